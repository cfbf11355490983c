"""How bytes travel on a serial wire: pacing, with time as an argument, and lanes on the running loop.

One :class:`PacedWire` is one direction. Every byte takes its character time (Modbus over serial line V1.02,
2.5.1: start bit, data bits, parity, stop bits), one after the other. A byte has arrived when its last bit
has. The :class:`Adapter` decides when the receiving computer gets it.
"""

import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Final

from gateway.options import Option, Options
from gateway.simulator.clock import DeadlineTimer, loop_now_ns
from gateway.simulator.ears import Hearing, TimedByte
from gateway.simulator.errors import SimulatorError
from gateway.simulator.pty import FdChannel
from gateway.times import NS_PER_MS, NS_PER_S
from gateway.transport.endpoints import SerialEndpoint

LatencyTimer = Annotated[
    float,
    Option("ms for which the gateway's ports collect bytes, like a USB adapter.", "latency-timer", min=0.0),
]
BurstBytes = Annotated[int, Option("They hand over earlier when they have so many bytes.", "lump", min=1)]
Jitter = Annotated[float, Option("Now and then they hand over up to so many ms later.", "jitter", min=0.0)]
Noise = Annotated[float, Option("Share of serial bytes followed by noise.", min=0.0, max=1.0)]
_Share = Annotated[float, Option("Probability.", min=0.0, max=1.0)]


@dataclass(frozen=True, slots=True)
class WireFaults(Options):
    """Faults of a wire. Probabilities are per byte, from a seeded generator."""

    garble: _Share = 0.0
    """One bit of the byte is inverted."""
    drop: _Share = 0.0
    """The byte is lost; its time passes."""
    noise: Noise = 0.0
    """An extra byte follows that was not sent."""
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Adapter(Options):
    """How a receiver passes on received bytes: each byte as it arrives, unless set otherwise.

    A burst leaves at whichever condition comes first. Bursts keep their order.
    """

    latency_timer_ms: LatencyTimer = 0.0
    """So long after its first byte came (FTDI: 16 ms by default, often set to 1 ms)."""
    quiet_characters: Annotated[float, Option("Silence, in characters.", min=0.0)] = 0.0
    """After a silence of so many characters (four in a UART of the kind 16550)."""
    burst_bytes: BurstBytes = 62
    """At so many bytes (62 in a packet of FTDI; 8 or 14 are levels of a UART's FIFO)."""
    jitter_ms: Jitter = 0.0
    """Random extra delay up to this: driver and machine load."""
    seed: int = 0

    @property
    def gathers(self) -> bool:
        """Whether bytes wait for others."""
        return bool(self.latency_timer_ms or self.quiet_characters)


AT_ONCE: Final = Adapter()


