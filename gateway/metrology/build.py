"""From readings to a table: its curve, means, turn-around points, home as reference (Centroid TB058)."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from statistics import fmean

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period
from gateway.metrology.readings import APPROACHES, NEAR, MeanCorrections, Reading, mean_corrections
from gateway.metrology.tables import correction_at

Refusal = Callable[[CorrectionTable], str | None]
"""The reason why a table cannot be written, and the remedy; None if it can."""
_MIN_TARGETS = 2
_LISTED = 8


class Shape(Enum):
    """The curve of a table, the plainest first."""

    LINES = "lines"
    """Straight from target to target."""
    SMOOTH = "smooth"
    """A smooth curve; scatter about it, noise and short waves alike, remains."""
    HARMONICS = "harmonics"
    """A smooth curve and what repeats with the lead and other revolutions."""

    @property
    def words(self) -> str:
        """Its name in a sentence."""
        return {
            Shape.LINES: "lines between the targets",
            Shape.SMOOTH: "a smooth curve",
            Shape.HARMONICS: "a smooth curve with harmonics of the lead",
        }[self]


class Fit(Enum):
    """The requested curve; ``AUTO``: the one that leaves least between the targets."""

    AUTO = "auto"
    LINES = "lines"
    SMOOTH = "smooth"
    HARMONICS = "harmonics"


@dataclass(frozen=True, slots=True)
class HomeReference:
    """The position where the correction is 0 by definition: home, approached in the direction of homing.

    TB058's cases: a home switch with positive travel is the first forward value, with negative travel the
    last backward value. A reference mark is the forward value at 0, interpolated if there is no target.
    """

    position: float
    direction: Direction


def home_of(table: CorrectionTable) -> HomeReference | None:
    """Return the home of a table from a file: where its correction is 0, nearest to position 0; or None."""
    points = (
        (abs(position), HomeReference(position, way))
        for way, curve in zip(APPROACHES, (table.forward, table.backward), strict=True)
        for position, correction in zip(table.positions, curve, strict=True)
        if correction == 0.0
    )
    return min(points, key=lambda each: each[0], default=(0.0, None))[1]


class HomeCase(Enum):
    """The three cases of TB058: how the axis homes, and on which side of home its travel is."""

    SWITCH_POSITIVE = "switch-positive"
    SWITCH_NEGATIVE = "switch-negative"
    MARK = "mark"

    def reference(self, table: CorrectionTable) -> HomeReference:
        """Return the home point of a table.

        An end counts as home if its distance from 0 is at most a hundredth of the way to the next target. The
        first gauge block is where the dial showed 0, not the DRO.

        Raises:
            ReadingsError: the table is on the other side of home, or does not reach 0.
        """
        low, high = table.first, table.last
        near_low = NEAR * (table.positions[1] - low)
        near_high = NEAR * (high - table.positions[-2])
        if self is HomeCase.MARK:
            if not low - near_low <= 0.0 <= high + near_high:
                raise ReadingsError(
                    "measure also at 0, where the reference mark is, or choose switch-positive or "
                    f"switch-negative: the targets are {low:.9g} to {high:.9g}"
                )
            return HomeReference(min(max(0.0, low), high), Direction.FORWARD)
        is_positive = self is HomeCase.SWITCH_POSITIVE
        if (is_positive and low < -near_low) or (not is_positive and high > near_high):
            side, end = ("positive", "negative") if is_positive else ("negative", "positive")
            other = HomeCase.SWITCH_NEGATIVE if is_positive else HomeCase.SWITCH_POSITIVE
            raise ReadingsError(
                f"home {self.value} means {side} positions, with the switch at the {end} end of travel, "
                f"but the targets are {low:.9g} to {high:.9g}; choose {other.value} if the switch is at "
                f"the {side} end, or mark if home is a mark between them"
            )
        if is_positive:
            return HomeReference(low, Direction.FORWARD)
        return HomeReference(high, Direction.BACKWARD)


@dataclass(frozen=True, slots=True)
class Recipe:
    """Options for making a table; lengths in the units of the readings.

    ``step`` requests an even grid, over ``travel`` if given. ``tolerance`` requests as few of the targets as
    it allows; the two exclude each other. ``smooth`` is the window. ``one_way`` makes one curve for both
    directions. ``fit`` is the curve of the table; without it, the table is straight from target to target,
    and nothing is reported about the range between. ``periods`` are the possible periods of the error.
    ``refusal`` returns why a table cannot be written, with the remedy; without it every table can be.
    ``widen`` is what to do if the even grid ends before the readings, in the options of who asks.
    """

    home: HomeCase | HomeReference | None = None
    step: float | None = None
    tolerance: float | None = None
    smooth: float | None = None
    drop_outliers: bool = False
    estimate_ends: bool = True
    one_way: bool = False
    travel: tuple[float, float] | None = None
    fit: Fit | None = None
    periods: tuple[Period, ...] = ()
    refusal: Refusal | None = None
    widen: str = "extend the grid with --travel LO HI, or give a step that divides both ends"

    def reference(self, table: CorrectionTable) -> HomeReference | None:
        """Return the home point of a table; None if no home is given.

        Raises:
            ReadingsError: see :meth:`HomeCase.reference`.
        """
        return self.home.reference(table) if isinstance(self.home, HomeCase) else self.home


def build_table(
    readings: Iterable[Reading],
    units: Units,
    *,
    home: HomeReference | None = None,
    estimate_ends: bool = True,
    one_way: bool = False,
) -> CorrectionTable:
    """Build the table that, added to the command, corrects the error that the instrument measured.

    The correction is ``target - measured``, the mean of all readings at a target in a direction. At the first
    and the last target one direction often has no reading, because the axis turned round there. With
    ``estimate_ends`` it is estimated from its neighbour's reversal. ``home`` is subtracted from everything.
    With ``one_way`` the table has one curve for both directions: the mean of the readings at a target.

    Raises:
        ReadingsError: readings that make no table.
        TableError: corrections that are not allowed in a table (a slope of 1).

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
    if one_way:
        means = _both_in_one(means)
    elif estimate_ends:
        means = with_estimated_ends(means)
    forward = _complete(means.targets, means.forward, Direction.FORWARD)
    backward = _complete(means.targets, means.backward, Direction.BACKWARD)
    table = make_table(means.targets, forward, backward, units)
    return referenced(table, home) if home else table


