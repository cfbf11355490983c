"""Renishaw error compensation tables (``.ren``), made by the laser's software. Read only.

Grammar, from public programs that read such tables; words in any case, any blanks and tabs, ``:`` or ``=``
allowed after a name::

    Compensation start    position
    Compensation end      position
    Compensation spacing  distance           the three in any order
    No.  Axis position  Combined             or: No.  Axis position  Forward  Reverse
    number  position  value  [value]         numbered from 1, from the start to the end in equal steps

Blank lines are allowed above the first row. Any other line is refused: an undocumented setting may reverse
the sign of all values. The user must give what the file does not contain. ``file_units`` is the unit of the
positions. ``file_counts_per_unit`` is the number of value units in one such unit, negative if the values are
measured errors (actual - commanded) instead of amounts to add. For an axis in mm it is 1000 for corrections
in micrometres, -1000 for errors. ``Combined`` holds in both directions; ``Forward`` while the position grows.
"""

import re
from collections.abc import Sequence
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.tabfile.checks import (
    AS_THEY_STAND,
    Interpretation,
    check_home,
    check_own_range,
    check_start,
    context_in_file_units,
    required_units,
)
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceLine, SourceText, shown, to_decimal, to_integer
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "renishaw-ren"
TITLE: Final = "Renishaw error compensation table (.ren), even grid; read only"
USES: Final = frozenset({"file_counts_per_unit", "file_start", "file_home"})
MAX_PROBLEMS: Final = 20
MAX_POINTS: Final = 100_000
STEP_TOLERANCE: Final = 1e-4
"""A position may be off its even position by this fraction of the spacing."""
_SETTINGS: Final = ("start", "end", "spacing")
_SETTING: Final = re.compile(r"compensation\s+(start|end|spacing)\s*[:=]?\s*(\S.*)?", re.IGNORECASE)
_COLUMNS: Final = re.compile(r"no\.?\s+axis\s+position\s+(combined|forward\s+reverse)", re.IGNORECASE)
_HEADINGS: Final = "'No. Axis position Combined' or 'No. Axis position Forward Reverse'"


