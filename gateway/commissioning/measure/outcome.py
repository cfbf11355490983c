"""The results of a whole run: ISO 230-2, a table, the changes, a report."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Final

from gateway.commissioning.measure.errors import FileError, MeasureError
from gateway.commissioning.table_options import ScrewOptions, StatedOptions
from gateway.compensation.backlash import with_backlash
from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.direction import Direction
from gateway.compensation.errors import TableError
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.config.axis_model import AxisSection
from gateway.config.tables import context_of, write_options_of
from gateway.exchange.plan import AxisPlan
from gateway.metrology.build import Fit, HomeReference
from gateway.metrology.doubts import notes_of
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate, results_json
from gateway.metrology.formats.context import ReadingsContext
from gateway.metrology.formats.load import is_readings, read_survey
from gateway.metrology.lead import Period, longest
from gateway.metrology.readings import Survey, check_uncorrected, small_unit
from gateway.metrology.recipe import Built, Recipe, build_from, from_one_zero
from gateway.metrology.refine import Refined, refine_table
from gateway.metrology.resample import grid_positions
from gateway.metrology.residue import LeftOut, left_out_json, left_out_line, left_out_text, predicted_residue
from gateway.metrology.scale import reliable_scale
from gateway.plain import JsonObject
from gateway.tabfile import DIALECTS, TabFileError, Written, dialect_named, parse_table
from gateway.tabfile.conversion import reader_lines, write

if TYPE_CHECKING:
    from gateway.metrology.band import Band
    from gateway.metrology.next_reading import Advice

FALLBACK_FORMATS: Final = ("csv", "centroid-3")
SMALL: Final = {Units.MM: (1000.0, "µm"), Units.INCH: (10_000.0, "tenths (0.0001 inch)")}


@dataclass(frozen=True, slots=True)
class ChangeFromActive:
    """The largest difference of a new table from the active one, in units of the axis: new less old."""

    position: float
    direction: Direction
    amount: float


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """All results of a whole run."""

    survey: Survey
    evaluation: Evaluation
    table: CorrectionTable
    is_refined: bool
    change: ChangeFromActive | None = None
    """None: no table was in use before."""
    notes: tuple[str, ...] = field(default=())
    active: CorrectionTable | None = None
    """The table in use during the run, including the backlash setting; None if there was none."""
    left_out: LeftOut | None = None
    """E that the new table will leave between the targets, predicted by leaving out; None: unknown."""
    band: "Band | None" = None
    """The uncertainty of the new table's corrections; None: unknown."""
    advice: "Advice | None" = None
    """What another reading would bring; None: the readings do not tell it."""

    def as_data(self) -> JsonObject:
        """Return the results for a program, in units of the axis."""
        table, change = self.table, self.change
        return {
            "units": self.survey.units.value,
            "results": results_json(self.evaluation),
            "predicted": left_out_json(self.survey.units, self.left_out),
            "uncertainty": None if self.band is None else self.band.as_data(table),
            "measure_next": None if self.advice is None else self.advice.as_data(),
            "table": {
                "positions": list(table.positions),
                "forward": list(table.forward),
                "backward": list(table.backward),
                "refined": self.is_refined,
            },
            "change": None
            if change is None
            else {
                "position": change.position,
                "direction": change.direction.name.lower(),
                "amount": change.amount,
            },
            "notes": list(self.notes),
        }

    def lines(self) -> Iterator[str]:
        """Yield sentences beside the figures: what changes, what does not, notes."""
        change = self.change
        if change is not None:
            factor, unit = SMALL[self.survey.units]
            yield (
                f"against the active table: the largest change is {change.amount * factor:+.2f} {unit} "
                f"at {change.position:.9g} {self.survey.units.value}, {change.direction.name.lower()}"
            )
        if self.left_out is not None:
            yield left_out_line(self.evaluation, self.left_out)
        yield from self.uncertain()
        yield from self.notes

    def uncertain(self) -> list[str]:
        """Return sentences about the uncertainty of the new table, and about another reading."""
        found = [] if self.band is None else self.band.described(self.table, is_refined=self.is_refined)
        return found if self.advice is None else [*found, self.advice.describe()]


