"""Readings that do not fit the others: they are named, and a person decides.

With three and more runs at a target, each reading is compared with the others at the same target in the same
direction: the modified z-score ``0.6745 |x - median| / MAD`` (Iglewicz and Hoaglin) above 4. Their limit is
3.5, by which one sound measurement in five, with its hundreds of readings, would have an outlier. The MAD of
few runs is sometimes small by chance. So the scale is never below the mean of all targets, corrected for the
number of runs (Croux and Rousseeuw 1992), nor below the noise of a good laser. With one or two runs a target
has nothing to compare. There the reading is compared with the straight line between its neighbours; a single
mistake is much farther from it than a screw's error.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, median
from typing import Final

from gateway.compensation.direction import Direction
from gateway.metrology.readings import APPROACHES, Reading, Survey, by_approach
from gateway.metrology.wrong_runs import without_runs, wrong_runs

NORMAL: Final = 0.6745
"""MAD of a normal distribution, in its standard deviations."""
MOST_SCORE: Final = 4.0
MOST_SCORE_BESIDE: Final = 6.0
"""A screw bends between targets, so neighbours are weaker evidence than runs."""
LEAST_RUNS: Final = 3
LEAST_TARGETS: Final = 7
"""Fewer targets do not show the usual distance of a sound reading from the line between its neighbours."""
NOISE_MM: Final = 0.0005
FEW: Final = {3: 1.495, 4: 1.363, 5: 1.206, 6: 1.200, 7: 1.140, 8: 1.129, 9: 1.107}

_Groups = dict[tuple[float, Direction], list[Reading]]


@dataclass(frozen=True, slots=True)
class Outlier:
    """A reading, its expected value, and its distance beyond the scatter of the others."""

    reading: Reading
    expected: float
    """Deviation of the others."""
    score: float
    against: str
    """``runs`` or ``neighbours``."""

    def describe(self, unit: str) -> str:
        """Return it as one line."""
        reading = self.reading
        return (
            f"{reading.direction.name.lower()} run {reading.run} at {reading.target:.9g}: deviation "
            f"{reading.deviation:+.6g} {unit}, but its {self.against} have {self.expected:+.6g} (score "
            f"{self.score:.3g})"
        )


def find_outliers(survey: Survey) -> tuple[Outlier, ...]:
    """Return the readings that do not fit, in the order of the survey.

    Readings of a run that is wrong as a whole are not included: that run has one fault, not many.
    """
    survey = without_runs(survey, wrong_runs(survey))
    groups = by_approach(survey.readings)
    floor = NORMAL * survey.units.from_mm(NOISE_MM)
    found = [*_against_runs(groups, floor)]
    for way in APPROACHES:
        found.extend(_against_neighbours(groups, way, floor))
    order = {reading: index for index, reading in enumerate(survey.readings)}
    return tuple(sorted(found, key=lambda outlier: order[outlier.reading]))


def without_outliers(
    survey: Survey, outliers: Sequence[Outlier]
) -> tuple[tuple[Reading, ...], tuple[float, ...]]:
    """Return the readings that are not outliers, and the targets that were lost completely.

    If an outlier was the only reading of its direction, the target is omitted in both: the curves are
    straight between its neighbours.
    """
    dropped = {outlier.reading for outlier in outliers}
    left = [reading for reading in survey.readings if reading not in dropped]
    ways: dict[float, set[Direction]] = {}
    for reading in left:
        ways.setdefault(reading.target, set()).add(reading.direction)
    emptied = {
        outlier.reading.target
        for outlier in outliers
        if outlier.reading.direction not in ways.get(outlier.reading.target, ())
    }
    return tuple(reading for reading in left if reading.target not in emptied), tuple(sorted(emptied))


def _against_runs(groups: _Groups, floor: float) -> Iterable[Outlier]:
    enough = {key: group for key, group in groups.items() if len(group) >= LEAST_RUNS}
    middles = {key: median(reading.deviation for reading in group) for key, group in enough.items()}
    spreads = {key: _mad(group, middles[key]) for key, group in enough.items()}
    common = fmean(spreads[key] * _for_few(len(group)) for key, group in enough.items()) if enough else 0.0
    for key, group in enough.items():
        scale = max(spreads[key], common, floor)
        for reading in group:
            score = NORMAL * abs(reading.deviation - middles[key]) / scale
            if score > MOST_SCORE:
                yield Outlier(reading, middles[key], score, "runs")


def _for_few(count: int) -> float:
    """Return the factor that removes the bias from the MAD of ``count`` normally distributed readings."""
    return FEW[count] if count in FEW else count / (count - 0.8)


def _mad(group: Sequence[Reading], middle: float) -> float:
    return median(abs(reading.deviation - middle) for reading in group)


def _against_neighbours(groups: _Groups, way: Direction, floor: float) -> Iterable[Outlier]:
    targets = sorted(target for target, direction in groups if direction is way)
    if len(targets) < LEAST_TARGETS:
        return
    middles = {target: median(r.deviation for r in groups[target, way]) for target in targets}
    distances = _distances(targets, middles)
    usual = median(distances.values())
    scale = max(median(abs(distance - usual) for distance in distances.values()), floor)
    beside = {
        target: max((abs(distances[near]) for near in nears if near in distances), default=0.0)
        for target, nears in _neighbours(targets).items()
    }
    for target, distance in distances.items():
        group = groups[target, way]
        # A mistake bends the lines of both its neighbours by half as much: only the sharpest bend is the
        # mistake.
        if len(group) >= LEAST_RUNS or abs(distance) <= beside[target]:
            continue
        expected = middles[target] - distance
        for reading in group:
            score = NORMAL * abs(reading.deviation - expected - usual) / scale
            if score > MOST_SCORE_BESIDE:
                yield Outlier(reading, expected, score, "neighbours")


def _distances(targets: Sequence[float], middles: Mapping[float, float]) -> dict[float, float]:
    """Return the distance of each inner target from the line between its neighbours."""
    distances = {}
    for low, at, high in zip(targets, targets[1:], targets[2:], strict=False):
        share = (at - low) / (high - low)
        distances[at] = middles[at] - (middles[low] + share * (middles[high] - middles[low]))
    return distances


def _neighbours(targets: Sequence[float]) -> dict[float, list[float]]:
    beside: dict[float, list[float]] = {target: [] for target in targets}
    for low, high in pairwise(targets):
        beside[low].append(high)
        beside[high].append(low)
    return beside
