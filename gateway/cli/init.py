"""``pitch-gateway init``."""

import asyncio
import os
import platform
import re
import shlex
import socket
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import typer

from gateway.cli.asking import Prompter, number, text, two_numbers, whole_number
from gateway.cli.init_options import InitOptions, TargetFile, further_axis
from gateway.cli.options import takes_options
from gateway.cli.output import Format, print_lines, show
from gateway.files import FileRefusedError, write_file

if TYPE_CHECKING:
    from gateway.commissioning.first_configuration import Draft, Serial
    from gateway.commissioning.serial_ports import Found
    from gateway.config.problems import Problem

QUESTIONS: Final[Mapping[str, tuple[Callable[..., Any], str]]] = {
    "drives_at": (text, "Drives at (/dev/…, HOST:PORT, or rtu://HOST:PORT)"),
    "drives_format": (text, "Baud rate, parity and stop bits of the drives"),
    "controller_at": (text, "Controller at (/dev/…, or HOST:PORT to listen on)"),
    "controller_format": (text, "Baud rate, parity and stop bits of the controller"),
    "unit_id": (whole_number, "Modbus unit id of the drive"),
    "units": (text, "Units (mm, inch or degree)"),
    "counts_per_unit": (number, "Counts in one unit"),
    "referenced": (text, "Referenced (absolute, drive-bit, homing or set-position)"),
    "travel": (two_numbers, "Travel"),
    "home_approach": (text, "Last movement of homing (none, forward or backward)"),
}
"""The questions for what the options leave open, in this order."""
OF_LINE: Final = ("drives_at", "drives_format", "controller_at", "controller_format")
"""Those of them that are asked once; the others are asked for each axis."""
OF_AXIS: Final = (
    "axis",
    "drive",
    "unit_id",
    "units",
    "counts_per_unit",
    "referenced",
    "travel",
    "home_approach",
    "table",
)
"""Options that describe the first axis; ``--another-axis`` has the same for a further one."""
AS_BEFORE: Final = ("drive", "units", "referenced", "home_approach")
"""Settings that a further axis takes from the one before, unless others are given."""
ANOTHER_QUESTION: Final = "Another axis on the same line?"
EXPLAINED: Final[Mapping[str, str]] = {
    "counts_per_unit": "counts in one unit: how far the position register changes while the axis moves one "
    "unit; counts per motor turn × gear / lead of the screw, as in 10 000 × 1 / 5 mm = 2000; negative if "
    "it counts down while the axis goes forward",
    "referenced": "referenced: how the gateway knows that the drive counts from the machine's zero: absolute "
    "encoder, a bit that says homed, homing seen on the wire, or the drive's position is set",
    "home_approach": "last movement of homing: it decides which branch of the table is valid right after "
    "homing; forward is towards greater positions; none: not known",
}
"""Text above a question."""
COMPENSATION_QUESTION: Final = (
    "Are the pitch error compensation and the backlash compensation of the controller itself off?"
)
SCAN_QUESTION: Final = (
    "Search for drives on {device}? This reads register {address:#06x} of unit ids 1 to 247 at every "
    "usual setting; it writes nothing and takes a minute. No controller may be on that line, and the "
    "machine must not move"
)
MEASURE_QUESTION: Final = "The drives reply. Measure how long they take (reads only, half a minute)?"
COMPENSATION_REFUSAL: Final = (
    "nothing was written: switch the controller's own compensation and backlash off, or the error is "
    "corrected twice; then start this again and answer y (or give --controller-compensation-off)"
)


