"""Simulated drives behind real sockets and serial ports."""

import asyncio
import errno
from collections import deque
from collections.abc import Callable
from typing import Final, Protocol

from gateway.modbus.lengths import ADU_OVERHEAD, MIN_ADU
from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from gateway.simulator.bus import DriveBus
from gateway.simulator.clock import DeadlineTimer, SimulationClock, loop_now_ns
from gateway.simulator.ears import Hearing, Uart
from gateway.simulator.errors import SimulatorError
from gateway.simulator.pty import FdChannel
from gateway.simulator.wire import PLAIN, Cable, Lane, PacedWire
from gateway.times import NS_PER_S
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.listener import ProtocolListener, bound
from gateway.transport.tcp import is_no_address_here

GATEWAY_TARGET_FAILED: Final = 0x0B
"""A TCP device's exception for an unknown unit id (Modbus application protocol V1.1b3, section 7)."""


Delay = Callable[[int], float]
"""Unit id -> response delay of its drive in seconds."""


def _same_delay(delay_s: float | Delay) -> Delay:
    return delay_s if callable(delay_s) else lambda _unit_id: delay_s


class _DelayedSender:
    """Sends replies after the drive's response delay, in the order of the requests."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._alarm = DeadlineTimer(self._send_due)

    def send(self, adu: bytes, delay_s: float) -> None:
        if not delay_s and not self._waiting:
            self._send(adu)
            return
        due_ns = loop_now_ns() + round(delay_s * NS_PER_S)
        self._waiting.append((max(due_ns, self._waiting[-1][0]) if self._waiting else due_ns, adu))
        self._alarm.set(self._waiting[0][0])

    def close(self) -> None:
        self._waiting.clear()
        self._alarm.set(None)

    def _send_due(self) -> None:
        now_ns = loop_now_ns()
        while self._waiting and self._waiting[0][0] <= now_ns:
            self._send(self._waiting.popleft()[1])
        self._alarm.set(self._waiting[0][0] if self._waiting else None)


class _Obeying:
    """Executes whole requests and sends the replies as RTU frames."""

    def __init__(
        self, bus: DriveBus, clock: SimulationClock, send: Callable[[bytes], None], delay: Delay
    ) -> None:
        self._bus = bus
        self._clock = clock
        self._delay = delay
        self._sender = _DelayedSender(send)

    def obey(self, unit_id: int, pdu: bytes) -> None:
        self._reply(unit_id, self._bus.answer(unit_id, pdu, self._clock()))

    def refuse_damaged(self, data: bytes) -> bool:
        """Let a drive answer a frame with a wrong CRC, which some drives do. Return whether one did."""
        return self._reply(data[0], self._bus.bad_crc_reply(data[0], data[1]))

    def close(self) -> None:
        self._sender.close()

    def _reply(self, unit_id: int, reply: bytes | None) -> bool:
        if reply is None:
            return False
        self._sender.send(encode_rtu(unit_id, reply), self._delay(unit_id))
        return True


class _RtuUnit:
    """RTU bytes in, RTU bytes out: common to serial ports and RTU over TCP."""

    def __init__(self, obeying: _Obeying) -> None:
        self._obeying = obeying
        self._decoder = RtuRequestDecoder()
        self._silence = DeadlineTimer(self._on_silence)
        self._unread = b""
        """Bytes since the last whole frame."""

    def feed(self, data: bytes) -> None:
        self._unread += data
        self._answer(self._decoder.feed(data, loop_now_ns()))

    def close(self) -> None:
        self._silence.set(None)
        self._obeying.close()

    def _on_silence(self) -> None:
        is_due = self._decoder.deadline_ns is not None and loop_now_ns() >= self._decoder.deadline_ns
        self._answer(self._decoder.on_silence(loop_now_ns()))
        if is_due and len(self._unread) >= MIN_ADU and self._obeying.refuse_damaged(self._unread):
            self._unread = b""
            self._decoder.reset()
            self._silence.set(None)

    def _answer(self, requests: list[tuple[int, bytes]]) -> None:
        for unit_id, pdu in requests:
            self._obeying.obey(unit_id, pdu)
        if self._decoder.deadline_ns is None:
            self._unread = b""
        self._silence.set(self._decoder.deadline_ns)


class _HearingUnit:
    """Drives that receive each byte at its time on the wire, and find frames by the rule ``hearing``."""

    def __init__(self, obeying: _Obeying, hearing: Hearing, line: SerialEndpoint, cable: Cable) -> None:
        self._obeying = obeying
        self.uart = Uart(hearing, line.baudrate, line.bits_per_character)
        self._wire = PacedWire(line.baudrate, line.bits_per_character, cable.faults)
        self._alarm = DeadlineTimer(self._listen)

    def feed(self, data: bytes) -> None:
        """Send bytes to the drives."""
        self._wire.send(data, loop_now_ns())
        self._listen()

    def close(self) -> None:
        self._alarm.set(None)
        self._obeying.close()

    def _listen(self) -> None:
        now_ns = loop_now_ns()
        for arrival in self._wire.arrivals(now_ns):
            self._take(self.uart.receive(arrival))
        self._take(self.uart.take(now_ns))
        due = [each for each in (self._wire.deadline_ns, self.uart.deadline_ns) if each is not None]
        self._alarm.set(min(due, default=None))

    def _take(self, frame: bytes) -> None:
        if frame:
            self._obeying.obey(frame[0], frame[1 : len(frame) + 1 - ADU_OVERHEAD])
        elif self.uart.damaged:
            damaged, self.uart.damaged = self.uart.damaged, b""
            self._obeying.refuse_damaged(damaged)


class _Part(Protocol):
    def close(self) -> None: ...


class SerialDriveServer:
    """Drives on a serial port, given by a raw, non-blocking descriptor: a pty's master or an opened device.

    With ``wire`` the bytes take the time that they need at that port's baud rate, in both directions.
    ``response_delay_s`` is that of all drives, or a function of the unit id. ``cable`` describes the line
    beyond its baud rate; it requires ``wire``.
    """

    def __init__(
        self,
        bus: DriveBus,
        clock: SimulationClock,
        fd: int,
        *,
        response_delay_s: float | Delay = 0.0,
        wire: SerialEndpoint | None = None,
        cable: Cable = PLAIN,
    ) -> None:
        self.bus = bus
        self.uart: Uart | None = None
        """The rule by which its drives find frames, if the cable has one."""
        channel = FdChannel(fd)
        to_gateway = Lane(channel.send, wire, cable.faults, cable.adapter)
        obeying = _Obeying(bus, clock, to_gateway.send, _same_delay(response_delay_s))
        if cable.hearing is not None and wire is not None:
            hearing = _HearingUnit(obeying, cable.hearing, wire, cable)
            self.uart = hearing.uart
            self._parts: tuple[_Part, ...] = (channel, hearing, to_gateway)
            channel.listen(hearing.feed)
            return
        unit = _RtuUnit(obeying)
        to_drives = Lane(unit.feed, wire, cable.faults)
        self._parts = (channel, to_drives, unit, to_gateway)
        channel.listen(to_drives.send)

    def close(self) -> None:
        """Stop answering; the descriptor stays open."""
        for part in self._parts:
            part.close()


class TcpDriveServer:
    """Drives on a TCP port: Modbus TCP, or raw RTU frames (``rtu``) like serial device servers."""

    def __init__(
        self,
        bus: DriveBus,
        clock: SimulationClock,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        rtu: bool = False,
        response_delay_s: float | Delay = 0.0,
    ) -> None:
        self.bus = bus
        self.host = host
        self.port = port
        self._clock = clock
        self.rtu = rtu
        self._delay = _same_delay(response_delay_s)
        self._listener = ProtocolListener(self._connection)
        self._connections: set[_Connection] = set()

    async def start(self) -> None:
        """Listen; a port of 0 is replaced by the port that the system chose.

        Raises:
            SimulatorError: the address is in use or not an address of this machine.
        """
        try:
            self._listener.open(await bound(self.host, self.port))
        except OSError as error:
            raise SimulatorError(f"cannot listen on {self.host}:{self.port}: {_why(error)}") from error
        self.port = self._listener.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Close the listener and every connection."""
        await self._listener.close()
        self.drop_connections()

    def drop_connections(self) -> None:
        """Close every connection, like a drive that is switched off; the listener stays."""
        for connection in tuple(self._connections):
            connection.abort()

    def _connection(self) -> asyncio.Protocol:
        if self.rtu:
            return _RtuConnection(self.bus, self._clock, self._delay, self._connections)
        return _MbapConnection(self.bus, self._clock, self._delay, self._connections)


