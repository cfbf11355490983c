"""Parts that the CSV dialects share: comments above the rows, one separator, checksums.

Grammar::

    file    := comment* row+
    comment := "#" text                 above the first row only; blank lines may stand between comments
    row     := cell (separator cell)*   separator: comma, semicolon or tab, the same in all rows
    cell    := text, or text in double quotes without a separator or another quote in it

A comment ``# key: value`` is provenance. Three keys have a meaning: ``axis``, a letter, and the two sums of
:mod:`gateway.tabfile.text`.
"""

import re
from collections.abc import Iterable, Sequence
from typing import Final

from msgspec import Struct

from gateway.tabfile.errors import TabFileError
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import (
    DECIMAL_ALLOWED,
    Facts,
    SourceLine,
    SourceText,
    check_points,
    check_sum,
    shown,
    stamped,
    stated_facts,
    to_decimal,
)

SEPARATORS: Final = {",": "commas", ";": "semicolons", "\t": "tabs"}
MAX_PROBLEMS: Final = 20


class CsvRow(Struct, frozen=True):
    """One row; ``cells`` without blanks around them."""

    number: int
    cells: tuple[str, ...]


class CsvText(Struct, frozen=True):
    """The rows of a file, and the facts in its comments."""

    separator: str
    rows: tuple[CsvRow, ...]
    facts: Facts
    body: tuple[SourceLine, ...]


def split_cells(text: str, separator: str) -> tuple[str, ...]:
    """Split a line into cells, without the blanks and the quotes around them.

    >>> split_cells('"a" ; 1;"b', ";")
    ('a', '1', '"b')
    """
    return tuple(_unquoted(cell.strip()) for cell in text.split(separator))


def _unquoted(cell: str) -> str:
    inner = cell[1:-1]
    return inner.strip() if cell == f'"{inner}"' and '"' not in inner else cell


def first_row(source: SourceText) -> SourceLine | None:
    """Return the first line that is neither blank nor a comment."""
    return next((line for line in source.lines if line.text and not line.text.startswith("#")), None)


def parse_csv(source: SourceText, separators: str, what: str) -> CsvText:
    """Split a text into rows; ``what`` names the expected first row.

    Raises:
        TabFileError: no separator or several in the first row, a comment or a blank line among the rows, a
            repeated key.
    """
    first = first_row(source)
    assert first is not None, "a dialect recognises its files by their first row"
    start = source.lines.index(first)
    facts = stated_facts(source, source.lines[:start], "#")
    found = [separator for separator in SEPARATORS if separator in first.text]
    if len(found) != 1 or found[0] not in separators:
        names = " or ".join(SEPARATORS[separator] for separator in separators)
        raise source.error(shown(first.text), f"{what}, with {names} between its cells", line=first.number)
    body = source.lines[start:]
    _check_lines(source, body)
    rows = tuple(CsvRow(line.number, split_cells(line.text, found[0])) for line in body)
    return CsvText(found[0], rows, facts, body)


def check_sums(source: SourceText, csv: CsvText, points: int) -> None:
    """Check a file without errors against its stated sums.

    Raises:
        TabFileError: another number of points, or changed rows.
    """
    check_points(source, csv.facts, points)
    check_sum(source, csv.body, csv.facts)


def axis_letter(source: SourceText, csv: CsvText, context: FileContext) -> str | None:
    """Return the letter stated by a comment; other words about an axis are provenance.

    Raises:
        TabFileError: the file is for another axis.
    """
    value, line = csv.facts.get("axis", ("", 0))
    if not re.fullmatch("[A-Za-z]", value):
        return None
    letter = value.upper()
    if context.axis is not None and context.axis.upper() != letter:
        given = context.axis.upper()
        raise source.error(
            f"axis {letter}, read for axis {given}", f"axis {given}: is this the right file?", line=line
        )
    return letter


def csv_file(comments: Iterable[str], rows: Sequence[str], points: int) -> str:
    """Return the text of a file: comments, both sums, rows."""
    return "".join(f"{line}\n" for line in stamped(comments, rows, points, "#"))


def _check_lines(source: SourceText, body: Iterable[SourceLine]) -> None:
    problems = [
        source.problem(
            "a comment among the rows" if line.text else "a blank line among the rows",
            "comments above the first row, rows without a gap",
            line=line.number,
        )
        for line in body
        if not line.text or line.text.startswith("#")
    ]
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


# --- Numbers, possibly with a decimal comma
#
# A comma in a number is a decimal mark or a mark of thousands. It is read as a decimal mark if the file
# proves it: no number has a point, and at least one cannot be grouped by thousands (``0,5``, ``12,75``).
# Commas without this proof are refused.

GROUPED: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:,[0-9]{3})+")
"""A number whose commas may also be marks of thousands."""
_LONE_ZERO: Final = re.compile(r"[+-]?0[0-9].*")
REMEDY: Final = "decimal points throughout (1.25), or decimal commas with semicolons between the columns"


def numbers(source: SourceText, csv: CsvText, rows: Sequence[CsvRow]) -> list[tuple[float, ...]]:
    """Return the numbers of all rows.

    Raises:
        TabFileError: a cell that is not a number, another number of cells than in the first row, commas that
            are not proven decimal marks.
    """
    width = len(csv.rows[0].cells)
    short = [
        source.problem(
            f"{len(row.cells)} cells",
            f"{width}, as the first row (line {csv.rows[0].number}) has"
            + (f"; {REMEDY}" if csv.separator == "," and len(row.cells) > width else ""),
            line=row.number,
        )
        for row in rows
        if len(row.cells) != width
    ]
    if short:
        raise TabFileError(*short[:MAX_PROBLEMS])
    has_commas = csv.separator != "," and _has_decimal_commas(source, rows)
    found, problems = [], []
    for row in rows:
        values = []
        for cell in row.cells:
            value = to_decimal(cell.replace(",", ".", 1) if has_commas else cell)
            if value is None or (csv.separator == "," and _LONE_ZERO.fullmatch(cell)):
                allowed = (
                    f"{DECIMAL_ALLOWED}, without zeros before it" if value is not None else DECIMAL_ALLOWED
                )
                what = shown(cell)
                if not any(row.cells):
                    what, allowed = "a row of empty cells", "a point in every row: remove this one"
                problems.append(source.problem(what, allowed, line=row.number))
                break
            values.append(value)
        found.append(tuple(values))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return found


def _has_decimal_commas(source: SourceText, rows: Sequence[CsvRow]) -> bool:
    cells = [(cell, row.number) for row in rows for cell in row.cells]
    commas = [(cell, line) for cell, line in cells if "," in cell]
    points = [(cell, line) for cell, line in cells if "." in cell]
    if not commas:
        return False
    if points:
        # The rarer of both is the mistake.
        cell, line = min(commas, points, key=len)[0]
        other = "commas" if "." in cell else "points"
        raise source.error(
            f"{shown(cell)} among numbers with decimal {other}", f"one decimal mark: {REMEDY}", line=line
        )
    if all(GROUPED.fullmatch(cell) for cell, _ in commas):
        cell, line = commas[0]
        raise source.error(
            f"{shown(cell)}, which is {cell.replace(',', '.')} or {cell.replace(',', '')}",
            REMEDY,
            line=line,
        )
    return True
