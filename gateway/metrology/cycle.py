"""The order in which an axis goes to its targets, and from which side. Lengths are in units of the axis.

Where the targets lie is said in ``metrology.program``, which writes the same cycle for a control.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gateway.compensation.direction import Direction


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
