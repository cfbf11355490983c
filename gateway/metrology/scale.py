"""The linear part of an error: a scale, which belongs into ``counts_per_unit``, not into a table.

TB058 requires a check of the revolutions per unit before any table is made. A wrong scale in a table needs
corrections up to the whole error, and a wrong drive ratio looks like a bad screw.
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
from gateway.metrology.standard import GRADE, Grade

MOST: Final = 3e-4
"""0.3 mm/m: more is not a screw error but a wrong scale; the user must correct it first."""
LEAST_TARGETS: Final = 3
LEAST_TURNS: Final = 10
"""Over fewer revolutions of the screw, a repeating error has a slope itself."""
USUAL_LEAD_MM: Final = 5.0
"""Assumed for a screw without a given lead."""
NO_WAVE_MM: Final = 0.1
"""A larger linear part, from the first target to the last, is not from a revolution."""
_PER_METRE_UM: Final = 1e6
TRIAL_MOVE: Final = {Units.MM: 1.0, Units.INCH: 0.05, Units.DEGREE: 1.0}
"""A move that does no harm if it becomes ten times as long."""
ROUGHLY: Final = 0.2
"""Tolerance of a trial move, as a share: lost motion, and a rule read by eye."""
LEAST_MOVED: Final = 1e-6
"""Share of a trial move: less is no move."""


@dataclass(frozen=True, slots=True)
class ScaleError:
    """``share``: excess of the nut's motion, as a share of the distance; positive if it goes too far."""

    share: float

    @property
    def counts_factor(self) -> float:
        """The factor for ``counts_per_unit``: a nut that goes too far needs fewer counts."""
        return 1.0 / (1.0 + self.share)

    @property
    def is_large(self) -> bool:
        """Whether the scale must be corrected before a table is made."""
        return abs(self.share) > MOST

    def describe(self, counts_per_unit: float | None = None) -> str:
        """Return it as a sentence.

        >>> ScaleError(0.00025).describe(1000.0)
        'linear part +250 µm/m: counts_per_unit 999.750062 instead of 1000 would remove it'
        """
        text = f"linear part {self.share * _PER_METRE_UM:+.4g} µm/m: counts_per_unit "
        if counts_per_unit is None:
            return f"{text}times {self.counts_factor:.8f} would remove it"
        right = counts_per_unit * self.counts_factor
        return f"{text}{right:.9g} instead of {counts_per_unit:.9g} would remove it"


def fault_of_trial(moved: float, counts_per_unit: float, units: Units) -> str:
    """Return the fault of an axis that moved by ``moved`` at a command of :data:`TRIAL_MOVE`.

    "" if its scale has the right size and sign; the last digits are for a table and its linear part.

    Raises:
        ReadingsError: it is not a finite number.

    >>> fault_of_trial(10.0, 1000.0, Units.MM)
    'it moved by 10 mm, not by 1 mm: counts_per_unit should be about 100, not 1000'
    >>> fault_of_trial(-0.98, 1000.0, Units.MM)
    'it moved by -0.98 mm, not by 1 mm: change the sign of counts_per_unit: -1000'
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
        return (
            f"{text}: check that the drive is enabled, and that counts_per_unit, "
            f"{counts_per_unit:.9g}, is large enough"
        )
    if abs(ratio + 1.0) <= ROUGHLY:
        return f"{text}: change the sign of counts_per_unit: {-counts_per_unit:.9g}"
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
    """Return the linear part, or None if the readings span only a few revolutions of the screw.

    Readings over a block of unknown length have none. ``lead`` is the longest possible period of the error,
    if given.
    """
    found = scale_of(survey.readings)
    if found is None or survey.units is Units.DEGREE:  # a revolution needs no scale
        return None
    if survey.facts.get(GRADE, "").lower() == Grade.UNKNOWN.value:
        return None
    made = abs(found.share) * survey.span
    is_reliable = not is_short(survey, lead) or made > survey.units.from_mm(NO_WAVE_MM)
    return found if is_reliable else None


def is_short(survey: Survey, lead: float | None = None) -> bool:
    """Whether readings span only a few revolutions of the screw."""
    period = survey.units.from_mm(USUAL_LEAD_MM) if lead is None else lead
    return survey.span < LEAST_TURNS * period * (1 - 1e-9)


def _one_reading(readings: Sequence[Reading]) -> str | None:
    """Return the reading that makes a linear part large; None if all do.

    A single wrong reading does not change the median of the slopes between all means by much.
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
        f"check {each.measured:.9g} at target {each.target:.9g}, {each.direction.name.lower()}, for a "
        f"wrong digit and correct it, or measure there again: it is {each.deviation:+.6g} away, but the "
        f"others lead to {expected:+.4g}. All readings together rise by more than 0.3 mm/m, but most of "
        f"them by {median(usual) * _PER_METRE_UM:+.4g} µm/m. --keep-scale makes the table anyway"
    )


def check_scale(survey: Survey, counts_per_unit: float | None = None, lead: float | None = None) -> None:
    """Check that readings show a screw and not a wrong scale; ``lead`` as in :func:`reliable_scale`.

    Raises:
        ReadingsError: the linear part is larger than 0.3 mm/m, in all readings or because of a single one.
    """
    found = reliable_scale(survey, lead)
    if found is not None and found.is_large:
        if (fault := _one_reading(survey.readings)) is not None:
            raise ReadingsError(f"{survey.source}: {fault}")
        raise ReadingsError(
            f"{survey.source}: {found.describe(counts_per_unit)}. More than 0.3 mm/m is a wrong scale, not "
            "a screw error: correct it first and measure again, or give --keep-scale if the screw is "
            "really so long or short"
        )
