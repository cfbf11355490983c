"""Leadscrew tables of the Fagor 8055: as the control transfers them, and as its manual prints them.

Source: installation manual 8055, "Leadscrew error compensation" (7.5.7, tables in 6.10.2), its example, and
the transfer files of a machine in use. One line for each point, nothing else::

    P001   X-  20.00000   EX    0.00100                position, error in the positive direction
    P002   X    0.00000   EX-   0.00100   EX   0.00050     ... and in the negative one (newer software)
    P001 X-20 EX 0.001                                 the same line as printed in the manual

``Pnnn`` counts from P001 without gaps, up to 1000 points; newer controls write four digits, P0001. A minus
sign follows its letter directly, with blanks between it and the number; in the manual it is next to the
number. Positions are coordinates from machine zero and begin with the most negative one. All lines have the
third field, or none. Two different letters are a table of cross compensation, refused here.

Units are those of the machine's parameters. The file has none, so ``file_units`` is required. The manual
speaks of the "amount of error" and never gives its sign, so ``error_sense`` is required. If all negative
errors are 0, the positive ones hold in both directions. The manual's own example (compensation in the
positive direction) contradicts this rule; the rule is used. The control allows a slope of 100 %; here it must
be smaller, or the correction has no inverse.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from math import inf
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import (
    RULES,
    check_stated,
    context_in_file_units,
    is_closed,
    required_sense,
    required_units,
)
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import ErrorSense, FileContext
from gateway.tabfile.text import SourceLine, SourceText, shown, to_decimal
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "fagor-8055"
TITLE: Final = "Fagor 8055 leadscrew table (P001 X-20 EX 0.001), one or two directions"
USES: Final = frozenset({"file_start", "file_axis", "error_sense"})
MAX_POINTS: Final = 1000
MAX_VALUE: Final = {Units.MM: 99999.9999, Units.INCH: 3937.00787, Units.DEGREE: 99999.9999}
DECIMALS: Final = {Units.MM: 4, Units.INCH: 5, Units.DEGREE: 4}
"""Digits after the point that the control allows."""
MAX_PROBLEMS: Final = 20
REVOLUTION: Final = 360.0
_MAX_PLAUSIBLE: Final = {Units.MM: 0.5, Units.INCH: 0.1, Units.DEGREE: inf}
_WHAT: Final = "a Fagor 8055 table"
_GRAMMAR: Final = "such as 'P001 X- 20.00000 EX 0.00100', with a third field (EX) in all lines or in none"
_SIGN: Final = r"(-[ \t]*|[ \t]*-?)"
_NUMBER: Final = r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_FIELD: Final = rf"[ \t]+E([A-Z]){_SIGN}{_NUMBER}"
_ROW: Final = re.compile(
    rf"P([0-9]{{3,4}})[ \t]+([A-Z]){_SIGN}{_NUMBER}{_FIELD}(?:{_FIELD})?", re.IGNORECASE | re.ASCII
)
_RECOGNISED: Final = re.compile(r"P[0-9]{3,4}[ \t]+[A-Z][ \t]*-?[ \t]*[0-9.]", re.IGNORECASE | re.ASCII)


class _Row(Struct, frozen=True):
    """One line as written; ``negative`` is None without a third field."""

    axis: str
    error_axes: tuple[str, ...]
    position: float
    positive: float
    negative: float | None
    line: int


def recognise(source: SourceText) -> bool:
    """Whether at least half of the lines begin with a point number, a letter and a number."""
    hits = sum(_RECOGNISED.match(line.text) is not None for line in source.lines)
    return 2 * hits >= len(source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table with the units and the sense from the context.

    Raises:
        TabFileError: a line that is not a point, point numbers with gaps, positions that do not ascend, a
            table of cross compensation or of another axis, no units or no sense given, a range that does not
            fit the travel.
    """
    found = _parse(source)
    axis = _check_axes(source, found, context)
    units = required_units(source, context, _WHAT)
    _check_values(source, found, units)
    context = context_in_file_units(source, context, units)
    sense = required_sense(source, context, _WHAT)
    is_both_ways, decision = _directions(found)
    rows = _rows(found, sense, is_both_ways=is_both_ways)
    check_stated(source, rows, units, context)
    return Decoded(
        rows,
        units,
        context,
        units.value,
        f"{RULES[sense]}; second field",
        f"{RULES[sense]}; {'second field, as in the positive direction' if is_both_ways else 'third field'}",
        axis=axis if context.file_axis is None else None,
        file_axis=context.file_axis,
        plausible=(0.0, _MAX_PLAUSIBLE[units]),
        decisions=(f"sense {sense.value}: as given", f"units {units.value}: from file_units", decision),
        behaves_as=(f"modulo = {REVOLUTION:g}",) if _is_revolution(rows, units) else ('outside = "hold"',),
        modulo=REVOLUTION if _is_revolution(rows, units) else None,
    )


