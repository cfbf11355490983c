"""Whether a drive tells where its axis stands when the gateway asks for it (W8)."""

from enum import Enum
from typing import Final


class Sight(Enum):
    """Whether the drive tells where its axis stands when the gateway asks for it (W8)."""

    __hash__ = object.__hash__

    OPEN = "open"
    """Nothing says that it does not."""
    REFUSED_ONCE = "refused-once"
    """It has answered one such read with an exception since the link came up."""
    REFUSED = "refused"
    """It has done so twice in a row: it is not asked before it tells a controller, or the link comes up."""


class Told(Enum):
    """What the drive answers when it is asked where its axis stands."""

    __hash__ = object.__hash__

    PLACE = "place"
    PASSING = "passing"
    """A place, to a controller that asked for it."""
    REFUSAL = "refusal"
    """An exception that does not say "later"."""
    LINK_LOST = "link-lost"
    """Nothing; behind the next link another drive may stand, or the same one with other settings."""


SIGHT_AFTER: Final[dict[Sight, dict[Told, Sight]]] = {
    Sight.OPEN: {
        Told.PLACE: Sight.OPEN,
        Told.PASSING: Sight.OPEN,
        Told.REFUSAL: Sight.REFUSED_ONCE,  # it may have been busy with something else
        Told.LINK_LOST: Sight.OPEN,
    },
    Sight.REFUSED_ONCE: {
        Told.PLACE: Sight.OPEN,
        Told.PASSING: Sight.REFUSED_ONCE,  # what a controller is told says nothing of the gateway's own read
        Told.REFUSAL: Sight.REFUSED,
        Told.LINK_LOST: Sight.OPEN,
    },
    Sight.REFUSED: {
        Told.PLACE: Sight.REFUSED,
        Told.PASSING: Sight.REFUSED_ONCE,  # it tells again: one more refusal, and it is left alone again
        Told.REFUSAL: Sight.REFUSED,
        Told.LINK_LOST: Sight.OPEN,
    },
}
"""Where each answer leads; every pair can be."""
