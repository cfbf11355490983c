"""``pitch-gateway table evaluate``: accuracy and repeatability after ISO 230-2, before and after."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli import survey_files as shared
from gateway.cli.evaluation_output import results_json, results_text
from gateway.cli.table_options import AsJson, AxisLetter, FileCounts, FileHome, FileStart, Layout, Travel
from gateway.cli.table_output import print_json, print_lines
from gateway.metrology.evaluation import evaluate as iso_230_2
from gateway.metrology.formats import ReadingsContext
from gateway.metrology.outliers import find_outliers
from gateway.metrology.readings import Survey
from gateway.metrology.residue import predicted_residue
from gateway.report.story import AxisStory, Report
from gateway.tabfile import FileContext, LoadedTable


def evaluate(
    readings: shared.ReadingFiles,
    *,
    after: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="READINGS2", help="Readings with a table in use; again for more.", readable=False
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Predict what this table leaves of READINGS.", readable=False),
    ] = None,
    file_counts_per_unit: FileCounts = None,
    file_home: FileHome = None,
    file_start: FileStart = None,
    v1_layout: Layout = None,
    travel: Travel = None,
    axis: AxisLetter = None,
    units: shared.ReadingsUnits = None,
    readings_format: shared.ReadingsFormat = None,
    runs: shared.RunsTold = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="OUT", help="Write a report: .html, .png or .svg.", readable=False),
    ] = None,
    json: AsJson = False,
) -> None:
    """Judge an axis by the formulas of ISO 230-2: A, R, E, M and B, for each direction and both.

    With --after it stands beside a second measurement, with --table beside what that table would leave of
    READINGS, to first order. A result that the readings do not carry is not shown: one run has no scatter,
    one direction no reversal.

    Examples:
      pitch-gateway table evaluate before.csv --after after.csv

      pitch-gateway table evaluate laser.rtl --table cnc10x.tab --travel 0 500
    """
    if after and table is not None:
        raise typer.BadParameter(
            "either a measurement or a prediction, not both", param_hint="--after, --table"
        )
    with shared.problems():
        context = ReadingsContext(readings_format, units, axis, runs)
        before = shared.read_all(readings, context)
        loaded = None
        second = shared.read_all(after, context).in_units(before.units) if after else None
        if table is not None:
            told = FileContext(
                axis=axis,
                units=units,
                travel=travel,
                file_counts_per_unit=file_counts_per_unit,
                v1_layout=v1_layout,
                file_start=file_start,
                file_home=file_home,
            )
            loaded = shared.inspect_told(table, told)
            second = predicted_residue(before, loaded.table)
        first_results = iso_230_2(before)
        second_results = iso_230_2(second) if second else None
        notes = _notes(before, second if loaded is None else None)
        if report is not None:
            _write_report(report, _story(before, second, loaded, notes))
    if json:
        found: dict[str, object] = {
            "readings": before.source,
            "before": results_json(first_results),
            "after": results_json(second_results) if second_results else None,
            "is_predicted": loaded is not None,
            "notes": list(notes),
        }
        print_json(found)
        return
    print_lines((f"note: {note}" for note in notes), err=True)
    results_text(first_results, second_results, ("before", "after" if loaded is None else "predicted"))
    if report is not None:
        typer.echo(f"report: {report}")


def _notes(before: Survey, after: Survey | None) -> tuple[str, ...]:
    notes: list[str] = []
    for survey in filter(None, (before, after)):
        notes.extend(survey.remarks)
        unit = survey.units.value
        notes.extend(f"{survey.source}: outlier: {each.describe(unit)}" for each in find_outliers(survey))
    return tuple(notes)


def _story(
    before: Survey, after: Survey | None, loaded: LoadedTable | None, notes: tuple[str, ...]
) -> AxisStory:
    facts = dict(before.facts)
    if loaded is not None:
        facts |= {"table": loaded.file, "table SHA-256": loaded.sha256}
    return AxisStory(
        axis=before.axis or "axis",
        units=before.units,
        table=loaded.table.in_units(before.units) if loaded else None,
        before=before,
        after=after,
        is_predicted=loaded is not None,
        facts=facts,
        notes=notes,
    )


def _write_report(path: Path, story: AxisStory) -> None:
    from gateway.report.writing import write_report  # type: ignore[import-untyped, import-not-found, unused-ignore]

    made_at = datetime.now(UTC).astimezone().isoformat(sep=" ", timespec="minutes")
    write_report(Report(f"Accuracy of axis {story.axis}", (story,), made_at), path)
