"""Options that the commands of ``pitch-gateway table`` share: what a file does not say about itself."""

from typing import Annotated

import typer

from gateway.compensation.units import Units
from gateway.tabfile import HomeSide, V1Layout

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
FileCounts = Annotated[
    float | None,
    typer.Option(
        "--file-counts-per-unit",
        metavar="N",
        help="Encoder counts of the OLD control per machine unit, negative where its Dir Rev was Y "
        "(version 1).",
    ),
]
FileHome = Annotated[
    HomeSide | None, typer.Option(help="The end at which the axis homes; checked against the file.")
]
FileStart = Annotated[
    float | None,
    typer.Option(
        metavar="S", help="Position of the lowest point, where the file does not say it (version 2)."
    ),
]
Layout = Annotated[
    V1Layout | None,
    typer.Option("--v1-layout", help="Is home the first value (listed) or not in the file (implicit)?"),
]
Travel = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="LO HI", help="Travel limits of the axis, in machine units of the table."),
]
Counts = Annotated[
    float | None,
    typer.Option("--counts-per-unit", metavar="N", help="Counts of the drive per machine unit, signed."),
]
AxisUnits = Annotated[
    Units | None,
    typer.Option(
        "--units", help="Machine units of a version 1 file, which states none; default there: inch."
    ),
]
AxisLetter = Annotated[
    str | None, typer.Option("--axis", metavar="LETTER", help="The axis that the table is meant for.")
]
