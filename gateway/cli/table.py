"""``pitch-gateway table``: show a table file of any dialect, check it, convert it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import typer

from gateway.cli import output, table_build, table_drift, table_evaluate, table_program, table_refine
from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import Format, StderrLine
from gateway.cli.table_convert import convert
from gateway.cli.table_edit import edit
from gateway.cli.table_formats import formats
from gateway.cli.table_options import AsJson, MaxCorrection, MaxSlope
from gateway.cli.table_output import PLAIN_WIDTH, TableShown, explained
from gateway.cli.table_plot import plot
from gateway.cli.table_reading import inspect, problems, with_limits
from gateway.cli.table_template import template
from gateway.commissioning.table_options import Counts, ReadOptions
from gateway.plain import JsonObject
from gateway.tabfile import FileProblem, Lint, LintSeverity, TabFileError
from gateway.tabfile import explain as explain_at

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Show, check and convert correction tables: Centroid .tab and other controls. The text of a "
    "file tells its format; 'table formats' lists all.",
)

app.command("build")(table_build.build)
app.command("refine")(table_refine.refine)
app.command("evaluate")(table_evaluate.evaluate)
app.command("drift")(table_drift.drift)
app.command("program")(table_program.program)
app.command("plot")(plot)
app.command("edit")(edit)

FAILING: Final = frozenset({"L4"})
"""Warnings that end ``lint`` like errors: a wrong unit leaves the axis practically uncorrected."""


@app.command()
@takes_options
def show(
    file: TableFile,
    *,
    source: ReadOptions,
    counts_per_unit: Counts = None,
    limit: Annotated[int, typer.Option(min=0, help="Number of points to print; 0: all.")] = 200,
    json: AsJson = False,
) -> None:
    """Show a table: its format, its settings and their origin, its points.

    Examples:
      pitch-gateway table show cnc10z.tab

      pitch-gateway table show CNC7X.TAB --file-counts-per-unit 64000 --units inch
    """
    with problems():
        loaded = inspect(file, source.context(counts_per_unit))
    form = Format.INDENTED if json else Format.TEXT
    output.show(TableShown(loaded, limit), form, plain_width=PLAIN_WIDTH)


@app.command()
@takes_options
def explain(
    file: TableFile,
    *,
    at: Annotated[
        float, typer.Option("--at", metavar="X", help="Machine position, in the units of the table.")
    ],
    source: ReadOptions,
    counts_per_unit: Counts = None,
    json: AsJson = False,
) -> None:
    """Show and explain the correction of a table at one position, in each direction.

    Corrections are in the machine units of the table. What the file proves needs no option. An option that
    contradicts the file is an error.

    Examples:
      pitch-gateway table explain cnc10z.tab --at -1.25

      pitch-gateway table explain CNC7X.TAB --at 0.25 --file-counts-per-unit 40000

      pitch-gateway table explain CNC7Z.TAB --at -1.25 --travel -2.6 0 --counts-per-unit 25400 --json
    """
    with problems():
        loaded = inspect(file, source.context(counts_per_unit))
    found = explain_at(loaded, at, counts_per_unit)
    form = Format.INDENTED if json else Format.TEXT
    output.show(found, form, explained(found), plain_width=PLAIN_WIDTH)


@app.command()
@takes_options
def lint(
    file: TableFile,
    *,
    source: ReadOptions,
    counts_per_unit: Counts = None,
    max_slope: MaxSlope = None,
    max_correction: MaxCorrection = None,
    strict: Annotated[bool, typer.Option("--strict", help="Fail on every warning.")] = False,
    json: AsJson = False,
) -> None:
    """Check a table for mistakes.

    Exit code 1 if the gateway would refuse the table, or if values were probably written in another unit
    (L4).

    Examples:
      pitch-gateway table lint cnc10z.tab --travel -4.1 0

      pitch-gateway table lint CNC7Z.TAB --file-start -2.5 --strict --json
    """
    form = Format.INDENTED if json else Format.TEXT
    with problems():
        context = with_limits(source.context(counts_per_unit), max_slope, max_correction)
        try:
            loaded = inspect(file, context)
        except TabFileError as error:
            if json:
                output.show(_Linted(str(file), None, [_as_lint(problem) for problem in error.problems]), form)
            raise
    found = _Linted(
        loaded.file, loaded.format, loaded.lints, len(loaded.source.rows), fails_on_warnings=strict
    )
    output.show(found, form)
    if found.failing:
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _Linted:
    """The remarks about a table."""

    file: str
    format: str | None
    """None: it cannot be read."""
    lints: Sequence[Lint]
    points: int = 0
    fails_on_warnings: bool = False

    @property
    def failing(self) -> list[Lint]:
        """Those that end the command like an error."""
        fails = {LintSeverity.ERROR, LintSeverity.WARNING} if self.fails_on_warnings else {LintSeverity.ERROR}
        return [lint for lint in self.lints if lint.severity in fails or lint.code in FAILING]

    def as_data(self) -> JsonObject:
        """Return them as plain data."""
        return {
            "file": self.file,
            "format": self.format,
            "ok": not self.failing,
            "lints": [lint.as_data() for lint in self.lints],
        }

    def lines(self) -> Iterator[str]:
        """Yield them for a person."""
        failing = self.failing
        yield from (lint.line_in(self.file) for lint in self.lints if lint not in failing)
        yield from (StderrLine(lint.line_in(self.file)) for lint in failing)
        yield f"{self.file}: {self.format}, {self.points} points"
        yield f"{self._count(LintSeverity.ERROR)} error(s), {self._count(LintSeverity.WARNING)} warning(s)"

    def _count(self, severity: LintSeverity) -> int:
        return sum(lint.severity is severity for lint in self.lints)


app.command()(convert)
app.command()(formats)
app.command()(template)


def _as_lint(problem: FileProblem) -> Lint:
    bare = replace(problem, code=None)
    message = str(bare).removeprefix(f"{bare.file}: ").removeprefix(f"{bare.file}:{bare.line}: ")
    return Lint(problem.code or "", LintSeverity.ERROR, message, problem.line)
