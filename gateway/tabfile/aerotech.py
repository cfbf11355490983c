"""Aerotech axis calibration (``.cal``): one direction, even grid, values in fractions of the axis unit.

Grammar, from public programs that write such files and from Aerotech's help on axis calibration. Words may be
in any case, separated by blanks or tabs::

    file    := (comment | blank line)* table+
    comment := (";" | "'") text                         outside tables only
    table   := start+ (number+)+ ":END"                 values: one to any number of lines, no blank lines
    start   := ":START" word+                           all words of all start lines together
    word    := axis                                     a name or a number, the first word
             | "MASTER=" axis                           only the axis itself; another one is a cross table
             | "SAMPLEDIST=" distance                   of two values, in axis units
             | "POSUNIT=PRIMARY"
             | "CORUNIT=PRIMARY" ["/1000" | "/3600"]    unit of the values: thousandths, or seconds of arc
             | "HOMEDIRECTION=" ("CW" | "CCW") | "HOMEOFFSET=" number
             | "NEGCOR"                                 the values are measured deviations
             | "SERIALNUMBER=" word                     of the stage; reported, not compared

Blanks are allowed around a "=".

A value is minus the measured deviation, so it is added; with NEGCOR it is subtracted. The primary unit is
that of the axis: mm, inch or degree. The file does not name it, so ``file_units`` must. The file does not
give the position of the first value either: the table counts from home, as the axis homed then.
``file_start`` must give the position of the lowest value; values are read upwards from there. Two-dimensional
tables are refused. ``file_axis`` chooses one of several tables. Two comments of our own above the tables are
checked, see :mod:`gateway.tabfile.text`.
"""

import re
from collections import deque
from collections.abc import Sequence
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import (
    Interpretation,
    check_home,
    check_own_range,
    context_in_file_units,
    required_units,
)
from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import MAX_POSITION, FileContext
from gateway.tabfile.text import (
    DECIMAL_ALLOWED,
    SourceLine,
    SourceText,
    check_points,
    check_sum,
    listed,
    shown,
    stamped,
    stated_facts,
    to_decimal,
)
from gateway.tabfile.writing import WriteOptions, Written, even_step, one_curve, unwritable

NAME: Final = "aerotech-cal"
TITLE: Final = "Aerotech axis calibration (.cal), one direction, even grid"
USES: Final = frozenset({"file_start", "file_home", "file_axis"})
COMMENTS: Final = ";'"
MAX_PROBLEMS: Final = 20
PER_LINE: Final = 6
DECIMALS: Final = 6
_AXIS: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}|[0-9]{1,3}")
_PER_UNIT: Final = {"PRIMARY": 1.0, "PRIMARY/1000": 1000.0, "PRIMARY/3600": 3600.0}
_TWO_DIMENSIONS: Final = (":START2D", "OFFSETROW", "OFFSETCOL", "OUTAXIS3")
_PAIRED: Final = ("MASTER", "SAMPLEDIST", "POSUNIT", "CORUNIT", "HOMEDIRECTION", "HOMEOFFSET")
_SERIAL: Final = "SERIALNUMBER"
_ALLOWED: Final = f"the axis, then {'=, '.join((*_PAIRED, _SERIAL))}= or NEGCOR"
_LOOSE_EQUALS: Final = re.compile(r"[ \t]*=[ \t]*(?=[^ \t=]+(?:[ \t]|$))")
"""A "=" and the blanks around it, before a value. A "=" without a value does not match."""


class _Table(Struct, frozen=True):
    """One table as written; ``words`` maps a key to its value and line, NEGCOR to an empty value."""

    axis: str
    line: int
    words: dict[str, tuple[str, int]]
    values: tuple[tuple[float, int], ...]


