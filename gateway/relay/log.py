"""What the relay writes into its log: JSON for services, colours on a terminal. Standard error, both."""

import contextlib
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from enum import Enum

from gateway.relay.journal import Note


class LogFormat(Enum):
    """``auto`` is ``console`` where standard error is a terminal, else ``json``."""

    AUTO = "auto"
    JSON = "json"
    CONSOLE = "console"


def note_writer(log_format: LogFormat) -> Callable[[Note], None]:
    """Set logging up for this process; returns the function that writes a note."""
    import structlog

    is_console = log_format is LogFormat.CONSOLE or (log_format is LogFormat.AUTO and sys.stderr.isatty())
    render: structlog.typing.Processor = (
        structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty(), sort_keys=False)
        if is_console
        else structlog.processors.JSONRenderer()
    )
    structlog.configure(
        processors=[structlog.processors.add_log_level, render],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=True,
    )
    logger = structlog.get_logger()

    def write(note: Note) -> None:
        timestamp = datetime.fromtimestamp(note.wall_s, UTC).isoformat(timespec="milliseconds")
        # A full disk or a reader that has gone must not stop an axis: there is nowhere to say so.
        with contextlib.suppress(OSError):
            getattr(logger, note.severity.value)(note.event, timestamp=timestamp, **note.fields)

    return write
