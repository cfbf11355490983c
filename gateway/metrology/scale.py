"""The linear part of an error: a scale, which belongs into ``counts_per_unit`` and not into a table.

TB058 demands that the turns for a unit are checked before any table is made; a table that holds a wrong scale
is as long as the error is steep, and a wrong drive ratio looks like a bad screw.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isfinite
from statistics import fmean, median
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.readings import APPROACHES, Reading, Survey, mean_corrections

MOST: Final = 3e-4
"""0.3 mm/m: more is no screw but a wrong scale, and is asked for first."""
LEAST_TARGETS: Final = 3
LEAST_TURNS: Final = 10
"""Over fewer turns of the screw what repeats with a turn has a slope of its own."""
USUAL_LEAD_MM: Final = 5.0
"""Of a screw whose lead nobody told."""
NO_WAVE_MM: Final = 0.1
"""A linear part that makes more, from the first target to the last, is none of a turn."""
_PER_METRE_UM: Final = 1e6
TRIAL_MOVE: Final = {Units.MM: 1.0, Units.INCH: 0.05, Units.DEGREE: 1.0}
"""A move that does no harm when it becomes ten times as long."""
ROUGHLY: Final = 0.2
"""Share by which a trial move may miss: lost motion, and a rule that is read by eye."""
LEAST_MOVED: Final = 1e-6
"""Share of a trial move: less is none."""


@dataclass(frozen=True, slots=True)
class ScaleError:
    """``share``: what the nut goes too far, of the way; positive where it goes too far."""

    share: float

    @property
    def counts_factor(self) -> float:
        """What ``counts_per_unit`` has to be multiplied by: a nut that goes too far needs fewer counts."""
        return 1.0 / (1.0 + self.share)

    @property
    def is_large(self) -> bool:
        """Whether the scale has to be put right before a table is made."""
        return abs(self.share) > MOST

    def describe(self, counts_per_unit: float | None = None) -> str:
        """Say it in a sentence.

        >>> ScaleError(0.00025).describe(1000.0)
        'linear part +250 µm/m: counts_per_unit 999.750062 instead of 1000 would remove it'
        """
        text = f"linear part {self.share * _PER_METRE_UM:+.4g} µm/m: counts_per_unit "
        if counts_per_unit is None:
            return f"{text}times {self.counts_factor:.8f} would remove it"
        right = counts_per_unit * self.counts_factor
        return f"{text}{right:.9g} instead of {counts_per_unit:.9g} would remove it"


def fault_of_trial(moved: float, counts_per_unit: float, units: Units) -> str:
    """Say what is wrong where an axis was told to move by :data:`TRIAL_MOVE`, and moved by ``moved``.

    "" where its scale is of the right size and sign; the last digits are for a table and its linear part.

    Raises:
        ReadingsError: it is no finite number.

    >>> fault_of_trial(10.0, 1000.0, Units.MM)
    'it moved by 10 mm, not by 1 mm: counts_per_unit should be about 100, not 1000'
    >>> fault_of_trial(-0.98, 1000.0, Units.MM)
    'it moved by -0.98 mm, not by 1 mm: turn the sign of counts_per_unit, -1000'
    >>> fault_of_trial(0.95, 1000.0, Units.MM)
    ''
    """
    if not isfinite(moved):
        raise ReadingsError(f"--moved {moved}: it must be a finite number")
    commanded = TRIAL_MOVE[units]
    text = f"it moved by {moved:.6g} {units.value}, not by {commanded:g} {units.value}"
    ratio = moved / commanded
    if abs(ratio - 1.0) <= ROUGHLY:
        return ""
    if abs(ratio) < LEAST_MOVED:
        return f"{text}: is the drive enabled? is counts_per_unit, {counts_per_unit:.9g}, large enough?"
    if abs(ratio + 1.0) <= ROUGHLY:
        return f"{text}: turn the sign of counts_per_unit, {-counts_per_unit:.9g}"
    right = counts_per_unit * ScaleError(ratio - 1.0).counts_factor
    return f"{text}: counts_per_unit should be about {right:.6g}, not {counts_per_unit:.9g}"


def scale_of(readings: Iterable[Reading]) -> ScaleError | None:
    """Return the slope of the straight line that fits the means best; None with fewer than three targets.

    >>> from gateway.compensation.direction import Direction
    >>> up = Direction.FORWARD
    >>> found = scale_of([Reading(0, up, 0.0), Reading(100, up, 100.02), Reading(200, up, 200.04)])
    >>> found is not None and round(found.share, 9)
    0.0002
    """
    means = mean_corrections(readings)
    if len(means.targets) < LEAST_TARGETS:
        return None
    sums = [0.0, 0.0]
    for values in (means.forward, means.backward):
        points = [(x, -c) for x, c in zip(means.targets, values, strict=True) if c is not None]
        if len(points) < LEAST_TARGETS:
            continue
        middle, mean = fmean(x for x, _ in points), fmean(d for _, d in points)
        sums[0] += sum((x - middle) * (d - mean) for x, d in points)
        sums[1] += sum((x - middle) ** 2 for x, _ in points)
    return ScaleError(sums[0] / sums[1]) if sums[1] else None


def reliable_scale(survey: Survey, lead: float | None = None) -> ScaleError | None:
    """Return the linear part of readings that tell it: None where they span only a few turns of the screw.

    ``lead`` is the longest length after which the error may repeat, where one is told.
    """
    found = scale_of(survey.readings)
    if found is None or survey.units is Units.DEGREE:  # a turn is a turn
        return None
    made = abs(found.share) * survey.span
    is_reliable = not is_short(survey, lead) or made > survey.units.from_mm(NO_WAVE_MM)
    return found if is_reliable else None


def is_short(survey: Survey, lead: float | None = None) -> bool:
    """Whether readings span only a few turns of the screw."""
    period = survey.units.from_mm(USUAL_LEAD_MM) if lead is None else lead
    return survey.span < LEAST_TURNS * period * (1 - 1e-9)


def _one_reading(readings: Sequence[Reading]) -> str | None:
    """Say which reading makes a linear part large; None where all do.

    The median of the slopes between all means is no larger for a single one that is wrong.
    """
    usual: list[float] = []
    worst: tuple[float, Reading, float] | None = None
    for way in APPROACHES:
        of_way = [each for each in readings if each.direction is way]
        if len({each.target for each in of_way}) < LEAST_TARGETS:
            continue
        means = mean_corrections(of_way)
        curve = means.forward if way is Direction.FORWARD else means.backward
        points = [(x, -c) for x, c in zip(means.targets, curve, strict=True) if c is not None]
        slope = median((d1 - d0) / (x1 - x0) for (x0, d0), (x1, d1) in combinations(points, 2))
        offset = median(d - slope * x for x, d in points)
        usual.append(slope)
        for each in of_way:
            away = abs(each.deviation - offset - slope * each.target)
            if worst is None or away > worst[0]:
                worst = (away, each, offset + slope * each.target)
    if worst is None or abs(median(usual)) > MOST:
        return None
    _, each, expected = worst
    return (
        f"the readings together rise by more than 0.3 mm/m, but most of them by "
        f"{median(usual) * _PER_METRE_UM:+.4g} µm/m: {each.measured:.9g} at target {each.target:.9g}, "
        f"{each.direction.name.lower()}, is {each.deviation:+.6g} away, where the others lead to "
        f"{expected:+.4g}. A digit slipped? Correct it, or measure there again; --keep-scale makes the table "
        "all the same"
    )


def check_scale(survey: Survey, counts_per_unit: float | None = None, lead: float | None = None) -> None:
    """Check that readings are of a screw and not of a wrong scale; ``lead`` as in :func:`reliable_scale`.

    Raises:
        ReadingsError: the linear part is larger than 0.3 mm/m, of all readings or because of a single one.
    """
    found = reliable_scale(survey, lead)
    if found is not None and found.is_large:
        if (fault := _one_reading(survey.readings)) is not None:
            raise ReadingsError(f"{survey.source}: {fault}")
        raise ReadingsError(
            f"{survey.source}: {found.describe(counts_per_unit)}. More than 0.3 mm/m is no screw but a wrong "
            "scale: put it right first and measure again, or --keep-scale where the screw is really so long "
            "or short"
        )
