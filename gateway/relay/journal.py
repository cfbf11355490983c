"""What happened, on its way to the log: noted on the hot path for the price of an append, written later.

A full pipe to the journal blocks whoever writes into it, so nothing here writes while frames pass: a task of
its own empties the notes a few times a second. When they come faster than that, the oldest are dropped and
counted.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import Final

from gateway.exchange.events import Event, EventKind
from gateway.ipc.notes import Note, Severity

CAPACITY: Final = 1000
WRITE_EVERY_S: Final = 0.2


QUIET_KINDS: Final = frozenset(
    {EventKind.LINE_UP, EventKind.DRIVE_ANSWERS, EventKind.AXIS_REFERENCED, EventKind.RESTORED}
)
"""Good news; every other event of the exchange is a warning."""


class Journal:
    """Collects notes; hands them to ``write`` off the hot path, or keeps the newest where there is none."""

    def __init__(self, write: Callable[[Note], None] | None) -> None:
        self._write = write
        self._notes: deque[Note] = deque(maxlen=CAPACITY)
        self._task: asyncio.Task[None] | None = None
        self.dropped = 0
        self.on_note: Callable[[Note], None] = _tell_nobody
        """Gets every note at once; it has to cost as little as an append."""

    def note(self, severity: Severity, event: str, **fields: object) -> None:
        """Append a note; never blocks."""
        if len(self._notes) == CAPACITY:
            self.dropped += self._write is not None
        note = Note(severity, event, fields, time.time())
        self._notes.append(note)
        self.on_note(note)

    def exchange_event(self, line: str, event: Event) -> None:
        """Append an event of a line's exchange."""
        severity = Severity.INFO if event.kind in QUIET_KINDS else Severity.WARNING
        axis = {"axis": event.axis} if event.axis else {}
        self.note(severity, event.kind.value, line=line, **axis, detail=event.detail)

    def record_not_used(self, line: str, axis: str, detail: str) -> None:
        """Append that the record of an axis does not count, or is not kept."""
        self.note(Severity.WARNING, EventKind.RECORD_NOT_USED.value, line=line, axis=axis, detail=detail)

    def recent(self) -> tuple[Note, ...]:
        """Return the notes that were not written yet, oldest first."""
        return tuple(self._notes)

    def start(self) -> None:
        """Begin to write."""
        if self._write is not None:
            self._task = asyncio.create_task(self._run())

    async def stop(self) -> None:
        """Write the rest and end."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
            self._task = None
        self.flush()

    def flush(self) -> None:
        """Write what there is, now."""
        if self._write is None:
            return
        if self.dropped:
            self._write(Note(Severity.WARNING, "notes-dropped", {"count": self.dropped}, time.time()))
            self.dropped = 0
        while self._notes:
            self._write(self._notes.popleft())

    async def _run(self) -> None:
        while True:
            await asyncio.sleep(WRITE_EVERY_S)
            self.flush()


def _tell_nobody(note: Note) -> None:
    pass
