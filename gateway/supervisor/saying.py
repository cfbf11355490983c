"""How what serves the status tells of what happens to itself."""

from typing import Protocol

from gateway.ipc.notes import Severity


class Say(Protocol):
    """Tells of an event: to the log, and to everyone who reads the feeds."""

    def __call__(self, event: str, severity: Severity = Severity.INFO, **fields: object) -> None:
        """Tell of it; does not block."""
        ...