def outcome_of(
    survey: Survey,
    axis: AxisPlan,
    *,
    is_active: bool,
    periods: tuple[Period, ...] = (),
    step: float | None = None,
    refusal: Callable[[CorrectionTable], str | None] | None = None,
) -> RunOutcome:
    """Evaluate the readings and make a table, along the curve that leaves least between targets.

    ``periods`` are the possible periods of the error. ``step`` requests an even grid over the travel, for a
    new table. ``refusal`` returns why a table cannot be written.

    Raises:
        MeasureError: the readings make no table.
    """
    notes: list[str] = []
    active = axis.table
    if active is not None and axis.settings.backlash is not None:
        active = with_backlash(active, axis.settings.backlash)
        notes.append("remove the key backlash when you use the new table: it contains the backlash")
    screw = None
    if survey.standard is not None:
        try:
            survey, screw = from_one_zero(survey, periods)
        except ReadingsError as error:
            raise MeasureError(str(error)) from None
    longest_period = longest(periods)
    notes += notes_of(survey, axis.settings.counts_per_unit, with_scale=not is_active, lead=longest_period)
    if not is_active and (scale := reliable_scale(survey, longest_period)) and scale.is_large:
        notes.append(
            "correct the scale first and measure again: more than 0.3 mm/m is a wrong scale, not a screw "
            "error"
        )
    try:
        evaluation = evaluate(survey)
        if is_active:
            assert active is not None
            refined = refine_table(
                active, survey, home=_home(axis, survey), fit=Fit.AUTO, periods=periods, refusal=refusal
            )
            done: Refined | Built = refined
            left_out = refined.left_out
            screw, judged, home = refined.screw, refined.added, _home(axis, survey)
        else:
            recipe = Recipe(
                home=_home(axis, survey, is_over_travel=step is not None),
                fit=Fit.AUTO,
                periods=periods,
                refusal=refusal,
                step=step,
                travel=axis.settings.travel if step is not None else None,
                widen="give a --table-step that divides both ends",
            )
            built = done = build_from(survey, recipe, screw)
            screw, judged, home = built.screw, built.table, built.home
            left_out = None if screw is None else screw.left_out(built.table)
        band = advice = None
        if screw is not None and judged is not None:
            from gateway.metrology.next_reading import advice_of

            band = StatedOptions().band(screw, judged, home, survey)
            advice = advice_of(screw, judged, left_out)
    except (ReadingsError, TableError) as error:
        raise MeasureError(str(error)) from None
    change = None if active is None else largest_change(active, done.table, axis)
    used = active if is_active else None
    return RunOutcome(
        survey, evaluation, done.table, is_active, change, (*done.notes, *notes), used, left_out, band,
        advice,
    )  # fmt: skip


def largest_change(old: CorrectionTable, new: CorrectionTable, axis: AxisPlan) -> ChangeFromActive:
    """Return the largest difference of two tables, at the points of both."""
    specs = [spec_of_table(table, axis.settings) for table in (old, new)]
    positions = sorted({*old.positions, *new.positions})
    changes = [
        ChangeFromActive(position, direction, after - before)
        for position in positions
        for direction, share in ((Direction.FORWARD, 1.0), (Direction.BACKWARD, 0.0))
        for before, after in [[spec.map_at(share).correction(position) for spec in specs]]
    ]
    return max(changes, key=lambda change: abs(change.amount))


def _home(axis: AxisPlan, survey: Survey, *, is_over_travel: bool = False) -> HomeReference | None:
    """Return the zero of the correction: machine position 0, in the direction of homing, if in the table."""
    reach = [reading.target for reading in survey.readings]
    if is_over_travel and axis.settings.travel is not None:
        reach += axis.settings.travel
    if not axis.settings.home_approach or not min(reach) <= 0.0 <= max(reach):
        return None
    return HomeReference(0.0, Direction(axis.settings.home_approach))


