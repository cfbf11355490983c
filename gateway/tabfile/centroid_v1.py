"""Centroid .tab version 1 (CNC7 6.00 to 7.17): one direction, encoder counts of the old control.

Grammar, after Centroid TB058 ("Version 7.17 File contents") and the description by CNC Services Northwest::

    file   := header value{N}          one to a line, no blank lines
    header := N TOTAL                  two whole numbers
    value  := whole number

TOTAL is the measured travel and each value the amount to add, both in encoder counts of the old control:
revolutions per unit x counts per revolution x (DRO - measured), negated where that control's Dir Rev is Y.
One signed scale k (counts per machine unit, negative for Dir Rev) gives travel and values the right sign, so
Dir Rev is not needed again. One value holds in both directions: the file does not contain lost motion.

The two sources place the points differently. "listed": N points, the first is home (CNC Services).
"implicit": N intervals, home is not listed and has no correction (TB058). A first value other than 0
indicates the second layout, because home is the zero of the measurement. Otherwise a layout is proven if its
interval is a round length and the other's is not. The file is refused if neither is proven, or if the first
value and the round length indicate different layouts.
"""

from dataclasses import replace
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import MM_PER_INCH, Units
from gateway.tabfile.checks import Interpretation, check_home, check_range, check_start, describe_both
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import FileContext, V1Layout, choices
from gateway.tabfile.text import INTEGER_ALLOWED, SourceLine, SourceText, shown, to_integer
from gateway.tabfile.writing import (
    LARGER_SCALE,
    NEEDS_SCALE,
    WriteOptions,
    Written,
    even_step,
    home_side,
    one_curve,
    unwritable,
)

NAME: Final = "centroid-1"
TITLE: Final = "Centroid version 1 (CNC7 6.00 to 7.17), one direction, encoder counts"
USES: Final = frozenset({"file_counts_per_unit", "v1_layout", "file_start", "file_home"})
ROUND_MM: Final = 1.0
ROUND_INCH: Final = 0.05
ROUND_DEGREE: Final = 1.0
"""People choose intervals that are multiples of these; no other interval counts as round."""
ROUND_TOLERANCE: Final = 2e-6
"""An error of TOTAL, one count or this fraction of it, spread over all intervals: still round."""
MAX_PROBLEMS: Final = 20


class _Counts(Struct, frozen=True):
    """The file as written."""

    total: int
    values: tuple[int, ...]
    lines: tuple[int, ...]


