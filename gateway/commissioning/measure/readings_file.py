"""The file of a measuring run: each reading is on the disk at once, so that none is lost.

Comment lines with facts, then a header and a row for each reading::

    # axis: x
    # units: mm
    # compensation: off
    # targets: 0 50 100
    # runs: 5
    # overrun: 1
    target_mm,direction,run,measured_mm
    0.0,forward,1,0.0012

``compensation`` is ``off``, or ``active`` with the SHA-256 of the table in force. Lengths are machine
positions in units of the axis, mm or inch, as in the names of the columns. ``table build`` and ``table
refine`` read the file.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import IO, Final

from gateway.commissioning.measure.errors import FileError
from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.cycle import Stop
from gateway.metrology.readings import Reading

SUFFIX: Final = ".readings.csv"
TOGETHER: Final = 1e-8
"""Tolerance for a target in the file against the plan: it is written with 9 decimals."""
_DIRECTIONS: Final = {"forward": Direction.FORWARD, "backward": Direction.BACKWARD}


@dataclass(frozen=True, slots=True)
class MeasuringPlan:
    """The measurement: targets in units of the axis, the number of runs, and the overrun."""

    targets: tuple[float, ...]
    runs: int
    overrun: float


@dataclass(frozen=True, slots=True)
class Earlier:
    """A file to continue."""

    facts: Mapping[str, str]
    readings: tuple[Reading, ...]
    plan: MeasuringPlan


class ReadingsFile:
    """Appends readings; every row is on the disk when :meth:`append` returns."""

    def __init__(self, path: Path, units: Units) -> None:
        self.path = path
        self._units = units
        self._stream: IO[str] | None = None

    def create(self, facts: Mapping[str, str]) -> None:
        """Begin a new file with its facts. Raises FileError: it exists, or cannot be written."""
        try:
            self._stream = self.path.open("x", encoding="utf-8", newline="")
        except FileExistsError:
            raise FileError(
                f"{self.path}: exists already; give another name with --readings, or continue it: --resume "
                f"{self.path}"
            ) from None
        except OSError as error:
            raise FileError(f"{self.path}: {error.strerror or error}") from None
        head = "".join(f"# {name}: {fact}\n" for name, fact in facts.items())
        try:
            self._put(head + header_of(self._units) + "\n")
        except FileError:  # a partial header would block the next try
            self.close()
            self.path.unlink(missing_ok=True)
            raise

    def go_on(self) -> None:
        """Append to the existing file. Raises FileError."""
        try:
            self._stream = self.path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise FileError(f"{self.path}: {error.strerror or error}") from None

    def append(self, reading: Reading) -> None:
        """Write a reading to the disk. Raises FileError."""
        way = reading.direction.name.lower()
        self._put(f"{_number(reading.target)},{way},{reading.run},{_number(reading.measured)}\n")

    def close(self) -> None:
        """Close it. The data are on the disk already; failures were reported."""
        if self._stream is not None:
            with suppress(OSError):  # a full disk rejects the rest of a failed row again
                self._stream.close()
            self._stream = None

    def _put(self, text: str) -> None:
        assert self._stream is not None
        try:
            self._stream.write(text)
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise FileError(f"{self.path}: {error.strerror or error}") from None


def header_of(units: Units) -> str:
    """Return the names of the columns.

    >>> header_of(Units.MM)
    'target_mm,direction,run,measured_mm'
    """
    return f"target_{units.value},direction,run,measured_{units.value}"


def facts_of(plan: MeasuringPlan, axis: str, compensation: str, units: Units) -> dict[str, str]:
    """Return the facts at the beginning of a file of readings."""
    return {
        "axis": axis,
        "units": units.value,
        "compensation": compensation,
        "targets": " ".join(map(_number, plan.targets)),
        "runs": str(plan.runs),
        "overrun": _number(plan.overrun),
    }


def read_earlier(path: Path, units: Units) -> Earlier:
    """Read the file of an earlier run.

    Raises:
        FileError: an invalid line, with its number and the remedy.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{path}: {error}") from None
    facts: dict[str, str] = {}
    readings: list[Reading] = []
    header, has_header = header_of(units), False
    for number, line in enumerate(text.splitlines(keepends=True), start=1):
        where = f"{path}, line {number}"
        row = line.rstrip("\n")
        if row == line:
            raise FileError(f"{where}: {row!r} is not a complete row: delete it and measure its stop again")
        if row.startswith("#") and not has_header:
            name, _, fact = row[1:].partition(":")
            facts[name.strip()] = fact.strip()
        elif not has_header:
            if row != header:
                raise FileError(f"{where}: {row!r}; it must be {header}: give the file of a measuring run")
            has_header = True
        else:
            readings.append(_reading(where, row))
    if not has_header:
        raise FileError(f"{path}: no line {header}: give the file of a measuring run")
    return Earlier(facts, tuple(readings), _plan(path, facts))


def check_order(path: Path, stops: Sequence[Stop], readings: Sequence[Reading]) -> None:
    """Check that readings are those of the first measuring stops.

    Raises:
        FileError: a reading is of another stop, or there are too many.
    """
    measured = [stop for stop in stops if stop.measure]
    if len(readings) > len(measured):
        raise FileError(f"{path}: {len(readings)} readings, but its plan has {len(measured)} stops")
    for index, (stop, reading) in enumerate(zip(measured, readings, strict=False), start=1):
        is_near = abs(stop.nominal - reading.target) <= TOGETHER
        if not is_near or (stop.direction, stop.run) != (reading.direction, reading.run):
            raise FileError(
                f"{path}, reading {index}: at {reading.target:.9g} {reading.direction.name.lower()}, run "
                f"{reading.run}, but the plan has {stop.nominal:.9g} {stop.direction.name.lower()}, run "
                f"{stop.run}: rows were lost or changed; start a new measurement"
            )


def _reading(where: str, row: str) -> Reading:
    fields = row.split(",")
    try:
        target, way, run, measured = fields
        numbers = float(target), float(measured)
        direction, count = _DIRECTIONS[way], int(run)
    except (ValueError, KeyError):
        raise FileError(f"{where}: {row!r}; it must be as in 50.0,forward,1,50.0123") from None
    if not all(map(isfinite, numbers)) or count < 1:
        raise FileError(f"{where}: {row!r}: numbers must be finite, runs count from 1")
    return Reading(numbers[0], direction, numbers[1], count)


def _plan(path: Path, facts: Mapping[str, str]) -> MeasuringPlan:
    try:
        targets = tuple(float(target) for target in facts["targets"].split())
        plan = MeasuringPlan(targets, int(facts["runs"]), float(facts["overrun"]))
    except (KeyError, ValueError):
        raise FileError(
            f"{path}: give a file that measure has begun: the lines # targets, # runs and # overrun of "
            "this one do not state the plan"
        ) from None
    if len(plan.targets) < 2 or plan.runs < 1 or not isfinite(plan.overrun):
        raise FileError(
            f"{path}: # targets, # runs or # overrun: give two or more targets, and one or more runs"
        )
    return plan


def _number(value: float) -> str:
    """Return the text of a length in full, without an exponent.

    >>> _number(0.1 + 0.2), _number(50.0), _number(-1e-7)
    ('0.3', '50.0', '-0.0000001')
    """
    text = f"{value:.9f}".rstrip("0")
    return text + "0" if text.endswith(".") else text
