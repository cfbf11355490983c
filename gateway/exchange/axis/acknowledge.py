"""Whether a drive has taken a target: while it is on the wire, and after nobody acknowledged it (M5, M7).

While a target is on the wire the process may die, and the drive may hold it or not: what a record has to say
of it then is in :class:`Acknowledgement`. What was sent and not acknowledged is proven later by where the
axis is seen (:class:`Proof`); :class:`~gateway.exchange.axis.motion.Motion` keeps that target.
"""

from collections.abc import Callable
from enum import Enum
from typing import Final, NamedTuple

from gateway.compensation.moves import Accepted, Move, SteadyMove
from gateway.compiled import mypyc_attr
from gateway.counts import Counts
from gateway.exchange.axis.impossible import IGNORED, sentence_of


class Outcome(Enum):
    """How a request ended."""

    __hash__ = object.__hash__  # asked for with each request; that of Enum is slow

    ACKNOWLEDGED = "acknowledged"
    """Its drive answered with the full native success."""
    EXCEPTION = "exception"
    """Its drive refused it, with the function byte of this request."""
    OTHER_REPLY = "other-reply"
    """Its drive said something that proves nothing."""
    NO_REPLY = "no-reply"
    """It was sent, and no reply came in time, or the link went down."""
    BROADCAST = "broadcast"
    """It went to every drive, and none of them answers."""
    NEVER_SENT = "never-sent"
    """Refused, withdrawn or given up before it left, or spoilt while it did."""


class OnWire(Enum):
    """What is on its way to the drive, where a record is kept: nobody may live to see the reply."""

    __hash__ = object.__hash__

    NOTHING = "nothing"
    """Nothing that moves it."""
    TARGET = "target"
    """A target that it has or has not got."""
    MOTION = "motion"
    """Something that moves it in a way which nobody can say."""


class WireEvent(Enum):
    """What decides what is on its way to the drive."""

    __hash__ = object.__hash__

    TARGET_SENT = "target-sent"
    """A target leaves that a record can name: nothing else is open, and the branch is known."""
    MOTION_SENT = "motion-sent"
    """Something leaves that moves the axis in a way that its record does not say."""
    ENDED = "ended"
    """What was sent has been answered, or never will be."""


_NOTHING: Final = OnWire.NOTHING  # a member is looked up slowly, and these are asked for with each target
_TARGET: Final = OnWire.TARGET

ON_WIRE_AFTER: Final[dict[OnWire, dict[WireEvent, OnWire | None]]] = {
    OnWire.NOTHING: {
        WireEvent.TARGET_SENT: OnWire.TARGET,
        WireEvent.MOTION_SENT: OnWire.MOTION,
        WireEvent.ENDED: IGNORED,  # it moved nothing, or no record is kept
    },
    OnWire.TARGET: {
        WireEvent.TARGET_SENT: OnWire.TARGET,  # one of the fast path, rendered after all
        WireEvent.MOTION_SENT: OnWire.MOTION,  # a second one in the same frame: a record names one
        WireEvent.ENDED: OnWire.NOTHING,
    },
    OnWire.MOTION: {
        WireEvent.TARGET_SENT: IGNORED,  # one more in the same frame: a record can name none of them
        WireEvent.MOTION_SENT: IGNORED,
        WireEvent.ENDED: OnWire.NOTHING,
    },
}
"""What each event makes of each state; every pair can be."""


class Proof(Enum):
    """What readings have told of a target without an acknowledgement that is proven at its ends (M5)."""

    __hash__ = object.__hash__

    ONE = "one"
    """The next one at an end decides."""
    TWO = "two"
    """Two in a row at one end decide: it was on its way when the gateway ended, and its record names it."""
    AT_START = "at-start"
    """The first of the two was at its start."""
    AT_END = "at-end"
    """The first of the two was at its end."""
    NONE = "none"
    """None decides: the machine was switched off since, or its ends are too near each other."""
    EXECUTED = "executed"
    """It ran: the axis has gone to its end."""
    NOT_EXECUTED = "not-executed"
    """It did not: the axis stands at its start."""


class WayEnd(Enum):
    """At which end of its way an axis is seen."""

    __hash__ = object.__hash__

    START = "start"
    END = "end"
    NEITHER = "neither"
    """At neither, or where both windows overlap."""


