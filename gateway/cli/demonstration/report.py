"""The result of a round: for scripts as JSON, for people as a few lines."""

from typing import Any, Final

from rich.console import Console
from rich.table import Table

from gateway.cli.demonstration.configuration import (
    CONFIGURATION_NAME,
    TABLE_FORMAT,
    TABLES_FOLDER,
    table_name,
)
from gateway.cli.demonstration.view import AxisView, Listener, View

REQUIRED_RATIO: Final = 1 / 20
"""What the demonstration promises: no more than this share of the error is left."""


class Narrator(Listener):
    """Says on a console which step begins."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def on_phase(self, axis: AxisView) -> None:
        """Print one line."""
        stops = f" ({axis.stops_total} stops)" if axis.stops_total else ""
        line = f"axis {axis.spec.title}: {axis.phase.value}{stops}"
        self._console.print(line, highlight=False, soft_wrap=True)


def as_json(view: View, seconds: float, kept_in: str | None) -> dict[str, Any]:
    """Return what was found, lengths in µm; ``kept_in`` is the folder of the files, if they stay."""
    return {
        "axes": {name: _axis_json(axis) for name, axis in view.axes.items()},
        "table": {
            "built_from": "readings of the simulated laser",
            "format": TABLE_FORMAT,
            "configuration": CONFIGURATION_NAME,
            "folder": TABLES_FOLDER,
            "kept_in": kept_in,
        },
        "seed": view.seed,
        "good": is_good(view),
        "seconds": round(seconds, 2),
    }


def is_good(view: View) -> bool:
    """Whether every axis became as accurate as promised, and read back what was commanded."""
    return all(
        axis.is_readback_exact and axis.error_with_um <= REQUIRED_RATIO * axis.error_without_um
        for axis in view.axes.values()
    )


def _axis_json(axis: AxisView) -> dict[str, Any]:
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


def summary(view: View) -> Table:
    """Return the result of a round as a table for a terminal."""
    table = Table(title="Worst error of the nut at random targets, approached from both sides")
    for column in ("axis", "screw", "backlash", "without", "with", "left over", "read back"):
        table.add_column(column, justify="left" if column == "axis" else "right")
    for axis in view.axes.values():
        left_over = axis.error_with_um / axis.error_without_um if axis.error_without_um else 0.0
        table.add_row(
            f"{axis.spec.name}, {axis.spec.controller.value} → {axis.spec.drive.value}",
            f"{axis.pitch_error_um:.0f} µm",
            f"{axis.backlash_um:.0f} µm",
            f"[red]{axis.error_without_um:.1f} µm[/]",
            f"[green]{axis.error_with_um:.1f} µm[/]",
            f"{left_over:.1%}",
            "exact" if axis.is_readback_exact else f"[red]{axis.inexact_readbacks} differ[/]",
        )
    return table
