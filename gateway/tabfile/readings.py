"""Two meanings of one file, described and compared, so that a person can choose."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gateway.compensation.units import Units
from gateway.tabfile.decoded import SourceRow

AS_THEY_STAND: Final = "positions as they stand"
"""What the plain meaning of a file that states positions assumes."""
_SHOWN_POINTS: Final = 4


@dataclass(frozen=True, slots=True)
class Reading:
    """One possible meaning: what it assumes and the points that follow, ascending."""

    assumption: str
    rows: Sequence[SourceRow]
    units: Units

    def describe(self) -> str:
        """Say in one line what is assumed and where the points then lie."""
        places = [f"{row.position:.6g}" for row in self.rows]
        if len(places) > 2 * _SHOWN_POINTS:
            places = [*places[:_SHOWN_POINTS], "…", *places[-_SHOWN_POINTS:]]
        return f"{self.assumption}: {len(self.rows)} points at {', '.join(places)} {self.units.value}"


def largest_difference(one: Sequence[SourceRow], other: Sequence[SourceRow]) -> tuple[float, float]:
    """Return the largest difference between the corrections of two readings, and where it is.

    Outside its points a reading holds its end value. Both are piecewise linear, so the largest difference
    lies at a point of one of them.
    """
    places = sorted({row.position for row in (*one, *other)})
    largest, where = 0.0, places[0]
    for first, second in zip(_branches(one), _branches(other), strict=True):
        for place in places:
            difference = abs(_hold(*first, place) - _hold(*second, place))
            if difference > largest:
                largest, where = difference, place
    return largest, where


def describe_both(one: Reading, other: Reading) -> tuple[str, ...]:
    """Return both readings in words, the second followed by how far they lie apart."""
    largest, where = largest_difference(one.rows, other.rows)
    unit = one.units.value
    difference = f"; their corrections differ by at most {largest:.6g} {unit} (at {where:.6g})"
    return (one.describe(), other.describe() + difference)


def _branches(rows: Sequence[SourceRow]) -> tuple[tuple[list[float], list[float]], ...]:
    positions = [row.position for row in rows]
    return (positions, [row.forward for row in rows]), (positions, [row.backward for row in rows])


def _hold(positions: list[float], corrections: list[float], place: float) -> float:
    above = bisect_right(positions, place)
    if above == 0:
        return corrections[0]
    if above == len(positions):
        return corrections[-1]
    share = (place - positions[above - 1]) / (positions[above] - positions[above - 1])
    return corrections[above - 1] + share * (corrections[above] - corrections[above - 1])
