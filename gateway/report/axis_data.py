"""What a report tells: of each axis the readings before, the table, and the readings after."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.readings import Survey
from gateway.metrology.residue import LeftOut


@dataclass(frozen=True, slots=True)
class AxisData:
    """One axis. At least one of the three is there; all are in ``units``.

    ``is_predicted``: nobody measured ``after``; it is ``before`` with the table taken into account.
    ``facts`` are shown as they are, by their names: machine, serial numbers, date, file, SHA-256.
    """

    axis: str
    units: Units
    table: CorrectionTable | None = None
    before: Survey | None = None
    after: Survey | None = None
    is_predicted: bool = False
    facts: Mapping[str, str] = field(default_factory=dict)
    left_out: LeftOut | None = None
    """E that ``after``, where it is predicted, is predicted to have between the targets; None: not known."""
    notes: tuple[str, ...] = ()
    """What a reader has to know: outliers that were named, points that were estimated, losses."""


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report; ``made_at`` is shown as it is, for nothing here reads a clock."""

    title: str
    axes: tuple[AxisData, ...]
    made_at: str
    facts: Mapping[str, str] = field(default_factory=dict)
