"""``pitch-gateway table``: look at a table file of any dialect, check it, turn it into another."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Final

import typer

from gateway.cli import table_build, table_drift, table_evaluate, table_program, table_refine
from gateway.cli import table_output as output
from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import print_json, print_lines
from gateway.cli.table_convert import convert
from gateway.cli.table_formats import formats
from gateway.cli.table_options import AsJson, Counts, Told
from gateway.cli.table_plot import plot
from gateway.cli.table_reading import fail, inspect, problems, usage
from gateway.cli.table_template import template
from gateway.tabfile import Lint, Problem, Severity, TabFileError
from gateway.tabfile import explain as explain_at
from gateway.tabfile.explanation import to_json
from gateway.tabfile.options import MAX_POSITION

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Look at correction tables (Centroid .tab and those of other controls), check and convert them. "
    "The format is found out from the text; 'table formats' lists all of them.",
)

app.command("build")(table_build.build)
app.command("refine")(table_refine.refine)
app.command("evaluate")(table_evaluate.evaluate)
app.command("drift")(table_drift.drift)
app.command("program")(table_program.program)
app.command("plot")(plot)

FAILING: Final = frozenset({"L4"})
"""Warnings with which ``lint`` ends as with an error: a unit slip leaves the axis as good as uncorrected."""


@app.command()
@takes_options
def show(
    file: TableFile,
    *,
    told: Told,
    counts_per_unit: Counts = None,
    limit: Annotated[int, typer.Option(min=0, help="Points to print, 0 for all.")] = 200,
    json: AsJson = False,
) -> None:
    """Show a table: what it is, how open questions were settled, its points.

    Examples:
      pitch-gateway table show cnc10z.tab

      pitch-gateway table show CNC7X.TAB --file-counts-per-unit 64000 --units inch
    """
    with usage(), problems():
        loaded = inspect(file, told.context(counts_per_unit))
    if json:
        rows = [output.row_json(row) for row in loaded.source.rows]
        print_json({**output.summary(loaded), "rows": rows})
    else:
        output.show_text(loaded, limit)


@app.command()
@takes_options
def explain(
    file: TableFile,
    *,
    at: Annotated[
        float, typer.Option("--at", metavar="X", help="Machine position, in the units of the table.")
    ],
    told: Told,
    counts_per_unit: Counts = None,
    json: AsJson = False,
) -> None:
    """Say what a table adds at one position in each direction, and why.

    Corrections are in the machine units of the table. What the file proves needs no option; an option that
    contradicts the file is an error.

    Examples:
      pitch-gateway table explain cnc10z.tab --at -1.25

      pitch-gateway table explain CNC7X.TAB --at 0.25 --file-counts-per-unit 40000

      pitch-gateway table explain CNC7Z.TAB --at -1.25 --travel -2.6 0 --counts-per-unit 25400 --json
    """
    if not abs(at) < MAX_POSITION:
        raise typer.BadParameter(f"{at}: is no position of a machine", param_hint="--at")
    with usage(), problems():
        loaded = inspect(file, told.context(counts_per_unit))
    explanation = explain_at(loaded, at, counts_per_unit)
    if json:
        print_json(to_json(loaded, explanation))
    else:
        output.explain_text(loaded, explanation)


@app.command()
@takes_options
def lint(
    file: TableFile,
    *,
    told: Told,
    counts_per_unit: Counts = None,
    max_slope: Annotated[float | None, typer.Option(help="Limit of |slope|; default: 0.01.")] = None,
    max_correction: Annotated[
        float | None, typer.Option(help="Limit of |correction|; default: 0.5 mm, or 0.3 mm/m.")
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Fail on every warning.")] = False,
    json: AsJson = False,
) -> None:
    """Report every sign of a mistake in a table.

    Ends with 1 if the gateway would refuse the table, or if values were probably written in another unit
    (L4).

    Examples:
      pitch-gateway table lint cnc10z.tab --travel -4.1 0

      pitch-gateway table lint CNC7Z.TAB --file-start -2.5 --strict --json
    """
    with usage():
        context = replace(told.context(counts_per_unit), max_correction=max_correction)
        if max_slope is not None:
            context = replace(context, max_slope=max_slope)
    try:
        loaded = inspect(file, context)
    except TabFileError as error:
        if json:
            print_json(_lint_json(str(file), None, [_as_lint(problem) for problem in error.problems]))
        fail(error)
    failing = [
        lint for lint in loaded.lints if _fails(lint) or (strict and lint.severity is not Severity.INFO)
    ]
    if json:
        print_json(_lint_json(str(file), loaded.format, loaded.lints, ok=not failing))
    else:
        passing = [lint for lint in loaded.lints if lint not in failing]
        print_lines(output.finding_line(loaded.file, lint) for lint in passing)
        print_lines((output.finding_line(loaded.file, lint) for lint in failing), err=True)
        typer.echo(f"{loaded.file}: {loaded.format}, {len(loaded.source.rows)} points")
        typer.echo(_count(loaded.lints))
    if failing:
        raise typer.Exit(1)


app.command()(convert)
app.command()(formats)
app.command()(template)


def _fails(lint: Lint) -> bool:
    return lint.severity is Severity.ERROR or lint.code in FAILING


def _as_lint(problem: Problem) -> Lint:
    bare = replace(problem, code=None)
    message = str(bare).removeprefix(f"{bare.file}: ").removeprefix(f"{bare.file}:{bare.line}: ")
    return Lint(problem.code or "", Severity.ERROR, message, problem.line)


def _lint_json(file: str, form: str | None, lints: Sequence[Lint], *, ok: bool = False) -> dict[str, object]:
    return {"file": file, "format": form, "ok": ok, "lints": [lint.to_json() for lint in lints]}


def _count(lints: Sequence[Lint]) -> str:
    errors = sum(lint.severity is Severity.ERROR for lint in lints)
    warnings = sum(lint.severity is Severity.WARNING for lint in lints)
    return f"{errors} error(s), {warnings} warning(s)"
