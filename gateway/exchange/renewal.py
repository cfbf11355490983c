"""When the connection to the drives is made anew because nothing answers on it any more, and what it carries.

A server may have forgotten a connection that its system still acknowledges: nothing comes on it any more, and
another one would be served. It is broken off when not one byte has come for three time-outs and for three
times ``response_timeout_ms``, and each unit id that may be read was asked in that time.

What was unanswered on the old connection may be executed yet. If it may have written, the new one carries
named reads alone until one was answered, and no write for ``lost_ms`` after that. Whose turn that is,
:class:`Held` says; it goes from one to the next only in this file.
"""

from collections.abc import Iterable
from enum import Enum
from typing import Final

from gateway.backoff import Backoff
from gateway.times import NS_PER_MS, NS_PER_S

FEWEST_TIMEOUTS: Final = 3
FEWEST_TIMES: Final = 3
"""So many ``response_timeout_ms``."""
FIRST_PAUSE_S: Final = 1.0
LONGEST_PAUSE_S: Final = 60.0
"""From one renewal to the next, twice as long each time until a byte comes."""


class Held(Enum):
    """What the connection carries."""

    __hash__ = object.__hash__

    NOTHING = "nothing"
    """Everything: nothing is held back."""
    ALL = "all"
    """Named reads and stops: a write that was never answered may be executed yet."""
    WRITES = "writes"
    """All but writes: a named read was answered, and ``lost_ms`` have not passed since."""


class Renewal:
    """See the module. ``lost_ns``: the longest ``lost_ms`` of the axes of the line."""

    def __init__(self, response_timeout_ns: int, lost_ns: int) -> None:
        self._shortest_ns = FEWEST_TIMES * response_timeout_ns
        self._hold_ns = lost_ns
        self.timeouts = 0
        """In a row, without a byte of anybody."""
        self._mute_since_ns = 0
        """When the first of these requests was sent."""
        self._silent: set[int] = set()
        """Unit ids of them."""
        self._asked: set[int] = set()
        """Unit ids that were asked to find out, once each."""
        self._open_writes: set[int] = set()
        """Unit ids that left more than a read unanswered, and have answered nothing that was asked later."""
        self._backoff = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        self._not_before_ns = 0
        self.held = Held.NOTHING
        self.holds = False
        """Whether it is another one: asked with each request."""
        self.held_until_ns = 0
        """While writes are held: until then."""

    def miss(self, unit_id: int, sent_ns: int, *, is_read: bool) -> None:
        """A request was not answered in time."""
        if not self.timeouts:
            self._mute_since_ns = sent_ns
        self.timeouts += 1
        self._silent.add(unit_id)
        if not is_read:
            self._open_writes.add(unit_id)

    def mark_alive(self) -> None:
        """Bytes came, whatever they are: the connection lives."""
        self.timeouts = 0
        self._silent.clear()
        self._asked.clear()
        self._backoff.reset()

    def mark_answered(self, unit_id: int) -> None:
        """A unit id answers what it was asked: whatever it was sent before is done, or never will be."""
        self._open_writes.discard(unit_id)

    @property
    def may_have_written(self) -> bool:
        """Whether anything is unanswered that was more than a read: it may be executed yet."""
        return bool(self._open_writes)

    @property
    def awaits_nothing(self) -> bool:
        """Whether nothing that was sent on the connection may still be answered or executed."""
        return not self.timeouts and not self._open_writes

    def answered(self, now_ns: int) -> None:
        """A named read was answered: see :class:`Held`."""
        if self.held is Held.ALL:
            self.held, self.held_until_ns = Held.WRITES, now_ns + self._hold_ns

    def settle(self, now_ns: int) -> bool:
        """Hold writes back no longer than they have to be; return whether that has ended now."""
        is_over = self.held is Held.WRITES and now_ns >= self.held_until_ns
        if is_over:
            self.held, self.holds = Held.NOTHING, False
        return is_over

    def is_mute(self, now_ns: int) -> bool:
        """Whether nothing has come for as long as it takes; whether everybody was asked is not looked at."""
        return (
            self.timeouts >= FEWEST_TIMEOUTS
            and now_ns - self._mute_since_ns >= self._shortest_ns
            and now_ns >= self._not_before_ns
        )

    def not_asked(self, unit_ids: Iterable[int]) -> list[int]:
        """Return those that left nothing unanswered since the last byte."""
        return [unit_id for unit_id in unit_ids if unit_id not in self._silent]

    def ask(self, unit_id: int) -> bool:
        """Whether a unit id is to be asked now; then it is not asked again until a byte comes."""
        if unit_id in self._asked:
            return False
        self._asked.add(unit_id)
        return True

    def renew(self, now_ns: int) -> None:
        """The connection is broken off."""
        if self.may_have_written:
            self.held, self.holds = Held.ALL, True
        self._not_before_ns = now_ns + int(self._backoff.next_s() * NS_PER_S)
        self.begin()

    def begin(self) -> None:
        """Another connection is there: nothing was asked on it."""
        self.timeouts = 0
        self._silent.clear()
        self._asked.clear()
        self._open_writes.clear()


def longest_lost_ns(lost_ms: Iterable[float]) -> int:
    """Return the longest ``lost_ms`` of some axes, in ns."""
    return int(max(lost_ms, default=0.0) * NS_PER_MS)
