"""The log of supervisor and commands, with structlog: its lines, and a context for every later line.

A relay that writes JSON does not load it (:func:`gateway.ipc.log.json_writer`).
"""

from typing import Final

import structlog
from structlog.typing import EventDict

from gateway.catalogue.entry import Severity
from gateway.ipc.log import (
    LogEntry,
    LogFormat,
    LogLines,
    is_terminal,
    json_text,
    line_of,
    name_standard_error,
)


class StructuredLog:
    """Writes entries; it blocks while the reader of standard error stalls, as :class:`LogLines` does."""

    def __init__(self, log_format: LogFormat) -> None:
        self._is_json: Final = log_format.is_json
        render = (
            _json if self._is_json else structlog.dev.ConsoleRenderer(colors=is_terminal(), sort_keys=False)
        )
        self._log = structlog.BoundLogger(_Lines(), [_line, render], {})

    def name_gateway(self, gateway: str) -> None:
        """Add the gateway's name to every later line, also to what this process writes to ``sys.stderr``.

        Not on a terminal, which shows one gateway only.
        """
        name_standard_error(gateway)
        if self._is_json:
            self._log = self._log.bind(gateway=gateway)

    def write(self, entry: LogEntry) -> None:
        """Write one entry; its fields name its line and axis."""
        getattr(self._log, entry.severity.value)(entry.event, entry=entry)


class _Lines:
    """What structlog passes its text to, by the name of the level."""

    def __init__(self) -> None:
        self._lines = LogLines()

    def info(self, text: str) -> None:
        self._lines.write(Severity.INFO, text)

    def warning(self, text: str) -> None:
        self._lines.write(Severity.WARNING, text)

    def error(self, text: str) -> None:
        self._lines.write(Severity.ERROR, text)


def _json(_logger: object, _level: str, line: EventDict) -> str:
    return json_text(line)


def _line(_logger: object, _level: str, event: EventDict) -> EventDict:
    """Return the line of an entry with the bound context."""
    entry, _ = event.pop("entry"), event.pop("event")
    return line_of(entry, event)
