"""``pitch-gateway init``."""

import json
import os
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import typer

from gateway.cli import init_options as options
from gateway.cli.asking import Asking, number, text, two_numbers, whole_number

if TYPE_CHECKING:
    from gateway.cli.draft import Draft
    from gateway.cli.first_configuration import Serial

QUESTIONS: Final[Mapping[str, tuple[Callable[[str], Any], str]]] = {
    "drives_at": (text, "Drives at (/dev/…, HOST:PORT, or rtu://HOST:PORT)"),
    "controller_at": (text, "Controller at (/dev/…, or HOST:PORT to listen on)"),
    "unit_id": (whole_number, "Modbus unit id of the drive"),
    "units": (text, "Units (mm, inch or degree)"),
    "counts_per_unit": (number, "Counts in one unit"),
    "referenced": (text, "Referenced (absolute, drive-bit, homing or set-position)"),
    "travel": (two_numbers, "Travel"),
    "home_approach": (text, "Last movement of homing (none, forward or backward)"),
}
"""How what the options leave open is asked for, in this order."""
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
    systemd: options.Systemd = None,
    as_json: options.AsJson = False,
) -> None:
    """Write a commented configuration for one drive, to start from.

    Asks first whether the controller's own compensation is off, then for what the options leave open. An
    answer that the configuration would refuse is explained and asked for again. The file is checked when it
    is written; what is left to fill in is said line by line. The axis starts in "shadow": everything is
    computed and shown, nothing is changed.

    Examples:
        pitch-gateway init

        pitch-gateway init mill.toml --controller-compensation-off --drive oriental-az --units mm --unit-id 1
        --drives-at /dev/ttyUSB1 --controller-at 127.0.0.1:1502 --counts-per-unit 1000 --travel -300 0
    """
    from gateway.cli.first_configuration import Serial

    asking = Asking(is_on=sys.stdin.isatty() if ask is None else ask)
    draft = _new_draft(file, axis, Serial(baudrate, parity, stop_bits), force=force)
    given = {
        "drive": drive,
        "drives_at": drives_at,
        "controller_at": controller_at,
        "unit_id": unit_id,
        "units": units,
        "counts_per_unit": counts_per_unit,
        "referenced": referenced,
        "travel": travel,
        "home_approach": home_approach,
    }
    try:
        _answer(draft, asking, given, is_compensation_off=controller_compensation_off)
        table = asking.optional(table, "Table file in the tables folder (none: leave empty)")
    except typer.Abort:
        _refuse("\nended before all was answered: nothing was written")
    _write(file, draft.text(table, _state_of(file, is_service=systemd is not None)), force=force)
    is_good = _say_what_is_left(file, as_json=as_json)
    if systemd is not None:
        _fit_units(file, systemd, is_good=is_good, is_quiet=as_json)


def _new_draft(file: Path, axis: str, serial: "Serial", *, force: bool) -> "Draft":
    """Return a draft in which nothing is answered yet; refuses names and settings that cannot be."""
    from gateway.cli.draft import Draft

    _check_names(file, axis, force=force)
    draft = Draft(file, axis, serial)
    problem = draft.wrong_serial()
    if problem is not None:
        option = "--" + problem.key.rpartition(".")[2].replace("_", "-")
        raise typer.BadParameter(f"{problem.found}; {problem.remedy}", param_hint=option)
    return draft


def _answer(draft: "Draft", asking: Asking, given: Mapping[str, Any], *, is_compensation_off: bool) -> None:
    """Have everything answered that the options leave open."""
    if not is_compensation_off and not asking.is_yes(COMPENSATION_QUESTION):
        _refuse(COMPENSATION_REFUSAL)
    _settle_drive(asking, draft, given["drive"])
    _settle_rest(asking, draft, given)
    asking.refuse_if_incomplete()


def _settle_drive(asking: Asking, draft: "Draft", given: str | None) -> None:
    """Have the drive named; the profiles that there are stand above the question."""
    from gateway.cli.drives_output import list_lines

    for line in list_lines() if asking.is_on and given is None else ():
        typer.echo(f"  {line}", err=True)
    ask = partial(text, "Drive (a name of `pitch-gateway drives`, or a file of your own: ./my-drive.toml)")
    try:
        asking.settle(given, "--drive", ask, partial(draft.take, "drive"))
    except typer.BadParameter as error:
        _refuse(error.message)


def _settle_rest(asking: Asking, draft: "Draft", given: Mapping[str, Any]) -> None:
    """Have everything else answered; what the drive answers by itself is not asked."""
    has_homed_bit = draft.profile is not None and draft.profile.registers.bits.homed is not None
    for name, (ask, question) in QUESTIONS.items():
        answer = given[name]
        if name == "referenced" and answer is None and has_homed_bit:
            answer = "drive-bit"
        option = f"--{name.replace('_', '-')}"
        said = len(draft.notes)
        asking.settle(answer, option, partial(ask, question), partial(draft.take, name))
        for note in draft.notes[said:] if asking.is_on else ():
            typer.echo(f"  note: {note}", err=True)


def _check_names(file: Path, axis: str, *, force: bool) -> None:
    from gateway.config.values import read_name

    if os.path.exists(file) and not force:  # noqa: PTH110 - a folder that may not be entered is no error here
        _refuse(f"{file} exists already; name another file, or overwrite it with --force")
    folder = file.parent
    is_folder = os.path.isdir(folder)  # noqa: PTH112
    if not is_folder or not os.access(folder, os.W_OK | os.X_OK):
        why = "not writable" if is_folder else "no folder, or none that this user may enter"
        _refuse(f"{file} cannot be written ({folder} is {why}); name a file in a folder of yours")
    try:
        read_name(axis)
    except ValueError as error:
        raise typer.BadParameter(f'found "{axis}"; {error}', param_hint="--axis") from None


def _state_of(file: Path, *, is_service: bool) -> str | None:
    """Return where the services of systemd keep the state, for a configuration of theirs."""
    from gateway.config.service_units import CONFIGURATION, STATE

    return STATE if is_service or file.parent.resolve() == Path(CONFIGURATION) else None


def _write(file: Path, text: str, *, force: bool) -> None:
    flags = os.O_WRONLY | os.O_CREAT | (os.O_TRUNC if force else os.O_EXCL)
    try:
        with open(os.open(file, flags, 0o644), "w", encoding="utf-8") as target:  # noqa: PTH123 (a descriptor)
            target.write(text)
    except OSError as error:
        _refuse(f"{file} cannot be written ({error.strerror}); name a file in a folder of yours")


def _fit_units(file: Path, systemd: Path, *, is_good: bool, is_quiet: bool) -> None:
    """Write the drop-ins that fit the configuration; one that is not good yet fits none."""
    from gateway.cli.service import say_written, write_drop_ins
    from gateway.config.load import load
    from gateway.config.service_units import drop_ins

    if not is_good:
        typer.echo(f"afterwards: pitch-gateway service {file} --systemd {systemd}", err=True)
        return
    written = write_drop_ins(systemd, drop_ins(load(file)))
    if not is_quiet:
        say_written(written)


def _say_what_is_left(file: Path, *, as_json: bool) -> bool:
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
        return not left
    typer.echo(f"{file} is written" + ("; left to do:" if left else f" and good: pitch-gateway run {file}"))
    for problem in left:
        typer.echo(f"  {problem}")
    return not left


def _refuse(why: str) -> NoReturn:
    typer.echo(why, err=True)
    raise typer.Exit(1)
