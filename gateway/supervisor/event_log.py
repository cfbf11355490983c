"""How what serves the status tells of what happens to itself."""

from typing import Protocol

from gateway.catalogue.entry import EventEntry, Severity


class LogEvent(Protocol):
    """Tells of an event: to the log, and to everyone who reads the feeds."""

    def __call__(self, event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        """Tell of it; does not block. ``severity`` only where the catalogue leaves it open."""
        ...
