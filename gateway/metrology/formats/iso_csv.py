"""Readings as ISO 230-2 lists them: one line for each stop.

Grammar (ours; the standard prescribes no file)::

    file    := comment* heading line*
    comment := "#" key ":" fact                        a fact about the measurement; "axis" is the axis
    heading := names, separated by a tab, a semicolon or a comma, in any order
    names   := "target_" UNIT or "dro_" UNIT, "direction", "run", and one of "measured_" UNIT,
               "block_" UNIT, "deviation_" SMALL_UNIT
    UNIT    := "mm" | "inch" | "deg"
    SMALL_UNIT := UNIT | "um" (with mm) | "tenth" (0.0001 inch) | "arcsec" (with deg)
    line    := as many cells as the heading has names

``measured`` is the position of the nut by the instrument, ``deviation`` that less the target. Over gauge
blocks the DRO is the control's position (``dro``); the block, at which the dial shows 0, is the position of
the nut (``block``). ``direction`` is the direction of approach: forward, up, + or backward, down, -. ``run``
counts from 1. For a name without its unit the units must be given. Optional columns are ``temperature_c``,
that of the screw, and ``time`` and ``note``, which are not read.
"""

from typing import Final

from gateway.compensation.direction import Direction
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
from gateway.metrology.formats.rows import Row, to_survey
from gateway.metrology.readings import Survey
from gateway.tabfile.text import SourceText, shown, to_integer

NAME: Final = "iso-csv"
TITLE: Final = "CSV with target, direction, run and reading, as ISO 230-2 lists them"
HEADING: Final = "target_mm,direction,run,measured_mm (or deviation_um)"
_DIRECTIONS: Final = {
    "forward": Direction.FORWARD,
    "fwd": Direction.FORWARD,
    "up": Direction.FORWARD,
    "+": Direction.FORWARD,
    "backward": Direction.BACKWARD,
    "bwd": Direction.BACKWARD,
    "down": Direction.BACKWARD,
    "-": Direction.BACKWARD,
}
_NAMES: Final = ("target", "direction", "run", "measured", "deviation", "temperature", "time", "note")
_OVER_BLOCKS: Final = {"dro": "target", "block": "measured"}
_MAX_RUN: Final = 1000
COLDEST_C: Final = -20.0
WARMEST_C: Final = 80.0


def recognise(source: SourceText) -> bool:
    """Whether the heading has a target and a direction or a reading."""
    cells = heading_words(source)
    names = {name for cell in cells for name in cell}
    # "run 1" is one of several columns.
    if ("placement",) in cells:  # a block walked along the axis
        return False
    is_listed = "direction" in names or ("run",) in cells
    if "dro" in names:
        return is_listed
    return "target" in names and (is_listed or not names.isdisjoint({"measured", "deviation"}))


def read(source: SourceText, context: ReadingsContext) -> Survey:
    """Read the file.

    Raises:
        TabFileError: a heading or a cell outside the grammar, or readings that do not belong together.
    """
    worksheet = worksheet_of(source, HEADING)
    columns = _columns(source, worksheet)
    units = settled_units(source, context, units_of(source, worksheet), worksheet.heading.number)
    scales = [(unit_of(name) or (units, 1.0))[1] for name in worksheet.names]
    reading = "measured" if "measured" in columns else "deviation"
    rows = []
    for line, cells in worksheet.lines:
        values = {
            what: decimal(source, line, cells[columns[what]], what) * scales[columns[what]]
            for what in ("target", reading)
        }
        measured = values[reading] + (values["target"] if reading == "deviation" else 0.0)
        run = _run(source, line, cells[columns["run"]])
        direction = direction_of(source, line, cells[columns["direction"]])
        warm = (
            temperature_of(source, line, cells[columns["temperature"]]) if "temperature" in columns else None
        )
        rows.append(Row(line, values["target"], direction, run, measured, warm))
    axis = settled_axis(source, context, worksheet.facts.get("axis"))
    return to_survey(source, rows, units, axis=axis, facts=worksheet.facts)


def _columns(source: SourceText, worksheet: Worksheet) -> dict[str, int]:
    """Return the column of each value."""
    columns: dict[str, int] = {}
    for index, name in enumerate(worksheet.names):
        parts = words(name)
        what = parts[0] if parts else ""
        if what in _OVER_BLOCKS:
            if (other := _OVER_BLOCKS[what]) in columns:
                raise source.error(
                    f"{shown(name)} beside {shown(worksheet.names[columns[other]])} in the heading",
                    "the DRO as dro_mm, and the gauge block or the instrument's reading as block_mm",
                    line=worksheet.heading.number,
                )
            what = other
        if what not in _NAMES or what in columns:
            twice = "a second " if what in columns else ""
            raise source.error(f"{twice}{shown(name)} in the heading", HEADING, line=worksheet.heading.number)
        if what == "temperature":
            if parts[1:] not in {(), ("c",), ("deg", "c")}:
                raise source.error(
                    f"{shown(name)} in the heading", "temperature_c: in °C", line=worksheet.heading.number
                )
            columns[what] = index
            continue
        unit = unit_of(name)
        if len(parts) > 1 and unit is None:
            raise source.error(
                f"{shown(name)} in the heading: an unknown unit",
                "mm, inch, deg; deviations also um, tenth, arcsec",
                line=worksheet.heading.number,
            )
        if unit is not None and unit[1] != 1.0 and what != "deviation":
            raise source.error(
                f"{shown(name)} in the heading", f"{what}_{unit[0].value}", line=worksheet.heading.number
            )
        columns[what] = index
    missing = [what for what in ("target", "direction", "run") if what not in columns]
    if missing or ("measured" in columns) == ("deviation" in columns):
        found = f"no {' and no '.join(missing)}" if missing else "not one of measured and deviation"
        in_order = "; or dro_mm,measured_mm: then the order of the lines gives the directions"
        raise source.error(
            f"{found} in the heading",
            f"{HEADING}{in_order if missing else ''}",
            line=worksheet.heading.number,
        )
    if "deviation" in columns and unit_of(worksheet.names[columns["deviation"]]) is None:
        raise source.error(
            f"{shown(worksheet.names[columns['deviation']])} in the heading, without a unit",
            "deviation_um, deviation_mm, deviation_inch, deviation_tenth, deviation_deg or deviation_arcsec",
            line=worksheet.heading.number,
        )
    return columns


def temperature_of(source: SourceText, line: int, text: str) -> float:
    """Return the temperature in a cell, in °C. Raises TabFileError: it is none of a machine."""
    warm = decimal(source, line, text, "temperature")
    if not COLDEST_C <= warm <= WARMEST_C:
        raise source.error(
            f"temperature {warm:g}", f"°C of a machine, {COLDEST_C:g} to {WARMEST_C:g}", line=line
        )
    return warm


def _run(source: SourceText, line: int, text: str) -> int:
    run = to_integer(text)
    if run is None or not 1 <= run <= _MAX_RUN:
        raise source.error(f"run {shown(text)}", f"a whole number from 1 to {_MAX_RUN}", line=line)
    return run


def direction_of(source: SourceText, line: int, text: str) -> Direction:
    """Return the direction in a cell. Raises TabFileError: it is none."""
    direction = _DIRECTIONS.get(text.lower())
    if direction is None:
        raise source.error(
            f"direction {shown(text)}", "forward, up or +; backward, down or -: the approach", line=line
        )
    return direction
