"""Where an axis is, and what each thing that can happen to it makes of that (M4 to M6)."""

from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from gateway.compensation.moves import Move
from gateway.counts import Counts


class Whereabouts(Enum):
    """Where the axis is, as far as anybody can tell."""

    __hash__ = object.__hash__  # looked up with each sample; that of Enum is slow

    UNKNOWN = "unknown"
    """Something else than a target decides where it is: homing, a jog, a stored position, an alarm."""
    STOPPED = "stopped"
    """A stop came after the last target: it stands somewhere, on the branch of that target."""
    RETAINED = "retained"
    """The reference has changed since: the last target means nothing, but its words are kept. Where the axis
    is seen to stand there a repeat of that target is the same words, and moves nothing (:class:`Keeping`)."""
    OUT_OF_REACH = "out-of-reach"
    """Its drive could not be reached, or was silent for long: the same."""
    UNPROVEN = "unproven"
    """A target was sent and not acknowledged: the drive may hold it or not."""
    UNPROVEN_AT_REST = "unproven-at-rest"
    """The same, and the drive has said done since."""
    UNDER_WAY = "under-way"
    """The last target was acknowledged, and nothing has shown the axis there, nor where it set out."""
    SET_OUT = "set-out"
    """The same, but it was known where it stood, and on which branch, when it set out."""
    DONE_SAID = "done-said"
    """Its drive says done; where it stands has not been seen yet."""
    SEEN_THERE = "seen-there"
    """Its actual position was seen in the window; its drive has not said done."""
    ARRIVED = "arrived"
    """Both, or the drive's word alone where no actual position is mapped."""
    MAY_HAVE_LEFT = "may-have-left"
    """Done fell after that: a motion that is not of our making, or the bit has flickered."""
    STANDS_AGAIN = "stands-again"
    """Done rose after that, or it was seen beside its target: it stands, there or elsewhere."""


TARGETED: Final = frozenset(
    {
        Whereabouts.UNDER_WAY,
        Whereabouts.SET_OUT,
        Whereabouts.DONE_SAID,
        Whereabouts.SEEN_THERE,
        Whereabouts.ARRIVED,
        Whereabouts.MAY_HAVE_LEFT,
        Whereabouts.STANDS_AGAIN,
    }
)
"""Places of which the last accepted target says where the axis is or goes."""

ON_WAY: Final = frozenset({Whereabouts.UNDER_WAY, Whereabouts.SET_OUT})
"""Places from which nothing has shown the axis at its target yet."""
WAS_THERE: Final = TARGETED - ON_WAY
"""Places from which an axis that is seen away has been moved by something else."""

MAY_BE_ELSEWHERE: Final = frozenset({Whereabouts.MAY_HAVE_LEFT, Whereabouts.STANDS_AGAIN})
"""Places from which an axis is looked at before a repeat of its target (M4)."""

AT_REST: Final = WAS_THERE | {Whereabouts.UNPROVEN_AT_REST}
"""Places of which anything says that the axis stands."""

ON_BRANCH: Final = TARGETED | {Whereabouts.STOPPED}
"""Places at which the branch of the last target is that on which the axis stands or moves."""

RETAINING: Final = frozenset({Whereabouts.RETAINED, Whereabouts.OUT_OF_REACH})
"""Places that keep the last target, which means nothing in them."""

UNPROVEN: Final = frozenset({Whereabouts.UNPROVEN, Whereabouts.UNPROVEN_AT_REST})


class Happening(Enum):
    """What decides, or shows, where an axis is."""

    __hash__ = object.__hash__  # looked up with each sample; that of Enum is slow

    ACKNOWLEDGED = "acknowledged"
    """The drive acknowledged a target and goes there, or was seen to have gone there."""
    ACKNOWLEDGED_AT_REST = "acknowledged-at-rest"
    """The same of an axis that stood where it was known to stand, on the branch of the target before."""
    UNACKNOWLEDGED = "unacknowledged"
    """A target went out, and its acknowledgement never came."""
    RAN_NOT = "ran-not"
    """A distance that was not acknowledged did not run: the axis was seen where it would have started."""
    STOPPED = "stopped"
    """It stands, or soon will, somewhere on the way that it was on."""
    DISPLACED = "displaced"
    """Something else than a target moves it, or has moved it, or nobody knows."""
    OUT_OF_REACH = "out-of-reach"
    """The way to its drive was lost, or it was silent for so long that it may have been switched off."""
    REFERENCE_CHANGED = "reference-changed"
    """Its last target means nothing from now on, and nothing but a target has moved it since."""
    DONE = "done"
    """Its drive says done, and what it says is not of the time before."""
    DONE_ALONE = "done-alone"
    """The same, and there is no actual position to look at."""
    FELL = "fell"
    """Its drive says: not done."""
    THERE = "there"
    """The actual position lies in the in-position window of the last target."""
    NEAR = "near"
    """It lies beside it, by no more than a correction."""
    AWAY = "away"
    """It lies elsewhere."""


