"""What the tests of reports tell: small enough to be worked out by hand."""

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.readings import Reading, Survey
from gateway.report.axis_data import AxisData, Report

DEVIATIONS_UM = {
    (0.0, Direction.FORWARD): (1.0, 3.0),
    (0.0, Direction.BACKWARD): (10.0, 14.0),
    (100.0, Direction.FORWARD): (-4.0, -4.0),
    (100.0, Direction.BACKWARD): (6.0, 8.0),
}
"""Means 2, 12, -4 and 7; s = sqrt(2), 2 sqrt(2), 0 and sqrt(2)."""


def survey(share: float = 1.0, units: Units = Units.MM, runs: int = 2) -> Survey:
    """Return the readings, their deviations taken ``share`` times."""
    um = 1 / 1000 if units is Units.MM else 1 / 25_400
    readings = tuple(
        Reading(target, direction, target + share * deviation * um, run)
        for (target, direction), deviations in DEVIATIONS_UM.items()
        for run, deviation in enumerate(deviations[:runs], start=1)
    )
    return Survey(readings, units, "x", "readings.csv")


def table() -> CorrectionTable:
    """Return four points; the spacing is not even."""
    return make_table([0, 10, 30, 40], [0.0, 0.01, -0.005, 0.02], [-0.02, -0.01, -0.02, 0.0], Units.MM)


def axis_data(**changes: object) -> AxisData:
    """Return an axis of which everything is known."""
    told: dict[str, object] = {
        "axis": "x",
        "units": Units.MM,
        "table": table(),
        "before": survey(),
        "after": survey(0.1),
        "facts": {"machine": "mill"},
        "notes": ("the laser was warm",),
    }
    return AxisData(**{**told, **changes})  # type: ignore[arg-type]


def report(*stories: AxisData) -> Report:
    """Return a report of these axes."""
    return Report("Accuracy of a mill", stories or (axis_data(),), "2026-11-21", {"customer": "Smith & Sons"})
