"""What a simulated bus received, for tests and for looking at."""

from collections import Counter, deque
from dataclasses import dataclass, field
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


@dataclass(slots=True)
class Ledger:
    """The latest writes, and how many requests of each function came in since the start."""

    writes: "deque[WriteRecord]" = field(default_factory=lambda: deque(maxlen=LEDGER_LENGTH))
    requests: "Counter[int]" = field(default_factory=Counter)

    def writes_to(self, unit_id: int, address: int) -> list[WriteRecord]:
        """Writes that began at an address of a drive."""
        return [w for w in self.writes if w.unit_id == unit_id and w.address == address]
