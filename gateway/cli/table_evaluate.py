"""``pitch-gateway table evaluate``: accuracy and repeatability by ISO 230-2, before and after."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import typer

from gateway.cli import readings_options as given
from gateway.cli.options import takes_options
from gateway.cli.output import Format, notes, show
from gateway.cli.table_options import AsJson
from gateway.cli.table_output import PLAIN_WIDTH, PREDICTED, results_lines
from gateway.cli.table_reading import inspect, problems
from gateway.commissioning.judging import EvaluateOptions, Judged, judge
from gateway.metrology.recipe import from_one_zero

if TYPE_CHECKING:
    from rich.console import RenderableType


@takes_options
def evaluate(
    readings: given.ReadingFiles,
    *,
    options: EvaluateOptions,
    json: AsJson = False,
) -> None:
    """Evaluate an axis by the formulas of ISO 230-2: A, R, E, M and B, for each direction and both.

    --after compares with a second measurement. --table compares with the error that this table would leave of
    READINGS: at the targets, to first order, and between them, by leaving targets out. Results that need more
    readings are not shown: one run has no scatter, one direction no reversal.

    Examples:
      pitch-gateway table evaluate before.csv --after after.csv

      pitch-gateway table evaluate laser.rtl --table cnc10x.tab --travel 0 500
    """
    if options.after and options.table is not None:
        raise typer.BadParameter(
            "give either a measurement or a prediction, not both", param_hint="--after, --table"
        )
    source, screw = options.source, options.screw
    context = options.readings.context(source.units, source.axis)
    with problems():
        after, loaded = None, None
        read = given.read_all(readings, context, screw, is_quiet=json)
        before, curves = from_one_zero(read, screw.periods(read))
        if options.after:
            after = given.read_all(options.after, context, screw, is_quiet=json)
            after, _ = from_one_zero(after.in_units(before.units), screw.periods(after))
        if options.table is not None:
            loaded = inspect(options.table, source.context())
        found = judge(before, after, loaded, options, curves)
    show(found, Format.INDENTED if json else Format.TEXT, _words(found), plain_width=PLAIN_WIDTH)


def _words(found: Judged) -> "Iterator[RenderableType]":
    first = "measured" if found.results[1] is None else "before"
    titles = (first, PREDICTED if found.is_predicted else "after")
    yield from notes(found.notes)
    yield from results_lines(*found.results, titles, left_out=found.left_out)
    if found.band is not None and found.table is not None:
        yield from found.band.described(found.table)
    if found.advice is not None:
        yield found.advice.describe()
    yield from found.by_others
    if found.report is not None:
        yield f"report: {found.report}"
