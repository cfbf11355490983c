"""Readings evaluated by ISO 230-2, beside a second measurement or the prediction for a table."""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from gateway.commissioning.table_options import (
    Counts,
    FormatOptions,
    ReadOptions,
    ScrewOptions,
    StatedOptions,
)
from gateway.compensation.table import CorrectionTable
from gateway.metrology.build import home_of
from gateway.metrology.doubts import json_of, notes_of
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate, results_json
from gateway.metrology.lead import Period, longest
from gateway.metrology.outliers import find_outliers
from gateway.metrology.readings import Survey, check_same_axis, check_uncorrected, understood, was_corrected
from gateway.metrology.residue import LeftOut, predicted_json, predicted_residue
from gateway.metrology.uncertainty import budget_of, limit_json, limit_line
from gateway.metrology.vdi_3441 import vdi_json, vdi_line
from gateway.options import Option, Options
from gateway.plain import JsonObject
from gateway.report.axis_data import AxisData, Report
from gateway.report.findings import find, other_stretch
from gateway.tabfile import LoadedTable

if TYPE_CHECKING:
    from gateway.metrology.band import Band
    from gateway.metrology.next_reading import Advice
    from gateway.metrology.screw import MeasuredScrew

NO_PREDICTION: Final = "evaluate it without a table: it cannot show what another table would leave"


@dataclass(frozen=True, slots=True)
class EvaluateOptions(Options):
    """What readings are compared with, and by which standards."""

    after: Annotated[
        list[Path] | None,
        Option(
            "Readings with a table in use; repeat it for more files.", metavar="READINGS2", is_read_by_us=True
        ),
    ] = None
    table: Annotated[
        Path | None,
        Option("Predict the error that this table leaves of READINGS.", metavar="FILE", is_read_by_us=True),
    ] = None
    source: ReadOptions = field(default_factory=ReadOptions)
    readings: FormatOptions = field(default_factory=FormatOptions)
    screw: ScrewOptions = field(default_factory=ScrewOptions)
    counts_per_unit: Counts = None
    vdi: Annotated[bool, Option("Also show P, Ps, Pa and U of VDI/DGQ 3441.", "vdi-3441")] = False
    limit: Annotated[
        float | None, Option("In µm (arcsec): say whether A is within it, with the uncertainty.")
    ] = None
    stated: StatedOptions = field(default_factory=StatedOptions)
    report: Annotated[
        Path | None, Option("Write a report: .html, .png or .svg.", metavar="OUT", is_read_by_us=True)
    ] = None
    force: Annotated[bool, Option("Overwrite the report.")] = False


def judge(
    before: Survey,
    after: Survey | None,
    loaded: LoadedTable | None,
    options: EvaluateOptions,
    screw: "MeasuredScrew | None" = None,
) -> "Judged":
    """Evaluate readings, and write the report if requested.

    Args:
        before: the readings, settled (``metrology.wrong_runs``).
        after: a second measurement, settled, in the same units; it excludes a table.
        loaded: the table whose effect on the readings is predicted.
        options: the other options; the files that they name are these.
        screw: the curves of the readings, if they were joined from differences.

    Raises:
        MetrologyError, ReportError: see the called functions.
    """
    second = after
    if second is not None:
        check_same_axis(before.source, before.axis, second.source, second.axis)
    if loaded is not None:
        check_same_axis(before.source, before.axis, Path(loaded.file).name, loaded.source.axis)
        check_uncorrected(before.source, before.facts, NO_PREDICTION)
        second = predicted_residue(before, loaded.table)
    results = (evaluate(before), evaluate(second) if second else None)
    notes = _all_notes((before, second), results, is_predicted=loaded is not None)
    periods = options.screw.periods(before)
    period, has_scale = longest(periods), not was_corrected(before.facts)
    notes = (*notes, *notes_of(before, options.counts_per_unit, with_scale=has_scale, lead=period))
    if after is not None:
        notes = (*notes, *(f"after: {note}" for note in notes_of(after, with_scale=False)))
    left_out = band = advice = None
    if loaded is not None:
        screw, warnings = _between(before, periods, screw)
        notes = (*notes, *warnings)
        table = loaded.table.in_units(before.units)
        if screw is not None:
            from gateway.metrology.next_reading import advice_of

            left_out = screw.left_out(table)
            advice = advice_of(screw, table, left_out)
        band = options.stated.band(screw, table, home_of(table), before)
    last = results[1] if results[1] is not None and loaded is None else results[0]
    by_others, more = _by_others(before, last, options)
    if options.report is not None:
        uncertain = [] if band is None or loaded is None else band.described(loaded.table)
        uncertain += [] if advice is None else [advice.describe()]
        axis_data = _axis_data(before, second, loaded, (*notes, *by_others, *uncertain))
        axis_data = replace(axis_data, left_out=left_out, band=band)
        _write_report(options.report, axis_data, force=options.force)
    return Judged(
        before,
        results,
        notes,
        is_predicted=loaded is not None,
        left_out=left_out,
        table=None if loaded is None else loaded.table,
        band=band,
        advice=advice,
        by_others=by_others,
        more=more,
        lead=period,
        report=options.report,
    )


