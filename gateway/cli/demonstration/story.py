"""The round as a report: the machine before, the tables, the machine with the tables in force."""

from typing import Final

from gateway.cli.demonstration.configuration import table_name
from gateway.cli.demonstration.view import AxisView, View
from gateway.metrology.readings import Reading, Survey
from gateway.report.story import AxisStory, Report
from gateway.report.words import shortest

REPORT_RUNS: Final = 5
"""Passes of the laser in each direction: what ISO 230-2 asks for."""
INSTRUMENT: Final = "the simulated laser"


def report_of(view: View, made_at: str) -> Report:
    """Return what the laser saw in a round, all axes."""
    facts = {"machine": f"simulated, seed {view.seed}", "instrument": INSTRUMENT}
    axes = tuple(_story(axis) for axis in view.axes.values())
    return Report("A worn machine becomes accurate", axes, made_at, facts)


def _story(axis: AxisView) -> AxisStory:
    spec = axis.spec
    facts = {
        "cables": f"controller {spec.controller.value}, drive {spec.drive.value}",
        "range": f"{shortest(spec.low)} to {shortest(spec.high)} {spec.units.value}",
        "screw": f"lead {spec.lead_mm:g} mm, {axis.pitch_error_um:.0f} µm of pitch error",
        "lost motion": f"{axis.backlash_um:.1f} µm",
        "table": table_name(spec),
        "read back": "exactly what was commanded"
        if axis.is_readback_exact
        else f"{axis.inexact_readbacks} of {axis.stops} stops differ",
    }
    note = (
        "The laser read at irregular targets, as ISO 230-2 asks; the points of the table are even, as its "
        f"format asks. At {len(axis.without) // 2} random targets between the points, approached from both "
        f"sides, the nut was off by up to {axis.error_without_um:.1f} µm without correction and by up to "
        f"{axis.error_with_um:.1f} µm with it."
    )
    return AxisStory(
        spec.name,
        spec.units,
        axis.table,
        _survey(axis, axis.before),
        _survey(axis, axis.after),
        facts=facts,
        notes=(note,),
    )


def _survey(axis: AxisView, readings: list[Reading]) -> Survey:
    return Survey(tuple(readings), axis.spec.units, axis.spec.name, INSTRUMENT)
