"""Numbers of a CSV file, which may have been written where the decimal mark is a comma.

A comma in a number is a decimal mark or a mark of thousands. It is read as a decimal mark if the file proves
it: no number has a point, and one at least cannot be grouped by thousands (``0,5``, ``12,75``). What nothing
proves is refused.
"""

import re
from collections.abc import Sequence
from typing import Final

from gateway.tabfile.csv_text import MAX_PROBLEMS, CsvRow, CsvText
from gateway.tabfile.errors import TabFileError
from gateway.tabfile.fields import DECIMAL_ALLOWED, to_decimal
from gateway.tabfile.text import SourceText, shown

GROUPED: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:,[0-9]{3})+")
"""A number whose commas may as well group its thousands."""
_LONE_ZERO: Final = re.compile(r"[+-]?0[0-9].*")
REMEDY: Final = "decimal points throughout (1.25), or decimal commas with semicolons between the columns"


def numbers(source: SourceText, csv: CsvText, rows: Sequence[CsvRow]) -> list[tuple[float, ...]]:
    """Return the numbers of all rows.

    Raises:
        TabFileError: a cell that is no number, another number of cells than the first row has, commas that
            nothing proves to be decimal marks.
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
                    what, allowed = "a row of empty cells", "a point in every row: take this one out"
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
        # the rarer of both is the slip
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
