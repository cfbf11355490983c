"""The throttle of events: the first of a kind, and then few in a while with how many there were."""

from typing import Final

from gateway.times import NS_PER_S

EVERY_NS: Final = 60 * NS_PER_S
"""Whoever is refused tries again at once, for ever."""
KINDS: Final = 256
"""So many kinds are told apart, all others together: what somebody sends must not fill the memory."""


class Throttle:
    """Counts what happens, by kind; ``burst`` of each may be told in ``every_ns``."""

    def __init__(self, every_ns: int = EVERY_NS, burst: int = 1) -> None:
        self._every_ns, self._burst = every_ns, burst
        self._told: dict[tuple[str, str], tuple[int, int]] = {}
        """Since when, and how often since then."""
        self._counts: dict[tuple[str, str], int] = {}

    def due(self, kind: tuple[str, str], now_ns: int) -> int:
        """Count one; return how many there were since this was due the last time, 0 where it is not due."""
        if kind not in self._counts and len(self._counts) >= KINDS:
            kind = ("", "")
        count = self._counts[kind] = self._counts.get(kind, 0) + 1
        since_ns, told = self._told.get(kind, (now_ns, 0))
        if now_ns - since_ns >= self._every_ns:
            since_ns, told = now_ns, 0
        if told >= self._burst:
            return 0
        self._told[kind] = (since_ns, told + 1)
        self._counts[kind] = 0
        return count


def times(count: int) -> str:
    """Return what stands behind the sentence about the last one of several; empty for one.

    >>> times(1), times(12)
    ('', ', 12 times since the last note')
    """
    return f", {count} times since the last note" if count > 1 else ""
