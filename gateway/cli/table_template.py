"""``pitch-gateway table template``."""

from typing import Annotated

import typer

from gateway.compensation.units import Units
from gateway.tabfile import csv_table


def template(
    *,
    units: Annotated[Units, typer.Option(help="Unit of positions and corrections.")] = Units.MM,
    semicolons: Annotated[
        bool, typer.Option("--semicolons", help="For spreadsheets that write decimal commas.")
    ] = False,
) -> None:
    """Print a CSV table to fill in, also with a spreadsheet.

    Examples:
      pitch-gateway table template > x.csv

      pitch-gateway table template --units inch --semicolons > x.csv
    """
    typer.echo(csv_table.template(units, ";" if semicolons else ","), nl=False)
