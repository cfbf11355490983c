"""Options that the commands of ``pitch-gateway table`` share: what a file does not say about itself.

What can be told about a file is declared in :mod:`gateway.tabfile.options`, the rest in :class:`Told` and
:class:`Wanted`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from gateway.compensation.units import Units
from gateway.tabfile import DIALECTS, ErrorSense, FileContext, TableOptions, V1Layout
from gateway.tabfile.options import DECLARED


def format_names() -> Sequence[str]:
    """Return the name of every format."""
    return [dialect.name for dialect in DIALECTS]


def writable_names() -> Sequence[str]:
    """Return the name of every format that can be written."""
    return [dialect.name for dialect in DIALECTS if dialect.is_writable]


def _complete_format(incomplete: str) -> list[str]:
    return [name for name in format_names() if name.startswith(incomplete)]


def _complete_target(incomplete: str) -> list[str]:
    return [name for name in writable_names() if name.startswith(incomplete)]


def _check_format(name: str | None) -> str | None:
    return _one_of(format_names(), name)


def _check_target(name: str | None) -> str | None:
    return _one_of(writable_names(), name)


def _one_of(names: Sequence[str], name: str | None) -> str | None:
    if name is not None and name not in names:
        raise typer.BadParameter(f"{name!r}: must be one of {', '.join(sorted(names))}")
    return name


OutFile = Annotated[
    Path, typer.Argument(metavar="OUT", help="The file to write.", show_default=False, readable=False)
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite OUT.")]
ToSense = Annotated[
    ErrorSense | None, typer.Option(help="What OUT calls an error, if its format leaves that open.")
]
ToFileAxis = Annotated[
    str | None, typer.Option(metavar="NAME", help="What OUT calls the axis, if its format names axes.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Target = Annotated[
    str,
    typer.Option(
        "--to",
        metavar="FORMAT",
        help="Format of OUT: see 'table formats'.",
        autocompletion=_complete_target,
        callback=_check_target,
    ),
]
Travel = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="LO HI", help="Travel limits of the axis, in machine units of the table."),
]
Counts = Annotated[
    float | None,
    typer.Option("--counts-per-unit", metavar="N", help="Counts of the drive per machine unit, signed."),
]
AxisUnits = Annotated[Units | None, typer.Option("--units", help=DECLARED["file_units"].option.help)]
AxisLetter = Annotated[
    str | None, typer.Option("--axis", metavar="LETTER", help="The axis that the table is meant for.")
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions(TableOptions):
    """What was told about a file on the command line: every option that is declared, and the axis.

    ``units`` tell the ``file_units`` too, of a file that states none.
    """

    format: Annotated[
        str | None,
        typer.Option(
            metavar=DECLARED["format"].option.metavar,
            help=DECLARED["format"].option.help,
            autocompletion=_complete_format,
            callback=_check_format,
        ),
    ] = None
    travel: Travel = None
    units: AxisUnits = None
    axis: AxisLetter = None

    def context(self, counts_per_unit: float | None = None) -> FileContext:
        """Return it for a reader; ``counts_per_unit`` is the drive's.

        Raises:
            ContextError: something of it cannot be true.
        """
        return FileContext(
            **self.given(),
            travel=self.travel,
            units=self.units,
            axis=self.axis,
            counts_per_unit=counts_per_unit,
        )


@dataclass(frozen=True, slots=True)
class OutOptions:
    """What ``convert`` was told about the file to write, besides its format."""

    to_units: Annotated[Units | None, typer.Option(help="Units of OUT; default: those of FILE.")] = None
    to_axis: Annotated[
        str | None,
        typer.Option(
            metavar="LETTER", help="The axis that OUT is for; default: that of FILE or of a file name."
        ),
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
