"""What is wrong with what others say, on its way to the log: the first of its kind, and then one a minute."""

import time
from collections.abc import Callable
from typing import Final

EVERY_S: Final = 60.0
"""Whoever is refused tries again at once, for ever."""


class Complaints:
    """Notes the first complaint of a kind, and then one a minute with how many there were.

    The kinds are few and ours: nothing that somebody sends makes a new one.
    """

    def __init__(self, note: Callable[[str], None], clock_s: Callable[[], float] = time.monotonic) -> None:
        self._note = note
        self._clock_s = clock_s
        self._noted_s: dict[str, float] = {}
        self._counts: dict[str, int] = {}

    def add(self, kind: str, detail: str) -> None:
        """Count a complaint, and note it where one is due."""
        self._counts[kind] = self._counts.get(kind, 0) + 1
        now_s = self._clock_s()
        if kind in self._noted_s and now_s - self._noted_s[kind] < EVERY_S:
            return
        self._noted_s[kind] = now_s
        times = f", {self._counts[kind]} times since the last note" if self._counts[kind] > 1 else ""
        self._counts[kind] = 0
        self._note(f"{detail}{times}")
