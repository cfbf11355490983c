"""Standstills of the gateway: while its process stands still, what reaches it waits; then all of it is there.

Controllers and drives go on: they lose patience, close connections, move.
"""

import random
from collections.abc import Callable, Hashable

from gateway.relay.pulse import EVERY_NS, Beats
from tests.ledger.clock import MS, Clock
from tests.ledger.events import Book

Call = Callable[[], None]


class Stillness:
    """What the gateway would do, done at once or when it wakes."""

    def __init__(self, clock: Clock, rng: random.Random, book: Book) -> None:
        self.beats = Beats()
        self.woke_ns = self.slept_ns = 0
        """The last standstill: its end, and how long it was."""
        self._clock, self._rng, self._book = clock, rng, book
        self._waiting: dict[Hashable, list[Call]] | None = None
        """By source: one's own calls stay in their order. None: the gateway runs."""
        self._afterwards: list[Call] = []
        self.beat()

    @property
    def is_still(self) -> bool:
        return self._waiting is not None

    def reaches(self, source: Hashable, call: Call) -> None:
        """Something reaches the gateway from a connection, a port or a timer."""
        if self._waiting is None:
            call()
        else:
            self._waiting.setdefault(source, []).append(call)

    def after_reading(self, call: Call) -> None:
        """As :meth:`reaches`, but where it stood still only once all that had waited has been read."""
        if self._waiting is None:
            call()
        else:
            self._afterwards.append(call)

    def stand_still(self, ms: float) -> None:
        self._waiting = {}
        self._book.seen["standstills"] += 1
        began_ns = self._clock.now_ns
        self._clock.after(ms, lambda: self._wake(began_ns))

    def _wake(self, began_ns: int) -> None:
        assert self._waiting is not None
        sources, afterwards = list(self._waiting.values()), self._afterwards
        self._waiting, self._afterwards = None, []
        self.woke_ns, self.slept_ns = self._clock.now_ns, self._clock.now_ns - began_ns
        self._rng.shuffle(sources)  # a loop reads them in no certain order
        for calls in (*sources, afterwards):
            for call in calls:
                call()

    def beat(self) -> None:
        self.beats.beat(self._clock.now_ns)
        self._clock.after(EVERY_NS / MS, lambda: self.reaches("beat", self.beat))
