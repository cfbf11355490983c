"""How bytes travel on a serial wire: the pacing core, with time as an argument.

One :class:`PacedWire` is one direction. Every byte takes its character time (Modbus over serial line V1.02,
2.5.1: start bit, data bits, parity, stop bits), one after the other; a byte is there when its last bit is.
"""

import random
from collections import deque
from dataclasses import dataclass

from gateway.simulator.errors import SimulatorError
from gateway.times import NS_PER_MS, NS_PER_S


@dataclass(frozen=True, slots=True)
class WireFaults:
    """What goes wrong on a wire. Probabilities are per byte, from a seeded generator.

    ``latency_timer_ms`` makes the receiver hand bytes over in lumps, as USB adapters do: when so many
    milliseconds have passed since the last lump (FTDI's default is 16) or when ``packet_bytes`` have
    gathered (62 on FTDI).
    """

    garble: float = 0.0
    drop: float = 0.0
    latency_timer_ms: float = 0.0
    packet_bytes: int = 62
    seed: int = 0


class PacedWire:
    """Bytes in at one end, bytes out at the other, later.

    >>> wire = PacedWire(baudrate=9600, bits_per_character=10)
    >>> wire.send(b"ab", now_ns=0)
    >>> wire.deadline_ns, wire.receive(1_100_000), wire.receive(2_083_334)
    (1041667, b'a', b'b')
    """

    def __init__(self, baudrate: int, bits_per_character: int = 11, faults: WireFaults | None = None) -> None:
        if baudrate <= 0:
            raise SimulatorError(f"baud rate {baudrate}: it must be above 0")
        self.bytes_garbled = 0
        self.bytes_dropped = 0
        self._baudrate = baudrate
        self._bits = bits_per_character
        self._faults = faults or WireFaults()
        self._rng = random.Random(self._faults.seed)
        self._busy_from_ns = 0
        self._busy_bytes = 0
        self._on_wire: deque[tuple[int, int]] = deque()  # (arrival, byte)
        self._adapter = bytearray()
        self._lump_due_ns: int | None = None

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`receive` has something to hand over next; None while nothing travels."""
        if not self._faults.latency_timer_ms:
            return self._on_wire[0][0] if self._on_wire else None
        due = [self._lump_due_ns] if self._lump_due_ns is not None else []
        due += [self._on_wire[0][0]] if self._on_wire else []
        return min(due, default=None)

    def send(self, data: bytes, now_ns: int) -> None:
        """Put bytes on the wire, behind those that are still travelling."""
        if now_ns >= self._free_at_ns(self._busy_bytes):
            self._busy_from_ns, self._busy_bytes = now_ns, 0
        for byte in data:
            self._busy_bytes += 1
            damaged = self._damage(byte)
            if damaged is not None:
                self._on_wire.append((self._free_at_ns(self._busy_bytes), damaged))

    def receive(self, now_ns: int) -> bytes:
        """Bytes that the far end can read at ``now_ns``."""
        arrived = bytearray()
        while self._on_wire and self._on_wire[0][0] <= now_ns:
            arrival_ns, byte = self._on_wire.popleft()
            if self._faults.latency_timer_ms:
                self._gather(byte, arrival_ns, arrived)
            else:
                arrived.append(byte)
        if self._lump_due_ns is not None and now_ns >= self._lump_due_ns:
            self._hand_over(arrived)
        return bytes(arrived)

    def _free_at_ns(self, count: int) -> int:
        """When the wire is free, ``count`` characters after the start of this burst: rounded up, once."""
        return self._busy_from_ns - (-count * self._bits * NS_PER_S // self._baudrate)

    def _damage(self, byte: int) -> int | None:
        faults = self._faults
        if faults.drop and self._rng.random() < faults.drop:
            self.bytes_dropped += 1
            return None
        if faults.garble and self._rng.random() < faults.garble:
            self.bytes_garbled += 1
            return byte ^ (1 << self._rng.randrange(8))
        return byte

    def _gather(self, byte: int, arrival_ns: int, arrived: bytearray) -> None:
        """Byte reaches the adapter: a lump that was due before leaves first."""
        if self._lump_due_ns is not None and arrival_ns >= self._lump_due_ns:
            self._hand_over(arrived)
        if self._lump_due_ns is None:
            self._lump_due_ns = arrival_ns + round(self._faults.latency_timer_ms * NS_PER_MS)
        self._adapter.append(byte)
        if len(self._adapter) >= self._faults.packet_bytes:
            self._hand_over(arrived)

    def _hand_over(self, arrived: bytearray) -> None:
        arrived += self._adapter
        self._adapter.clear()
        self._lump_due_ns = None