@dataclass(frozen=True, slots=True)
class Judged:
    """The results of readings of an axis, and of a second measurement or a prediction beside it."""

    survey: Survey
    results: tuple[Evaluation, Evaluation | None]
    notes: tuple[str, ...]
    is_predicted: bool
    left_out: LeftOut | None
    table: CorrectionTable | None
    """The one whose effect is predicted."""
    band: "Band | None"
    """Its uncertainty; None: unknown, or no table."""
    advice: "Advice | None"
    """What another reading would bring; None: unknown, or no table."""
    by_others: tuple[str, ...]
    """Results of other standards, and whether a limit is kept."""
    more: JsonObject
    """The same for a program."""
    lead: float | None
    """The longest possible period of the error."""
    report: Path | None

    def as_data(self) -> JsonObject:
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
            "uncertainty": None if self.band is None or self.table is None else self.band.as_data(self.table),
            "measure_next": None if self.advice is None else self.advice.as_data(),
            "notes": list(self.notes),
        }


def _by_others(
    survey: Survey, last: Evaluation, options: EvaluateOptions
) -> tuple[tuple[str, ...], JsonObject]:
    """Return the results of VDI/DGQ 3441, and whether a limit is kept: as lines, and as plain data."""
    lines, data = [], JsonObject()
    if options.vdi:
        lines.append(vdi_line(last))
        data["vdi_3441"] = vdi_json(last)
    if options.limit is not None:
        budget = budget_of(last, options.stated.inputs(survey))
        lines.append(limit_line(last, budget, options.limit))
        data["conformity"] = limit_json(last, budget, options.limit)
    return tuple(lines), data


def _between(
    survey: Survey, periods: tuple[Period, ...], screw: "MeasuredScrew | None"
) -> tuple["MeasuredScrew | None", tuple[str, ...]]:
    """Return the curves that the readings allow, and what the targets do not show."""
    from gateway.metrology.fitting import warnings_of
    from gateway.metrology.screw import screw_of

    try:
        screw = screw or screw_of(survey.readings, survey.units, periods)
    except ReadingsError as error:
        return None, (f"{error}: the error that the table leaves between its points is unknown",)
    return screw, warnings_of(screw)


def _all_notes(
    surveys: tuple[Survey, Survey | None],
    results: tuple[Evaluation, Evaluation | None],
    *,
    is_predicted: bool,
) -> tuple[str, ...]:
    """Return what is odd about both; a predicted survey adds only what the first does not have."""
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
        notes.append(f"{after.source}: the same readings as {before.source}: measure again, then compare")
    elif after is not None and was_corrected(before.facts) and was_corrected(after.facts) is False:
        notes.append(
            f"exchange {before.source} and {after.source}: the first was measured with a table, the second "
            "without; --after is the later measurement"
        )
    return tuple(notes)


def _axis_data(
    before: Survey, after: Survey | None, loaded: LoadedTable | None, notes: tuple[str, ...]
) -> AxisData:
    # A fact of one survey only, such as whether the compensation was on, is not a fact of both.
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
