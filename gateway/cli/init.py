"""``pitch-gateway init``."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import typer

from gateway.cli import init_options as options
from gateway.cli.asking import Asking

if TYPE_CHECKING:
    from gateway.drives.profile import Profile

UNITS: Final = ("mm", "inch", "degree")
REFERENCES: Final = ("absolute", "drive-bit", "homing", "set-position")
APPROACHES: Final = ("none", "forward", "backward")
COMPENSATION_QUESTION: Final = (
    "Are the pitch error compensation and the backlash compensation of the controller itself switched off?"
)
COMPENSATION_REFUSAL: Final = (
    "the controller's own compensation and backlash have to be off, or the error is taken out twice; "
    "switch them off there, then say so with --controller-compensation-off"
)


def init(
    file: options.TargetFile = Path("gateway.toml"),
    *,
    controller_compensation_off: options.CompensationOff = False,
    drive: options.Drive = None,
    drives_at: options.DrivesAt = None,
    controller_at: options.ControllerAt = None,
    baudrate: options.Baudrate = None,
    parity: options.Parity = None,
    stop_bits: options.StopBits = None,
    axis: options.Axis = "x",
    unit_id: options.UnitId = None,
    units: options.AxisUnits = None,
    counts_per_unit: options.Counts = None,
    travel: options.Travel = None,
    table: options.Table = None,
    referenced: options.Referenced = None,
    home_approach: options.HomeApproach = "none",
    ask: options.Ask = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Write a commented configuration for one drive, to start from.

    Asks first whether the controller's own compensation is off, then for what the options leave open. The
    file is checked when it is written; what is left to fill in is said line by line. The axis starts in
    "shadow": everything is computed and shown, nothing is changed.

    Examples:
        pitch-gateway init

        pitch-gateway init mill.toml --controller-compensation-off --drive oriental-az --units mm --unit-id 1
        --drives-at /dev/ttyUSB1 --controller-at 127.0.0.1:1502 --counts-per-unit 1000 --travel -300 0
    """
    from gateway.cli.first_configuration import Answers, Serial, configuration_text

    asking = Asking(is_on=sys.stdin.isatty() if ask is None else ask)
    if not controller_compensation_off and not asking.is_yes(COMPENSATION_QUESTION):
        _refuse(COMPENSATION_REFUSAL)
    _check_names(file, axis, force=force)
    drive = asking.text(drive, "--drive", "Drive (a name of `pitch-gateway drives`, or a file)")
    profile = _profile(drive, file.parent) if drive else None
    answers = Answers(
        drive=drive,
        drives_at=asking.text(drives_at, "--drives-at", "Drives at (/dev/… or HOST:PORT)"),
        controller_at=asking.text(controller_at, "--controller-at", "Controller at (/dev/… or HOST:PORT)"),
        serial=Serial(baudrate, parity, stop_bits),
        axis=axis,
        unit_id=asking.answer(unit_id, "--unit-id", "Modbus unit id of the drive", int),
        units=asking.choice(units, "--units", UNITS),
        counts_per_unit=asking.answer(counts_per_unit, "--counts-per-unit", "Counts in one unit", float),
        travel=asking.range(travel, "--travel", "Travel"),
        referenced=_referenced(asking, referenced, profile),
        table=asking.optional(table, "Table file in the tables folder (none: leave empty)"),
        home_approach=asking.choice(home_approach, "--home-approach", APPROACHES),
    )
    asking.refuse_if_incomplete()
    assert profile is not None, "a drive that is missing has been refused"
    _write(file, configuration_text(answers, profile), force=force)
    _say_what_is_left(file, as_json=as_json)


def _profile(name: str, folder: Path) -> "Profile":
    from gateway.config.drive_files import near_names, read_profile
    from gateway.config.problems import ConfigErrors
    from gateway.drives import library

    if library.is_name(name):
        if name not in library.names():
            _refuse(f'there is no profile "{name}"; {near_names(name)}')
        return library.shipped(name)
    try:
        return read_profile(folder / name)
    except ConfigErrors as errors:
        _refuse(str(errors))


def _referenced(asking: Asking, given: str | None, profile: "Profile | None") -> str:
    """The drive's own bit is the best answer where there is one."""
    if given is None and profile is not None and profile.registers.bits.homed is not None:
        return "drive-bit"
    return asking.choice(given, "--referenced", REFERENCES)


def _check_names(file: Path, axis: str, *, force: bool) -> None:
    from gateway.config.values import read_name

    if file.exists() and not force:
        _refuse(f"{file} exists already; name another file, or overwrite it with --force")
    try:
        read_name(axis)
    except ValueError as error:
        raise typer.BadParameter(f'found "{axis}"; {error}', param_hint="--axis") from None


def _write(file: Path, text: str, *, force: bool) -> None:
    flags = os.O_WRONLY | os.O_CREAT | (os.O_TRUNC if force else os.O_EXCL)
    try:
        with open(os.open(file, flags, 0o644), "w", encoding="utf-8") as target:  # noqa: PTH123 (a descriptor)
            target.write(text)
    except OSError as error:
        _refuse(f"{file} cannot be written ({error.strerror}); name a file in a folder of yours")


def _say_what_is_left(file: Path, *, as_json: bool) -> None:
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors

    left: list[Any] = []
    try:
        load(file)
    except ConfigErrors as errors:
        left = list(errors.problems)
    if as_json:
        result = {"file": str(file), "ok": not left, "left": [problem.as_dict() for problem in left]}
        typer.echo(json.dumps(result, indent=2, ensure_ascii=False))
        return
    typer.echo(f"{file} is written" + ("; left to do:" if left else f" and good: pitch-gateway run {file}"))
    for problem in left:
        typer.echo(f"  {problem}")


def _refuse(why: str) -> NoReturn:
    typer.echo(why, err=True)
    raise typer.Exit(1)
