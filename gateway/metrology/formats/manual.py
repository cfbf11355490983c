"""The table written by hand at the machine, after Centroid TB058 ("Example").

Grammar::

    file    := comment* heading line*
    heading := a name with "DRO" in it, one with "measured" or "block", and perhaps one with "correction"
               or "count" (encoder counts, TB058 version 7.17); separated by a tab, a semicolon or a comma; a
               unit in any of them is that of the file
    line    := as many numbers as the heading has names

The DRO shows the control's position of the axis, the instrument measures the actual one. The order of the DRO
column is the direction of motion: rising is forward, falling backward. The direction may change once. The way
back begins at the position of the change, or near it: over a gauge block the DRO is different on the way
back. A correction column is compared with DRO - measured, and differences are reported; it is not used.
Counts are not used either, because their scale is unknown.
"""

from itertools import pairwise
from statistics import median
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.formats.cells import (
    Worksheet,
    decimal,
    heading_words,
    unit_of,
    units_of,
    words,
    worksheet_of,
)
from gateway.metrology.formats.context import ReadingsContext, settled_axis, settled_units
from gateway.metrology.formats.rows import TOGETHER, Row, to_survey
from gateway.metrology.readings import Survey
from gateway.tabfile.text import SourceText, shown

NAME: Final = "manual"
TITLE: Final = "table of DRO and measured position, one or two sweeps (Centroid TB058)"
HEADING: Final = "dro_inch,measured_inch"
_COLUMNS: Final = ("dro", "measured", "correction", "count")


def recognise(source: SourceText) -> bool:
    """Whether the heading has a DRO, and no directions."""
    cells = heading_words(source)
    names = {name for cell in cells for name in cell}
    return "dro" in names and "direction" not in names and ("run",) not in cells


def read(source: SourceText, context: ReadingsContext) -> Survey:
    """Read the file; the directions follow from the order of the DRO column.

    Raises:
        TabFileError: a heading or a cell outside the grammar, fewer than two lines, a DRO column that changes
            direction more than once.
    """
    worksheet = worksheet_of(source, HEADING)
    columns = _columns(source, worksheet)
    units = settled_units(source, context, units_of(source, worksheet), worksheet.heading.number)
    table = []
    for line, cells in worksheet.lines:
        dro, measured = (decimal(source, line, cells[columns[what]], what) for what in ("dro", "measured"))
        table.append((line, dro, measured))
    ways, remarks = _ways(source, table)
    rows = [Row(line, dro, way, 1, measured) for (line, dro, measured), way in zip(table, ways, strict=True)]
    if "count" in columns:
        remarks.append(
            f"{source.name}: {shown(worksheet.names[columns['count']])} is not used: its scale is unknown"
        )
    if "correction" in columns:
        remarks += _differing(source, worksheet, rows, units)
    axis = settled_axis(source, context, worksheet.facts.get("axis"))
    return to_survey(source, rows, units, axis=axis, facts=worksheet.facts, remarks=remarks)


def _columns(source: SourceText, worksheet: Worksheet) -> dict[str, int]:
    columns: dict[str, int] = {}
    for index, name in enumerate(worksheet.names):
        parts = ["measured" if part == "block" else part for part in words(name)]
        found = [what for what in _COLUMNS if what in parts]
        if len(found) != 1 or found[0] in columns:
            raise source.error(f"{shown(name)} in the heading", HEADING, line=worksheet.heading.number)
        unit = unit_of(name)
        if unit is not None and unit[1] != 1.0 and found[0] != "correction":
            raise source.error(
                f"{shown(name)} in the heading",
                f"positions in {unit[0].value}",
                line=worksheet.heading.number,
            )
        columns[found[0]] = index
    if not {"dro", "measured"} <= set(columns):
        raise source.error(
            "no DRO or no measured position in the heading", HEADING, line=worksheet.heading.number
        )
    return columns


def _ways(source: SourceText, table: list[tuple[int, float, float]]) -> tuple[list[Direction], list[str]]:
    """Return the direction of each line, and the assumptions."""
    if len(table) < 2:
        raise source.error(
            f"{len(table)} line(s) of readings", "at least two: their order gives the direction"
        )
    near = TOGETHER * median(abs(after - before) for (_, before, _), (_, after, _) in pairwise(table))
    first = _sense(table[0][1], table[1][1], near)
    if not first:
        raise source.error(
            f"DRO {table[1][1]:.9g} twice at the start", "the order of the stops", line=table[1][0]
        )
    ways, reversed_at = [first], None
    for (line_before, before, _), (line, dro, _) in pairwise(table):
        sense = _sense(before, dro, near)
        if sense is not ways[-1]:
            # The same position again, or nearly, is the first stop of the way back, after an overrun.
            if reversed_at is not None:
                raise source.error(
                    f"DRO {dro:.9g} after {before:.9g}: the axis reverses for the second time (first in "
                    f"line {reversed_at})",
                    "one sweep, or one forth and one back; write more runs as iso-csv: target, direction, "
                    "run, measured",
                    line=line,
                )
            reversed_at = line if sense is None else line_before
            sense = Direction.BACKWARD if first is Direction.FORWARD else Direction.FORWARD
        ways.append(sense)
    start = f"{source.name}:{table[0][0]}: {table[0][1]:.9g} is the first stop"
    remarks = [
        f"{start}: assumed to be approached {first.name.lower()}; next time approach it from further outside"
    ]
    if reversed_at is not None:
        at = next(dro for line, dro, _ in table if line == reversed_at)
        back = ways[-1].name.lower()
        remarks.append(f"{source.name}:{reversed_at}: the axis reversed at {at:.9g}, {back} from there")
        if sum(dro == at for _, dro, _ in table) > 1:
            remarks.append(
                f"{source.name}:{reversed_at}: {at:.9g} is there twice, the second time as approached "
                f"{back}: delete one line, unless the axis went further and came back"
            )
    return ways, remarks


def _sense(before: float, after: float, near: float) -> Direction | None:
    if abs(after - before) <= near:
        return None
    return Direction.FORWARD if after > before else Direction.BACKWARD


def _differing(source: SourceText, worksheet: Worksheet, rows: list[Row], units: Units) -> list[str]:
    """Name corrections beside the readings that are not DRO - measured."""
    index = next(i for i, name in enumerate(worksheet.names) if "correction" in words(name))
    scale = (unit_of(worksheet.names[index]) or (units, 1.0))[1]
    remarks = []
    for row, (line, cells) in zip(rows, worksheet.lines, strict=True):
        written = decimal(source, line, cells[index], "correction")
        right = (row.target - row.measured) / scale
        decimals = len(cells[index].partition(".")[2])
        if abs(written - right) > 0.51 * 10**-decimals:
            remarks.append(
                f"{source.name}:{line}: check this line: correction {cells[index]} at {row.target:.9g}, "
                f"but DRO - measured is {round(right, 6) + 0.0:.6g}; the readings are used"
            )
    return remarks
