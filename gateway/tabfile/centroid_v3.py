"""Centroid .tab version 3 (CNC10 2.61 and up, CNC11, CNC12): explicit positions, machine units.

Grammar, after the description by CNC Services Northwest; keywords in any case, any blanks and tabs::

    CNC10 TAB FILE VERSION 3
    AXIS letter
    UNITS INCH | UNITS MILLIMETER
    INTERVAL decimal number
    ENTRIES n                          points, not intervals
    position away toward               n lines

Positions are signed distances from home and begin there, at 0. ``away`` is added while the axis moves away
from home, ``toward`` while it moves towards home. Both are in the units of the positions (not tenths or
microns). The order of the positions proves the home end. Descending from 0 means home at the plus end; away
from home is then the negative direction (``away`` is the backward correction). Ascending means home at the
minus end (``away`` is the forward correction). Positions on both sides of 0 are refused: no source says which
column holds there.
"""

import itertools
import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import (
    Interpretation,
    check_home,
    check_stated,
    context_in_file_units,
    describe_both,
)
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import FileContext, HomeSide
from gateway.tabfile.text import (
    DECIMAL_ALLOWED,
    SourceLine,
    SourceText,
    shown,
    to_decimal,
    to_integer,
    with_point,
)
from gateway.tabfile.writing import WriteOptions, Written, even_step, home_side, unwritable

NAME: Final = "centroid-3"
TITLE: Final = "Centroid version 3 (CNC10 2.61 and up, CNC11, CNC12), two directions, machine units"
USES: Final = frozenset({"file_start", "file_home"})
INTERVAL_TOLERANCE: Final = 1e-4
HOME_TOLERANCE: Final = 1e-6
MIN_STEP: Final = 1e-3
"""Eight decimals of a position keep steps down to this within the tolerance of readers."""
MAX_PROBLEMS: Final = 20
_UNITS: Final = {"INCH": Units.INCH, "MILLIMETER": Units.MM}
_UNIT_WORDS: Final = {units: word for word, units in _UNITS.items()}
_MAX_PLAUSIBLE: Final = {Units.INCH: 0.1, Units.MM: 0.5}
"""A larger |value| is probably in tenths or microns."""
_VERSION: Final = re.compile(r"CNC[0-9]*\s+TAB\s+FILE\s+VERSION\s+([0-9]+)", re.IGNORECASE)


class _Row(NamedTuple):
    position: float
    away: float
    toward: float
    line: int


class _Header(Struct, frozen=True):
    axis: str
    units: Units
    interval: float
    entries: int
    entries_line: int


