"""``pitch-gateway table build``: readings of a laser, a scale or a dial gauge into a table."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from gateway.cli import readings_options as given
from gateway.cli.options import takes_options
from gateway.cli.output import Format, notes, show
from gateway.cli.table_options import AsJson, OutFile
from gateway.cli.table_output import PLAIN_WIDTH, PREDICTED, results_lines
from gateway.cli.table_reading import problems
from gateway.commissioning import building
from gateway.commissioning.building import BuildOptions, BuiltTable

if TYPE_CHECKING:
    from rich.console import RenderableType


@takes_options
def build(
    readings: given.ReadingFiles,
    out: OutFile,
    *,
    options: BuildOptions,
    json: AsJson = False,
) -> None:
    """Make a correction table from readings taken without a table.

    The correction is target minus reading, the mean of all runs in each direction. A value that cannot be
    measured at a turn-around point is estimated from its neighbour. Unusual readings are reported. Between
    the targets the table follows straight lines, a smooth curve, or a curve with harmonics of the lead
    (--lead), whichever leaves the smallest error. This error is predicted by leaving targets out.

    Examples:
      pitch-gateway table build z.csv cnc10z.tab --home switch-negative

      pitch-gateway table build x.csv x-table.csv --to csv --lead 5

      pitch-gateway table build run1.rtl run2.rtl cnc10x.tab --to centroid-3 --axis x --home switch-positive
    """
    context = options.readings.context(options.units, options.axis)
    with problems():
        survey = given.read_all(readings, context, options.shape.screw, is_quiet=json)
        found = building.build(survey, out, options)
    show(found, Format.INDENTED if json else Format.TEXT, _words(found), plain_width=PLAIN_WIDTH)


def _words(found: BuiltTable) -> "Iterator[RenderableType]":
    titles = ("before", PREDICTED)
    yield from notes(found.notes)
    yield from found.written.lines(found.out)
    yield from results_lines(found.before, found.predicted, titles, left_out=found.left_out)
    if found.band is not None:
        yield from found.band.described(found.written.again.table)
    if found.advice is not None:
        yield found.advice.describe()
