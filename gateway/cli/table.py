"""``pitch-gateway table``: look at a .tab file of any dialect, check it, turn it into another."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, NoReturn

import typer

from gateway.cli import table_build, table_evaluate, table_program, table_refine
from gateway.cli import table_output as output
from gateway.cli.arguments import TableFile
from gateway.cli.table_convert import converted, letter_for, report, write
from gateway.cli.table_options import (
    AsJson,
    AxisLetter,
    AxisUnits,
    Counts,
    FileCounts,
    FileHome,
    FileStart,
    Layout,
    Travel,
)
from gateway.cli.table_plot import plot
from gateway.compensation.units import Units
from gateway.tabfile import (
    DIALECTS,
    ContextError,
    Dialect,
    FileContext,
    Lint,
    LoadedTable,
    Problem,
    Severity,
    TabFileError,
    UnitsOf,
    V1Layout,
    WriteOptions,
    dialect_of,
    inspect_table,
)
from gateway.tabfile import explain as explain_at
from gateway.tabfile.context import MAX_POSITION, MAX_SCALE, MIN_SCALE
from gateway.tabfile.explanation import to_json

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Look at correction tables (Centroid .tab versions 1, 2 and 3), check and convert them.",
)

app.command("plot")(plot)
app.command("build")(table_build.build)
app.command("refine")(table_refine.refine)
app.command("evaluate")(table_evaluate.evaluate)
app.command("program")(table_program.program)

FAILING: Final = frozenset({"L4"})
"""Warnings with which ``lint`` ends as with an error: a unit slip leaves the axis as good as uncorrected."""


@app.command()
def show(
    file: TableFile,
    *,
    file_counts_per_unit: FileCounts = None,
    file_home: FileHome = None,
    file_start: FileStart = None,
    v1_layout: Layout = None,
    travel: Travel = None,
    counts_per_unit: Counts = None,
    units: AxisUnits = None,
    axis: AxisLetter = None,
    limit: Annotated[int, typer.Option(min=0, help="Points to print, 0 for all.")] = 200,
    json: AsJson = False,
) -> None:
    """Show a table: what it is, how open questions were settled, its points.

    Examples:
      pitch-gateway table show cnc10z.tab

      pitch-gateway table show CNC7X.TAB --file-counts-per-unit 64000 --units inch
    """
    with _usage(), _problems():
        context = FileContext(
            axis=axis,
            units=units,
            travel=travel,
            file_counts_per_unit=file_counts_per_unit,
            v1_layout=v1_layout,
            file_start=file_start,
            file_home=file_home,
            counts_per_unit=counts_per_unit,
        )
        loaded = _inspect(file, context)
    if json:
        rows = [output.row_json(row) for row in loaded.source.rows]
        output.print_json({**output.summary(loaded), "rows": rows})
    else:
        output.show_text(loaded, limit)


@app.command()
def explain(
    file: TableFile,
    *,
    at: Annotated[
        float, typer.Option("--at", metavar="X", help="Machine position, in the units of the table.")
    ],
    file_counts_per_unit: FileCounts = None,
    file_home: FileHome = None,
    file_start: FileStart = None,
    v1_layout: Layout = None,
    travel: Travel = None,
    counts_per_unit: Counts = None,
    units: AxisUnits = None,
    axis: AxisLetter = None,
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
    with _usage(), _problems():
        context = FileContext(
            axis=axis,
            units=units,
            travel=travel,
            file_counts_per_unit=file_counts_per_unit,
            v1_layout=v1_layout,
            file_start=file_start,
            file_home=file_home,
            counts_per_unit=counts_per_unit,
        )
        loaded = _inspect(file, context)
    explanation = explain_at(loaded, at, counts_per_unit)
    if json:
        output.print_json(to_json(loaded, explanation))
    else:
        output.explain_text(loaded, explanation)


@app.command()
def lint(
    file: TableFile,
    *,
    file_counts_per_unit: FileCounts = None,
    file_home: FileHome = None,
    file_start: FileStart = None,
    v1_layout: Layout = None,
    travel: Travel = None,
    counts_per_unit: Counts = None,
    units: AxisUnits = None,
    axis: AxisLetter = None,
    max_slope: Annotated[float | None, typer.Option(help="Limit of |slope|; default: 0.01.")] = None,
    max_correction: Annotated[
        float | None, typer.Option(help="Limit of |correction|; default: 0.5 mm.")
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
    with _usage():
        context = FileContext(
            axis=axis,
            units=units,
            travel=travel,
            file_counts_per_unit=file_counts_per_unit,
            v1_layout=v1_layout,
            file_start=file_start,
            file_home=file_home,
            counts_per_unit=counts_per_unit,
            max_correction=max_correction,
        )
        if max_slope is not None:
            context = replace(context, max_slope=max_slope)
    try:
        loaded = _inspect(file, context)
    except TabFileError as error:
        if json:
            output.print_json(_lint_json(str(file), None, [_as_lint(problem) for problem in error.problems]))
        _fail(error)
    failing = [lint for lint in loaded.lints if strict or _fails(lint)]
    if json:
        output.print_json(_lint_json(str(file), loaded.format, loaded.lints, ok=not failing))
    else:
        passing = [lint for lint in loaded.lints if lint not in failing]
        output.print_lines(output.finding_line(loaded.file, lint) for lint in passing)
        output.print_lines((output.finding_line(loaded.file, lint) for lint in failing), err=True)
        typer.echo(f"{loaded.file}: {loaded.format}, {len(loaded.source.rows)} points")
        typer.echo(_count(loaded.lints))
    if failing:
        raise typer.Exit(1)


@app.command()
def convert(
    file: TableFile,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="The file to write.", show_default=False, readable=False)
    ],
    *,
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="centroid-1, centroid-2 or centroid-3.")],
    file_counts_per_unit: FileCounts = None,
    file_home: FileHome = None,
    file_start: FileStart = None,
    v1_layout: Layout = None,
    travel: Travel = None,
    units: AxisUnits = None,
    axis: AxisLetter = None,
    to_counts_per_unit: Annotated[
        float | None,
        typer.Option(
            metavar="N", help="Encoder counts per unit of the control that will read OUT (versions 1 and 2)."
        ),
    ] = None,
    to_v1_layout: Annotated[V1Layout | None, typer.Option(help="Layout of OUT; default: implicit.")] = None,
    to_units: Annotated[Units | None, typer.Option(help="Units of OUT; default: those of FILE.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite OUT.")] = False,
    json: AsJson = False,
) -> None:
    """Write a table in another format, and say what that format cannot hold.

    What was written is read back and compared before OUT is touched. Version 1 takes the counts per unit from
    --to-counts-per-unit or --file-counts-per-unit.

    Examples:
      pitch-gateway table convert CNC7Z.TAB cnc10z.tab --to centroid-3 --file-start -2.5 --axis z

      pitch-gateway table convert cnc10z.tab CNC7Z.TAB --to centroid-1 --to-counts-per-unit 25400
    """
    target = _dialect(to)
    with _usage(), _problems():
        context = FileContext(
            axis=axis,
            units=units,
            travel=travel,
            file_counts_per_unit=file_counts_per_unit,
            v1_layout=v1_layout,
            file_start=file_start,
            file_home=file_home,
        )
        loaded = _inspect(file, context)
        scale = _scale(to_counts_per_unit)
        if scale is None and target.name == "centroid-1":
            scale = file_counts_per_unit
        options = WriteOptions(letter_for(loaded, axis, out), scale, to_v1_layout)
        written, difference = converted(loaded, target, options, to_units)
        write(out, written.text, force=force)
    report(loaded, out, target, (written, difference), json=json)


def _scale(told: float | None) -> float | None:
    """Return the scale of OUT.

    Raises:
        BadParameter: 0, or of a size that no machine has.
    """
    if told is not None and not MIN_SCALE <= abs(told) <= MAX_SCALE:
        rule = f"must be a number other than 0, its size from {MIN_SCALE:g} to {MAX_SCALE:g}"
        raise typer.BadParameter(f"{told:g}: {rule}", param_hint="--to-counts-per-unit")
    return told


def _inspect(file: Path, context: FileContext) -> LoadedTable:
    """Read a file; its own units hold, and one without units is in inches unless told otherwise."""
    units_of = dialect_of(file, context.format).units
    if units_of is UnitsOf.FILE:
        return inspect_table(file, replace(context, same_units=True))
    if units_of is UnitsOf.TOLD:
        return inspect_table(file, replace(context, file_units=context.units))
    if context.units is not None:
        return inspect_table(file, context)
    loaded = inspect_table(file, replace(context, units=Units.INCH))
    decision = "units inch: taken because the file states none and --units was not given"
    source = replace(loaded.source, decisions=(decision, *loaded.source.decisions))
    return replace(loaded, source=source)


def _dialect(name: str) -> Dialect:
    writable = [dialect for dialect in DIALECTS if dialect.is_writable]
    for dialect in writable:
        if dialect.name == name:
            return dialect
    names = ", ".join(sorted(dialect.name for dialect in writable))
    raise typer.BadParameter(f"{name!r}: must be one of {names}", param_hint="--to")


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
    return f"{errors} error(s), {len(lints) - errors} warning(s)"


@contextmanager
def _usage() -> Iterator[None]:
    """Turn facts that cannot be true into wrong usage (exit code 2)."""
    try:
        yield
    except ContextError as error:
        raise typer.BadParameter(str(error)) from error


@contextmanager
def _problems() -> Iterator[None]:
    """Turn a bad file into one line a problem on stderr and exit code 1."""
    try:
        yield
    except TabFileError as error:
        _fail(error)


def _fail(error: TabFileError) -> NoReturn:
    output.print_lines((f"error: {problem}" for problem in error.problems), err=True)
    raise typer.Exit(1) from None
