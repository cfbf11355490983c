"""The options of ``pitch-gateway init``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer

Option = typer.Option
TargetFile = Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")]


@dataclass(frozen=True, slots=True)
class InitOptions:
    """The answers given as options, and the procedure."""

    controller_compensation_off: Annotated[
        bool,
        Option(
            "--controller-compensation-off",
            help="The controller's own pitch and backlash compensation are off.",
        ),
    ] = False
    name: Annotated[str | None, Option(help="Of this gateway; default: the name of this computer.")] = None
    drive: Annotated[str | None, Option(help="A profile of `pitch-gateway drives`, or a file.")] = None
    drives_at: Annotated[
        str | None,
        Option(help="Where the drives are: /dev/…, HOST:PORT, or rtu://HOST:PORT for raw RTU over TCP."),
    ] = None
    controller_at: Annotated[
        str | None, Option(help="Where the controller connects: /dev/…, or HOST:PORT to listen on.")
    ] = None
    baudrate: Annotated[int | None, Option(help="Of the drives' serial port; default: the drive's.")] = None
    parity: Annotated[str | None, Option(help="none, even or odd; default: the drive's.")] = None
    stop_bits: Annotated[int | None, Option(help="1 or 2; default: the drive's.")] = None
    controller_baudrate: Annotated[
        int | None, Option(help="Of the controller's serial port; default: as the drives' is.")
    ] = None
    controller_parity: Annotated[str | None, Option(help="The same; default: as the drives' is.")] = None
    controller_stop_bits: Annotated[int | None, Option(help="The same; default: as the drives' is.")] = None
    axis: Annotated[str | None, Option(help="Name of the axis; default: x.")] = None
    unit_id: Annotated[int | None, Option(min=0, max=255, help="Modbus unit id of the drive.")] = None
    units: Annotated[str | None, Option(help="mm, inch or degree.")] = None
    counts_per_unit: Annotated[
        float | None, Option(help="Counts of the drive in one unit; negative where it counts down.")
    ] = None
    travel: Annotated[tuple[float, float] | None, Option(help="Lowest and highest machine position.")] = None
    table: Annotated[str | None, Option(help="Name of the table file in the tables folder.")] = None
    referenced: Annotated[str | None, Option(help="absolute, drive-bit, homing or set-position.")] = None
    home_approach: Annotated[str | None, Option(help="none, forward or backward.")] = None
    another_axis: Annotated[
        list[str] | None,
        Option(
            metavar="NAME,KEY=VALUE,...",
            help="A further axis on the same line: unit-id, counts-per-unit, travel=LOWEST:HIGHEST, and "
            "table where it has one. drive, units, referenced and home-approach are those of the axis "
            "before, if left out. May be given again.",
        ),
    ] = None
    measure: Annotated[
        bool | None,
        Option(
            "--measure/--no-measure",
            help="Measure how long the drives take, and write the time-outs; default: ask, where they are "
            "there.",
        ),
    ] = None
    scan: Annotated[
        bool,
        Option(
            "--scan",
            help="Look for baud rate, parity and unit ids on a silent serial line; reads only, and asks "
            "first.",
        ),
    ] = False
    ask: Annotated[
        bool | None, Option("--ask/--no-ask", help="Ask for what is missing; default: on a terminal.")
    ] = None
    force: Annotated[bool, Option("--force", help="Overwrite FILE.")] = False
    systemd: Annotated[
        Path | None,
        Option(metavar="DIR", help="Fit systemd's units below DIR to it too; see `pitch-gateway service`."),
    ] = None
    as_json: Annotated[bool, Option("--json", help="Say what is left to do as JSON.")] = False


def _range(text: str) -> tuple[float, float]:
    lowest, _, highest = text.partition(":")
    return float(lowest), float(highest)


_OF_AXIS: Final[Mapping[str, tuple[Callable[[str], Any], str]]] = {
    "drive": (str, ""),
    "unit-id": (int, "a whole number, as in unit-id=2"),
    "units": (str, ""),
    "counts-per-unit": (float, "a number, as in counts-per-unit=1000"),
    "referenced": (str, ""),
    "travel": (_range, "LOWEST:HIGHEST, as in travel=-300:0"),
    "home-approach": (str, ""),
    "table": (str, ""),
}
"""The keys of ``--another-axis``, each with its type and what is allowed if it does not fit."""


def further_axis(text: str) -> dict[str, Any]:
    """Return the values of an ``--another-axis``, by the names of the options with underscores.

    Raises:
        ValueError: it is invalid; the error says what was found and what is allowed.

    >>> further_axis("y,unit-id=2,travel=-300:0")
    {'axis': 'y', 'unit_id': 2, 'travel': (-300.0, 0.0)}
    """
    name, *pairs = text.split(",")
    found: dict[str, Any] = {"axis": name}
    for pair in pairs:
        key, _, value = pair.partition("=")
        if key not in _OF_AXIS or not value:
            raise ValueError(f'found "{pair}"; allowed: KEY=VALUE with {", ".join(_OF_AXIS)}')
        if key.replace("-", "_") in found:
            raise ValueError(f'found "{pair}"; {key} stands there twice')
        read, allowed = _OF_AXIS[key]
        try:
            found[key.replace("-", "_")] = read(value)
        except ValueError:
            raise ValueError(f'found "{pair}"; allowed: {allowed}') from None
    return found
