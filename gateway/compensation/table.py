"""The correction table: every dialect is converted into it.

``corrected = nominal + correction``. The reader of a dialect has converted its sign convention before a table
exists. Code that uses a table knows no other sign.
"""

from array import array
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf, isfinite
from typing import Final, NamedTuple

from gateway.compensation.errors import TableError
from gateway.compensation.units import Units

EVEN_GRID_TOLERANCE: Final = 1e-9
"""A grid counts as even if every point is within this fraction of a step from its even position."""


class Range(NamedTuple):
    """Smallest and largest of some numbers."""

    low: float
    high: float

    @property
    def largest(self) -> float:
        """Largest absolute value."""
        return max(abs(self.low), abs(self.high))


class TableFacts(NamedTuple):
    """Properties of all points together. Lengths are in the units of the table.

    The builder of the table computes them once: a process with deadlines of microseconds never walks over the
    points.
    """

    is_unidirectional: bool
    """Both directions have the same corrections."""
    forward: Range
    backward: Range
    difference: Range
    """Of forward - backward."""
    max_slope: float
    """Largest |change of correction / distance| of either direction, without a unit."""
    has_backlash: bool = False
    """A constant lost motion was added to it (see ``backlash``); its file had one direction only."""


@dataclass(frozen=True, slots=True)
class CorrectionTable:
    """Corrections of one axis over machine position, separate for each direction of travel.

    All arrays hold doubles in ``units``; positions ascend strictly; between points the curve is a straight
    line. ``forward`` applies while the machine position grows, ``backward`` while it shrinks.

    Build one with :func:`make_table`, which checks it.
    """

    positions: Sequence[float]
    forward: Sequence[float]
    backward: Sequence[float]
    units: Units
    even_step: float
    """Distance of neighbouring points if the grid is even, else 0."""
    facts: TableFacts
    digest: str = field(default="", compare=False)
    """Names its compiled form; empty for a table that was built in this process."""

    @property
    def first(self) -> float:
        """Lowest position of the table, in its units."""
        return self.positions[0]

    @property
    def last(self) -> float:
        """Highest position of the table, in its units."""
        return self.positions[-1]

    @property
    def is_unidirectional(self) -> bool:
        """Whether both directions have the same corrections."""
        return self.facts.is_unidirectional

    def segment(self, position: float) -> int:
        """Return the index of the point that begins the segment around ``position``, clipped to the table.

        >>> make_table([0, 1, 2], [0, 0, 0], [0, 0, 0], Units.MM).segment(1.0)
        1
        """
        last_segment = len(self.positions) - 2
        if self.even_step:
            index = int((position - self.positions[0]) / self.even_step)
            # Near a point the division may be off by one segment; the comparisons below are exact.
            index = 0 if index < 0 else min(index, last_segment)
            if position < self.positions[index] and index:
                return index - 1
            if index < last_segment and position >= self.positions[index + 1]:
                return index + 1
            return index
        return max(0, min(bisect_right(self.positions, position) - 1, last_segment))

    def max_slope(self) -> float:
        """Largest |change of correction / distance| of either direction, without a unit."""
        return self.facts.max_slope

    def max_correction(self) -> float:
        """Largest |correction| of either direction, in the table's units."""
        return max(self.facts.forward.largest, self.facts.backward.largest)

    def max_reversal(self) -> float:
        """Largest |forward - backward|, in the table's units."""
        return self.facts.difference.largest

    def in_units(self, units: Units) -> "CorrectionTable":
        """Return the same table in other units.

        Raises:
            ValueError: between a length and an angle.
        """
        if units is self.units:
            return self
        factor = self.units.convert_factor(units)
        return make_table(
            [x * factor for x in self.positions],
            [c * factor for c in self.forward],
            [c * factor for c in self.backward],
            units,
            has_backlash=self.facts.has_backlash,
        )


def make_table(
    positions: Sequence[float],
    forward: Sequence[float],
    backward: Sequence[float],
    units: Units,
    *,
    has_backlash: bool = False,
) -> CorrectionTable:
    """Check and build a table from points in ascending order.

    Raises:
        TableError: fewer than two points, lists of different length, a number that is not finite, positions
            that do not ascend strictly, or a correction that changes by as much as the position does
            (slope >= 1: the map could not be inverted).

    >>> make_table([0, 10], [0.0, 0.01], [0.0, -0.01], Units.MM).max_slope()
    0.001
    """
    if not len(positions) == len(forward) == len(backward):
        raise TableError(
            f"{len(positions)} positions, {len(forward)} forward and {len(backward)} backward corrections: "
            "the three lists must be of one length"
        )
    if len(positions) < 2:
        raise TableError(f"{len(positions)} point(s): a table needs at least 2")
    for name, values in (("position", positions), ("forward", forward), ("backward", backward)):
        for index, number in enumerate(values):
            if not isfinite(number):
                raise TableError(f"{name} of point {index + 1} is {number}, not a finite number")
    for index in range(1, len(positions)):
        if positions[index] <= positions[index - 1]:
            raise TableError(
                f"position of point {index + 1} ({positions[index]}) does not lie above point {index} "
                f"({positions[index - 1]})"
            )
    forward_array = array("d", forward)
    backward_array = forward_array if list(forward) == list(backward) else array("d", backward)
    position_array = array("d", positions)
    _check_slope(position_array, forward_array, backward_array)
    facts = TableFacts(
        is_unidirectional=forward_array is backward_array,
        forward=Range(min(forward_array), max(forward_array)),
        backward=Range(min(backward_array), max(backward_array)),
        difference=_range_of(f - b for f, b in zip(forward_array, backward_array, strict=True)),
        max_slope=max(_steepest(position_array, curve) for curve in (forward_array, backward_array)),
        has_backlash=has_backlash,
    )
    even_step = _even_step(position_array)
    return CorrectionTable(position_array, forward_array, backward_array, units, even_step, facts)


def _range_of(numbers: Iterable[float]) -> Range:
    found = list(numbers)
    return Range(min(found), max(found))


def _steepest(positions: Sequence[float], curve: Sequence[float]) -> float:
    return max(
        abs(after - before) / (high - low)
        for (low, high), (before, after) in zip(pairwise(positions), pairwise(curve), strict=True)
    )


def _even_step(positions: Sequence[float]) -> float:
    step = (positions[-1] - positions[0]) / (len(positions) - 1)
    start = positions[0]
    furthest = max(abs(x - (start + i * step)) for i, x in enumerate(positions))
    return step if furthest <= step * EVEN_GRID_TOLERANCE else 0.0


def _check_slope(positions: Sequence[float], forward: Sequence[float], backward: Sequence[float]) -> None:
    for name, curve in (("forward", forward), ("backward", backward)):
        for i in range(len(positions) - 1):
            slope = (curve[i + 1] - curve[i]) / (positions[i + 1] - positions[i])
            if not -1.0 < slope < 1.0 or abs(slope) == inf:
                raise TableError(
                    f"{name} correction changes by {curve[i + 1] - curve[i]:.9g} between "
                    f"{positions[i]:.9g} and {positions[i + 1]:.9g}: a slope of {slope:.4g}, "
                    "which must stay below 1"
                )
