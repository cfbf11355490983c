"""The result of bringing tables up to date."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.config.problems import Problem
from gateway.exchange.commands import Command
from gateway.supervisor.debounce import FileStamp


@dataclass(frozen=True, slots=True)
class ReloadOutcome:
    """What has changed, what stays as it was, and why."""

    comes: Mapping[str, str] = field(default_factory=dict)
    """How the new correction of an axis comes into force, or how the old one goes; only axes with a
    change."""
    gone: tuple[str, ...] = ()
    """Axes whose table was removed: its file is gone, or the configuration names none."""
    given: tuple[tuple[Command, tuple[str, ...]], ...] = ()
    """The commands that changed something in the relay, each with the axes that changed."""
    changed: tuple[str, ...] = ()
    """Keys of the configuration whose new values are in force."""
    problems: tuple[str, ...] = ()
    """Why nothing, or not everything, was changed; each with what to do."""
    rejected: Mapping[str, tuple[Problem, ...]] = field(default_factory=dict)
    """What is wrong with the table files of axes. The tables in force stay."""
    held: Mapping[str, tuple[Problem, ...]] = field(default_factory=dict)
    """Axes whose valid file is not in force because of another axis of their group; with the reason."""
    digests: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the valid file of each axis that has one."""
    absent: frozenset[str] = frozenset()
    """Axes without correction: their table file, or that of another axis of their group, is missing."""
    waiting: frozenset[str] = frozenset()
    """Axes whose table file is being written and does not count yet."""
    saving: tuple[str, ...] = ()
    """What is not taken yet because its file is being written, or may be; each with what to do."""
    stamps: Mapping[str, FileStamp] = field(default_factory=dict)
    """Stamp of each file that was read, by its name: the same before and after reading."""
    has_read: bool = True
    """Whether the table files were examined, so that the results here are valid."""
    is_owed: bool = False
    """Whether the configuration could not be applied for a temporary reason, such as a full disk."""
    is_refused: bool = False
    """Whether the configuration in its file was refused: the previous one stays."""
    is_running: bool = True
    """Whether a relay was running. If not, its next start takes the new tables from the state folder."""

    @property
    def all_problems(self) -> tuple[str, ...]:
        """Everything that is wrong, a line each."""
        held = (problems for axis, problems in self.held.items() if axis not in self.absent)
        found = (*self.rejected.values(), *held)
        of_tables = (str(problem) for problems in found for problem in problems)
        return (*self.problems, *dict.fromkeys(of_tables), *self.saving)

    def as_data(self) -> dict[str, Any]:
        """Return plain data, with :attr:`all_problems`."""
        return {
            "comes": dict(self.comes),
            "gone": list(self.gone),
            "changed": list(self.changed),
            "problems": list(self.problems),
            "rejected": {
                axis: [problem.as_dict() for problem in problems] for axis, problems in self.rejected.items()
            },
            "all_problems": list(self.all_problems),
            "is_running": self.is_running,
        }
