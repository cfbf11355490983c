"""A first configuration: one line, one controller, its axes, with a comment on each choice.

A :class:`Draft` takes answers one by one and checks each by the rules of the resulting configuration.
"""

import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway.config.drive_files import read_profile
from gateway.config.load import problems_of_draft
from gateway.config.problems import Problem
from gateway.config.toml_text import quoted
from gateway.config.values import read_name
from gateway.drives import library
from gateway.drives.profile import Profile, Tier
from gateway.transport.endpoints import PARITIES

RTU_OVER_TCP: Final = "rtu://"


class Serial(NamedTuple):
    """Settings of serial ports; None: the drive's default."""

    baudrate: int | None = None
    parity: str | None = None
    stop_bits: int | None = None


AS_WHEN_NEW: Final = Serial()
USUAL: Final = Serial(19200, "none", 1)


@dataclass(frozen=True, slots=True)
class AxisAnswers:
    """Answers about an axis. Lengths in ``units``."""

    name: str
    drive: str
    profile: Profile
    """Of :attr:`drive`."""
    unit_id: int
    units: str
    counts_per_unit: float
    travel: tuple[float, float]
    referenced: str
    home_approach: str = "none"
    table: str | None = None


@dataclass(frozen=True, slots=True)
class Answers:
    """Answers that a configuration needs."""

    drives_at: str
    """A path from /, HOST:PORT, or rtu://HOST:PORT."""
    controller_at: str
    axes: tuple[AxisAnswers, ...]
    name: str = "gateway"
    drives_serial: Serial = USUAL
    """Of their port, if it is a serial one."""
    controller_serial: Serial = USUAL
    timing: tuple[str, ...] = ()
    """Measured lines for the line's section, such as ``response_timeout_ms = 50``; empty: not measured."""
    state: str | None = None
    """The state folder of the gateway, if it is not beside the configuration."""


def configuration_text(answers: Answers) -> str:
    """Return the configuration with its comments."""
    axes = "\n\n".join("\n".join((*_axis(axis), "")) for axis in answers.axes)
    return "\n".join((*_head(answers), *_line(answers), axes))


def serial_of(asked: Serial, profile: Profile) -> Serial:
    """Return the settings of serial ports: the given ones, else the drive's default."""
    usual = profile.serial
    return Serial(
        asked.baudrate or usual.baudrate or USUAL.baudrate,
        asked.parity or usual.parity or USUAL.parity,
        asked.stop_bits or usual.stop_bits or USUAL.stop_bits,
    )


FORMAT_RULE: Final = (
    'allowed: baud rate, data bits, parity and stop bits as manuals write them, as in "115200 8E1"; or '
    '"115200 even 1"; a baud rate alone, as in "38400", leaves parity and stop bits as offered'
)


def serial_format(text: str, offered: Serial = USUAL) -> Serial:
    """Return the settings of a serial port from a person's text; a baud rate alone changes ``offered``.

    Raises:
        ValueError: the text is invalid; the error says what is allowed.

    >>> serial_format("115200 8E1"), serial_format("9600 none 2")
    (Serial(baudrate=115200, parity='even', stop_bits=1), Serial(baudrate=9600, parity='none', stop_bits=2))
    >>> serial_format("38400", Serial(9600, "even", 1))
    Serial(baudrate=38400, parity='even', stop_bits=1)
    """
    if text.strip().isdecimal():
        return offered._replace(baudrate=int(text))
    short = re.fullmatch(r"(\d+)[ ,/-]+8[ ,/-]?([NEO])[ ,/-]?([12])", text.strip().upper())
    if short is not None:
        return Serial(int(short[1]), PARITIES[short[2]], int(short[3]))
    long = re.fullmatch(r"(\d+)[ ,]+(none|even|odd)[ ,]+([12])", text.strip().lower())
    if long is None:
        raise ValueError(f'found "{text}"; {FORMAT_RULE}')
    return Serial(int(long[1]), long[2], int(long[3]))


def format_words(serial: Serial) -> str:
    """Return the settings of a serial port in the notation of manuals.

    >>> format_words(USUAL)
    '19200 8N1'
    """
    letter = next(letter for letter, parity in PARITIES.items() if parity == serial.parity)
    return f"{serial.baudrate} 8{letter}{serial.stop_bits}"


def _one_line(text: str) -> str:
    """A comment ends with its line."""
    return " ".join(text.split())


