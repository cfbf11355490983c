"""Options that the commands of ``pitch-gateway table`` share: what a file does not say about itself.

They stand once, in :class:`Told`; :func:`takes_file_options` gives them to a command.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Annotated

import typer

from gateway.compensation.units import Units
from gateway.tabfile import DIALECTS, ErrorSense, FileContext, HomeSide, V1Layout


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


def _known_format(name: str | None) -> str | None:
    return _one_of(format_names(), name)


def _known_target(name: str | None) -> str | None:
    return _one_of(writable_names(), name)


def _one_of(names: Sequence[str], name: str | None) -> str | None:
    if name is not None and name not in names:
        raise typer.BadParameter(f"{name!r}: must be one of {', '.join(sorted(names))}")
    return name


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
FileCounts = Annotated[
    float | None,
    typer.Option(
        "--file-counts-per-unit",
        metavar="N",
        help="Encoder counts of the OLD control per machine unit, negative where its Dir Rev was Y "
        "(files that hold counts).",
    ),
]
FileHome = Annotated[
    HomeSide | None, typer.Option(help="The end at which the axis homes; checked against the file.")
]
FileStart = Annotated[
    float | None,
    typer.Option(metavar="S", help="Position of the lowest point, where the file does not say it."),
]
Layout = Annotated[
    V1Layout | None,
    typer.Option(
        "--v1-layout",
        help="Is home the first value of a Centroid version 1 file (listed) or not in it (implicit)?",
    ),
]
FileAxis = Annotated[
    str | None,
    typer.Option("--file-axis", metavar="NAME", help="What a file that holds several axes calls this one."),
]
FagorSense = Annotated[
    ErrorSense | None,
    typer.Option("--fagor-sense", help="What the file of a Fagor control calls an error; no manual says it."),
]
IsgSense = Annotated[
    ErrorSense | None,
    typer.Option(
        "--isg-sense",
        help="What the file of an ISG kernel or TwinCAT calls an error; default: actual_minus_command.",
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar="NAME",
        help="Format of the file, where its text fits several: see 'table formats'.",
        autocompletion=_complete_format,
        callback=_known_format,
    ),
]
Target = Annotated[
    str,
    typer.Option(
        "--to",
        metavar="FORMAT",
        help="Format of OUT: see 'table formats'.",
        autocompletion=_complete_target,
        callback=_known_target,
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
AxisUnits = Annotated[
    Units | None,
    typer.Option(
        "--units",
        help="Machine units of a file that states none; a file that states others is refused. Default for "
        "Centroid version 1: inch.",
    ),
]
AxisLetter = Annotated[
    str | None, typer.Option("--axis", metavar="LETTER", help="The axis that the table is meant for.")
]


@dataclass(frozen=True, slots=True)
class Told:
    """What was told about a file on the command line."""

    format: Format = None
    file_counts_per_unit: FileCounts = None
    file_home: FileHome = None
    file_start: FileStart = None
    file_axis: FileAxis = None
    v1_layout: Layout = None
    fagor_sense: FagorSense = None
    isg_sense: IsgSense = None
    travel: Travel = None
    units: AxisUnits = None
    axis: AxisLetter = None

    def context(self, counts_per_unit: float | None = None) -> FileContext:
        """Return it for a reader; ``counts_per_unit`` is the drive's.

        Raises:
            ContextError: something of it cannot be true.
        """
        return FileContext(
            axis=self.axis,
            units=self.units,
            travel=self.travel,
            file_counts_per_unit=self.file_counts_per_unit,
            v1_layout=self.v1_layout,
            file_start=self.file_start,
            file_home=self.file_home,
            counts_per_unit=counts_per_unit,
            format=self.format,
            file_axis=self.file_axis,
            fagor_sense=self.fagor_sense,
            isg_sense=self.isg_sense,
        )


def takes_file_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command, in the place of its parameter ``told: Told``, an option for each field of it."""
    own = inspect.signature(command, eval_str=True).parameters
    shared = inspect.signature(Told, eval_str=True).parameters
    parameters: list[inspect.Parameter] = []
    for name, parameter in own.items():
        if name == "told":
            parameters += [option.replace(kind=parameter.kind) for option in shared.values()]
        else:
            parameters.append(parameter)

    @wraps(command)
    def run(**options: object) -> None:
        told = Told(**{name: options.pop(name) for name in shared})  # type: ignore[arg-type]
        command(told=told, **options)

    # what typer looks at
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run
