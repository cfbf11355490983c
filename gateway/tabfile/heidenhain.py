"""Compensation tables of Heidenhain controls (``*.COM``): nonlinear axis-error compensation.

Source: technical manuals of the MANUALplus 620, iTNC 530 HSCI and TNC 407 (axis-error compensation)::

    BEGIN Z_PITCH .COM MM          or INCH
    NR  AXISPOS   Z        BACKLASH
    0   -200      +0.004   -0.001
    1   -195      +0.005   +0.000
    [END]

Certain, from the manuals: the columns AXISPOS (positions from the machine datum), one column for each
compensated axis, named like the axis, and BACKLASH (values measured in the negative direction of traverse).
The axis of AXISPOS is not in this file: a ``.CMA`` file assigns it.

Assumed, from all other tables of these controls and from a public program that writes such files for a TNC
640: the BEGIN line with the units, the line of column names, rows numbered from 0 in the column NR, and
[END]. The columns may come in any order after NR. A column that is blank in all rows counts as absent, see
:mod:`gateway.tabfile.heidenhain_columns`: with a blank BACKLASH one value holds in both directions. The older
layout, with DATUM and DISTANCE in the BEGIN line and without AXISPOS, is in no available source and is
refused by name.

Refused, for lack of proof: errors without a given ``error_sense`` (only the sign of the *linear* compensation
is documented), several axis columns without ``file_axis`` (the others are cross compensation), BACKLASH
beside several axis columns, a BACKLASH column of zeros (not filled in, or no correction?). On a rotary axis
numbers are degrees, whatever the BEGIN line says. The behaviour of these controls outside a table is unknown.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from math import inf
from typing import Final, NamedTuple

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import RULES, check_stated, context_in_file_units, required_sense
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.heidenhain_columns import (
    AXIS,
    MAX_PROBLEMS,
    NEGATIVE,
    POSITION,
    ColumnGrid,
    Names,
    parse_cells,
    parse_names,
)
from gateway.tabfile.options import ErrorSense, FileContext
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceText, shown, to_decimal
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "heidenhain-com"
TITLE: Final = "Heidenhain compensation table (.COM with AXISPOS), one or two directions"
USES: Final = frozenset({"file_start", "file_axis", "error_sense"})
DECIMALS: Final = 6
_UNITS: Final = {"MM": Units.MM, "INCH": Units.INCH}
_MAX_PLAUSIBLE: Final = {Units.MM: 0.5, Units.INCH: 0.1, Units.DEGREE: inf}
_BEGIN: Final = re.compile(r"BEGIN[ \t]+([^ \t.]+)[ \t]*\.COM[ \t]+(MM|INCH)", re.IGNORECASE)
_OLDER: Final = re.compile(r"BEGIN[ \t].*\.COM\b.*\bDATUM\b", re.IGNORECASE)
_OF_THIS_FAMILY: Final = re.compile(r"BEGIN[ \t].*\.(?:COM|CMA)\b", re.IGNORECASE)
_HAS_POSITIONS: Final = re.compile(r"\bAXISPOS\b", re.IGNORECASE)


class _Columns(Struct, frozen=True):
    """The columns that are used."""

    axis: str
    has_negative: bool
    others: tuple[str, ...]
    blank: tuple[str, ...]
    line: int


class _Row(NamedTuple):
    """Position, values in both directions as written, line."""

    position: float
    forward: float
    backward: float
    line: int


def recognise(source: SourceText) -> bool:
    """Whether the first line begins such a table, or one of the first two names its AXISPOS column."""
    head = source.lines[:2]
    return _OF_THIS_FAMILY.match(head[0].text) is not None or any(
        _HAS_POSITIONS.search(line.text) for line in head
    )


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read one axis of the table, with the sense from the context.

    Raises:
        TabFileError: a line outside the grammar, no such column, several columns and none given, a BACKLASH
            column without a clear meaning, positions that do not ascend, no sense given, a range that does
            not fit the travel.
    """
    units, unit_decision = _units(source, context)
    names = parse_names(source)
    grid = parse_cells(source, names)
    columns = _columns(source, context, names, grid)
    table = _parse_rows(source, columns, grid)
    _check_negative(source, columns, table)
    context = context_in_file_units(source, context, units)
    sense = required_sense(source, context, "a Heidenhain compensation table")
    rows = _rows(table, sense)
    check_stated(source, rows, units, context)
    backward = f"column {NEGATIVE}" if columns.has_negative else "one value for both directions"
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
        decisions=(f"sense {sense.value}: as given", unit_decision, *_column_decisions(columns)),
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
        if _OLDER.match(line.text):
            raise source.error(
                "a .COM file of the older layout (DATUM and DISTANCE), without units and AXISPOS",
                "BEGIN NAME .COM MM (or INCH), a line 'NR AXISPOS X' above the rows, with X for the axis, "
                "and [END] below them; or its positions and values as plain CSV, with units and sign",
                line=line.number,
            )
        raise source.error(shown(line.text), "BEGIN NAME .COM MM (or INCH)", line=line.number)
    stated = _UNITS[match[2].upper()]
    if Units.DEGREE in (context.file_units, context.units) and context.file_units in (None, Units.DEGREE):
        return Units.DEGREE, f"units degree: the axis is rotary, so {match[2]} does not count"
    return stated, f"units {stated.value}: line {line.number}"


