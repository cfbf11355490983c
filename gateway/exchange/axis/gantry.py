"""What the first trigger of a group fixes for every axis of it, until each has gone (M11).

Theory of operation
===================

The axes of a group carry one beam, and their controller starts them one after the other: with a trigger each,
or with a target each where a drive goes as it is written. Whatever changes between the first of these frames
and the last would send one drive corrected and another one 1:1, and skew the beam by the correction. To
refuse the later ones would skew it by the whole way. So the first one decides for all: switch, table, gain
and reference of each axis stay as they were when it left, until

- each axis has gone (what is put off comes into force then, as ever with the next different target),
- one that has gone is given another target: a new round begins, and with it a new decision,
- one is stopped, or moved in another way, or its drive cannot be reached,
- :data:`LONGEST_NS` have passed.

Of a first trigger that nobody answered, or that was answered with an exception that proves nothing, nobody
knows whether it was obeyed. So it fixes what the others go by, as one does that was obeyed. Only the proof
that nothing was obeyed lets the next trigger be the first.

An axis that has not gone yet may have its target written anew: it still goes by what was fixed, for the
others stand or go by that. That is also how a beam is levelled of which a later trigger was refused (M3).

The machine is :class:`Gantry`, one for each group: its state, and the data that goes with it. What was fixed
of each axis is its ``fixed`` (:class:`Fixed`), there exactly while the state is not ``OPEN``.
``exchange.group`` sets both, as requests leave and end; ``Axis`` puts off what is asked for meanwhile.
"""

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final, NamedTuple

from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.impossible import IGNORED
from gateway.exchange.axis.motion import MotionState
from gateway.times import NS_PER_S

LONGEST_NS: Final = 10 * NS_PER_S
"""After so long a decision ends: a trigger that has not come by then belongs to another move."""


class GantryState(Enum):
    """Whether what is asked for of a group is in force, or what its first trigger has fixed."""

    __hash__ = object.__hash__

    OPEN = "open"
    """What is asked for is in force; the next trigger of one of the axes fixes it."""
    SENT = "sent"
    """The first trigger is on its way to the drive."""
    UNDER_WAY = "under-way"
    """One has gone at least, or may have, and one has not."""


class GantryEvent(Enum):
    """What decides whether something is fixed."""

    __hash__ = object.__hash__

    LEFT = "left"
    """A frame that makes an axis go to its target leaves."""
    WENT = "went"
    """It was acknowledged, or broadcast, and another axis has not gone yet."""
    WHOLE = "whole"
    """The same, and each axis has gone."""
    UNCONFIRMED = "unproven"
    """Nobody knows whether it was obeyed: M3 holds."""
    REFUSED = "refused"
    """It was refused, and that proves that it was not obeyed: M3 holds."""
    AGAIN = "again"
    """An axis that has gone is given another target."""
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
        GantryEvent.UNCONFIRMED: _UNDER_WAY,  # it may have gone
        GantryEvent.REFUSED: _OPEN,  # none has gone, and none goes before the target of this one came again
        GantryEvent.AGAIN: IGNORED,
        GantryEvent.ENDED: _OPEN,
        GantryEvent.EXPIRED: IGNORED,  # its answer, or its silence, comes first
    },
    GantryState.UNDER_WAY: {
        GantryEvent.LEFT: IGNORED,
        GantryEvent.WENT: IGNORED,
        GantryEvent.WHOLE: _OPEN,
        GantryEvent.UNCONFIRMED: IGNORED,
        GantryEvent.REFUSED: IGNORED,  # once its target came again it goes by what was fixed
        GantryEvent.AGAIN: _OPEN,
        GantryEvent.ENDED: _OPEN,
        GantryEvent.EXPIRED: _OPEN,
    },
}
"""What each event makes of each state, complete; :data:`IGNORED` changes nothing."""


class Fixed(NamedTuple):
    """What the first trigger of its group has fixed of one axis (``axis.gantry``)."""

    is_referenced: bool
    """Whether its positions meant something."""
    motion_state: MotionState
    """Where it was."""
    had_reported_done: bool
    """The same of a target that was not acknowledged: whether its drive said done."""
    nominal_counts: float | None
    """Where its controller took it to be; None: nobody knew."""
    run: Rendering | None
    """The target that it held, as it has to run it; None: it held none that was complete, or is the first."""
    keeps_words: bool = False
    """Whether it may keep words that were made with another switch, table or gain: all of its group do."""
    has_gone: bool = False
    may_have_gone: bool = False
    """It was the first, and nobody knows whether its trigger was obeyed."""
    missing: int = 0
    """The words of its target that have not come since it went, a bit for each: a drive that goes as it is
    written may be given them one by one."""
    part_ns: int = 0
    """When the newest of them came."""
    was_lost: bool = False
    """Its reference was lost since, be it found again by now."""
    has_other_correction: bool = False
    """Table, gain or switch were changed since."""


class Gantry:
    """Whether the axes of one group go by a decision of before, since when, and by whose trigger."""

    __slots__ = ("_releases", "has_put_off", "is_skewed", "led_by", "since_ns", "skew", "state")

    def __init__(self, releases: Sequence[Callable[[], None]]) -> None:
        self._releases = releases
        """Called when nothing is fixed any more: of each axis, what was put off comes into force."""
        self.state = GantryState.OPEN
        self.led_by = ""
        """The axis whose trigger has fixed it."""
        self.since_ns = 0
        """When that left."""
        self.has_put_off = False
        """Something else was asked for since, or a reference came or went."""
        self.is_skewed = False
        """A later one was refused after the first had gone, or of the first nobody knows whether it has; and
        they have not all gone together since."""
        self.skew: float | None = None
        """By how much, in units; None: nobody knows."""

    def happens(self, event: GantryEvent) -> None:
        """Go on to the state that the table says; with ``OPEN`` what was put off comes into force."""
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
        """The first trigger leaves: what was asked for until now is what counts."""
        self.led_by, self.since_ns, self.has_put_off = led_by, now_ns, False

    def put_off(self) -> None:
        """Something has to wait until nothing is fixed any more."""
        self.has_put_off = True

    def skew_by(self, skew: float | None) -> None:
        """A trigger was refused, or may have been obeyed: the beam is skewed by so much."""
        self.is_skewed, self.skew = True, skew

    @property
    def is_open(self) -> bool:
        """Whether nothing is fixed: the next trigger is a first one."""
        return self.state is _OPEN

    @property
    def is_under_way(self) -> bool:
        """Whether one has gone at least, or may have, and one has not."""
        return self.state is _UNDER_WAY

    def is_over(self, now_ns: int) -> bool:
        """Whether a decision has lasted as long as one may."""
        return self.state is _UNDER_WAY and now_ns - self.since_ns > LONGEST_NS
