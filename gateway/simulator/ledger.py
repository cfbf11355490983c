"""Record of what a simulated bus received and what its drives did, for tests and inspection."""

from collections import Counter, deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

LEDGER_LENGTH: Final = 10_000


@dataclass(frozen=True, slots=True)
class WriteRecord:
    """Written registers. ``unit_id`` is the drive's own, also for a broadcast."""

    unit_id: int
    function: int
    address: int
    words: bytes
    now_s: float


class MoveKind(Enum):
    """What a drive did."""

    ABSOLUTE = "absolute"
    RELATIVE = "relative"
    HOME = "home"
    STOP = "stop"
    SET_POSITION = "set_position"
    OTHER = "other"
    """Velocity, jog, or a mode that is not simulated: the axis does not move."""


@dataclass(frozen=True, slots=True)
class MoveRecord:
    """A motion that a drive started, in its own counts.

    ``target_counts`` is where the axis ends: for a stop, where it comes to rest; for a set position, the new
    value of the present position. None if there is no target.
    """

    unit_id: int
    axis: str
    kind: MoveKind
    target_counts: int | None
    now_s: float
    distance_counts: int | None = None
    """Of a relative move only."""


@dataclass(slots=True)
class Ledger:
    """The latest writes and moves, and the number of requests by function code since the start."""

    writes: "deque[WriteRecord]" = field(default_factory=lambda: deque(maxlen=LEDGER_LENGTH))
    moves: "deque[MoveRecord]" = field(default_factory=lambda: deque(maxlen=LEDGER_LENGTH))
    """Recorded by the drives of known makes, not by the generic one."""
    requests: "Counter[int]" = field(default_factory=Counter)
    unheard_of: "deque[str]" = field(default_factory=lambda: deque(maxlen=LEDGER_LENGTH))
    """Values that a drive of a known make received and does not know, each as a sentence."""

    def writes_to(self, unit_id: int, address: int) -> list[WriteRecord]:
        """Return the writes that began at an address of a drive."""
        return [w for w in self.writes if w.unit_id == unit_id and w.address == address]

    def moves_of(self, unit_id: int) -> list[tuple[MoveKind, int | None]]:
        """Return what a drive did, in order: the kind and the target in counts."""
        return [(move.kind, move.target_counts) for move in self.moves if move.unit_id == unit_id]
