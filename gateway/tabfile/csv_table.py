"""Plain CSV of our own: free positions, both directions, lengths and degrees, full precision.

Grammar (see :mod:`gateway.tabfile.csv_text` for comments, separators and sums)::

    header := position column, then either "correction" or both of "forward" and "backward", in any order
    column := name "_" unit
    name   := position | correction | forward | backward | error | forward_error | backward_error
    unit   := mm | inch | degree, for corrections also um (of mm and inch) or arcsec (of degree)
    row    := one number for each column

``correction``, ``forward`` and ``backward`` (also ``forward_correction``, ``backward_correction``) are
amounts to ADD to a commanded position; the single ``correction`` holds in both directions. ``error`` columns
are measured errors, actual - commanded, and are subtracted. ``forward`` holds while the position grows. All
correction columns have one unit. Positions ascend strictly or descend strictly. No column is ignored.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import MM_PER_INCH, Units
from gateway.tabfile.checks import check_home, check_stated, context_in_file_units
from gateway.tabfile.csv_text import (
    MAX_PROBLEMS,
    CsvText,
    axis_letter,
    check_sums,
    csv_file,
    first_row,
    numbers,
    parse_csv,
)
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import TabFileError
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import SourceText, shown
from gateway.tabfile.writing import WriteOptions, Written

NAME: Final = "csv"
TITLE: Final = "plain CSV with named columns, free positions, two directions, full precision"
USES: Final = frozenset({"file_start", "file_home"})
EXAMPLE: Final = "a header such as position_mm,forward_mm,backward_mm"
_SIGN: Final = re.compile(r"(?i)(?:^|[^a-z])(?:position|forward|backward|correction|error)_[a-z]")
_COLUMN: Final = re.compile(
    r"(position|correction|error|(?:forward|backward)(?:_correction|_error)?)_(mm|inch|degree|um|arcsec)",
    re.IGNORECASE,
)
_PER_UNIT: Final = {
    ("um", Units.MM): 1000.0,
    ("um", Units.INCH): 1000.0 * MM_PER_INCH,
    ("arcsec", Units.DEGREE): 3600.0,
}
"""The number of smaller units in one machine unit."""
_PLAUSIBLE: Final = {
    "mm": (0.0, 0.5),
    "inch": (0.0, 0.1),
    "degree": (0.0, 0.5),
    "um": (0.1, 500.0),
    "arcsec": (0.1, 1800.0),
}
"""Bounds of the largest |value| of a sound file: beyond them the file is probably in another unit."""


class _Header(Struct, frozen=True):
    """The columns; ``per_unit`` of the file's values make one machine unit, < 0 for errors."""

    units: Units
    position: int
    forward: int
    backward: int
    value_unit: str
    per_unit: float
    names: tuple[str, ...]