WHEREABOUTS_AFTER: Final[dict[tuple[Whereabouts, Happening], Whereabouts]] = {
    **{(place, Happening.ACKNOWLEDGED): Whereabouts.UNDER_WAY for place in Whereabouts},
    **{(place, Happening.ACKNOWLEDGED_AT_REST): Whereabouts.SET_OUT for place in Whereabouts},
    **{(place, Happening.UNACKNOWLEDGED): Whereabouts.UNPROVEN for place in Whereabouts},
    **{(place, Happening.RAN_NOT): Whereabouts.UNDER_WAY for place in UNPROVEN},
    **{
        (place, Happening.STOPPED): Whereabouts.STOPPED if place in ON_BRANCH else Whereabouts.UNKNOWN
        for place in Whereabouts
    },
    **{(place, Happening.DISPLACED): Whereabouts.UNKNOWN for place in Whereabouts},
    **{
        (place, Happening.OUT_OF_REACH): Whereabouts.OUT_OF_REACH
        if place in TARGETED
        else Whereabouts.UNKNOWN
        for place in set(Whereabouts) - RETAINING
    },
    **{(place, Happening.REFERENCE_CHANGED): Whereabouts.RETAINED for place in TARGETED | RETAINING},
    **{(place, Happening.AWAY): Whereabouts.UNKNOWN for place in RETAINING},
    (Whereabouts.UNPROVEN, Happening.DONE): Whereabouts.UNPROVEN_AT_REST,
    (Whereabouts.UNPROVEN, Happening.DONE_ALONE): Whereabouts.UNPROVEN_AT_REST,
    **{(place, Happening.DONE): Whereabouts.DONE_SAID for place in ON_WAY},
    **{(place, Happening.DONE_ALONE): Whereabouts.ARRIVED for place in ON_WAY},
    **{(place, Happening.THERE): Whereabouts.SEEN_THERE for place in ON_WAY},
    (Whereabouts.DONE_SAID, Happening.FELL): Whereabouts.MAY_HAVE_LEFT,
    (Whereabouts.DONE_SAID, Happening.THERE): Whereabouts.ARRIVED,
    (Whereabouts.DONE_SAID, Happening.AWAY): Whereabouts.UNKNOWN,
    (Whereabouts.SEEN_THERE, Happening.DONE): Whereabouts.ARRIVED,
    (Whereabouts.SEEN_THERE, Happening.NEAR): Whereabouts.UNDER_WAY,
    (Whereabouts.SEEN_THERE, Happening.AWAY): Whereabouts.UNKNOWN,
    (Whereabouts.ARRIVED, Happening.FELL): Whereabouts.MAY_HAVE_LEFT,
    (Whereabouts.ARRIVED, Happening.NEAR): Whereabouts.STANDS_AGAIN,
    (Whereabouts.ARRIVED, Happening.AWAY): Whereabouts.UNKNOWN,
    (Whereabouts.MAY_HAVE_LEFT, Happening.DONE): Whereabouts.STANDS_AGAIN,
    (Whereabouts.MAY_HAVE_LEFT, Happening.AWAY): Whereabouts.UNKNOWN,
    (Whereabouts.STANDS_AGAIN, Happening.FELL): Whereabouts.MAY_HAVE_LEFT,
    (Whereabouts.STANDS_AGAIN, Happening.THERE): Whereabouts.ARRIVED,
    (Whereabouts.STANDS_AGAIN, Happening.AWAY): Whereabouts.UNKNOWN,
}
"""What each happening makes of each place; what is not here changes nothing."""


class Said(Enum):
    """What the drive has said since the last motion began: the end of an old one and of this look alike."""

    NOTHING = "nothing"
    """Nothing that could not be of the time before."""
    MOVES = "moves"
    STOOD = "stood"
    """It moved, and then stood."""


class Keeping(Enum):
    """What a target is that equals the one of before a loss of reach or reference."""

    NEW = "new"
    """A new target: no such one is kept, or the axis was seen elsewhere since."""
    SAME_WORDS = "same-words"
    """The same words as before: the axis was seen to stand there since, or nobody may look and its drive goes
    with each write (a cyclic writer must not jerk it)."""
    UNSEEN = "unseen"
    """Nobody may look, and its drive waits for a trigger: refused until a reading or a different target."""


KEEPING: Final[dict[tuple[bool, bool, bool], Keeping]] = {
    # was seen there since, its drive waits for a trigger, had been seen there before the loss
    (True, True, True): Keeping.SAME_WORDS,
    (True, True, False): Keeping.SAME_WORDS,
    (True, False, True): Keeping.SAME_WORDS,
    (True, False, False): Keeping.SAME_WORDS,
    (False, False, True): Keeping.SAME_WORDS,
    (False, False, False): Keeping.SAME_WORDS,
    (False, True, True): Keeping.UNSEEN,
    (False, True, False): Keeping.NEW,
}
"""What a kept target is; one that was seen elsewhere is not kept any more."""


class KeptOver(Enum):
    """What a last target is kept over."""

    LOSS = "loss"
    """The drive may have been switched off, or counts from another zero."""
    ORDERLY_CLOSE = "orderly-close"
    """The link was closed in order, and nothing else was lost: its drive may hold these words still."""
    DECLARATION = "declaration"
    """Nothing was lost: a person has declared the reference, and the drive holds these words as before."""


@dataclass(slots=True)
class Actual:
    """The last actual position seen, as the drive reported it."""

    counts: Counts
    seen_ns: int


class Retained(NamedTuple):
    """The last target as its drive was told it, over a loss of reach or reference."""

    number: int
    nominal_words: bytes
    corrected_words: bytes
    corrected_counts: Counts
    move: Move
    """The correction it was told with."""
    was_there: bool
    """The axis had been seen at it, or its drive had said so, before the loss."""
    newest_ns: int
    """When the last actual position before the loss was asked for: only a later one proves anything."""
    over: KeptOver = KeptOver.LOSS

    @property
    def is_declared(self) -> bool:
        """Whether it needs no proof: nothing was lost."""
        return self.over is KeptOver.DECLARATION