@takes_options
def init(file: TargetFile = Path("gateway.toml"), *, options: InitOptions) -> None:
    r"""Write a first configuration with comments, for the drives on one line.

    It first asks whether the controller's own compensation is off, then for missing values. It lists serial
    ports by their lasting names; type a number to choose one. If an answer is not allowed, it says why and
    asks again. Then it asks for further axes; Enter takes the drive of the axis before. It makes the folder
    of the tables, writes the file and checks it. If the drives reply, it can measure their times and write
    the time-outs of the line (as `pitch-gateway probe --timing` does). At the end it lists what you must fill
    in, and the next three commands. Each axis starts in "shadow": corrections are computed and shown, but
    positions pass unchanged.

    If you do not know baud rate, parity or unit ids, use --scan on a silent line. It reads one register from
    each unit id at the usual settings, and offers what replied.

    Examples:
        pitch-gateway init

        pitch-gateway init --scan

        pitch-gateway init mill.toml --controller-compensation-off \
          --drive oriental-az --units mm --unit-id 1 --counts-per-unit 1000 \
          --drives-at /dev/ttyUSB1 --controller-at 127.0.0.1:1502 \
          --travel -300 0

        pitch-gateway init mill.toml --controller-compensation-off \
          --drive oriental-az --units mm --unit-id 1 --counts-per-unit 1000 \
          --drives-at /dev/ttyUSB1 --controller-at 127.0.0.1:1502 \
          --travel -300 0 \
          --another-axis y,unit-id=2,counts-per-unit=1000,travel=-200:0 \
          --another-axis z,unit-id=3,counts-per-unit=500,travel=-99:0,table=z.tab
    """
    from gateway.commissioning.first_configuration import Serial

    asking = Prompter(is_on=sys.stdin.isatty() if options.ask is None else options.ask)
    controller = Serial(options.controller_baudrate, options.controller_parity, options.controller_stop_bits)
    draft = _new_draft(
        file, Serial(options.baudrate, options.parity, options.stop_bits), controller, force=options.force
    )
    given = {"name": options.name, "drives_at": options.drives_at, "controller_at": options.controller_at}
    first = {name: getattr(options, name) for name in OF_AXIS}
    try:
        axes = [first, *map(further_axis, options.another_axis or ())]
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--another-axis") from None
    if options.scan and not asking.is_on:
        raise typer.BadParameter(
            "confirmation is needed before reading: run it on a terminal, or with --ask", param_hint="--scan"
        )
    try:
        _answer(
            draft,
            asking,
            given,
            axes,
            is_compensation_off=options.controller_compensation_off,
            is_scan=options.scan,
        )
    except typer.Abort:
        _refuse("\nstopped before all questions were answered: nothing was written")
    state = _state_of(file, is_service=options.systemd is not None)
    _write(file, draft.text(state), force=options.force)
    _make_tables(file)
    if timing := _measured(file, asking, draft, measure=options.measure):
        _write(file, draft.text(state, timing), force=True)
    written = _written(file, _next(file, state))
    show(written, Format.INDENTED if options.as_json else Format.TEXT)
    if options.systemd is not None:
        _fit_units(file, options.systemd, is_good=not written.left, is_quiet=options.as_json)


def _new_draft(file: Path, drives: "Serial", controller: "Serial", *, force: bool) -> "Draft":
    """Return a draft without answers; refuse unsuitable files and settings."""
    from gateway.commissioning.first_configuration import Draft

    _check_file(file, force=force)
    draft = Draft(file, drives, controller)
    wrong = draft.wrong_serial()
    if wrong is not None:
        option, problem = wrong
        raise typer.BadParameter(f"{problem.found}; {problem.remedy}", param_hint=option)
    return draft


def _answer(
    draft: "Draft",
    asking: Prompter,
    given: Mapping[str, Any],
    axes: "Sequence[Mapping[str, Any]]",
    *,
    is_compensation_off: bool,
    is_scan: bool,
) -> None:
    """Get all answers that the options leave open."""
    if not is_compensation_off and not asking.is_yes(COMPENSATION_QUESTION):
        _refuse(COMPENSATION_REFUSAL)
    name = given["name"] if given["name"] or asking.is_on else host_name()
    asking.settle(
        name, "--name", partial(text, "Name of the gateway", host_name()), partial(draft.take, "name")
    )
    unit_ids = tuple(axis["unit_id"] for axis in axes if axis.get("unit_id") is not None)
    for axis in axes:
        _settle_axis(asking, draft, {**given, **axis}, scanned=unit_ids if is_scan else None)
    while len(axes) == 1 and asking.is_yes(ANOTHER_QUESTION):
        _settle_axis(asking, draft, {}, scanned=None)
    asking.refuse_if_incomplete()