def recognise(source: SourceText) -> bool:
    """Whether the first line that is not a comment has one of our column names."""
    first = first_row(source)
    return first is not None and _SIGN.search(first.text) is not None


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the file; its header contains all that the reader needs.

    Raises:
        TabFileError: an unknown, missing or repeated column, mixed units, a cell that is not a number,
            positions that are not monotonic, a wrong checksum, another axis, a range that does not fit the
            travel.
    """
    csv = parse_csv(source, ",;\t", EXAMPLE)
    header = _parse_header(source, csv)
    found = numbers(source, csv, csv.rows[1:])
    rows = _rows(source, csv, header, found)
    check_sums(source, csv, len(rows))
    context = context_in_file_units(source, context, header.units)
    axis = axis_letter(source, csv, context)
    check_home(source, rows, context)
    check_stated(source, rows, header.units, context)
    rule = "value is added unchanged" if header.per_unit > 0 else "error = actual - commanded: subtracted"
    return Decoded(
        rows,
        header.units,
        context,
        header.value_unit,
        f"column {header.names[header.forward]}: {rule}",
        f"column {header.names[header.backward]}: {rule}",
        axis=axis,
        plausible=_PLAUSIBLE[header.value_unit],
    )


def _parse_header(source: SourceText, csv: CsvText) -> _Header:
    first = csv.rows[0]
    columns: dict[str, tuple[int, str, str]] = {}
    for index, cell in enumerate(first.cells):
        match = _COLUMN.fullmatch(cell)
        if match is None:
            remedy = "" if cell else ": remove the empty columns"
            raise source.error(
                f"a column {shown(cell)}", f"{EXAMPLE}; nothing else{remedy}", line=first.number
            )
        name = match[1].lower()
        column = name.split("_")[0]
        column = "correction" if column == "error" else column
        if column in columns:
            raise source.error(f"a second {column} column, {shown(cell)}", "each once", line=first.number)
        columns[column] = (index, match[2].lower(), "error" if "error" in name else "correction")
    if set(columns) not in ({"position", "correction"}, {"position", "forward", "backward"}):
        raise source.error(
            f"the columns {', '.join(first.cells)}",
            "position with correction (for both directions), or position with forward and backward",
            line=first.number,
        )
    position, word, _ = columns.pop("position")
    kinds = {(unit, kind) for _, unit, kind in columns.values()}
    if len(kinds) != 1:
        raise source.error(
            f"mixed columns {', '.join(first.cells)}",
            "both directions in one unit, both as corrections or both as errors",
            line=first.number,
        )
    unit, kind = kinds.pop()
    if word not in ("mm", "inch", "degree") or (unit != word and (unit, Units(word)) not in _PER_UNIT):
        raise source.error(
            f"positions in {word} with values in {unit}",
            "positions in mm, inch or degree; values in the same unit, or in um (arcsec with degrees)",
            line=first.number,
        )
    per_unit = _PER_UNIT.get((unit, Units(word)), 1.0) * (-1.0 if kind == "error" else 1.0)
    forward = columns.get("forward", columns.get("correction"))
    backward = columns.get("backward", columns.get("correction"))
    assert forward is not None
    assert backward is not None
    return _Header(Units(word), position, forward[0], backward[0], unit, per_unit, first.cells)


def _rows(
    source: SourceText, csv: CsvText, header: _Header, found: Sequence[tuple[float, ...]]
) -> tuple[SourceRow, ...]:
    """Return the points in ascending order."""
    if len(found) < 2:
        raise source.error(f"{len(found)} rows of numbers", "at least 2 points", line=source.last_line)
    rows = [
        SourceRow(
            cells[header.position] + 0.0,
            # + 0.0 turns -0.0 into 0.0
            cells[header.forward] / header.per_unit + 0.0,
            cells[header.backward] / header.per_unit + 0.0,
            cells[header.forward],
            cells[header.backward],
            row.number,
            row.number,
        )
        for row, cells in zip(csv.rows[1:], found, strict=True)
    ]
    sign = 1 if rows[-1].position > rows[0].position else -1
    problems = [
        source.problem(
            f"position {after.position:.9g} after {before.position:.9g}",
            f"positions that always {'ascend' if sign > 0 else 'descend'}",
            line=after.forward_line,
            code="L11",
        )
        for before, after in pairwise(rows)
        if sign * (after.position - before.position) <= 0
    ]
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return tuple(rows if sign > 0 else reversed(rows))


def template(units: Units, separator: str = ",") -> str:
    """Return a file to fill in: a header and rows of zeros, which change nothing."""
    header = separator.join(f"{name}_{units.value}" for name in ("position", "forward", "backward"))
    comments = (
        "# corrections to ADD: commanded less measured position; forward: while the position grows",
        "# put your own points in the place of these, in the order of their positions",
    )
    rows = (separator.join((position, "0", "0")) for position in ("0", "50", "100"))
    return "".join(f"{line}\n" for line in (*comments, header, *rows))


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table unchanged, each number with all its digits. The format has no losses."""
    unit = table.units.value
    if table.is_unidirectional:
        header = f"position_{unit},correction_{unit}"
        columns = [table.positions, table.forward]
    else:
        header = f"position_{unit},forward_{unit},backward_{unit}"
        columns = [table.positions, table.forward, table.backward]
    lines = [",".join(repr(number + 0.0) for number in row) for row in zip(*columns, strict=True)]
    comments = ["corrections to ADD to a commanded position; forward: while the position grows"]
    if options.axis is not None:
        comments.append(f"axis: {options.axis.upper()}")
    text = csv_file(comments, [header, *lines], len(lines))
    return Written(text, (), FileContext(axis=options.axis))
