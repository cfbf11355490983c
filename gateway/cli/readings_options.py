"""Readings that stand beside a table, for ``pitch-gateway table plot``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.output import print_lines
from gateway.compensation.table import CorrectionTable
from gateway.metrology.errors import MetrologyError
from gateway.report.story import AxisStory
from gateway.tabfile import TabFileError

if TYPE_CHECKING:
    from gateway.metrology.readings import Survey
    from gateway.metrology.residue import LeftOut

Readings = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="READINGS",
        help="Readings that were taken WITHOUT the table, drawn with what it would leave of them; "
        "again for more files.",
        readable=False,
    ),
]
ReadingsFormat = Annotated[
    str | None,
    typer.Option("--readings-format", metavar="NAME", help="Format of READINGS, where it is not plain."),
]
ReadingsRuns = Annotated[
    str | None,
    typer.Option(
        "--runs",
        metavar="alternate|forward|backward",
        help="Directions of the runs of a file that does not prove them.",
    ),
]


def _left_out(survey: "Survey", table: CorrectionTable) -> "LeftOut | None":
    """Return E that a table will leave between the targets; None where there are too few to tell."""
    from gateway.cli.survey_files import periods_of_readings
    from gateway.metrology.screw import LEAST_TARGETS, MOST_TARGETS, screw_of

    periods = periods_of_readings(survey, None, None)
    if not LEAST_TARGETS <= len({each.target for each in survey.readings}) <= MOST_TARGETS:
        return None
    return screw_of(survey.readings, survey.units, periods).left_out(table)


def with_readings(
    story: AxisStory, files: Sequence[Path], told_format: str | None, runs: str | None
) -> AxisStory:
    """Return the story of a table with readings before, and what the table is predicted to leave of them.

    Raises:
        BadParameter: ``runs`` is no way of making them.
        Exit: code 1, the files are no readings of this axis; each problem is a line on stderr.
    """
    from gateway.metrology.formats import (
        ReadingsContext,
        Runs,
        read_survey,
    )
    from gateway.metrology.readings import check_same_axis, check_uncorrected, merged
    from gateway.metrology.residue import (
        predicted_residue,
    )

    table = story.table
    assert table is not None, "the story of a table has one"
    names = [each.value for each in Runs]
    if runs is not None and runs not in names:
        raise typer.BadParameter(f"{runs!r}: must be one of {', '.join(names)}", param_hint="--runs")
    context = ReadingsContext(
        format=told_format, units=None, axis=None, runs=None if runs is None else Runs(runs)
    )
    try:
        before = merged([read_survey(file, context) for file in files]).in_units(story.units)
        check_same_axis(before.source, before.axis, "the table", story.axis)
        check_uncorrected(before.source, before.facts, "draw the table without them, or give those before it")
        after = predicted_residue(before, table)
        left_out = _left_out(before, table)
    except TabFileError as error:
        print_lines((f"error: {problem}" for problem in error.problems), err=True)
        raise typer.Exit(1) from None
    except (MetrologyError, ValueError) as error:
        print_lines([f"error: {error}"], err=True)
        raise typer.Exit(1) from None
    return replace(
        story,
        before=before,
        after=after,
        is_predicted=True,
        left_out=left_out,
        facts={**before.facts, **story.facts, "readings": before.source},
        notes=(*story.notes, *after.remarks),
    )
