"""What a process says in its log: JSON for services, colours on a terminal. Standard error, both.

Where standard error goes to the journal, each line begins with its priority (sd-daemon(3)).
"""

import contextlib
import io
import json
import os
import select
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import Enum
from types import TracebackType
from typing import Final, TextIO

from gateway.catalogue.entry import EventEntry, Severity
from gateway.catalogue.process_events import CONFIGURATION_WARNING, STANDARD_ERROR, UNEXPECTED

PRIORITIES: Final = {Severity.ERROR: 3, Severity.WARNING: 4, Severity.INFO: 6}
"""LOG_ERR, LOG_WARNING and LOG_INFO of syslog(3)."""
WARNING: Final = "warning: "
"""How a text for people begins that is no error."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One thing that happened; ``wall_s`` is the time of day (``time.time``)."""

    severity: Severity
    event: str
    fields: Mapping[str, object] = field(default_factory=dict)
    wall_s: float = 0.0


def log_entry(
    entry: EventEntry, fields: Mapping[str, object], wall_s: float, severity: Severity | None = None
) -> LogEntry:
    """Return a note of an event of the catalogue; ``severity`` where the catalogue leaves it open."""
    return LogEntry(severity or entry.severity, entry.name, fields, wall_s)


class LogFormat(Enum):
    """``auto`` is ``console`` where standard error is a terminal, else ``json``."""

    AUTO = "auto"
    JSON = "json"
    CONSOLE = "console"


def log_writer(log_format: LogFormat) -> Callable[[LogEntry], None]:
    """Set logging up for this process; returns the function that writes a note.

    It blocks while the reader of standard error stalls: for ``log_thread.LogThread``.
    """
    if sys.stderr is None:  # closed at the start: its number may be that of a socket by now
        return _write_nothing
    text_of = _json_text if _is_json(log_format) else _console_text()
    log_fd = sys.stderr.fileno()
    marks = _marks(sys.stderr)

    def write(entry: LogEntry) -> None:
        text = _marked(text_of(entry), marks[entry.severity])
        # A full disk or a reader that has gone must not stop an axis: there is nowhere to say so.
        with contextlib.suppress(OSError):
            _write_all(log_fd, text.encode(errors="backslashreplace"))

    return write


def take_standard_error(log_format: LogFormat = LogFormat.CONSOLE) -> None:
    """Give what this process writes to ``sys.stderr`` as text the form of its log, line by line.

    Where the log is JSON each line becomes a note, and so does an exception that nobody catches; where it
    goes to the journal each line gets a priority. Anywhere else the text stays as it is.
    """
    if sys.stderr is None:
        return
    is_json = _is_json(log_format)
    marks = _marks(sys.stderr)
    if is_json:
        sys.excepthook = _hook(log_writer(log_format))
    if is_json or any(marks.values()):
        sys.stderr = _Lines(sys.stderr, marks, is_json=is_json)


class _Lines(io.TextIOBase):
    """A stream that passes on whole lines only, each in the form of the log."""

    def __init__(self, stream: TextIO, marks: Mapping[Severity, str], *, is_json: bool) -> None:
        self._stream = stream
        self._marks = marks
        self._is_json = is_json
        self._begun = ""

    @property
    def encoding(self) -> str:  # type: ignore[override] # io.TextIOBase has an attribute
        return self._stream.encoding

    @property
    def errors(self) -> str | None:  # type: ignore[override]
        return self._stream.errors

    def fileno(self) -> int:
        return self._stream.fileno()

    def isatty(self) -> bool:
        return self._stream.isatty()

    def writable(self) -> bool:
        return True

    def write(self, text: str, /) -> int:
        *whole, self._begun = (self._begun + text).split("\n")
        for line in whole:
            self._pass_on(line)
        return len(text)

    def flush(self) -> None:
        """Pass on what was begun as a line of its own: nobody knows whether more comes."""
        if self._begun:
            line, self._begun = self._begun, ""
            self._pass_on(line)
        self._stream.flush()

    def _pass_on(self, line: str) -> None:
        event = CONFIGURATION_WARNING if line.startswith(WARNING) else STANDARD_ERROR
        if self._is_json:
            line = _json_text(log_entry(event, {"detail": line.removeprefix(WARNING)}, time.time()))
        self._stream.write(_marked(line, self._marks[event.severity]))


def _hook(
    write: Callable[[LogEntry], None],
) -> Callable[[type[BaseException], BaseException, TracebackType | None], None]:
    """Return what makes one note of an exception that ends the process."""

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        where = "".join(traceback.format_exception(kind, error, trace))
        write(log_entry(UNEXPECTED, {"detail": f"{kind.__name__}: {error}", "traceback": where}, time.time()))

    return hook


def _is_json(log_format: LogFormat) -> bool:
    return log_format is LogFormat.JSON or (log_format is LogFormat.AUTO and not sys.stderr.isatty())


def _marks(log: TextIO) -> Mapping[Severity, str]:
    """Return what a line of each severity begins with: nothing unless the log goes to the journal.

    ``JOURNAL_STREAM`` names the stream of the journal by device and inode, systemd.exec(5): whoever has
    redirected standard error inherits the variable, and not the stream.
    """
    is_journal = False
    with contextlib.suppress(OSError):  # a stream without a descriptor
        stream = os.fstat(log.fileno())
        is_journal = os.environ.get("JOURNAL_STREAM") == f"{stream.st_dev}:{stream.st_ino}"
    return {severity: f"<{priority}>" if is_journal else "" for severity, priority in PRIORITIES.items()}


def _marked(text: str, mark: str) -> str:
    r"""Return whole lines, each with the mark: the journal makes an entry of each.

    >>> _marked("one\ntwo", "<3>")
    '<3>one\n<3>two\n'
    """
    return "".join(f"{mark}{line}\n" for line in text.split("\n"))


def _write_nothing(entry: LogEntry) -> None:
    pass


def _write_all(log_fd: int, text: bytes) -> None:
    """Write lines past ``sys.stderr``, with one call: other processes write into the same log."""
    rest = memoryview(text)
    while rest:
        try:
            rest = rest[os.write(log_fd, rest) :]
        except BlockingIOError:  # whoever shares it made it non-blocking
            select.select((), (log_fd,), ())


def _json_text(entry: LogEntry) -> str:
    """Return one line. Without structlog, which brings 4 MB along that a service has no use for."""
    return json.dumps(_line_of(entry), default=repr)


def _console_text() -> Callable[[LogEntry], str]:
    import structlog

    render = structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty(), sort_keys=False)
    return lambda entry: render(None, entry.severity.value, _line_of(entry))


def _line_of(entry: LogEntry) -> dict[str, object]:
    return {
        **entry.fields,
        "timestamp": _timestamp(entry),
        "event": entry.event,
        "level": entry.severity.value,
    }


def _timestamp(entry: LogEntry) -> str:
    return datetime.fromtimestamp(entry.wall_s, UTC).isoformat(timespec="milliseconds")
