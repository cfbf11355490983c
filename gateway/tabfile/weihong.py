"""Weihong screw error files, ``axeserr.dat`` (Ncstudio, NK, EasyRoute controls): both directions, any grid.

Grammar, from the manufacturer's manuals (screw error compensation file) and their examples; ``;`` begins a
comment on a separate line::

    file    := [";"] "unit" "=" "mm" table+         the examples have the semicolon, the text has none
    table   := "[" axis "]" point+                  a letter, in any case
    point   := nominal "," forward "," backward     nominal machine positions, ascending

``forward`` is the error of motion towards greater positions. Such a control accepts no unit but mm.

The manual defines an error as nominal - actual. It shows a backlash of 0.03 mm as a backward error of +0.03,
which is actual - nominal where the forward errors are 0: moving back, the nut lags at greater positions. One
of both is wrong, so the sense must be given. The manual does not describe the behaviour beyond the points.
"""

import re
from itertools import pairwise
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import RULES, check_stated, context_in_file_units, required_sense
from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import FileContext, option_hint
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceLine, SourceText, listed, shown, to_decimal
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "weihong"
TITLE: Final = "Weihong axeserr.dat (Ncstudio, NK), both directions"
SUFFIX: Final = ".dat"
USES: Final = frozenset({"file_start", "file_axis", "error_sense"})
DECIMALS: Final = 6
MAX_PROBLEMS: Final = 20
_WHAT: Final = "a Weihong screw error file (its manual's formula and its example of a backlash disagree)"
_PLAUSIBLE_MM: Final = 0.5
_UNIT: Final = re.compile(r"(?i);?\s*unit\s*=\s*(\S+)")
_AXIS: Final = re.compile(r"\[\s*([A-Za-z])\s*\]")

_Points = list[tuple[float, float, float, int]]
"""Position, forward and backward error, line."""


