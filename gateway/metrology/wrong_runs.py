"""Runs that are wrong as a whole: directions swapped, sign reversed, or the instrument moved in between.

A run is compared with the median of the other runs at each target and direction. If it fits them far better
with its directions exchanged, or with its sign reversed, that is its fault; such readings make no table. A
run with a constant distance from all others does not change the table, because home is subtracted from it.
But the scatter of the readings, and so what a table leaves, is unknown until a person gives the reason.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from statistics import fmean, median
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.drift import drift_of, without_drift
from gateway.metrology.errors import ReadingsError
from gateway.metrology.readings import APPROACHES, Reading, Survey, small_unit

CLEARLY: Final = 3.0
"""A run must fit the others this many times better without its fault."""
LEAST_MM: Final = 0.002
"""A run that is nearer to the others is not a wrong one."""
LEAST_READINGS: Final = 4
"""Of a run: fewer readings do not represent all of it."""
WIDER: Final = 2.0
"""A run is offset if its distance from the others exceeds this many times their differences."""
BEYOND_SCATTER: Final = 4.0


class RunFault(Enum):
    """The fault of a run."""

    SWAPPED = "directions swapped"
    INVERTED = "sign turned"
    OFFSET = "aside"

    @property
    def is_mistake(self) -> bool:
        """Whether no machine behaves so: the readings are wrong as written."""
        return self is not RunFault.OFFSET


@dataclass(frozen=True, slots=True)
class WrongRun:
    """A run that is wrong as a whole."""

    run: int
    fault: RunFault
    away: float
    """Its distance from the others, in the units of the readings; with its sign for ``OFFSET``."""
    fits: float = 0.0
    """Its distance without the fault."""
    other: int | None = None
    """With two runs it is unknown which of them is wrong."""

    @property
    def named(self) -> str:
        """Return the name of the run."""
        return f"run {self.run}" if self.other is None else f"run {self.run} or run {self.other}"

    def describe(self, units: Units) -> str:
        """Return it in a few words.

        >>> WrongRun(3, RunFault.OFFSET, 0.005).describe(Units.MM)
        'run 3: 5.00 µm beside the other runs'
        """
        small = small_unit(units)
        if self.fault is RunFault.OFFSET:
            return f"{self.named}: {small.text(abs(self.away))} beside the other runs"
        return (
            f"{self.named}: {self.fault.value} ({small.text(self.away)} from the other runs now, "
            f"{small.text(self.fits)} after this correction)"
        )


def wrong_runs(survey: Survey) -> tuple[WrongRun, ...]:
    """Return the runs that are wrong as a whole, in order."""
    mistaken = _mistaken(survey)
    sound = without_runs(survey, mistaken)
    offset_runs = _offset_runs(sound)
    if not offset_runs and (drift := drift_of(sound)) is not None:
        offset_runs = _offset_runs(without_drift(sound, drift))
    return tuple(sorted([*mistaken, *offset_runs], key=lambda each: each.run))


def without_runs(survey: Survey, wrong: Iterable[WrongRun]) -> Survey:
    """Return the readings of the other runs."""
    left_out = {each.run for each in wrong}
    return replace(survey, readings=tuple(each for each in survey.readings if each.run not in left_out))


def settled(survey: Survey, *, drop: bool = False) -> Survey:
    """Return readings without a mistake of a whole run; with ``drop`` all wrong runs are omitted.

    Raises:
        ReadingsError: a run with swapped directions or reversed sign, unless it is omitted.
    """
    wrong = wrong_runs(survey)
    mistaken = [each for each in wrong if each.fault.is_mistake]
    is_open = any(each.other is not None for each in mistaken)
    if mistaken and (is_open or not drop):
        text = "; ".join(each.describe(survey.units) for each in mistaken)
        remedy = "Correct this in the file, or measure again"
        if not is_open:
            remedy += "; table build --drop-outliers leaves this run out"
        raise ReadingsError(f"{survey.source}: {text}. {remedy}" if survey.source else f"{text}. {remedy}")
    if not drop or not wrong:
        return survey
    left_out = [f"left out: {each.describe(survey.units)}" for each in wrong]
    return replace(without_runs(survey, wrong), remarks=(*survey.remarks, *left_out))


def offset_notes(survey: Survey) -> list[str]:
    """Return the possible reason and the remedy for each offset run."""
    return [
        f"{each.describe(survey.units)}: the instrument moved or was set to 0 again, or the axis was "
        "colder or warmer. Measure again, or leave this run out (table build --drop-outliers)"
        for each in wrong_runs(survey)
        if each.fault is RunFault.OFFSET
    ]


_Point = tuple[float, Direction]


def _by_point(readings: Iterable[Reading]) -> dict[_Point, dict[int, Reading]]:
    points: dict[_Point, dict[int, Reading]] = {}
    for each in readings:
        points.setdefault((each.target, each.direction), {})[each.run] = each
    return points


def _deviation(each: Reading) -> float:
    return each.deviation


def _mistaken(survey: Survey) -> list[WrongRun]:
    points = _by_point(survey.readings)
    runs = sorted({each.run for each in survey.readings})
    least = survey.units.from_mm(LEAST_MM)
    found = []
    for run in runs:
        others = {
            point: median(each.deviation for number, each in group.items() if number != run)
            for point, group in points.items()
            if len(group) - (run in group) >= (2 if len(runs) > 2 else 1)
        }
        own = [group[run] for group in points.values() if run in group]
        away = _distance(own, others, _deviation)
        tries = [
            (_distance(own, _exchanged(others), _deviation), RunFault.SWAPPED),
            (_distance(own, others, lambda each: -each.deviation), RunFault.INVERTED),
            # An instrument that counts down.
            (_distance(own, others, lambda each: -each.measured - each.target), RunFault.INVERTED),
        ]
        tried = [(fits, fault) for fits, fault in tries if fits is not None]
        if away is None or not tried:
            continue
        fits, fault = min(tried, key=lambda each: each[0])
        if away > least and away > CLEARLY * fits:
            found.append(WrongRun(run, fault, away, fits))
    if len(runs) == 2 and found:
        return [replace(found[0], run=runs[0], other=runs[1])]
    return found


def _exchanged(others: Mapping[_Point, float]) -> dict[_Point, float]:
    up, down = APPROACHES
    return {(target, down if way is up else up): value for (target, way), value in others.items()}


def _distance(
    own: Sequence[Reading], others: Mapping[_Point, float], value: Callable[[Reading], float]
) -> float | None:
    """Return the mean distance from the others, without the offset of the run; None: too few readings."""
    rests = [
        value(each) - others[each.target, each.direction]
        for each in own
        if (each.target, each.direction) in others
    ]
    if len(rests) < LEAST_READINGS:
        return None
    middle = median(rests)
    return fmean(abs(rest - middle) for rest in rests)


def _offset_runs(survey: Survey) -> list[WrongRun]:
    rests: dict[int, list[float]] = {}
    for group in _by_point(survey.readings).values():
        if len(group) >= 3:
            middle = median(each.deviation for each in group.values())
            for run, each in group.items():
                rests.setdefault(run, []).append(each.deviation - middle)
    offsets = {run: median(each) for run, each in rests.items() if len(each) >= LEAST_READINGS}
    if len(offsets) < 3:
        return []
    scatter = fmean(abs(rest - offsets[run]) for run in offsets for rest in rests[run])
    found = []
    for run, offset in offsets.items():
        others = [each for number, each in offsets.items() if number != run]
        gap = max(min(others) - offset, offset - max(others))
        clear_gap = WIDER * (max(others) - min(others))
        if gap > max(survey.units.from_mm(LEAST_MM), clear_gap, BEYOND_SCATTER * scatter):
            found.append(WrongRun(run, RunFault.OFFSET, offset - median(others)))
    return found
