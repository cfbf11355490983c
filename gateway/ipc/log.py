"""The log of a process on standard error: entries, their format, and a writer of JSON.

Several processes write into one log. A pipe keeps a line in one piece if it is written at once and has at
most ``PIPE_BUF`` bytes (pipe(7)). So longer lines are shortened, and say how long they were.

``ipc.structured_log`` has the lines for people, and a log that learns its gateway's name later. If standard
error goes to the journal, each line begins with its priority (sd-daemon(3)).
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
from math import isfinite
from types import TracebackType
from typing import Final, TextIO

from gateway.catalogue.entry import EventEntry, Severity
from gateway.catalogue.process_events import CONFIGURATION_WARNING, STANDARD_ERROR, UNEXPECTED

PRIORITIES: Final = {Severity.ERROR: 3, Severity.WARNING: 4, Severity.INFO: 6}
"""LOG_ERR, LOG_WARNING and LOG_INFO of syslog(3)."""
LONGEST: Final = select.PIPE_BUF - len("<6>\n")
"""Bytes of a line, without its priority and its end."""
SHORTEST_FIELD: Final = 40
"""No field of a line in JSON is shortened below this number of characters; then it is left out."""
WARNING: Final = "warning: "
"""The beginning of a text for people that is no error."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One event; ``wall_s`` is the time of day (``time.time``)."""

    severity: Severity
    event: str
    fields: Mapping[str, object] = field(default_factory=dict)
    wall_s: float = 0.0


def log_entry(
    entry: EventEntry, fields: Mapping[str, object], wall_s: float, severity: Severity | None = None
) -> LogEntry:
    """Return a log entry of an event of the catalogue; ``severity`` if the catalogue leaves it open."""
    return LogEntry(severity or entry.severity, entry.name, fields, wall_s)


class LogFormat(Enum):
    """``auto`` is ``console`` if standard error is a terminal, else ``json``."""

    AUTO = "auto"
    JSON = "json"
    CONSOLE = "console"

    @property
    def is_json(self) -> bool:
        """Whether this process writes JSON."""
        return self is LogFormat.JSON or (self is LogFormat.AUTO and not is_terminal())


def is_terminal() -> bool:
    """Return whether standard error is a terminal."""
    return sys.stderr is not None and sys.stderr.isatty()


class LogLines:
    """Standard error, without ``sys.stderr``.

    It blocks while its reader stalls: for ``log_thread.LogThread``.
    """

    def __init__(self) -> None:
        # If it was closed at the start, its number may be that of a socket by now.
        self._fd = -1 if sys.stderr is None else sys.stderr.fileno()
        self._marks = {} if sys.stderr is None else _marks(sys.stderr)

    def write(self, severity: Severity, text: str) -> None:
        """Write whole lines, each with one call; one that is too long for that is cut."""
        if self._fd >= 0:
            # A full disk or a closed reader must not stop an axis, and there is no other output for the
            # error.
            with contextlib.suppress(OSError):
                for line in text.split("\n"):
                    marked = _marked(line, self._marks[severity])
                    _write_all(self._fd, marked.encode(errors="backslashreplace"))


def json_writer(gateway: str) -> Callable[[LogEntry], None]:
    """Return a function that writes an entry of this gateway as JSON; it may block (:class:`LogLines`).

    ``structured_log`` writes the same lines.
    """
    name_standard_error(gateway)
    return _json_writer({"gateway": gateway})


def _json_writer(context: Mapping[str, object]) -> Callable[[LogEntry], None]:
    lines = LogLines()
    return lambda entry: lines.write(entry.severity, json_text(line_of(entry, context)))


def take_standard_error(log_format: LogFormat = LogFormat.CONSOLE) -> None:
    """Format what this process writes to ``sys.stderr`` as lines of its log.

    In a JSON log each line becomes an entry, and so does an uncaught exception. In the journal each line gets
    a priority. Otherwise the text stays as it is.
    """
    if sys.stderr is None:
        return
    is_json = log_format.is_json
    marks = _marks(sys.stderr)
    if is_json or any(marks.values()):
        sys.stderr = lines = _Lines(sys.stderr, marks, is_json=is_json)
        if is_json:
            sys.excepthook = _hook(_json_writer(lines.context))


def name_standard_error(gateway: str) -> None:
    """Add the gateway's name to what this process writes to ``sys.stderr`` from now on, if that is JSON."""
    if isinstance(sys.stderr, _Lines):
        sys.stderr.context["gateway"] = gateway


