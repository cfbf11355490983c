"""A Modbus master: one exchange at a time with the drives of a line, for tools and trials.

It keeps the timing of the gateway's own drive side: before each request, the silence that a drive needs.
After a time-out on a line without transaction ids, it keeps a longer silence, so that no late reply is taken
for another. It never sends a request twice. docs/decisions/0032 says why it is not the master of pymodbus.
"""

import asyncio
from types import TracebackType
from typing import Final, Protocol, Self

from gateway.clock import boot_ns
from gateway.modbus.crc import inverted_crc, residue_after
from gateway.modbus.mbap import MbapDecoder, answers_with, encode_mbap
from gateway.modbus.rtu import RtuReplyDecoder, encode_rtu
from gateway.times import NS_PER_MS, NS_PER_S
from gateway.transport.channel import Channel
from gateway.transport.devices import open_port
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.framing import frame_silence_ns, reply_decoder
from gateway.transport.serial_channel import SerialChannel
from gateway.transport.tcp import connect
from gateway.transport.timer import Timer

SHOWN_BYTES: Final = 32
LAST_ID: Final = 0xFFFF
FIRST_ID: Final = 1
"""Transaction ids wrap without 0: some servers reply with 0 to every request."""


class NoReplyError(Exception):
    """Base of the reasons for a missing reply; one sentence."""


class SilentError(NoReplyError):
    """Nothing came in time."""


class GarbledError(NoReplyError):
    """Bytes came in time, but they made no reply."""


class OtherIdError(NoReplyError):
    """A Modbus/TCP reply came in time, with another transaction id than the request."""


class LostError(NoReplyError):
    """The connection or the port is gone."""


class _Framing(Protocol):
    """How requests and replies are framed."""

    @property
    def deadline_ns(self) -> int | None:
        """When the silence ends a frame."""
        ...

    @property
    def returned(self) -> int:
        """How many reads of registers in a row were echoed."""
        ...

    def request(self, unit_id: int, pdu: bytes) -> bytes:
        """Return the frame of a request, and expect its reply."""
        ...

    def feed(self, data: bytes, now_ns: int) -> list[bytes]:
        """Return the PDU of the reply, if it is complete."""
        ...

    def silent(self, now_ns: int) -> list[bytes]:
        """Return the reply that the silence has ended, if there is one."""
        ...

    def give_up(self) -> str:
        """Expect nothing any more; return what the drive did instead of replying, "": unknown."""
        ...


class _RtuFraming:
    def __init__(self, decoder: RtuReplyDecoder) -> None:
        self._decoder = decoder

    @property
    def deadline_ns(self) -> int | None:
        return self._decoder.deadline_ns

    @property
    def returned(self) -> int:
        return self._decoder.returned

    def request(self, unit_id: int, pdu: bytes) -> bytes:
        self._decoder.expect(unit_id, pdu)
        return encode_rtu(unit_id, pdu)

    def feed(self, data: bytes, now_ns: int) -> list[bytes]:
        return [pdu for _, pdu in self._decoder.feed(data, now_ns)]

    def silent(self, now_ns: int) -> list[bytes]:
        return [pdu for _, pdu in self._decoder.on_silence(now_ns)]

    def give_up(self) -> str:
        self._decoder.cancel()
        return ""


class _MbapFraming:
    deadline_ns = None
    returned = 0

    def __init__(self) -> None:
        self._decoder = MbapDecoder()
        self._transaction_id = 0
        self._given_up: set[int] = set()
        """Ids whose reply may come late; cleared when the ids wrap."""
        self._other_id: int | None = None
        """Id of a reply that belongs to no request."""

    def request(self, unit_id: int, pdu: bytes) -> bytes:
        if self._transaction_id == LAST_ID:
            self._transaction_id = FIRST_ID - 1
            self._given_up.clear()
        self._transaction_id += 1
        self._other_id = None
        return encode_mbap(self._transaction_id, unit_id, pdu)

    def feed(self, data: bytes, now_ns: int) -> list[bytes]:
        replies = []
        for number, _, pdu in self._decoder.feed(data):
            if number == self._transaction_id:
                replies.append(pdu)
            elif number not in self._given_up and (number == 0 or number != self._transaction_id - 1):
                # Otherwise it answers an earlier request, late or twice.
                self._other_id = number
        return replies

    def silent(self, now_ns: int) -> list[bytes]:
        return []

    def give_up(self) -> str:
        self._given_up.add(self._transaction_id)
        return "" if self._other_id is None else answers_with(self._transaction_id, self._other_id)


