"""Tables of increments, as Fanuc and Mitsubishi controls store them: what both share.

Such a control holds one small whole number for each compensation point: by how much the correction changes
across one section of the axis. The correction itself is the sum of all sections between the reference point,
where it is 0, and the position. Seen in the positive direction every value is a step of the correction::

    correction at the upper end of a section = correction at its lower end + value

No file format of these controls is known to us, so the CSV is our own (comments, separators and sums: see
:mod:`gateway.tabfile.csv_text`)::

    file   := parameter{5} [limit] "point,value" row+
    row    := point "," value           whole numbers, every point once, in ascending order

The parameters are rows of a name and a number, in the order of :class:`System`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gateway.compensation.units import Units
from gateway.tabfile.csv_text import MAX_PROBLEMS, CsvRow, CsvText, check_sums, parse_csv
from gateway.tabfile.errors import TabFileError
from gateway.tabfile.text import INTEGER_ALLOWED, SourceText, shown, to_decimal, to_integer

LIMIT: Final = "limit"
HEADER: Final = ("point", "value")
MAX_POINT: Final = 99_999
TURN_DEGREES: Final = 360.0
TURN_TOLERANCE: Final = 1e-6


@dataclass(frozen=True, slots=True)
class System:
    """What one control calls its parameters, and what it allows.

    ``parameters`` name the numbers of the reference, the lowest and the highest point, the magnification of
    the values and the interval. ``refused`` maps parameters that change the meaning of the values in a way
    that is not read to the reason.
    """

    title: str
    parameters: tuple[str, str, str, str, str]
    lowest_value: int
    highest_value: int
    max_magnification: int
    highest_limit: int
    """A ``limit`` row may allow values up to this; 0: there is no such row."""
    refused: dict[str, str]


@dataclass(frozen=True, slots=True)
class Point:
    """The value of one compensation point."""

    number: int
    value: int
    line: int


@dataclass(frozen=True, slots=True)
class Increments:
    """The file as it stands; ``interval`` in units of the file, ``points`` ascending without a gap."""

    reference: int
    reference_line: int
    magnification: int
    interval: float
    points: tuple[Point, ...]
    csv: CsvText


@dataclass(frozen=True, slots=True)
class Sum:
    """The correction at the end of a section, in counts; ``step`` counts intervals from the reference.

    ``line`` is that of the value that led here from the side of the reference, None at the reference.
    """

    step: int
    total: int
    line: int | None


def parse_increments(source: SourceText, system: System) -> Increments:
    """Read parameters and values.

    Raises:
        TabFileError: a parameter that is missing, refused or no number, points that do not run from the
            lowest to the highest, a value out of range.
    """
    csv = parse_csv(source, ",;", f"{system.parameters[0]} and the number of the reference point")
    rows = csv.rows
    reference = _whole(source, rows, 0, system, (0, MAX_POINT))
    lowest = _whole(source, rows, 1, system, (0, MAX_POINT))
    highest = _whole(source, rows, 2, system, (lowest, MAX_POINT))
    magnification = _whole(source, rows, 3, system, (1, system.max_magnification))
    text = _cell(source, rows, 4, system)
    interval = to_decimal(text)
    if interval is None or interval <= 0:
        raise source.error(
            f"{system.parameters[4]} {shown(text)}",
            "the distance of two points, above 0, with a decimal point",
            line=rows[4].number,
        )
    start, low, high = 5, system.lowest_value, system.highest_value
    if system.highest_limit and len(rows) > start and rows[start].cells[0].lower() == LIMIT:
        high = _bounded(source, rows[start], (high, system.highest_limit))
        low, start = -high, start + 1
    _check_header(source, rows, start, system)
    points = _points(source, rows[start + 1 :], (lowest, highest), (low, high))
    check_sums(source, csv, len(points))
    return Increments(reference, rows[0].number, magnification, interval, points, csv)


def sum_up(sections: Sequence[tuple[int, Point]]) -> tuple[Sum, ...]:
    """Add up from the reference outward; a section is its lower end, in steps from there, and its point.

    The sections ascend without a gap and begin or end at the reference, or reach over it.
    """
    above, total = [], 0
    for low, point in sections:
        if low >= 0:
            total += point.value
            above.append(Sum(low + 1, total, point.line))
    below, total = [], 0
    for low, point in reversed(sections):
        if low < 0:
            total -= point.value
            below.append(Sum(low, total, point.line))
    return (*reversed(below), Sum(0, 0, None), *above)


def is_turn(units: Units, steps: int, interval: float) -> bool:
    """Whether so many intervals are one whole turn of a rotary axis."""
    return units is Units.DEGREE and abs(steps * interval - TURN_DEGREES) <= TURN_TOLERANCE * TURN_DEGREES


def _cell(source: SourceText, rows: Sequence[CsvRow], index: int, system: System) -> str:
    name = system.parameters[index]
    if index >= len(rows):
        raise source.error("the end of the file", f"{name} and its number", line=source.last_line)
    row = rows[index]
    if row.cells[0].lower() in system.refused:
        raise _refused(source, row, system)
    if len(row.cells) != 2 or row.cells[0].lower() != name:
        raise source.error(
            shown(" ".join(row.cells)),
            f"{name} and its number: the first rows are {', '.join(system.parameters)}, in this order",
            line=row.number,
        )
    return row.cells[1]


def _refused(source: SourceText, row: CsvRow, system: System) -> TabFileError:
    name = row.cells[0].lower()
    return source.error(f"parameter {name}: {system.refused[name]}", "a table without it", line=row.number)


def _whole(
    source: SourceText, rows: Sequence[CsvRow], index: int, system: System, bounds: tuple[int, int]
) -> int:
    _cell(source, rows, index, system)
    return _bounded(source, rows[index], bounds)


def _bounded(source: SourceText, row: CsvRow, bounds: tuple[int, int]) -> int:
    low, high = bounds
    number = to_integer(row.cells[1]) if len(row.cells) == 2 else None
    if number is None or not low <= number <= high:
        found = shown(" ".join(row.cells))
        raise source.error(found, f"{row.cells[0]} and a whole number {low} to {high}", line=row.number)
    return number


def _check_header(source: SourceText, rows: Sequence[CsvRow], start: int, system: System) -> None:
    expected = f"'{','.join(HEADER)}' above the values"
    if start >= len(rows):
        raise source.error("the end of the file", expected, line=source.last_line)
    row = rows[start]
    if row.cells[0].lower() in system.refused:
        raise _refused(source, row, system)
    if tuple(cell.lower() for cell in row.cells) != HEADER:
        raise source.error(shown(" ".join(row.cells)), expected, line=row.number)


def _points(
    source: SourceText, rows: Sequence[CsvRow], numbers: tuple[int, int], values: tuple[int, int]
) -> tuple[Point, ...]:
    points, problems = [], []
    expected, highest = numbers
    for row in rows:
        pair = [to_integer(cell) for cell in row.cells]
        if len(pair) != 2 or pair[0] is None or pair[1] is None:
            allowed = f"a point and its value, each {INTEGER_ALLOWED}"
            problems.append(source.problem(shown(" ".join(row.cells)), allowed, line=row.number))
        elif pair[0] != expected or expected > highest:
            allowed = f"point {expected}: every point once, {numbers[0]} to {highest}"
            if expected > highest:
                allowed = f"nothing after point {highest}, the highest"
            raise source.error(f"point {pair[0]}", allowed, line=row.number)
        elif not values[0] <= pair[1] <= values[1]:
            allowed = f"a value from {values[0]} to {values[1]}"
            problems.append(source.problem(f"{pair[1]} at point {pair[0]}", allowed, line=row.number))
        else:
            points.append(Point(pair[0], pair[1], row.number))
        expected += 1
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if expected <= highest:
        raise source.error(
            f"the last point, {expected - 1}", f"points up to {highest}, the highest", line=source.last_line
        )
    return tuple(points)