class _Lines(io.TextIOBase):
    """A stream that passes on whole lines only, each in the format of the log."""

    def __init__(self, stream: TextIO, marks: Mapping[Severity, str], *, is_json: bool) -> None:
        self._stream = stream
        self._marks = marks
        self._is_json = is_json
        self._begun = ""
        self.context: Final[dict[str, object]] = {}
        """Fields at the beginning of each line of JSON."""

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
        """Pass on an incomplete line: the rest may never come."""
        if self._begun:
            line, self._begun = self._begun, ""
            self._pass_on(line)
        self._stream.flush()

    def _pass_on(self, line: str) -> None:
        event = CONFIGURATION_WARNING if line.startswith(WARNING) else STANDARD_ERROR
        if self._is_json:
            entry = log_entry(event, {"detail": line.removeprefix(WARNING)}, time.time())
            line = json_text(line_of(entry, self.context))
        self._stream.write(_marked(line, self._marks[event.severity]))


def _hook(
    write: Callable[[LogEntry], None],
) -> Callable[[type[BaseException], BaseException, TracebackType | None], None]:
    """Return a function that makes one log entry of an exception that ends the process."""

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        where = "".join(traceback.format_exception(kind, error, trace))
        write(log_entry(UNEXPECTED, {"detail": f"{kind.__name__}: {error}", "traceback": where}, time.time()))

    return hook


def _marks(log: TextIO) -> Mapping[Severity, str]:
    """Return the prefix of a line of each severity: empty unless the log goes to the journal.

    ``JOURNAL_STREAM`` names the stream of the journal by device and inode, systemd.exec(5). The check is
    necessary: a process whose standard error is redirected still inherits the variable.
    """
    is_journal = False
    with contextlib.suppress(OSError):  # a stream without a descriptor
        stream = os.fstat(log.fileno())
        is_journal = os.environ.get("JOURNAL_STREAM") == f"{stream.st_dev}:{stream.st_ino}"
    return {severity: f"<{priority}>" if is_journal else "" for severity, priority in PRIORITIES.items()}


def _marked(text: str, mark: str) -> str:
    r"""Return whole lines, each with the prefix: the journal makes an entry of each.

    >>> _marked("one\ntwo", "<3>")
    '<3>one\n<3>two\n'
    """
    return "".join(f"{mark}{_cut(line)}\n" for line in text.split("\n"))


def _cut(line: str) -> str:
    """Return a line of at most :data:`LONGEST` bytes."""
    data = line.encode(errors="backslashreplace")
    if len(data) <= LONGEST:
        return line
    end = f"… ({len(data)} bytes)"
    return data[: LONGEST - len(end.encode())].decode(errors="ignore") + end


def _write_all(log_fd: int, text: bytes) -> None:
    """Write lines with one call, without ``sys.stderr``: other processes write into the same log."""
    rest = memoryview(text)
    while rest:
        try:
            rest = rest[os.write(log_fd, rest) :]
        except BlockingIOError:  # another process made it non-blocking
            select.select((), (log_fd,), ())


def line_of(entry: LogEntry, context: Mapping[str, object]) -> dict[str, object]:
    """Return the fields of a log line, in their order."""
    return {
        **context,
        **entry.fields,
        "timestamp": datetime.fromtimestamp(entry.wall_s, UTC).isoformat(timespec="milliseconds"),
        "event": entry.event,
        "level": entry.severity.value,
    }


def json_text(line: Mapping[str, object]) -> str:
    """Return a line in JSON, of at most :data:`LONGEST` bytes: its longest fields lose their middle.

    A number that is not finite becomes null.
    """
    text, short = _dumps(line), dict(line)
    kept: dict[str, int] = {}
    while len(text) > LONGEST:
        name = max(short, key=lambda each: len(_dumps({each: short[each]})))
        value = line[name]
        whole = value if isinstance(value, str) else _dumps(value)
        before = kept.get(name, len(whole))
        if before <= SHORTEST_FIELD:
            del short[name]
        else:
            # A character can be six bytes of JSON.
            excess = (len(text) - LONGEST) * len(whole) // len(_dumps(whole))
            half = max(SHORTEST_FIELD, before - excess - SHORTEST_FIELD) // 2
            kept[name] = 2 * half
            short[name] = f"{whole[:half]} … ({len(whole)} characters) … {whole[-half:]}"
        text = _dumps(short)
    return text


def _dumps(value: object) -> str:
    """Return JSON in ASCII."""
    try:
        return json.dumps(value, default=repr, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(value), default=repr)


def _finite(value: object) -> object:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(each) for key, each in value.items()}
    return [_finite(each) for each in value] if isinstance(value, list | tuple) else value
