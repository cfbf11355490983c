"""Whether the triggers of an axis are refused because a target was lost (M3, M11).

Stops always pass. What was lost counts until a complete target was accepted that was sent after the loss;
what was sent before carries an older *epoch*. An axis of a group is refused its triggers as well while
another one is blocked for its own sake (``Axis.blocked_by``).
"""

from collections.abc import Callable
from enum import Enum
from typing import Final

from gateway.exchange.axis.impossible import IGNORED, sentence_of


class Block(Enum):
    """Whether triggers are refused because a target was lost (M3)."""

    __hash__ = object.__hash__

    NONE = "none"
    """Triggers pass."""
    OWN = "own"
    """The target was lost for its own sake."""
    OF_GROUP = "of-group"
    """It was lost because another axis of the group was blocked (M11)."""


class BlockEvent(Enum):
    """What decides whether the triggers of an axis are refused."""

    __hash__ = object.__hash__

    LOST = "lost"
    """A target, its mode or a part of it was lost for its own sake."""
    LOST_OF_GROUP = "lost-of-group"
    """It was lost because another axis of the group was blocked (M11)."""
    COMPLETED = "completed"
    """The drive accepted a complete target that was sent after the loss."""


BLOCK_AFTER: Final[dict[Block, dict[BlockEvent, Block | None]]] = {
    Block.NONE: {
        BlockEvent.LOST: Block.OWN,
        BlockEvent.LOST_OF_GROUP: Block.OF_GROUP,
        BlockEvent.COMPLETED: IGNORED,  # as always
    },
    Block.OWN: {
        BlockEvent.LOST: IGNORED,  # the first loss says why
        BlockEvent.LOST_OF_GROUP: IGNORED,  # its own loss holds up the others too: it must not be taken back
        BlockEvent.COMPLETED: Block.NONE,
    },
    Block.OF_GROUP: {
        BlockEvent.LOST: Block.OWN,
        BlockEvent.LOST_OF_GROUP: IGNORED,
        BlockEvent.COMPLETED: Block.NONE,
    },
}
"""What each event makes of each state; every pair can be."""


class Interlock:
    """Whether the triggers of one axis are refused, since when and with which code."""

    __slots__ = ("_on_fault", "block", "block_code", "blocked_in_epoch", "epoch")

    def __init__(self, on_fault: Callable[[str], None]) -> None:
        self._on_fault = on_fault
        self.block = Block.NONE
        self.block_code = 0
        """Exception code of the target that was lost; its triggers are refused with it."""
        self.epoch = 0
        """Goes up with each target and mode that is lost: what was sent before makes up for none."""
        self.blocked_in_epoch = 0
        """The epoch that began with the loss for which triggers were blocked last."""

    def happens(self, event: BlockEvent) -> bool:
        """Go on to the state that the table says; return whether triggers pass otherwise than before."""
        before = self.block
        try:
            after = BLOCK_AFTER[before][event]
        except KeyError:
            self.block = Block.OWN
            self._on_fault(sentence_of("interlock", before, event))
            return False
        if after is IGNORED:
            return False
        self.block = after
        return (before is Block.NONE) is not (after is Block.NONE)

    def begin_epoch(self) -> int:
        """Something is lost: return the epoch that begins with it."""
        self.epoch += 1
        return self.epoch

    def refuse(self, code: int, *, is_own: bool) -> bool:
        """Refuse triggers from now on; return whether they passed before.

        ``is_own``: for its own sake, not because another axis of the group was blocked (M11).
        """
        self.blocked_in_epoch = self.begin_epoch()
        is_new = self.happens(BlockEvent.LOST if is_own else BlockEvent.LOST_OF_GROUP)
        if is_new:
            self.block_code = code
        return is_new

    def complete(self, epoch: int) -> bool:
        """A complete target was accepted, sent in ``epoch``; return whether triggers pass again by that."""
        return epoch >= self.blocked_in_epoch and self.happens(BlockEvent.COMPLETED)

    @property
    def is_blocked(self) -> bool:
        """Whether triggers are refused."""
        return self.block is not Block.NONE
