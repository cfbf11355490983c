"""What a simulated bus received and what its drives did, for tests and for looking at."""

from collections import Counter, deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

LEDGER_LENGTH: Final = 10_000


@dataclass(frozen=True, slots=True)
class WriteRecord:
    """Registers that were written. ``unit_id`` is the drive's own, also for a broadcast."""

    unit_id: int
    function: int
    address: int
    words: bytes
    now_s: float


class MoveKind(Enum):
    """What a drive was made to do."""

    ABSOLUTE = "absolute"
    RELATIVE = "relative"
    HOME = "home"
    STOP = "stop"
    SET_POSITION = "set_position"
    OTHER = "other"
    """Velocity, jog, or a mode that is not simulated: the axis stays where it is."""


@dataclass(frozen=True, slots=True)
class MoveRecord:
    """Something that a drive started, in its own counts.

    ``target_counts`` is where the axis ends: of a stop where it comes to rest, of a set position what the
    place is called from then on. None where there is no target.
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
    """The latest writes and moves, and how many requests of each function came in since the start."""

    writes: "deque[WriteRecord]" = field(default_factory=lambda: deque(maxlen=LEDGER_LENGTH))
    moves: "deque[MoveRecord]" = field(default_factory=lambda: deque(maxlen=LEDGER_LENGTH))
    """Kept by the drives that are simulated by name, not by the plain one."""
    requests: "Counter[int]" = field(default_factory=Counter)
    unheard_of: "deque[str]" = field(default_factory=lambda: deque(maxlen=LEDGER_LENGTH))
    """Values that a drive simulated by name was told and does not know, each as a sentence."""

    def writes_to(self, unit_id: int, address: int) -> list[WriteRecord]:
        """Writes that began at an address of a drive."""
        return [w for w in self.writes if w.unit_id == unit_id and w.address == address]

    def moves_of(self, unit_id: int) -> list[tuple[MoveKind, int | None]]:
        """What a drive was made to do, in order: the kind and the target in counts."""
        return [(move.kind, move.target_counts) for move in self.moves if move.unit_id == unit_id]
