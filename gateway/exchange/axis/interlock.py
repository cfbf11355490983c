"""Whether the triggers of an axis are refused because a target was lost (M3, M11).

Stops always pass. Triggers stay refused until a complete target is accepted that was sent after the loss. A
target that was sent before carries an older *epoch* and does not count. In a group, triggers are also refused
while another axis is blocked for its own loss (``Axis.blocked_by``).
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
    """The axis itself lost a target."""
    OF_GROUP = "of-group"
    """Its target was lost because another axis of the group was blocked (M11)."""


class BlockEvent(Enum):
    """What decides whether the triggers of an axis are refused."""

    __hash__ = object.__hash__

    LOST = "lost"
    """A target, its mode or a part of it was lost by the axis itself."""
    LOST_OF_GROUP = "lost-of-group"
    """It was lost because another axis of the group was blocked (M11)."""
    COMPLETED = "completed"
    """The drive accepted a complete target that was sent after the loss."""


BLOCK_AFTER: Final[dict[Block, dict[BlockEvent, Block | None]]] = {
    Block.NONE: {
        BlockEvent.LOST: Block.OWN,
        BlockEvent.LOST_OF_GROUP: Block.OF_GROUP,
        BlockEvent.COMPLETED: IGNORED,  # the usual case
    },
    Block.OWN: {
        BlockEvent.LOST: IGNORED,  # the first loss gives the reason
        BlockEvent.LOST_OF_GROUP: IGNORED,  # its own loss blocks the other axes too, and must still do so
        BlockEvent.COMPLETED: Block.NONE,
    },
    Block.OF_GROUP: {
        BlockEvent.LOST: Block.OWN,
        BlockEvent.LOST_OF_GROUP: IGNORED,
        BlockEvent.COMPLETED: Block.NONE,
    },
}
"""The state after each event; every pair is possible."""


class Interlock:
    """Whether the triggers of one axis are refused, since when and with which code."""

    __slots__ = ("_on_fault", "block", "block_code", "blocked_in_epoch", "epoch")

    def __init__(self, on_fault: Callable[[str], None]) -> None:
        self._on_fault = on_fault
        self.block = Block.NONE
        self.block_code = 0
        """Exception code of the lost target; triggers are refused with it."""
        self.epoch = 0
        """Increases with each lost target or mode. A target that was sent before a loss is older than it, and
        does not replace what was lost."""
        self.blocked_in_epoch = 0
        """The epoch that began with the newest loss that blocked triggers."""

    def happens(self, event: BlockEvent) -> bool:
        """Enter the state that the table gives; return whether it is another one."""
        try:
            after = BLOCK_AFTER[self.block][event]
        except KeyError:
            self._on_fault(sentence_of("interlock", self.block, event))  # refuses the triggers (``Axis``)
            self.block = Block.OWN
            return False
        if after is IGNORED:
            return False
        self.block = after
        return True

    def begin_epoch(self) -> int:
        """Something was lost: return the epoch that begins with it."""
        self.epoch += 1
        return self.epoch

    def refuse(self, code: int, *, is_own: bool) -> bool:
        """Refuse triggers from now on; return whether they passed before.

        ``is_own``: the axis lost the target itself, not because another axis of the group was blocked (M11).
        """
        self.blocked_in_epoch = self.begin_epoch()
        passed = self.block is Block.NONE
        if self.happens(BlockEvent.LOST if is_own else BlockEvent.LOST_OF_GROUP):
            self.block_code = code
        return passed

    def complete(self, epoch: int) -> bool:
        """A complete target, sent in ``epoch``, was accepted; return whether it released the triggers."""
        return epoch >= self.blocked_in_epoch and self.happens(BlockEvent.COMPLETED)

    @property
    def is_blocked(self) -> bool:
        """Whether triggers are refused."""
        return self.block is not Block.NONE
