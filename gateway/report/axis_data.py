"""The data of a report: for each axis the readings before, the table, and the readings after."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.readings import Survey
from gateway.metrology.residue import LeftOut


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
    notes: tuple[str, ...] = ()
    """What a reader has to know: named outliers, estimated points, losses."""


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report; ``made_at`` is shown unchanged, because nothing here reads a clock."""

    title: str
    axes: tuple[AxisData, ...]
    made_at: str
    facts: Mapping[str, str] = field(default_factory=dict)
