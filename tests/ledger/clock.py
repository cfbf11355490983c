"""Virtual time: what happens next, and when. Nothing here sleeps or looks at a real clock."""

import heapq
from collections.abc import Callable
from typing import Final

MS: Final = 1_000_000
"""Nanoseconds."""


class Clock:
    """Callbacks in the order of their instants; those of one instant as they were asked for."""

    def __init__(self) -> None:
        self.now_ns = 1_000 * MS
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._number = 0

    def at(self, instant_ns: int, call: Callable[[], None]) -> None:
        """Call at an instant; one that has passed already counts as now."""
        self._number += 1
        heapq.heappush(self._due, (max(instant_ns, self.now_ns), self._number, call))

    def after(self, ms: float, call: Callable[[], None]) -> None:
        self.at(self.now_ns + int(ms * MS), call)

    def step(self) -> bool:
        """Do the next thing; False when nothing is left."""
        if not self._due:
            return False
        self.now_ns, _, call = heapq.heappop(self._due)
        call()
        return True
