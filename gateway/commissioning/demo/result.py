"""The result of a round: as plain data, and as a report with the machine before and after."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.commissioning.demo.cycle import AxisView, View
from gateway.commissioning.demo.machine import (
    CONFIGURATION_NAME,
    TABLE_FORMAT,
    TABLES_FOLDER,
    table_name,
)
from gateway.metrology.readings import Reading, Survey
from gateway.plain import JsonObject
from gateway.report.axis_data import AxisData, Report
from gateway.report.words import shortest

REQUIRED_RATIO: Final = 1 / 20
"""The promise of the demonstration: at most this share of the error is left."""


@dataclass(frozen=True, slots=True)
class Demonstrated:
    """The result of a finished round, and the location of its files."""

    view: View
    seconds: float
    kept_in: Path | None = None
    """The folder of the files, if they are kept."""
    report: Path | None = None

    @property
    def is_good(self) -> bool:
        """Whether every axis became as accurate as promised, and read back its commanded positions."""
        return all(
            axis.is_readback_exact and axis.error_with_um <= REQUIRED_RATIO * axis.error_without_um
            for axis in self.view.axes.values()
        )

    def as_data(self) -> JsonObject:
        """Return the results, lengths in µm."""
        return {
            "axes": {name: _axis_json(axis) for name, axis in self.view.axes.items()},
            "table": {
                "built_from": "readings of the simulated laser",
                "format": TABLE_FORMAT,
                "configuration": CONFIGURATION_NAME,
                "folder": TABLES_FOLDER,
                "kept_in": None if self.kept_in is None else str(self.kept_in),
            },
            "seed": self.view.seed,
            "good": self.is_good,
            "seconds": round(self.seconds, 2),
            "report": None if self.report is None else str(self.report),
        }

    def lines(self) -> Iterator[str]:
        """Yield the paths of the files; on a terminal the results are a table."""
        if self.kept_in is not None:
            yield f"configuration and tables are in {self.kept_in}"
        if self.report is not None:
            yield f"the report is {self.report}"


def _axis_json(axis: AxisView) -> JsonObject:
    spec = axis.spec
    return {
        "controller": spec.controller.value,
        "drive": spec.drive.value,
        "units": spec.units.value,
        "counts_per_unit": spec.counts_per_unit,
        "backlash_um": round(axis.backlash_um, 2),
        "pitch_error_um": round(axis.pitch_error_um, 2),
        "table_file": table_name(spec),
        "table_points": len(axis.table.positions) if axis.table else 0,
        "targets": len({stop.nominal for stop in axis.corrected}),
        "stops": axis.stops,
        "error_without_um": round(axis.error_without_um, 3),
        "error_with_um": round(axis.error_with_um, 3),
        "ratio": round(axis.error_with_um / axis.error_without_um, 5) if axis.error_without_um else None,
        "readback_exact": axis.is_readback_exact,
    }


REPORT_RUNS: Final = 5
"""Passes of the laser in each direction, as required by ISO 230-2."""
INSTRUMENT: Final = "the simulated laser"


def report_of(view: View, made_at: str) -> Report:
    """Return the laser readings of a round, for all axes."""
    facts = {"machine": f"simulated, seed {view.seed}", "instrument": INSTRUMENT}
    axes = tuple(_axis_data(axis) for axis in view.axes.values())
    return Report("A worn machine becomes accurate", axes, made_at, facts)


def _axis_data(axis: AxisView) -> AxisData:
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
        "The laser read at irregular targets, as ISO 230-2 requires; the points of the table are even, "
        f"as its format requires. At {len(axis.without) // 2} random targets between the points, "
        f"approached from both sides, the nut was off by up to {axis.error_without_um:.1f} µm without "
        f"correction and by up to {axis.error_with_um:.1f} µm with it."
    )
    return AxisData(
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
