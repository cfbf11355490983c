"""Whether the triggers of an axis are refused because a target was lost (M3, M11)."""

from enum import Enum
from typing import Final


class Block(Enum):
    """Whether triggers are refused because a target was lost (M3)."""

    NONE = "none"
    """Triggers pass."""
    OWN = "own"
    """The target was lost for its own sake."""
    OF_GROUP = "of-group"
    """It was lost because another axis of the group was blocked (M11)."""


class BlockEvent(Enum):
    """What decides whether the triggers of an axis are refused."""

    LOST = "lost"
    """A target, its mode or a part of it was lost for its own sake."""
    LOST_OF_GROUP = "lost-of-group"
    """It was lost because another axis of the group was blocked (M11)."""
    COMPLETED = "completed"
    """The drive accepted a complete target that was sent after the loss."""


BLOCK_AFTER: Final[dict[tuple[Block, BlockEvent], Block]] = {
    (Block.NONE, BlockEvent.LOST): Block.OWN,
    (Block.OF_GROUP, BlockEvent.LOST): Block.OWN,
    (Block.NONE, BlockEvent.LOST_OF_GROUP): Block.OF_GROUP,
    (Block.OWN, BlockEvent.COMPLETED): Block.NONE,
    (Block.OF_GROUP, BlockEvent.COMPLETED): Block.NONE,
}
"""What each event makes of each block."""
