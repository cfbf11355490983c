"""Options that the commands of ``pitch-gateway table`` share: what a file does not say about itself.

They stand once, in :class:`Told` and :class:`Wanted`; :func:`takes_file_options` gives them to a command.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from dataclasses import fields as fields_of
from functools import wraps
from typing import Annotated, Any

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
    typer.Option(
        metavar="S", help="Position of the lowest point (Mint: of mark A), where the file does not prove it."
    ),
]
Increment = Annotated[
    float | None,
    typer.Option(
        "--increment",
        metavar="STEP",
        help="Distance of the points of a Mint table, where the program does not set PRECISIONINCREMENT.",
    ),
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
AnySense = Annotated[
    ErrorSense | None,
    typer.Option(
        "--error-sense",
        help="What the file calls an error, for every format that leaves it open (see 'table formats').",
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
    increment: Increment = None
    file_axis: FileAxis = None
    v1_layout: Layout = None
    fagor_sense: FagorSense = None
    isg_sense: IsgSense = None
    error_sense: AnySense = None
    travel: Travel = None
    units: AxisUnits = None
    axis: AxisLetter = None

    def sense(self) -> ErrorSense | None:
        """Return the sense of the errors, whichever option told it."""
        return self.error_sense or self.isg_sense or self.fagor_sense

    def context(self, counts_per_unit: float | None = None) -> FileContext:
        """Return it for a reader; ``counts_per_unit`` is the drive's.

        Raises:
            ContextError: something of it cannot be true.
        """
        told = {each.name: getattr(self, each.name) for each in fields_of(self)}
        return FileContext(**told, counts_per_unit=counts_per_unit)


@dataclass(frozen=True, slots=True)
class Wanted:
    """What ``convert`` was told about the file to write, besides its format."""

    to_units: Annotated[Units | None, typer.Option(help="Units of OUT; default: those of FILE.")] = None
    to_axis: Annotated[
        str | None,
        typer.Option(
            metavar="LETTER", help="The axis that OUT is for; default: that of FILE or of a file name."
        ),
    ] = None
    to_file_axis: Annotated[
        str | None, typer.Option(metavar="NAME", help="What OUT calls the axis, if its format names axes.")
    ] = None
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
    to_sense: Annotated[
        ErrorSense | None, typer.Option(help="What OUT calls an error, if its format leaves that open.")
    ] = None
    resample: Annotated[
        float | None,
        typer.Option(
            metavar="STEP",
            help="Write an even grid of this step (in units of OUT), and say how much that changes.",
        ),
    ] = None


def takes_file_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command, in the place of a parameter that is a :class:`Told` or a :class:`Wanted`, its fields.

    Each field becomes an option of the command.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, type[Told | Wanted]] = {}
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        if parameter.annotation in {Told, Wanted}:
            groups[name] = parameter.annotation
            fields = inspect.signature(parameter.annotation, eval_str=True).parameters.values()
            parameters += [field.replace(kind=parameter.kind) for field in fields]
        else:
            parameters.append(parameter)

    @wraps(command)
    def run(**options: Any) -> None:
        for name, group in groups.items():
            options[name] = group(**{field.name: options.pop(field.name) for field in fields_of(group)})
        command(**options)

    # what typer looks at
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run