def _settle_axis(
    asking: Prompter, draft: "Draft", given: Mapping[str, Any], *, scanned: tuple[int, ...] | None
) -> None:
    """Get the answers for an axis, and with the first one those for its line.

    ``scanned``: the unit ids to poll with every setting; empty: the usual ones; None: no scan.
    """
    before = next(reversed(draft.axes.values()), None)
    name = given.get("axis")
    if name is None and before is None and not asking.is_on:
        name = "x"
    ask = partial(text, "Name of the axis", "x" if before is None else None)
    asking.settle(name, "--axis" if before is None else "--another-axis", ask, draft.begin_axis)
    _settle_drive(asking, draft, given.get("drive"), None if before is None else before.get("drive"))
    _settle_rest(asking, draft, given, before, scanned=scanned)
    question = "Table file in the tables folder (none: leave empty)"
    draft.set_table(asking.optional(given.get("table"), question))


def _settle_drive(asking: Prompter, draft: "Draft", given: str | None, before: str | None) -> None:
    """Get the drive's name; the first question lists the profiles."""
    from gateway.drives import library
    from gateway.drives.described import ProfileList

    names = library.names()
    is_listed = asking.is_on and given is None and before is None
    for number_, line in enumerate(ProfileList().lines()) if is_listed else ():
        typer.echo(f"  {number_ or '':>2}  {line}", err=True)  # the first line has the headings
    question = "Drive (a number or a name of the list, or your own file: ./my-drive.toml)"
    ask = partial(_choice, question, names, before)
    given = before if given is None and not asking.is_on else given
    try:
        asking.settle(given, _option(draft, "drive"), ask, partial(draft.take, "drive"))
    except typer.BadParameter as error:
        _refuse(error.message)


def _option(draft: "Draft", name: str) -> str:
    """Return the option for an answer that is not asked for."""
    name = name.replace("_", "-")
    return f"--{name}" if len(draft.axes) == 1 else f"{name} of --another-axis {next(reversed(draft.axes))}"


def _settle_rest(
    asking: Prompter,
    draft: "Draft",
    given: Mapping[str, Any],
    before: Mapping[str, Any] | None,
    *,
    scanned: tuple[int, ...] | None,
) -> None:
    """Get all other answers; offer the usual answer if there is one."""
    from gateway.commissioning.first_configuration import FORMATS, format_words
    from gateway.commissioning.serial_ports import serial_ports

    usual = _usual(draft, before)
    ports = serial_ports() if asking.is_on and before is None else []
    for name, (ask, question) in QUESTIONS.items():
        if name in OF_LINE and before is not None:
            continue
        answer = given.get(name)
        if name == "drives_format" and scanned is not None:
            usual |= _scanned(asking, draft, scanned)
        if name in FORMATS:
            if not draft.wants_format(name) or not asking.is_on:
                continue
            usual.setdefault(name, format_words(draft.serial(name)))
        if answer is None and asking.is_on:
            _print_before(name, draft, ports, is_first=before is None)
        if answer is None and not asking.is_on:
            answer = usual.get(name)
        asked = partial(ask, question, usual[name]) if name in usual else partial(ask, question)
        if name.endswith("_at"):
            asked = partial(_choice, question, [port.path for port in ports])
        shown = len(draft.notes)
        asking.settle(answer, _option(draft, name), asked, partial(draft.take, name))
        for note in draft.notes[shown:] if asking.is_on else ():
            typer.echo(f"  note: {note}", err=True)


