"""How often something may happen, and how often it is reported. Time is an argument, in nanoseconds."""

from collections.abc import Callable, Hashable
from typing import Final, Generic, TypeVar

from gateway.times import NS_PER_S

EVERY_NS: Final = 60 * NS_PER_S
"""A refused client usually retries immediately and indefinitely."""
MOST_KEYS: Final = 256
"""This many keys are counted separately, all others together: clients must not be able to fill the memory."""

Key = TypeVar("Key", bound=Hashable)


class TokenBucket:
    """Admits one event every ``interval_ns`` on average.

    After a pause, ``1 + burst_ns / interval_ns`` are admitted immediately. A new bucket is full.
    """

    __slots__ = ("_burst_ns", "_due_ns", "_interval_ns")

    def __init__(self, interval_ns: int, burst_ns: int) -> None:
        self._interval_ns, self._burst_ns = interval_ns, burst_ns
        self._due_ns: int | None = None
        """When the next event is due, if the earlier ones had come evenly."""

    def takes(self, now_ns: int) -> bool:
        """Count one event, and return whether it is admitted."""
        if not self.has_one(now_ns):
            return False
        self.take(now_ns)
        return True

    def has_one(self, now_ns: int) -> bool:
        """Return whether an event would be admitted now."""
        return self._due_ns is None or self._due_ns <= now_ns

    def is_full(self, now_ns: int) -> bool:
        """Return whether earlier events have no effect any more."""
        return self._due_ns is None or self._due_ns <= now_ns - self._burst_ns

    def take(self, now_ns: int) -> None:
        """Count one admitted event."""
        full_ns = now_ns - self._burst_ns
        due_ns = full_ns if self._due_ns is None else max(self._due_ns, full_ns)
        self._due_ns = due_ns + self._interval_ns

    def give_back(self) -> None:
        """Count one event less."""
        if self._due_ns is not None:
            self._due_ns -= self._interval_ns


def bucket_of(per_s: float, at_once: float) -> TokenBucket:
    """Return a bucket that admits ``per_s`` a second on average, and ``at_once`` after a pause."""
    interval_ns = int(NS_PER_S / per_s)
    return TokenBucket(interval_ns, int(interval_ns * max(at_once - 1.0, 0.0)))


class Reports(Generic[Key]):
    """Reports the first event of a kind, then ``burst`` every ``every_ns``, each with the number since.

    ``others`` returns the common key for all new keys once ``most`` keys are known.
    """

    __slots__ = ("_burst", "_counts", "_every_ns", "_most", "_others", "_reported")

    def __init__(
        self,
        every_ns: int = EVERY_NS,
        burst: int = 1,
        *,
        most: int = MOST_KEYS,
        others: Callable[[Key], Key] | None = None,
    ) -> None:
        self._every_ns, self._burst, self._most, self._others = every_ns, burst, most, others
        self._reported: dict[Key, tuple[int, int]] = {}
        """Start of the current interval, and the reports since then."""
        self._counts: dict[Key, int] = {}
        """Events since the last report."""

    def counted_as(self, key: Key) -> Key:
        """Return the key under which an event would be counted now."""
        if self._others is None or key in self._counts or len(self._counts) < self._most:
            return key
        return self._others(key)

    def knows(self, key: Key) -> bool:
        """Return whether a key is stored."""
        return key in self._counts

    def due(self, key: Key, now_ns: int) -> int:
        """Count one event; return the number since the last report, or 0 if no report is due."""
        key = self.counted_as(key)
        count = self._counts[key] = self._counts.get(key, 0) + 1
        since_ns, reported = self._reported.get(key, (now_ns, 0))
        if now_ns - since_ns >= self._every_ns:
            since_ns, reported = now_ns, 0
        if reported >= self._burst:
            return 0
        self._reported[key] = (since_ns, reported + 1)
        self._counts[key] = 0
        return count

    def sentence(self, key: Key, detail: str, now_ns: int) -> str:
        """Count one event; return ``detail`` with the number, or "" if no report is due."""
        count = self.due(key, now_ns)
        return detail + times(count) if count else ""

    def held_back(self, now_ns: int) -> list[tuple[Key, int]]:
        """Return each key whose report is due, with its count, and forget the keys that have been quiet."""
        due = []
        for key, (since_ns, _) in list(self._reported.items()):
            if now_ns - since_ns < self._every_ns:
                continue
            count = self._counts[key]
            if count:
                due.append((key, count))
                self._reported[key], self._counts[key] = (now_ns, 1), 0
            else:
                del self._reported[key], self._counts[key]
        return due


def others_of_pairs(_: tuple[str, str]) -> tuple[str, str]:
    """Return the key of all further pairs of names."""
    return "", ""


def times(count: int) -> str:
    """Return the end of a sentence about the last of several events; empty for one.

    >>> times(1), times(12)
    ('', ', 12 times since the last note')
    """
    return f", {count} times since the last note" if count > 1 else ""
