"""LinuxCNC compensation files, types 0 and 1 (``COMP_FILE`` and ``COMP_FILE_TYPE`` of a joint).

Grammar, after LinuxCNC's own loader and its INI documentation: one point a line, three decimal numbers with
blanks between them, nominal positions strictly ascending, at most 256 points::

    nominal forward reverse

Type 0: ``forward`` and ``reverse`` are the actual positions of the nut when the machine showed ``nominal``.
LinuxCNC adds nominal - forward while moving forward, nominal - reverse while moving back. This reader does
the same (first order; the inverse of the curve would differ by slope x correction). Type 1: both are trims
that LinuxCNC adds unchanged. The documentation prints examples of both types as if they meant the same; they
do not. A file does not contain its type, so the type must be given. A file of one type read as the other has
slopes near 1 and is refused. The file has no units either.

LinuxCNC stops reading, without a message, at the first line that is not such a triplet (a comment, a blank
line, a comma). It drops everything after 256 points, and holds the end values outside. Here comments (``#``
or ``;``, alone or behind a point) and blank lines are skipped, anything else is an error, and every point
counts. Remark R7 names the line at which LinuxCNC itself would have stopped.
"""

import itertools
import re
from collections.abc import Sequence
from functools import partial
from statistics import median
from typing import Final, NamedTuple

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import check_stated, context_in_file_units, required_units
from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceLine, SourceText, shown, to_decimal
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME_0: Final = "linuxcnc-0"
NAME_1: Final = "linuxcnc-1"
TITLE_0: Final = "LinuxCNC COMP_FILE type 0: nominal and both actual positions"
TITLE_1: Final = "LinuxCNC COMP_FILE type 1: nominal and both trims, which are added"
SUFFIX: Final = ".dat"
USES: Final = frozenset({"file_start"})
MAX_POINTS: Final = 256
"""Limit of LinuxCNC; it drops further points without a message."""
MIN_STEP: Final = 1e-6
DECIMALS: Final = 12
MAX_PROBLEMS: Final = 20
_PLAUSIBLE_TRIM: Final = {Units.INCH: 0.1, Units.MM: 0.5, Units.DEGREE: 0.5}
_LIKE_POSITIONS: Final = 0.5
"""Columns that grow by more than this per unit of position are positions; trims hardly grow."""
_COMMENT: Final = re.compile("[#;].*")
_WORD: Final = re.compile("[A-Za-z]{2}|[:%$(]")
_RULES: Final = {
    NAME_0: "value is the actual position: nominal - value is added; column {}",
    NAME_1: "value is a trim, added unchanged; column {}",
}


class _Row(NamedTuple):
    nominal: float
    forward: float
    reverse: float
    line: int


def recognise(source: SourceText) -> bool:
    """Whether the first point is a triplet or, if it is damaged, nearly all others are.

    It cannot tell type 0 from type 1.
    """
    points = (text for line in source.lines if (text := _content(line)))
    if (first := next(points, None)) is None:
        return False
    if _is_triplet(first):
        return True
    if _WORD.search(first):
        return False
    others = [_is_triplet(point) for point in points]
    return len(others) >= 2 and sum(others) >= len(others) - 1


def read_type_0(source: SourceText, context: FileContext) -> Decoded:
    """Read actual positions; see :func:`_read`."""
    return _read(source, context, NAME_0)


def read_type_1(source: SourceText, context: FileContext) -> Decoded:
    """Read trims; see :func:`_read`."""
    return _read(source, context, NAME_1)


def _read(source: SourceText, context: FileContext, name: str) -> Decoded:
    """Read every point.

    Raises:
        TabFileError: no units given, a line that is not a point, positions that do not ascend, values that
            clearly belong to the other type, a range that does not fit the travel.
    """
    units = required_units(source, context, "a LinuxCNC compensation file")
    file_rows = _parse(source)
    context = context_in_file_units(source, context, units)
    _check_order(source, file_rows)
    _check_type(source, file_rows, name)
    is_absolute = name == NAME_0
    rows = tuple(_to_source_row(row, is_absolute=is_absolute) for row in file_rows)
    check_stated(source, rows, units, context)
    return Decoded(
        rows,
        units,
        context,
        units.value,
        _RULES[name].format("2, forward"),
        _RULES[name].format("3, reverse"),
        plausible=(0.0, _PLAUSIBLE_TRIM[units]),
        decisions=(f"type {name[-1]}: from format", f"units {units.value}: from file_units"),
        remarks=_where_linuxcnc_stops(file_rows),
        behaves_as=('outside = "hold"',),
        are_positions=is_absolute,
    )


def _content(line: SourceLine) -> str:
    return _COMMENT.sub("", line.text).strip(" \t")