def recognise(source: SourceText) -> bool:
    """Whether the first line is exactly two whole numbers."""
    fields = source.lines[0].text.split()
    return len(fields) == 2 and all(to_integer(field) is not None for field in fields)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the file with the scale, units and layout that the context tells.

    Raises:
        TabFileError: a line outside the grammar, a wrong number of values, no scale or no units given, a
            layout without proof, a range that does not fit the travel.
    """
    counts = _parse(source)
    scale, units = _scale(source, context)
    layout, decision = _decide_layout(source, counts, scale, units, context)
    rows = _rows(counts, scale, layout)
    reading = Interpretation(f"file_counts_per_unit {scale:g}", rows, units)
    mirror = Interpretation(f"file_counts_per_unit {-scale:g}", _rows(counts, -scale, layout), units)
    check_range(
        source, reading, mirror, context, "the right file_counts_per_unit (negative for Dir Rev) and travel"
    )
    check_home(source, rows, context)
    check_start(source, rows, context)
    rule = "value / file_counts_per_unit is added; one value for both directions"
    return Decoded(rows, units, context, "counts", rule, rule, decisions=(decision,))


def _parse(source: SourceText) -> _Counts:
    header, *body = source.lines
    size, total = (to_integer(field) or 0 for field in header.text.split())
    if size < 1 or total == 0:
        raise source.error(
            f"header {shown(header.text)}",
            "the number of values (1 or more), then the total travel (not 0)",
            line=header.number,
        )
    values, problems = [], []
    for line in body:
        value = to_integer(line.text)
        if value is None:
            problems.append(_bad_value(source, line))
        else:
            values.append(value)
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if len(body) != size:
        at = body[size].number if len(body) > size else source.last_line
        raise source.error(
            f"{len(body)} values", f"{size}, as the header on line {header.number} says", line=at
        )
    return _Counts(total, tuple(values), tuple(line.number for line in body))


def _bad_value(source: SourceText, line: SourceLine) -> FileProblem:
    found = shown(line.text) if line.text else "a blank line between the values"
    return source.problem(found, INTEGER_ALLOWED, line=line.number)


def _scale(source: SourceText, context: FileContext) -> tuple[float, Units]:
    if context.units is None:
        raise source.error("a version 1 file, without units", "units of the axis: mm, inch or degree")
    if context.file_counts_per_unit is None:
        raise source.error(
            "a version 1 file holds encoder counts, and file_counts_per_unit is missing",
            f"file_counts_per_unit = counts of the OLD control per {context.units.value} (counts per "
            "revolution x revolutions per unit), negative if its Dir Rev was Y",
        )
    return context.file_counts_per_unit, context.units


def _rows(counts: _Counts, scale: float, layout: V1Layout) -> tuple[SourceRow, ...]:
    """Return the points in ascending order; lengths are counts / scale."""
    length = counts.total / scale
    listed = layout is V1Layout.LISTED
    intervals = len(counts.values) - 1 if listed else len(counts.values)
    home = [] if listed else [SourceRow(0.0, 0.0, 0.0, 0.0, 0.0, None, None)]
    rows = home + [
        # + 0.0 turns the -0.0 of a negative scale into 0.0
        SourceRow(
            index * length / intervals + 0.0,
            value / scale + 0.0,
            value / scale + 0.0,
            value,
            value,
            line,
            line,
        )
        for index, (value, line) in enumerate(zip(counts.values, counts.lines, strict=True), start=len(home))
    ]
    return tuple(rows if length > 0 else reversed(rows))


def _decide_layout(
    source: SourceText, counts: _Counts, scale: float, units: Units, context: FileContext
) -> tuple[V1Layout, str]:
    size = len(counts.values)
    if context.v1_layout is not None:
        if context.v1_layout is V1Layout.LISTED and size == 1:
            raise source.error(
                "one value, with v1_layout = listed", "at least 2 values, or v1_layout implicit"
            )
        return context.v1_layout, f"layout {context.v1_layout.value}: from v1_layout"
    if size == 1:
        return V1Layout.IMPLICIT, "layout implicit: one value needs home as the other end of its interval"
    length = abs(counts.total / scale)
    tolerance = max(1 / abs(scale), ROUND_TOLERANCE * length)
    listed_round = _is_round(length, size - 1, tolerance, units)
    implicit_round = _is_round(length, size, tolerance, units)
    listed_step, implicit_step = (f"{length / n:.6g} {units.value}" for n in (size - 1, size))
    readings = [Interpretation(f"v1_layout {w.value}", _rows(counts, scale, w), units) for w in V1Layout]
    if counts.values[0] != 0:
        if listed_round and not implicit_round:
            raise source.error(
                f"a first value of {counts.values[0]}, so it is not home; but only with home in the list "
                f"is the interval a round number ({listed_step}; without home {implicit_step})",
                f"{choices('v1_layout')}, or 0 as the value of home",
                line=counts.lines[0],
                readings=describe_both(*readings),
            )
        return V1Layout.IMPLICIT, (
            f"layout implicit: the first value is {counts.values[0]}, and home has no correction"
        )
    if listed_round and not implicit_round:
        return (
            V1Layout.LISTED,
            f"layout listed: an interval of {listed_step} is a round number, {implicit_step} is not",
        )
    if implicit_round and not listed_round:
        return (
            V1Layout.IMPLICIT,
            f"layout implicit: an interval of {implicit_step} is a round number, {listed_step} is not",
        )
    raise source.error(
        f"the layout is not clear: {'both' if listed_round else 'neither'} of the intervals {listed_step} "
        f"(first value is home) and {implicit_step} (home not listed) are round numbers",
        choices("v1_layout"),
        readings=describe_both(*readings),
    )


def _is_round(length: float, intervals: int, tolerance: float, units: Units) -> bool:
    interval = length / intervals
    if units is Units.DEGREE:
        steps = [ROUND_DEGREE]
    elif units is Units.MM:
        steps = [ROUND_MM, ROUND_INCH * MM_PER_INCH]
    else:
        steps = [ROUND_MM / MM_PER_INCH, ROUND_INCH]
    return any(
        round(interval / step) >= 1 and abs(interval - round(interval / step) * step) <= tolerance / intervals
        for step in steps
    )


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table; home must be at one end of it, and the points must be evenly spaced.

    A table with two directions is averaged; values are rounded to whole counts. The layout is that of TB058
    ("implicit") unless another is given.

    Raises:
        TabFileError: no scale given, 0 is not an end of the table, a correction at home (a reader would take
            the file for the other layout).
    """
    scale = options.file_counts_per_unit
    if scale is None:
        raise unwritable(NAME, "the old control's counts per unit are missing", NEEDS_SCALE)
    even_step(table, NAME)
    home_first = home_side(table, NAME) > 0
    total = round((table.last if home_first else table.first) * scale)
    means, lost_motion = one_curve(table)
    values = [round(mean * scale) for mean in (means if home_first else reversed(means))]
    layout = options.v1_layout or V1Layout.IMPLICIT
    if values[0] != 0:
        raise unwritable(
            NAME,
            f"a correction of {values[0]} counts at home",
            "0 at home: subtract it from the whole table first",
        )
    if layout is V1Layout.IMPLICIT:
        del values[0]
    if total == 0:
        raise unwritable(NAME, f"a travel of less than one count at {scale:g} counts per unit", LARGER_SCALE)
    losses = [f"values are whole counts: a resolution of {1 / abs(scale):.6g} {table.units.value}"]
    losses.extend(lost_motion)
    losses.append(f"units and layout are not in the file: read it with v1_layout {layout.value}")
    text = "".join(f"{line}\r\n" for line in (f"{len(values)} {total}", *values))
    context = FileContext(units=table.units, file_counts_per_unit=scale, v1_layout=layout)
    return Written(text, tuple(losses), replace(context, axis=options.axis))
