"""Whether a drive has received a target that is on the wire, or that it did not acknowledge (M5, M7).

The process may be killed while a target is on the wire; the drive may then hold the target or not.
:class:`Acknowledgement` decides what the record says in that time.

The positions at which the axis is seen later prove a target that was sent and not acknowledged
(:class:`Proof`). :class:`~gateway.exchange.axis.motion.Motion` holds that target.
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

    __hash__ = object.__hash__  # used for each request; the hash of Enum is slow

    ACKNOWLEDGED = "acknowledged"
    """Its drive answered with a complete normal reply."""
    EXCEPTION = "exception"
    """Its drive refused it, with the function byte of this request."""
    OTHER_REPLY = "other-reply"
    """Its drive sent a reply that proves nothing."""
    NO_REPLY = "no-reply"
    """It was sent, and no reply came in time, or the link was lost."""
    BROADCAST = "broadcast"
    """It was sent to all drives; none of them answers."""
    NEVER_SENT = "never-sent"
    """It was refused, withdrawn or given up before it was sent, or aborted during forwarding."""


class OnWire(Enum):
    """What is on the wire to the drive. The record names it: the process may die before the reply."""

    __hash__ = object.__hash__

    NOTHING = "nothing"
    """Nothing that moves the axis."""
    TARGET = "target"
    """A target. The drive may have received it or not."""
    MOTION = "motion"
    """Something that moves the axis in a way that the record cannot describe."""


class WireEvent(Enum):
    """What changes :class:`OnWire`."""

    __hash__ = object.__hash__

    TARGET_SENT = "target-sent"
    """A target is sent that the record can name: no earlier target is open, and the side from which the axis
    approaches is known."""
    MOTION_SENT = "motion-sent"
    """Something is sent that moves the axis in a way that its record does not describe."""
    ENDED = "ended"
    """What was sent is answered, or will never be."""


_NOTHING: Final = OnWire.NOTHING  # member lookup is slow, and these are used for each target
_TARGET: Final = OnWire.TARGET

ON_WIRE_AFTER: Final[dict[OnWire, dict[WireEvent, OnWire | None]]] = {
    OnWire.NOTHING: {
        WireEvent.TARGET_SENT: OnWire.TARGET,
        WireEvent.MOTION_SENT: OnWire.MOTION,
        WireEvent.ENDED: IGNORED,  # the request moved nothing, or no record is kept
    },
    OnWire.TARGET: {
        WireEvent.TARGET_SENT: OnWire.TARGET,  # the same one: the slow path renders it again
        WireEvent.MOTION_SENT: OnWire.MOTION,  # a second target in the same frame: a record names one
        WireEvent.ENDED: OnWire.NOTHING,
    },
    OnWire.MOTION: {
        WireEvent.TARGET_SENT: IGNORED,  # one more in the same frame: a record can name none of them
        WireEvent.MOTION_SENT: IGNORED,
        WireEvent.ENDED: OnWire.NOTHING,
    },
}
"""The state after each event; every pair is possible."""


class Proof(Enum):
    """What readings at both ends of its travel say about an unacknowledged target (M5)."""

    __hash__ = object.__hash__

    ONE = "one"
    """The next reading at an end decides."""
    TWO = "two"
    """Two readings in a row at the same end decide: the target was on the wire when the gateway ended, and
    the record names it."""
    AT_START = "at-start"
    """The first of the two readings was at the start."""
    AT_END = "at-end"
    """The first of the two readings was at the end."""
    NONE = "none"
    """No reading decides: the machine was switched off since, or both ends are too close together."""
    EXECUTED = "executed"
    """It was executed: the axis went to its end."""
    NOT_EXECUTED = "not-executed"
    """It was not executed: the axis is still at its start."""


class WayEnd(Enum):
    """The end of its travel at which an axis is seen."""

    __hash__ = object.__hash__

    START = "start"
    END = "end"
    NEITHER = "neither"
    """At neither end, or where both windows overlap."""


PROOF_AFTER: Final[dict[Proof, dict[WayEnd, Proof]]] = {
    Proof.ONE: {WayEnd.START: Proof.NOT_EXECUTED, WayEnd.END: Proof.EXECUTED, WayEnd.NEITHER: Proof.ONE},
    Proof.TWO: {WayEnd.START: Proof.AT_START, WayEnd.END: Proof.AT_END, WayEnd.NEITHER: Proof.TWO},
    Proof.AT_START: {WayEnd.START: Proof.NOT_EXECUTED, WayEnd.END: Proof.AT_END, WayEnd.NEITHER: Proof.TWO},
    Proof.AT_END: {WayEnd.START: Proof.AT_START, WayEnd.END: Proof.EXECUTED, WayEnd.NEITHER: Proof.TWO},
    Proof.NONE: {WayEnd.START: Proof.NONE, WayEnd.END: Proof.NONE, WayEnd.NEITHER: Proof.NONE},
}
"""The proof after each reading of an axis that may be at standstill.

