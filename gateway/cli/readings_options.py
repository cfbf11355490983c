"""Options of the commands that take readings, each declared once, and what is understood of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.table_options import ToFileAxis, ToSense
from gateway.compensation.settings import DEFAULT_MAX_SLOPE
from gateway.compensation.units import Units
from gateway.metrology.build import Fit, HomeCase
from gateway.metrology.drift import at_20_degrees
from gateway.metrology.errors import ReadingsError
from gateway.metrology.formats import FORMATS, ReadingsContext, Runs, read_survey
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.readings import Survey, merged, understood
from gateway.tabfile import DIALECTS, Dialect, WriteOptions

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

    def periods(self, survey: Survey) -> tuple[Period, ...]:
        """Return what the error may repeat with: as told, or as the readings say.

        Raises:
            ReadingsError: a lead or a period that is no length.
        """
        lead = self.lead
        if lead is None and (stated := survey.facts.get("lead")) is not None:
            lead = _number(survey.source, "lead", stated, "in the units of the targets", "lead")
        return periods_of(lead, self.period or ())


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


def read_all(
    files: Sequence[Path], context: ReadingsContext, screw: ScrewOptions, *, is_quiet: bool
) -> Survey:
    """Read files of one axis as one survey, and say what was understood of it, unless quiet.

    It is normalised to 20 °C, if that was asked.

    Raises:
        TabFileError, ReadingsError: see there, and :func:`gateway.metrology.drift.at_20_degrees`.
    """
    survey = merged([read_survey(file, context) for file in files])
    if not is_quiet:
        typer.echo(f"read: {understood(survey)}")
    return survey if screw.to_20c is None else at_20_degrees(survey, screw.to_20c)


def _number(source: str, name: str, stated: str, what: str, option: str) -> float:
    try:
        return float(stated)
    except ValueError:
        raise ReadingsError(
            f"{source}: # {name}: {stated}: it must be a number, {what}; correct that line, or take it out "
            f"and give --{option}"
        ) from None


def steep_allowed(survey: Survey, given: float | None) -> float:
    """Return how steep a table may be: as told, or as the readings say, or as axes have it by default.

    Raises:
        BadParameter: what was told is no slope below 1.
        ReadingsError: what the readings say is none.
    """
    if given is not None:
        if not 0.0 < given < 1.0:
            raise typer.BadParameter(
                f"{given:g}: it must be above 0 and below 1, as max_slope of the axis",
                param_hint="--max-slope",
            )
        return given
    if (stated := survey.facts.get("max_slope")) is None:
        return DEFAULT_MAX_SLOPE
    limit = _number(survey.source, "max_slope", stated, "above 0 and below 1", "max-slope")
    if not 0.0 < limit < 1.0:
        raise ReadingsError(f"{survey.source}: # max_slope: {stated}: it must be above 0 and below 1")
    return limit


def dialect_to_write(name: str) -> Dialect:
    """Return the dialect of a name.

    Raises:
        BadParameter: there is none, or no system reads it.
    """
    writable = {dialect.name: dialect for dialect in DIALECTS if dialect.is_writable}
    if name not in writable:
        raise typer.BadParameter(f"{name!r}: must be one of {', '.join(sorted(writable))}", param_hint="--to")
    return writable[name]
