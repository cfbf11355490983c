"""Whether a drive has taken a target: while it is on the wire, and after nobody acknowledged it (M5, M7)."""

from enum import Enum
from typing import Final, NamedTuple

from gateway.compensation.moves import Accepted, Move
from gateway.counts import Counts


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

    NOTHING = "nothing"
    """Nothing that moves it."""
    TARGET = "target"
    """A target that it has or has not got."""
    MOTION = "motion"
    """Something that moves it in a way which nobody can say."""


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
    RAN = "ran"
    RAN_NOT = "ran-not"


class End(Enum):
    """At which end of its way an axis is seen."""

    __hash__ = object.__hash__

    START = "start"
    END = "end"
    NEITHER = "neither"
    """At neither, or where both windows overlap."""


PROOF_AFTER: Final[dict[tuple[Proof, End], Proof]] = {
    (Proof.ONE, End.START): Proof.RAN_NOT,
    (Proof.ONE, End.END): Proof.RAN,
    (Proof.ONE, End.NEITHER): Proof.ONE,
    (Proof.TWO, End.START): Proof.AT_START,
    (Proof.TWO, End.END): Proof.AT_END,
    (Proof.TWO, End.NEITHER): Proof.TWO,
    (Proof.AT_START, End.START): Proof.RAN_NOT,
    (Proof.AT_START, End.END): Proof.AT_END,
    (Proof.AT_START, End.NEITHER): Proof.TWO,
    (Proof.AT_END, End.START): Proof.AT_START,
    (Proof.AT_END, End.END): Proof.RAN,
    (Proof.AT_END, End.NEITHER): Proof.TWO,
    (Proof.NONE, End.START): Proof.NONE,
    (Proof.NONE, End.END): Proof.NONE,
    (Proof.NONE, End.NEITHER): Proof.NONE,
}
"""What each reading of an axis that may stand makes of it. What decides is there no more."""

AT_ONE_END: Final = frozenset({Proof.AT_START, Proof.AT_END})


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
