"""A correction table from readings without one, as a file."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from gateway.commissioning.table_options import (
    AxisLetter,
    Counts,
    Force,
    FormatOptions,
    Home,
    MaxSlope,
    OutOptions,
    ShapeOptions,
    StatedOptions,
    steep_allowed,
    writable_names,
)
from gateway.commissioning.tables import WrittenTable, refusal, steep_notes, written_table
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.doubts import json_of, notes_of, plausibility_warnings
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate, results_json
from gateway.metrology.lead import longest
from gateway.metrology.readings import Survey, check_uncorrected, understood
from gateway.metrology.recipe import Built, Recipe, build_from, from_one_zero
from gateway.metrology.residue import LeftOut, predicted_json, predicted_residue
from gateway.metrology.scale import check_scale
from gateway.options import Option, Options
from gateway.plain import JsonObject
from gateway.tabfile import LoadedTable, TabFileError, axis_of_name, dialect_named

if TYPE_CHECKING:
    from gateway.metrology.band import Band
    from gateway.metrology.fitting import FitEvidence
    from gateway.metrology.next_reading import Advice

OWN_OPTIONS: Final = {
    "--to-axis": "--axis",
    "--resample STEP": "--step STEP, or a format with positions of its own",
}
"""Names here for some options of ``table convert``."""


@dataclass(frozen=True, slots=True)
class BuildOptions(Options):
    """Options for making a table from readings."""

    to: Annotated[
        str,
        Option(
            "Format of OUT; pitch-gateway table formats lists all.", metavar="FORMAT", one_of=writable_names
        ),
    ] = "centroid-2"
    home: Home = None
    step: Annotated[float | None, Option("Even grid: multiples of this distance.")] = None
    travel: Annotated[
        tuple[float, float] | None,
        Option("Range of the even grid; beyond the targets the end value is held.", metavar="LO HI"),
    ] = None
    tolerance: Annotated[float | None, Option("Use the fewest targets that lose no more than this.")] = None
    smooth: Annotated[
        float | None, Option("Smooth over this length, and say how much that changes.", metavar="WINDOW")
    ] = None
    drop_outliers: Annotated[bool, Option("Leave out outliers, and runs that are wrong as a whole.")] = False
    drop_noise: Annotated[
        bool, Option("Make 0 of each correction that is smaller than its own uncertainty.")
    ] = False
    shape: ShapeOptions = field(default_factory=ShapeOptions)
    stated: StatedOptions = field(default_factory=StatedOptions)
    keep_scale: Annotated[
        bool, Option("Make the table even if the readings are wrong by more than 0.3 mm/m.")
    ] = False
    max_slope: MaxSlope = None
    counts_per_unit: Counts = None
    axis: AxisLetter = None
    units: Annotated[Units | None, Option("Units of readings that state none.")] = None
    to_units: Annotated[Units | None, Option("Units of OUT; default: those of the readings.")] = None
    out: OutOptions = field(default_factory=OutOptions)
    readings: FormatOptions = field(default_factory=FormatOptions)
    force: Force = False


def build(survey: Survey, out: Path, options: BuildOptions) -> "BuiltTable":
    """Make a table from readings and write it to ``out``.

    Raises:
        TabFileError, MetrologyError, TableError: no table can be made, or ``out`` cannot be written. The
            notes of the error name what looks wrong in the readings, as a possible reason.
    """
    check_uncorrected(survey.source, survey.facts, "table refine adds it to that table")
    periods = options.shape.screw.periods(survey)
    options.stated.inputs(survey)  # what is wrong in it is said before a file is written
    survey, screw = from_one_zero(survey, periods, drop=options.drop_outliers)
    if not options.keep_scale:
        try:
            check_scale(survey, options.counts_per_unit, longest(periods))
        except ReadingsError as error:
            _add_warnings(error, survey)
            raise
    target = dialect_named(options.to)
    writing = options.out.writing(options.axis or _letter(survey.axis) or axis_of_name(out.name))
    unit = options.to_units or survey.units
    steepest = steep_allowed(survey, options.max_slope)
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
    built = build_from(survey, recipe, screw)
    found = built.table
    if options.drop_noise:
        found = _without_noise(built, options.stated.band(built.screw, found, built.home, survey), survey)
    table = found.in_units(unit)
    try:
        written = written_table(table, target, writing, steepest, OWN_OPTIONS)
    except TabFileError as error:
        _add_warnings(error, survey)
        raise
    # The order of both lists is known here, because they come from the readings.
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
    in_force, screw = again.table.in_units(survey.units), built.screw
    left_out = advice = None
    if screw is not None:
        from gateway.metrology.next_reading import advice_of

        left_out = screw.left_out(in_force)
        advice = advice_of(screw, in_force, left_out)
    return BuiltTable(
        out,
        tuple(notes),
        written,
        before=evaluate(survey),
        predicted=evaluate(predicted_residue(survey, again.table)),
        left_out=left_out,
        band=options.stated.band(screw, in_force, built.home, survey),
        advice=advice,
        survey=survey,
        evidence=built.evidence,
        lead=longest(periods),
    )


@dataclass(frozen=True, slots=True)
class BuiltTable:
    """A new table, and what it is predicted to leave."""

    out: Path
    notes: tuple[str, ...]
    written: WrittenTable
    before: Evaluation
    predicted: Evaluation
    left_out: LeftOut | None
    band: "Band | None"
    """The uncertainty of its corrections; None: the readings do not tell it."""
    advice: "Advice | None"
    """What another reading would bring; None: the readings do not tell it."""
    survey: Survey
    evidence: "FitEvidence | None"
    lead: float | None
    """The longest possible period of the error."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        again = self.written.again
        return {
            "out": str(self.out),
            "to": again.format,
            "units": again.table.units.value,
            "points": len(again.table.positions),
            "notes": list(self.notes),
            **self.written.as_data(),
            "before": results_json(self.before),
            "predicted": {**results_json(self.predicted), **predicted_json(self.predicted, self.left_out)},
            "uncertainty": None if self.band is None else self.band.as_data(again.table),
            "measure_next": None if self.advice is None else self.advice.as_data(),
            "fit": None if self.evidence is None else self.evidence.as_data(),
            "understood": understood(self.survey),
            **json_of(self.survey, self.lead),
        }


def _without_noise(built: Built, band: "Band | None", survey: Survey) -> CorrectionTable:
    """Return the table without corrections that are noise. Raises ReadingsError: nothing tells which."""
    if band is None:
        raise ReadingsError(f"{survey.source}: remove --drop-noise: these readings do not tell what is noise")
    from gateway.metrology.band import without_noise

    return without_noise(built.table, band)


def _add_warnings(error: Exception, survey: Survey) -> None:
    for warning in plausibility_warnings(survey.readings, survey.units):
        error.add_note(warning)


def _one_curve(table: CorrectionTable, again: LoadedTable, name: str) -> list[str]:
    """Name a format that uses the mean of both directions: the correction at home is then no longer 0."""
    if table.is_unidirectional or not again.table.is_unidirectional:
        return []
    return [
        f"{name} holds one curve, here the mean of both directions: --one-way makes one that is 0 at home"
    ]


def _letter(axis: str | None) -> str | None:
    return axis if axis is not None and len(axis) == 1 and axis.isalpha() else None
