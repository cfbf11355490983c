"""Options that the commands of ``pitch-gateway table`` share.

Options that programs use too are in :mod:`gateway.commissioning.table_options`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from gateway.commissioning.table_options import ToFileAxis, ToSense, writable_names
from gateway.compensation.units import Units
from gateway.options import Option
from gateway.tabfile import V1Layout

OutFile = Annotated[
    Path, typer.Argument(metavar="OUT", help="File to write.", show_default=False, readable=False)
]
MaxSlope = Annotated[float | None, typer.Option(help="Limit of |slope|; default: 0.01.")]
MaxCorrection = Annotated[
    float | None, typer.Option(help="Limit of |correction|; default: 0.5 mm, or 0.3 mm/m.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Target = Annotated[
    str, Option("Format of OUT: see 'table formats'.", "to", metavar="FORMAT", one_of=writable_names)
]


@dataclass(frozen=True, slots=True)
class OutOptions:
    """Options of ``convert`` about the file to write, besides its format."""

    to_units: Annotated[Units | None, typer.Option(help="Units of OUT; default: those of FILE.")] = None
    to_axis: Annotated[
        str | None,
        typer.Option(metavar="LETTER", help="Axis of OUT; default: that of FILE or of a file name."),
    ] = None
    to_file_axis: ToFileAxis = None
    to_counts_per_unit: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Encoder counts per unit of the control that will read OUT, if its format holds counts.",
        ),
    ] = None
    to_v1_layout: Annotated[
        V1Layout | None, typer.Option(help="Layout of a Centroid version 1 OUT; default: implicit.")
    ] = None
    to_sense: ToSense = None
    resample: Annotated[
        float | None,
        typer.Option(
            metavar="STEP",
            help="Write an even grid of this step (in units of OUT), and say how much that changes.",
        ),
    ] = None
