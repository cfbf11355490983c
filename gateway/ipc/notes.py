"""What a process says in its log: JSON for services, colours on a terminal. Standard error, both."""

import contextlib
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import Enum


class Severity(Enum):
    """How loud a note is; the values are the method names of a structlog logger."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Note:
    """One thing that happened; ``wall_s`` is the time of day (``time.time``)."""

    severity: Severity
    event: str
    fields: Mapping[str, object] = field(default_factory=dict)
    wall_s: float = 0.0


class LogFormat(Enum):
    """``auto`` is ``console`` where standard error is a terminal, else ``json``."""

    AUTO = "auto"
    JSON = "json"
    CONSOLE = "console"


def note_writer(log_format: LogFormat) -> Callable[[Note], None]:
    """Set logging up for this process; returns the function that writes a note."""
    if log_format is LogFormat.CONSOLE or (log_format is LogFormat.AUTO and sys.stderr.isatty()):
        return _console_writer()
    return _write_json


def _write_json(note: Note) -> None:
    """Write one line. Without structlog, which brings 4 MB along that a service has no use for."""
    line = {
        **note.fields,
        "timestamp": _timestamp(note),
        "event": note.event,
        "level": note.severity.value,
    }
    # A full disk or a reader that has gone must not stop an axis: there is nowhere to say so.
    with contextlib.suppress(OSError):
        # One write a line: other processes write into the same log.
        sys.stderr.write(json.dumps(line, default=repr) + "\n")
        sys.stderr.flush()


def _console_writer() -> Callable[[Note], None]:
    import structlog

    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty(), sort_keys=False),
        ],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=True,
    )
    logger = structlog.get_logger()

    def write(note: Note) -> None:
        with contextlib.suppress(OSError):
            getattr(logger, note.severity.value)(note.event, timestamp=_timestamp(note), **note.fields)

    return write


def _timestamp(note: Note) -> str:
    return datetime.fromtimestamp(note.wall_s, UTC).isoformat(timespec="milliseconds")