def check_format(given: str | None, axis: AxisPlan) -> str:
    """Return the dialect for the new table. Raises FileError: no dialect has that name."""
    names = [dialect.name for dialect in DIALECTS]
    if given is not None:
        if given not in names:
            raise FileError(f"--out-format {given}: allowed are {', '.join(names)}")
        return given
    return next(name for name in (axis.table_format, *FALLBACK_FORMATS) if name in names)


def check_outputs(out: Path | None, report: Path | None, *, force: bool) -> None:
    """Check before the run that the results can be written to their paths. Raises FileError."""
    if out is not None and out.exists() and not force:
        raise FileError(f"{out}: a file of this name exists; give a new name, or --force")
    if out is not None:
        _check_no_readings(out)
        if not out.parent.is_dir():
            raise FileError(f"{out}: make the folder {out.parent} first: it does not exist")
        try:
            TemporaryFile(dir=out.parent).close()
        except OSError as error:
            raise FileError(
                f"{out}: the folder {out.parent} cannot be written ({error.strerror}): give another path"
            ) from None
    if report is not None:
        from gateway.report.errors import ReportError
        from gateway.report.writing import check_path

        try:
            check_path(report, force=force)
        except ReportError as error:
            raise FileError(str(error)) from None


def _check_no_readings(out: Path) -> None:
    """Refuse to overwrite readings, even with ``--force``: they are irreplaceable. Raises FileError."""
    if is_readings(out):
        raise FileError(f"{out}: give another name for --out: this is a file of readings")


def check_writable(
    format_name: str, positions: Sequence[float], axis: AxisPlan, section: AxisSection
) -> None:
    """Check before the run that a dialect can hold a table of two directions at these positions.

    Raises:
        FileError: it cannot, or it needs more facts than there are options for.
    """
    least = abs(1.0 / axis.settings.counts_per_unit)
    forward, backward = [least] * len(positions), [-least] * len(positions)
    try:
        table = make_table(positions, forward, backward, axis.settings.units)
        dialect_named(format_name).write(table, write_options_of(section, axis.name, format_name))
    except (TabFileError, TableError) as error:
        raise FileError(
            f"--out: a table at {positions[0]:.9g} to {positions[-1]:.9g} cannot be written as {format_name}"
            f": {error}; give --table-step, an even grid over the travel, or another --out-format"
        ) from None


def is_writable(format_name: str, positions: Sequence[float], axis: AxisPlan, section: AxisSection) -> bool:
    """Whether :func:`check_writable` passes."""
    try:
        check_writable(format_name, positions, axis, section)
    except FileError:
        return False
    return True


def points_of(targets: Sequence[float], step: float | None, axis: AxisPlan) -> Sequence[float]:
    """Return the points of a new table: the targets, or the multiples of a step in the whole travel.

    Raises:
        FileError: a step with fewer than two multiples in the travel.
    """
    if step is None:
        return targets
    assert axis.settings.travel is not None, "check_range wants one"
    try:
        return grid_positions(step, axis.settings.travel, axis.settings.units)
    except ReadingsError as error:
        raise FileError(f"--table-step: {error}") from None


def refusal(format_name: str, table: CorrectionTable, axis: AxisPlan, section: AxisSection) -> str | None:
    """Return why a dialect or a limit of the axis forbids a table; None: neither does."""
    settings = axis.settings
    for key, found, limit in (
        ("max_correction", table.max_correction(), settings.max_correction),
        ("max_slope", table.max_slope(), settings.max_slope),
    ):
        if found > limit:
            return (
                f"{found:.4g} is above {key} = {limit:g} of axis {axis.name}: if this is right, raise the key"
            )
    try:
        dialect_named(format_name).write(table, write_options_of(section, axis.name, format_name))
    except TabFileError as error:
        allowed = f", allowed: {error.allowed}" if error.allowed else ""
        return f"this format does not hold it ({error.found}{allowed}); --out-format csv does"
    except TableError as error:
        return str(error)
    return None


