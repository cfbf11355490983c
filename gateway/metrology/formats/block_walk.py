"""A gauge block walked along an axis: a line for each reading of the dial.

Grammar (ours)::

    file    := comment* heading line*
    heading := names, separated by a tab, a semicolon or a comma, in any order
    names   := "target_" UNIT or "dro_" UNIT, "direction", "placement", "block_" UNIT,
               "dial_" UNIT or "dial_um"
    UNIT    := "mm" | "inch"
    line    := as many cells as the heading has names

``placement`` counts how often dial and stop were placed, from 1: each has its own zero. ``block`` is the
nominal length of the block between them, 0 without one. ``dial`` counts up while the gap between dial and
stop opens. ``direction`` is the direction of approach. Optional columns are ``temperature_c``, that of the
screw, and ``time`` and ``note``, which are not read.

Comments say what is known about the block (:mod:`gateway.metrology.standard`), and::

    # gap: closes       the gap between dial and stop closes while the axis moves forward (default: opens)
    # dial: reversed    the dial counts down while the gap opens
"""

from collections import defaultdict
from statistics import median
from typing import Final

from gateway.metrology.errors import ReadingsError
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
from gateway.metrology.formats.iso_csv import direction_of, temperature_of
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.standard import standard_of
from gateway.metrology.walk import CLOSES, GAP, MOST, MOST_DIFFERENCE_MM, OPENS
from gateway.tabfile.text import SourceText, shown, to_integer

NAME: Final = "block-walk"
TITLE: Final = "CSV of a gauge block walked along the axis: target, direction, placement, block and dial"
HEADING: Final = "target_mm,direction,placement,block_mm,dial_mm (or dial_um)"
DIAL: Final = "dial"
_NEEDED: Final = ("target", "direction", "placement", "block", DIAL)
_NAMES: Final = (*_NEEDED, "temperature", "time", "note")


def recognise(source: SourceText) -> bool:
    """Whether the heading has placements."""
    return ("placement",) in heading_words(source)


def read(source: SourceText, context: ReadingsContext) -> Survey:
    """Read the file.

    Raises:
        TabFileError: a heading, a comment or a cell outside the grammar, a reading twice, or readings of a
            placement that do not belong together.
    """
    worksheet = worksheet_of(source, HEADING)
    columns = _columns(source, worksheet)
    units = settled_units(source, context, units_of(source, worksheet), worksheet.heading.number)
    try:
        standard = standard_of(worksheet.facts)
    except ReadingsError as error:
        raise source.error(
            str(error), "a line # block_grade: 1 or 0, 2, K, unknown: it is on the block's box"
        ) from None
    opens = _choice(source, worksheet, GAP, OPENS, CLOSES)
    counts_up = _choice(source, worksheet, DIAL, "counts up", "reversed")
    scale = (unit_of(worksheet.names[columns[DIAL]]) or (units, 1.0))[1]
    lines: dict[Reading, int] = {}
    first: dict[tuple[object, ...], int] = {}
    for line, cells in worksheet.lines:
        numbers = {
            what: decimal(source, line, cells[columns[what]], what) for what in ("target", "block", DIAL)
        }
        if numbers["block"] < 0.0:
            raise source.error(
                f"block {numbers['block']:.9g}", "the length of the block, 0 without one", line=line
            )
        placement = _placement(source, line, cells[columns["placement"]])
        direction = direction_of(source, line, cells[columns["direction"]])
        warm = None
        if "temperature" in columns:
            warm = temperature_of(source, line, cells[columns["temperature"]])
        block = opens * numbers["block"]
        measured = block + opens * counts_up * numbers[DIAL] * scale
        key = (placement, direction, numbers["target"], block)
        if key in first:
            raise source.error(
                f"a second reading of placement {placement} at {numbers['target']:.9g}, "
                f"{direction.name.lower()}; the first is in line {first[key]}",
                "one reading for a position and direction of a placement: delete one of them",
                line=line,
            )
        first[key] = line
        lines[Reading(numbers["target"], direction, measured, placement, warm, block)] = line
    if not lines:
        raise source.error("no reading", f"a line for each reading: {HEADING}")
    _check_together(source, lines, units.from_mm(MOST_DIFFERENCE_MM))
    axis = settled_axis(source, context, worksheet.facts.get("axis"))
    return Survey(tuple(lines), units, axis, source.name, worksheet.facts, standard=standard)


def _columns(source: SourceText, worksheet: Worksheet) -> dict[str, int]:
    """Return the column of each value."""
    columns: dict[str, int] = {}
    line = worksheet.heading.number
    for index, name in enumerate(worksheet.names):
        parts = words(name)
        what = parts[0] if parts else ""
        what = "target" if what == "dro" else what
        if what not in _NAMES or what in columns:
            twice = "a second " if what in columns else ""
            raise source.error(f"{twice}{shown(name)} in the heading", HEADING, line=line)
        unit = unit_of(name) if what in ("target", "block", DIAL) else None
        if what in ("target", "block", DIAL) and len(parts) > 1 and unit is None:
            raise source.error(f"{shown(name)} in the heading: an unknown unit", HEADING, line=line)
        if unit is not None and unit[1] != 1.0 and what != DIAL:
            raise source.error(f"{shown(name)} in the heading", f"{what}_{unit[0].value}", line=line)
        columns[what] = index
    if missing := [what for what in _NEEDED if what not in columns]:
        raise source.error(f"no {' and no '.join(missing)} in the heading", HEADING, line=line)
    return columns


def _choice(source: SourceText, worksheet: Worksheet, key: str, usual: str, other: str) -> float:
    """Return 1 if a comment says the usual, or nothing; -1 for the other."""
    stated = worksheet.facts.get(key, usual).strip().lower()
    if stated not in (usual, other):
        raise source.error(f"# {key}: {stated}", f"# {key}: {usual}, or # {key}: {other}")
    return 1.0 if stated == usual else -1.0


def _placement(source: SourceText, line: int, text: str) -> int:
    number = to_integer(text)
    if number is None or not 1 <= number <= MOST:
        raise source.error(f"placement {shown(text)}", f"a whole number from 1 to {MOST}", line=line)
    return number


def _check_together(source: SourceText, lines: dict[Reading, int], most: float) -> None:
    """Check that no reading is far from the others of its placement: wrong digits, sign, or block."""
    groups: dict[int, list[Reading]] = defaultdict(list)
    for each in lines:
        groups[each.run].append(each)
    for placement, group in groups.items():
        middle = median(each.deviation for each in group)
        for each in group:
            if abs(each.deviation - middle) > most:
                raise source.error(
                    f"placement {placement} at {each.target:.9g}: {each.deviation - middle:+.6g} beside its "
                    "other readings",
                    "the length of the block that was there, the dial in its unit, counting up while the gap "
                    f"opens (else # {DIAL}: reversed, or # {GAP}: {CLOSES})",
                    line=lines[each],
                )
