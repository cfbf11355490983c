"""When the connection to the drives is renewed because nothing answers on it, and what a new one carries.

A server may have lost a connection that its operating system still acknowledges. No byte comes on it any
more, but the server would serve a new one. The gateway closes the old one when no byte has come for three
time-outs and for three times ``response_timeout_ms``. Each unit id that may be read was polled in that time.

Unanswered requests of the old connection may still be executed. To the unit ids of which one may have
written, the new connection carries only added reads until a drive answers, and no write for ``lost_ms`` after
that. :class:`Held` says how far this has come; only this file changes it. Other unit ids are not held up.
"""

from collections.abc import Iterable
from enum import Enum
from typing import Final

from gateway.backoff import Backoff
from gateway.times import NS_PER_MS, NS_PER_S

FEWEST_TIMEOUTS: Final = 3
FEWEST_TIMES: Final = 3
"""Minimum time without a byte, in units of ``response_timeout_ms``."""
FIRST_PAUSE_S: Final = 1.0
LONGEST_PAUSE_S: Final = 60.0
"""Longest time from one renewal to the next; it doubles each time until a byte comes."""


class Held(Enum):
    """What the connection carries to the unit ids that left a write unanswered."""

    __hash__ = object.__hash__

    NOTHING = "nothing"
    """Everything: nothing is held back."""
    ALL = "all"
    """Added reads and stops: an unanswered write may still be executed. To a device without an axis also
    reads, and writes after ``lost_ms``: the gateway reads nothing of it."""
    WRITES = "writes"
    """All but writes: something was answered, and ``lost_ms`` have not passed since."""


class Renewal:
    """The renewal of one line. See the module. ``lost_ns``: the longest ``lost_ms`` of its axes."""

    def __init__(self, response_timeout_ns: int, lost_ns: int) -> None:
        self._shortest_ns = FEWEST_TIMES * response_timeout_ns
        self._hold_ns = lost_ns
        self.timeouts = 0
        """Number of time-outs in a row, without a byte from any unit."""
        self._mute_since_ns = 0
        """When the first of the unanswered requests was sent."""
        self._silent: set[int] = set()
        """The unit ids that left them unanswered."""
        self._asked: set[int] = set()
        """Unit ids that the gateway polled since the last byte, once each."""
        self._open_writes: set[int] = set()
        """Unit ids that left a write unanswered, and answered nothing that was sent later."""
        self._backoff = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        self._not_before_ns = 0
        self.held = Held.NOTHING
        self.holds = False
        """Whether anything is held: checked for each request."""
        self.held_unit_ids: frozenset[int] = frozenset()
        """The unit ids to which it is."""
        self.held_until_ns = 0
        """Until when writes are held."""
        self.devices_until_ns = 0
        """Until when writes to devices without an axis are held."""

    def miss(self, unit_id: int, sent_ns: int, *, is_read: bool) -> None:
        """A request was not answered in time."""
        if not self.timeouts:
            self._mute_since_ns = sent_ns
        self.timeouts += 1
        self._silent.add(unit_id)
        if not is_read:
            self._open_writes.add(unit_id)

    def mark_alive(self) -> None:
        """Any bytes came: the connection is alive."""
        self.timeouts = 0
        self._silent.clear()
        self._asked.clear()
        self._backoff.reset()

    def mark_answered(self, unit_id: int) -> None:
        """A unit id answered: what was sent to it before is executed, or never will be."""
        self._open_writes.discard(unit_id)

    @property
    def may_have_written(self) -> bool:
        """Whether an unanswered request may have written: it may still be executed."""
        return bool(self._open_writes)

    @property
    def awaits_nothing(self) -> bool:
        """Whether nothing that was sent on the connection may still be answered or executed."""
        return not self.timeouts and not self._open_writes

    def answered(self, now_ns: int) -> None:
        """An added read was answered, or a request to another unit id: see :class:`Held`."""
        if self.held is Held.ALL:
            self.held, self.held_until_ns = Held.WRITES, now_ns + self._hold_ns

    def settle(self, now_ns: int) -> bool:
        """Release held writes when their time is over; return whether they were released now."""
        is_over = self.held is Held.WRITES and now_ns >= self.held_until_ns
        if is_over:
            self.held, self.holds, self.held_unit_ids = Held.NOTHING, False, frozenset()
        return is_over

    def is_mute(self, now_ns: int) -> bool:
        """Whether nothing has come for long enough; it does not check that all units were polled."""
        return (
            self.timeouts >= FEWEST_TIMEOUTS
            and now_ns - self._mute_since_ns >= self._shortest_ns
            and now_ns >= self._not_before_ns
        )

    def not_asked(self, unit_ids: Iterable[int]) -> list[int]:
        """Return those unit ids that left nothing unanswered since the last byte."""
        return [unit_id for unit_id in unit_ids if unit_id not in self._silent]

    def ask(self, unit_id: int) -> bool:
        """Return whether to poll a unit id now; it is then not polled again until a byte comes."""
        if unit_id in self._asked:
            return False
        self._asked.add(unit_id)
        return True

    def renew(self, now_ns: int) -> None:
        """The connection is closed to be made again."""
        if self.may_have_written:
            self.held, self.holds = Held.ALL, True
            self.held_unit_ids |= self._open_writes
            self.devices_until_ns = now_ns + self._hold_ns
        self._not_before_ns = now_ns + int(self._backoff.next_s() * NS_PER_S)
        self.begin()

    def begin(self) -> None:
        """A new connection begins: nothing was sent on it yet."""
        self.timeouts = 0
        self._silent.clear()
        self._asked.clear()
        self._open_writes.clear()


def longest_lost_ns(lost_ms: Iterable[float]) -> int:
    """Return the longest ``lost_ms`` of some axes, in ns."""
    return int(max(lost_ms, default=0.0) * NS_PER_MS)