class PacedWire:
    """Bytes in at one end, bytes out at the other, later.

    >>> wire = PacedWire(baudrate=9600, bits_per_character=10)
    >>> wire.send(b"ab", now_ns=0)
    >>> wire.deadline_ns, wire.receive(1_100_000), wire.receive(2_083_334)
    (1041667, b'a', b'b')
    """

    def __init__(
        self,
        baudrate: int,
        bits_per_character: int = 11,
        faults: WireFaults | None = None,
        adapter: Adapter = AT_ONCE,
    ) -> None:
        if baudrate <= 0:
            raise SimulatorError(f"baud rate {baudrate}: it must be above 0")
        self.bytes_garbled = 0
        self.bytes_dropped = 0
        self.bytes_of_noise = 0
        self._baudrate = baudrate
        self._bits = bits_per_character
        self._faults = faults or WireFaults()
        self._adapter = adapter
        self._rng = random.Random(self._faults.seed)
        self._jitter = random.Random(adapter.seed)
        self._busy_from_ns = 0
        self._busy_bytes = 0
        self._on_wire: deque[TimedByte] = deque()
        self._burst = bytearray()
        self._burst_begun_ns = 0
        self._burst_due_ns = 0
        self._quiet_ns = round(adapter.quiet_characters * bits_per_character * NS_PER_S / baudrate)
        self._handed_over: deque[tuple[int, bytes]] = deque()
        """Bursts that have left the adapter, with the time at which the computer gets them."""

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`receive` is next due; None while nothing travels."""
        due = [self._burst_due_ns] if self._burst else []
        due += [self._on_wire[0].came_ns] if self._on_wire else []
        due += [self._handed_over[0][0]] if self._handed_over else []
        return min(due, default=None)

    def send(self, data: bytes, now_ns: int) -> None:
        """Put bytes on the wire, after those that still travel."""
        if now_ns >= self._free_at_ns(self._busy_bytes):
            self._busy_from_ns, self._busy_bytes = now_ns, 0
        for byte in data:
            damaged = self._damage(byte)
            self._travels(damaged)
            if self._faults.noise and self._rng.random() < self._faults.noise:
                self.bytes_of_noise += 1
                self._travels(self._rng.randrange(0x100))

    def arrivals(self, now_ns: int) -> list[TimedByte]:
        """Return the bytes at the far end by ``now_ns``, before its adapter: what a drive receives."""
        arrived = []
        while self._on_wire and self._on_wire[0].came_ns <= now_ns:
            arrived.append(self._on_wire.popleft())
        return arrived

    def receive(self, now_ns: int) -> bytes:
        """Return the bytes that the computer at the far end can read at ``now_ns``."""
        for came_ns, byte in self.arrivals(now_ns):
            if self._burst and came_ns >= self._burst_due_ns:  # a burst that was due before leaves first
                self._hand_over(self._burst_due_ns)
            self._gather(byte, came_ns)
        if self._burst and now_ns >= self._burst_due_ns:
            self._hand_over(self._burst_due_ns)
        there = bytearray()
        while self._handed_over and self._handed_over[0][0] <= now_ns:
            there += self._handed_over.popleft()[1]
        return bytes(there)

    def _free_at_ns(self, count: int) -> int:
        """When the wire is free, ``count`` characters after the start of this burst; rounded up once."""
        return self._busy_from_ns - (-count * self._bits * NS_PER_S // self._baudrate)

    def _travels(self, byte: int | None) -> None:
        """Let a character's time pass; None: without a character."""
        self._busy_bytes += 1
        if byte is not None:
            self._on_wire.append(TimedByte(self._free_at_ns(self._busy_bytes), byte))

    def _damage(self, byte: int) -> int | None:
        faults = self._faults
        if faults.drop and self._rng.random() < faults.drop:
            self.bytes_dropped += 1
            return None
        if faults.garble and self._rng.random() < faults.garble:
            self.bytes_garbled += 1
            return byte ^ (1 << self._rng.randrange(8))
        return byte

    def _gather(self, byte: int, came_ns: int) -> None:
        """Pass a byte to the adapter."""
        adapter = self._adapter
        if not self._burst:
            self._burst_begun_ns = came_ns
        self._burst.append(byte)
        if not adapter.gathers or len(self._burst) >= adapter.burst_bytes:
            self._hand_over(came_ns)
            return
        due = []
        if adapter.latency_timer_ms:
            due.append(self._burst_begun_ns + round(adapter.latency_timer_ms * NS_PER_MS))
        if adapter.quiet_characters:
            due.append(came_ns + self._quiet_ns)
        self._burst_due_ns = min(due)

    def _hand_over(self, now_ns: int) -> None:
        there_ns = now_ns + round(self._jitter.random() * self._adapter.jitter_ms * NS_PER_MS)
        if self._handed_over:
            there_ns = max(there_ns, self._handed_over[-1][0])
        self._handed_over.append((there_ns, bytes(self._burst)))
        self._burst.clear()


# --- On the running loop


@dataclass(frozen=True, slots=True)
class Cable:
    """Properties of a serial line besides its baud rate."""

    adapter: Adapter = AT_ONCE
    """Of the port that the gateway opens."""
    faults: WireFaults | None = None
    """On the wire, in both directions."""
    hearing: Hearing | None = None
    """Rule by which its drives find frames. None: each whole, valid frame is accepted immediately, with or
    without silences."""


PLAIN: Final = Cable()


class Lane:
    """One direction of a wire: sent bytes come out of ``deliver`` at their time.

    Without ``line`` that is immediately; with it, after the time of its baud rate and character format.
    """

    def __init__(
        self,
        deliver: Callable[[bytes], None],
        line: SerialEndpoint | None,
        faults: WireFaults | None = None,
        adapter: Adapter = AT_ONCE,
    ) -> None:
        self.wire = PacedWire(line.baudrate, line.bits_per_character, faults, adapter) if line else None
        self._deliver = deliver
        self._alarm = DeadlineTimer(self._arrive)

    def send(self, data: bytes) -> None:
        """Put bytes on the wire."""
        if self.wire is None:
            self._deliver(data)
            return
        self.wire.send(data, loop_now_ns())
        self._alarm.set(self.wire.deadline_ns)

    def close(self) -> None:
        """Stop; bytes that still travel are lost."""
        self._alarm.set(None)

    def _arrive(self) -> None:
        assert self.wire is not None
        data = self.wire.receive(loop_now_ns())
        self._alarm.set(self.wire.deadline_ns)
        if data:
            self._deliver(data)


class SerialWire:
    """Joins two ports, each given by the master descriptor of its pty; see :class:`Lane`.

    The adapter of ``cable`` is that of the left port.
    """

    def __init__(
        self, left_fd: int, right_fd: int, line: SerialEndpoint | None, cable: Cable = PLAIN
    ) -> None:
        left, right = FdChannel(left_fd), FdChannel(right_fd)
        self.to_right = Lane(right.send, line, cable.faults)
        self.to_left = Lane(left.send, line, cable.faults, cable.adapter)
        self._parts = (left, right, self.to_right, self.to_left)
        left.listen(self.to_right.send)
        right.listen(self.to_left.send)

    def close(self) -> None:
        """Disconnect; the descriptors stay open."""
        for part in self._parts:
            part.close()
