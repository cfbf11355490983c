"""Which unit ids of a line answer, and since when one does not: for the status, no frame goes by it.

An answer costs one store. A unit id is silent from the first request that it left unanswered to its next
answer.
"""

from dataclasses import dataclass
from typing import Final

from gateway.times import NS_PER_S

UNIT_IDS: Final = 0x100


@dataclass(slots=True)
class Silence:
    """What a unit id has left unanswered since its last answer."""

    since_ns: int
    """When the first request was sent that it did not answer."""
    timeouts: int
    """How many there were, all in a row."""


class Answers:
    """Answers and silences of one line, by unit id."""

    def __init__(self) -> None:
        self.answered_ns = [0] * UNIT_IDS
        """When each unit id answered last; 0: never."""
        self.silent: dict[int, Silence] = {}
        """Unit ids whose last request was not answered."""
        self.askers: set[tuple[str, int]] = set()
        """Controllers, each with a unit id that did not answer it or that nobody knows."""

    def miss(self, unit_id: int, sent_ns: int) -> bool:
        """Note a request without an answer; return whether the one before it was answered."""
        silence = self.silent.get(unit_id)
        if silence is None:
            self.silent[unit_id] = Silence(sent_ns, 1)
            return True
        silence.timeouts += 1
        return False

    def status(self, unit_id: int, now_ns: int) -> dict[str, object]:
        """Return what is known of one unit id: ages in s, null where there is nothing to measure."""
        answered_ns, silence = self.answered_ns[unit_id], self.silent.get(unit_id)
        return {
            "answered_s": round((now_ns - answered_ns) / NS_PER_S, 3) if answered_ns else None,
            "silent_s": None if silence is None else round((now_ns - silence.since_ns) / NS_PER_S, 3),
            "timeouts_in_a_row": 0 if silence is None else silence.timeouts,
        }
