"""Two readings at one point show whether a table is used with the right sign and direction.

With the compensation off, the drive is at the controller's position, and the screw's error moves the nut. A
table predicts the nut position: ``corrected = nominal + correction`` puts the nut at ``nominal``. So with the
drive at ``p`` the nut is at the exact inverse of that map, ``p - correction`` to first order. Each wrong use
of a table predicts other readings:

====================  =====================================  =========================================
way                   approached forward, measured ≈         approached backward, measured ≈
====================  =====================================  =========================================
right                 ``p - forward(p)``                     ``p - backward(p)``
sense inverted        ``p + forward(p)``                     ``p + backward(p)``
columns swapped       ``p - backward(p)``                    ``p - forward(p)``
both                  ``p + backward(p)``                    ``p + forward(p)``
direction inverted    ``-p``                                 ``-p``
====================  =====================================  =========================================

Everything here is in machine positions and units; the readings are from the table's own zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from typing import Final

from gateway.compensation.correction_map import CorrectionMap, Term
from gateway.compensation.curve import Curve
from gateway.compensation.table import CorrectionTable
from gateway.metrology.errors import ReadingsError

BEYOND: Final = 0.5
"""If the best guess leaves more than this share of the table unexplained, it is rejected."""


class TableUse(Enum):
    """The possible uses of a table; the value is the name in reports."""

    RIGHT = "right"
    SENSE_INVERTED = "sense inverted"
    COLUMNS_SWAPPED = "columns swapped"
    BOTH = "sense inverted and columns swapped"


class SignVerdict(Enum):
    """The result of the readings."""

    RIGHT = "right"
    SENSE_INVERTED = "sense inverted"
    COLUMNS_SWAPPED = "columns swapped"
    BOTH = "sense inverted and columns swapped"
    DIRECTION_INVERTED = "axis direction inverted"
    CANNOT_TELL = "cannot tell"
    NOTHING_FITS = "nothing fits"


@dataclass(frozen=True, slots=True)
class Pair:
    """One number for each direction of approach."""

    forward: float
    backward: float

    def distance(self, other: "Pair") -> float:
        """Return the larger of both differences."""
        return max(abs(self.forward - other.forward), abs(self.backward - other.backward))


NOTHING: Final = Pair(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Measurement:
    """Two readings of the nut with the drive at one position, approached forward and backward.

    Machine positions in units; ``uncertainty`` is that of a reading. A correction cannot exceed ``largest``:
    beyond it the readings are of another position. If an axis or an instrument counts the other way, the
    readings are near one of ``mirrored``.

    Raises:
        ReadingsError: a number that is not finite, an uncertainty that is not positive.
    """

    position: float
    readings: Pair
    uncertainty: float
    largest: float
    mirrored: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, number in (
            ("position", self.position),
            ("forward reading", self.readings.forward),
            ("backward reading", self.readings.backward),
        ):
            if not isfinite(number):
                raise ReadingsError(f"the {name} is {number}: it must be a finite number")
        if not (isfinite(self.uncertainty) and self.uncertainty > 0.0):
            raise ReadingsError(f"the uncertainty is {self.uncertainty}: it must be a number above 0")

    @property
    def measured(self) -> Pair:
        """The correction according to the readings: position less reading."""
        return Pair(self.position - self.readings.forward, self.position - self.readings.backward)


@dataclass(frozen=True, slots=True)
class BestPosition:
    """The position at which a table separates its uses best, and their smallest difference there."""

    position: float
    separation: float


@dataclass(frozen=True, slots=True)
class SignTest:
    """Result of a sign test; all numbers in units."""

    verdict: SignVerdict
    position: float
    measured: Pair
    """The correction according to the readings: position less reading."""
    table: Pair
    """The present correction of the table there."""
    expected: Mapping[TableUse, Pair]
    """The readings predicted by each use."""
    off_by: Mapping[TableUse, float]
    """The distance of the readings from each prediction."""
    candidates: tuple[TableUse, ...]
    """The uses that the readings do not exclude, the nearest first."""
    best: BestPosition
    share: float | None
    """Share of the table that explains the readings best (least squares); None if the table is 0."""
    tells_direction: bool
    """Whether an axis moving the other way would be at a clearly different position."""

    @property
    def is_right(self) -> bool:
        """Whether the table is used correctly."""
        return self.verdict is SignVerdict.RIGHT


def sign_test(curve: Curve, at: Measurement, inside: tuple[float, float] | None = None) -> SignTest:
    """Compare two readings with the table as used by the axis, in the same units.

    ``inside`` is the range of the search for a better position, as for :func:`most_telling_position`.
    """
    ways = _ways(curve.table)
    expected = {way: _expected(curve, way, at.position) for way in ways}
    off_by = {way: at.readings.distance(pair) for way, pair in expected.items()}
    nearest = min(off_by.values())
    # Two uses are separated when the readings, within the uncertainty, prefer one of them.
    near = [way for way in ways if off_by[way] - nearest <= 2.0 * at.uncertainty]
    table = _corrections(curve, at.position)
    return SignTest(
        verdict=_verdict(at, near, nearest, table),
        position=at.position,
        measured=at.measured,
        table=table,
        expected=expected,
        off_by=off_by,
        candidates=tuple(sorted(near, key=lambda way: off_by[way])),
        best=most_telling_position(curve, inside),
        share=_share(table, at.measured),
        tells_direction=all(abs(position - at.position) > 2.0 * at.largest for position in at.mirrored),
    )


def room(table: CorrectionTable, travel: tuple[float, float] | None, clearance: float) -> tuple[float, float]:
    """Return the range for a sign test: inside the table, and away from the ends of travel.

    The axis needs ``clearance`` on both sides of the position, to approach it from below and from above.
    Without a known travel the table's ends are used. A travel that is too short leaves only its middle.

    >>> from gateway.compensation.table import make_table
    >>> from gateway.compensation.units import Units
    >>> table = make_table([-300.0, 0.0], [0.0, 0.1], [0.0, 0.1], Units.MM)
    >>> room(table, (-300.0, 0.0), 1.01), room(table, (-500.0, 500.0), 1.01), room(table, (0.0, 1.0), 1.01)
    ((-298.99, -1.01), (-300.0, 0.0), (0.0, 0.0))
    """
    low, high = (table.first, table.last) if travel is None else travel
    low, high = low + clearance, high - clearance
    if low > high:
        low = high = (low + high) / 2.0
    return max(min(low, table.last), table.first), min(max(high, table.first), table.last)


def most_telling_position(curve: Curve, inside: tuple[float, float] | None = None) -> BestPosition:
    """Return the position where a sign test shows most: a point of the table, or an end of ``inside``.

    Right and inverted differ by twice the larger correction; right and swapped by forward - backward; right
    and both by forward + backward. The smallest of the three is maximised. A table of one direction has no
    columns to swap, and only the first one counts.
    """
    table = curve.table
    low, high = (table.first, table.last) if inside is None else inside
    positions = sorted({low, high, *(x for x in table.positions if low <= x <= high)})
    return max(
        (
            BestPosition(x, _separation(_corrections(curve, x), is_one_way=table.is_unidirectional))
            for x in positions
        ),
        key=lambda position: position.separation,
    )


def _corrections(curve: Curve, position: float) -> Pair:
    """Return the correction of the table at a position."""
    return Pair(
        CorrectionMap((Term(curve, 1.0, 0.0),)).correction(position),
        CorrectionMap((Term(curve, 0.0, 1.0),)).correction(position),
    )


def _separation(correction: Pair, *, is_one_way: bool) -> float:
    forward, backward = correction.forward, correction.backward
    inverted = 2.0 * max(abs(forward), abs(backward))
    return inverted if is_one_way else min(inverted, abs(forward - backward), abs(forward + backward))


def _ways(table: CorrectionTable) -> tuple[TableUse, ...]:
    """Return the possible mistakes: with equal directions, a swap has no effect."""
    return (TableUse.RIGHT, TableUse.SENSE_INVERTED) if table.is_unidirectional else tuple(TableUse)


def _expected(curve: Curve, way: TableUse, position: float) -> Pair:
    sign = -1.0 if way in (TableUse.SENSE_INVERTED, TableUse.BOTH) else 1.0
    first, second = Term(curve, sign, 0.0), Term(curve, 0.0, sign)
    if way in (TableUse.COLUMNS_SWAPPED, TableUse.BOTH):
        first, second = second, first
    return Pair(CorrectionMap((first,)).nominal(position), CorrectionMap((second,)).nominal(position))


def _verdict(at: Measurement, near: list[TableUse], nearest: float, table: Pair) -> SignVerdict:
    if at.measured.distance(NOTHING) > at.largest:
        is_mirrored = any(
            at.readings.distance(Pair(position, position)) <= at.largest for position in at.mirrored
        )
        return SignVerdict.DIRECTION_INVERTED if is_mirrored else SignVerdict.NOTHING_FITS
    if nearest > max(2.0 * at.uncertainty, BEYOND * table.distance(NOTHING)):
        return SignVerdict.NOTHING_FITS
    return SignVerdict.CANNOT_TELL if len(near) > 1 else SignVerdict(near[0].value)


def _share(table: Pair, measured: Pair) -> float | None:
    square = table.forward**2 + table.backward**2
    return (
        (table.forward * measured.forward + table.backward * measured.backward) / square if square else None
    )
