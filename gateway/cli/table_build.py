"""``pitch-gateway table build``: readings of a laser, a scale or a dial gauge into a table."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gateway.cli import readings_options as given
from gateway.cli.options import takes_options
from gateway.cli.output import Format, StderrLine, print_lines, show
from gateway.cli.table_options import AsJson, AxisLetter, Counts, Force, OutFile
from gateway.cli.table_output import PLAIN_WIDTH, PREDICTED, results_lines
from gateway.cli.table_reading import problems
from gateway.commissioning.tables import WrittenTable, refusal, steep_notes, written_table
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.doubts import json_of, notes_of, plausibility_warnings
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate, results_json
from gateway.metrology.lead import longest
from gateway.metrology.readings import Survey, check_uncorrected, understood
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.residue import LeftOut, predicted_json, predicted_residue
from gateway.metrology.scale import check_scale
from gateway.metrology.wrong_runs import settled
from gateway.tabfile import Dialect, LoadedTable, TabFileError, axis_of_name

if TYPE_CHECKING:
    from rich.console import RenderableType

    from gateway.metrology.fitting import FitEvidence

OWN_OPTIONS: Final = {
    "--to-axis": "--axis",
    "--resample STEP": "--step STEP, or a format with positions of its own",
}
"""What some options of ``table convert`` are called here."""


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """How a table is made of readings."""

    to: Annotated[
        str,
        typer.Option("--to", metavar="FORMAT", help="Format of OUT; pitch-gateway table formats lists all."),
    ] = "centroid-2"
    home: given.Home = None
    step: Annotated[float | None, typer.Option(help="An even grid: multiples of this distance.")] = None
    travel: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LO HI", help="Lay the even grid over this range; beyond the targets it is held."
        ),
    ] = None
    tolerance: Annotated[
        float | None, typer.Option(help="As few of the targets as lose no more than this.")
    ] = None
    smooth: Annotated[
        float | None, typer.Option(metavar="WINDOW", help="Smooth over this length; says by how much.")
    ] = None
    drop_outliers: Annotated[
        bool,
        typer.Option(
            "--drop-outliers",
            help="Leave out outliers, and runs that are wrong as a whole.",
        ),
    ] = False
    shape: given.ShapeOptions = field(default_factory=given.ShapeOptions)
    keep_scale: Annotated[
        bool,
        typer.Option(
            "--keep-scale", help="Make the table though the readings are wrong by more than 0.3 mm/m."
        ),
    ] = False
    max_slope: given.MaxSlope = None
    counts_per_unit: Counts = None
    axis: AxisLetter = None
    units: Annotated[Units | None, typer.Option("--units", help="Units of readings that state none.")] = None
    to_units: Annotated[Units | None, typer.Option(help="Units of OUT; default: those of the readings.")] = (
        None
    )
    out: given.OutOptions = field(default_factory=given.OutOptions)
    readings: given.FormatOptions = field(default_factory=given.FormatOptions)
    force: Force = False


@takes_options
def build(
    readings: given.ReadingFiles,
    out: OutFile,
    *,
    options: BuildOptions,
    json: AsJson = False,
) -> None:
    """Build a correction table from readings that were taken without one.

    The correction is target less reading, the mean of all runs in each direction; what cannot be measured
    where the axis turns round is estimated from its neighbour. What is odd about the readings is named. The
    table follows what leaves least between the targets: lines, a smooth curve, or one with harmonics of the
    lead (--lead); what it will leave there is predicted by leaving targets out.

    Examples:
      pitch-gateway table build z.csv cnc10z.tab --home switch-negative

      pitch-gateway table build x.csv x-table.csv --to csv --lead 5

      pitch-gateway table build run1.rtl run2.rtl cnc10x.tab --to centroid-3 --axis x --home switch-positive
    """
    target = given.dialect_to_write(options.to)
    with problems():
        found = _built(readings, out, target, options, is_quiet=json)
    show(found, Format.INDENTED if json else Format.TEXT, plain_width=PLAIN_WIDTH)


def _built(
    files: list[Path], out: Path, target: Dialect, options: BuildOptions, *, is_quiet: bool
) -> "_BuiltTable":
    """Make a table of readings and write it. Raises TabFileError, MetrologyError, TableError."""
    screw = options.shape.screw
    context = options.readings.context(options.units, options.axis)
    survey = given.read_all(files, context, screw, is_quiet=is_quiet)
    check_uncorrected(survey.source, survey.facts, "table refine adds it to that table")
    survey = settled(survey, drop=options.drop_outliers)
    periods = screw.periods(survey)
    if not options.keep_scale:
        try:
            check_scale(survey, options.counts_per_unit, longest(periods))
        except ReadingsError:
            _print_warnings(survey)
            raise
    writing = options.out.writing(options.axis or _letter(survey.axis) or axis_of_name(out.name))
    unit = options.to_units or survey.units
    steepest = given.steep_allowed(survey, options.max_slope)
    recipe = Recipe(
        options.home,
        options.step,
        options.tolerance,
        options.smooth,
        options.drop_outliers,
        one_way=options.shape.one_way,
        travel=options.travel,
        fit=options.shape.fit,
        periods=periods,
        refusal=lambda each: refusal(target, each.in_units(unit), writing, steepest),
    )
    built = build_from(survey, recipe)
    table = built.table.in_units(unit)
    try:
        written = written_table(table, target, writing, steepest, OWN_OPTIONS)
    except TabFileError:
        _print_warnings(survey)
        raise
    # in which order both lists stand is known here, for they come from the readings
    lints = tuple(lint for lint in written.again.lints if lint.code != "L3")
    again = replace(written.again, lints=lints)
    notes = [
        *built.notes,
        *notes_of(survey, options.counts_per_unit, lead=longest(periods)),
        *_one_curve(table, again, target.name),
        *steep_notes(again.table),
    ]
    written = replace(written, again=again)
    written.put(out, force=options.force)
    return _BuiltTable(
        out,
        notes,
        written,
        before=evaluate(survey),
        predicted=evaluate(predicted_residue(survey, again.table)),
        left_out=None if built.screw is None else built.screw.left_out(again.table),
        survey=survey,
        evidence=built.evidence,
        lead=longest(periods),
    )


@dataclass(frozen=True, slots=True)
class _BuiltTable:
    """A new table, and what it is predicted to leave."""

    out: Path
    notes: list[str]
    written: WrittenTable
    before: Evaluation
    predicted: Evaluation
    left_out: LeftOut | None
    survey: Survey
    evidence: "FitEvidence | None"
    lead: float | None
    """The longest length after which the error may repeat."""

    def as_data(self) -> dict[str, object]:
        """Return it as plain data."""
        again = self.written.again
        return {
            "out": str(self.out),
            "to": again.format,
            "units": again.table.units.value,
            "points": len(again.table.positions),
            "notes": self.notes,
            **self.written.as_data(),
            "before": results_json(self.before),
            "predicted": {**results_json(self.predicted), **predicted_json(self.predicted, self.left_out)},
            "fit": None if self.evidence is None else self.evidence.as_data(),
            "understood": understood(self.survey),
            **json_of(self.survey, self.lead),
        }

    def lines(self) -> "Iterator[RenderableType]":
        """Yield it for a person."""
        yield from (StderrLine(f"note: {note}") for note in self.notes)
        yield from self.written.lines(self.out)
        yield from results_lines(self.before, self.predicted, ("before", PREDICTED), left_out=self.left_out)


def _print_warnings(survey: Survey) -> None:
    """Print what looks wrong about readings that make no table: perhaps it says why."""
    print_lines(
        (f"note: {warning}" for warning in plausibility_warnings(survey.readings, survey.units)), err=True
    )


def _one_curve(table: CorrectionTable, again: LoadedTable, name: str) -> list[str]:
    """Name a format that takes the mean of both directions: what was 0 at home is so no more."""
    if table.is_unidirectional or not again.table.is_unidirectional:
        return []
    return [
        f"{name} holds one curve, here the mean of both directions: --one-way makes one that is 0 at home"
    ]


def _letter(axis: str | None) -> str | None:
    return axis if axis is not None and len(axis) == 1 and axis.isalpha() else None
