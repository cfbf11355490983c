"""``pitch-gateway table plot``: the plots of a table, as a file."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import Format, show
from gateway.cli.table_options import AsJson
from gateway.cli.table_reading import inspect, problems
from gateway.commissioning.table_options import Counts, Force, ReadOptions, ScrewOptions, StatedOptions
from gateway.metrology.build import home_of
from gateway.metrology.formats import ReadingsContext, Runs, read_survey
from gateway.metrology.readings import Survey, check_same_axis, check_uncorrected, merged
from gateway.metrology.recipe import from_one_zero
from gateway.metrology.residue import predicted_residue
from gateway.plain import JsonObject
from gateway.report.axis_data import AxisData, Report, axis_data_of
from gateway.report.writing import check_path, put_file, render

if TYPE_CHECKING:
    from gateway.metrology.screw import MeasuredScrew

STDOUT: Final = Path("-")
DEFAULT_SUFFIX: Final = ".png"


@dataclass(frozen=True, slots=True)
class PlotOptions:
    """What to draw."""

    source: ReadOptions = field(default_factory=ReadOptions)
    counts_per_unit: Counts = None
    readings: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="READINGS",
            help="Readings taken WITHOUT the table: also draws the error that it would leave; repeat it "
            "for more files.",
            readable=False,
        ),
    ] = None
    readings_format: Annotated[
        str | None,
        typer.Option("--readings-format", metavar="NAME", help="Format of READINGS, if it is not clear."),
    ] = None
    runs: Annotated[
        str | None,
        typer.Option(
            "--runs",
            metavar="alternate|forward|backward",
            help="Directions of the runs, if the file does not prove them.",
        ),
    ] = None
    stated: StatedOptions = field(default_factory=StatedOptions)
    force: Force = False


@takes_options
def plot(
    file: TableFile,
    out: Annotated[
        Path | None,
        typer.Argument(
            metavar="OUT",
            help="File to write: .png, .svg or .html; - prints SVG. Default: FILE.png beside FILE.",
            show_default=False,
            readable=False,
        ),
    ] = None,
    *,
    options: PlotOptions,
    json: AsJson = False,
) -> None:
    """Draw a table: forward and backward corrections, backlash, slope; with READINGS also its effect.

    The suffix of OUT decides: PNG or SVG is one picture, HTML a report in a single file that needs no
    network. Deviations are in µm (rotary axes: arcsec), positions in the units of the table.

    Examples:
      pitch-gateway table plot cnc10z.tab

      pitch-gateway table plot cnc10z.tab z-axis.html

      pitch-gateway table plot cnc10x.tab x.html --readings laser.rtl

      pitch-gateway table plot CNC7X.TAB - --file-counts-per-unit 64000 > x.svg
    """
    if json and out == STDOUT:
        raise typer.BadParameter("standard output takes SVG or JSON, not both", param_hint="--json")
    with problems():
        loaded = inspect(file, options.source.context(options.counts_per_unit))
        axis_data = axis_data_of(loaded, options.source.axis)
        if options.readings:
            axis_data = _with_readings(axis_data, options)
        report = Report(f"Correction table {file.name}", (axis_data,), "")
        if out == STDOUT:
            typer.echo(render(report, ".svg").decode(), nl=False)
            return
        where = out or file.with_name(file.name + DEFAULT_SUFFIX)
        check_path(where, force=options.force)
        content = render(report, where.suffix.lower())
        put_file(where, content, force=options.force)
    show(_Plotted(file, where, axis_data, len(content)), Format.INDENTED if json else Format.TEXT)


@dataclass(frozen=True, slots=True)
class _Plotted:
    """The written report of one axis."""

    file: Path
    out: Path
    axis_data: AxisData
    size: int
    """Bytes."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {
            "file": str(self.file),
            "out": str(self.out),
            "kind": self.out.suffix.lower().removeprefix("."),
            "bytes": self.size,
            "axis": self.axis_data.axis,
            "units": self.axis_data.units.value,
            "points": len(self.axis_data.table.positions) if self.axis_data.table else 0,
        }

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        yield f"{self.out}: {self.size} bytes"


def _with_readings(axis_data: AxisData, options: PlotOptions) -> AxisData:
    """Return the axis data with readings before, and with the predicted effect of the table on them.

    Raises:
        BadParameter: the value of ``--runs`` is unknown.
        TabFileError, MetrologyError: the files do not contain readings of this axis.
    """
    table = axis_data.table
    assert table is not None, "the story of a table has one"
    names = [each.value for each in Runs]
    if options.runs is not None and options.runs not in names:
        raise typer.BadParameter(f"{options.runs!r}: must be one of {', '.join(names)}", param_hint="--runs")
    runs = None if options.runs is None else Runs(options.runs)
    context = ReadingsContext(options.readings_format, None, None, runs)
    before = merged([read_survey(file, context) for file in options.readings or ()]).in_units(axis_data.units)
    screw = None
    if before.standard is not None:
        before, screw = from_one_zero(before, ScrewOptions().periods(before))
    check_same_axis(before.source, before.axis, "the table", axis_data.axis)
    check_uncorrected(
        before.source, before.facts, "draw the table without them, or give readings taken before it"
    )
    after = predicted_residue(before, table)
    screw = screw or _screw(before)
    band = options.stated.band(screw, table, home_of(table), before)
    return replace(
        axis_data,
        before=before,
        after=after,
        is_predicted=True,
        left_out=None if screw is None else screw.left_out(table),
        band=band,
        facts={**before.facts, **axis_data.facts, "readings": before.source},
        notes=(*axis_data.notes, *after.remarks, *([] if band is None else band.described(table))),
    )


def _screw(survey: Survey) -> "MeasuredScrew | None":
    """Return the curves that the readings allow; None with too few targets."""
    from gateway.metrology.screw import LEAST_TARGETS, MOST_TARGETS, screw_of

    periods = ScrewOptions().periods(survey)
    if not LEAST_TARGETS <= len({each.target for each in survey.readings}) <= MOST_TARGETS:
        return None
    return screw_of(survey.readings, survey.units, periods)