def endpoint(address: str, serial: Serial) -> dict[str, object]:
    """Return the keys of an endpoint with their values.

    >>> endpoint("rtu://10.0.0.5:4001", USUAL)
    {'rtu_over_tcp': '10.0.0.5:4001'}
    """
    if address.startswith(RTU_OVER_TCP):
        return {"rtu_over_tcp": address.removeprefix(RTU_OVER_TCP)}
    if not address.startswith("/"):
        return {"tcp": address}
    return {"rtu": address, **serial._asdict()}


def _endpoint(address: str, serial: Serial) -> list[str]:
    return [
        f"{key} = {quoted(value) if isinstance(value, str) else value}"
        for key, value in endpoint(address, serial).items()
    ]


def _head(answers: Answers) -> list[str]:
    state = answers.state
    kept = () if state is None else (f"state = {quoted(state)}  # where the service may write",)
    return [
        "# Written by `pitch-gateway init`. docs/configuration.md has every key. Check it after each change",
        "# with `pitch-gateway check`.",
        "#",
        "# The controller's own compensation and backlash must be off. With both at work the error of",
        "# the screw would be corrected twice.",
        "",
        "[gateway]",
        f"name = {quoted(answers.name)}",
        'tables = "tables"          # folder with the table files, relative to this file',
        *kept,
        "",
        "[http]",
        'listen = "127.0.0.1:8480"  # the page beside the machine; "" for none',
        "",
        "# [mqtt]                   # status and events to a broker: docs/mqtt.md",
        '# host = "127.0.0.1"',
        "",
        "",
    ]


def _line(answers: Answers) -> list[str]:
    return [
        "[line.main]",
        "# A path from /dev/serial/by-id stays the same when adapters are replugged.",
        f"drives = {{ {', '.join(_endpoint(answers.drives_at, answers.drives_serial))} }}",
        *(("# Measured: pitch-gateway probe --timing",) if answers.timing else ()),
        *answers.timing,
        "",
        "[[line.main.controllers]]",
        'name = "controller"',
        *_endpoint(answers.controller_at, answers.controller_serial),
        'role = "motion"            # may do everything; "monitor", for a display, may only read',
        "# timeout_ms = 1000        # how long the controller waits; take it from its program",
        "",
        "",
    ]


def _axis(axis: AxisAnswers) -> list[str]:
    return [
        f"[axis.{axis.name}]",
        'line = "main"',
        f"unit_id = {axis.unit_id}",
        *_drive(axis),
        f"units = {quoted(axis.units)}",
        f"# {_one_line(axis.profile.counts or 'Counts of the drive in one unit.')}",
        "# Negative if the drive counts down while the axis goes forward.",
        f"counts_per_unit = {axis.counts_per_unit!r}",
        "# zero_counts = 0          # count of the drive at machine position 0",
        f"travel = [{axis.travel[0]!r}, {axis.travel[1]!r}]",
        "# In the folder named above; without a table positions pass 1:1. To behave like its control beyond",
        "# the ends and at a reversal: pitch-gateway table show FILE",
        f'# table = "{axis.name}.tab"' if axis.table is None else f"table = {quoted(axis.table)}",
        "# How the gateway knows that the axis is referenced; until it is, nothing is corrected.",
        f"referenced = {quoted(axis.referenced)}",
        '# Direction of the last movement of homing: "forward", "backward" or "none" (not known).',
        f"home_approach = {quoted(axis.home_approach)}",
        "# max_speed = 200.0        # units/s",
        '# "shadow" computes and shows corrections, positions pass unchanged; later "on".',
        'compensation = "shadow"',
    ]


def _drive(axis: AxisAnswers) -> list[str]:
    profile = axis.profile
    tier = "" if profile.tier is Tier.OWN else f" (tier {profile.tier.value})"
    return [
        f"# {_one_line(profile.title)}{tier}. Before the machine runs, check its list of traps:",
        f"# pitch-gateway drives show {_one_line(axis.drive)}",
        f"drive = {quoted(axis.drive)}",
    ]


NOT_ASKED: Final = frozenset({"axes", "name", "profile", "table"})
"""Fields that come from elsewhere: the named axes, the drive, :meth:`Draft.set_table`."""


def _required(answers: type) -> tuple[str, ...]:
    return tuple(
        field.name for field in fields(answers) if field.default is MISSING and field.name not in NOT_ASKED
    )


