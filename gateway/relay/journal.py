"""Log entries of the hot path: an entry costs one append there and is written elsewhere.

A full pipe blocks the process that writes into it. So nothing here writes: ``ipc.log_thread`` does.
"""

from collections import deque
from collections.abc import Callable

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.exchange_events import RECORD_NOT_USED
from gateway.clock import wall_s
from gateway.exchange.events import Event
from gateway.ipc.log import LogEntry, log_entry
from gateway.ipc.log_thread import CAPACITY


class Journal:
    """Passes entries to ``write``, which must cost no more than an append; without it, keeps the newest."""

    def __init__(self, write: Callable[[LogEntry], None] | None) -> None:
        self._kept: deque[LogEntry] = deque(maxlen=CAPACITY)
        self._write = write or self._kept.append
        self.on_entry: Callable[[LogEntry], None] = _ignore
        """Gets every entry too; it must cost as little."""

    def log(self, event: EventEntry, **fields: object) -> None:
        """Log an event of the catalogue; never blocks."""
        entry = log_entry(event, fields, wall_s())
        self._write(entry)
        self.on_entry(entry)

    def exchange_event(self, line: str, event: Event) -> None:
        """Log an event of a line's exchange."""
        axis = {"axis": event.axis} if event.axis else {}
        self.log(event.kind, line=line, **axis, **dict(event.more), detail=event.detail)

    def record_not_used(self, line: str, axis: str, detail: str) -> None:
        """Log that the record of an axis is not used, or that the axis has none."""
        self.log(RECORD_NOT_USED, line=line, axis=axis, detail=detail)

    def recent(self) -> tuple[LogEntry, ...]:
        """Return the newest log entries, oldest first; only if ``write`` is not given."""
        return tuple(self._kept)


def _ignore(entry: LogEntry) -> None:
    pass
