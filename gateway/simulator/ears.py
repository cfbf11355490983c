"""How drives make frames of what they hear: what the standard says, and what else there is. Sans-IO.

A gateway that sends frames which are no frames has to know what drives make of them. An :class:`Uart` knows
when each byte came; by :class:`Hearing` it finds frames as one kind of drive does.
"""

from enum import Enum
from typing import Final, NamedTuple

from gateway.modbus.crc import is_intact
from gateway.modbus.lengths import MAX_ADU, MIN_ADU, UNTIL_SILENCE, request_length
from gateway.modbus.rtu_line import pause_ns, silence_ns
from gateway.times import NS_PER_MS, NS_PER_S

MERGED_NS: Final = 10 * NS_PER_MS


class TimedByte(NamedTuple):
    """A byte at the end of a wire."""

    came_ns: int
    """When its last bit was there."""
    byte: int


class Hearing(Enum):
    """What a kind of drive takes for a frame."""

    __hash__ = object.__hash__

    STANDARD = "standard"
    """What stands between two silences of t3.5 without a pause of t1.5, is as long as it says, and intact."""
    ANY_LENGTH = "any-length"
    """What is intact between two silences, however long: what its head counts and did not come is what the
    drive's buffer held before, what came behind it is left alone."""
    MERGING = "merging"
    """As ANY_LENGTH, but only 10 ms of silence end a frame: what is nearer together is one."""
    NO_CHECK = "no-check"
    """What is as long as it says, whatever its check sum is."""


def ends_ns(hearing: Hearing, baudrate: int, bits_per_character: int = 11) -> int:
    """Return after how much silence a kind of drive has a frame, in ns.

    >>> ends_ns(Hearing.STANDARD, 38400), ends_ns(Hearing.MERGING, 38400)
    (1750000, 10000000)
    """
    ends = silence_ns(baudrate, bits_per_character)
    return max(ends, MERGED_NS) if hearing is Hearing.MERGING else ends


class Uart:
    """One drive's UART and its buffer.

    >>> uart = Uart(Hearing.STANDARD, baudrate=1000, bits_per_character=10)
    >>> for at, byte in enumerate(bytes.fromhex("01 06 31 00 00 0F C7 32")):
    ...     _ = uart.receive(TimedByte(10_000_000 * at, byte))
    >>> uart.deadline_ns
    115000000
    >>> uart.take(115_000_000).hex(" ")
    '01 06 31 00 00 0f c7 32'
    """

    def __init__(self, hearing: Hearing, baudrate: int, bits_per_character: int = 11) -> None:
        self.frames_broken = 0
        """By a pause of more than t1.5, or longer than any frame."""
        self.frames_odd = 0
        """With a wrong check sum or length."""
        self.damaged = b""
        """The last one that was wrong, as it came."""
        self._hearing = hearing
        self._ends_ns = ends_ns(hearing, baudrate, bits_per_character)
        self._breaks_ns = pause_ns(silence_ns(baudrate, bits_per_character))
        self._character_ns = round(bits_per_character * NS_PER_S / baudrate)
        self._buffer = bytearray(MAX_ADU)
        self._heard = 0
        self._last_ns = 0
        self._is_broken = False

    @property
    def deadline_ns(self) -> int | None:
        """When what was heard has ended, if nothing more comes; None: nothing was heard.

        A character that began just before the silence was long enough takes its time to come.
        """
        return self._last_ns + self._ends_ns + self._character_ns if self._heard else None

    def receive(self, arrival: TimedByte) -> bytes:
        """Take a byte; return the frame that had ended before it came, empty where there is none."""
        ended = self.take(arrival.came_ns)
        if self._heard:
            pause = arrival.came_ns - self._character_ns - self._last_ns
            self._is_broken |= self._hearing is Hearing.STANDARD and pause > self._breaks_ns
        if self._heard < MAX_ADU:
            self._buffer[self._heard] = arrival.byte
            self._heard += 1
        else:
            self._is_broken = True
        self._last_ns = arrival.came_ns
        return ended

    def take(self, now_ns: int) -> bytes:
        """Return the frame that has ended by ``now_ns``, as the drive obeys it; empty: there is none."""
        if self.deadline_ns is None or now_ns < self.deadline_ns:
            return b""
        heard, is_broken = bytes(self._buffer[: self._heard]), self._is_broken
        self._heard, self._is_broken = 0, False
        if is_broken:
            self.frames_broken += 1
            return b""
        frame = self._frame_of(heard)
        if not frame:
            self.frames_odd += 1
            self.damaged = heard
        return frame

    def _frame_of(self, heard: bytes) -> bytes:
        if len(heard) < MIN_ADU:
            return b""
        length = request_length(heard if self._wants_length else bytes(self._buffer))
        if self._hearing is not Hearing.NO_CHECK and not is_intact(heard):
            return b""
        if length < MIN_ADU:
            return heard if length == UNTIL_SILENCE else b""
        if self._wants_length:
            return heard if length == len(heard) else b""
        return bytes(self._buffer[:length])

    @property
    def _wants_length(self) -> bool:
        return self._hearing is Hearing.STANDARD or self._hearing is Hearing.NO_CHECK