REQUIRED: Final = _required(Answers)
REQUIRED_OF_AXIS: Final = _required(AxisAnswers)
OF_AN_AXIS: Final = tuple(each.name for each in fields(AxisAnswers) if each.name not in NOT_ASKED)
LINE: Final = "main"
CONTROLLER: Final = "controller"
GENERAL_KEYS: Final = {
    "drives_at": f"line.{LINE}.drives",
    "controller_at": f"line.{LINE}.controllers",
    "drives_format": f"line.{LINE}.drives",
    "controller_format": f"line.{LINE}.controllers",
    "name": "gateway.name",
}
"""Answers that do not belong to an axis, each with its key."""
FORMATS: Final = {"drives_format": "drives_at", "controller_format": "controller_at"}
"""Serial settings, each with the answer that names its port."""
ADDRESS_RULE: Final = (
    'allowed: "HOST:PORT", as in "192.168.0.7:502", or the full path of a serial port, as in "/dev/ttyUSB0"'
)
ANY_PORT: Final = "/dev/ttyUSB0"


class Draft:
    """Takes answers one by one; those about an axis follow its name.

    The name of an answer is its name in ``Answers`` or ``AxisAnswers``.
    """

    def __init__(self, file: Path, drives: Serial, controller: Serial) -> None:
        """``drives`` and ``controller``: settings of their serial ports, as far as options give them."""
        self.answers: dict[str, Any] = {}
        """Those that do not belong to an axis."""
        self.axes: dict[str, dict[str, Any]] = {}
        """Those of each axis, in the order of naming."""
        self.tables: dict[str, str | None] = {}
        """The table file of each axis; checked only in the written file."""
        self.notes: list[str] = []
        """Problems elsewhere that valid answers reveal; the user can correct them in the file."""
        self._file = file
        self._axis = ""
        self._profiles: dict[str, Profile] = {}
        self._serial = {"drives_format": drives, "controller_format": controller}
        self._seen_problems: set[Problem] = set()

    @property
    def profile(self) -> Profile | None:
        """Return the profile of the last named axis."""
        return self._profiles.get(self._axis)

    def begin_axis(self, name: str) -> None:
        """Take the name of an axis; the following answers about axes belong to it.

        Raises:
            ValueError: the name is invalid or already used.
        """
        try:
            read_name(name)
        except ValueError as error:
            raise ValueError(f'found "{name}"; {error}') from None
        if name in self.axes:
            raise ValueError(f'found "{name}"; there is an axis {name} already: give this one another name')
        self._axis = name
        self.axes[name] = {}

    def wrong_serial(self) -> tuple[str, Problem] | None:
        """Return a wrong option about a serial port, with the reason, whatever questions follow."""
        for name in FORMATS:
            tables = {"line": {LINE: {"drives": endpoint(ANY_PORT, self.serial(name))}}}
            for problem in problems_of_draft(self._file, tables):
                if problem.key.startswith(f"{GENERAL_KEYS['drives_at']}."):
                    option = problem.key.rpartition(".")[2].replace("_", "-")
                    return f"--{'' if name == 'drives_format' else 'controller-'}{option}", problem
        return None

    def serial(self, name: str, answers: Mapping[str, Any] | None = None) -> Serial:
        """Return the settings of the port ``name`` (of ``FORMATS``), by default those of the drives."""
        found = (self.answers if answers is None else answers).get(name)
        if isinstance(found, Serial):
            return found
        asked = self._serial[name]
        if name == "controller_format":
            given = {key: value for key, value in asked._asdict().items() if value is not None}
            return self.serial("drives_format", answers)._replace(**given)
        for profile in self._profiles.values():  # the first drive decides: all are on one cable
            return serial_of(asked, profile)
        return USUAL._replace(**{key: value for key, value in asked._asdict().items() if value is not None})

    @property
    def read_address(self) -> int:
        """Return a readable register of the drive: that of its position, if known."""
        fields = () if self.profile is None else self.profile.registers.actual
        return next((field.address for field in fields), 0)

    def wants_format(self, name: str) -> bool:
        """Whether to ask for the settings of a port: it is serial, and no option gave them."""
        is_serial = str(self.answers.get(FORMATS[name], "")).startswith("/")
        return is_serial and None in self._serial[name]

    def take(self, name: str, answer: object) -> None:
        """Take an answer.

        Raises:
            ValueError: there is no such answer, an axis must be named first, or the configuration would
                refuse it; the error says what was found and what is allowed.
        """
        if name not in GENERAL_KEYS:
            if name not in OF_AN_AXIS:
                allowed = ", ".join((*GENERAL_KEYS, *OF_AN_AXIS))
                raise ValueError(f'there is no answer "{name}"; allowed: {allowed}')
            self._check_named(name)
        if name in FORMATS:
            answer = serial_format(str(answer), self.serial(name))
        if name == "unit_id":
            self._refuse_same_unit(answer)
        answers, axes = self.answers, self.axes
        if name in GENERAL_KEYS:
            answers = {**answers, name: answer}
        else:
            axes = {**axes, self._axis: {**axes[self._axis], name: answer}}
        problems = problems_of_draft(self._file, self._tables(answers, axes))
        new = [
            problem
            for problem in problems
            if problem.found != "missing" and problem not in self._seen_problems
        ]
        own = [problem for problem in new if self._is_about(problem, name)]
        if own:
            raise ValueError("\n  ".join(_problem_text(problem, name) for problem in own))
        self.answers, self.axes = answers, axes
        self._seen_problems.update(new)
        self.notes += [f"{problem.key}: {problem.found}; {problem.remedy}" for problem in new]
        if name == "drive":
            self._profiles[self._axis] = _profile(str(answer), self._file.parent)

    def set_table(self, file: str | None) -> None:
        """Set the table file of the last named axis, None for none. Raises ValueError: no axis is named."""
        self._check_named("table")
        self.tables[self._axis] = file

    def _check_named(self, answer: str) -> None:
        if not self.axes:
            raise ValueError(f"{answer}: belongs to an axis; name the axis first, with begin_axis")

    def _refuse_same_unit(self, unit_id: object) -> None:
        """Refuse a drive with several axes: each has its own registers, so that is written by hand."""
        for name, answers in self.axes.items():
            if name != self._axis and answers.get("unit_id") == unit_id:
                raise ValueError(f"found {unit_id}; axis {name} has this unit id: each drive needs its own")

    def text(self, state: str | None = None, timing: tuple[str, ...] = ()) -> str:
        """Return the configuration with its comments.

        Raises:
            ValueError: an answer without a default is missing; the error names all of them.
        """
        missing = [name for name in REQUIRED if name not in self.answers]
        missing += [] if self.axes else ["an axis"]
        for axis, its in self.axes.items():
            missing += [f"axis {axis}: {name}" for name in REQUIRED_OF_AXIS if name not in its]
        if missing:
            raise ValueError(f"answers are missing: {', '.join(missing)}; take them before the text")
        given = {name: answer for name, answer in self.answers.items() if name not in FORMATS}
        answers = Answers(
            **given,
            axes=tuple(
                AxisAnswers(name=name, profile=self._profiles[name], table=self.tables.get(name), **its)
                for name, its in self.axes.items()
            ),
            drives_serial=self.serial("drives_format"),
            controller_serial=self.serial("controller_format"),
            timing=timing,
            state=state,
        )
        return configuration_text(answers)

    def _is_about(self, problem: Problem, name: str) -> bool:
        if name == "drive":
            keys = [f"axis.{self._axis}.drive", f"axis.{self._axis}.registers"]
            return problem.file != str(self._file) or problem.key.startswith(tuple(keys))
        return problem.key.startswith(GENERAL_KEYS.get(name, f"axis.{self._axis}.{name}"))

    def _tables(self, answers: Mapping[str, Any], axes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        """Return the configuration as far as the answers go."""
        line: dict[str, Any] = {}
        if "drives_at" in answers:
            line["drives"] = endpoint(answers["drives_at"], self.serial("drives_format", answers))
        if "controller_at" in answers:
            serial = self.serial("controller_format", answers)
            line["controllers"] = [{"name": CONTROLLER, **endpoint(answers["controller_at"], serial)}]
        gateway = {"name": answers["name"]} if "name" in answers else {}
        return {
            "gateway": gateway,
            "line": {LINE: line},
            "axis": {name: {"line": LINE, **_as_toml(its)} for name, its in axes.items()},
        }


def _as_toml(answers: Mapping[str, Any]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in answers.items()}


def _profile(name: str, folder: Path) -> Profile:
    return library.shipped(name) if library.is_name(name) else read_profile(folder / name)


def _problem_text(problem: Problem, name: str) -> str:
    if (
        name in GENERAL_KEYS
        and problem.key.endswith(".tcp")
        and problem.remedy.startswith('allowed: "HOST:PORT"')
    ):
        return f"{problem.found}; {ADDRESS_RULE}"
    if name == "drive":
        return str(problem) if problem.line is not None else f"{problem.found}; {problem.remedy}"
    return f"{problem.found}; {problem.remedy}"
