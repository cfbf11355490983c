"""The data of a report: for each axis the readings before, the table, and the readings after."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.readings import Survey
from gateway.metrology.residue import LeftOut
from gateway.report.words import shortest
from gateway.tabfile import LoadedTable, axis_of_name

if TYPE_CHECKING:
    from gateway.metrology.band import Band


@dataclass(frozen=True, slots=True)
class AxisData:
    """One axis. At least one of the three is present; all are in ``units``.

    ``is_predicted``: ``after`` was not measured; it is ``before`` with the table applied. ``facts`` are shown
    unchanged, by their names: machine, serial numbers, date, file, SHA-256.
    """

    axis: str
    units: Units
    table: CorrectionTable | None = None
    before: Survey | None = None
    after: Survey | None = None
    is_predicted: bool = False
    facts: Mapping[str, str] = field(default_factory=dict)
    left_out: LeftOut | None = None
    """Predicted E between the targets of a predicted ``after``; None: not known."""
    band: "Band | None" = None
    """The uncertainty of the table's corrections; None: not known."""
    notes: tuple[str, ...] = ()
    """What a reader has to know: named outliers, estimated points, losses."""


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report; ``made_at`` is shown unchanged, because nothing here reads a clock."""

    title: str
    axes: tuple[AxisData, ...]
    made_at: str
    facts: Mapping[str, str] = field(default_factory=dict)


def axis_data_of(loaded: LoadedTable, axis: str | None) -> AxisData:
    """Return the data of a file: its table, its source, its remarks."""
    table = loaded.table
    name = axis or loaded.source.axis or axis_of_name(Path(loaded.file).name) or ""
    facts = {
        "file": Path(loaded.file).name,
        "format": loaded.format,
        "points": f"{len(table.positions)}",
        "range": f"{shortest(table.first)} to {shortest(table.last)} {table.units.value}",
        "SHA-256": loaded.sha256,
    }
    notes = (
        *(f"decided: {decision}" for decision in loaded.source.decisions),
        *(lint.line_in(Path(loaded.file).name) for lint in loaded.lints),
    )
    return AxisData(name, table.units, table, facts=facts, notes=notes)
