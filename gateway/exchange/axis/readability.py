"""Whether a drive tells where its axis stands when the gateway asks for it (W8)."""

from enum import Enum
from typing import Final


class Readability(Enum):
    """Whether the drive tells where its axis stands when the gateway asks for it (W8)."""

    __hash__ = object.__hash__

    OPEN = "open"
    """Nothing says that it does not."""
    REFUSED_ONCE = "refused-once"
    """It has answered one such read with an exception since the link came up."""
    REFUSED = "refused"
    """It has done so twice in a row: it is not asked before it tells a controller, or the link comes up."""


class PositionAnswer(Enum):
    """What the drive answers when it is asked where its axis stands."""

    __hash__ = object.__hash__

    POSITION = "place"
    PASSING = "passing"
    """A place, to a controller that asked for it."""
    REFUSAL = "refusal"
    """An exception that does not say "later"."""
    LINK_LOST = "link-lost"
    """Nothing; behind the next link another drive may stand, or the same one with other settings."""


READABILITY_AFTER: Final[dict[Readability, dict[PositionAnswer, Readability]]] = {
    Readability.OPEN: {
        PositionAnswer.POSITION: Readability.OPEN,
        PositionAnswer.PASSING: Readability.OPEN,
        PositionAnswer.REFUSAL: Readability.REFUSED_ONCE,  # it may have been busy with something else
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
    Readability.REFUSED_ONCE: {
        PositionAnswer.POSITION: Readability.OPEN,
        PositionAnswer.PASSING: Readability.REFUSED_ONCE,  # a controller's reply says nothing of the own read
        PositionAnswer.REFUSAL: Readability.REFUSED,
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
    Readability.REFUSED: {
        PositionAnswer.POSITION: Readability.REFUSED,
        PositionAnswer.PASSING: Readability.REFUSED_ONCE,  # one more refusal, and it is left alone again
        PositionAnswer.REFUSAL: Readability.REFUSED,
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
}
"""Where each answer leads; every pair can be."""
