"""The simulated controller's end of the cable: a Modbus master over TCP or over a serial port."""

import asyncio
import os
from contextlib import suppress
from typing import Protocol

from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.rtu import RtuReplyDecoder, encode_rtu
from gateway.simulator.clock import Alarm, loop_now_ns
from gateway.simulator.errors import NoReplyError
from gateway.simulator.pty import FdChannel, open_serial

DEFAULT_TIMEOUT_S = 1.0


class Master(Protocol):
    """One connection that carries one exchange at a time."""

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request and return the reply's PDU, also an exception's.

        Raises:
            NoReplyError: nothing came back in time, or the connection is gone.
        """
        ...

    async def close(self) -> None:
        """Close the connection or the port."""
        ...


class _Pending:
    """The reply that is waited for."""

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._reply: asyncio.Future[bytes] | None = None

    async def wait(self, what: str) -> bytes:
        self._reply = asyncio.get_running_loop().create_future()
        try:
            return await asyncio.wait_for(self._reply, self._timeout_s)
        except TimeoutError:
            raise NoReplyError(f"{what}: no reply within {self._timeout_s:g} s") from None
        finally:
            self._reply = None

    def resolve(self, pdu: bytes) -> None:
        if self._reply is not None and not self._reply.done():
            self._reply.set_result(pdu)

    def fail(self, why: str) -> None:
        if self._reply is not None and not self._reply.done():
            self._reply.set_exception(NoReplyError(why))


class TcpMaster(asyncio.Protocol):
    """Modbus TCP. Open one with :meth:`connect`."""

    def __init__(self, timeout_s: float) -> None:
        self._pending = _Pending(timeout_s)
        self._decoder = MbapDecoder()
        self._transaction_id = 0
        self._transport: asyncio.Transport | None = None
        self._closed = asyncio.get_running_loop().create_future()

    @classmethod
    async def connect(cls, host: str, port: int, timeout_s: float = DEFAULT_TIMEOUT_S) -> "TcpMaster":
        """Connect.

        Raises:
            OSError: nobody listens there.
        """
        loop = asyncio.get_running_loop()
        _, master = await loop.create_connection(lambda: cls(timeout_s), host, port)
        return master

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """See :class:`Master`."""
        if self._transport is None:
            raise NoReplyError("the connection is closed")
        self._transaction_id = (self._transaction_id + 1) & 0xFFFF
        self._transport.write(encode_mbap(self._transaction_id, unit_id, pdu))
        return await self._pending.wait(f"unit {unit_id}, function {pdu[0]}")

    async def close(self) -> None:
        """See :class:`Master`."""
        if self._transport is not None:
            self._transport.close()
        await self._closed

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by the loop."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by the loop."""
        self._transport = None
        self._pending.fail(f"the connection was closed: {exc or 'by the other side'}")
        if not self._closed.done():
            self._closed.set_result(None)

    def data_received(self, data: bytes) -> None:
        """Called by the loop: a reply to an earlier request is late and dropped."""
        for transaction_id, _, pdu in self._decoder.feed(data):
            if transaction_id == self._transaction_id:
                self._pending.resolve(pdu)


class RtuMaster:
    """Modbus RTU on a raw, non-blocking descriptor: the master of a pty, or a port opened by :meth:`open`."""

    def __init__(self, fd: int, timeout_s: float = DEFAULT_TIMEOUT_S, *, owns_fd: bool = False) -> None:
        self._pending = _Pending(timeout_s)
        self._decoder = RtuReplyDecoder()
        self._silence = Alarm(self._on_silence)
        self._channel = FdChannel(fd)
        self._channel.listen(self._feed, lambda: self._pending.fail("the port is gone"))
        self._own_fd = fd if owns_fd else None

    @classmethod
    def open(cls, path: str, timeout_s: float = DEFAULT_TIMEOUT_S) -> "RtuMaster":
        """Open a serial port.

        Raises:
            OSError: there is no such port, or no permission.
        """
        return cls(open_serial(path), timeout_s, owns_fd=True)

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """See :class:`Master`."""
        self._decoder.expect(unit_id, pdu)
        self._channel.send(encode_rtu(unit_id, pdu))
        return await self._pending.wait(f"unit {unit_id}, function {pdu[0]}")

    async def close(self) -> None:
        """See :class:`Master`."""
        self._channel.close()
        self._silence.set(None)
        if self._own_fd is not None:
            with suppress(OSError):
                os.close(self._own_fd)
            self._own_fd = None

    def _feed(self, data: bytes) -> None:
        self._resolve(self._decoder.feed(data, loop_now_ns()))

    def _on_silence(self) -> None:
        self._resolve(self._decoder.on_silence(loop_now_ns()))

    def _resolve(self, replies: list[tuple[int, bytes]]) -> None:
        for _, pdu in replies:
            self._pending.resolve(pdu)
        self._silence.set(self._decoder.deadline_ns)