def _parse(source: SourceText) -> list[_Row]:
    rows: list[_Row] = []
    problems: list[FileProblem] = []
    number = digits = 0
    for line in source.lines:
        # A heading takes no number from the points below it.
        number += number > 0 or _RECOGNISED.match(line.text) is not None
        digits = digits or _digits(line)
        row = _parse_row(line, number, digits)
        if isinstance(row, _Row):
            rows.append(row)
        else:
            problems.append(source.problem(*row, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if not 2 <= len(rows) <= MAX_POINTS:
        raise source.error(f"{len(rows)} point(s)", f"2 to {MAX_POINTS}", line=source.last_line)
    odd = next((row for row in rows if (row.negative is None) is not (rows[0].negative is None)), None)
    if odd is not None:
        found = "2 fields after lines of 3" if odd.negative is None else "3 fields after lines of 2"
        raise source.error(found, "the same number in all lines", line=odd.line)
    for before, after in pairwise(rows):
        if after.position <= before.position:
            problems.append(
                source.problem(
                    f"position {after.position:g} after {before.position:g}",
                    "positions that ascend from the most negative one",
                    line=after.line,
                    code="L11",
                )
            )
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return rows


def _digits(line: SourceLine) -> int:
    """Return the number of digits of the first point number, 0 if there is none."""
    match = _ROW.fullmatch(line.text)
    return 0 if match is None else len(match[1])


def _parse_row(line: SourceLine, number: int, digits: int) -> _Row | tuple[str, str]:
    """Return the row, or what was found and what is allowed."""
    match = _ROW.fullmatch(line.text)
    if match is None:
        return (shown(line.text) if line.text else "a blank line"), _GRAMMAR
    point, axis, sign, position, one_axis, one_sign, one, other_axis, other_sign, other = match.groups()
    if point != f"{number:0{digits}d}":
        return (
            f"point P{point}",
            f"P{number:0{digits}d}: points are numbered from P{1:0{digits}d} without gaps",
        )
    numbers = [
        None if text is None else _signed(mark, text)
        for mark, text in ((sign, position), (one_sign, one), (other_sign, other))
    ]
    if numbers[0] is None or numbers[1] is None or (other is not None and numbers[2] is None):
        return shown(line.text), "numbers of at most 40 characters"
    axes = tuple(name.upper() for name in (one_axis, other_axis) if name is not None)
    return _Row(axis.upper(), axes, numbers[0], numbers[1], numbers[2], line.number)


def _signed(sign: str, text: str) -> float | None:
    number = to_decimal(text)
    return number if number is None or "-" not in sign else 0.0 - number


def _check_axes(source: SourceText, found: Sequence[_Row], context: FileContext) -> str:
    """Return the letter of the axis.

    Raises:
        TabFileError: several letters, or the letter of another axis.
    """
    axis = found[0].axis
    for row in found:
        for error_axis in row.error_axes:
            if row.axis == axis and error_axis != axis:
                raise source.error(
                    f"a table of cross compensation: errors of {error_axis} by the position of {axis}",
                    f"a leadscrew table ({axis} and E{axis}); for the 'cross' key of axis {error_axis} write "
                    f"it with E{axis} instead of E{error_axis}",
                    line=row.line,
                )
        if row.axis != axis:
            raise source.error(f"axis {row.axis} after axis {axis}", "only one axis in a file", line=row.line)
    given = context.file_axis or context.axis
    if given is not None and given.upper() != axis:
        raise source.error(
            f"a table of axis {axis}, read for axis {given.upper()}",
            f"axis {given.upper()}: is this the right file? If so: file_axis = {axis!r}",
            line=found[0].line,
        )
    return axis


def _check_values(source: SourceText, found: Sequence[_Row], units: Units) -> None:
    limit = MAX_VALUE[units]
    problems = [
        source.problem(f"{number:g}", f"{-limit:.10g} to {limit:.10g} {units.value}", line=row.line)
        for row in found
        for number in (row.position, row.positive, row.negative or 0.0)
        if abs(number) > limit
    ]
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


def _directions(found: Sequence[_Row]) -> tuple[bool, str]:
    """Return whether the positive errors hold in both directions, and why."""
    if found[0].negative is None:
        return True, "no third field: the positive errors apply in both directions"
    if any(row.negative for row in found):
        return False, "third field: errors in the negative direction"
    return True, (
        "the negative errors are all 0: on this control the positive errors then apply in both directions"
    )


def _rows(found: Sequence[_Row], sense: ErrorSense, *, is_both_ways: bool) -> tuple[SourceRow, ...]:
    rows = []
    for row in found:
        backward = row.positive if is_both_ways or row.negative is None else row.negative
        rows.append(
            SourceRow(
                row.position,
                sense.to_correction * row.positive + 0.0,
                sense.to_correction * backward + 0.0,
                row.positive,
                backward,
                row.line,
                row.line,
            )
        )
    return tuple(rows)


def _is_revolution(rows: Sequence[SourceRow], units: Units) -> bool:
    """Whether a rotary table runs from 0 to 360 with equal ends; others keep their end values."""
    ends = (rows[0].position, rows[-1].position)
    return units is Units.DEGREE and ends == (0.0, REVOLUTION) and is_closed(rows)


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table in the control's transfer format, with CRLF; a third field if the directions differ.

    Numbers are rounded to 4 decimals of mm or degrees, or 5 of inches.

    Raises:
        TabFileError: no axis letter or no sense given, more than 1000 points, numbers too long for the
            control, points that are equal after rounding.
    """
    axis = options.file_axis or options.axis
    if axis is None or not re.fullmatch("[A-Za-z]", axis):
        raise unwritable(NAME, f"axis {axis!r}", "one letter for its lines: --to-axis LETTER")
    if options.sense is None:
        found = "the sense of its errors is missing: no manual states which one the control expects"
        raise unwritable(NAME, found, "--to-sense actual_minus_command or command_minus_actual")
    if len(table.positions) > MAX_POINTS:
        raise unwritable(NAME, f"{len(table.positions)} points", f"at most {MAX_POINTS}")
    decimals, unit = DECIMALS[table.units], table.units.value
    to_error = options.sense.to_correction
    columns = [
        [round(number * factor, decimals) + 0.0 for number in numbers]
        for numbers, factor in ((table.positions, 1.0), (table.forward, to_error), (table.backward, to_error))
    ]
    losses = [f"positions and values are rounded to {decimals} decimals ({unit})"]
    _check_columns(columns, table.units)
    forward, backward = columns[1:]
    if table.is_unidirectional:
        columns.pop()
    elif any(forward) and not any(backward):
        backward[0] = 10**-decimals
        losses.append(
            f"the first negative error is written as {backward[0]:.{decimals}f}: if all are 0, the control "
            "uses the positive errors in both directions"
        )
    lines = []
    for index, (position, *errors) in enumerate(zip(*columns, strict=True), start=1):
        fields = "".join(
            f"{'':11}E{axis.upper()}{_sign(error)}{abs(error):10.{decimals}f}" for error in errors
        )
        position_text = f"{axis.upper()}{_sign(position)}{abs(position):10.{decimals}f}"
        lines.append(f"{'':11}P{index:03d}{'':14}{position_text}{fields}\r\n")
    context = FileContext(
        axis=options.axis, file_axis=options.file_axis, file_units=table.units, error_sense=options.sense
    )
    return Written("".join(lines), tuple(losses), context)


def _check_columns(columns: Sequence[Sequence[float]], units: Units) -> None:
    for before, after in pairwise(columns[0]):
        if after <= before:
            found = f"points closer than {10 ** -DECIMALS[units]:g} {units.value} at {after:g}"
            raise unwritable(NAME, found, "points further apart: --resample STEP")
    worst = max((abs(number) for column in columns for number in column), default=0.0)
    if worst > MAX_VALUE[units]:
        raise unwritable(NAME, f"a number of {worst:g}", f"at most {MAX_VALUE[units]:.10g} {units.value}")


def _sign(number: float) -> str:
    return "-" if number < 0 else " "
