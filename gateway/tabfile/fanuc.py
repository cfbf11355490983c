"""Fanuc stored pitch error compensation, as CSV: one direction, increments in pulses.

The parameters are those of the control (0i, 16i, 18i and kin: parameter manual B-63980EN, 3620 to 3624);
the CSV is our own, see :mod:`gateway.tabfile.increments`::

    3620,40          number of the reference point
    3621,33          number of the most negative point
    3622,49          number of the most positive point
    3623,1           magnification of the values
    3624,50          interval, in units of the file
    limit,127        only if the control allows values above 7
    point,value
    33,2
    ...

A value times the magnification is in pulses (detection units) of the old control. The manual gives the
section of a value, and the sign on the negative side, in figures only. This is our reading of them:

* A point owns the section that ends at it, seen in the positive direction: with the reference at 40 and an
  interval of 50 mm, point 41 is the section 0 to 50, point 40 the section -50 to 0, point 33 the section -400
  to -350. The manual's example has 33 as the first point of a stroke that begins at -400.
* Values are steps seen in the positive direction on both sides of the reference: the correction at -50 is
  minus the value of point 40. (Assumed. A public program that makes such values from laser readings does the
  same. One move to each side of the reference shows it.)

On a rotary axis, in the manual, the most negative point is the reference itself and has the value of the last
point (60 = 68). The values of a revolution add up to 0.
"""

from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import required_units
from gateway.tabfile.csv_text import first_row
from gateway.tabfile.decoded import Decoded
from gateway.tabfile.increments import (
    Convention,
    Increments,
    Point,
    Rows,
    System,
    decode,
    is_revolution,
    parse_increments,
    round_steps,
    sum_up,
    written,
)
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import SourceText
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "fanuc-csv"
TITLE: Final = "Fanuc pitch error compensation as CSV, one direction, increments in pulses"
USES: Final = frozenset({"file_counts_per_unit", "file_start", "file_home"})
MAX_NUMBER: Final = 1023
"""Highest point number. General knowledge, like the range of -7 to 7 and the magnification of 1 to 100."""
_BIDIRECTIONAL: Final = "bidirectional compensation (3605#0): no manual at hand states how its values count"
SYSTEM: Final = System(
    title="Fanuc CSV",
    parameters=("3620", "3621", "3622", "3623", "3624"),
    lowest_value=-7,
    highest_value=7,
    max_magnification=100,
    highest_limit=127,
    refused=dict.fromkeys(("3605", "3626", "3627"), _BIDIRECTIONAL),
)
_CONVENTION: Final = Convention(
    1,
    "values x magnification / file_counts_per_unit, summed from the reference point: added",
    (
        (
            "assumed on both sides of the reference point: the value of a point is the change of the "
            "correction over the section below it, moving upwards"
        ),
    ),
)


def recognise(source: SourceText) -> bool:
    """Whether the first row is one of the parameters."""
    first = first_row(source)
    name = (
        first.text.replace(";", ",").split(",")[0].strip()
        if first is not None and len(first.text) > 5
        else ""
    )
    return len(name) == 4 and name.startswith("36") and name.isdecimal()


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the file with the units and the scale from the context.

    Raises:
        TabFileError: see :func:`parse_increments` and :func:`decode`; a reference that is not among the
            points; on a rotary axis, a first value that differs from that of the last point.
    """
    file = parse_increments(source, SYSTEM)
    points = _without_the_double(source, context, file)
    first, last = points[0].number, points[-1].number
    if not first - 1 <= file.reference <= last:
        raise source.error(
            f"reference point {file.reference}, points {first} to {last}",
            f"3620 from {first - 1} to {last}: the sums begin at this point",
            line=file.reference_line,
        )
    sums = sum_up([(point.number - 1 - file.reference, point) for point in points])
    return decode(source, context, file, sums, _CONVENTION)


def _without_the_double(source: SourceText, context: FileContext, file: Increments) -> tuple[Point, ...]:
    """Return the points of a revolution without the first, which repeats the last one."""
    first, last = file.points[0], file.points[-1]
    units: Units = required_units(source, context, "a table of increments")
    if first.number != file.reference or not is_revolution(units, last.number - first.number, file.interval):
        return file.points
    if first.value != last.value:
        raise source.error(
            f"{first.value} at point {first.number}, but {last.value} at point {last.number}, one turn later",
            "the same value at both: they are the same point",
            line=first.line,
        )
    return file.points[1:]


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table; it must have a point at 0 without correction, and evenly spaced points.

    Raises:
        TabFileError: see :func:`round_steps`; more points than a control has.
    """
    steps = round_steps(table, options, SYSTEM, 1)
    sections = len(steps.totals) - 1
    if sections > MAX_NUMBER:
        raise unwritable(SYSTEM.title, f"{sections} sections", f"at most {MAX_NUMBER}")
    points = [(section + 1, steps.across(section)) for section in range(sections)]
    if steps.zero == 0 and is_revolution(table.units, sections, steps.interval):
        points.insert(0, (0, points[-1][1]))
    assert options.file_counts_per_unit is not None
    parameters = (steps.zero, points[0][0], points[-1][0], steps.magnification, f"{steps.interval:.12g}")
    resolution = steps.magnification / options.file_counts_per_unit
    return written(table, options, SYSTEM, Rows(parameters, points, resolution))
