"""``pitch-gateway table evaluate``: accuracy and repeatability after ISO 230-2, before and after."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gateway.cli import readings_options as given
from gateway.cli.options import takes_options
from gateway.cli.output import Format, StderrLine, show
from gateway.cli.table_options import AsJson, Counts, ReadOptions
from gateway.cli.table_output import PLAIN_WIDTH, PREDICTED, results_lines
from gateway.cli.table_reading import inspect, problems
from gateway.metrology.doubts import json_of, notes_of
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, results_json
from gateway.metrology.evaluation import evaluate as iso_230_2
from gateway.metrology.lead import Period, longest
from gateway.metrology.outliers import find_outliers
from gateway.metrology.readings import Survey, check_same_axis, check_uncorrected, understood, was_corrected
from gateway.metrology.residue import LeftOut, predicted_json, predicted_residue
from gateway.metrology.uncertainty import budget_of, inputs_of, limit_json, limit_line
from gateway.metrology.vdi_3441 import vdi_json, vdi_line
from gateway.metrology.wrong_runs import settled
from gateway.report.axis_data import AxisData, Report
from gateway.report.findings import find, other_stretch
from gateway.tabfile import LoadedTable

if TYPE_CHECKING:
    from rich.console import RenderableType

NO_PREDICTION: Final = "what another table would leave cannot be told from it; evaluate it without a table"


@dataclass(frozen=True, slots=True)
class EvaluateOptions:
    """What readings are judged beside, and by what."""

    after: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="READINGS2", help="Readings with a table in use; again for more.", readable=False
        ),
    ] = None
    table: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Predict what this table leaves of READINGS.", readable=False),
    ] = None
    source: ReadOptions = field(default_factory=ReadOptions)
    readings: given.FormatOptions = field(default_factory=given.FormatOptions)
    screw: given.ScrewOptions = field(default_factory=given.ScrewOptions)
    counts_per_unit: Counts = None
    vdi: Annotated[bool, typer.Option("--vdi-3441", help="Show P, Ps, Pa and U after VDI/DGQ 3441 too.")] = (
        False
    )
    limit: Annotated[
        float | None,
        typer.Option("--limit", help="In µm (arcsec): say whether A keeps it, with the uncertainty."),
    ] = None
    u_instrument: Annotated[
        float,
        typer.Option("--u-instrument", help="Of the instrument over the length, k = 2, in µm (arcsec)."),
    ] = 0.0
    u_alignment: Annotated[
        float,
        typer.Option("--u-alignment", help="How far gantry or scale leave the axis over its length, in mm."),
    ] = 0.0
    u_temperature: Annotated[
        float,
        typer.Option("--u-temperature", help="Range in which the temperature of the screw lies, in K."),
    ] = 0.0
    u_environment: Annotated[
        float, typer.Option("--u-environment", help="What an hour of a drift test shows, in µm (arcsec).")
    ] = 0.0
    report: Annotated[
        Path | None,
        typer.Option(metavar="OUT", help="Write a report: .html, .png or .svg.", readable=False),
    ] = None
    force: Annotated[bool, typer.Option("--force", help="Overwrite the report.")] = False


@takes_options
def evaluate(
    readings: given.ReadingFiles,
    *,
    options: EvaluateOptions,
    json: AsJson = False,
) -> None:
    """Judge an axis by the formulas of ISO 230-2: A, R, E, M and B, for each direction and both.

    With --after it stands beside a second measurement, with --table beside what that table would leave of
    READINGS: at the targets, to first order, and between them, by leaving targets out. A result that the
    readings do not carry is not shown: one run has no scatter, one direction no reversal.

    Examples:
      pitch-gateway table evaluate before.csv --after after.csv

      pitch-gateway table evaluate laser.rtl --table cnc10x.tab --travel 0 500
    """
    if options.after and options.table is not None:
        raise typer.BadParameter(
            "either a measurement or a prediction, not both", param_hint="--after, --table"
        )
    with problems():
        found = _judged(readings, options, is_quiet=json)
    show(found, Format.INDENTED if json else Format.TEXT, plain_width=PLAIN_WIDTH)


def _judged(files: list[Path], options: EvaluateOptions, *, is_quiet: bool) -> "_Judged":
    """Judge readings, and write the report if one is asked for.

    Raises:
        TabFileError, MetrologyError, ReportError: see there.
    """
    context = options.readings.context(options.source.units, options.source.axis)
    screw = options.screw
    before = settled(given.read_all(files, context, screw, is_quiet=is_quiet))
    loaded = None
    second = None
    if options.after:
        second = given.read_all(options.after, context, screw, is_quiet=is_quiet)
        second = settled(second.in_units(before.units))
        check_same_axis(before.source, before.axis, second.source, second.axis)
    if options.table is not None:
        loaded = inspect(options.table, options.source.context())
        check_same_axis(before.source, before.axis, options.table.name, loaded.source.axis)
        check_uncorrected(before.source, before.facts, NO_PREDICTION)
        second = predicted_residue(before, loaded.table)
    results = (iso_230_2(before), iso_230_2(second) if second else None)
    notes = _all_notes((before, second), results, is_predicted=loaded is not None)
    periods = screw.periods(before)
    longest_period, has_scale = longest(periods), not was_corrected(before.facts)
    notes = (*notes, *notes_of(before, options.counts_per_unit, with_scale=has_scale, lead=longest_period))
    if second is not None and loaded is None:
        notes = (*notes, *(f"after: {note}" for note in notes_of(second, with_scale=False)))
    left_out = None
    if loaded is not None:
        left_out, warnings = _between(before, loaded, periods)
        notes = (*notes, *warnings)
    last = results[1] if results[1] is not None and loaded is None else results[0]
    by_others, extra = _by_others(last, options)
    if options.report is not None:
        axis_data = replace(_axis_data(before, second, loaded, (*notes, *by_others)), left_out=left_out)
        _write_report(options.report, axis_data, force=options.force)
    return _Judged(
        before,
        results,
        notes,
        is_predicted=loaded is not None,
        left_out=left_out,
        by_others=by_others,
        more=extra,
        lead=longest_period,
        report=options.report,
    )


def _by_others(last: Evaluation, options: EvaluateOptions) -> tuple[tuple[str, ...], dict[str, object]]:
    """Return what VDI/DGQ 3441 says, and whether a limit is kept: as lines, and as plain data."""
    lines, data = [], dict[str, object]()
    if options.vdi:
        lines.append(vdi_line(last))
        data["vdi_3441"] = vdi_json(last)
    if options.limit is not None:
        inputs = inputs_of(
            last,
            options.u_instrument,
            options.u_alignment,
            options.u_temperature,
            options.u_environment,
        )
        budget = budget_of(last, inputs)
        lines.append(limit_line(last, budget, options.limit))
        data["conformity"] = limit_json(last, budget, options.limit)
    return tuple(lines), data


@dataclass(frozen=True, slots=True)
class _Judged:
    """What readings say of an axis, and what a second measurement or a prediction says beside it."""

    survey: Survey
    results: tuple[Evaluation, Evaluation | None]
    notes: tuple[str, ...]
    is_predicted: bool
    left_out: LeftOut | None
    by_others: tuple[str, ...]
    """By other standards, and whether a limit is kept."""
    more: dict[str, object]
    """The same for a program."""
    lead: float | None
    """The longest length after which the error may repeat."""
    report: Path | None

    def as_data(self) -> dict[str, object]:
        """Return it as plain data."""
        before, after = self.results
        shown = None if after is None else results_json(after)
        if shown is not None and self.is_predicted and after is not None:
            shown |= predicted_json(after, self.left_out)
        return {
            "readings": self.survey.source,
            "understood": understood(self.survey),
            **self.more,
            **json_of(self.survey, self.lead),
            "before": results_json(before),
            "after": shown,
            "is_predicted": self.is_predicted,
            "notes": list(self.notes),
        }

    def lines(self) -> "Iterator[RenderableType]":
        """Yield it for a person."""
        yield from (StderrLine(f"note: {note}") for note in self.notes)
        first = "measured" if self.results[1] is None else "before"
        titles = (first, PREDICTED if self.is_predicted else "after")
        yield from results_lines(*self.results, titles, left_out=self.left_out)
        yield from self.by_others
        if self.report is not None:
            yield f"report: {self.report}"


def _between(
    survey: Survey, loaded: LoadedTable, periods: tuple[Period, ...]
) -> tuple[LeftOut | None, tuple[str, ...]]:
    """Return E that a table will leave between the targets, and what they do not show."""
    from gateway.metrology.fitting import warnings_of
    from gateway.metrology.screw import screw_of

    try:
        screw = screw_of(survey.readings, survey.units, periods)
    except ReadingsError as error:
        return None, (f"{error}: nothing is said about what the table leaves between its points",)
    return screw.left_out(loaded.table), warnings_of(screw)


def _all_notes(
    surveys: tuple[Survey, Survey | None],
    results: tuple[Evaluation, Evaluation | None],
    *,
    is_predicted: bool,
) -> tuple[str, ...]:
    """Return what is odd about both; of a survey that was predicted only what the first does not say."""
    before, after = surveys
    notes = _notes(before, None if is_predicted else after)
    if is_predicted and after is not None:
        notes = (*notes, *(remark for remark in after.remarks if remark not in before.remarks))
    if results[1] is not None and (other := other_stretch(results[0], results[1])):
        notes = (*notes, f"measured {other}")
    return notes


def _notes(before: Survey, after: Survey | None) -> tuple[str, ...]:
    notes: list[str] = []
    for survey in filter(None, (before, after)):
        notes.extend(survey.remarks)
        unit = survey.units.value
        notes.extend(f"{survey.source}: outlier: {each.describe(unit)}" for each in find_outliers(survey))
    if after is not None and after.readings == before.readings:
        notes.append(f"{after.source}: the same readings as {before.source}: nothing was measured in between")
    elif after is not None and was_corrected(before.facts) and was_corrected(after.facts) is False:
        notes.append(
            f"{before.source} was measured with a table and {after.source} without: exchange them, --after "
            "is what was measured last"
        )
    return tuple(notes)


def _axis_data(
    before: Survey, after: Survey | None, loaded: LoadedTable | None, notes: tuple[str, ...]
) -> AxisData:
    # What holds of one of two surveys only, as whether the compensation was on, is no fact of both.
    facts = {k: v for k, v in before.facts.items() if after is None or after.facts.get(k) == v}
    if loaded is not None:
        facts |= {"table": loaded.file, "table SHA-256": loaded.sha256}
    named = (before.axis, after.axis if after else None, loaded.source.axis if loaded else None)
    return AxisData(
        axis=next(filter(None, named), ""),
        units=before.units,
        table=loaded.table.in_units(before.units) if loaded else None,
        before=before,
        after=after,
        is_predicted=loaded is not None,
        facts=facts,
        notes=notes,
    )


def _write_report(path: Path, axis_data: AxisData, *, force: bool) -> None:
    from gateway.report.writing import write_report

    made_at = datetime.now(UTC).astimezone().isoformat(sep=" ", timespec="minutes")
    write_report(Report(f"Accuracy of {find(axis_data).named}", (axis_data,), made_at), path, force=force)
