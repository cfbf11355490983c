"""Laser readings into a correction table: mean, turn-around points, home as reference (Centroid TB058)."""

from collections.abc import Iterable
from dataclasses import dataclass

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.readings import APPROACHES, MeanCorrections, Reading, mean_corrections

_MIN_TARGETS = 2


@dataclass(frozen=True, slots=True)
class HomeReference:
    """Where the correction is 0 by definition: the home position, arrived at in the direction of homing.

    TB058's cases: a home switch with positive travel is the first forward value, with negative travel the
    last backward value; a reference mark is the forward value at 0, interpolated where no target lies there.
    """

    position: float
    direction: Direction


def build_table(
    readings: Iterable[Reading],
    units: Units,
    *,
    home: HomeReference | None = None,
    estimate_ends: bool = True,
) -> CorrectionTable:
    """Build the table that, added to the command, takes the nut where the instrument missed it.

    The correction is ``target - measured``, the mean of all readings at a target in a direction. At the
    first and the last target one direction often has no reading, because the axis turned round there: with
    ``estimate_ends`` it is estimated from its neighbour's reversal. ``home`` is subtracted from everything.

    Raises:
        ReadingsError: readings that make no table.
        TableError: corrections that no table may hold (a slope of 1).

    >>> up, down = Direction.FORWARD, Direction.BACKWARD
    >>> readings = [Reading(0, up, 0.0), Reading(0, down, 0.02)]
    >>> readings += [Reading(10, up, 9.99), Reading(10, down, 10.01)]
    >>> table = build_table(readings, Units.MM)
    >>> [round(c, 3) for c in table.forward], [round(c, 3) for c in table.backward]
    ([0.0, 0.01], [-0.02, -0.01])
    """
    means = mean_corrections(readings)
    if len(means.targets) < _MIN_TARGETS:
        raise ReadingsError(
            f"all readings are at {means.targets[0]:.9g}: a table needs at least {_MIN_TARGETS} targets"
        )
    if estimate_ends:
        means = _with_estimated_ends(means)
    forward = _complete(means.targets, means.forward, Direction.FORWARD)
    backward = _complete(means.targets, means.backward, Direction.BACKWARD)
    table = make_table(means.targets, forward, backward, units)
    return _referenced(table, home) if home else table


def _with_estimated_ends(means: MeanCorrections) -> MeanCorrections:
    forward, backward = list(means.forward), list(means.backward)
    for end, neighbour in ((0, 1), (-1, -2)):
        _estimate(forward, backward, end, neighbour)
        _estimate(backward, forward, end, neighbour)
    return MeanCorrections(means.targets, tuple(forward), tuple(backward))


def _estimate(wanted: list[float | None], other: list[float | None], end: int, neighbour: int) -> None:
    """``LastReverse = LastForward - (NextToLastForward - NextToLastReverse)``, for either end and way."""
    here, beside, wanted_beside = other[end], other[neighbour], wanted[neighbour]
    if wanted[end] is None and here is not None and beside is not None and wanted_beside is not None:
        wanted[end] = here - (beside - wanted_beside)


def _complete(
    targets: tuple[float, ...], values: tuple[float | None, ...], direction: Direction
) -> list[float]:
    missing = [f"{target:.9g}" for target, value in zip(targets, values, strict=True) if value is None]
    if missing:
        raise ReadingsError(
            f"no {direction.name.lower()} reading at {', '.join(missing)}: measure every target in both "
            "directions; only the first and the last can be estimated, from a neighbour that has both"
        )
    return [value for value in values if value is not None]


def _referenced(table: CorrectionTable, home: HomeReference) -> CorrectionTable:
    """Subtract the correction at home from both directions; between points it is interpolated."""
    if home.direction not in APPROACHES:
        raise ReadingsError("home was approached in an unknown direction: give forward or backward")
    if not table.first <= home.position <= table.last:
        raise ReadingsError(
            f"home at {home.position:.9g} lies outside the targets {table.first:.9g} to {table.last:.9g}"
        )
    curve = table.forward if home.direction is Direction.FORWARD else table.backward
    index = table.segment(home.position)
    left, right = table.positions[index], table.positions[index + 1]
    share = (home.position - left) / (right - left)
    at_home = curve[index] * (1 - share) + curve[index + 1] * share
    return make_table(
        table.positions,
        [c - at_home for c in table.forward],
        [c - at_home for c in table.backward],
        table.units,
    )
