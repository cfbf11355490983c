"""Corrections between the points of a table and beyond its ends, where end values hold; comparisons."""

from dataclasses import dataclass

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.metrology.readings import APPROACHES


def correction_at(table: CorrectionTable, position: float, direction: Direction) -> float:
    """Return the amount that a table adds at a machine position, in its units.

    >>> from gateway.compensation.table import make_table
    >>> from gateway.compensation.units import Units
    >>> table = make_table([0, 10], [0.0, 0.02], [0.0, 0.0], Units.MM)
    >>> correction_at(table, 5, Direction.FORWARD), correction_at(table, 99, Direction.FORWARD)
    (0.01, 0.02)
    """
    curve = table.backward if direction is Direction.BACKWARD else table.forward
    inside = min(max(position, table.first), table.last)
    index = table.segment(inside)
    left, right = table.positions[index], table.positions[index + 1]
    share = (inside - left) / (right - left)
    # Exact at both points: rounding must not change measured values.
    return curve[index + 1] if share == 1.0 else curve[index] + share * (curve[index + 1] - curve[index])


@dataclass(frozen=True, slots=True)
class Change:
    """Difference of two tables: the largest difference, its position, and the root of the mean square."""

    largest: float
    position: float
    direction: Direction
    rms: float


def change(before: CorrectionTable, after: CorrectionTable) -> Change:
    """Compare two tables at the points of the second."""
    differences = [
        (abs(correction_at(after, x, way) - correction_at(before, x, way)), x, way)
        for way in APPROACHES
        for x in after.positions
    ]
    largest, position, way = max(differences, key=lambda difference: difference[0])
    mean_square = sum(size * size for size, _, _ in differences) / len(differences)
    return Change(largest, position, way, mean_square**0.5)


@dataclass(frozen=True, slots=True)
class ResamplingLoss:
    """The largest difference from other points, also between the points, and its position."""

    size: float
    position: float
    direction: Direction


def loss(before: CorrectionTable, after: CorrectionTable) -> ResamplingLoss:
    """Return the largest difference of two tables over the range of the first; outside, end values hold."""
    low, high = before.first, before.last
    positions = sorted({*before.positions, *(x for x in after.positions if low <= x <= high)})
    return max(
        (
            ResamplingLoss(abs(correction_at(before, x, way) - correction_at(after, x, way)), x, way)
            for way in APPROACHES
            for x in positions
        ),
        key=lambda found: found.size,
    )