def _both_in_one(means: MeanCorrections) -> MeanCorrections:
    curve = tuple(
        fmean([value for value in pair if value is not None])
        for pair in zip(means.forward, means.backward, strict=True)
    )
    return MeanCorrections(means.targets, curve, curve)


def with_estimated_ends(means: MeanCorrections) -> MeanCorrections:
    """Estimate missing directions at the first and the last target, if a neighbour has both."""
    forward, backward = list(means.forward), list(means.backward)
    for end, neighbour in ((0, 1), (-1, -2)):
        _estimate(forward, backward, end, neighbour)
        _estimate(backward, forward, end, neighbour)
    return MeanCorrections(means.targets, tuple(forward), tuple(backward))


def _estimate(curve: list[float | None], other: list[float | None], end: int, neighbour: int) -> None:
    """``LastReverse = LastForward - (NextToLastForward - NextToLastReverse)``, either end, either way."""
    here, beside, curve_beside = other[end], other[neighbour], curve[neighbour]
    if curve[end] is None and here is not None and beside is not None and curve_beside is not None:
        curve[end] = here - (beside - curve_beside)


def _complete(
    targets: tuple[float, ...], values: tuple[float | None, ...], direction: Direction
) -> list[float]:
    missing = [f"{target:.9g}" for target, value in zip(targets, values, strict=True) if value is None]
    if missing:
        where = ", ".join(missing[:_LISTED]) + (
            f" and {len(missing) - _LISTED} more" * (len(missing) > _LISTED)
        )
        where = "at all" if len(missing) == len(targets) > _LISTED else f"at {where}"
        raise ReadingsError(
            f"no {direction.name.lower()} reading {where}: measure every target in both directions, or "
            "make one curve for both directions (--one-way). Only the first and the last target can be "
            "estimated, from a neighbour with both"
        )
    return [value for value in values if value is not None]


def referenced(table: CorrectionTable, home: HomeReference) -> CorrectionTable:
    """Subtract the correction at home from both directions; between points it is interpolated.

    Raises:
        ReadingsError: home is outside the table, or has no direction of approach.
    """
    if home.direction not in APPROACHES:
        raise ReadingsError("give the direction in which home was approached: forward or backward")
    if not table.first <= home.position <= table.last:
        raise ReadingsError(
            f"home at {home.position:.9g} is outside the targets {table.first:.9g} to {table.last:.9g}"
        )
    at_home = correction_at(table, home.position, home.direction)
    return make_table(
        table.positions,
        [c - at_home for c in table.forward],
        [c - at_home for c in table.backward],
        table.units,
    )
