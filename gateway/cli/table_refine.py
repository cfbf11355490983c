"""``pitch-gateway table refine``: a better table from readings with the old one in use."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli import readings_options as given
from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import Format, notes, show
from gateway.cli.table_options import AsJson, OutFile
from gateway.cli.table_reading import inspect, problems
from gateway.commissioning import refining
from gateway.commissioning.refining import RefinedTable, RefineOptions


@takes_options
def refine(
    file: TableFile,
    readings: Annotated[
        list[Path],
        typer.Argument(
            metavar="READINGS...",
            help="Readings taken while FILE was in use.",
            show_default=False,
            readable=False,
        ),
    ],
    out: OutFile,
    *,
    options: RefineOptions,
    json: AsJson = False,
) -> None:
    """Add the error left by a table to that table: new = old + (nominal - measured).

    Repeat it with readings under the new table; the command says when more readings do not help. With --home
    the correction at home does not change. A turn-around point without a reading is estimated from its
    neighbour.

    Examples:
      pitch-gateway table refine cnc10x.tab after.csv better.tab --home switch-positive

      pitch-gateway table refine cnc10z.tab after.csv better.tab --file-start -2.5 --home switch-negative
    """
    source = options.source
    with problems():
        loaded = inspect(file, source.context())
        context = options.readings.context(source.units, source.axis)
        survey = given.read_all(readings, context, options.shape.screw, is_quiet=json)
        found = refining.refine(loaded, survey, out, options)
    show(found, Format.INDENTED if json else Format.TEXT, _words(found))


def _words(found: RefinedTable) -> Iterator[str]:
    yield from notes(found.refined.notes)
    yield from found.lines()