PROOF_AFTER: Final[dict[Proof, dict[WayEnd, Proof]]] = {
    Proof.ONE: {WayEnd.START: Proof.NOT_EXECUTED, WayEnd.END: Proof.EXECUTED, WayEnd.NEITHER: Proof.ONE},
    Proof.TWO: {WayEnd.START: Proof.AT_START, WayEnd.END: Proof.AT_END, WayEnd.NEITHER: Proof.TWO},
    Proof.AT_START: {WayEnd.START: Proof.NOT_EXECUTED, WayEnd.END: Proof.AT_END, WayEnd.NEITHER: Proof.TWO},
    Proof.AT_END: {WayEnd.START: Proof.AT_START, WayEnd.END: Proof.EXECUTED, WayEnd.NEITHER: Proof.TWO},
    Proof.NONE: {WayEnd.START: Proof.NONE, WayEnd.END: Proof.NONE, WayEnd.NEITHER: Proof.NONE},
}
"""What each reading of an axis that may stand makes of it. What decides is there no more."""
AT_ONE_END: Final = frozenset({Proof.AT_START, Proof.AT_END})
DECIDED: Final = frozenset({Proof.EXECUTED, Proof.NOT_EXECUTED})


# --- a target ----------------------------------------------------------------------------------------------


class Rendering(NamedTuple):
    """A target ready to be written: both forms of its words, and what accepting it means."""

    number: int
    """Of its command field."""
    nominal_words: bytes
    corrected_words: bytes
    corrected_counts: Counts
    move: Move | None
    """None for a repeat: the drive is told exactly the same words again (M4)."""
    is_distance: bool = False
    """The words are a distance; ``corrected_counts`` is where it ends."""
    start: Accepted | None = None
    """Where a distance starts."""
    stood_there: bool = False
    """Of one that was not acknowledged: the drive held these words before, so to read them proves nothing."""
    is_beside_another: bool = False
    """Of such: the target right before it is so near that to see the axis there proves nothing."""
    proof: Proof = Proof.ONE
    """Of such, where its start is known: what readings at its ends have told by now."""


@mypyc_attr(free_list_len=1)  # as of the moves in them
class SteadyTarget:
    """A target on the fast path."""

    __slots__ = ("corrected_counts", "corrected_words", "epoch", "nominal_words", "steady")

    def __init__(
        self,
        nominal_words: bytes,
        corrected_words: bytes,
        corrected_counts: Counts,
        epoch: int,
        steady: SteadyMove | None,
    ) -> None:
        self.nominal_words = nominal_words
        self.corrected_words = corrected_words
        self.corrected_counts = corrected_counts
        self.epoch = epoch
        """Of its field, when it was sent."""
        self.steady = steady
        """What accepting it means; None: it is a repeat."""


class Acknowledgement:
    """What is on its way to the drive of one axis, as its record has to say it."""

    __slots__ = ("_on_fault", "on_wire", "pending")

    def __init__(self, on_fault: Callable[[str], None]) -> None:
        self._on_fault = on_fault
        self.on_wire = _NOTHING
        self.pending: Rendering | None = None
        """The target that was on the wire last, as long as its record has to name it."""

    def happens(self, event: WireEvent) -> None:
        """Go on to the state that the table says."""
        try:
            after = ON_WIRE_AFTER[self.on_wire][event]
        except KeyError:
            sentence = sentence_of("acknowledgement", self.on_wire, event)
            self.on_wire, self.pending = OnWire.MOTION, None  # the safest: a record says nothing
            self._on_fault(sentence)
            return
        if after is not IGNORED:
            self.on_wire = after

    def send(self, target: Rendering | None) -> None:
        """A target leaves; None: it is named when it ends otherwise than as usual (:meth:`name`)."""
        self.happens(WireEvent.TARGET_SENT)
        self.pending = target if self.on_wire is _TARGET else None

    def send_motion(self) -> None:
        """Something leaves that moves the axis in a way that its record does not say."""
        self.happens(WireEvent.MOTION_SENT)
        self.pending = None

    def name(self, target: Rendering) -> None:
        """Name the target that is on the wire, where it was not rendered before."""
        if self.on_wire is _TARGET and self.pending is None:
            self.pending = target

    def go_on_naming(self, target: Rendering | None) -> None:
        """A target of before is still open: its record goes on to name it."""
        self.pending = target

    def conclude(self, unacknowledged: Rendering | None) -> None:
        """What was sent has been answered, or never will be; ``unacknowledged``: what is open of it."""
        if self.on_wire is not _NOTHING:
            self.happens(WireEvent.ENDED)
        if unacknowledged is not self.pending:
            self.pending = None

    def let_go(self, target: Rendering) -> None:
        """A target is not open any more: a record need not name it."""
        if self.pending is target and self.on_wire is _NOTHING:
            self.pending = None

    def marked(self, target: Rendering, marked: Rendering) -> Rendering:
        """Return a target of which more is known now; its record goes on to name it."""
        if self.pending is target:
            self.pending = marked
        return marked
