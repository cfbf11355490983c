"""What the ledger writes down: counts, violations, and the last events of each axis to explain them."""

from collections import Counter, deque
from typing import Final

from tests.ledger.clock import MS, Clock

KEPT: Final = 40
"""Events of one axis that are printed with a violation."""


class ViolationError(Exception):
    """The gateway broke a rule; the text is the whole story."""


class Journal:
    """The last events of one axis."""

    def __init__(self, clock: Clock, name: str, kept: int) -> None:
        self.name = name
        self._clock = clock
        self._events: deque[tuple[int, str, bytes, str]] = deque(maxlen=kept)

    def note(self, what: str, pdu: bytes = b"", detail: str = "") -> None:
        self._events.append((self._clock.now_ns, what, pdu, detail))

    def text(self) -> str:
        return "\n".join(
            f"  {at / MS:12.3f} ms  {what:<24} {pdu.hex(' ')}  {detail}"
            for at, what, pdu, detail in self._events
        )


class Book:
    """Counts of everything that was seen, and of everything that was wrong."""

    def __init__(self, seed: int, *, stops_at_first: bool, kept: int = KEPT) -> None:
        self.seed = seed
        self.kept = kept
        self.seen: Counter[str] = Counter()
        self.violations: Counter[str] = Counter()
        self.stories: dict[str, list[str]] = {}
        self._stops_at_first = stops_at_first
        self.line = ""

    def violation(self, kind: str, detail: str, journal: Journal | None) -> None:
        """Note a broken rule.

        Raises:
            ViolationError: when the run is to end at the first one.
        """
        self.violations[kind] += 1
        story = f"{kind} (seed {self.seed}, line {self.line}): {detail}"
        if journal is not None:
            story += f"\n axis {journal.name}:\n{journal.text()}"
        self.stories.setdefault(kind, [])
        if len(self.stories[kind]) < 3:
            self.stories[kind].append(story)
        if self._stops_at_first:
            raise ViolationError(story)