def _is_triplet(text: str) -> bool:
    fields = text.split()
    return len(fields) == 3 and all(to_decimal(field) is not None for field in fields)


def _parse(source: SourceText) -> list[_Row]:
    rows: list[_Row] = []
    problems: list[FileProblem] = []
    for line in source.lines:
        fields = _content(line).split()
        numbers = [number for field in fields if (number := to_decimal(field)) is not None]
        if len(fields) == len(numbers) == 3:
            rows.append(_Row(numbers[0], numbers[1], numbers[2], line.number))
        elif fields:
            allowed = f"nominal, forward, reverse with blanks between them, each {DECIMAL_ALLOWED}"
            problems.append(source.problem(shown(line.text), allowed, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if len(rows) < 2:
        raise source.error(f"{len(rows)} point(s)", "at least 2", line=source.last_line)
    return rows


def _check_order(source: SourceText, rows: Sequence[_Row]) -> None:
    problems = [
        source.problem(
            f"nominal position {after.nominal:g} after {before.nominal:g}",
            "nominal positions that ascend (LinuxCNC would drop this point)",
            line=after.line,
            code="L11",
        )
        for before, after in itertools.pairwise(rows)
        if not after.nominal > before.nominal
    ]
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


def _check_type(source: SourceText, rows: Sequence[_Row], name: str) -> None:
    growth = median(
        (after.forward - before.forward) / (after.nominal - before.nominal)
        for before, after in itertools.pairwise(rows)
    )
    if name == NAME_0 and growth < _LIKE_POSITIONS:
        raise source.error(
            f"columns that do not follow the nominal position (they grow by {growth:.3g} per unit), so "
            "they are not positions",
            f"actual positions, or format = {NAME_1!r} if they are trims",
            line=rows[0].line,
        )
    if name == NAME_1 and growth > _LIKE_POSITIONS:
        raise source.error(
            f"columns that follow the nominal position (they grow by {growth:.3g} per unit), so they are "
            "not trims",
            f"trims, or format = {NAME_0!r} if they are positions",
            line=rows[0].line,
        )


def _to_source_row(row: _Row, *, is_absolute: bool) -> SourceRow:
    nominal, forward, reverse, line = row
    corrections = (nominal - forward, nominal - reverse) if is_absolute else (forward, reverse)
    return SourceRow(nominal, *corrections, forward, reverse, line, line)


def _where_linuxcnc_stops(rows: Sequence[_Row]) -> tuple[Lint, ...]:
    """Report the line from which LinuxCNC itself would use nothing, if points follow it."""
    points = {row.line for row in rows}
    last_used = rows[min(len(rows), MAX_POINTS) - 1].line
    # Blank lines above the first line with text are not in the source, but they stop LinuxCNC, too.
    stop = next((number for number in range(1, last_used) if number not in points), None)
    why = "is not a point"
    if stop is None and len(rows) > MAX_POINTS:
        stop, why = rows[MAX_POINTS].line, f"is beyond its {MAX_POINTS} points"
    if stop is None:
        return ()
    before = sum(number < stop for number in points)
    message = (
        f"line {stop} {why}, so LinuxCNC reads only {before} of the {len(rows)} points, without a message. "
        "Here all points count: if the machine ran well with LinuxCNC, delete the others"
    )
    return (Lint("R7", LintSeverity.WARNING, message, stop),)


def _write(name: str, table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table on its own points; such a file has no field for any of the ``options``.

    Raises:
        TabFileError: more than 256 points, or points closer than 0.000001 units.
    """
    del options
    if len(table.positions) > MAX_POINTS:
        raise unwritable(name, f"{len(table.positions)} points", f"at most {MAX_POINTS}: LinuxCNC drops more")
    step = min(after - before for before, after in itertools.pairwise(table.positions))
    if step < MIN_STEP:
        raise unwritable(name, f"points {step:g} apart", f"at least {MIN_STEP:g}: --resample STEP")
    lines = []
    for x, forward, backward in zip(table.positions, table.forward, table.backward, strict=True):
        nominal = round(x, DECIMALS)
        values = (nominal - forward, nominal - backward) if name == NAME_0 else (forward, backward)
        lines.append(" ".join(_number(value) for value in (nominal, *values)))
    losses = (
        f"numbers are rounded to {DECIMALS} decimals; LinuxCNC keeps corrections as 32-bit floats",
        f"units ({table.units.value}) and type ({name[-1]}: COMP_FILE_TYPE) are not in the file",
    )
    context = FileContext(format=name, file_units=table.units)
    return Written("".join(f"{line}\n" for line in lines), losses, context)


def _number(value: float) -> str:
    return f"{round(value, DECIMALS) + 0.0:.{DECIMALS}f}".rstrip("0").rstrip(".")


write_type_0: Final = partial(_write, NAME_0)
write_type_1: Final = partial(_write, NAME_1)
