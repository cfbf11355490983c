"""Compensation tables of Heidenhain controls (``*.COM``): nonlinear axis-error compensation.

Source: technical manuals of the MANUALplus 620, iTNC 530 HSCI and TNC 407 (axis-error compensation)::

    BEGIN Z_PITCH .COM MM          or INCH
    NR  AXISPOS   Z        BACKLASH
    0   -200      +0.004   -0.001
    1   -195      +0.005   +0.000
    [END]

Sure, because the manuals say it: the columns AXISPOS (positions from the machine datum), one column for each
compensated axis, named like the axis, and BACKLASH (values measured in the negative direction of traverse).
Which axis AXISPOS belongs to is not in this file: a ``.CMA`` file assigns it.

Assumed, from how these controls write all their tables: the BEGIN line with the units, the line of column
names, rows numbered from 0 in the column NR, and [END]. The columns may come in any order after NR. A blank
cell would leave open which column it is of, so every row has as many numbers as there are columns.

Refused, because nothing proves it: errors without a told ``error_sense`` (only the sign of the *linear*
compensation is described), several axis columns without ``file_axis`` (the others are cross compensation),
BACKLASH beside several axis columns, a BACKLASH column of zeros (not filled in, or no correction?). On a
rotary axis numbers are degrees, whatever the BEGIN line says. What these controls do outside a table is not
known here.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.context import ErrorSense, FileContext
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import Problem, TabFileError
from gateway.tabfile.fields import DECIMAL_ALLOWED, to_decimal
from gateway.tabfile.ranges import context_in_file_units
from gateway.tabfile.senses import RULES, required_sense
from gateway.tabfile.stated import check_stated
from gateway.tabfile.text import Line, SourceText, shown
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "heidenhain-com"
TITLE: Final = "Heidenhain compensation table (.COM with AXISPOS), one or two directions"
DECIMALS: Final = 6
MAX_PROBLEMS: Final = 20
_UNITS: Final = {"MM": Units.MM, "INCH": Units.INCH}
_MAX_PLAUSIBLE: Final = {Units.MM: 0.5, Units.INCH: 0.1, Units.DEGREE: inf}
_BEGIN: Final = re.compile(r"BEGIN[ \t]+([^ \t.]+)[ \t]*\.COM[ \t]+(MM|INCH)", re.IGNORECASE)
_OF_THIS_FAMILY: Final = re.compile(r"BEGIN[ \t].*\.(?:COM|CMA)\b", re.IGNORECASE)
_HAS_POSITIONS: Final = re.compile(r"\bAXISPOS\b", re.IGNORECASE)
_AXIS: Final = re.compile(r"[A-Z][0-9]{0,2}")
_POSITION: Final = "AXISPOS"
_NEGATIVE: Final = "BACKLASH"


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where in a row the numbers are; ``negative`` is None without a BACKLASH column."""

    axis: str
    position: int
    positive: int
    negative: int | None
    size: int
    others: tuple[str, ...]
    line: int