def recognise(source: SourceText) -> bool:
    """Whether a line has the unit and one names an axis, or, if one of them is damaged, two name axes."""
    units = sum(_UNIT.fullmatch(line.text) is not None for line in source.lines)
    axes = sum(_AXIS.fullmatch(line.text) is not None for line in source.lines)
    return axes > 0 and units + axes > 1


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table of one axis.

    Raises:
        TabFileError: a line outside the grammar, another unit, positions that do not ascend, no sense given,
            several axes and none given, a range that does not fit the travel.
    """
    tables, gaps = _parse(source)
    axis = _choose(source, tables, context)
    context = context_in_file_units(source, context, Units.MM)
    sense = required_sense(source, context, _WHAT)
    rows = tuple(
        SourceRow(x, sense.to_correction * f + 0.0, sense.to_correction * b + 0.0, f, b, line, line)
        for x, f, b, line in tables[axis]
    )
    check_stated(source, rows, Units.MM, context)
    first, last = tables[axis][0][3], tables[axis][-1][3]
    return Decoded(
        rows,
        Units.MM,
        context,
        "mm",
        f"{RULES[sense]}; column 2, forward",
        f"{RULES[sense]}; column 3, backward",
        axis=axis,
        file_axis=axis,
        plausible=(0.0, _PLAUSIBLE_MM),
        remarks=tuple(_gap(line) for line in gaps if first < line.number < last),
        decisions=(f"axis {axis} of {listed(tables)}", f"sense {sense.value}: as given"),
    )


def _gap(line: SourceLine) -> Lint:
    return Lint(
        "R10",
        LintSeverity.WARNING,
        "check whether a point was lost here: this line between two points has none, and the file does not "
        "state their number",
        line.number,
    )


def _parse(source: SourceText) -> tuple[dict[str, _Points], list[SourceLine]]:
    """Return the points of each axis, and the lines without a point between two points."""
    tables: dict[str, _Points] = {}
    points: _Points | None = None
    problems: list[FileProblem] = []
    has_unit = False
    other: SourceLine | None = None
    gaps: list[SourceLine] = []
    for line in source.lines:
        unit, axis = _UNIT.fullmatch(line.text), _AXIS.fullmatch(line.text)
        if unit is not None:
            if unit[1].lower() != "mm":
                raise source.error(f"unit {shown(unit[1])}", "mm, the only one", line=line.number)
            has_unit = True
        elif not line.text or line.text.startswith(";"):
            other = line
        elif axis is not None:
            name = axis[1].upper()
            if name in tables:
                raise source.error(f"a second table of axis {name}", "one of each axis", line=line.number)
            points = tables[name] = []
        elif points is None:
            problems.append(source.problem(shown(line.text), "unit = mm, then [X]", line=line.number))
        else:
            if points and other is not None and other.number > points[-1][3]:
                gaps.append(other)
            problems += _add(source, points, line)
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if not has_unit:
        raise source.error("no unit", "unit = mm, above the tables", line=source.lines[0].number)
    return tables, gaps


def _add(source: SourceText, points: _Points, line: SourceLine) -> list[FileProblem]:
    """Add a point; return its errors."""
    numbers = [to_decimal(cell.strip()) for cell in line.text.split(",")]
    if len(numbers) != 3 or None in numbers:
        allowed = f"nominal, forward, backward with commas between them, each {DECIMAL_ALLOWED}"
        return [source.problem(shown(line.text), allowed, line=line.number)]
    x, forward, backward = (number or 0.0 for number in numbers)
    if points and not x > points[-1][0]:
        found = f"position {x:.9g} after {points[-1][0]:.9g}"
        return [source.problem(found, "ascending positions", line=line.number, code="L11")]
    points.append((x, forward, backward, line.number))
    return []


def _choose(source: SourceText, tables: dict[str, _Points], context: FileContext) -> str:
    given = context.file_axis.upper() if context.file_axis else None
    if given is not None and given not in tables:
        raise source.error(
            f"tables of {listed(tables)}, but file_axis = {given!r}", f"file_axis = {listed(tables, ' or ')}"
        )
    if given is None and len(tables) > 1:
        raise source.error(
            f"tables of {listed(tables)}",
            option_hint("file_axis", f"{next(iter(tables))!r}, for example"),
        )
    name = given or next(iter(tables))
    if len(tables[name]) < 2:
        raise source.error(
            f"{len(tables[name])} point(s) of axis {name}", "at least 2", line=source.last_line
        )
    return name


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table of one axis, on its own points.

    Raises:
        TabFileError: no axis, no sense given, an axis in degrees, or points that are equal in its digits.
    """
    axis = (options.file_axis or options.axis or "").upper()
    if re.fullmatch("[A-Z]", axis) is None:
        raise unwritable(NAME, f"axis {axis!r}", "a letter: --to-axis or --to-file-axis")
    if options.sense is None:
        raise unwritable(
            NAME,
            "the sense of its errors is missing: the manual's formula and its example disagree",
            "--to-sense actual_minus_command or command_minus_actual",
        )
    if table.units is Units.DEGREE:
        raise unwritable(NAME, "a table in degrees", "a table of a linear axis")
    table = table.in_units(Units.MM)
    if min(after - before for before, after in pairwise(table.positions)) < 2 * 10.0**-DECIMALS:
        raise unwritable(NAME, f"points closer than {2 * 10.0**-DECIMALS:g} mm", "--resample STEP")
    factor = options.sense.to_correction
    lines = ["unit = mm", f"[{axis}]"]
    lines += [
        ", ".join(_number(number) for number in (x, factor * f, factor * b))
        for x, f, b in zip(table.positions, table.forward, table.backward, strict=True)
    ]
    losses = (
        f"numbers are rounded to {DECIMALS} decimals; the manual shows 3",
        "put the tables of the other axes into the same file: the control reads only one file",
    )
    context = FileContext(file_axis=axis, error_sense=options.sense)
    return Written("".join(f"{line}\n" for line in lines), losses, context)


def _number(value: float) -> str:
    return f"{round(value, DECIMALS) + 0.0:.{DECIMALS}f}"
