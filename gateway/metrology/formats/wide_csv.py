"""Readings with a column for each run: a line for each target.

Grammar::

    file    := comment* heading line*
    heading := a name with "target" or "position" in it, then a name for each run; separated by a tab, a
               semicolon or a comma
    run     := a direction (forward, up, +, backward, down, -) and a number, in any order: "forward 1",
               "1 up", "+1"; or "run 1" without a direction, if --runs gives the directions
    line    := a target and a reading for each run; an empty cell is a missing reading

A run may name a unit. Micrometres, tenths and arc seconds are deviations. In the unit of the targets readings
are either positions or deviations. Their size decides, and readings that could be both are refused.
"""

import re
from typing import Final

from gateway.compensation.direction import Direction
from gateway.metrology.formats.cells import (
    Worksheet,
    decimal,
    heading_of,
    unit_of,
    units_of,
    words,
    worksheet_of,
)
from gateway.metrology.formats.context import ReadingsContext, Runs, settled_axis, settled_units
from gateway.metrology.formats.rows import Row, to_survey
from gateway.metrology.readings import Survey
from gateway.tabfile.csv_text import split_cells
from gateway.tabfile.text import SourceText, shown

NAME: Final = "wide-csv"
TITLE: Final = "CSV with a column for each run: target, forward 1, backward 1, forward 2, …"
HEADING: Final = "target_mm;forward 1;backward 1;forward 2;backward 2 (or forward_1_um)"
_FORWARD: Final = frozenset({"forward", "fwd", "up", "+"})
_BACKWARD: Final = frozenset({"backward", "bwd", "down", "reverse", "-"})
_TARGET: Final = frozenset({"target", "position", "nominal"})
_WAY: Final = re.compile(r"([+-]?)([0-9]{1,3})([+-]?)")
_UNIT: Final = re.compile(r"\s*\(?(?:mm|um|µm|inch|tenths?|deg|arcsec)\)?\s*$")
CLEARLY: Final = 100.0
"""A reading must be this many times nearer to its target than to 0, or the reverse."""


def recognise(source: SourceText) -> bool:
    """Whether the heading has a target and a run as columns; the reader names other columns."""
    found = heading_of(source)
    if found is None:
        return False
    names = split_cells(found[0].text, found[1])
    return bool(_TARGET & set(words(names[0]))) and any(_run(name) is not None for name in names[1:])


def read(source: SourceText, context: ReadingsContext) -> Survey:
    """Read the file.

    Raises:
        TabFileError: a heading or a cell outside the grammar, runs without a given direction, readings that
            may be positions as well as deviations.
    """
    worksheet = worksheet_of(source, HEADING)
    units = settled_units(source, context, units_of(source, worksheet), worksheet.heading.number)
    runs = _runs(source, worksheet, context.runs)
    table = []
    for line, cells in worksheet.lines:
        target = decimal(source, line, cells[0], "target")
        table += [
            (line, target, at, decimal(source, line, cell, worksheet.names[at]))
            for at, cell in enumerate(cells[1:], start=1)
            if cell
        ]
    small = {
        at: unit[1]
        for at, name in enumerate(worksheet.names)
        if at and (unit := unit_of(name)) is not None and unit[1] != 1.0
    }
    are_positions = not small and _are_positions(source, [(t, v) for _, t, _, v in table])
    rows = []
    for line, target, at, value in sorted(table, key=lambda each: (each[2], each[0])):
        way, run = runs[at]
        measured = value if are_positions else target + value * small.get(at, 1.0)
        rows.append(Row(line, target, way, run, measured))
    axis = settled_axis(source, context, worksheet.facts.get("axis"))
    return to_survey(source, rows, units, axis=axis, facts=worksheet.facts)


def _run(name: str) -> tuple[Direction | None, int] | None:
    """Return the direction and the number in the name of a column; None if it is not a run.

    >>> [_run(name) for name in ("forward 1", "up_2_um", "Run 3", "-4", "measured_mm")]
    ... # doctest: +NORMALIZE_WHITESPACE
    [(<Direction.FORWARD: 1>, 1), (<Direction.FORWARD: 1>, 2), (None, 3), (<Direction.BACKWARD: -1>, 4), None]
    """
    if found := _WAY.fullmatch(_UNIT.sub("", name).replace(" ", "")):
        sign = found[1] or found[3]
        return {"+": Direction.FORWARD, "-": Direction.BACKWARD}.get(sign), int(found[2])
    parts = words(name)
    numbers = [int(part) for part in parts if part.isascii() and part.isdigit()]
    forward, backward = (bool(ways & set(parts)) for ways in (_FORWARD, _BACKWARD))
    if len(numbers) != 1 or (forward and backward) or not (forward or backward or "run" in parts):
        return None
    return (Direction.FORWARD if forward else Direction.BACKWARD if backward else None), numbers[0]


def _runs(source: SourceText, worksheet: Worksheet, given: Runs | None) -> dict[int, tuple[Direction, int]]:
    found: dict[int, tuple[Direction, int]] = {}
    for at, name in enumerate(worksheet.names[1:], start=1):
        run = _run(name)
        if run is None:
            raise source.error(f"{shown(name)} in the heading", HEADING, line=worksheet.heading.number)
        way, number = run
        if way is None:
            if given is None:
                raise source.error(
                    f"{shown(name)} in the heading, without a direction",
                    "--runs alternate (odd runs forward, even runs back), forward or backward; or forward 1, "
                    "backward 1 in the heading",
                    line=worksheet.heading.number,
                )
            way, number = _given_way(given, number)
        if (way, number) in found.values():
            raise source.error(
                f"a second {shown(name)} in the heading", HEADING, line=worksheet.heading.number
            )
        found[at] = (way, number)
    return found


def _given_way(given: Runs, number: int) -> tuple[Direction, int]:
    if given is Runs.ALTERNATE:
        return (Direction.FORWARD if number % 2 else Direction.BACKWARD), (number + 1) // 2
    return (Direction.FORWARD if given is Runs.FORWARD else Direction.BACKWARD), number


def _are_positions(source: SourceText, pairs: list[tuple[float, float]]) -> bool:
    """Whether readings are positions: near their targets, and not near 0.

    Raises:
        TabFileError: they may be both.
    """
    from_target = max((abs(value - target) for target, value in pairs), default=0.0)
    from_zero = max((abs(value) for _, value in pairs), default=0.0)
    if from_target * CLEARLY < from_zero:
        return True
    farthest = max((abs(target) for target, _ in pairs), default=0.0)
    if from_zero * CLEARLY < farthest:
        return False
    raise source.error(
        f"readings up to {from_zero:.6g} at targets up to {farthest:.6g}: positions, or deviations?",
        "a unit in the names of the runs (forward_1_um is a deviation), or target, direction, run, measured",
        line=source.lines[0].number,
    )
