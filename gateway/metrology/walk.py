"""A gauge block walked along an axis: where it is placed, in which order, and what that cannot show.

At each placement the dial touches its stop at one position of the axis, and the block between them at a
position one block further. The dial has a range, so the positions need not be exactly one block apart.
Random distances show errors that repeat with a turn of the screw. A block of ten turns alone would hide them,
because both of its ends are at the same angle.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import cos, hypot, pi, sin
from random import Random
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.cycle import DECIMALS
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period

GAP: Final = "gap"
OPENS: Final = "opens"
"""The gap between dial and stop opens while the axis moves forward."""
CLOSES: Final = "closes"
MOST_DIFFERENCE_MM: Final = 0.5
"""No screw is so wrong over one block: the sign, the digits or the block of a reading are."""
USUAL_MM: Final = 9.2
"""Distance of placements without a given number: each place is measured by five blocks of 50 mm."""
LEAST: Final = 5
MOST: Final = 500
ASIDE: Final = 0.4
"""Of the distance of placements: how far each may be moved aside."""
LEAST_SEEN: Final = 0.05
"""Information about an error that repeats, a difference: half of it at random angles. Below it is hidden."""


@dataclass(frozen=True, slots=True)
class Placement:
    """One placement of the instrument and its stop: positions without the block, and with it."""

    number: int
    """From 1."""
    bare: tuple[float, ...]
    over_block: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Walk:
    """A walk from ``low`` to ``high``; lengths in units of the axis.

    ``reach`` is the range of the dial that may be used. ``closes``: the gap between dial and stop closes when
    the axis moves forward.
    """

    low: float
    high: float
    block: float
    placements: int
    reach: float
    seed: int = 1
    closes: bool = False

    def __post_init__(self) -> None:
        """Check the lengths.

        Raises:
            ReadingsError: the block does not fit, or too few or too many placements.
        """
        if not self.block > 0.0 or not self.reach >= 0.0:
            raise ReadingsError("a walk needs a block longer than 0, and a range of the dial of 0 or more")
        if self.reach >= self.block:
            raise ReadingsError(
                f"a dial range of {self.reach:g}: give less than the block, {self.block:g}, or use the dial "
                "alone"
            )
        if self.high - self.low < 2 * self.block:
            raise ReadingsError(
                f"a block of {self.block:g} from {self.low:g} to {self.high:g}: the range must be at least "
                "twice the block; use a shorter block"
            )
        if not LEAST <= self.placements <= MOST:
            raise ReadingsError(f"{self.placements} placements: give {LEAST} to {MOST}")

    def placed(self, units: Units) -> list[Placement]:
        """Return the placements, from ``low`` to ``high``. The same seed gives the same ones.

        >>> [first, *_, last] = Walk(0.0, 500.0, 50.0, 10, 0.0).placed(Units.MM)
        >>> first.bare, first.over_block, last.bare, last.over_block
        ((0.0,), (50.0,), (450.0,), (500.0,))
        """
        random = Random(self.seed)
        free = self.high - self.low - self.block
        found = []
        for index in range(self.placements):
            start = self.low + free * index / (self.placements - 1)
            # Not on a grid: an error that repeats would look the same at each placement.
            start += random.uniform(-ASIDE, ASIDE) * free / (self.placements - 1)
            low = min(max(start, self.low), self.high - self.block)
            aside = random.uniform(-1.0, 1.0) * self.reach / 2
            if index == 0:
                # The first shows a wrong sign of the dial most clearly.
                low, aside = self.low, self.reach / 2
            high = min(low + self.block + aside, self.high)
            if index == self.placements - 1:
                high = self.high
            positions = round(low, DECIMALS[units]), round(high, DECIMALS[units])
            bare, over = positions if not self.closes else positions[::-1]
            found.append(Placement(index + 1, (bare,), (over,)))
        return found


# --- What a walk cannot show


def hidden(placements: Sequence[Sequence[float]], periods: Iterable[Period]) -> tuple[Period, ...]:
    """Return the periods that the differences within placements do not show; positions of each placement.

    Without a given period these are the whole fractions of a usual difference, as for the step of a grid.

    >>> walk = [(start, start + 50.0) for start in (0.0, 11.0, 23.0, 37.0, 52.0)]
    >>> [each.name for each in hidden(walk, [Period(5.0, "lead 5")])]
    ['lead 5']
    >>> moved = [(low, high + extra) for (low, high), extra in zip(walk, (0.0, 2.0, 3.5, 1.2, 4.1))]
    >>> hidden(moved, [Period(5.0, "lead 5")])
    ()
    """
    given = tuple(periods)
    found = [each for each in given if _seen(placements, each.length) < LEAST_SEEN]
    if given:
        return tuple(found)
    usual = sorted(max(each) - min(each) for each in placements)[len(placements) // 2]
    if _seen(placements, usual) < LEAST_SEEN:
        found.append(Period(usual, f"the length of {usual:.6g} between two readings and its whole fractions"))
    return tuple(found)


def _seen(placements: Sequence[Sequence[float]], period: float) -> float:
    """Return the least information that the differences have about a wave of any phase, for each of them."""
    a = b = c = 0.0
    count = 0
    for positions in placements:
        angles = [2 * pi * position / period for position in positions]
        sines, cosines = [sin(angle) for angle in angles], [cos(angle) for angle in angles]
        s, k = sum(sines) / len(angles), sum(cosines) / len(angles)
        a += sum((each - s) ** 2 for each in sines)
        c += sum((each - k) ** 2 for each in cosines)
        b += sum((one - s) * (other - k) for one, other in zip(sines, cosines, strict=True))
        count += len(angles) - 1
    # The smaller eigenvalue of the information matrix.
    least = (a + c) / 2 - hypot((a - c) / 2, b)
    return least / max(count, 1)
