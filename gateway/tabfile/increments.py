"""Tables of increments, as Fanuc and Mitsubishi controls store them: what both share.

Such a control holds one small whole number for each compensation point: the change of the correction across
one section of the axis. The correction itself is the sum of all sections between the reference point, where
it is 0, and the position. Seen in the positive direction every value is a step of the correction::

    correction at the upper end of a section = correction at its lower end + value

No file format of these controls is known to us, so the CSV is our own (comments, separators and sums: see
:mod:`gateway.tabfile.csv_text`)::

    file   := parameter{5} [limit] "point,value" row+
    row    := point "," value           whole numbers, every point once, in ascending order

The parameters are rows of a name and a number, in the order of :class:`System`.
"""

from collections.abc import Sequence
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import (
    AS_THEY_STAND,
    Interpretation,
    check_home,
    check_own_range,
    context_in_file_units,
    required_units,
)
from gateway.tabfile.csv_text import (
    MAX_PROBLEMS,
    CsvRow,
    CsvText,
    axis_letter,
    check_sums,
    csv_file,
    parse_csv,
)
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import TabFileError
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import INTEGER_ALLOWED, SourceText, shown, to_decimal, to_integer
from gateway.tabfile.writing import (
    EVEN_TOLERANCE,
    NEEDS_SCALE,
    WriteOptions,
    Written,
    even_step,
    one_curve,
    unwritable,
)

LIMIT: Final = "limit"
HEADER: Final = ("point", "value")
MAX_POINT: Final = 99_999
REVOLUTION_DEGREES: Final = 360.0
REVOLUTION_TOLERANCE: Final = 1e-6


class System(Struct, frozen=True):
    """A control's names for its parameters, and its limits.

    ``parameters`` name the numbers of the reference, the lowest and the highest point, the magnification of
    the values and the interval. ``refused`` maps parameters that change the meaning of the values, and are
    not read, to the reason.
    """

    title: str
    parameters: tuple[str, str, str, str, str]
    lowest_value: int
    highest_value: int
    max_magnification: int
    highest_limit: int
    """A ``limit`` row may allow values up to this; 0: no such row."""
    refused: dict[str, str]


class Point(Struct, frozen=True):
    """The value of one compensation point."""

    number: int
    value: int
    line: int


class Increments(Struct, frozen=True):
    """The file as written; ``interval`` in units of the file, ``points`` ascending without a gap."""

    reference: int
    reference_line: int
    magnification: int
    interval: float
    points: tuple[Point, ...]
    csv: CsvText


class Sum(Struct, frozen=True):
    """The correction at the end of a section, in counts; ``step`` counts intervals from the reference.

    ``line`` is that of the value that led here from the side of the reference, None at the reference.
    """

    step: int
    total: int
    line: int | None


def parse_increments(source: SourceText, system: System) -> Increments:
    """Read parameters and values.

    Raises:
        TabFileError: a parameter that is missing, refused or not a number, points that do not run from the
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
            "the distance between two points, above 0, with a decimal point",
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

    The sections ascend without a gap. They begin or end at the reference, or include it.
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


def is_revolution(units: Units, steps: int, interval: float) -> bool:
    """Whether this number of intervals is one full revolution of a rotary axis."""
    return (
        units is Units.DEGREE
        and abs(steps * interval - REVOLUTION_DEGREES) <= REVOLUTION_TOLERANCE * REVOLUTION_DEGREES
    )


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
    return source.error(
        f"parameter {name}: {system.refused[name]}", "a table without this parameter", line=row.number
    )


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
                allowed = f"no more points after {highest}, the highest"
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


# --- Sums of increments and tables: scale, position, revolutions, and rounding that keeps the sums exact

HOLDS: Final = ('outside = "hold"',)
"""No more steps follow the last point, so the sum does not change."""


class Convention(Struct, frozen=True):
    """What sums become: the number of values in one count, the rule in words, and its unproven part."""

    values_per_count: int
    rule: str
    assumed: tuple[str, ...] = ()


def decode(
    source: SourceText,
    context: FileContext,
    file: Increments,
    sums: Sequence[Sum],
    convention: Convention,
) -> Decoded:
    """Make points from sums.

    The reference point is 0 of the machine unless ``file_start`` says where the lowest point lies.

    Raises:
        TabFileError: units or scale not given, a revolution whose values do not add up to 0, more than a
            revolution, another axis, a range that does not fit the travel.
    """
    units = required_units(source, context, "a table of increments")
    context = context_in_file_units(source, context, units)
    scale = _scale(source, context, units)
    _check_revolution(source, units, file, sums)
    axis = axis_letter(source, file.csv, context)
    start = context.file_start
    offset = 0.0 if start is None else start - sums[0].step * file.interval
    rows = tuple(
        SourceRow(
            total.step * file.interval + offset + 0.0,
            *(total.total * file.magnification / (scale * convention.values_per_count) + 0.0,) * 2,
            *(total.total,) * 2,
            *(total.line,) * 2,
        )
        for total in sums
    )
    check_home(source, rows, context)
    remedy = "the right file_units, file_start and travel"
    check_own_range(source, Interpretation(AS_THEY_STAND, rows, units), context, remedy)
    revolution = REVOLUTION_DEGREES if is_revolution(units, len(rows) - 1, file.interval) else None
    reference_text = f"the reference point {file.reference} is at {offset:g} {units.value}"
    origin = "from file_start" if start is not None else "the zero of the machine (file_start moves it)"
    return Decoded(
        rows,
        units,
        context,
        "values, summed",
        convention.rule,
        convention.rule,
        axis=axis,
        decisions=(f"{reference_text}, {origin}", *_given_scale(context, scale, units), *convention.assumed),
        behaves_as=HOLDS if revolution is None else (f"modulo = {revolution:g}",),
        modulo=revolution,
    )


def _scale(source: SourceText, context: FileContext, units: Units) -> float:
    """Return the counts of the old control in one unit of the file."""
    scale = context.file_counts_per_unit
    if scale is None or scale <= 0:
        found = "file_counts_per_unit is missing" if scale is None else f"file_counts_per_unit = {scale:g}"
        raise source.error(
            f"a table of increments holds counts, but {found}",
            f"file_counts_per_unit = counts of the OLD control per {context.option_units(units).value}, "
            "the unit of the axis, above 0 (1000 if it counts in 0.001 of that)",
        )
    return scale


def _given_scale(context: FileContext, scale: float, units: Units) -> tuple[str, ...]:
    """Report a scale that was given per unit of the axis, if the file has other units."""
    given = context.option_units(units)
    if given is units:
        return ()
    rule = f"file_counts_per_unit is given per {given.value}, the unit of the axis"
    return (f"{scale:.9g} counts per {units.value}: {rule}",)


def _check_revolution(source: SourceText, units: Units, file: Increments, sums: Sequence[Sum]) -> None:
    steps = sums[-1].step - sums[0].step
    if is_revolution(units, steps, file.interval):
        total = sums[-1].total - sums[0].total
        if total:
            raise source.error(
                f"the sum of the values over a turn is {total}, so the error would grow with every turn",
                "a sum of 0 over 360 degrees",
                line=sums[-1].line,
            )
    elif units is Units.DEGREE and steps * file.interval > 360.0:
        raise source.error(
            f"{steps} intervals of {file.interval:g} degrees",
            "at most one turn, 360 degrees",
            line=file.csv.rows[4].number,
        )


class Steps(Struct, frozen=True):
    """The writer's view of a table: ``totals`` at all its points, in values; ``zero`` is the reference."""

    interval: float
    magnification: int
    zero: int
    totals: tuple[int, ...]

    def across(self, section: int) -> int:
        """Return the value of a section, counted from 0."""
        return self.totals[section + 1] - self.totals[section]


