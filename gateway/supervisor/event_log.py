"""How the services that show the status log their own events."""

from typing import Protocol

from gateway.catalogue.entry import EventEntry, Severity


class LogEvent(Protocol):
    """Sends an event to the log and to all readers of the broadcast."""

    def __call__(self, event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        """Send the event without blocking; ``severity`` only where the catalogue leaves it open."""
        ...
