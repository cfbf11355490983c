"""A gauge block walked along an axis: where it is placed, in which order, and what that cannot show.

At each placement the dial touches its stop at one position of the axis, and the block between them at a
position one block further. The dial has a range, so the positions need not be exactly one block apart.
Random distances show errors that repeat with a turn of the screw. A block of ten turns alone would hide them,
because both of its ends are at the same angle.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import cos, hypot, pi, sin
from random import Random
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.cycle import DECIMALS, Hands, Stop
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
MOST_PER_SIDE: Final = 20
APART: Final = 0.002
"""Of the block: the range of the dial for each position on one side, so that no two are the same."""
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

    @property
    def positions(self) -> tuple[float, ...]:
        """All positions with readings."""
        return self.bare + self.over_block


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
    per_side: int = 1
    """Positions without the block at each placement, and as many with it."""

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
        if self.per_side > 1 and self.reach < self.per_side * APART * self.block:
            raise ReadingsError(
                f"{self.per_side} positions on each side of the block: give a dial range of at least "
                f"{self.per_side * APART * self.block:.3g}"
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
        lowest, highest = self.low + self.reach / 2, self.high - self.block - self.reach / 2
        step = (self.high - self.block - self.low) / (self.placements - 1)
        found = []
        for index in range(self.placements):
            # Not on a grid: an error that repeats would look the same at each placement.
            start = self.low + step * (index + random.uniform(-ASIDE, ASIDE))
            start = min(max(start, lowest), highest)
            is_first, is_last = index == 0, index == self.placements - 1
            start = lowest if is_first else highest if is_last else start
            lower, upper = self._around(start, random), self._around(start + self.block, random)
            if is_first:
                # It shows a wrong sign of the dial most clearly.
                lower[0], upper[-1] = self.low, self.low + self.block + self.reach
            if is_last:
                upper[-1] = self.high
            bare, over = (tuple(round(each, DECIMALS[units]) for each in side) for side in (lower, upper))
            if self.closes:
                bare, over = over, bare
            found.append(Placement(index + 1, bare, over))
        return found

    def _around(self, middle: float, random: Random) -> list[float]:
        """Return positions of one side, within the range of the dial."""
        parts = [(index + random.uniform(0.1, 0.9)) / self.per_side for index in range(self.per_side)]
        return [middle + (part - 0.5) * self.reach for part in parts]

    def stops(self, units: Units, overrun: float) -> Iterator[Stop]:
        """Yield the stops: at each placement without the block and with it, turn round, and back.

        Between the readings the axis moves away from the stop of the dial, so the gap opens. It closes in the
        end, after the block was taken out.

        >>> walk = Walk(0.0, 500.0, 50.0, 10, 0.0)
        >>> for stop in list(walk.stops(Units.MM, 1.0))[:6]:
        ...     print(stop.nominal, stop.direction.name, stop.block, stop.before, stop.after)
        -1.0 BACKWARD 0.0 Hands.CLEAR None
        0.0 FORWARD 0.0 None Hands.PLACE
        50.0 FORWARD 50.0 None Hands.INSERT
        51.0 FORWARD 0.0 None None
        50.0 BACKWARD 50.0 None None
        0.0 BACKWARD 0.0 Hands.REMOVE None
        """
        out, back = Direction.FORWARD, Direction.BACKWARD
        if self.closes:
            out, back = back, out
        block = out.value * self.block
        for each in self.placed(units):
            run, bare, over = each.number, each.bare, each.over_block
            if self.closes:
                bare, over = bare[::-1], over[::-1]
            yield Stop(bare[0] - out.value * overrun, back, measure=False, run=run, before=Hands.CLEAR)
            for x in bare:
                after = Hands.PLACE if x == bare[0] else None
                yield Stop(x, out, measure=True, run=run, after=after)
            for x in over:
                after = Hands.INSERT if x == over[0] else None
                yield Stop(x, out, measure=True, run=run, block=block, after=after)
            yield Stop(over[-1] + out.value * overrun, out, measure=False, run=run)
            for x in over[::-1]:
                yield Stop(x, back, measure=True, run=run, block=block)
            for x in bare[::-1]:
                before = Hands.REMOVE if x == bare[-1] else None
                yield Stop(x, back, measure=True, run=run, before=before)

    @property
    def readings(self) -> int:
        """Readings of a placement: on both sides of the block, in both directions."""
        return 4 * self.per_side


def from_placement(stops: Sequence[Stop], placement: int) -> list[Stop]:
    """Return the stops from the beginning of a placement on."""
    return [each for each in stops if each.run >= placement]


def usual_placements(low: float, high: float, block: float, units: Units) -> int:
    """Return a number of placements with which each position is measured by several blocks.

    >>> usual_placements(0.0, 500.0, 50.0, Units.MM)
    50
    """
    count = round((high - low - block) / units.from_mm(USUAL_MM)) + 1
    return min(max(count, 2 * LEAST), MOST)


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


def hidden_warning(periods: Sequence[Period], walk: Walk, unit: str) -> str:
    """Return what the walk does not show, and the remedy."""
    names = " and ".join(each.name for each in periods)
    longest = max(each.length for each in periods)
    return (
        f"an error that repeats with {names} is not seen, because the block of {walk.block:.9g} {unit} is "
        f"nearly a whole number of turns long: use a dial of more range (--dial-range {longest:.6g}), or "
        "another block"
    )