def write_table(
    outcome: RunOutcome, out: Path, format_name: str, axis: AxisPlan, section: AxisSection, *, force: bool
) -> list[str]:
    """Write the table for the axis's ``table_options``; return what the user should know.

    Raises:
        FileError: the dialect cannot hold it, or the path cannot be written.
    """
    try:
        written = dialect_named(format_name).write(
            outcome.table, write_options_of(section, axis.name, format_name)
        )
        again = parse_table(written.text.encode(), str(out), written.context).table
        change = largest_change(outcome.table, again.in_units(outcome.table.units), axis)
        _check_no_readings(out)
        write(out, written.text, force=force, encoding=written.encoding)
    except (TabFileError, TableError) as error:
        command = "table refine" if outcome.is_refined else "table build"
        raise FileError(
            f"{error}; the readings are kept: make the table from them with pitch-gateway {command}, with "
            "another path or format"
        ) from None
    factor, unit = SMALL[outcome.table.units]
    return [
        f"{out}: {format_name}, {len(outcome.table.positions)} points",
        *(f"not in the file: {loss}" for loss in written.losses),
        *reader_lines(written, dialect_named(format_name)),
        *_as_configured(written, again, out, axis, section),
        f"largest difference of a correction after reading it back: {abs(change.amount) * factor:.3g} {unit}",
    ]


def _as_configured(
    written: Written, table: CorrectionTable, out: Path, axis: AxisPlan, section: AxisSection
) -> list[str]:
    """Return the problem if the axis's present configuration would read another table."""
    try:
        read = parse_table(written.text.encode(), str(out), context_of(section, axis.name)).table
        units = axis.settings.units
        change = largest_change(table.in_units(units), read.in_units(units), axis)
        if abs(change.amount) <= 0.5 * axis.settings.step:
            return []
        why = "they would change how it is read"
    except (TabFileError, TableError, ValueError) as error:
        why = str(error)
    return [f"change table_options in the configuration together with the table ({why})"]


def survey_of(path: Path, axis: AxisPlan) -> Survey:
    """Read a file of readings of the axis, in its units. Raises FileError."""
    try:
        survey = read_survey(path, ReadingsContext(axis=axis.name))
        return survey.in_units(axis.settings.units)
    except TabFileError as error:
        raise FileError(str(error)) from None
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None


def survey_before(path: Path, axis: AxisPlan) -> Survey:
    """Read the "before" readings of a report. Raises FileError: a table was in use already."""
    survey = survey_of(path, axis)
    try:
        if survey.standard is not None:
            survey, _ = from_one_zero(survey, ScrewOptions().periods(survey))
        check_uncorrected(
            str(path), survey.facts, "give with --before readings that were measured without a table"
        )
    except ReadingsError as error:
        raise FileError(str(error)) from None
    return survey


def _report_notes(outcome: RunOutcome) -> tuple[str, ...]:
    """Return the notes of the report; a refined table has no figures in it."""
    if not outcome.is_refined or outcome.left_out is None:
        return (*outcome.notes, *outcome.uncertain())
    left = left_out_text(small_unit(outcome.survey.units), outcome.left_out)
    advice = [] if outcome.advice is None else [outcome.advice.describe()]
    return (
        *outcome.notes,
        *advice,
        f"the next table, made from these readings, will leave between its points {left}",
    )


def write_report(outcome: RunOutcome, path: Path, axis: str, before: Survey | None, *, force: bool) -> None:
    """Write the report; ``before`` are readings of an earlier run, without a table. Raises FileError."""
    from gateway.report.axis_data import AxisData, Report
    from gateway.report.errors import ReportError
    from gateway.report.writing import write_report as write_file

    survey = outcome.survey
    if outcome.is_refined:
        # Readings with a table are shown beside that table, not beside the better one made from them.
        axis_data = AxisData(axis, survey.units, outcome.active, before, survey)
    else:
        after = predicted_residue(survey, outcome.table)
        axis_data = AxisData(
            axis, survey.units, outcome.table, survey, after, is_predicted=True, band=outcome.band
        )
    axis_data = replace(
        axis_data, facts=survey.facts, left_out=outcome.left_out, notes=_report_notes(outcome)
    )
    report = Report(f"Axis {axis}", (axis_data,), survey.facts.get("measured", ""))
    try:
        write_file(report, path, force=force)
    except ReportError as error:
        raise FileError(str(error)) from None