def _columns(source: SourceText, context: FileContext, names: Names, grid: ColumnGrid) -> _Columns:
    line = names.line.number
    if not grid.axes:
        raise source.error(f"no number in any of {', '.join(names.axes)}", "values of one axis", line=line)
    axis = _choose_axis(source, context, grid.axes, line)
    has_negative = NEGATIVE in grid.filled
    if has_negative and len(grid.axes) > 1:
        raise source.error(
            f"{NEGATIVE} beside the columns {', '.join(grid.axes)}: the file does not state which one it "
            "belongs to",
            f"a file with only {POSITION}, {axis} and its {NEGATIVE}",
            line=line,
        )
    others = tuple(name for name in grid.axes if name != axis)
    return _Columns(axis, has_negative, others, grid.blank, line)


def _choose_axis(source: SourceText, context: FileContext, axes: Sequence[str], line: int) -> str:
    given = context.file_axis.upper() if context.file_axis is not None else None
    if given is not None:
        if given not in axes:
            raise source.error(
                f"columns {', '.join(axes)}, but file_axis = {given}", "one of the columns", line=line
            )
        return given
    if len(axes) > 1:
        raise source.error(
            f"{len(axes)} axes ({', '.join(axes)}): the positions belong to one of them, and the file does "
            "not state to which",
            f"file_axis = {axes[0]!r} or another: the axis whose positions are in {POSITION}",
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
    decisions = [f"positions: assumed to be those of {columns.axis}; only the .CMA file states this"]
    if columns.others:
        decisions.append(f"not used: {', '.join(columns.others)}, a cross compensation over these positions")
    if columns.blank:
        decisions.append(f"not filled in: {', '.join(columns.blank)}")
    return tuple(decisions)


def _parse_rows(source: SourceText, columns: _Columns, grid: ColumnGrid) -> list[_Row]:
    """Return the numbers of each row, with its line."""
    rows: list[_Row] = []
    problems: list[FileProblem] = []
    for cells, line in grid.rows:
        numbers = {name: to_decimal(cell) for name, cell in cells.items() if name != "NR"}
        problems += (
            source.problem(shown(cells[name]), DECIMAL_ALLOWED, line=line)
            for name, number in numbers.items()
            if number is None
        )
        position, forward, backward = (
            numbers[name] or 0.0
            for name in (POSITION, columns.axis, NEGATIVE if columns.has_negative else columns.axis)
        )
        rows.append(_Row(position, forward, backward, line))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    for before, after in pairwise(rows):
        if after.position <= before.position:
            found = f"position {after.position:g} after {before.position:g}"
            problems.append(source.problem(found, "positions that ascend", line=after.line, code="L11"))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return rows


def _check_negative(source: SourceText, columns: _Columns, rows: Sequence[_Row]) -> None:
    if not columns.has_negative or any(row.backward for row in rows) or not any(row.forward for row in rows):
        return
    raise source.error(
        f"a {NEGATIVE} column of zeros",
        f"for reading 1: no column {NEGATIVE}; for reading 2: one value in it that differs from 0",
        line=columns.line,
        readings=(
            f"an empty column: the values of {columns.axis} apply in both directions",
            "no correction in the negative direction",
        ),
    )


def _rows(found: Sequence[_Row], sense: ErrorSense) -> tuple[SourceRow, ...]:
    return tuple(
        SourceRow(
            row.position,
            sense.to_correction * row.forward + 0.0,
            sense.to_correction * row.backward + 0.0,
            row.forward,
            row.backward,
            row.line,
            row.line,
        )
        for row in found
    )


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table with one axis column, and BACKLASH if the directions differ.

    Numbers are rounded to 6 decimals.

    Raises:
        TabFileError: no name of the axis or no sense given, points that are equal after rounding.
    """
    axis = (options.file_axis or options.axis or "").upper()
    if not AXIS.fullmatch(axis):
        raise unwritable(
            NAME, f"axis {axis!r}", "a letter, and up to two digits, for its column: --to-file-axis NAME"
        )
    if options.sense is None:
        found = "the sense of its errors is missing: no manual states which one the control expects"
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
    names, columns = [POSITION, axis], [positions, forward]
    if not table.is_unidirectional:
        if any(forward) and not any(backward):
            backward[0] = 10**-DECIMALS
            losses.append(
                f"the first value of {NEGATIVE} is written as {backward[0]:f}, because a column of zeros "
                "has two meanings"
            )
        names.append(NEGATIVE)
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
