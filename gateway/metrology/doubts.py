"""What looks wrong about readings as a whole: their unit, and ends at which the axis did not go beyond."""

from collections.abc import Sequence
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.readings import MeanCorrections, Reading, mean_corrections

TINY_MM: Final = 0.0002
"""No screw is as good: the deviations are given in a larger unit than they are said to be in."""
HUGE_MM: Final = 1.0
"""No screw is as bad as this: perhaps micrometres were meant."""
LOST_AT_AN_END: Final = 0.25
"""Of the smallest reversal elsewhere: below it an end has none."""
_LEAST_OTHERS: Final = 3


def doubts_of(readings: Sequence[Reading], units: Units) -> list[str]:
    """Return a sentence for each doubt; none keeps a table from being made.

    Raises:
        ReadingsError: see :func:`gateway.metrology.readings.mean_corrections`.
    """
    means = mean_corrections(readings)
    return [*_unit(readings, units), *_ends(means, units)]


def _unit(readings: Sequence[Reading], units: Units) -> list[str]:
    if units is Units.DEGREE:
        return []
    # Where the instrument has its zero does not matter, so only what the deviations differ by counts.
    deviations = [each.deviation for each in readings]
    largest = max(deviations) - min(deviations)
    if not 0.0 < largest < units.from_mm(TINY_MM) and largest <= units.from_mm(HUGE_MM):
        return []
    difference = f"{largest:.3g} {units.value}"
    return [f"the deviations differ by {difference} in all: are the numbers in the unit that is said?"]


def _ends(means: MeanCorrections, units: Units) -> list[str]:
    reversals = {
        target: forward - backward
        for target, forward, backward in zip(means.targets, means.forward, means.backward, strict=True)
        if forward is not None and backward is not None
    }
    found = []
    for end in (means.targets[0], means.targets[-1]):
        others = [
            size for target, size in reversals.items() if target not in (means.targets[0], means.targets[-1])
        ]
        if end not in reversals or len(others) < _LEAST_OTHERS or min(others) * max(others) <= 0.0:
            continue
        least = min(map(abs, others))
        if abs(reversals[end]) < LOST_AT_AN_END * least:
            found.append(
                f"at {end:.9g} both directions lie {abs(reversals[end]):.3g} {units.value} apart, elsewhere "
                f"at least {least:.3g}: did the axis turn round there without going beyond it? Then both "
                "readings are of one direction: measure with an overrun larger than the lost motion"
            )
    return found
