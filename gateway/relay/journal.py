"""What happened, on its way to the log: noted on the hot path for the price of an append, written elsewhere.

A full pipe blocks whoever writes into it, so nothing here writes: ``ipc.log_thread`` does.
"""

import time
from collections import deque
from collections.abc import Callable

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.exchange_events import RECORD_NOT_USED
from gateway.exchange.events import Event
from gateway.ipc.log import LogEntry, log_entry
from gateway.ipc.log_thread import CAPACITY


class Journal:
    """Makes notes for ``write``, which has to cost as little as an append; keeps the newest without it."""

    def __init__(self, write: Callable[[LogEntry], None] | None) -> None:
        self._kept: deque[LogEntry] = deque(maxlen=CAPACITY)
        self._write = write or self._kept.append
        self.on_entry: Callable[[LogEntry], None] = _ignore
        """Gets every note, too, at the same price."""

    def log(self, event: EventEntry, **fields: object) -> None:
        """Make a note of an event of the catalogue; never blocks."""
        entry = log_entry(event, fields, time.time())
        self._write(entry)
        self.on_entry(entry)

    def exchange_event(self, line: str, event: Event) -> None:
        """Append an event of a line's exchange."""
        axis = {"axis": event.axis} if event.axis else {}
        self.log(event.kind, line=line, **axis, **dict(event.more), detail=event.detail)

    def record_not_used(self, line: str, axis: str, detail: str) -> None:
        """Append that the record of an axis does not count, or is not kept."""
        self.log(RECORD_NOT_USED, line=line, axis=axis, detail=detail)

    def recent(self) -> tuple[LogEntry, ...]:
        """Return the newest notes where nobody writes them, oldest first."""
        return tuple(self._kept)


def _ignore(entry: LogEntry) -> None:
    pass
