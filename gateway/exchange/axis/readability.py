"""Whether a drive reports the position of its axis when the gateway reads it (W8)."""

from enum import Enum
from typing import Final


class Readability(Enum):
    """Whether the drive reports the position of its axis when the gateway reads it (W8)."""

    __hash__ = object.__hash__

    OPEN = "open"
    """Nothing shows that it does not."""
    REFUSED_ONCE = "refused-once"
    """It answered one such read with an exception since the link came up."""
    REFUSED = "refused"
    """It did so twice in a row: the gateway stops reading until a controller gets a position, or the link
    comes up again."""


class PositionAnswer(Enum):
    """How the drive answers a read of its position."""

    __hash__ = object.__hash__

    POSITION = "place"
    PASSING = "passing"
    """A position, to a controller that read it."""
    REFUSAL = "refusal"
    """An exception that does not mean "later"."""
    LINK_LOST = "link-lost"
    """No answer; behind the next link there may be another drive, or the same one with other settings."""


READABILITY_AFTER: Final[dict[Readability, dict[PositionAnswer, Readability]]] = {
    Readability.OPEN: {
        PositionAnswer.POSITION: Readability.OPEN,
        PositionAnswer.PASSING: Readability.OPEN,
        PositionAnswer.REFUSAL: Readability.REFUSED_ONCE,  # it may have been busy
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
    Readability.REFUSED_ONCE: {
        PositionAnswer.POSITION: Readability.OPEN,
        PositionAnswer.PASSING: Readability.REFUSED_ONCE,  # says nothing about our own read
        PositionAnswer.REFUSAL: Readability.REFUSED,
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
    Readability.REFUSED: {
        PositionAnswer.POSITION: Readability.REFUSED,
        PositionAnswer.PASSING: Readability.REFUSED_ONCE,  # after one more refusal it is not read again
        PositionAnswer.REFUSAL: Readability.REFUSED,
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
}
"""The state after each answer; every pair is possible."""
