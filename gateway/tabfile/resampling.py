"""A free grid made even, for the controls that know no other, and what that changes."""

from dataclasses import dataclass
from math import ceil, floor
from typing import Final

from gateway.compensation.curve import Curve
from gateway.compensation.table import CorrectionTable, make_table
from gateway.tabfile.errors import Problem, TabFileError

MAX_POINTS: Final = 100_000
DECIMALS: Final = 11
"""Of a unit: far below what any instrument or drive shows, and above what sums leave behind."""
MEASURED_DECIMALS: Final = 7
"""Of a unit: a tenth of a nanometre, where instruments show a hundred times as much."""
ON_GRID: Final = 1e-6
"""An end that lies within this fraction of a step from a point of the grid is that point."""


@dataclass(frozen=True, slots=True)
class Resampled:
    """The table on its new grid; its corrections differ from the old ones by at most this, and there."""

    table: CorrectionTable
    difference: float
    at: float


def resample(table: CorrectionTable, step: float, name: str) -> Resampled:
    """Return a table with points every ``step``, in units of the table; ``name`` is for the error.

    Home is a point of the grid if the table reaches there, else its first point is. Where the length is no
    multiple of the step, the grid ends within one step behind the table, with the value at its end.

    Raises:
        TabFileError: a step that is not above 0, above the length of the table, or that makes more than
            100 000 points.
    """
    length = table.last - table.first
    unit = table.units.value
    if not 0 < step <= length * (1 + ON_GRID) or length / step > MAX_POINTS:
        raise TabFileError(
            Problem(
                name,
                f"a step of {step:g} for a table of {length:g} {unit}",
                f"--resample from {length / MAX_POINTS:g} to {length:g} {unit}",
            )
        )
    origin = 0.0 if table.first - ON_GRID * step <= 0 <= table.last + ON_GRID * step else table.first
    lowest = floor((table.first - origin) / step + ON_GRID)
    highest = ceil((table.last - origin) / step - ON_GRID)
    positions = [origin + index * step for index in range(lowest, highest + 1)]
    curve = Curve(table)
    forward, backward = ([branch(x) for x in positions] for branch in (curve.forward, curve.backward))
    even = make_table(positions, forward, backward, table.units, has_backlash=table.facts.has_backlash)
    again = Curve(even)
    # Both are straight between the points of either, and the same at those of the new grid.
    difference, at = max(
        (abs(value - branch(x)), x)
        for values, branch in ((table.forward, again.forward), (table.backward, again.backward))
        for x, value in zip(table.positions, values, strict=True)
    )
    return Resampled(even, difference, at)


def tidied(table: CorrectionTable, decimals: int = DECIMALS) -> CorrectionTable:
    """Return a table that was computed, without what sums left behind the last digit that means anything.

    Of one that was measured that is :data:`MEASURED_DECIMALS`.

    >>> from gateway.compensation.units import Units
    >>> table = make_table([0.1, 0.1 + 0.2], [400.0123 - 400.0, 1e-9], [0.0, 0.0], Units.MM)
    >>> table.positions[1], tidied(table).positions[1], table.forward[0], tidied(table).forward[0]
    (0.30000000000000004, 0.3, 0.012299999999981992, 0.0123)
    """
    positions, *curves = (
        [round(number, decimals) + 0.0 for number in numbers]
        for numbers in (table.positions, table.forward, table.backward)
    )
    if len(set(positions)) < len(positions):
        positions = list(table.positions)
    return make_table(positions, curves[0], curves[1], table.units)
