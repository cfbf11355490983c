"""The log of supervisor and commands: its lines, and the gateway's name in each.

Lines for people are structlog's. Lines of JSON do without it: to load it takes a tenth of the start of a
supervisor.
"""

from collections.abc import Callable, Mapping
from typing import Final

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
        self._text: Final = json_text if self._is_json else _for_people()
        self._lines: Final = LogLines()
        self._context: dict[str, object] = {}

    def name_gateway(self, gateway: str) -> None:
        """Add the gateway's name to every later line, also to what this process writes to ``sys.stderr``.

        Not on a terminal, which shows one gateway only.
        """
        name_standard_error(gateway)
        if self._is_json:
            self._context = {"gateway": gateway}

    def write(self, entry: LogEntry) -> None:
        """Write one entry; its fields name its line and axis."""
        self._lines.write(entry.severity, self._text(line_of(entry, self._context)))


def _for_people() -> Callable[[Mapping[str, object]], str]:
    """Return what makes a line for people, in colours on a terminal."""
    from structlog.dev import ConsoleRenderer

    render = ConsoleRenderer(colors=is_terminal(), sort_keys=False)
    return lambda line: render(None, "", dict(line))
