"""What the commands that take readings share: options, reading, writing, errors."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil, floor, log10
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.output import print_lines
from gateway.cli.table_output import finding_line
from gateway.compensation.errors import TableError
from gateway.compensation.settings import DEFAULT_MAX_SLOPE
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.build import Fit, HomeCase
from gateway.metrology.drift import at_20_degrees
from gateway.metrology.errors import MetrologyError, ReadingsError
from gateway.metrology.formats import FORMATS, ReadingsContext, Runs, is_readings, read_survey
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.readings import APPROACHES, Survey, merged, understood
from gateway.metrology.tables import correction_at
from gateway.tabfile import (
    DIALECTS,
    ContextError,
    Dialect,
    ErrorSense,
    LoadedTable,
    Problem,
    TabFileError,
    WriteOptions,
    Written,
    conversion,
    dialect_named,
    parse_table,
)
from gateway.tabfile.conversion import MEASURED_DECIMALS, tidied

STEEP = "L1"
"""Lint of a table that is steeper than the axis allows."""
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
OutFile = Annotated[
    Path, typer.Argument(metavar="OUT", help="The file to write.", show_default=False, readable=False)
]
To = Annotated[
    str, typer.Option("--to", metavar="FORMAT", help="Format of OUT; pitch-gateway table formats lists all.")
]
ToUnits = Annotated[Units | None, typer.Option(help="Units of OUT; default: those of the readings.")]
ToCounts = Annotated[
    float | None,
    typer.Option(metavar="N", help="Encoder counts per unit of the control that will read OUT."),
]
ToSense = Annotated[
    ErrorSense | None,
    typer.Option("--to-sense", help="What OUT calls an error, if its format leaves that open."),
]
ToFileAxis = Annotated[
    str | None,
    typer.Option("--to-file-axis", metavar="NAME", help="What OUT calls the axis, if its format names axes."),
]
ReadingsUnits = Annotated[Units | None, typer.Option("--units", help="Units of readings that state none.")]
ReadingsFormat = Annotated[
    str | None,
    typer.Option("--readings-format", metavar="NAME", help=f"Where it is not plain: {NAMES}."),
]
RunsTold = Annotated[
    Runs | None,
    typer.Option("--runs", help="Directions of the runs of a file that does not prove them."),
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
OneWay = Annotated[
    bool, typer.Option("--one-way", help="One curve for both directions, from what was measured.")
]
FitWish = Annotated[
    Fit,
    typer.Option("--fit", help="What the table follows between the targets; auto: what leaves least there."),
]
Lead = Annotated[
    float | None,
    typer.Option(
        "--lead",
        help="Lead of the screw, in the units of the readings: once and twice a turn the error may repeat. "
        "Default: the line '# lead' of the readings.",
    ),
]
Turns = Annotated[
    list[float] | None,
    typer.Option(
        "--period", help="Another length after which it may repeat: a turn of motor or gear; again for more."
    ),
]
To20 = Annotated[
    float | None,
    typer.Option(
        "--to-20c",
        metavar="COEFFICIENT",
        help="Normalise to 20 °C: the screw grows by so many µm a metre and kelvin, 11.5 for steel. The "
        "readings carry temperatures.",
    ),
]
KeepScale = Annotated[
    bool,
    typer.Option("--keep-scale", help="Make the table though the readings are wrong by more than 0.3 mm/m."),
]
MaxSlope = Annotated[
    float | None,
    typer.Option(
        "--max-slope",
        help="Steepest table that may be made, as max_slope of the axis. Default: the line '# max_slope' "
        "of the readings, or 0.01.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite OUT.")]


@dataclass(frozen=True, slots=True)
class WrittenTable:
    """A table as the text of a file, and read back from it."""

    result: Written
    again: LoadedTable
    difference: float
    """The largest difference of a correction."""

    def as_data(self) -> dict[str, object]:
        """Return what became of it as plain data."""
        return {
            "losses": list(self.result.losses),
            "largest_difference": self.difference,
            "read_with": conversion.told_to_reader(self.result, dialect_named(self.again.format)),
            "lints": [lint.to_json() for lint in self.again.lints],
        }

    def lines(self, out: Path) -> Iterator[str]:
        """Yield in words what was written."""
        table = self.again.table
        yield (
            f"{out}: {self.again.format}, {len(table.positions)} points from {table.first:g} to "
            f"{table.last:g} {table.units.value}, corrections up to {table.max_correction():.6g}"
        )
        yield from (f"not in the file: {loss}" for loss in self.result.losses)
        yield from conversion.reader_lines(self.result, dialect_named(self.again.format))
        yield from (finding_line(str(out), lint) for lint in self.again.lints)
        yield f"largest difference of a correction after reading it back: {self.difference:.3g}"


@contextmanager
def problems() -> Iterator[None]:
    """Turn a bad file, readings or a table that cannot be into lines on stderr and exit code 1."""
    try:
        yield
    except ContextError as error:
        raise typer.BadParameter(str(error)) from error
    except TabFileError as error:
        print_lines((f"error: {problem}" for problem in error.problems), err=True)
        raise typer.Exit(1) from None
    except (MetrologyError, TableError, ValueError) as error:
        print_lines([f"error: {error}"], err=True)
        raise typer.Exit(1) from None


def read_all(files: Sequence[Path], context: ReadingsContext) -> Survey:
    """Read files of one axis as one survey.

    Raises:
        TabFileError, ReadingsError: see there.
    """
    return merged([read_survey(file, context) for file in files])


def prepared(survey: Survey, to_20c: float | None, *, is_quiet: bool) -> Survey:
    """Say what was understood of readings, unless quiet, and return them as they are to be used.

    They are normalised to 20 °C, if that was asked.

    Raises:
        ReadingsError: see :func:`gateway.metrology.drift.at_20_degrees`.
    """
    if not is_quiet:
        typer.echo(f"read: {understood(survey)}")
    return survey if to_20c is None else at_20_degrees(survey, to_20c)


def periods_of_readings(
    survey: Survey, lead: float | None, turns: Sequence[float] | None
) -> tuple[Period, ...]:
    """Return what the error may repeat with: as told, or as the readings say.

    Raises:
        ReadingsError: a lead or a period that is no length.
    """
    if lead is None and (stated := survey.facts.get("lead")) is not None:
        lead = _number(survey.source, "lead", stated, "in the units of the targets", "lead")
    return periods_of(lead, turns or ())


def _number(source: str, name: str, stated: str, what: str, option: str) -> float:
    try:
        return float(stated)
    except ValueError:
        raise ReadingsError(
            f"{source}: # {name}: {stated}: it must be a number, {what}; correct that line, or take it out "
            f"and give --{option}"
        ) from None


def refusal(target: Dialect, table: CorrectionTable, options: WriteOptions, max_slope: float) -> str | None:
    """Say why a table cannot be written, or the gateway would refuse it, and what to do; None: neither."""
    try:
        written(table, target, options, {}, max_slope)
    except TabFileError as error:
        if error.problems[0].code is None:
            allowed = f", allowed: {error.allowed}" if error.allowed else ""
            return f"this format does not hold it ({error.found}{allowed}); --to csv does"
        # a limit of the gateway is one in every format
        return f"{error.found}; {error.allowed}" if error.allowed else error.found
    except TableError as error:
        return str(error)
    return None


def steep_allowed(survey: Survey, told: float | None) -> float:
    """Return how steep a table may be: as told, or as the readings say, or as axes have it by default.

    Raises:
        BadParameter: what was told is no slope below 1.
        ReadingsError: what the readings say is none.
    """
    if told is not None:
        if not 0.0 < told < 1.0:
            raise typer.BadParameter(
                f"{told:g}: it must be above 0 and below 1, as max_slope of the axis",
                param_hint="--max-slope",
            )
        return told
    if (stated := survey.facts.get("max_slope")) is None:
        return DEFAULT_MAX_SLOPE
    limit = _number(survey.source, "max_slope", stated, "above 0 and below 1", "max-slope")
    if not 0.0 < limit < 1.0:
        raise ReadingsError(f"{survey.source}: # max_slope: {stated}: it must be above 0 and below 1")
    return limit


def steep_notes(table: CorrectionTable) -> list[str]:
    """Say of a steep table what the axis that uses it needs."""
    slope = table.max_slope()
    if slope <= DEFAULT_MAX_SLOPE:
        return []
    return [
        (
            f"a slope of {slope:.4g}: the axis takes this table with max_slope = {_up(slope):g} in its "
            f"configuration; it is {DEFAULT_MAX_SLOPE:g} by default"
        )
    ]


def _up(slope: float) -> float:
    """Return a slope with two digits that is no smaller.

    >>> _up(0.01131), _up(0.02)
    (0.012, 0.02)
    """
    scale = 10.0 ** (1 - floor(log10(slope)))
    return round(ceil(slope * scale * (1 - 1e-9)) / scale, 12)


def dialect_to_write(name: str) -> Dialect:
    """Return the dialect of a name.

    Raises:
        BadParameter: there is none, or no system reads it.
    """
    writable = {dialect.name: dialect for dialect in DIALECTS if dialect.is_writable}
    if name not in writable:
        raise typer.BadParameter(f"{name!r}: must be one of {', '.join(sorted(writable))}", param_hint="--to")
    return writable[name]


def written(
    table: CorrectionTable,
    target: Dialect,
    options: WriteOptions,
    own_options: Mapping[str, str],
    max_slope: float,
) -> WrittenTable:
    """Write a table as text and read it back.

    ``own_options`` are what this command calls some options of ``table convert``; a table that is steeper
    than ``max_slope`` is refused.

    Raises:
        TabFileError: the target cannot hold the table, or the gateway would refuse what it holds.
    """
    table = tidied(table, MEASURED_DECIMALS)
    try:
        result = conversion.write_text(table, target, options)
    except TabFileError as error:
        remedy = error.allowed
        # writers name the options of table convert
        for option, own in own_options.items():
            remedy = remedy.replace(option, own)
        if "subtract it" in remedy and not table.is_unidirectional:
            remedy += ": --one-way makes one curve that is 0 at home"
        raise TabFileError(replace(error.problems[0], allowed=remedy)) from None
    context = replace(result.context, format=target.name, max_slope=max_slope)
    again = parse_table(result.text.encode(), f"the {target.name} file", context)
    if again.errors:
        # no line: nothing is written, so there is no file to look into
        raise TabFileError(
            *(
                _steep(table, max_slope)
                if lint.code == STEEP
                else Problem("the new table", lint.message, "", code=lint.code)
                for lint in again.errors
            )
        )
    same = again.table.in_units(table.units)
    difference = max(
        abs(correction_at(table, x, way) - correction_at(same, x, way))
        for x in table.positions
        for way in APPROACHES
    )
    return WrittenTable(result, again, difference)


def _steep(table: CorrectionTable, limit: float) -> Problem:
    slope = table.max_slope()
    remedy = (
        f"--max-slope {_up(slope):g}, if the screw is really so steep, and max_slope = {_up(slope):g} for "
        "the axis that uses the table"
    )
    return Problem("the new table", f"its slope is {slope:.4g}, above {limit:g}", remedy, code=STEEP)


def write_file(out: Path, text: str, *, force: bool, encoding: str = "utf-8") -> None:
    """Write a file, an existing one only with ``force``, and one of readings never.

    A forgotten OUT makes the last file of readings the one to write.

    Raises:
        TabFileError: a file of this name exists, it holds readings, or the place cannot be written to.
    """
    if is_readings(out):
        raise TabFileError(Problem(str(out), "a file of readings", "another name for OUT, the last argument"))
    conversion.write(out, text, force=force, encoding=encoding)
