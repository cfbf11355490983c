"""Common parts of both RTU decoders: bytes that wait for the rest of their frame, silence, and counters."""

from dataclasses import dataclass
from typing import Final

from gateway.modbus.errors import FrameError
from gateway.modbus.lengths import MIN_ADU
from gateway.times import NS_PER_S

Frame = tuple[int, bytes]
"""Unit id and PDU."""

SILENCE_CHARACTERS: Final = 3.5
FAST_ABOVE_BAUD: Final = 19200
FAST_SILENCE_NS: Final = 1_750_000
USB_PAUSE_NS: Final = 30_000_000
"""USB adapters deliver bytes up to 16 ms apart, even inside a frame: two of these pauses."""


def silence_ns(baudrate: int, bits_per_character: int = 11) -> int:
    """Return the silence between two frames in ns: 3.5 characters, a fixed 1.75 ms above 19200 Bd.

    Modbus over serial line V1.02, 2.5.1.1. Bits are counted with start, parity and stop bits.

    >>> silence_ns(9600)
    4010417
    >>> silence_ns(115200)
    1750000
    """
    if baudrate > FAST_ABOVE_BAUD:
        return FAST_SILENCE_NS
    return round(SILENCE_CHARACTERS * bits_per_character * NS_PER_S / baudrate)


def pause_ns(silence: int) -> int:
    """Return the longest pause inside a frame, from the silence between two, both in ns.

    1.5 of 3.5 characters, 750 µs of 1.75 ms; as :func:`silence_ns`. It is counted from the end of a character
    to the start of the next.

    >>> pause_ns(silence_ns(9600)), pause_ns(silence_ns(115200))
    (1718750, 750000)
    """
    return silence * 3 // 7


@dataclass(slots=True)
class RtuCounters:
    """What a decoder received besides good frames, since it was made."""

    crc_errors: int = 0
    """Lost frames: runs of at least four bytes that made no frame."""
    damaged: int = 0
    """Runs of bytes, however short, that made no frame: ``crc_errors`` and shorter ones."""
    dropped_bytes: int = 0
    """Bytes that belong to no frame, without those below."""
    glitch_bytes: int = 0
    """Zero bytes outside of frames, as an RS-485 driver makes when it switches."""
    oversized: int = 0
    """How often more bytes than a frame can have came without a frame."""
    foreign: int = 0
    """Whole frames on the drive side with another unit id or another function."""
    stray_frames: int = 0
    """Whole good frames among the stray bytes: a drive that answers late, or twice."""
    stray_bytes: int = 0
    """Bytes on the drive side while nothing was expected."""
    echoes: int = 0
    """Own requests that were received back."""


class RtuDecoder:
    """Waiting bytes, the time of the last one, and what happens to them when the line is silent.

    After ``silence_ns`` without a byte the waiting bytes are checked for a frame that a silence ends. If
    there is none, one may still come, because USB adapters make their own pauses. So the bytes are kept until
    ``give_up_ns`` after the last one.
    """

    __slots__ = ("_buffer", "_give_up_ns", "_last_byte_ns", "_silence_ns", "counters", "deadline_ns")

    def __init__(self, silence_ns: int = FAST_SILENCE_NS, give_up_ns: int | None = None) -> None:
        """Both in ns after the last byte; ``give_up_ns`` is by default 30 ms after the silence."""
        self._silence_ns = silence_ns
        self._give_up_ns = silence_ns + USB_PAUSE_NS if give_up_ns is None else give_up_ns
        if not 0 <= self._silence_ns <= self._give_up_ns:
            raise FrameError(f"give_up_ns {give_up_ns} must not be shorter than silence_ns {silence_ns}")
        self._buffer = b""
        self._last_byte_ns = 0
        self.deadline_ns: int | None = None
        """When ``on_silence`` must be called; every byte postpones it. None: nothing waits."""
        self.counters = RtuCounters()

    @property
    def is_between_frames(self) -> bool:
        """Whether no bytes wait: the next one begins a frame."""
        return not self._buffer

    def on_silence(self, now_ns: int) -> list[Frame]:
        """Return the frames that a silence ended. An early call changes nothing (some timers fire early)."""
        if self.deadline_ns is None or now_ns < self.deadline_ns:
            return []
        has_given_up = now_ns - self._last_byte_ns >= self._give_up_ns
        frames = self._settle(has_given_up=has_given_up)
        if has_given_up:
            self._drop(len(self._buffer))
        self.deadline_ns = self._last_byte_ns + self._give_up_ns if self._buffer else None
        return frames

    def reset(self) -> None:
        """Forget the waiting bytes: the line is a new one."""
        self._buffer = b""
        self.deadline_ns = None

    def _settle(self, *, has_given_up: bool) -> list[Frame]:
        raise NotImplementedError

    def _await_silence(self, now_ns: int) -> None:
        self._last_byte_ns = now_ns
        self.deadline_ns = now_ns + self._silence_ns if self._buffer else None

    def _drop(self, count: int) -> None:
        """Drop the first ``count`` waiting bytes, and count them by kind."""
        dropped = self._buffer[:count]
        self._buffer = self._buffer[count:]
        if any(dropped):
            self.counters.damaged += 1
            self.counters.dropped_bytes += len(dropped)
            self.counters.crc_errors += len(dropped) >= MIN_ADU
        else:
            self.counters.glitch_bytes += len(dropped)
