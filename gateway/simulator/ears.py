"""How drives find frames in received bytes: as the standard says, and in other known ways. Sans-IO.

A gateway that sends aborted frames depends on what drives make of them. A :class:`Uart` records when each
byte came. Its :class:`Hearing` is the rule by which one kind of drive finds frames.
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
    """When its last bit arrived."""
    byte: int


class Hearing(Enum):
    """The rule by which a kind of drive finds frames."""

    __hash__ = object.__hash__

    STANDARD = "standard"
    """A frame is between two silences of t3.5, has no pause of t1.5, the length in its header, and a valid
    CRC."""
    ANY_LENGTH = "any-length"
    """A frame with a valid CRC between two silences, of any length. If bytes are missing, the drive takes the
    old content of its buffer; extra bytes are ignored."""
    MERGING = "merging"
    """Like ANY_LENGTH, but only 10 ms of silence end a frame: frames with less silence between them count as
    one."""
    NO_CHECK = "no-check"
    """A frame of the length in its header, with any CRC."""


def ends_ns(hearing: Hearing, baudrate: int, bits_per_character: int = 11) -> int:
    """Return the silence after which a kind of drive has a frame, in ns.

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
        """The last wrong frame, as received."""
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
        """When the present frame ends if no more bytes come; None: no bytes were received.

        A character that began just before the silence was long enough still has to arrive.
        """
        return self._last_ns + self._ends_ns + self._character_ns if self._heard else None

    def receive(self, arrival: TimedByte) -> bytes:
        """Take a byte; return the frame that ended before it, or empty."""
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
        """Return the frame that has ended by ``now_ns`` and that the drive executes; empty: there is none."""
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
