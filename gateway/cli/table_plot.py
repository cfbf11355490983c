"""``pitch-gateway table plot``: the pictures of a table, as a file to look at or to hand on."""

from pathlib import Path
from typing import Annotated, Final

import typer

from gateway.cli import table_output as output
from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import print_json
from gateway.cli.readings_options import Readings, ReadingsFormat, ReadingsRuns, with_readings
from gateway.cli.table_options import AsJson, Counts, Told
from gateway.cli.table_reading import inspect, problems, usage
from gateway.report.errors import ReportError
from gateway.report.story import AxisStory, Report
from gateway.report.words import shortest
from gateway.report.writing import check_place, place, render
from gateway.tabfile import LoadedTable, axis_of_name

STDOUT: Final = Path("-")
DEFAULT_SUFFIX: Final = ".png"


@takes_options
def plot(
    file: TableFile,
    out: Annotated[
        Path | None,
        typer.Argument(
            metavar="OUT",
            help="The file to write: .png, .svg or .html; - prints SVG. Default: FILE.png beside FILE.",
            show_default=False,
            readable=False,
        ),
    ] = None,
    *,
    told: Told,
    counts_per_unit: Counts = None,
    readings: Readings = None,
    readings_format: ReadingsFormat = None,
    runs: ReadingsRuns = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite OUT.")] = False,
    json: AsJson = False,
) -> None:
    """Draw a table: forward and backward corrections, backlash, slope; with READINGS also what it does.

    The suffix of OUT decides: PNG or SVG is one picture, HTML a report to hand on, in a single file that
    needs no network. Deviations are in µm (rotary axes: arcsec), positions in the units of the table.

    Examples:
      pitch-gateway table plot cnc10z.tab

      pitch-gateway table plot cnc10z.tab z-axis.html

      pitch-gateway table plot cnc10x.tab x.html --readings laser.rtl

      pitch-gateway table plot CNC7X.TAB - --file-counts-per-unit 64000 > x.svg
    """
    if json and out == STDOUT:
        raise typer.BadParameter("standard output takes one of both: SVG or JSON", param_hint="--json")
    with usage(), problems():
        loaded = inspect(file, told.context(counts_per_unit))
    story = story_of(loaded, told.axis)
    if readings:
        story = with_readings(story, readings, readings_format, runs)
    write(story, file, out, force=force, json=json)


def write(story: AxisStory, file: Path, out: Path | None, *, force: bool, json: bool) -> None:
    """Write the report of one axis, or print it; one line says what was written."""
    report = Report(f"Correction table {file.name}", (story,), "")
    where = out or file.with_name(file.name + DEFAULT_SUFFIX)
    try:
        if where == STDOUT:
            typer.echo(render(report, ".svg").decode(), nl=False)
            return
        check_place(where, force=force)
        content = render(report, where.suffix.lower())
        place(where, content, force=force)
    except ReportError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None
    if json:
        print_json(
            {
                "file": str(file),
                "out": str(where),
                "kind": where.suffix.lower().removeprefix("."),
                "bytes": len(content),
                "axis": story.axis,
                "units": story.units.value,
                "points": len(story.table.positions) if story.table else 0,
            }
        )
    else:
        typer.echo(f"{where}: {len(content)} bytes")


def story_of(loaded: LoadedTable, axis: str | None) -> AxisStory:
    """Return what there is to tell of a file: its table, where it comes from, what is odd about it."""
    table = loaded.table
    name = axis or loaded.source.axis or axis_of_name(Path(loaded.file).name) or ""
    facts = {
        "file": Path(loaded.file).name,
        "format": loaded.format,
        "points": f"{len(table.positions)}",
        "range": f"{shortest(table.first)} to {shortest(table.last)} {table.units.value}",
        "SHA-256": loaded.sha256,
    }
    notes = (
        *(f"decided: {decision}" for decision in loaded.source.decisions),
        *(output.finding_line(Path(loaded.file).name, lint) for lint in loaded.lints),
    )
    return AxisStory(name, table.units, table, facts=facts, notes=notes)