def recognise(source: SourceText) -> bool:
    """Whether one of the first lines, above the columns, is a setting of such a table or the columns are."""
    head = source.lines[: len(_SETTINGS) + 2]
    return any(_SETTING.fullmatch(line.text) or _COLUMNS.fullmatch(line.text) for line in head)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table with the units, the scale and the sign from the context.

    Raises:
        TabFileError: a line outside the grammar, rows that do not run from the start to the end, no units or
            no scale given, a range that does not fit the travel.
    """
    settings, values_per_row, body = _parse_head(source)
    found = _parse_rows(source, body, 2 + values_per_row)
    _check_grid(source, settings, found)
    units = required_units(source, context, "a Renishaw table")
    context = context_in_file_units(source, context, units)
    scale = context.file_counts_per_unit
    if scale is None:
        raise source.error(
            "a Renishaw table without file_counts_per_unit: the file states neither the unit nor the sign "
            "of its values",
            f"file_counts_per_unit = steps of its values in one {context.option_units(units).value}, the "
            "unit of the axis, negative if the values are errors (actual - commanded), which are "
            "subtracted: 1000 or -1000 for micrometres and an axis in mm",
        )
    rows = [
        SourceRow(
            cells[1] + 0.0,
            cells[2] / scale + 0.0,
            cells[-1] / scale + 0.0,
            cells[2],
            cells[-1],
            line,
            line,
        )
        for cells, line in found
    ]
    ascending = tuple(rows if settings["start"][0] < settings["end"][0] else reversed(rows))
    check_home(source, ascending, context)
    check_start(source, ascending, context)
    remedy = "the right file_units and travel"
    check_own_range(source, Interpretation(AS_THEY_STAND, ascending, units), context, remedy)
    sign = "added" if scale > 0 else "errors (actual - commanded), as given: subtracted"
    rule = f"column {{}}: value / {abs(scale):g} is {sign}"
    columns = ("Combined", "Combined") if values_per_row == 1 else ("Forward", "Reverse")
    return Decoded(
        ascending,
        units,
        context,
        f"{units.value}/{abs(scale):g}",
        rule.format(columns[0]),
        rule.format(columns[1]),
    )


def _parse_head(source: SourceText) -> tuple[dict[str, tuple[float, int]], int, Sequence[SourceLine]]:
    """Return the settings with their lines, the number of values in a row, and the lines of the rows."""
    settings: dict[str, tuple[float, int]] = {}
    for index, line in enumerate(source.lines):
        columns = _COLUMNS.fullmatch(line.text)
        if columns is not None:
            missing = [name for name in _SETTINGS if name not in settings]
            if missing:
                allowed = f"Compensation {missing[0]} above the columns"
                raise source.error(f"no Compensation {missing[0]}", allowed, line=line.number)
            return settings, len(columns[1].split()), source.lines[index + 1 :]
        if not line.text:
            continue
        setting = _SETTING.fullmatch(line.text)
        if setting is None:
            allowed = (
                f"Compensation start, end or spacing, or the columns {_HEADINGS}. Remove a title line; "
                "remove another setting only if it does not change the sign or unit of the values"
            )
            raise source.error(shown(line.text), allowed, line=line.number)
        name, number = setting[1].lower(), to_decimal(setting[2] or "")
        if name in settings:
            allowed = f"only one (line {settings[name][1]})"
            raise source.error(f"a second Compensation {name}", allowed, line=line.number)
        if number is None or (name == "spacing" and number <= 0):
            allowed = "a distance above 0" if name == "spacing" else DECIMAL_ALLOWED
            raise source.error(
                shown(line.text), f"Compensation {name} and {allowed}, without a unit", line=line.number
            )
        settings[name] = (number, line.number)
    raise source.error("the end of the file", f"the columns {_HEADINGS}", line=source.last_line)


def _parse_rows(
    source: SourceText, body: Sequence[SourceLine], width: int
) -> list[tuple[tuple[float, ...], int]]:
    rows: list[tuple[tuple[float, ...], int]] = []
    problems: list[FileProblem] = []
    for index, line in enumerate(body, start=1):
        fields = line.text.split()
        numbers = [to_decimal(field) for field in fields]
        if len(fields) != width or to_integer(fields[0]) != index or None in numbers:
            allowed = f"number {index}, a position and {width - 2} value(s), each {DECIMAL_ALLOWED}"
            problems.append(source.problem(shown(line.text), allowed, line=line.number))
        rows.append((tuple(number or 0.0 for number in numbers), line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return rows


def _check_grid(
    source: SourceText,
    settings: dict[str, tuple[float, int]],
    rows: Sequence[tuple[tuple[float, ...], int]],
) -> None:
    start, end, spacing = (settings[name][0] for name in _SETTINGS)
    intervals = abs(end - start) / spacing
    size = round(intervals) + 1 if intervals < MAX_POINTS else 0
    if size < 2 or abs(intervals - round(intervals)) > STEP_TOLERANCE:
        raise source.error(
            f"{start:g} to {end:g} in steps of {spacing:g}",
            f"a whole number of steps, 1 to {MAX_POINTS - 1}",
            line=settings["spacing"][1],
        )
    if len(rows) != size:
        raise source.error(
            f"{len(rows)} rows",
            f"{size}: {start:g} to {end:g} in steps of {spacing:g}",
            line=source.last_line,
        )
    step = (end - start) / (size - 1)
    problems = [
        source.problem(
            f"position {cells[1]:.9g}",
            f"{start + index * step:.9g}, as start, end and spacing say",
            line=line,
            code="L11",
        )
        for index, (cells, line) in enumerate(rows)
        if abs(cells[1] - (start + index * step)) > STEP_TOLERANCE * spacing
    ]
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


def write(table: CorrectionTable, _: WriteOptions) -> Written:
    """Refuse: the laser's software makes these tables, and no control reads them.

    Raises:
        TabFileError: always.
    """
    raise unwritable(
        NAME,
        f"a table of {len(table.positions)} points to write",
        "another format, such as csv: only the laser's software makes these files",
    )
