"""Whether an axis knows where it is: what its positions mean hangs on it (M9)."""

from enum import Enum
from typing import Final

from gateway.exchange.plan import Reference
from gateway.times import NS_PER_MS, NS_PER_S


class Referenced(Enum):
    """Whether the axis knows where it is (M9). How that can be known, ``plan.Reference`` says.

    *In doubt*: where a status bit decides, it has to be read before positions pass.
    """

    __hash__ = object.__hash__

    UNTOLD = "untold"
    """The bit that decides was never seen."""
    UNTOLD_HOMING = "untold-homing"
    """The same, and a homing command was seen since the start."""
    LOST = "lost"
    """Nobody has said yet where the axis stands, or it may have lost that."""
    LOST_IN_DOUBT = "lost-in-doubt"
    """The same, and the bit has to be read before positions pass."""
    HOMING = "homing"
    """A homing command was seen, and not yet its end."""
    HOMING_IN_DOUBT = "homing-in-doubt"
    """The same, and the bit has to be read before positions pass."""
    FOUND = "found"
    """The axis knows where it is: its positions are corrected."""
    FOUND_IN_DOUBT = "found-in-doubt"
    """It was found, and the drive may have been switched off since."""


FOUND: Final = frozenset({Referenced.FOUND, Referenced.FOUND_IN_DOUBT})

HOMING: Final = frozenset({Referenced.UNTOLD_HOMING, Referenced.HOMING, Referenced.HOMING_IN_DOUBT})
IN_DOUBT: Final = frozenset(
    {
        Referenced.UNTOLD,
        Referenced.UNTOLD_HOMING,
        Referenced.LOST_IN_DOUBT,
        Referenced.HOMING_IN_DOUBT,
        Referenced.FOUND_IN_DOUBT,
    }
)

UNTOLD: Final = frozenset({Referenced.UNTOLD, Referenced.UNTOLD_HOMING})


class ReferenceEvent(Enum):
    """What decides whether an axis knows where it is."""

    __hash__ = object.__hash__

    BIT_SET = "bit-set"
    """The bit that decides is set, and is not that of the time before homing."""
    BIT_CLEAR = "bit-clear"
    """The bit that decides is not set."""
    HOMING = "homing"
    """A homing command went out."""
    OTHER_MOTION = "other-motion"
    """Something else was commanded: the bit that is seen next does not end a homing."""
    SET_AT_REST = "set-at-rest"
    """The drive was told that it stands somewhere else, and it stood."""
    SET_MOVING = "set-moving"
    """The same, and it moved, or nobody knows whether it was told."""
    LOSS = "loss"
    """The drive may have lost its position: switched off, an alarm, a jump."""
    SILENCE = "silence"
    """A request was not answered."""
    DECLARED = "declared"
    """A person says that the axis stands where its drive says."""


_TOLD_BY_BIT: Final = [each for each in Referenced if each is not Referenced.HOMING]
"""States of a reference that a bit of the drive decides: a homing command leaves it in doubt."""

_DOUBTED_AGAIN: Final = {
    Referenced.UNTOLD_HOMING: Referenced.UNTOLD,
    Referenced.LOST: Referenced.LOST_IN_DOUBT,
    Referenced.HOMING_IN_DOUBT: Referenced.LOST_IN_DOUBT,
    Referenced.FOUND: Referenced.LOST_IN_DOUBT,
    Referenced.FOUND_IN_DOUBT: Referenced.LOST_IN_DOUBT,
}

REFERENCE_AFTER: Final[dict[Reference, dict[ReferenceEvent, dict[Referenced, Referenced]]]] = {
    Reference.ABSOLUTE: {
        ReferenceEvent.SET_AT_REST: {Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.SET_MOVING: {Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.DECLARED: {Referenced.LOST: Referenced.FOUND},
    },
    Reference.SET_POSITION: {  # nothing hangs on homing: what counts is the position that is set after it
        ReferenceEvent.HOMING: {Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.SET_AT_REST: {Referenced.LOST: Referenced.FOUND},
        ReferenceEvent.SET_MOVING: {Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.LOSS: {Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.DECLARED: {Referenced.LOST: Referenced.FOUND},
    },
    Reference.HOMING: {
        ReferenceEvent.BIT_SET: {Referenced.HOMING: Referenced.FOUND},
        ReferenceEvent.HOMING: {Referenced.LOST: Referenced.HOMING, Referenced.FOUND: Referenced.HOMING},
        ReferenceEvent.OTHER_MOTION: {Referenced.HOMING: Referenced.LOST},
        ReferenceEvent.SET_AT_REST: {Referenced.HOMING: Referenced.LOST, Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.SET_MOVING: {Referenced.HOMING: Referenced.LOST, Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.LOSS: {Referenced.HOMING: Referenced.LOST, Referenced.FOUND: Referenced.LOST},
        ReferenceEvent.DECLARED: {Referenced.LOST: Referenced.FOUND, Referenced.HOMING: Referenced.FOUND},
    },
    Reference.DRIVE_BIT: {  # once the bit was seen to be down a homing has begun: the next one set ends it
        ReferenceEvent.BIT_SET: dict.fromkeys(_TOLD_BY_BIT, Referenced.FOUND),
        ReferenceEvent.BIT_CLEAR: dict.fromkeys(_TOLD_BY_BIT, Referenced.LOST),
        ReferenceEvent.HOMING: {
            Referenced.UNTOLD: Referenced.UNTOLD_HOMING,
            Referenced.LOST: Referenced.HOMING_IN_DOUBT,
            Referenced.LOST_IN_DOUBT: Referenced.HOMING_IN_DOUBT,
            Referenced.FOUND: Referenced.HOMING_IN_DOUBT,
            Referenced.FOUND_IN_DOUBT: Referenced.HOMING_IN_DOUBT,
        },
        ReferenceEvent.OTHER_MOTION: {
            Referenced.UNTOLD_HOMING: Referenced.UNTOLD,
            Referenced.HOMING_IN_DOUBT: Referenced.LOST_IN_DOUBT,
        },
        ReferenceEvent.SET_AT_REST: _DOUBTED_AGAIN,
        ReferenceEvent.SET_MOVING: _DOUBTED_AGAIN,
        ReferenceEvent.LOSS: {
            Referenced.UNTOLD_HOMING: Referenced.UNTOLD,
            Referenced.LOST: Referenced.LOST_IN_DOUBT,
            Referenced.HOMING_IN_DOUBT: Referenced.LOST_IN_DOUBT,
            Referenced.FOUND: Referenced.FOUND_IN_DOUBT,
        },
        ReferenceEvent.SILENCE: {
            Referenced.LOST: Referenced.LOST_IN_DOUBT,
            Referenced.FOUND: Referenced.FOUND_IN_DOUBT,
        },
    },
}
"""What each event makes of each state of the reference, by the way in which it is known."""

REFERENCE_AT_START: Final = {
    Reference.ABSOLUTE: Referenced.FOUND,
    Reference.DRIVE_BIT: Referenced.UNTOLD,
    Reference.HOMING: Referenced.LOST,
    Reference.SET_POSITION: Referenced.LOST,
}
REFERENCE_FRESH_NS: Final = NS_PER_S
"""A homed bit that was seen longer ago is read again before a target."""
HOMING_SETTLE_NS: Final = 100 * NS_PER_MS
"""A bit that is still set so soon after a homing command may be that of the homing before."""
