"""Carvera Community firmware, ``pitch_compensation.dat``: the stretch of the screw at each point. Read only.

Grammar, after the module that writes and reads it (``PitchCompensation``, pull request 221 of the firmware)::

    file  := point+
    point := axis position multiplier               one a line, in any order; X, Y or Z

Positions are in mm. A multiplier, from 0.5 to 1.5, is the stretch of a mm at this position. Between two
points it changes linearly. The commanded position is therefore the integral of the multipliers, 0 at 0, and
the correction is a parabola from point to point. Here it is a straight line between the same points; the
difference from the parabola is reported. One correction holds for both directions. Outside, the firmware
continues with the last multiplier.

The firmware skips a line that is not a point. Here such a line is an error, and so are two points at one
position.
"""

import re
from itertools import pairwise
from typing import Final, NamedTuple

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import check_stated, context_in_file_units
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import MAX_POSITION, FileContext, option_hint
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceText, listed, shown, to_decimal
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "carvera"
TITLE: Final = "Carvera Community pitch_compensation.dat: multipliers, one direction; read only"
SUFFIX: Final = ".dat"
USES: Final = frozenset({"file_start", "file_axis"})
MAX_PROBLEMS: Final = 20
LEAST, MOST = 0.5, 1.5
_UM_PER_MM: Final = 1000.0
_LINE: Final = re.compile(r"([XYZ])\s+(\S+)\s+(\S+)")
_OUTSIDE: Final = (
    "add a point at each end of the travel: beyond its points the firmware continues with the last "
    "multiplier, and no setting here does that"
)
_RULE: Final = "value is a multiplier: the integral of (value - 1) from 0 on is added, in both directions"


class _Point(NamedTuple):
    position: float
    multiplier: float
    line: int


def recognise(source: SourceText) -> bool:
    """Whether most lines are a letter and two numbers."""
    texts = [line.text for line in source.lines if line.text]
    points = [found for text in texts if (found := _LINE.fullmatch(text))]
    numbers = [
        found for found in points if to_decimal(found[2]) is not None and to_decimal(found[3]) is not None
    ]
    return len(points) > 0 and 2 * len(numbers) >= len(texts)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the points of one axis.

    Raises:
        TabFileError: a line that is not a point, a multiplier out of range, two points at one position, fewer
            than two points, several axes and none given, a range that does not fit the travel.
    """
    axes = _parse(source)
    axis = _choose(source, axes, context)
    points = sorted(axes[axis], key=lambda point: (point.position, point.line))
    for before, after in pairwise(points):
        if after.position == before.position:
            raise source.error(
                f"a second point of {axis} at {after.position:.9g} (the first is on line {before.line})",
                "only one of them",
                line=after.line,
            )
    if len(points) < 2:
        raise source.error(
            f"{len(points)} point of {axis}",
            "at least 2: put one multiplier for the whole axis into counts_per_unit",
            line=points[0].line,
        )
    context = context_in_file_units(source, context, Units.MM)
    rows = _rows(points)
    check_stated(source, rows, Units.MM, context)
    return Decoded(
        rows,
        Units.MM,
        context,
        "mm/mm",
        _RULE,
        _RULE,
        axis=axis,
        file_axis=axis,
        plausible=(LEAST, MOST),
        decisions=(
            f"axis {axis} of {listed(axes)}",
            _about_parabolas(points),
            _OUTSIDE,
        ),
        are_positions=True,
    )


def _parse(source: SourceText) -> dict[str, list[_Point]]:
    axes: dict[str, list[_Point]] = {}
    problems: list[FileProblem] = []
    for line in source.lines:
        if not line.text:
            continue
        found = _LINE.fullmatch(line.text)
        position, multiplier = (to_decimal(found[at]) if found else None for at in (2, 3))
        if found is None or position is None or multiplier is None or abs(position) >= MAX_POSITION:
            allowed = f"X, Y or Z, a position and a multiplier, each {DECIMAL_ALLOWED}"
            problems.append(source.problem(shown(line.text), allowed, line=line.number))
        elif not LEAST <= multiplier <= MOST:
            allowed = f"{LEAST:g} to {MOST:g}, the firmware's limits"
            problems.append(source.problem(f"multiplier {multiplier:g}", allowed, line=line.number))
        else:
            axes.setdefault(found[1], []).append(_Point(position, multiplier, line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return axes


def _choose(source: SourceText, axes: dict[str, list[_Point]], context: FileContext) -> str:
    given = context.file_axis.upper() if context.file_axis else None
    if given is not None and given not in axes:
        raise source.error(
            f"points of {listed(axes)}, but file_axis = {given!r}", f"file_axis = {listed(axes, ' or ')}"
        )
    if given is None and len(axes) > 1:
        raise source.error(
            f"points of {listed(axes)}",
            option_hint("file_axis", f"{next(iter(axes))!r}, for example"),
        )
    return given or next(iter(axes))


def _rows(points: list[_Point]) -> tuple[SourceRow, ...]:
    zero = _integral(points, 0.0)
    rows = []
    for x, multiplier, line in points:
        added = _integral(points, x) - zero + 0.0
        rows.append(SourceRow(x, added, added, multiplier, multiplier, line, line))
    return tuple(rows)


def _about_parabolas(points: list[_Point]) -> str:
    """Report the distance of the straight lines from the parabolas: the change times the length, / 8."""
    away, middle = max(
        (abs(b.multiplier - a.multiplier) * (b.position - a.position) / 8.0, (a.position + b.position) / 2.0)
        for a, b in pairwise(points)
    )
    return (
        "equal at each point. Between the points the firmware's correction is a parabola, here a straight "
        f"line: they differ by at most {away * _UM_PER_MM:.2g} µm, near {middle:.6g}"
    )


def _integral(points: list[_Point], x: float) -> float:
    """Return the integral of multiplier - 1 from the first point to x; outside, the end multiplier holds."""
    first, last = points[0], points[-1]
    if x <= first.position:
        return (x - first.position) * (first.multiplier - 1.0)
    total = 0.0
    for before, after in pairwise(points):
        end = min(x, after.position)
        share = (end - before.position) / (after.position - before.position)
        multiplier = before.multiplier + share * (after.multiplier - before.multiplier)
        total += (end - before.position) * ((before.multiplier + multiplier) / 2.0 - 1.0)
        if x <= after.position:
            return total
    return total + (x - last.position) * (last.multiplier - 1.0)


def write(table: CorrectionTable, _: WriteOptions) -> Written:
    """Refuse: linearly changing multipliers are not a table of corrections.

    Raises:
        TabFileError: always.
    """
    raise unwritable(
        NAME,
        f"a table of {len(table.positions)} points to write",
        "another format, such as csv: the firmware's multipliers are not corrections",
    )
