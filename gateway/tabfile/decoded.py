"""The result of a reader, remarks about it, and the checked table."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import inf
from typing import Final, NamedTuple

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.plain import JsonObject
from gateway.tabfile.options import FileContext


class LintSeverity(Enum):
    """``error``: the gateway does not load the table. ``info``: no action is needed."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


class Lint(Struct, frozen=True):
    """One remark. ``code`` never changes its meaning; ``message`` says what to do."""

    code: str
    severity: LintSeverity
    message: str
    line: int | None = None

    def line_in(self, file: str) -> str:
        """Return one line about a file: path, severity, code, message."""
        location = file if self.line is None else f"{file}:{self.line}"
        return f"{location}: {self.severity.value} {self.code} {self.message}"

    def as_data(self) -> JsonObject:
        """Return the remark as plain data."""
        return {
            "code": self.code,
            "severity": self.severity.value,
            "message": self.message,
            "line": self.line,
        }


class SourceRow(NamedTuple):
    """One point: position and corrections in machine units, and the numbers as the file has them.

    A line is None where the file does not list the point (home of a version 1 file).
    """

    position: float
    forward: float
    backward: float
    forward_value: float
    backward_value: float
    forward_line: int | None
    backward_line: int | None


@dataclass(frozen=True, slots=True)
class Decoded:
    """A file read by its dialect, all decisions made.

    ``rows`` ascend; ``context`` is in ``units``; ``value_unit`` is the unit of the file's own numbers.
    ``forward_rule`` and ``backward_rule`` give the source and the sign of each correction. ``plausible``
    bounds the largest |value| of a sound file, in ``value_unit``. ``decisions`` are the answers to what the
    file leaves open; ``remarks`` name what was assumed. ``behaves_as`` holds settings of the axis, each a
    line of its configuration. With them the gateway behaves as the file's control outside the table and at a
    reversal. ``are_positions``: the values are positions of the nut, not corrections, so their size does not
    indicate their unit. ``file_axis`` is the file's own name for this axis. ``modulo`` is the length after
    which the table repeats, in ``units``, None if it does not.
    """

    rows: tuple[SourceRow, ...]
    units: Units
    context: FileContext
    value_unit: str
    forward_rule: str
    backward_rule: str
    axis: str | None = None
    comment_axis: str | None = None
    plausible: tuple[float, float] = (0.0, inf)
    decisions: tuple[str, ...] = ()
    remarks: tuple[Lint, ...] = ()
    behaves_as: tuple[str, ...] = ()
    are_positions: bool = False
    file_axis: str | None = None
    modulo: float | None = None


@dataclass(frozen=True, slots=True)
class LoadedTable:
    """A file with its table, in the machine units of the file, and all information about it."""

    file: str
    format: str
    sha256: str
    table: CorrectionTable
    source: Decoded
    lints: tuple[Lint, ...]

    @property
    def errors(self) -> tuple[Lint, ...]:
        """Remarks that keep the gateway from using the table."""
        return tuple(lint for lint in self.lints if lint.severity is LintSeverity.ERROR)

    @property
    def warnings(self) -> tuple[Lint, ...]:
        """The other remarks."""
        return tuple(lint for lint in self.lints if lint.severity is LintSeverity.WARNING)


# --- Small sums over rows, for the loader and the lints

BRANCHES: Final = ("forward", "backward")


def corrections(rows: Sequence[SourceRow], branch: str) -> list[float]:
    """Return the corrections of one direction, in machine units."""
    return [row.forward if branch == "forward" else row.backward for row in rows]


def line_of(row: SourceRow, branch: str) -> int | None:
    """Return the line that holds the correction of one direction."""
    return row.forward_line if branch == "forward" else row.backward_line


def steepest(rows: Sequence[SourceRow]) -> tuple[float, SourceRow, SourceRow]:
    """Return the largest slope of either direction, signed, and its two points.

    A slope without a value (between equal positions) is infinite and the steepest.
    """
    found = (0.0, rows[0], rows[-1])
    for before, after in pairwise(rows):
        width = after.position - before.position
        for change in (after.forward - before.forward, after.backward - before.backward):
            slope = change / width if width > 0 else float("inf")
            if not abs(slope) <= abs(found[0]):
                found = (slope, before, after)
    return found


def second_differences(rows: Sequence[SourceRow], branch: str) -> list[float]:
    """Return the bends of one direction, see :func:`bends`."""
    return bends([row.position for row in rows], corrections(rows, branch))


def bends(positions: Sequence[float], values: Sequence[float]) -> list[float]:
    """Return, for each inner point, |twice its distance from the line through its neighbours|."""
    differences = []
    for i in range(1, len(positions) - 1):
        share = (positions[i] - positions[i - 1]) / (positions[i + 1] - positions[i - 1])
        chord = values[i - 1] + share * (values[i + 1] - values[i - 1])
        differences.append(2 * abs(values[i] - chord))
    return differences
