"""What a process says in its log: JSON for services, colours on a terminal. Standard error, both."""

import contextlib
import json
import os
import select
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import Enum

from gateway.catalogue.entry import EventEntry, Severity


@dataclass(frozen=True, slots=True)
class Note:
    """One thing that happened; ``wall_s`` is the time of day (``time.time``)."""

    severity: Severity
    event: str
    fields: Mapping[str, object] = field(default_factory=dict)
    wall_s: float = 0.0


def note_of(
    entry: EventEntry, fields: Mapping[str, object], wall_s: float, severity: Severity | None = None
) -> Note:
    """Return a note of an event of the catalogue; ``severity`` where the catalogue leaves it open."""
    return Note(severity or entry.severity, entry.name, fields, wall_s)


class LogFormat(Enum):
    """``auto`` is ``console`` where standard error is a terminal, else ``json``."""

    AUTO = "auto"
    JSON = "json"
    CONSOLE = "console"


def note_writer(log_format: LogFormat) -> Callable[[Note], None]:
    """Set logging up for this process; returns the function that writes a note.

    It blocks while the reader of standard error stalls: for ``log_thread.LogThread``.
    """
    if sys.stderr is None:  # closed at the start: its number may be that of a socket by now
        return _write_nothing
    is_console = log_format is LogFormat.CONSOLE or (log_format is LogFormat.AUTO and sys.stderr.isatty())
    text_of = _console_text() if is_console else _json_text
    log_fd = sys.stderr.fileno()

    def write(note: Note) -> None:
        # A full disk or a reader that has gone must not stop an axis: there is nowhere to say so.
        with contextlib.suppress(OSError):
            _write_all(log_fd, f"{text_of(note)}\n".encode(errors="backslashreplace"))

    return write


def _write_nothing(note: Note) -> None:
    pass


def _write_all(log_fd: int, line: bytes) -> None:
    """Write a line past ``sys.stderr``, with one call: other processes write into the same log."""
    rest = memoryview(line)
    while rest:
        try:
            rest = rest[os.write(log_fd, rest) :]
        except BlockingIOError:  # whoever shares it made it non-blocking
            select.select((), (log_fd,), ())


def _json_text(note: Note) -> str:
    """Return one line. Without structlog, which brings 4 MB along that a service has no use for."""
    return json.dumps(_line_of(note), default=repr)


def _console_text() -> Callable[[Note], str]:
    import structlog

    render = structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty(), sort_keys=False)
    return lambda note: render(None, note.severity.value, _line_of(note))


def _line_of(note: Note) -> dict[str, object]:
    return {
        **note.fields,
        "timestamp": _timestamp(note),
        "event": note.event,
        "level": note.severity.value,
    }


def _timestamp(note: Note) -> str:
    return datetime.fromtimestamp(note.wall_s, UTC).isoformat(timespec="milliseconds")