class _Connection(asyncio.Protocol):
    """Common part of both kinds of connection."""

    def __init__(
        self, bus: DriveBus, clock: SimulationClock, delay: Delay, connections: "set[_Connection]"
    ) -> None:
        self.bus = bus
        self.clock = clock
        self.delay = delay
        self._connections = connections
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        self._transport = transport
        self._connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._connections.discard(self)
        self._transport = None

    def send(self, adu: bytes) -> None:
        if self._transport is not None:
            self._transport.write(adu)

    def abort(self) -> None:
        if self._transport is not None:
            self._transport.abort()


class _RtuConnection(_Connection):
    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._unit = _RtuUnit(_Obeying(self.bus, self.clock, self.send, self.delay))

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._unit.close()

    def data_received(self, data: bytes) -> None:
        self._unit.feed(data)


class _MbapConnection(_Connection):
    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._decoder = MbapDecoder()
        self._sender = _DelayedSender(self.send)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._sender.close()

    def data_received(self, data: bytes) -> None:
        requests = self._decoder.feed(data)
        if self._decoder.counters.bad_headers:
            self.abort()  # Not Modbus TCP, or permanently out of step.
            return
        for transaction_id, unit_id, pdu in requests:
            reply = self.bus.answer(unit_id, pdu, self.clock())
            if reply is None and pdu and not self.bus.has(unit_id):
                reply = bytes((pdu[0] | 0x80, GATEWAY_TARGET_FAILED))
            if reply is not None:
                self._sender.send(encode_mbap(transaction_id, unit_id, reply), self.delay(unit_id))


def _why(error: OSError) -> str:
    """Return why an address cannot be opened, and what to do about it."""
    if is_no_address_here(error):
        return "not an address of this machine; give the drives an address of this machine, such as 127.0.0.1"
    match error.errno:
        case errno.EADDRINUSE:
            return "the port is in use; stop the program that uses it, or give the drives another port"
        case errno.EACCES:
            return "no permission; give the drives a port above 1023"
    return f"{error.strerror or error}; give the drives an address of this machine, such as 127.0.0.1"