def recognise(source: SourceText) -> bool:
    """Whether the first line begins such a table, or one of the first two names its AXISPOS column."""
    head = source.lines[:2]
    return _OF_THIS_FAMILY.match(head[0].text) is not None or any(
        _HAS_POSITIONS.search(line.text) for line in head
    )


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read one axis of the table, with the sense that the context tells.

    Raises:
        TabFileError: a line that is not grammar, no such column or no told one of several, a BACKLASH column
            that has no clear meaning, positions that do not ascend, no sense told, a range that does not fit
            the travel.
    """
    units, unit_decision = _units(source, context)
    columns = _columns(source, context)
    table = _parse_rows(source, columns)
    _check_negative(source, columns, table)
    context = context_in_file_units(source, context, units)
    sense = required_sense(source, context, None, "a Heidenhain compensation table")
    rows = _rows(table, columns, sense)
    check_stated(source, rows, units, context)
    backward = f"column {_NEGATIVE}" if columns.negative is not None else "one value for both directions"
    return Decoded(
        rows,
        units,
        context,
        units.value,
        f"{RULES[sense]}; column {columns.axis}",
        f"{RULES[sense]}; {backward}",
        axis=columns.axis if len(columns.axis) == 1 and context.file_axis is None else None,
        file_axis=columns.axis,
        plausible=(0.0, _MAX_PLAUSIBLE[units]),
        decisions=(f"sense {sense.value}: told", unit_decision, *_column_decisions(columns)),
    )


def _units(source: SourceText, context: FileContext) -> tuple[Units, str]:
    """Return the units of the rows, and why."""
    line = source.lines[0]
    match = _BEGIN.fullmatch(line.text)
    if match is None:
        if _OF_THIS_FAMILY.match(line.text) and ".CMA" in line.text.upper():
            raise source.error(
                "a .CMA file, which only assigns tables", "the .COM file that it names", line=line.number
            )
        raise source.error(shown(line.text), "BEGIN NAME .COM MM (or INCH)", line=line.number)
    stated = _UNITS[match[2].upper()]
    if Units.DEGREE in (context.file_units, context.units) and context.file_units in (None, Units.DEGREE):
        return Units.DEGREE, f"units degree: the axis is a rotary one, whatever {match[2]} says"
    return stated, f"units {stated.value}: line {line.number}"


def _columns(source: SourceText, context: FileContext) -> _Columns:
    if len(source.lines) < 2:
        raise source.error("the end of the file", f"a line 'NR {_POSITION} X'", line=source.last_line)
    line = source.lines[1]
    names = line.text.upper().split()
    axes = [name for name in names[1:] if name not in {_POSITION, _NEGATIVE}]
    odd = [name for name, count in Counter(names).items() if count > 1]
    odd += [name for name in axes if not _AXIS.fullmatch(name)]
    if names[:1] != ["NR"] or _POSITION not in names or not axes or odd:
        raise source.error(
            f"column {shown(odd[0])} in {shown(line.text)}" if odd else shown(line.text),
            f"NR first, then {_POSITION}, a column for each axis (X, Y, C, Z2 ...) and {_NEGATIVE} if there "
            "is one, each once",
            line=line.number,
        )
    axis = _choose_axis(source, context, axes, line.number)
    negative = names.index(_NEGATIVE) if _NEGATIVE in names else None
    if negative is not None and len(axes) > 1:
        raise source.error(
            f"{_NEGATIVE} beside the columns {', '.join(axes)}: nothing says which one it belongs to",
            f"a file with {_POSITION}, {axis} and its {_NEGATIVE} only",
            line=line.number,
        )
    others = tuple(name for name in axes if name != axis)
    return _Columns(
        axis, names.index(_POSITION), names.index(axis), negative, len(names), others, line.number
    )


def _choose_axis(source: SourceText, context: FileContext, axes: Sequence[str], line: int) -> str:
    told = context.file_axis.upper() if context.file_axis is not None else None
    if told is not None:
        if told not in axes:
            raise source.error(
                f"columns {', '.join(axes)}, told file_axis {told}", "one of the columns", line=line
            )
        return told
    if len(axes) > 1:
        raise source.error(
            f"{len(axes)} axes ({', '.join(axes)}): the errors of one by its own position, the others by the "
            "position of the first, and nothing says which is which",
            f"file_axis = {axes[0]!r} or another: the axis whose positions are in {_POSITION}",
            line=line,
        )
    if context.axis is not None and context.axis.upper() != axes[0]:
        raise source.error(
            f"a column of axis {axes[0]}, read for axis {context.axis.upper()}",
            f"axis {context.axis.upper()}: is this the right file? If so: file_axis = {axes[0]!r}",
            line=line,
        )
    return axes[0]


def _column_decisions(columns: _Columns) -> tuple[str, ...]:
    decisions = [
        f"positions: taken as those of {columns.axis} itself; only the .CMA file says whose they are"
    ]
    if columns.others:
        decisions.append(f"not used: {', '.join(columns.others)}, cross compensation by these positions")
    return tuple(decisions)


def _parse_rows(source: SourceText, columns: _Columns) -> list[tuple[list[float], int]]:
    """Return the numbers of each row, with its line."""
    last = source.lines[-1]
    if last.text.upper() != "[END]":
        raise source.error(f"the last line {shown(last.text)}", "[END]", line=last.number)
    rows: list[tuple[list[float], int]] = []
    problems: list[Problem] = []
    for number, line in enumerate(source.lines[2:-1]):
        row = _parse_row(line, number, columns)
        if isinstance(row, list):
            rows.append((row, line.number))
        else:
            problems.append(source.problem(*row, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if len(rows) < 2:
        raise source.error(f"{len(rows)} row(s)", "at least 2", line=source.last_line)
    for (before, _), (after, at) in pairwise(rows):
        if after[columns.position] <= before[columns.position]:
            found = f"position {after[columns.position]:g} after {before[columns.position]:g}"
            problems.append(source.problem(found, "positions that ascend", line=at, code="L11"))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return rows


def _parse_row(line: Line, number: int, columns: _Columns) -> list[float] | tuple[str, str]:
    """Return the numbers, or what was found and what is allowed."""
    fields = line.text.split()
    if len(fields) != columns.size:
        found = f"{len(fields)} fields in {shown(line.text)}" if fields else "a blank line"
        return found, f"{columns.size}, one for each column of line {columns.line}; 0 instead of a blank cell"
    if fields[0] != str(number):
        return f"row {shown(fields[0])}", f"NR {number}: rows are numbered through from 0"
    row = [0.0]
    for field in fields[1:]:
        value = to_decimal(field)
        if value is None:
            return shown(field), DECIMAL_ALLOWED
        row.append(value)
    return row


def _check_negative(source: SourceText, columns: _Columns, table: Sequence[tuple[list[float], int]]) -> None:
    column, positive = columns.negative, columns.positive
    if column is None or any(row[column] for row, _ in table) or not any(row[positive] for row, _ in table):
        return
    raise source.error(
        f"a {_NEGATIVE} column of zeros",
        f"for the first: no column {_NEGATIVE}; for the second: one value in it that differs from 0",
        line=columns.line,
        readings=(
            f"not filled in: the values of {columns.axis} hold in both directions",
            "no correction in the negative direction",
        ),
    )


def _rows(
    table: Sequence[tuple[list[float], int]], columns: _Columns, sense: ErrorSense
) -> tuple[SourceRow, ...]:
    rows = []
    for row, line in table:
        forward = row[columns.positive]
        backward = forward if columns.negative is None else row[columns.negative]
        rows.append(
            SourceRow(
                row[columns.position],
                sense.to_correction * forward + 0.0,
                sense.to_correction * backward + 0.0,
                forward,
                backward,
                line,
                line,
            )
        )
    return tuple(rows)


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table with one axis column, and BACKLASH if the directions differ.

    Numbers are rounded to 6 decimals.

    Raises:
        TabFileError: no name of the axis or no sense told, points that fall together once rounded.
    """
    axis = (options.file_axis or options.axis or "").upper()
    if not _AXIS.fullmatch(axis):
        raise unwritable(
            NAME, f"axis {axis!r}", "a letter, and up to two digits, for its column: --to-file-axis NAME"
        )
    if options.sense is None:
        found = "no sense of its errors: no manual says which one the control expects"
        raise unwritable(NAME, found, "--to-sense actual_minus_command or command_minus_actual")
    to_error, unit = options.sense.to_correction, table.units.value
    positions, forward, backward = (
        [round(number * factor, DECIMALS) + 0.0 for number in numbers]
        for numbers, factor in ((table.positions, 1.0), (table.forward, to_error), (table.backward, to_error))
    )
    if any(after <= before for before, after in pairwise(positions)):
        raise unwritable(
            NAME, f"points closer than {10**-DECIMALS:g} {unit}", "points further apart: --resample STEP"
        )
    losses = [f"positions and values are rounded to {DECIMALS} decimals ({unit})"]
    names, columns = [_POSITION, axis], [positions, forward]
    if not table.is_unidirectional:
        if any(forward) and not any(backward):
            backward[0] = 10**-DECIMALS
            losses.append(
                f"a {_NEGATIVE} column of zeros has two meanings: its first value is {backward[0]:f}"
            )
        names.append(_NEGATIVE)
        columns.append(backward)
    lines = [
        f"BEGIN {axis}_PITCH .COM {'INCH' if table.units is Units.INCH else 'MM'}",
        "".join(f"{name:<16}" for name in ("NR", *names)).rstrip(),
        *(
            f"{index:<16}" + "".join(f"{number:<+16.{DECIMALS}f}" for number in row).rstrip()
            for index, row in enumerate(zip(*columns, strict=True))
        ),
        "[END]",
    ]
    context = FileContext(
        axis=options.axis, file_axis=options.file_axis, file_units=table.units, error_sense=options.sense
    )
    return Written("".join(f"{line}\r\n" for line in lines), tuple(losses), context)
