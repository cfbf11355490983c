"""A good configuration on disk, edited by each test, and what is said about it."""

from pathlib import Path

import pytest

from gateway.config.load import Loaded, load
from gateway.config.problems import ConfigErrors, Problem

GOOD = """\
[gateway]
name = "mill-1"

[line.xyz]
drives = { rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }

[[line.xyz.controllers]]
name = "cnc"
rtu = "/dev/serial/by-id/usb-A"
baudrate = 38400

[[line.xyz.controllers]]
name = "hmi"
tcp = "127.0.0.1:1502"
role = "monitor"

[axis.x]
line = "xyz"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [-300.0, 0.0]
table = "cnc10x.tab"
compensation = "on"
referenced = "drive-bit"
max_speed = 200.0

[axis.x.registers]
command = [{ address = 0x0606, type = "int32", words = "low-first" }]
actual = [{ address = 0x0520, type = "int32", words = "low-first" }]
bits.homed = { address = 0x0140, bit = 6 }
bits.done = { address = 0x0140, bit = 1 }
"""

TWO_WAYS = """\
CNC10 TAB FILE VERSION 3
AXIS X
UNITS MILLIMETER
INTERVAL 150.0
ENTRIES 3
   0.0  +0.0000  +0.0100
-150.0  -0.0100  -0.0030
-300.0  -0.0200  -0.0120
"""
"""Home is the plus end: away from it is backward, towards it forward."""

ONE_WAY = TWO_WAYS.replace("+0.0100", "+0.0000").replace("-0.0030", "-0.0100").replace("-0.0120", "-0.0200")


def edited(*changes: tuple[str, str], text: str = GOOD) -> str:
    """Return the text with every fragment replaced; a fragment that is not there is a mistake of the test."""
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the text"
        text = text.replace(old, new)
    return text


def written(folder: Path, text: str = GOOD, tables: dict[str, str] | None = None) -> Path:
    """Write a configuration with its tables and return its path."""
    (folder / "tables").mkdir(exist_ok=True)
    for name, content in ({"cnc10x.tab": TWO_WAYS} if tables is None else tables).items():
        (folder / "tables" / name).write_text(content)
    path = folder / "gateway.toml"
    path.write_text(text)
    return path


def loaded(folder: Path, text: str = GOOD, tables: dict[str, str] | None = None) -> Loaded:
    """Load a configuration in which nothing is wrong."""
    return load(written(folder, text, tables))


def refused(folder: Path, text: str, tables: dict[str, str] | None = None) -> tuple[Problem, ...]:
    """Load a configuration in which something is wrong and return what is said about it."""
    with pytest.raises(ConfigErrors) as caught:
        load(written(folder, text, tables))
    return caught.value.problems


def line_of(text: str, fragment: str) -> int:
    """Return the line, from 1, on which a fragment first stands."""
    return text[: text.index(fragment)].count("\n") + 1


def only(problems: tuple[Problem, ...], key: str) -> Problem:
    """Return the only problem, which must be one of this key."""
    assert [problem.key for problem in problems] == [key], "\n".join(map(str, problems))
    return problems[0]


def refusal(
    folder: Path, text: str, key: str, *, at: str = "", tables: dict[str, str] | None = None
) -> Problem:
    """Return the only problem of a configuration: it is one of this key, on the line of this fragment."""
    problem = only(refused(folder, text, tables), key)
    assert not at or problem.line == line_of(text, at)
    return problem


def warning_of(
    folder: Path, text: str, key: str, *, at: str = "", tables: dict[str, str] | None = None
) -> Problem:
    """Return the only warning about a configuration: it is one of this key, on the line of this fragment."""
    warning = only(loaded(folder, text, tables).warnings, key)
    assert not at or warning.line == line_of(text, at)
    return warning
