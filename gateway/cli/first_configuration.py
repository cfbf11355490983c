"""The text of a first configuration: one line, one controller, its axes, with a comment on each choice."""

import json
import re
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.drives.profile import Profile, Tier

DELETE: Final = "\x7f"
RTU_OVER_TCP: Final = "rtu://"


class Serial(NamedTuple):
    """How serial ports are to be set; None: as the drive is when it is new."""

    baudrate: int | None = None
    parity: str | None = None
    stop_bits: int | None = None


AS_WHEN_NEW: Final = Serial()
USUAL: Final = Serial(19200, "none", 1)


@dataclass(frozen=True, slots=True)
class AxisAnswers:
    """What has to be known of an axis. Lengths in ``units``."""

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
    """What has to be known before a configuration can be written."""

    drives_at: str
    """A path from /, HOST:PORT, or rtu://HOST:PORT."""
    controller_at: str
    axes: tuple[AxisAnswers, ...]
    name: str = "gateway"
    drives_serial: Serial = USUAL
    """Of their port, where it is a serial one."""
    controller_serial: Serial = USUAL
    timing: tuple[str, ...] = ()
    """Lines of the line, as ``response_timeout_ms = 50``: measured, where they are there."""
    state: str | None = None
    """Where the gateway keeps its state, where that is not beside the configuration."""


def configuration_text(answers: Answers) -> str:
    """Return the configuration with its comments."""
    axes = "\n\n".join("\n".join((*_axis(axis), "")) for axis in answers.axes)
    return "\n".join((*_head(answers), *_line(answers), axes))


def serial_of(asked: Serial, profile: Profile) -> Serial:
    """Return how serial ports are set: as asked, else as the drive is when it is new."""
    known = profile.serial
    return Serial(
        asked.baudrate or known.baudrate or USUAL.baudrate,
        asked.parity or known.parity or USUAL.parity,
        asked.stop_bits or known.stop_bits or USUAL.stop_bits,
    )


PARITIES: Final = {"N": "none", "E": "even", "O": "odd"}
FORMAT_RULE: Final = (
    'allowed: baud rate, data bits, parity and stop bits as manuals write them, as in "115200 8E1"; or '
    '"115200 even 1"; a baud rate alone, as in "38400", leaves parity and stop bits as offered'
)


def serial_format(text: str, offered: Serial = USUAL) -> Serial:
    """Return the settings of a serial port as a person writes them; a baud rate alone changes ``offered``.

    Raises:
        ValueError: it is not understood; says what is allowed.

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
    """Return the settings of a serial port as manuals write them.

    >>> format_words(USUAL)
    '19200 8N1'
    """
    letter = next(letter for letter, parity in PARITIES.items() if parity == serial.parity)
    return f"{serial.baudrate} 8{letter}{serial.stop_bits}"


def _quoted(text: str) -> str:
    """JSON's strings are TOML's, but for one character that TOML wants escaped."""
    return json.dumps(text, ensure_ascii=False).replace(DELETE, "\\u007F")


def _one_line(text: str) -> str:
    """A comment ends with its line."""
    return " ".join(text.split())


def endpoint(place: str, serial: Serial) -> dict[str, object]:
    """Return the keys of a place with their values.

    >>> endpoint("rtu://10.0.0.5:4001", USUAL)
    {'rtu_over_tcp': '10.0.0.5:4001'}
    """
    if place.startswith(RTU_OVER_TCP):
        return {"rtu_over_tcp": place.removeprefix(RTU_OVER_TCP)}
    if not place.startswith("/"):
        return {"tcp": place}
    return {"rtu": place, **serial._asdict()}


def _endpoint(place: str, serial: Serial) -> list[str]:
    return [
        f"{key} = {_quoted(value) if isinstance(value, str) else value}"
        for key, value in endpoint(place, serial).items()
    ]


def _head(answers: Answers) -> list[str]:
    state = answers.state
    kept = () if state is None else (f"state = {_quoted(state)}  # where the service may write",)
    return [
        "# Written by `pitch-gateway init`. docs/configuration.md has every key. Check it after each change",
        "# with `pitch-gateway check`.",
        "#",
        "# The controller's own compensation and backlash are said to be off. With both at work the error of",
        "# the screw would be taken out twice.",
        "",
        "[gateway]",
        f"name = {_quoted(answers.name)}",
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
        'role = "motion"            # may do everything; a display gets "monitor", which may only read',
        "# timeout_ms = 1000        # after this the controller gives up; take it from its program",
        "",
        "",
    ]


def _axis(axis: AxisAnswers) -> list[str]:
    return [
        f"[axis.{axis.name}]",
        'line = "main"',
        f"unit_id = {axis.unit_id}",
        *_drive(axis),
        f"units = {_quoted(axis.units)}",
        f"# {_one_line(axis.profile.counts or 'Counts of the drive in one unit.')}",
        "# Negative where the drive counts down while the axis goes forward.",
        f"counts_per_unit = {axis.counts_per_unit!r}",
        "# zero_counts = 0          # count of the drive at machine position 0",
        f"travel = [{axis.travel[0]!r}, {axis.travel[1]!r}]",
        "# In the folder named above; without a table positions pass 1:1. How to do beyond its ends and at a",
        "# reversal what its control did: pitch-gateway table show FILE",
        f'# table = "{axis.name}.tab"' if axis.table is None else f"table = {_quoted(axis.table)}",
        "# How it is known that the axis knows where it is; as long as it does not, nothing is corrected.",
        f"referenced = {_quoted(axis.referenced)}",
        '# Direction of the last movement of homing: "forward", "backward" or "none" (not known).',
        f"home_approach = {_quoted(axis.home_approach)}",
        "# max_speed = 200.0        # units/s",
        '# "shadow" computes and shows everything and changes nothing; then "on".',
        'compensation = "shadow"',
    ]


def _drive(axis: AxisAnswers) -> list[str]:
    profile = axis.profile
    tier = "" if profile.tier is Tier.OWN else f" (tier {profile.tier.value})"
    return [
        f"# {_one_line(profile.title)}{tier}. Go through its traps before the machine is run:",
        f"# pitch-gateway drives show {_one_line(axis.drive)}",
        f"drive = {_quoted(axis.drive)}",
    ]
