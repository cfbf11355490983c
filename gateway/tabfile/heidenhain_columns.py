"""The columns of a Heidenhain table: their names, which are filled in, and the cells of each row.

A row may have a number in every column. Controls list a column for each of their axes and leave unused ones
blank. A number then belongs to the column whose name begins at the same character. A column is blank in all
rows or in none.
"""

import re
from collections import Counter
from collections.abc import Sequence
from typing import Final

from msgspec import Struct

from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.text import SourceLine, SourceText, shown

POSITION: Final = "AXISPOS"
NEGATIVE: Final = "BACKLASH"
AXIS: Final = re.compile(r"[A-Z][0-9]{0,2}")
MAX_PROBLEMS: Final = 20
_FIELD: Final = re.compile(r"\S+")


class Names(Struct, frozen=True):
    """The line of names, each with the index of its first character."""

    names: tuple[str, ...]
    starts: tuple[int, ...]
    line: SourceLine

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axis columns."""
        return tuple(name for name in self.names[1:] if name not in {POSITION, NEGATIVE})


class ColumnGrid(Struct, frozen=True):
    """The columns that are filled in, and the cells of each row by column name."""

    filled: tuple[str, ...]
    blank: tuple[str, ...]
    rows: tuple[tuple[dict[str, str], int], ...]
    """Cells and line number."""

    @property
    def axes(self) -> list[str]:
        """Names of the axis columns that hold numbers."""
        return [name for name in self.filled[1:] if name not in {POSITION, NEGATIVE}]


def parse_names(source: SourceText) -> Names:
    """Read the second line.

    Raises:
        TabFileError: there is no second line, or it does not name NR, the positions and an axis, each once.
    """
    if len(source.lines) < 2:
        raise source.error("the end of the file", f"a line 'NR {POSITION} X'", line=source.last_line)
    line = source.lines[1]
    fields = list(_FIELD.finditer(line.text))
    names = Names(tuple(f.group().upper() for f in fields), tuple(f.start() for f in fields), line)
    odd = [name for name, count in Counter(names.names).items() if count > 1]
    odd += [name for name in names.axes if not AXIS.fullmatch(name)]
    if names.names[:1] != ("NR",) or POSITION not in names.names or not names.axes or odd:
        raise source.error(
            f"column {shown(odd[0])} in {shown(line.text)}" if odd else shown(line.text),
            f"first NR, then {POSITION}, a column for each axis (X, Y, C, Z2 ...) and {NEGATIVE} if it "
            "exists, each once",
            line=line.number,
        )
    return names


def parse_cells(source: SourceText, names: Names) -> ColumnGrid:
    """Read the rows, from the third line to the last but one.

    Raises:
        TabFileError: no [END], a row with a wrong number, numbers that belong to no column, a column that is
            blank in some rows only.
    """
    last = source.lines[-1]
    if last.text.upper() != "[END]":
        raise source.error(f"the last line {shown(last.text)}", "[END]", line=last.number)
    rows: list[tuple[dict[str, str], int]] = []
    problems: list[FileProblem] = []
    for number, line in enumerate(source.lines[2:-1]):
        cells = _cells(line, number, names)
        if isinstance(cells, dict):
            rows.append((cells, line.number))
        else:
            problems.append(source.problem(*cells, line=line.number))
    problems = problems or _partly_blank(source, names, rows)
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if len(rows) < 2:
        raise source.error(f"{len(rows)} row(s)", "at least 2", line=source.last_line)
    filled = tuple(name for name in names.names if name in rows[0][0])
    return ColumnGrid(filled, tuple(name for name in names.names if name not in filled), tuple(rows))


def _cells(line: SourceLine, number: int, names: Names) -> dict[str, str] | tuple[str, str]:
    """Return the cells by column name, or what was found and what is allowed."""
    fields = list(_FIELD.finditer(line.text))
    if len(fields) == len(names.names):
        cells = dict(zip(names.names, (field.group() for field in fields), strict=True))
    else:
        # The width of a tab is not fixed.
        names_by_start = (
            {} if "\t" in line.text + names.line.text else dict(zip(names.starts, names.names, strict=True))
        )
        cells = {
            names_by_start[field.start()]: field.group()
            for field in fields
            if field.start() in names_by_start
        }
        if not fields or len(cells) != len(fields):
            found = f"{len(fields)} fields in {shown(line.text)}" if fields else "a blank line"
            return found, (
                f"{len(names.names)}, one for each column of line {names.line.number}; or fewer, each "
                "starting below the first letter of its column"
            )
    if "NR" not in cells:
        return (
            f"no number in column NR in {shown(line.text)}",
            f"NR {number}: rows are numbered from 0 without gaps",
        )
    if cells["NR"] != str(number):
        return f"row {shown(cells['NR'])}", f"NR {number}: rows are numbered from 0 without gaps"
    return cells


def _partly_blank(
    source: SourceText, names: Names, rows: Sequence[tuple[dict[str, str], int]]
) -> list[FileProblem]:
    problems = []
    for name in names.names:
        blank = [line for cells, line in rows if name not in cells]
        if blank and (len(blank) < len(rows) or name == POSITION):
            found = f"no number in column {name}"
            problems.append(source.problem(found, "a number in each row, or in none", line=blank[0]))
    return problems
