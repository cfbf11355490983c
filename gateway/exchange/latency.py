"""How long things take, in integers: log-linear histograms that cost a hundred nanoseconds a value.

Each power of two is divided into 64 buckets, so that a value is known within 1.6 %, from 1 ns to two minutes.
"""

from bisect import bisect_left
from collections import deque
from itertools import accumulate
from typing import Final

from gateway.times import NS_PER_S

SUB_BITS: Final = 6
BUCKETS: Final = 2048
LONGEST_NS: Final = (1 << 37) - 1
"""Whatever takes longer counts as this: 137 s."""
SLOT_NS: Final = 10 * NS_PER_S
SLOTS: Final = 6
"""High marks of the last minute are kept for ten seconds each."""


def bucket_of(span_ns: int) -> int:
    """Return the bucket of a time in ns; what is negative belongs to 0.

    >>> [bucket_of(ns) for ns in (0, 1, 127, 128, 129, 130, 255, 256)]
    [0, 1, 127, 128, 128, 129, 191, 192]
    """
    shift = span_ns.bit_length() - SUB_BITS - 1
    if shift <= 0:
        return max(0, span_ns)
    if span_ns > LONGEST_NS or span_ns < 0:
        return BUCKETS - 1 if span_ns > 0 else 0
    return (shift << SUB_BITS) + (span_ns >> shift)


def middle_ns(bucket: int) -> int:
    """Return the middle of a bucket.

    >>> middle_ns(100), middle_ns(bucket_of(1_000_000))
    (100, 1003520)
    """
    shift = (bucket >> SUB_BITS) - 1
    if shift <= 0:
        return bucket
    low = (bucket - (shift << SUB_BITS)) << shift
    return low + (1 << shift) // 2


class Histogram:
    """Times in ns, counted in buckets: ``counts[bucket_of(ns)] += 1``."""

    __slots__ = ("counts",)

    def __init__(self) -> None:
        self.counts = [0] * BUCKETS

    def note(self, span_ns: int) -> None:
        """Count one time."""
        self.counts[bucket_of(span_ns)] += 1

    def percentiles_ns(self, *shares: float) -> list[int]:
        """Return the time that each share (0 to 1) of all counted ones does not exceed; 0 of none.

        >>> histogram = Histogram()
        >>> for ns in range(1, 101):
        ...     histogram.note(ns)
        >>> histogram.percentiles_ns(0.5, 0.99, 1.0)
        [50, 99, 100]
        """
        below = list(accumulate(self.counts))
        total = below[-1]
        if not total:
            return [0] * len(shares)
        return [middle_ns(bisect_left(below, max(1, share * total))) for share in shares]

    @property
    def total(self) -> int:
        """How many times were counted."""
        return sum(self.counts)


class HighMark:
    """The highest time since the start, and of the last minute."""

    __slots__ = ("_slot_ends_ns", "_slots", "ever_ns", "slot_ns")

    def __init__(self) -> None:
        self.ever_ns = 0
        self.slot_ns = 0
        """Highest since the slot began: what is not above it need not be told."""
        self._slots: deque[int] = deque([0] * SLOTS, maxlen=SLOTS)
        self._slot_ends_ns = 0

    def raise_to(self, span_ns: int) -> None:
        """Note a time above ``slot_ns``."""
        self.slot_ns = span_ns
        if span_ns > self.ever_ns:
            self.ever_ns = span_ns

    def turn(self, now_ns: int) -> None:
        """Begin a new slot when the last one is full; to be called at least once in ten seconds."""
        if now_ns >= self._slot_ends_ns:
            self._slots.append(self.slot_ns)
            self.slot_ns = 0
            self._slot_ends_ns = now_ns + SLOT_NS

    @property
    def minute_ns(self) -> int:
        """Highest of the last minute, within ten seconds."""
        return max(self.slot_ns, *self._slots)
