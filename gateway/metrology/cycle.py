"""Where an axis is measured: targets, and the order in which it goes to them. Lengths are in its units.

ISO 230-2 (clause 5) asks for targets ``P(i) = (i - 1) p + r``: evenly spaced by ``p``, each with another
offset ``r``, so that an error that repeats with every turn of the screw is not met at one phase only.
"""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from gateway.compensation.direction import Direction
from gateway.metrology.errors import ReadingsError

MOST_TARGETS: Final = 10_000
EVEN: Final = 1e-6
"""Part of a step by which the last target of an even grid may miss the end."""
RANDOM_SHARE: Final = 0.3
"""Largest offset, as a share of the interval, where no period is given."""
DECIMALS: Final = 3
"""Random targets are whole micrometres, as a person types them."""


@dataclass(frozen=True, slots=True)
class Stop:
    """One stop of a cycle. ``direction`` is that of the move that led to it; ends are no measuring stops.

    ``run`` counts the cycles, from 1.
    """

    nominal: float
    direction: Direction
    measure: bool
    run: int = 1


def bidirectional_cycle(targets: Sequence[float], overrun: float, cycles: int = 1) -> Iterator[Stop]:
    """Stops of a measuring cycle: up through all targets and down again, overrunning both ends.

    The overrun lets the axis turn round outside the targets, so that the first and last are approached from
    both sides too. It must be greater than the lost motion.

    >>> [(stop.nominal, stop.direction.name) for stop in bidirectional_cycle([0.0, 10.0], 2.0)]
    ... # doctest: +NORMALIZE_WHITESPACE
    [(-2.0, 'BACKWARD'), (0.0, 'FORWARD'), (10.0, 'FORWARD'),
     (12.0, 'FORWARD'), (10.0, 'BACKWARD'), (0.0, 'BACKWARD')]
    """
    ascending = sorted(targets)
    for run in range(1, cycles + 1):
        yield Stop(ascending[0] - overrun, Direction.BACKWARD, measure=False, run=run)
        for nominal in ascending:
            yield Stop(nominal, Direction.FORWARD, measure=True, run=run)
        yield Stop(ascending[-1] + overrun, Direction.FORWARD, measure=False, run=run)
        for nominal in reversed(ascending):
            yield Stop(nominal, Direction.BACKWARD, measure=True, run=run)


def remaining(stops: Sequence[Stop], done: int) -> list[Stop]:
    """Return the stops that are left after ``done`` readings, from the turn before the next one on.

    From there the next target is approached from the side that it is to be measured from.

    >>> stops = list(bidirectional_cycle([0.0, 10.0], 2.0))
    >>> [stop.nominal for stop in remaining(stops, 1)]
    [-2.0, 10.0, 12.0, 10.0, 0.0]
    >>> remaining(stops, 4)
    []
    """
    turn, measured = 0, 0
    for index, stop in enumerate(stops):
        if not stop.measure:
            turn = index
        elif measured == done:
            return [stops[turn], *stops[index:]]
        else:
            measured += 1
    return []


def even_targets(low: float, high: float, step: float) -> list[float]:
    """Return targets from ``low`` to ``high``, a step apart.

    Raises:
        ReadingsError: the step does not lead from one end to the other.

    >>> even_targets(-20.0, 20.0, 10.0)
    [-20.0, -10.0, 0.0, 10.0, 20.0]
    """
    _check_range(low, high)
    if not isfinite(step) or step <= 0:
        raise ReadingsError(f"a step of {step:g}: it must be greater than 0")
    steps = (high - low) / step
    if steps >= MOST_TARGETS:
        raise ReadingsError(f"{steps:.0f} steps: at most {MOST_TARGETS} targets")
    count = round(steps)
    if count < 1 or abs(steps - count) > EVEN:
        raise ReadingsError(
            f"from {low:.9g} to {high:.9g} are {steps:.6g} steps of {step:g}: it must be a whole number; "
            f"end at {low + max(1, int(steps)) * step:.9g}"
        )
    return [round(low + index * step, 9) for index in range(count)] + [high]


def random_targets(low: float, high: float, count: int, seed: int, period: float = 0.0) -> list[float]:
    """Return ``count`` targets with the standard's random offsets; the same seed gives the same targets.

    Each offset is anywhere in one ``period`` of the error that repeats (the lead of the screw), or in 0.3 of
    the interval where none is given. All targets are inside the range.

    Raises:
        ReadingsError: fewer than two targets, or a range that has no room for them.
    """
    _check_range(low, high)
    if not 2 <= count <= MOST_TARGETS:
        raise ReadingsError(f"{count} targets: allowed are 2 to {MOST_TARGETS}")
    if not isfinite(period) or period < 0:
        raise ReadingsError(f"a period of {period:g}: it must be greater than 0")
    widest = period or RANDOM_SHARE * (high - low) / (count - 1 + RANDOM_SHARE)
    interval = (high - low - widest) / (count - 1)
    if interval <= widest:
        raise ReadingsError(
            f"{count} targets from {low:.9g} to {high:.9g} with offsets up to {widest:g}: neighbours could "
            "change places; fewer targets, or a shorter period"
        )
    chosen = random.Random(seed)
    targets = [low + index * interval + chosen.random() * widest for index in range(count)]
    return [min(max(round(target, DECIMALS), low), high) for target in targets]


def _check_range(low: float, high: float) -> None:
    if not (isfinite(low) and isfinite(high) and low < high):
        raise ReadingsError(f"targets from {low:.9g} to {high:.9g}: the first must be the lower one")
