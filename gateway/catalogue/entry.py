"""The types of catalogue entries."""

import re
from collections.abc import Iterator, Mapping
from enum import Enum
from types import ModuleType
from typing import Final

from msgspec import Struct

NOTHING_TO_DO: Final = "nothing to do"


class Severity(Enum):
    """Severity of a log entry; the values are the levels of structlog."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class EventEntry(Struct, frozen=True):
    """An event: something that happened, as in the log and in all other reports."""

    name: str
    severity: Severity
    description: str
    """What it reports, as the end of a sentence, with the keys that it carries if they need a word."""
    cause: str
    """Usual cause."""
    remedy: str = NOTHING_TO_DO
    """What to do about it; begins with a verb."""
    also: Severity | None = None
    """The other possible severity; the code that reports the event decides."""


def _with_gaps(text: str) -> str:
    return re.sub(r"\{[^}]*\}", "…", text)


def entries_of(module: ModuleType) -> Iterator[EventEntry]:
    """Yield the events that a module of the catalogue defines, in the order of the file."""
    values: Mapping[str, object] = vars(module)
    for value in values.values():
        if isinstance(value, EventEntry):
            yield value


class AlarmEntry(Struct, frozen=True):
    """Something that is wrong now. Banner, terminal and alerts show it until it is right."""

    kind: str
    severity: Severity
    """``error``: positions do not pass, or pass uncorrected; ``warning``: they pass, but an operator should
    check."""
    description: str
    cause: str
    remedy: str
    """Begins with a verb, because the page begins its sentence with it; keys and commands have no capital
    letter."""
    title: str = ""
    """Two or three words, shown at an axis in place of its compensation."""
    cuts_off: bool = False
    """Commands do not reach some drive as long as it lasts."""


class RefusalEntry(Struct, frozen=True):
    """Why the gateway itself answers a request with an exception."""

    code: int
    begins: str
    """Beginning of its event's detail, with the names of its fields; empty: no event has it."""
    ends: str
    """Rest of the detail."""
    cause: str
    remedy: str

    @property
    def says(self) -> str:
        """Beginning of the detail, with … for each field."""
        return _with_gaps(self.begins)

    def sentence(self, **fields: object) -> str:
        """Return the whole detail."""
        return (self.begins + self.ends).format(**fields)


class ExceptionEntry(Struct, frozen=True):
    """A Modbus exception that a drive answers."""

    code: int
    title: str
    """Its name in the standard."""
    description: str
    cause: str
    remedy: str
    aliases: tuple[str, ...] = ()
    """Other names that programs and manuals have for it."""


class StartEntry(Struct, frozen=True):
    """Why a process does not start."""

    begins: str
    """Beginning of the sentence on standard error, with the names of its fields."""
    cause: str
    remedy: str
    description: str = "the gateway does not start"

    @property
    def says(self) -> str:
        """Beginning of the sentence, with … for each field."""
        return _with_gaps(self.begins)

    def begin(self, **fields: object) -> str:
        """Return the beginning of the sentence."""
        return self.begins.format(**fields)


class RemarkEntry(Struct, frozen=True):
    """A remark about a table, as ``check`` and ``table lint`` print its code."""

    code: str
    severity: str
    """In words: an error means that the table is not loaded; a refused file is not a table."""
    description: str
    remedy: str


class StateEntry(Struct, frozen=True):
    """A word of the status."""

    name: str
    description: str
    remedy: str = NOTHING_TO_DO
