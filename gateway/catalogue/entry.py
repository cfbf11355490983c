"""What an entry of the catalogue is made of."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from types import ModuleType
from typing import Final

NOTHING_TO_DO: Final = "nothing to do"


class Severity(Enum):
    """How loud a note is; the values are the levels of structlog."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class EventEntry:
    """An event: something that happened, as it stands in the log and in everything that is told of it."""

    name: str
    severity: Severity
    description: str
    """What it says, as the end of a sentence; with the keys that it carries where they need a word."""
    cause: str
    """What usually brings it about."""
    remedy: str = NOTHING_TO_DO
    """What to do about it; begins with a verb."""
    also: Severity | None = None
    """What else it may be: whoever tells of it knows."""


def _with_gaps(text: str) -> str:
    return re.sub(r"\{[^}]*\}", "…", text)


def entries_of(module: ModuleType) -> Iterator[EventEntry]:
    """Yield the events that a module of the catalogue defines, in the order of the file."""
    values: Mapping[str, object] = vars(module)
    for value in values.values():
        if isinstance(value, EventEntry):
            yield value


@dataclass(frozen=True, slots=True)
class AlarmEntry:
    """Something that is wrong now, as banner, terminal and alerts show it until it is right."""

    kind: str
    severity: Severity
    """``error``: positions do not pass, or not corrected; ``warning``: they do, and somebody should look."""
    description: str
    cause: str
    remedy: str
    """Begins with a verb: the page begins its sentence with it, and no key or command stands a capital."""
    title: str = ""
    """In two or three words, where an axis shows it in the place of its compensation."""
    cuts_off: bool = False
    """No command reaches some drive as long as it lasts."""


@dataclass(frozen=True, slots=True)
class RefusalEntry:
    """Why the gateway itself answers a request with an exception."""

    code: int
    begins: str
    """How the detail of its event begins, with the names of what is filled in; empty: no event has one."""
    ends: str
    """How it goes on."""
    cause: str
    remedy: str

    @property
    def says(self) -> str:
        """How the detail begins, … for what is filled in."""
        return _with_gaps(self.begins)

    def sentence(self, **fields: object) -> str:
        """Return the whole detail."""
        return (self.begins + self.ends).format(**fields)


@dataclass(frozen=True, slots=True)
class ExceptionEntry:
    """An exception of Modbus, as a drive answers it."""

    code: int
    title: str
    """As the standard names it."""
    description: str
    cause: str
    remedy: str
    aliases: tuple[str, ...] = ()
    """Other names that programs and manuals have for it."""


@dataclass(frozen=True, slots=True)
class StartEntry:
    """Why a process does not start."""

    begins: str
    """How the sentence on standard error begins, with the names of what is filled in."""
    cause: str
    remedy: str
    description: str = "the gateway does not start"

    @property
    def says(self) -> str:
        """How the sentence begins, … for what is filled in."""
        return _with_gaps(self.begins)

    def begin(self, **fields: object) -> str:
        """Return how the sentence begins."""
        return self.begins.format(**fields)


@dataclass(frozen=True, slots=True)
class RemarkEntry:
    """A remark about a table, as ``check`` and ``table lint`` print its code."""

    code: str
    severity: str
    """In words: an error keeps the table from being loaded, and what is refused is no table."""
    description: str
    remedy: str


@dataclass(frozen=True, slots=True)
class StateEntry:
    """A word of the status."""

    name: str
    description: str
    remedy: str = NOTHING_TO_DO
