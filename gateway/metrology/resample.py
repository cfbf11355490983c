"""Changes of a table before it is written: smoothing, an even grid, or as few points as possible.

Smoothing fits a straight line to the surroundings of each point (least squares). The points are those nearer
than half the window, each with the weight ``1 - distance / half``. The correction becomes the value of the
line there; each direction is smoothed separately. A straight curve does not change. The ends get a line too,
not a mean.
"""

from collections.abc import Iterable, Sequence
from math import ceil, floor, inf
from typing import Final

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.readings import APPROACHES
from gateway.metrology.tables import Change, ResamplingLoss, change, correction_at, loss

GRID_TOLERANCE: Final = 1e-9
"""Share of a step by which a target may differ from a multiple and still be on it."""
DIGITS: Final = 12
MAX_POINTS: Final = 100_000
LEAST_POINTS: Final = 3
"""A line through two points is exact: they would smooth nothing."""


# --- Other values


def smoothed(table: CorrectionTable, window: float) -> tuple[CorrectionTable, Change]:
    """Return the smoothed table and its change at its points; the window is in its units.

    Raises:
        ReadingsError: a window that is not positive, or so small that it changes no point.
    """
    if not window > 0.0:
        raise ReadingsError(f"a smoothing window of {window:g}: it must be a length above 0")
    surroundings = [_surroundings(table.positions, at, window / 2.0) for at in table.positions]
    if all(len(near) < LEAST_POINTS for near in surroundings):
        raise ReadingsError(
            f"a smoothing window of {window:g} {table.units.value} never holds {LEAST_POINTS} points: make "
            "it wider than twice the distance between the targets"
        )
    forward, backward = (
        [_value(table.positions, curve, i, near) for i, near in enumerate(surroundings)]
        for curve in (table.forward, table.backward)
    )
    result = make_table(table.positions, forward, backward, table.units)
    return result, change(table, result)


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


# --- Other points


def on_grid(
    table: CorrectionTable, step: float, span: tuple[float, float] | None = None
) -> tuple[CorrectionTable, ResamplingLoss]:
    """Return the table at the multiples of a step (TB058: "an even multiple of the StepSize").

    The points are those inside ``span``, the travel, or without one those inside the table. Beyond the table
    its end values hold. What lies between an end of the table and the first multiple is lost; the loss there
    counts as if the end value of the new table held.

    Raises:
        ReadingsError: a step that is not positive, so large that fewer than two multiples fit, or so small
            that a hundred thousand do.
    """
    return _at(table, grid_positions(step, span or (table.first, table.last), table.units))


def grid_positions(step: float, span: tuple[float, float], units: Units) -> list[float]:
    """Return the multiples of a step inside ``span``.

    Raises:
        ReadingsError: see :func:`on_grid`.
    """
    if not step > 0.0:
        raise ReadingsError(f"a step of {step:g}: it must be a length above 0")
    first, last = span
    low = ceil(first / step - GRID_TOLERANCE)
    high = floor(last / step + GRID_TOLERANCE)
    if not 1 <= high - low < MAX_POINTS:
        raise ReadingsError(
            f"a step of {step:g} {units.value}: {max(high - low + 1, 0)} multiples of it are in "
            f"{first:.9g} to {last:.9g}; give a step with 2 to {MAX_POINTS}"
        )
    return [round(index * step, DIGITS) + 0.0 for index in range(low, high + 1)]


def at_positions(table: CorrectionTable, positions: Sequence[float]) -> CorrectionTable:
    """Return the table at other points; beyond its own its end values hold."""
    return _at(table, positions)[0]


def fewest_points(
    table: CorrectionTable, tolerance: float, keep: Iterable[float] = ()
) -> tuple[CorrectionTable, ResamplingLoss]:
    """Return the table with the fewest of its points that stays within a tolerance in both directions.

    No smaller choice of points that includes both ends satisfies this: each stretch that may be omitted is an
    edge, and the shortest path from end to end is used. The points in ``keep`` stay, if the table has them.

    Raises:
        ReadingsError: a tolerance that is not 0 or more.
    """
    if not tolerance >= 0.0:
        raise ReadingsError(f"a tolerance of {tolerance:g}: it must be 0 or more")
    # Rounding of the sums must not cost a point that lies exactly on the line, or on the limit.
    scale = max(table.max_correction(), abs(table.first), abs(table.last))
    margin = tolerance + 1e-13 * scale
    kept = set(keep)
    count = len(table.positions)
    steps, before = [0] + [count] * (count - 1), [0] * count
    for start in range(count - 1):
        for end in _reachable(table, start, margin, kept):
            if steps[start] + 1 < steps[end]:
                steps[end], before[end] = steps[start] + 1, start
    chosen = [count - 1]
    while chosen[-1] != 0:
        chosen.append(before[chosen[-1]])
    return _at(table, [table.positions[index] for index in reversed(chosen)])


def with_point(table: CorrectionTable, position: float) -> CorrectionTable:
    """Return the same curves with a point at a position inside the table."""
    if position in table.positions or not table.first < position < table.last:
        return table
    return _at(table, sorted({*table.positions, position}))[0]


def _reachable(table: CorrectionTable, start: int, margin: float, kept: set[float]) -> Iterable[int]:
    """Yield the points to which a straight line from ``start`` stays within the margin of all between.

    Each point that is passed narrows the allowed slopes, in each direction.
    """
    x0 = table.positions[start]
    limits = [(-inf, inf), (-inf, inf)]
    for end in range(start + 1, len(table.positions)):
        width = table.positions[end] - x0
        rises = [curve[end] - curve[start] for curve in (table.forward, table.backward)]
        if all(low <= rise / width <= high for (low, high), rise in zip(limits, rises, strict=True)):
            yield end
        if table.positions[end] in kept:
            return
        limits = [
            (max(low, (rise - margin) / width), min(high, (rise + margin) / width))
            for (low, high), rise in zip(limits, rises, strict=True)
        ]
        if any(low > high for low, high in limits):
            return


def _at(table: CorrectionTable, positions: Sequence[float]) -> tuple[CorrectionTable, ResamplingLoss]:
    forward, backward = ([correction_at(table, x, way) for x in positions] for way in APPROACHES)
    result = make_table(positions, forward, backward, table.units)
    return result, loss(table, result)