def _usual(draft: "Draft", before: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the offered answers; only an axis with the same drive takes over ``referenced``."""
    profile = draft.profile
    has_homed_bit = profile is not None and profile.registers.bits.homed is not None
    usual = {"home_approach": "none", **({"referenced": "drive-bit"} if has_homed_bit else {})}
    if before is None:
        return usual
    is_same = before.get("drive") == next(reversed(draft.axes.values())).get("drive")
    names = [name for name in AS_BEFORE if name in before and (is_same or name != "referenced")]
    return usual | {name: str(before[name]) for name in names}


def _scanned(asking: Prompter, draft: "Draft", unit_ids: tuple[int, ...]) -> dict[str, str]:
    """Scan for drives with every setting; return the one with answers, and the lowest unit id there."""
    from gateway.commissioning.first_configuration import format_words
    from gateway.commissioning.serial_ports import scan
    from gateway.transport.errors import TransportError
    from gateway.transport.master import LostError

    device, offered = draft.answers["drives_at"], draft.serial("drives_format")
    if not device.startswith("/"):
        typer.echo("  --scan: a network has no baud rate: there is nothing to search for", err=True)
        return {}
    address = draft.read_address
    if not asking.is_yes(SCAN_QUESTION.format(device=device, address=address)):
        return {}
    try:
        found = asyncio.run(
            scan(device, offered, address, unit_ids, lambda line: typer.echo(f"  {line}", err=True))
        )
    except (TransportError, LostError) as error:
        typer.echo(f"  not scanned: {getattr(error, 'detail', error)}", err=True)
        return {}
    if found is None:
        typer.echo(
            "  no drive replies: are the drives on, is the cable in the right socket, are D1 and D0 (A "
            "and B) swapped? To find a drive with a unit id above 8, give --unit-id",
            err=True,
        )
        return {}
    typer.echo(f"  unit ids that reply: {', '.join(map(str, found.unit_ids))}", err=True)
    return {"drives_format": format_words(found.serial), "unit_id": str(min(found.unit_ids))}


def _print_before(name: str, draft: "Draft", ports: "Sequence[Found]", *, is_first: bool) -> None:
    """Print the information for a question."""
    if name.endswith("_at"):
        listed = "  serial ports found (type a number to choose one):"
        typer.echo(listed if ports else "  no serial port found", err=True)
        for number_, port in enumerate(ports, start=1):
            typer.echo(f"    {number_}  {port}", err=True)
    if name in EXPLAINED and is_first:
        typer.echo(f"  {EXPLAINED[name]}", err=True)
    if name == "counts_per_unit" and draft.profile is not None and draft.profile.counts:
        typer.echo(f"  of this drive: {draft.profile.counts}", err=True)


def _choice(question: str, listed: "Sequence[str]", default: str | None = None) -> str:
    """Ask for an item of a list that was shown: by its number or its name."""
    answer = text(question, default)
    if answer.isdecimal() and 0 < int(answer) <= len(listed):
        return listed[int(answer) - 1]
    return answer


def host_name() -> str:
    """Return the name of this computer, in a form that is allowed as the name of a gateway."""
    from gateway.config.values import read_name

    name = re.sub(r"[^A-Za-z0-9_-]", "-", platform.node().partition(".")[0])
    try:
        return read_name(name)
    except ValueError:
        return "gateway"


def _make_tables(file: Path) -> None:
    """Make the configuration's folder for tables."""
    try:
        (file.parent / "tables").mkdir(exist_ok=True)
    except OSError as error:
        _refuse(f"{file.parent / 'tables'} cannot be made ({error.strerror}); {file} is written")


def _check_file(file: Path, *, force: bool) -> None:
    if os.path.exists(file) and not force:  # noqa: PTH110 - a folder without access is no error here
        _refuse(f"{file} exists already; name another file, or overwrite it with --force")
    folder = file.parent
    is_folder = os.path.isdir(folder)  # noqa: PTH112
    if not is_folder or not os.access(folder, os.W_OK | os.X_OK):
        why = "not writable" if is_folder else "no folder, or you may not enter it"
        _refuse(f"{file} cannot be written ({folder} is {why}); name a file in your own folder")


def _state_of(file: Path, *, is_service: bool) -> str | None:
    """Return the state folder of the systemd services, for a configuration of theirs."""
    from gateway.config.service_units import CONFIGURATION, STATE

    return STATE if is_service or file.parent.resolve() == Path(CONFIGURATION) else None


def _write(file: Path, text: str, *, force: bool) -> None:
    try:
        write_file(file, text.encode(), force=force)
    except FileRefusedError as error:
        _refuse(f"{file}: {error}")
    except OSError as error:
        _refuse(f"{file} cannot be written ({error.strerror}); name a file in your own folder")


def _fit_units(file: Path, systemd: Path, *, is_good: bool, is_quiet: bool) -> None:
    """Write the drop-ins for the configuration; none while it has problems."""
    from gateway.cli.service import fit
    from gateway.config.load import load
    from gateway.config.service_units import drop_ins

    if not is_good:
        typer.echo(f"afterwards: pitch-gateway service {file} --systemd {systemd}", err=True)
        return
    fitted = fit(systemd, drop_ins(load(file)))
    if not is_quiet:
        print_lines(fitted.lines())


def _measured(file: Path, asking: Prompter, draft: "Draft", *, measure: bool | None) -> tuple[str, ...]:
    """Return the time-outs for the drives, as lines of the configuration; empty: not measured."""
    from gateway.commissioning.probe.timing import keys_of, measure_line
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors
    from gateway.transport.errors import TransportError

    if measure is None and asking.is_on and _is_there(draft.answers["drives_at"]):
        try:
            measure = asking.is_yes(MEASURE_QUESTION)
        except typer.Abort:
            measure = False
    if not measure:
        return ()
    try:
        found = asyncio.run(measure_line(load(file).plan.lines[0]))
    except (ConfigErrors, TransportError) as error:
        why = error.detail if isinstance(error, TransportError) else "something is left to do in it"
        typer.echo(f"not measured: {why}; later: pitch-gateway probe --timing {file}", err=True)
        return ()
    for line in found.lines():
        typer.echo(line, err=True)
    return () if found.proposed is None else keys_of(found.proposed)


def _is_there(address: str) -> bool:
    """Whether a port exists, or a listener answers."""
    from gateway.commissioning.first_configuration import RTU_OVER_TCP

    if address.startswith("/"):
        return os.path.exists(address)  # noqa: PTH110 - a folder without access is no error here
    host, _, port = address.removeprefix(RTU_OVER_TCP).rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=1.0).close()
    except OSError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class _Written:
    """A configuration that was written."""

    file: Path
    left: "Sequence[Problem]"
    """Problems that the user must still solve in it."""
    warnings: "Sequence[Problem]"
    following: Sequence[str]
    """The next commands."""

    def as_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "file": str(self.file),
            "ok": not self.left,
            "left": [problem.as_dict() for problem in self.left],
            "warnings": [warning.as_dict() for warning in self.warnings],
            "next": self.following,
        }

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        yield f"{self.file} is written" + ("; left to do:" if self.left else " and good")
        yield from (f"  {problem}" for problem in self.left)
        yield from (f"warning: {warning}" for warning in self.warnings)
        yield "next:"
        yield from (f"  {line}" for line in self.following)


def _written(file: Path, following: Sequence[str]) -> _Written:
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors

    try:
        return _Written(file, (), load(file).warnings, following)
    except ConfigErrors as errors:
        return _Written(file, errors.problems, errors.warnings, following)


def _next(file: Path, state: str | None) -> list[str]:
    """Return the next three commands, as typed; root runs them as the user of the service."""
    from gateway.ipc.service_user import why_not_for_root

    folder = Path(state or file.parent)
    who = f"sudo -u {folder.owner()} " if why_not_for_root(folder) else ""
    quoted = shlex.quote(str(file))
    return [f"{who}pitch-gateway {command} {quoted}" for command in ("check", "probe", "run")]


def _refuse(why: str) -> NoReturn:
    typer.echo(why, err=True)
    raise typer.Exit(1)
