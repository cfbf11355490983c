"""Statistics of durations, in integers: counts in log-linear buckets; one count takes 100 ns.

Each power of two has 64 buckets, so a value is known within 1.6 %, from 1 ns to ten hours.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import accumulate
from typing import Final

from gateway.times import NS_PER_S

SUB_BITS: Final = 6
OCTAVE: Final = SUB_BITS + 1
"""Durations of up to this number of bits have a bucket each; longer ones lose their lowest bits."""
LONGEST_BITS: Final = 45
LONGEST_NS: Final = (1 << LONGEST_BITS) - 1
"""Longer durations count as this: ten hours, longer than any time-out."""
BUCKETS: Final = (LONGEST_BITS - OCTAVE + 2) << SUB_BITS
SLOT_NS: Final = 10 * NS_PER_S
SLOTS: Final = 6
"""Number of slots of ten seconds: together they give the high mark of the last minute."""


def bucket_of(span_ns: int) -> int:
    """Return the bucket of a duration in ns; negative ones belong to 0.

    >>> [bucket_of(ns) for ns in (0, 1, 127, 128, 129, 130, 255, 256)]
    [0, 1, 127, 128, 128, 129, 191, 192]
    """
    shift = span_ns.bit_length() - OCTAVE
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


def running_totals(counts: Iterable[int]) -> list[int]:
    """Return the number of durations in or below each bucket: one pass serves all statistics.

    >>> running_totals([1, 0, 2])
    [1, 1, 3]
    """
    return list(accumulate(counts))


def percentiles_ns(totals: Sequence[int], shares: Sequence[float]) -> list[int]:
    """Return the duration that each share (0 to 1) of all does not exceed; 0 if there are none.

    >>> counts = [0] * BUCKETS
    >>> for ns in range(1, 101):
    ...     counts[bucket_of(ns)] += 1
    >>> percentiles_ns(running_totals(counts), (0.5, 0.99, 1.0))
    [50, 99, 100]
    """
    total = totals[-1]
    if not total:
        return [0] * len(shares)
    return [middle_ns(bisect_left(totals, max(1, share * total))) for share in shares]


def below_bounds(totals: Sequence[int], bounds_ns: Sequence[int]) -> list[int]:
    """Return how many durations do not exceed each bound, and how many there are.

    Exact except for durations within 1.6 % of a bound, which share its bucket.

    >>> counts = [0] * BUCKETS
    >>> for ns in (5, 10, 11, 1000):
    ...     counts[bucket_of(ns)] += 1
    >>> below_bounds(running_totals(counts), (10, 100))
    [2, 3, 4]
    """
    return [*(totals[bucket_of(bound)] for bound in bounds_ns), totals[-1]]


class HighMark:
    """The highest duration since the start, and of the last minute."""

    __slots__ = ("_slot_ends_ns", "_slots", "ever_ns", "slot_ns")

    def __init__(self) -> None:
        self.ever_ns = 0
        self.slot_ns = 0
        """Highest since the slot began: only a higher one must be recorded."""
        self._slots: deque[int] = deque([0] * SLOTS, maxlen=SLOTS)
        self._slot_ends_ns = 0

    def raise_to(self, span_ns: int) -> None:
        """Record a duration above ``slot_ns``."""
        self.slot_ns = span_ns
        if span_ns > self.ever_ns:
            self.ever_ns = span_ns

    def tick(self, now_ns: int) -> None:
        """Begin a new slot when the last one is over; must be called at least once in ten seconds."""
        if now_ns >= self._slot_ends_ns:
            self._slots.append(self.slot_ns)
            self.slot_ns = 0
            self._slot_ends_ns = now_ns + SLOT_NS

    @property
    def minute_ns(self) -> int:
        """Highest of the last minute, give or take ten seconds."""
        return max(self.slot_ns, *self._slots)
