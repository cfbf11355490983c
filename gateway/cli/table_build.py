"""``pitch-gateway table build``: readings of a laser, a scale or a dial gauge into a table."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gateway.cli import survey_files as shared
from gateway.cli.output import print_json, print_lines
from gateway.cli.table_options import AsJson, AxisLetter, Counts
from gateway.cli.table_output import PREDICTED, results_text
from gateway.compensation.table import CorrectionTable
from gateway.metrology.build import Fit
from gateway.metrology.doubts import doubts_of, json_of, notes_of
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate, results_json
from gateway.metrology.formats import ReadingsContext
from gateway.metrology.lead import longest
from gateway.metrology.readings import Survey, check_uncorrected, understood
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.residue import LeftOut, predicted_json, predicted_residue
from gateway.metrology.scale import check_scale
from gateway.metrology.wrong_runs import settled
from gateway.tabfile import LoadedTable, TabFileError, WriteOptions, axis_of_name

if TYPE_CHECKING:
    from gateway.metrology.fitting import Evidence

OWN_OPTIONS: Final = {
    "--to-axis": "--axis",
    "--resample STEP": "--step STEP, or a format with positions of its own",
}
"""What some options of ``table convert`` are called here."""


def build(
    readings: shared.ReadingFiles,
    out: shared.OutFile,
    *,
    to: shared.To = "centroid-2",
    home: shared.Home = None,
    step: Annotated[float | None, typer.Option(help="An even grid: multiples of this distance.")] = None,
    travel: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LO HI", help="Lay the even grid over this range; beyond the targets it is held."
        ),
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="As few of the targets as lose no more than this.")
    ] = None,
    smooth: Annotated[
        float | None, typer.Option(metavar="WINDOW", help="Smooth over this length; says by how much.")
    ] = None,
    drop_outliers: Annotated[
        bool,
        typer.Option(
            "--drop-outliers",
            help="Leave out outliers, and runs that are wrong as a whole.",
        ),
    ] = False,
    one_way: shared.OneWay = False,
    fit: shared.FitWish = Fit.AUTO,
    lead: shared.Lead = None,
    period: shared.Turns = None,
    to_20c: shared.To20 = None,
    keep_scale: shared.KeepScale = False,
    max_slope: shared.MaxSlope = None,
    counts_per_unit: Counts = None,
    axis: AxisLetter = None,
    units: shared.ReadingsUnits = None,
    to_units: shared.ToUnits = None,
    to_counts_per_unit: shared.ToCounts = None,
    to_sense: shared.ToSense = None,
    to_file_axis: shared.ToFileAxis = None,
    readings_format: shared.ReadingsFormat = None,
    runs: shared.RunsTold = None,
    force: shared.Force = False,
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
    target = shared.dialect_to_write(to)
    with shared.problems():
        survey = shared.prepared(
            shared.read_all(readings, ReadingsContext(readings_format, units, axis, runs)),
            to_20c,
            is_quiet=json,
        )
        check_uncorrected(survey.source, survey.facts, "table refine adds it to that table")
        survey = settled(survey, drop=drop_outliers)
        periods = shared.periods_of_readings(survey, lead, period)
        if not keep_scale:
            try:
                check_scale(survey, counts_per_unit, longest(periods))
            except ReadingsError:
                _print_doubts(survey)
                raise
        letter = axis or _letter(survey.axis) or axis_of_name(out.name)
        options = WriteOptions(letter, to_counts_per_unit, file_axis=to_file_axis, sense=to_sense)
        unit = to_units or survey.units
        steepest = shared.steep_allowed(survey, max_slope)
        recipe = Recipe(
            home, step, tolerance, smooth, drop_outliers, one_way=one_way, travel=travel, fit=fit,
            periods=periods,
            refusal=lambda each: shared.refusal(target, each.in_units(unit), options, steepest),
        )  # fmt: skip
        built = build_from(survey, recipe)
        table = built.table.in_units(unit)
        try:
            written = shared.written(table, target, options, OWN_OPTIONS, steepest)
        except TabFileError:
            _print_doubts(survey)
            raise
        # in which order both lists stand is known here, for they come from the readings
        lints = tuple(lint for lint in written.again.lints if lint.code != "L3")
        again = replace(written.again, lints=lints)
        written = replace(written, again=again)
        notes = [
            *built.notes,
            *notes_of(survey, counts_per_unit, lead=longest(periods)),
            *_one_curve(table, again, target.name),
            *shared.steep_notes(again.table),
        ]
        result = written.result
        shared.write_file(out, result.text, force=force, encoding=result.encoding)
    found = _BuiltTable(
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
    if json:
        print_json(found.as_data())
    else:
        found.show()


@dataclass(frozen=True, slots=True)
class _BuiltTable:
    """A new table, and what it is predicted to leave."""

    out: Path
    notes: list[str]
    written: shared.WrittenTable
    before: Evaluation
    predicted: Evaluation
    left_out: LeftOut | None
    survey: Survey
    evidence: "Evidence | None"
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

    def show(self) -> None:
        """Print it for a person."""
        print_lines((f"note: {note}" for note in self.notes), err=True)
        print_lines(self.written.lines(self.out))
        results_text(self.before, self.predicted, ("before", PREDICTED), left_out=self.left_out)


def _print_doubts(survey: Survey) -> None:
    """Print what looks wrong about readings that make no table: perhaps it says why."""
    print_lines((f"note: {doubt}" for doubt in doubts_of(survey.readings, survey.units)), err=True)


def _one_curve(table: CorrectionTable, again: LoadedTable, name: str) -> list[str]:
    """Name a format that takes the mean of both directions: what was 0 at home is so no more."""
    if table.is_unidirectional or not again.table.is_unidirectional:
        return []
    return [
        f"{name} holds one curve, here the mean of both directions: --one-way makes one that is 0 at home"
    ]


def _letter(axis: str | None) -> str | None:
    return axis if axis is not None and len(axis) == 1 and axis.isalpha() else None
