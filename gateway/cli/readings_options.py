"""Options of the commands that take readings; what several of them take is declared once, here."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.table_options import ToFileAxis, ToSense
from gateway.compensation.units import Units
from gateway.metrology.build import HomeCase
from gateway.metrology.formats import FORMATS, ReadingsContext, Runs
from gateway.metrology.shapes import Fit
from gateway.tabfile import WriteOptions

NAMES = ", ".join(each.name for each in FORMATS)

ReadingFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="READINGS...",
        help="Files of readings: CSV, a manual table, Renishaw .rtl, API .pos, or a spreadsheet (.xlsx).",
        show_default=False,
        readable=False,
    ),
]
Home = Annotated[
    HomeCase | None,
    typer.Option(
        "--home",
        help="Where the correction is 0. switch-positive: travel has positive positions, and the home switch "
        "is at its negative end. switch-negative: travel has negative positions, and the switch is at its "
        "positive end. mark: a reference mark at 0.",
    ),
]
MaxSlope = Annotated[
    float | None,
    typer.Option(
        "--max-slope",
        help="Steepest table that may be made, as max_slope of the axis. Default: the line '# max_slope' "
        "of the readings, or 0.01.",
    ),
]


@dataclass(frozen=True, slots=True)
class FormatOptions:
    """What files of readings do not say about themselves."""

    readings_format: Annotated[
        str | None,
        typer.Option("--readings-format", metavar="NAME", help=f"Where it is not plain: {NAMES}."),
    ] = None
    runs: Annotated[
        Runs | None,
        typer.Option("--runs", help="Directions of the runs of a file that does not prove them."),
    ] = None

    def context(self, units: Units | None, axis: str | None) -> ReadingsContext:
        """Return it for a reader, with what was told of the axis."""
        return ReadingsContext(self.readings_format, units, axis, self.runs)


@dataclass(frozen=True, slots=True)
class ScrewOptions:
    """What is known of the screw."""

    lead: Annotated[
        float | None,
        typer.Option(
            "--lead",
            help="Lead of the screw, in the units of the readings: once and twice a turn the error may "
            "repeat. Default: the line '# lead' of the readings.",
        ),
    ] = None
    period: Annotated[
        list[float] | None,
        typer.Option(
            "--period",
            help="Another length after which it may repeat: a turn of motor or gear; again for more.",
        ),
    ] = None
    to_20c: Annotated[
        float | None,
        typer.Option(
            "--to-20c",
            metavar="COEFFICIENT",
            help="Normalise to 20 °C: the screw grows by so many µm a metre and kelvin, 11.5 for steel. The "
            "readings carry temperatures.",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class ShapeOptions:
    """How a table follows readings."""

    one_way: Annotated[
        bool, typer.Option("--one-way", help="One curve for both directions, from what was measured.")
    ] = False
    fit: Annotated[
        Fit,
        typer.Option(
            "--fit", help="What the table follows between the targets; auto: what leaves least there."
        ),
    ] = Fit.AUTO
    screw: ScrewOptions = ScrewOptions()


@dataclass(frozen=True, slots=True)
class OutOptions:
    """How OUT is written, besides its format."""

    to_counts_per_unit: Annotated[
        float | None,
        typer.Option(metavar="N", help="Encoder counts per unit of the control that will read OUT."),
    ] = None
    to_sense: ToSense = None
    to_file_axis: ToFileAxis = None

    def writing(self, axis: str | None) -> WriteOptions:
        """Return it for a writer, with the letter of the axis."""
        return WriteOptions(axis, self.to_counts_per_unit, file_axis=self.to_file_axis, sense=self.to_sense)
