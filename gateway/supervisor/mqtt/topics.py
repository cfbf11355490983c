"""Where everything is published: the topics of one gateway, under ``BASE/NAME/``."""

import re
from dataclasses import dataclass
from typing import Final

COMMANDS: Final = ("reload", "enable", "disable", "switch", "gain")

_NOT_IN_AN_ID: Final = re.compile(r"[^A-Za-z0-9_-]")


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of the gateway ``name``."""

    base: str
    name: str

    @property
    def root(self) -> str:
        """What all of them begin with; no slash at its end."""
        return f"{self.base}/{self.name}"

    @property
    def availability(self) -> str:
        """``online`` or ``offline``; retained."""
        return f"{self.root}/availability"

    @property
    def info(self) -> str:
        """What the gateway has and what is wrong; retained."""
        return f"{self.root}/info"

    @property
    def event(self) -> str:
        """What happens, as it happens."""
        return f"{self.root}/event"

    def line(self, line: str) -> str:
        """One line, every interval."""
        return f"{self.root}/line/{line}"

    def axis(self, axis: str) -> str:
        """One axis, every interval."""
        return f"{self.root}/axis/{axis}"

    def table(self, axis: str) -> str:
        """The table of an axis; retained."""
        return f"{self.root}/axis/{axis}/table"

    @property
    def commands(self) -> str:
        """Filter of everything that may be commanded."""
        return f"{self.root}/command/+"

    def command(self, command: str) -> str:
        """One of ``COMMANDS``."""
        return f"{self.root}/command/{command}"

    def command_in(self, topic: str) -> str:
        """Return which command a topic that :attr:`commands` matches is."""
        return topic.rpartition("/")[2]

    @property
    def id(self) -> str:
        """An identifier of the gateway in letters, digits, ``-`` and ``_``."""
        return f"{_NOT_IN_AN_ID.sub('_', self.base)}_{self.name}"
