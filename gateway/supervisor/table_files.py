"""The state of each axis's table file, beside what the relay reports of the table."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from msgspec.structs import replace

from gateway.config.problems import Problem
from gateway.status.axis import ProblemStatus, TableStatus
from gateway.supervisor.outcome import ReloadOutcome


class FileState(Enum):
    """The state of a table file; the value is what the status shows."""

    GOOD = "active"
    """It is the table in force."""
    WAITING = "waiting"
    """It changes, has been gone for a few seconds, or could not be applied: another table is in force."""
    REJECTED = "rejected"
    """It is invalid, or its group prevents its use; the axis keeps its table."""
    REMOVED = "removed"
    """It is gone or was renamed to ``.bak``; the axis is not corrected."""


@dataclass(frozen=True, slots=True)
class TableFileEntry:
    """One axis's table file."""

    file: str
    state: FileState
    problems: tuple[Problem, ...] = ()
    is_overdue: bool = False
    """It has been waiting for very long."""
    digest: str = ""
    """SHA-256 of a good file."""
    is_doubtful: bool = False
    """Something could not be applied, maybe this file: the relay's report shows it."""

    def over(self, table: TableStatus) -> TableStatus:
        """Return the relay's status of a table, with the state of its file."""
        return replace(
            table,
            file=self.file,
            status=self._state_beside(table).value,
            is_overdue=self.is_overdue,
            error=str(self.problems[0]) if self.problems else None,
            problems=[ProblemStatus(**problem.as_dict()) for problem in self.problems],
        )

    def _state_beside(self, table: TableStatus) -> FileState:
        """Return the state of the file, given the table that the relay has.

        A full disk or a relay that refuses a table can keep a good file out of force, and the table of a
        removed file in force.
        """
        is_another = {
            FileState.GOOD: table.sha256 != self.digest,
            FileState.REMOVED: table.points > 0,
        }
        return FileState.WAITING if self.is_doubtful and is_another.get(self.state) else self.state


class TableFiles:
    """The table files of all axes, as last read."""

    def __init__(self) -> None:
        self._entries: dict[str, TableFileEntry] = {}

    def enter(self, names: Mapping[str, str], outcome: ReloadOutcome) -> None:
        """Take over the result of reading the files; ``names`` are those of the tables, by axis."""
        self._entries = {axis: self._entry(axis, name, outcome) for axis, name in names.items()}

    def _entry(self, axis: str, name: str, outcome: ReloadOutcome) -> TableFileEntry:
        if axis in outcome.waiting:
            before = self._entries.get(axis)
            return TableFileEntry(name, FileState.WAITING, before.problems if before else ())
        if axis in outcome.rejected:
            return TableFileEntry(name, FileState.REJECTED, outcome.rejected[axis])
        held = outcome.held.get(axis, ())
        if axis in outcome.absent:
            return TableFileEntry(name, FileState.REMOVED, held, is_doubtful=bool(outcome.problems))
        if held:
            return TableFileEntry(name, FileState.REJECTED, held)
        digest = outcome.digests.get(axis, "")
        return TableFileEntry(name, FileState.GOOD, digest=digest, is_doubtful=bool(outcome.problems))

    def entries(
        self, moving: frozenset[str], overdue: frozenset[str] = frozenset()
    ) -> dict[str, TableFileEntry]:
        """Return all entries as of now.

        ``moving`` are axes whose file has changed since, ``overdue`` those of them that have waited for very
        long.
        """
        return {
            axis: TableFileEntry(entry.file, FileState.WAITING, entry.problems, axis in overdue)
            if axis in moving
            else entry
            for axis, entry in self._entries.items()
        }