def round_steps(table: CorrectionTable, options: WriteOptions, system: System, per_count: int) -> Steps:
    """Round the sums, not the steps: no sum is off by more than half a value, whatever the length.

    The smallest magnification that keeps all steps in range is used.

    Raises:
        TabFileError: no scale given, an uneven grid, no point at 0, a correction there, a revolution that
            does not close, a step that is out of range.
    """
    dialect, scale = system.title, options.file_counts_per_unit
    if scale is None or scale <= 0:
        found = (
            "the old control's counts per unit are missing" if scale is None else f"{scale:g} counts per unit"
        )
        raise unwritable(dialect, found, f"{NEEDS_SCALE}, above 0")
    step = even_step(table, dialect)
    zero = min(range(len(table.positions)), key=lambda index: abs(table.positions[index]))
    if abs(table.positions[zero]) > EVEN_TOLERANCE * step / 2:
        raise unwritable(
            dialect,
            f"no point at 0 (nearest: {table.positions[zero]:g})",
            "a table with a point at 0, where its sums begin",
        )
    means, _ = one_curve(table)
    steps = Steps(step, 1, zero, ())
    for magnification in range(1, system.max_magnification + 1):
        unit = magnification / (scale * per_count)
        steps = Steps(step, magnification, zero, tuple(round(mean / unit) for mean in means))
        if _misfit(steps, system) is None:
            break
    misfit = _misfit(steps, system)
    if misfit is not None:
        raise unwritable(
            dialect,
            f"a step of {steps.across(misfit)} between {table.positions[misfit]:g} and "
            f"{table.positions[misfit + 1]:g} (magnification {steps.magnification})",
            f"{system.lowest_value} to {system.highest_value}: a finer grid, or fewer counts per unit",
        )
    if steps.totals[zero]:
        raise unwritable(
            dialect,
            f"a correction of {means[zero]:.6g} {table.units.value} at 0",
            "0 there: subtract it from the whole table first",
        )
    is_closed = steps.totals[0] == steps.totals[-1]
    if is_revolution(table.units, len(steps.totals) - 1, step) and not is_closed:
        raise unwritable(
            dialect, "a turn with different corrections at its ends", "the same correction at both ends"
        )
    return steps


def _misfit(steps: Steps, system: System) -> int | None:
    return next(
        (
            section
            for section in range(len(steps.totals) - 1)
            if not system.lowest_value <= steps.across(section) <= system.highest_value
        ),
        None,
    )


class Rows(Struct, frozen=True):
    """The content of a file; ``resolution`` is the size of one value, in units of the table."""

    parameters: tuple[int | str, ...]
    points: list[tuple[int, int]]
    resolution: float


def written(table: CorrectionTable, options: WriteOptions, system: System, rows: Rows) -> Written:
    """Return the text of a file, its losses, and the options that its reader needs."""
    comments = [f"{system.title}: increments, counted from the reference point"]
    if options.axis is not None:
        comments.append(f"axis: {options.axis.upper()}")
    lines = [f"{name},{number}" for name, number in zip(system.parameters, rows.parameters, strict=True)]
    lines += [",".join(HEADER), *(f"{point},{value}" for point, value in rows.points)]
    _, lost_motion = one_curve(table)
    unit, scale = table.units.value, options.file_counts_per_unit
    hint = f"read it with file_units {unit} and file_counts_per_unit {scale:g}"
    losses = (
        f"sums are whole numbers: a resolution of {rows.resolution:.6g} {unit}",
        *lost_motion,
        f"units and counts are not in the file: {hint}",
    )
    context = FileContext(axis=options.axis, file_units=table.units, file_counts_per_unit=scale)
    return Written(csv_file(comments, lines, len(rows.points)), losses, context)
