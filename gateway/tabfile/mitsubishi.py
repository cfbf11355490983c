"""Mitsubishi machine error compensation, incremental system, as CSV: one direction, half output units.

The control's manuals (E68 and C64, "Machine error compensation", incremental system) define the value of a
division point n of this interval, in half output units, -128 to 127:

* above the reference, feed from n - 1 to n: (interval - actual movement) x 2
* below the reference, feed from n + 1 to n: (interval + actual movement) x 2, the movement being negative

So a point owns the section between it and its neighbour towards the reference. On both sides a value is twice
the growth of the correction across the section, seen in the positive direction. No section ends at the
reference itself: its value is 0. The parameters have plain names here; the CSV is our own, see
:mod:`gateway.tabfile.increments`::

    reference,3      number of the reference point
    lowest,1         number of the most negative point
    highest,5        number of the most positive point
    magnification,1  the compensation scale factor
    interval,100     division interval, in units of the file
    point,value
    1,-6
    ...
"""

from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.tabfile.csv_text import first_row
from gateway.tabfile.decoded import Decoded
from gateway.tabfile.increments import (
    Convention,
    Rows,
    System,
    decode,
    parse_increments,
    round_steps,
    sum_up,
    written,
)
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import SourceText
from gateway.tabfile.writing import WriteOptions, Written

NAME: Final = "mitsubishi-csv"
TITLE: Final = "Mitsubishi machine error compensation as CSV, one direction, increments in half output units"
USES: Final = frozenset({"file_counts_per_unit", "file_start", "file_home"})
VALUES_PER_COUNT: Final = 2
SYSTEM: Final = System(
    title="Mitsubishi CSV",
    parameters=("reference", "lowest", "highest", "magnification", "interval"),
    lowest_value=-128,
    highest_value=127,
    max_magnification=99,
    highest_limit=0,
    refused={"absolute": "the absolute system: its values are not increments"},
)
_CONVENTION: Final = Convention(
    VALUES_PER_COUNT,
    "values x magnification / 2 / file_counts_per_unit, summed from the reference point: added",
)


def recognise(source: SourceText) -> bool:
    """Whether the first row is one of the parameters."""
    first = first_row(source)
    return (
        first is not None and first.text.replace(";", ",").split(",")[0].strip().lower() in SYSTEM.parameters
    )


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the file with the units and the scale (output units per unit) from the context.

    Raises:
        TabFileError: see :func:`parse_increments` and :func:`decode`; a reference that is not among the
            points, or a value there.
    """
    file = parse_increments(source, SYSTEM)
    numbers = [point.number for point in file.points]
    if file.reference not in numbers or len(numbers) < 2:
        raise source.error(
            f"reference point {file.reference}, points {numbers[0]} to {numbers[-1]}",
            "at least 2 points, and the reference point must be one of them: the sums begin there",
            line=file.reference_line,
        )
    home = file.points[numbers.index(file.reference)]
    if home.value:
        raise source.error(
            f"{home.value} at the reference point {home.number}", "0: no section ends there", line=home.line
        )
    sections = [
        (point.number - file.reference - (point.number > file.reference), point)
        for point in file.points
        if point is not home
    ]
    return decode(source, context, file, sum_up(sections), _CONVENTION)


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table; it must have a point at 0 without correction, and evenly spaced points.

    Raises:
        TabFileError: see :func:`round_steps`.
    """
    steps = round_steps(table, options, SYSTEM, VALUES_PER_COUNT)
    points = [
        (index + 1, 0 if index == steps.zero else steps.across(index - (index > steps.zero)))
        for index in range(len(steps.totals))
    ]
    assert options.file_counts_per_unit is not None
    parameters = (steps.zero + 1, 1, len(points), steps.magnification, f"{steps.interval:.12g}")
    resolution = steps.magnification / options.file_counts_per_unit / VALUES_PER_COUNT
    return written(table, options, SYSTEM, Rows(parameters, points, resolution))
