"""What a process says in its log, on standard error: notes, their form, and the relay's writer of JSON.

Supervisor and commands write with ``ipc.structured_log``. Where standard error goes to the journal, each line
begins with its priority (sd-daemon(3)).
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

    @property
    def is_json(self) -> bool:
        """Whether this process writes JSON."""
        return self is LogFormat.JSON or (self is LogFormat.AUTO and not is_terminal())


def is_terminal() -> bool:
    """Return whether a person sees standard error."""
    return sys.stderr is not None and sys.stderr.isatty()


class LogLines:
    """Standard error, past ``sys.stderr``.

    It blocks while its reader stalls: for ``log_thread.LogThread``.
    """

    def __init__(self) -> None:
        # Closed at the start: its number may be that of a socket by now.
        self._fd = -1 if sys.stderr is None else sys.stderr.fileno()
        self._marks = {} if sys.stderr is None else _marks(sys.stderr)

    def write(self, severity: Severity, text: str) -> None:
        """Write whole lines."""
        if self._fd >= 0:
            # A full disk or a reader that has gone must not stop an axis: there is nowhere to say so.
            with contextlib.suppress(OSError):
                _write_all(self._fd, _marked(text, self._marks[severity]).encode(errors="backslashreplace"))


def json_writer(gateway: str) -> Callable[[LogEntry], None]:
    """Return what writes a note of this gateway as a line of JSON; it may block, as :class:`LogLines` does.

    As ``structured_log`` does it, without structlog: with it the relay takes a fifth more memory.
    """
    return _json_writer({"gateway": gateway})


def _json_writer(context: Mapping[str, object]) -> Callable[[LogEntry], None]:
    lines = LogLines()
    return lambda entry: lines.write(entry.severity, _json_text(entry, context))


def take_standard_error(log_format: LogFormat = LogFormat.CONSOLE) -> None:
    """Give what this process writes to ``sys.stderr`` as text the form of its log, line by line.

    Where the log is JSON each line becomes a note, and so does an exception that nobody catches; where it
    goes to the journal each line gets a priority. Anywhere else the text stays as it is.
    """
    if sys.stderr is None:
        return
    is_json = log_format.is_json
    marks = _marks(sys.stderr)
    if is_json:
        sys.excepthook = _hook(_json_writer({}))
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
            line = _json_text(log_entry(event, {"detail": line.removeprefix(WARNING)}, time.time()), {})
        self._stream.write(_marked(line, self._marks[event.severity]))


def _hook(
    write: Callable[[LogEntry], None],
) -> Callable[[type[BaseException], BaseException, TracebackType | None], None]:
    """Return what makes one note of an exception that ends the process."""

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        where = "".join(traceback.format_exception(kind, error, trace))
        write(log_entry(UNEXPECTED, {"detail": f"{kind.__name__}: {error}", "traceback": where}, time.time()))

    return hook


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


def _write_all(log_fd: int, text: bytes) -> None:
    """Write lines past ``sys.stderr``, with one call: other processes write into the same log."""
    rest = memoryview(text)
    while rest:
        try:
            rest = rest[os.write(log_fd, rest) :]
        except BlockingIOError:  # whoever shares it made it non-blocking
            select.select((), (log_fd,), ())


def line_of(entry: LogEntry, context: Mapping[str, object]) -> dict[str, object]:
    """Return what a line of the log says, in its order."""
    return {
        **context,
        **entry.fields,
        "timestamp": datetime.fromtimestamp(entry.wall_s, UTC).isoformat(timespec="milliseconds"),
        "event": entry.event,
        "level": entry.severity.value,
    }


def _json_text(entry: LogEntry, context: Mapping[str, object]) -> str:
    return json.dumps(line_of(entry, context), default=repr)
