"""The file of a measuring run: each reading is written to the disk immediately, so that none is lost.

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

The file of a walk has the facts of the walk and of its block, and a row for each reading of the dial::

    # method: block-walk
    # from: 0.0
    # to: 500.0
    # block: 50.0
    # placements: 50
    # per_side: 1
    # dial_range: 10.0
    # gap: opens
    # seed: 1
    # overrun: 1.0
    # block_grade: 1
    target_mm,direction,placement,block_mm,dial_mm
    0.0,forward,1,0.0,0.012
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import accumulate
from math import isfinite
from pathlib import Path
from typing import IO, Final

from gateway.commissioning.measure.errors import FileError
from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.cycle import Stop, bidirectional_cycle, remaining
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period, lead_warnings
from gateway.metrology.readings import Reading
from gateway.metrology.standard import Standard, standard_of
from gateway.metrology.walk import (
    CLOSES,
    GAP,
    OPENS,
    Walk,
    from_placement,
    hidden,
    hidden_warning,
)

METHOD: Final = "method"
BLOCK_WALK: Final = "block-walk"
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

    @property
    def stops(self) -> list[Stop]:
        """All stops."""
        return list(bidirectional_cycle(self.targets, self.overrun, self.runs))

    def left(self, done: int) -> list[Stop]:
        """Return the remaining stops after ``done`` readings."""
        return remaining(self.stops, done)

    def warnings(self, periods: Sequence[Period], units: Units) -> list[str]:
        """Return what the targets will not show."""
        return lead_warnings(self.targets, periods, units)

    def facts(self) -> dict[str, str]:
        """Return its lines in a file."""
        return {
            "targets": " ".join(map(_number, self.targets)),
            "runs": str(self.runs),
            "overrun": _number(self.overrun),
        }


@dataclass(frozen=True, slots=True)
class WalkPlan:
    """The walk of a block along an axis; lengths in units of the axis."""

    walk: Walk
    standard: Standard
    overrun: float
    units: Units

    @property
    def stops(self) -> list[Stop]:
        """All stops."""
        return list(self.walk.stops(self.units, self.overrun))

    @property
    def targets(self) -> tuple[float, ...]:
        """All positions with readings, lowest first."""
        return tuple(sorted({x for each in self.walk.placed(self.units) for x in each.positions}))

    def left(self, done: int) -> list[Stop]:
        """Return the remaining stops after ``done`` readings: a placement begins with its first reading."""
        return from_placement(self.stops, done // self.walk.readings + 1)

    def warnings(self, periods: Sequence[Period], units: Units) -> list[str]:
        """Return what the walk will not show."""
        concealed = hidden([each.positions for each in self.walk.placed(units)], periods)
        return [hidden_warning(concealed, self.walk, units.value)] if concealed else []

    def facts(self) -> dict[str, str]:
        """Return its lines in a file."""
        walk = self.walk
        return {
            METHOD: BLOCK_WALK,
            "from": _number(walk.low),
            "to": _number(walk.high),
            "block": _number(walk.block),
            "placements": str(walk.placements),
            "per_side": str(walk.per_side),
            "dial_range": _number(walk.reach),
            GAP: CLOSES if walk.closes else OPENS,
            "seed": str(walk.seed),
            "overrun": _number(self.overrun),
            **self.standard.facts(),
        }


Plan = MeasuringPlan | WalkPlan


@dataclass(frozen=True, slots=True)
class Earlier:
    """A file to continue."""

    facts: Mapping[str, str]
    readings: tuple[Reading, ...]
    plan: Plan


class ReadingsFile:
    """Appends readings; every row is on the disk when :meth:`append` returns.

    ``gap`` is for a walk: 1 if the gap of the dial opens while the axis moves forward, -1 if it closes. None:
    readings of positions.
    """

    def __init__(self, path: Path, units: Units, gap: float | None = None) -> None:
        self.path = path
        self._units = units
        self._gap = gap
        self._stream: IO[str] | None = None
        self._rows: list[int] = []
        """Where each row of a reading begins, in bytes."""

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
            self._put(head + header_of(self._units, is_walk=self._gap is not None) + "\n")
        except FileError:  # a partial header would block the next try
            self.close()
            self.path.unlink(missing_ok=True)
            raise

    def go_on(self) -> None:
        """Append to the existing file. Raises FileError."""
        try:
            lines = self.path.read_bytes().splitlines(keepends=True)
            self._stream = self.path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise FileError(f"{self.path}: {error.strerror or error}") from None
        starts = list(accumulate((len(line) for line in lines), initial=0))
        header = sum(line.startswith(b"#") for line in lines) + 1
        self._rows = starts[header:-1]

    def take_back(self, count: int) -> None:
        """Remove the last ``count`` rows. Raises FileError."""
        assert self._stream is not None
        if not count:
            return
        start = self._rows[-count]
        try:
            self._stream.truncate(start)
            self._stream.seek(start)
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise FileError(f"{self.path}: {error.strerror or error}") from None
        del self._rows[-count:]

    def append(self, reading: Reading) -> None:
        """Write a reading to the disk. Raises FileError."""
        way = reading.direction.name.lower()
        shown = _number(reading.measured)
        if self._gap is not None:
            dial = self._gap * (reading.measured - reading.block)
            shown = f"{_number(abs(reading.block))},{_number(dial)}"
        self._rows.append(self._size())
        self._put(f"{_number(reading.target)},{way},{reading.run},{shown}\n")

    def _size(self) -> int:
        assert self._stream is not None
        return os.fstat(self._stream.fileno()).st_size

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


def header_of(units: Units, *, is_walk: bool = False) -> str:
    """Return the names of the columns.

    >>> header_of(Units.MM), header_of(Units.MM, is_walk=True)
    ('target_mm,direction,run,measured_mm', 'target_mm,direction,placement,block_mm,dial_mm')
    """
    if is_walk:
        return f"target_{units.value},direction,placement,block_{units.value},dial_{units.value}"
    return f"target_{units.value},direction,run,measured_{units.value}"


def facts_of(plan: Plan, axis: str, compensation: str, units: Units) -> dict[str, str]:
    """Return the facts at the beginning of a file of readings."""
    return {"axis": axis, "units": units.value, "compensation": compensation, **plan.facts()}


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
    gap: float | None = None
    for number, line in enumerate(text.splitlines(keepends=True), start=1):
        where = f"{path}, line {number}"
        row = line.rstrip("\n")
        if row == line:
            raise FileError(f"{where}: {row!r} is not a complete row: delete it and measure its stop again")
        if row.startswith("#") and not has_header:
            name, _, fact = row[1:].partition(":")
            facts[name.strip()] = fact.strip()
            if name.strip() == METHOD and fact.strip() == BLOCK_WALK:
                header, gap = header_of(units, is_walk=True), 1.0
        elif not has_header:
            if row != header:
                raise FileError(f"{where}: {row!r}; it must be {header}: give the file of a measuring run")
            has_header = True
            if gap is not None and facts.get(GAP) == CLOSES:
                gap = -1.0
        else:
            readings.append(_reading(where, row) if gap is None else _dial(where, row, gap))
    if not has_header:
        raise FileError(f"{path}: no line {header}: give the file of a measuring run")
    plan = _plan(path, facts) if gap is None else _walk_plan(path, facts, units)
    return Earlier(facts, tuple(readings), plan)


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
        is_same = (stop.direction, stop.run, stop.block) == (reading.direction, reading.run, reading.block)
        if not is_near or not is_same:
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


def _dial(where: str, row: str, gap: float) -> Reading:
    """Return the reading of a row of a walk."""
    try:
        target, way, placement, block, dial = row.split(",")
        numbers = float(target), float(block), float(dial)
        direction, count = _DIRECTIONS[way], int(placement)
    except (ValueError, KeyError):
        raise FileError(f"{where}: {row!r}; it must be as in 50.0,forward,1,50.0,0.0123") from None
    if not all(map(isfinite, numbers)) or count < 1:
        raise FileError(f"{where}: {row!r}: numbers must be finite, placements count from 1")
    position, length, shown = numbers
    return Reading(position, direction, gap * (length + shown), count, block=gap * length)


def _walk_plan(path: Path, facts: Mapping[str, str], units: Units) -> WalkPlan:
    try:
        walk = Walk(
            float(facts["from"]),
            float(facts["to"]),
            float(facts["block"]),
            int(facts["placements"]),
            float(facts["dial_range"]),
            int(facts["seed"]),
            facts[GAP] == CLOSES,
            int(facts["per_side"]),
        )
        return WalkPlan(walk, standard_of(facts), float(facts["overrun"]), units)
    except (KeyError, ValueError, ReadingsError) as error:
        raise FileError(
            f"{path}: give a file that measure has begun: its lines # from, # to, # block, # placements, "
            f"# per_side, # dial_range, # gap, # seed and # overrun do not state the walk ({error})"
        ) from None


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