def recognise(source: SourceText) -> bool:
    """Whether the first line names this family; :func:`read` refuses versions other than 3."""
    return _VERSION.fullmatch(source.lines[0].text) is not None


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the file; the order of its positions proves where the axis homes.

    Raises:
        TabFileError: another version, a line outside the grammar, a wrong number of rows, positions that do
            not run from 0 in equal steps, another axis, a range that does not fit the travel.
    """
    header = _parse_header(source)
    file_rows = _parse_rows(source, header)
    context = context_in_file_units(source, context, header.units)
    _check_positions(source, header, file_rows)
    if context.axis is not None and context.axis.upper() != header.axis:
        found = f"AXIS {header.axis}, read for axis {context.axis.upper()}"
        raise source.error(
            found, f"AXIS {context.axis.upper()}: is this the right file?", line=source.lines[1].number
        )
    side = HomeSide.PLUS if file_rows[-1].position < 0 else HomeSide.MINUS
    rows = _ascending(file_rows, side)
    check_home(source, rows, context)
    check_stated(source, rows, header.units, context)
    away, toward = ("backward", "forward") if side is HomeSide.PLUS else ("forward", "backward")
    columns = {away: "column 2, away from home", toward: "column 3, towards home"}
    rule = f"value is added unchanged; {{}} (home is at the {side.value} end)"
    return Decoded(
        rows,
        header.units,
        context,
        header.units.value,
        rule.format(columns["forward"]),
        rule.format(columns["backward"]),
        axis=header.axis,
        plausible=(0.0, _MAX_PLAUSIBLE[header.units]),
        decisions=(
            f"home {side.value}: the positions {'descend' if side is HomeSide.PLUS else 'ascend'} from 0",
        ),
    )


def _parse_header(source: SourceText) -> _Header:
    version = _VERSION.fullmatch(source.lines[0].text)
    assert version is not None
    if int(version[1][:9]) != 3:
        raise source.error(f"version {version[1]}", "VERSION 3", line=source.lines[0].number)
    axis = _header_field(source, 1, "AXIS", "one letter").upper()
    if not re.fullmatch("[A-Z]", axis):
        raise source.error(f"AXIS {shown(axis)}", "one letter, A to Z", line=source.lines[1].number)
    word = _header_field(source, 2, "UNITS", "INCH or MILLIMETER").upper()
    if word not in _UNITS:
        raise source.error(f"UNITS {shown(word)}", "INCH or MILLIMETER", line=source.lines[2].number)
    text = _header_field(source, 3, "INTERVAL", DECIMAL_ALLOWED)
    interval = to_decimal(text)
    if interval is None or interval <= 0:
        allowed = with_point(text, "a distance above 0")
        raise source.error(f"INTERVAL {shown(text)}", allowed, line=source.lines[3].number)
    text = _header_field(source, 4, "ENTRIES", "a number of points")
    entries = to_integer(text)
    if entries is None or entries < 2:
        allowed = "a whole number of points, at least 2"
        raise source.error(f"ENTRIES {shown(text)}", allowed, line=source.lines[4].number)
    return _Header(axis, _UNITS[word], interval, entries, source.lines[4].number)


def _header_field(source: SourceText, index: int, keyword: str, what: str) -> str:
    if index >= len(source.lines):
        raise source.error("the end of the file", f"{keyword} and {what}", line=source.last_line)
    line = source.lines[index]
    fields = line.text.split()
    if len(fields) != 2 or fields[0].upper() != keyword:
        raise source.error(shown(line.text), f"{keyword} and {what}", line=line.number)
    return fields[1]


def _parse_rows(source: SourceText, header: _Header) -> list[_Row]:
    rows, problems = [], []
    for line in source.lines[5:]:
        row = _parse_row(line)
        if isinstance(row, _Row):
            rows.append(row)
        else:
            found, wrong = row
            allowed = with_point(wrong, f"position, away, toward: each {DECIMAL_ALLOWED}")
            problems.append(source.problem(found, allowed, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if len(rows) != header.entries:
        line_number = rows[header.entries].line if len(rows) > header.entries else source.last_line
        allowed = f"{header.entries}, as ENTRIES on line {header.entries_line} says"
        raise source.error(f"{len(rows)} rows", allowed, line=line_number)
    return rows


def _parse_row(line: SourceLine) -> _Row | tuple[str, str]:
    """Return the row, or what was found instead and the field that is not a number ("" for none)."""
    fields = line.text.split()
    if len(fields) != 3:
        return (f"{len(fields)} fields in {shown(line.text)}" if fields else "a blank line"), ""
    numbers = [to_decimal(field) for field in fields]
    for field, number in zip(fields, numbers, strict=True):
        if number is None:
            return shown(field), field
    position, away, toward = (number or 0.0 for number in numbers)
    return _Row(position, away, toward, line.number)


def _check_positions(source: SourceText, header: _Header, rows: Sequence[_Row]) -> None:
    _check_order(source, rows)
    low, high = sorted((rows[0].position, rows[-1].position))
    if low < -HOME_TOLERANCE and high > HOME_TOLERANCE:
        raise _two_sided(source, header, rows)
    if abs(rows[0].position) > HOME_TOLERANCE:
        found = f"a first position of {rows[0].position:g}"
        raise source.error(found, "0: positions begin at home", line=rows[0].line)
    for before, after in itertools.pairwise(rows):
        step = abs(after.position - before.position)
        if abs(step - header.interval) > INTERVAL_TOLERANCE * header.interval:
            found = f"a step of {step:.8g} from {before.position:g} to {after.position:g}"
            raise source.error(found, f"INTERVAL {header.interval:g} within 0.01 %", line=after.line)


def _check_order(source: SourceText, rows: Sequence[_Row]) -> None:
    sign = 1 if rows[-1].position > rows[0].position else -1
    problems: list[FileProblem] = []
    for before, after in itertools.pairwise(rows):
        if sign * (after.position - before.position) <= 0:
            found = f"position {after.position:g} after {before.position:g}"
            allowed = f"positions that always {'ascend' if sign > 0 else 'descend'} from home"
            problems.append(source.problem(found, allowed, line=after.line, code="L11"))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


def _two_sided(source: SourceText, header: _Header, rows: Sequence[_Row]) -> TabFileError:
    is_rising = rows[-1].position > rows[0].position
    by_position = sorted(rows)
    readings = describe_both(
        Interpretation(
            "columns change direction at home",
            [_directed(row, away_is_forward=row.position >= 0) for row in by_position],
            header.units,
        ),
        Interpretation(
            "columns keep their direction everywhere",
            [_directed(row, away_is_forward=is_rising) for row in by_position],
            header.units,
        ),
    )
    return source.error(
        "positions on both sides of home: no manual says which column applies",
        "positions on one side of home: split the table there",
        line=rows[0].line,
        readings=readings,
    )


def _ascending(rows: Sequence[_Row], side: HomeSide) -> tuple[SourceRow, ...]:
    """Give the columns their directions and put the points in ascending order."""
    is_rising = side is HomeSide.MINUS
    return tuple(_directed(row, away_is_forward=is_rising) for row in (rows if is_rising else reversed(rows)))


def _directed(row: _Row, *, away_is_forward: bool) -> SourceRow:
    position, away, toward, line = row
    forward, backward = (away, toward) if away_is_forward else (toward, away)
    return SourceRow(position + 0.0, forward, backward, forward, backward, line, line)


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table; home, at 0, must be at one end of it, and the points must be evenly spaced.

    Positions and values are rounded to 8 decimals.

    Raises:
        TabFileError: no axis letter, degrees, 0 is not an end of the table, points that are not evenly spaced
            or are closer than 0.001 units.
    """
    if options.axis is None or not re.fullmatch("[A-Za-z]", options.axis):
        raise unwritable(NAME, f"axis {options.axis!r}", "one letter for its AXIS line: --to-axis LETTER")
    if table.units not in _UNIT_WORDS:
        raise unwritable(NAME, f"a table in {table.units.value}", "inch or mm")
    step = even_step(table, NAME)
    if step < MIN_STEP:
        raise unwritable(NAME, f"a step of {step:g}", f"at least {MIN_STEP:g}: positions have 8 decimals")
    is_plus = home_side(table, NAME) < 0
    rows = list(zip(table.positions, table.forward, table.backward, strict=True))
    if is_plus:
        rows = [(position, backward, forward) for position, forward, backward in reversed(rows)]
    lines = [
        "CNC10 TAB FILE VERSION 3",
        f"AXIS {options.axis.upper()}",
        f"UNITS {_UNIT_WORDS[table.units]}",
        f"INTERVAL {step:.10g}",
        f"ENTRIES {len(rows)}",
        *("".join(f"\t{number:+.8f}" for number in row) for row in rows),
    ]
    losses = (f"positions and values are rounded to 8 decimals ({table.units.value})",)
    return Written("".join(f"{line}\n" for line in lines), losses, FileContext(axis=options.axis))
