"""Smoothing of a table: a straight line through each point's surroundings, weighted by nearness.

At each point the correction becomes the value there of the line that fits best (least squares) the points
nearer than half the window, each with the weight ``1 - distance / half``; both directions for themselves. A
straight curve stays as it is, and the ends are no exception: they get a line too, not a mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.metrology.errors import ReadingsError

LEAST_POINTS: Final = 3
"""Through two points a line goes exactly: they would smooth nothing."""


@dataclass(frozen=True, slots=True)
class Change:
    """How much two tables differ: the largest difference, where, and the root of the mean square."""

    largest: float
    position: float
    direction: Direction
    rms: float


def smoothed(table: CorrectionTable, window: float) -> tuple[CorrectionTable, Change]:
    """Return the smoothed table and how much it differs at its points; the window is in its units.

    Raises:
        ReadingsError: a window that is not positive, or so small that it changes no point.
    """
    if not window > 0.0:
        raise ReadingsError(f"a smoothing window of {window:g}: it must be a length above 0")
    surroundings = [_surroundings(table.positions, at, window / 2.0) for at in table.positions]
    if all(len(near) < LEAST_POINTS for near in surroundings):
        raise ReadingsError(
            f"a smoothing window of {window:g} {table.units.value} holds fewer than {LEAST_POINTS} points "
            "everywhere: make it wider than twice the distance of the targets"
        )
    forward, backward = (
        [_value(table.positions, curve, i, near) for i, near in enumerate(surroundings)]
        for curve in (table.forward, table.backward)
    )
    result = make_table(table.positions, forward, backward, table.units)
    return result, change(table, result)


def change(before: CorrectionTable, after: CorrectionTable) -> Change:
    """Compare two tables with the same points."""
    differences = [
        (abs(new - old), position, way)
        for way, olds, news in (
            (Direction.FORWARD, before.forward, after.forward),
            (Direction.BACKWARD, before.backward, after.backward),
        )
        for old, new, position in zip(olds, news, before.positions, strict=True)
    ]
    largest, position, way = max(differences, key=lambda difference: difference[0])
    rms = sqrt(sum(size * size for size, _, _ in differences) / len(differences))
    return Change(largest, position, way, rms)


def _surroundings(positions: Sequence[float], at: float, half: float) -> list[tuple[int, float]]:
    """Return index and weight of every point nearer than ``half``."""
    return [(i, 1.0 - abs(x - at) / half) for i, x in enumerate(positions) if abs(x - at) < half]


def _value(
    positions: Sequence[float], curve: Sequence[float], index: int, near: Sequence[tuple[int, float]]
) -> float:
    if len(near) < LEAST_POINTS:
        return curve[index]
    total = sum(weight for _, weight in near)
    middle = sum(weight * positions[i] for i, weight in near) / total
    mean = sum(weight * curve[i] for i, weight in near) / total
    spread = sum(weight * (positions[i] - middle) ** 2 for i, weight in near)
    slope = sum(weight * (positions[i] - middle) * (curve[i] - mean) for i, weight in near) / spread
    return mean + slope * (positions[index] - middle)