class ModbusMaster:
    """A master on one line; enter it to open the line, leave it to close it.

    ``gap_ms``: silence that the drives need before a request, beyond that of the line. ``drain_ms``: silence
    after a time-out; 0: ``timeout_ms``.
    """

    def __init__(
        self,
        endpoint: TcpEndpoint | SerialEndpoint,
        timeout_ms: float = 1000.0,
        gap_ms: float = 0.0,
        drain_ms: float = 0.0,
    ) -> None:
        self._endpoint = endpoint
        self._timeout_s = timeout_ms / 1000.0
        self._gap_ns = int(gap_ms * NS_PER_MS)
        self._drain_ns = int((drain_ms or timeout_ms) * NS_PER_MS)
        self._has_ids = isinstance(endpoint, TcpEndpoint) and not endpoint.rtu
        self._framing: _Framing = _MbapFraming() if self._has_ids else _RtuFraming(reply_decoder(endpoint))
        self._channel: Channel | None = None
        self._lost: asyncio.Future[None] | None = None
        self._timer: Timer | None = None
        self._lock = asyncio.Lock()
        self._reply: asyncio.Future[bytes] | None = None
        self._heard = b""
        self._quiet_ns = 0
        """When the next request may be sent."""
        self._is_draining = False
        self.took_ns = 0
        """From the write of the newest answered request to the last byte of its reply."""
        self._sent_ns = 0

    async def __aenter__(self) -> Self:
        """Open the line.

        Raises:
            TransportError: no answer, in use, no permission; with the remedy.
        """
        if isinstance(self._endpoint, SerialEndpoint):
            port, _ = open_port(self._endpoint)
            channel = SerialChannel(port, self._endpoint, self)
            channel.begin()
            self._lost = channel.lost
        else:
            self._lost = (await connect(self._endpoint, self)).lost
        self._timer = Timer(self._silent)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the line."""
        if self._timer is not None:
            self._timer.close()
        if self._channel is not None:
            self._channel.close()
        if self._lost is not None:
            await asyncio.wait([self._lost])

    @property
    def returned(self) -> int:
        """How many reads of registers in a row were echoed; see ``RtuReplyDecoder.returned``."""
        return self._framing.returned

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request and return the PDU of its reply, also an exception.

        Raises:
            SilentError: nothing came in time.
            OtherIdError: what came in time carries another transaction id.
            GarbledError: what came in time is no reply.
            LostError: the connection or the port is gone.
        """
        return await self._ask(unit_id, pdu)

    async def exchange_with_wrong_crc(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request on an RTU line with its CRC inverted: the right reaction is silence.

        Returns the PDU of a reply that came nevertheless; raises as :meth:`exchange`.
        """
        assert not self._has_ids, "Modbus TCP has no check sums"
        return await self._ask(unit_id, pdu, has_wrong_crc=True)

    async def _ask(self, unit_id: int, pdu: bytes, *, has_wrong_crc: bool = False) -> bytes:
        async with self._lock:
            await self._wait_for_silence()
            if self._channel is None:
                raise LostError(f"the connection to {self._endpoint} is closed")
            self._heard = b""
            self._reply = asyncio.get_running_loop().create_future()
            frame = self._framing.request(unit_id, pdu)
            if has_wrong_crc:
                body = frame[: 1 + len(pdu)]
                frame = body + inverted_crc(residue_after(body))
            self._sent_ns = boot_ns()
            self._channel.write(frame)
            self._quiet_ns = boot_ns() + len(frame) * self._channel.wire_ns_per_byte + self._gap()
            try:
                async with asyncio.timeout(self._timeout_s):
                    return await self._reply
            except TimeoutError:
                raise self._nothing() from None
            finally:
                self._reply = None

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``. The traffic before is unknown: it begins with a silence."""
        self._channel = channel
        self._quiet_ns = now_ns + self._gap()

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``."""
        self._heard = (self._heard + data)[-SHOWN_BYTES:]
        self._quiet_ns = max(self._quiet_ns, now_ns + self._gap())
        self._resolve(self._framing.feed(data, now_ns), now_ns)

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        self._channel = None
        if self._reply is not None and not self._reply.done():
            self._reply.set_exception(LostError(f"{self._endpoint}: {reason}"))

    def _gap(self) -> int:
        if self._is_draining:
            return max(self._drain_ns, self._gap_ns)
        is_wire = self._channel is not None and self._channel.wire_ns_per_byte
        if is_wire and isinstance(self._endpoint, SerialEndpoint):
            return max(self._gap_ns, frame_silence_ns(self._endpoint))
        return self._gap_ns

    async def _wait_for_silence(self) -> None:
        while (left_ns := self._quiet_ns - boot_ns()) > 0:  # noqa: ASYNC110 - each byte postpones it
            await asyncio.sleep(left_ns / NS_PER_S)
        self._is_draining = False

    def _nothing(self) -> NoReplyError:
        """Give up on a reply, and say what came instead."""
        instead = self._framing.give_up()
        if not self._has_ids:
            self._is_draining = True
            self._quiet_ns = boot_ns() + self._gap()
        within = f"within {self._timeout_s * 1000.0:g} ms"
        if instead:
            return OtherIdError(instead)
        if self._heard:
            return GarbledError(f"no whole reply {within}; the last bytes were {self._heard.hex(' ')}")
        return SilentError(f"no reply {within}")

    def _silent(self, now_ns: int) -> None:
        self._resolve(self._framing.silent(now_ns), now_ns)

    def _resolve(self, replies: list[bytes], now_ns: int) -> None:
        if self._timer is not None:
            self._timer.arm(self._framing.deadline_ns)
        for pdu in replies:
            if self._reply is not None and not self._reply.done():
                self.took_ns = now_ns - self._sent_ns
                self._reply.set_result(pdu)
