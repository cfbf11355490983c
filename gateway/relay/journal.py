"""What happened, on its way to the log: noted on the hot path for the price of an append, written elsewhere.

A full pipe blocks whoever writes into it, so nothing here writes: ``ipc.log_thread`` does.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Final

from gateway.exchange.events import Event, EventKind
from gateway.ipc.log_thread import CAPACITY
from gateway.ipc.notes import Note, Severity

QUIET_KINDS: Final = frozenset(
    {
        EventKind.LINE_UP,
        EventKind.DRIVE_ANSWERS,
        EventKind.AXIS_REFERENCED,
        EventKind.RESTORED,
        EventKind.BUDGET_KEPT,
    }
)
"""Good news; every other event of the exchange is a warning."""


class Journal:
    """Makes notes for ``write``, which has to cost as little as an append; keeps the newest without it."""

    def __init__(self, write: Callable[[Note], None] | None) -> None:
        self._kept: deque[Note] = deque(maxlen=CAPACITY)
        self._write = write or self._kept.append
        self.on_note: Callable[[Note], None] = _tell_nobody
        """Gets every note, too, at the same price."""

    def note(self, severity: Severity, event: str, **fields: object) -> None:
        """Make a note; never blocks."""
        note = Note(severity, event, fields, time.time())
        self._write(note)
        self.on_note(note)

    def exchange_event(self, line: str, event: Event) -> None:
        """Append an event of a line's exchange."""
        severity = Severity.INFO if event.kind in QUIET_KINDS else Severity.WARNING
        axis = {"axis": event.axis} if event.axis else {}
        self.note(severity, event.kind.value, line=line, **axis, **dict(event.more), detail=event.detail)

    def record_not_used(self, line: str, axis: str, detail: str) -> None:
        """Append that the record of an axis does not count, or is not kept."""
        self.note(Severity.WARNING, EventKind.RECORD_NOT_USED.value, line=line, axis=axis, detail=detail)

    def recent(self) -> tuple[Note, ...]:
        """Return the newest notes where nobody writes them, oldest first."""
        return tuple(self._kept)


def _tell_nobody(note: Note) -> None:
    pass
