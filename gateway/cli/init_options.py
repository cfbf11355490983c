"""The options of ``pitch-gateway init``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer

Option = typer.Option
TargetFile = Annotated[Path, typer.Argument(metavar="FILE", help="File to write.")]


@dataclass(frozen=True, slots=True)
class InitOptions:
    """The answers given as options, and the procedure."""

    controller_compensation_off: Annotated[
        bool,
        Option(
            "--controller-compensation-off",
            help="Confirm that the controller's own pitch and backlash compensation are off.",
        ),
    ] = False
    name: Annotated[str | None, Option(help="Name of this gateway; default: the name of this computer.")] = (
        None
    )
    drive: Annotated[str | None, Option(help="Profile of `pitch-gateway drives`, or a file.")] = None
    drives_at: Annotated[
        str | None,
        Option(help="Address of the drives: /dev/…, HOST:PORT, or rtu://HOST:PORT for RTU over TCP."),
    ] = None
    controller_at: Annotated[
        str | None, Option(help="Where the controller connects: /dev/…, or HOST:PORT to listen on.")
    ] = None
    baudrate: Annotated[
        int | None, Option(help="Baud rate of the drives' port; default: from the drive profile.")
    ] = None
    parity: Annotated[
        str | None,
        Option(help="Parity of the drives' port: none, even or odd; default: from the drive profile."),
    ] = None
    stop_bits: Annotated[
        int | None, Option(help="Stop bits of the drives' port: 1 or 2; default: from the drive profile.")
    ] = None
    controller_baudrate: Annotated[
        int | None, Option(help="Baud rate of the controller's port; default: that of the drives.")
    ] = None
    controller_parity: Annotated[
        str | None, Option(help="Parity of the controller's port; default: that of the drives.")
    ] = None
    controller_stop_bits: Annotated[
        int | None, Option(help="Stop bits of the controller's port; default: those of the drives.")
    ] = None
    axis: Annotated[str | None, Option(help="Name of the axis; default: x.")] = None
    unit_id: Annotated[int | None, Option(min=0, max=255, help="Modbus unit id of the drive.")] = None
    units: Annotated[str | None, Option(help="mm, inch or degree.")] = None
    counts_per_unit: Annotated[
        float | None,
        Option(
            help="Counts of the drive in one unit; negative if it counts down while the axis goes forward."
        ),
    ] = None
    travel: Annotated[tuple[float, float] | None, Option(help="Lowest and highest machine position.")] = None
    table: Annotated[str | None, Option(help="Table file in the tables folder.")] = None
    referenced: Annotated[
        str | None,
        Option(
            help=(
                "How the gateway knows that the axis is referenced: absolute, drive-bit, homing or "
                "set-position."
            )
        ),
    ] = None
    home_approach: Annotated[
        str | None, Option(help="Direction of the last homing move: none, forward or backward.")
    ] = None
    another_axis: Annotated[
        list[str] | None,
        Option(
            metavar="NAME,KEY=VALUE,...",
            help="Further axis on the same line: unit-id, counts-per-unit, travel=LOWEST:HIGHEST, and "
            "table if it has one. Default of drive, units, referenced and home-approach: those of "
            "the axis before. Repeat it for more axes.",
        ),
    ] = None
    measure: Annotated[
        bool | None,
        Option(
            "--measure/--no-measure",
            help="Measure how long the drives take to reply, and write the time-outs; default: ask if "
            "they reply.",
        ),
    ] = None
    scan: Annotated[
        bool,
        Option(
            "--scan",
            help="Find baud rate, parity and unit ids on a silent serial line; only reads, and asks first.",
        ),
    ] = False
    ask: Annotated[
        bool | None, Option("--ask/--no-ask", help="Ask for missing values; default: on a terminal.")
    ] = None
    force: Annotated[bool, Option("--force", help="Overwrite FILE.")] = False
    systemd: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Also write drop-ins for the units of systemd below DIR; see `pitch-gateway service`.",
        ),
    ] = None
    as_json: Annotated[bool, Option("--json", help="Print what is left to do as JSON.")] = False


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
            raise ValueError(f'found "{pair}"; {key} is given twice')
        read, allowed = _OF_AXIS[key]
        try:
            found[key.replace("-", "_")] = read(value)
        except ValueError:
            raise ValueError(f'found "{pair}"; allowed: {allowed}') from None
    return found
