"""What the first trigger of a group fixes for all of its axes, until each has started (M11).

Theory of operation
===================

The axes of a group carry one gantry. Their controller starts them one after the other: with a trigger for
each, or with a target for each where a drive moves as soon as it is written. A change between the first and
the last of these frames would send one drive corrected and another one 1:1. That would skew the gantry by the
correction. Refusing the later frames would skew it by the whole travel. So the first frame decides for all:
switch, table, gain and reference of each axis stay as they were when it was sent, until one of these happens:

- Each axis has started. Deferred changes come into force then, with the next different target.
- An axis that has started gets another target: a new round begins, with a new decision.
- An axis is stopped or moved in another way, or its drive cannot be reached.
- :data:`LONGEST_NS` have passed.

A first trigger may get no answer, or an exception that proves nothing. Then it is unknown whether the drive
obeyed it. It fixes the same as one that was obeyed. Only a proof that the drive did not obey makes the next
trigger a first one again.

The target of an axis that has not started may be rewritten. It still uses what was fixed, because the other
axes do. An operator levels a gantry in the same way after a later trigger was refused (M3).

The machine is :class:`Gantry`, one for each group: its state and the data of that state. The fixed values of
each axis are in its ``axis.member``, present exactly while the state is not ``OPEN``. ``exchange.group`` sets
both as requests are sent and end. Changes that are requested meanwhile are put off.
"""

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

from gateway.exchange.axis.impossible import IGNORED
from gateway.times import NS_PER_S

LONGEST_NS: Final = 10 * NS_PER_S
"""A decision ends after so long: a later trigger belongs to another move."""


class GantryState(Enum):
    """Whether the requested values of a group are in force, or those that its first trigger has fixed."""

    __hash__ = object.__hash__

    OPEN = "open"
    """The requested values are in force; the next trigger of one of the axes fixes them."""
    SENT = "sent"
    """The first trigger is on the wire."""
    UNDER_WAY = "under-way"
    """At least one axis has started or may have, and at least one has not."""


class GantryEvent(Enum):
    """What decides whether something is fixed."""

    __hash__ = object.__hash__

    LEFT = "left"
    """A frame that makes an axis go to its target is sent."""
    WENT = "went"
    """That frame was acknowledged, or broadcast, and another axis has not started yet."""
    WHOLE = "whole"
    """The same, and each axis has started."""
    UNCONFIRMED = "unproven"
    """It is unknown whether the drive obeyed that frame: M3 holds."""
    REFUSED = "refused"
    """The drive refused that frame, which proves that it did not obey: M3 holds."""
    AGAIN = "again"
    """An axis that has started gets another target."""
    ENDED = "ended"
    """An axis is stopped, moved in another way, or cannot be reached."""
    EXPIRED = "expired"
    """``LONGEST_NS`` have passed."""


_OPEN: Final = GantryState.OPEN
_SENT: Final = GantryState.SENT
_UNDER_WAY: Final = GantryState.UNDER_WAY

GANTRY_AFTER: Final[dict[GantryState, dict[GantryEvent, GantryState | None]]] = {
    GantryState.OPEN: {
        GantryEvent.LEFT: _SENT,
        GantryEvent.WENT: IGNORED,
        GantryEvent.WHOLE: IGNORED,
        GantryEvent.UNCONFIRMED: IGNORED,
        GantryEvent.REFUSED: IGNORED,
        GantryEvent.AGAIN: IGNORED,
        GantryEvent.ENDED: IGNORED,
        GantryEvent.EXPIRED: IGNORED,
    },
    GantryState.SENT: {
        GantryEvent.LEFT: IGNORED,  # two axes in one frame
        GantryEvent.WENT: _UNDER_WAY,
        GantryEvent.WHOLE: _OPEN,
        GantryEvent.UNCONFIRMED: _UNDER_WAY,  # it may have started
        GantryEvent.REFUSED: _OPEN,  # none has started; none does before this one's target comes again
        GantryEvent.AGAIN: IGNORED,
        GantryEvent.ENDED: _OPEN,
        GantryEvent.EXPIRED: IGNORED,  # its answer, or its silence, comes first
    },
    GantryState.UNDER_WAY: {
        GantryEvent.LEFT: IGNORED,
        GantryEvent.WENT: IGNORED,
        GantryEvent.WHOLE: _OPEN,
        GantryEvent.UNCONFIRMED: IGNORED,
        GantryEvent.REFUSED: IGNORED,  # when its target comes again, it uses what was fixed
        GantryEvent.AGAIN: _OPEN,
        GantryEvent.ENDED: _OPEN,
        GantryEvent.EXPIRED: _OPEN,
    },
}
"""The state after each event, complete; :data:`IGNORED` changes nothing."""


class Gantry:
    """Whether the axes of one group use an earlier decision, since when, and by whose trigger."""

    __slots__ = ("_releases", "has_put_off", "is_skewed", "led_by", "since_ns", "skew", "state")

    def __init__(self, releases: Sequence[Callable[[], None]]) -> None:
        self._releases = releases
        """Called for each axis when nothing is fixed any more: its deferred changes come into force."""
        self.state = GantryState.OPEN
        self.led_by = ""
        """The axis whose trigger fixed it."""
        self.since_ns = 0
        """When that trigger was sent."""
        self.has_put_off = False
        """Since then another correction was requested, or a reference was found or lost."""
        self.is_skewed = False
        """A later trigger was refused after the first axis had started, or it is unknown whether the first
        has; and the axes have not all started together since."""
        self.skew: float | None = None
        """The skew in units; None: unknown."""

    def happens(self, event: GantryEvent) -> None:
        """Enter the state that the table gives; with ``OPEN``, deferred changes come into force."""
        after = GANTRY_AFTER[self.state][event]
        if event is GantryEvent.WHOLE:
            self.is_skewed, self.skew = False, None
        if after is IGNORED:
            return
        self.state = after
        if after is _OPEN:
            for release in self._releases:
                release()

    def fix(self, led_by: str, now_ns: int) -> None:
        """The first trigger is sent: the values requested until now are fixed."""
        self.led_by, self.since_ns, self.has_put_off = led_by, now_ns, False

    def put_off(self) -> None:
        """A change must wait until nothing is fixed any more."""
        self.has_put_off = True

    def skew_by(self, skew: float | None) -> None:
        """A trigger was refused, or may have been obeyed: the gantry has this skew."""
        self.is_skewed, self.skew = True, skew

    @property
    def is_open(self) -> bool:
        """Whether nothing is fixed: the next trigger is a first one."""
        return self.state is _OPEN

    @property
    def is_under_way(self) -> bool:
        """Whether at least one axis has started or may have, and at least one has not."""
        return self.state is _UNDER_WAY

    def is_over(self, now_ns: int) -> bool:
        """Whether a decision has reached its maximum age."""
        return self.state is _UNDER_WAY and now_ns - self.since_ns > LONGEST_NS
