"""What every reader returns, and what it becomes once it has been checked."""

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.context import FileContext
from gateway.tabfile.findings import Lint, Severity


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

    ``rows`` ascend; ``context`` is in ``units``; ``value_unit`` is the unit of the file's own numbers,
    ``forward_rule`` and ``backward_rule`` say where each correction comes from and with which sign.
    ``plausible`` bounds the largest |value| of a sound file, in ``value_unit``. ``decisions`` tell how what
    the file leaves open was settled; ``remarks`` what was taken on trust. ``behaves_as`` holds settings of
    the axis, each a line of its configuration, that make the gateway do outside the table and at a reversal
    what the control did that the file was made for. ``are_positions``: the values are places of the nut, not
    corrections, so that their size says nothing about their unit. ``file_axis`` is what a file that names
    axes in a way of its own calls this one. ``modulo`` is the length after which the table begins again, in
    ``units``, None where it does not.
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
    """A file with its table, in the machine units of the file, and everything there is to say about it."""

    file: str
    format: str
    sha256: str
    table: CorrectionTable
    source: Decoded
    lints: tuple[Lint, ...]

    @property
    def errors(self) -> tuple[Lint, ...]:
        """Remarks that keep the gateway from using the table."""
        return tuple(lint for lint in self.lints if lint.severity is Severity.ERROR)

    @property
    def warnings(self) -> tuple[Lint, ...]:
        """Remarks that do not."""
        return tuple(lint for lint in self.lints if lint.severity is Severity.WARNING)