A decided proof closes its target, so no reading follows: it has no row.
"""
AT_ONE_END: Final = frozenset({Proof.AT_START, Proof.AT_END})
DECIDED: Final = frozenset({Proof.EXECUTED, Proof.NOT_EXECUTED})


# --- a target ----------------------------------------------------------------------------------------------


class Rendering(NamedTuple):
    """A target ready to be written: its words on both scales, and the state after its acceptance."""

    number: int
    """Number of its command field."""
    nominal_words: bytes
    corrected_words: bytes
    corrected_counts: Counts
    move: Move | None
    """None for a repeat: the drive gets exactly the same words again (M4)."""
    is_distance: bool = False
    """The words are a distance; the move ends at ``corrected_counts``."""
    start: Accepted | None = None
    """Where a distance starts."""
    stood_there: bool = False
    """For an unacknowledged target: the drive held these words before, so reading them proves nothing."""
    is_beside_another: bool = False
    """For an unacknowledged target: the target before it is so near that seeing the axis there proves
    nothing."""
    proof: Proof = Proof.ONE
    """For an unacknowledged target with a known start: what readings at its ends have shown so far."""


@mypyc_attr(free_list_len=1)  # as for the moves in them
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
        """Epoch of its field when it was sent."""
        self.steady = steady
        """The state after its acceptance; None: the target is a repeat."""


class Acknowledgement:
    """What is on the wire to the drive of one axis, as its record must describe it."""

    __slots__ = ("_on_fault", "on_wire", "pending")

    def __init__(self, on_fault: Callable[[str], None]) -> None:
        self._on_fault = on_fault
        self.on_wire = _NOTHING
        self.pending: Rendering | None = None
        """The target that was on the wire last, as long as its record must name it."""

    def happens(self, event: WireEvent) -> None:
        """Enter the state that the table gives."""
        try:
            after = ON_WIRE_AFTER[self.on_wire][event]
        except KeyError:
            sentence = sentence_of("acknowledgement", self.on_wire, event)
            self.on_wire, self.pending = OnWire.MOTION, None  # the safest state: the record says nothing
            self._on_fault(sentence)
            return
        if after is not IGNORED:
            self.on_wire = after

    def send(self, target: Rendering | None) -> None:
        """A target is sent; None: :meth:`name` names it if it ends in an unusual way."""
        self.happens(WireEvent.TARGET_SENT)
        self.pending = target if self.on_wire is _TARGET else None

    def send_motion(self) -> None:
        """Something is sent that moves the axis in a way that its record does not describe."""
        self.happens(WireEvent.MOTION_SENT)
        self.pending = None

    def name(self, target: Rendering) -> None:
        """Name the target that is on the wire, if it was not rendered before."""
        if self.on_wire is _TARGET and self.pending is None:
            self.pending = target

    def go_on_naming(self, target: Rendering | None) -> None:
        """An earlier target is still open: the record continues to name it."""
        self.pending = target

    def conclude(self, unacknowledged: Rendering | None) -> None:
        """What was sent is answered, or will never be; ``unacknowledged``: the target that stays open."""
        if self.on_wire is not _NOTHING:
            self.happens(WireEvent.ENDED)
        if unacknowledged is not self.pending:
            self.pending = None

    def let_go(self, target: Rendering) -> None:
        """A target is not open any more: the record need not name it."""
        if self.pending is target and self.on_wire is _NOTHING:
            self.pending = None

    def marked(self, target: Rendering, marked: Rendering) -> Rendering:
        """Return a target with new knowledge in it; the record continues to name it."""
        if self.pending is target:
            self.pending = marked
        return marked