def recognise(source: SourceText) -> bool:
    """Whether any line is a ``:START`` statement."""
    return any(_head(line).startswith(":START") for line in source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the file with the units, the start and, if it has several tables, the axis from the context.

    Raises:
        TabFileError: a line outside the grammar, a table in two dimensions or of another axis, no units or no
            start given, a wrong checksum, a range that does not fit the travel.
    """
    start = next((i for i, line in enumerate(source.lines) if line.text.startswith(":")), len(source.lines))
    facts = stated_facts(source, source.lines[:start], COMMENTS)
    tables = _parse(source)
    size = sum(len(table.values) for table in tables)
    check_points(source, facts, size)
    check_sum(source, source.lines[start:], facts)
    table = _pick(source, tables, context)
    units = required_units(source, context, "an Aerotech file")
    context = context_in_file_units(source, context, units)
    step, per_unit = _scale(source, table, units)
    if context.file_start is None:
        raise source.error(
            f"{size} values, {step:g} {units.value} apart; the file does not state where the first one is",
            "file_start = the position of the lowest value (the file counts from home)",
            line=table.line,
        )
    rows = _rows(table, context.file_start, step, per_unit)
    check_home(source, rows, context)
    reading = Interpretation(f"file_start {context.file_start:g}", rows, units)
    check_own_range(source, reading, context, "the right file_start, file_units and travel")
    remarks = () if "points" in facts else (_uncounted(size, table.line),)
    return _decoded(table, rows, context, per_unit, remarks)


def _decoded(
    table: _Table,
    rows: tuple[SourceRow, ...],
    context: FileContext,
    per_unit: float,
    remarks: tuple[Lint, ...],
) -> Decoded:
    assert context.units is not None
    unit = context.units.value
    rule = "value is added" if per_unit > 0 else "NEGCOR: value is subtracted"
    homing = [f"{key}={table.words[key][0]}" for key in _PAIRED[4:] if key in table.words]
    reach = f"{len(rows)} values from file_start {rows[0].position:g} up to {rows[-1].position:g} {unit}"
    decisions = [f"{reach}; assumed to ascend: the file does not state it"]
    if homing:
        decisions.append(
            f"made for {', '.join(homing)}: check that the axis homes like this, because a table is valid "
            "only with the homing of its measurement"
        )
    if _SERIAL in table.words:
        decisions.append(
            f"check that this is the stage with {_SERIAL}={table.words[_SERIAL][0]}: the table was "
            "made for it"
        )
    return Decoded(
        rows,
        context.units,
        context,
        unit if abs(per_unit) == 1 else f"{unit}/{abs(per_unit):g}",
        rule,
        rule,
        axis=table.axis.upper() if re.fullmatch("[A-Za-z]", table.axis) else None,
        file_axis=table.axis,
        decisions=tuple(decisions),
        remarks=remarks,
        behaves_as=('outside = "hold"',),
    )


def _uncounted(size: int, line: int) -> Lint:
    return Lint(
        "R10",
        LintSeverity.WARNING,
        f"count the {size} values, then add the comment '; points: {size}' above the table. The file does "
        "not state their number, and a lost line would move all values after it",
        line,
    )


def _parse(source: SourceText) -> list[_Table]:
    tables: list[_Table] = []
    lines = deque(source.lines)
    while lines:
        line = lines.popleft()
        if not line.text or line.text[0] in COMMENTS:
            continue
        if _head(line).startswith(":START"):
            tables.append(_parse_table(source, line, lines))
            continue
        raise source.error(shown(line.text), "a comment (; or '), or :START and an axis", line=line.number)
    return tables


def _parse_table(source: SourceText, first: SourceLine, lines: deque[SourceLine]) -> _Table:
    words: dict[str, tuple[str, int]] = {}
    axis = _parse_start(source, first, words, is_first=True)
    while lines and _head(lines[0]).startswith(":START"):
        _parse_start(source, lines.popleft(), words, is_first=False)
    values: list[tuple[float, int]] = []
    problems: list[FileProblem] = []
    while True:
        if not lines:
            raise source.error(
                "the end of the file", f":END of the table of axis {axis}", line=source.last_line
            )
        line = lines.popleft()
        if _head(line) == ":END":
            break
        numbers = [to_decimal(field) for field in line.text.split()]
        if not numbers or None in numbers:
            problems.append(
                source.problem(_found(line), f"values, each {DECIMAL_ALLOWED}, or :END", line=line.number)
            )
        values.extend((number, line.number) for number in numbers if number is not None)
    if len(line.text.split()) > 1:
        problems.append(source.problem(shown(line.text), ":END alone", line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if len(values) < 2:
        raise source.error(f"{len(values)} values", "at least 2", line=line.number)
    return _Table(axis, first.number, words, tuple(values))


def _head(line: SourceLine) -> str:
    # A line may consist of blanks other than spaces.
    return next(iter(line.text.split()), "").upper()


def _found(line: SourceLine) -> str:
    if not line.text:
        return "a blank line inside a table"
    return f"{shown(line.text)} inside a table" if line.text[0] in COMMENTS else shown(line.text)


def _parse_start(
    source: SourceText, line: SourceLine, words: dict[str, tuple[str, int]], *, is_first: bool
) -> str:
    """Add the words of a start line to those of the table; return the axis if it is the first line."""
    head, *fields = _LOOSE_EQUALS.sub("=", line.text).split()
    if head.upper() != ":START":
        is_known = head.upper() == ":START2D"
        found = f"{head}, a table in two dimensions" if is_known else shown(head)
        raise source.error(found, "tables of one axis: :START", line=line.number)
    axis = ""
    if is_first:
        if not fields or not _AXIS.fullmatch(fields[0]):
            raise source.error(shown(line.text), f":START and {_ALLOWED}", line=line.number)
        axis = fields.pop(0)
    for field in fields:
        key, mark, value = field.partition("=")
        key = key.upper()
        if key in _TWO_DIMENSIONS:
            raise source.error(f"{key}, a table in two dimensions", "tables of one axis", line=line.number)
        is_known = (key in {*_PAIRED, _SERIAL} and bool(value)) or (key == "NEGCOR" and not mark)
        if not is_known:
            raise source.error(f"{shown(field)} after :START", _ALLOWED, line=line.number)
        if key in words:
            raise source.error(f"a second {key}", f"only one (line {words[key][1]})", line=line.number)
        words[key] = (value, line.number)
    if not is_first and not fields:
        raise source.error(":START and nothing else", _ALLOWED, line=line.number)
    return axis


def _pick(source: SourceText, tables: Sequence[_Table], context: FileContext) -> _Table:
    names = listed(table.axis for table in tables)
    if context.file_axis is not None:
        fitting = [table for table in tables if table.axis.upper() == context.file_axis.upper()]
        if not fitting:
            raise source.error(
                f"tables of {names}, but file_axis = {context.file_axis}", f"file_axis = one of {names}"
            )
    else:
        fitting = list(tables)
        if len({table.axis.upper() for table in tables}) > 1:
            raise source.error(f"tables of {names}", f"file_axis = one of {names}", line=tables[1].line)
    table = fitting[0]
    if len(fitting) > 1:
        raise source.error(
            f"a second table of axis {table.axis}: its values would be added to those of the first",
            "one table: add them up",
            line=fitting[1].line,
        )
    given = context.axis.upper() if context.axis is not None else None
    is_letter = re.fullmatch("[A-Za-z]", table.axis) is not None
    if given is not None and context.file_axis is None and is_letter and table.axis.upper() != given:
        raise source.error(
            f":START {table.axis}, read for axis {given}",
            f"a table of axis {given}, or file_axis = {table.axis!r} if it is the right one",
            line=table.line,
        )
    return table


def _scale(source: SourceText, table: _Table, units: Units) -> tuple[float, float]:
    """Return the distance of the values and the value units in an axis unit, negative for NEGCOR."""
    words = table.words
    missing = next((key for key in _PAIRED[1:4] if key not in words), None)
    if missing is not None:
        raise source.error(f"no {missing} for axis {table.axis}", f"{missing}= after :START", line=table.line)
    if "MASTER" in words and words["MASTER"][0].upper() != table.axis.upper():
        master, line = words["MASTER"]
        found = f"MASTER={master}: a correction of axis {table.axis} over the position of another axis"
        raise source.error(found, "a table over the axis's own position", line=line)
    text, line = words["SAMPLEDIST"]
    step = to_decimal(text)
    if step is None or not 0 < step < MAX_POSITION:
        raise source.error(f"SAMPLEDIST={text}", "a distance above 0", line=line)
    text, line = words["POSUNIT"]
    if text.upper() != "PRIMARY":
        raise source.error(f"POSUNIT={text}", "PRIMARY: positions in units of the axis", line=line)
    text, line = words["CORUNIT"]
    per_unit = _PER_UNIT.get(text.upper())
    if per_unit is None:
        raise source.error(f"CORUNIT={text}", ", ".join(_PER_UNIT), line=line)
    if text.upper() == "PRIMARY/3600" and units is not Units.DEGREE:
        raise source.error(f"CORUNIT={text} for an axis in {units.value}", "file_units = 'degree'", line=line)
    _check_homing(source, words)
    return step, -per_unit if "NEGCOR" in words else per_unit


def _check_homing(source: SourceText, words: dict[str, tuple[str, int]]) -> None:
    direction, line = words.get("HOMEDIRECTION", ("CW", 0))
    if direction.upper() not in ("CW", "CCW"):
        raise source.error(f"HOMEDIRECTION={direction}", "CW or CCW", line=line)
    offset, line = words.get("HOMEOFFSET", ("0", 0))
    if to_decimal(offset) is None:
        raise source.error(f"HOMEOFFSET={offset}", DECIMAL_ALLOWED, line=line)


def _rows(table: _Table, start: float, step: float, per_unit: float) -> tuple[SourceRow, ...]:
    return tuple(
        # + 0.0 turns -0.0 into 0.0
        SourceRow(
            start + index * step + 0.0,
            value / per_unit + 0.0,
            value / per_unit + 0.0,
            value,
            value,
            line,
            line,
        )
        for index, (value, line) in enumerate(table.values)
    )


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table, in thousandths of a unit or seconds of arc, with 6 decimals.

    Raises:
        TabFileError: no axis, points that are not evenly spaced.
    """
    axis = options.file_axis or options.axis
    if axis is None or not _AXIS.fullmatch(axis):
        raise unwritable(
            NAME, f"axis {axis!r}", "a name or number for its :START line: --to-axis or --to-file-axis"
        )
    step = even_step(table, NAME)
    means, lost_motion = one_curve(table)
    unit = "PRIMARY/3600" if table.units is Units.DEGREE else "PRIMARY/1000"
    values = [f"{mean * _PER_UNIT[unit] + 0.0:.{DECIMALS}f}" for mean in means]
    lines = [
        f":START {axis} MASTER={axis} SAMPLEDIST={step:.12g} POSUNIT=PRIMARY CORUNIT={unit}",
        *(" ".join(values[index : index + PER_LINE]) for index in range(0, len(values), PER_LINE)),
        ":END",
    ]
    hint = f"read it with file_units {table.units.value} and file_start {table.first:g}"
    losses = (
        f"values have {DECIMALS} decimals of {unit}",
        *lost_motion,
        f"units and start are not in the file: {hint}",
        "HOMEDIRECTION and HOMEOFFSET are not in the file: add those of the axis",
    )
    context = FileContext(
        axis=options.axis, file_units=table.units, file_start=table.first, file_axis=options.file_axis
    )
    text = "".join(f"{line}\n" for line in stamped(["values are added"], lines, len(values), ";"))
    return Written(text, losses, context)
