"""Drift: readings that grow or move with the number of the run, as when the machine warms up.

At each target and in each direction the runs are compared with their mean. The common part is a shift for
each run (``offset``) and a stretch for each run that grows with the position (``growth``). Both are fitted by
least squares over the number of the run; the way back counts as half a run later than the way there.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from statistics import fmean
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import evaluate
from gateway.metrology.readings import Reading, Small, Survey, by_approach, small_unit

STEEL: Final = 11.5
"""µm a metre and kelvin: the usual material of screws."""
LEAST_RUNS: Final = 3
CLEAR: Final = 4.0
"""A slope this many standard deviations from 0 is not chance: sound data has it once in ten thousand."""
LEAST_MM: Final = 0.0005
"""Over all targets and runs: a smaller drift does not matter."""
REFERENCE_C: Final = 20.0
MOST_EXPANSION: Final = 100.0
_PER_METRE_UM: Final = 1e6
_NUMBER: Final = re.compile(r"-?[0-9]+(?:\.[0-9]+)?")


@dataclass(frozen=True, slots=True)
class Drift:
    """The change from the first run to the last. Lengths in the units of the readings."""

    growth: float
    """Change of length by length."""
    offset: float
    """Shift at ``fixed_at``."""
    fixed_at: float
    """Lowest target."""
    length: float
    is_growing: bool
    is_shifting: bool

    @property
    def kelvin_of_steel(self) -> float:
        """The temperature rise of a steel screw that would explain the growth."""
        return self.growth * _PER_METRE_UM / STEEL

    def describe(self, small: Small) -> str:
        """Return in words what grows and what moves."""
        parts = []
        if self.is_growing:
            parts.append(
                f"{self.growth * _PER_METRE_UM:+.3g} µm/m over the runs, as steel grows in "
                f"{self.kelvin_of_steel:+.2g} K"
            )
        if self.is_shifting:
            parts.append(
                f"{self.offset * small.factor:+.3g} {small.name} over the runs at {self.fixed_at:.9g}"
            )
        return " and ".join(parts)


def drift_of(survey: Survey) -> Drift | None:
    """Return the common drift of the runs; None if it is chance, too small, or cannot be determined."""
    rows = _rows(survey.readings)
    runs = {each.run for each in survey.readings}
    if len(runs) < LEAST_RUNS or len(rows) < 2 * LEAST_RUNS:
        return None
    targets = survey.targets
    low, high = targets[0], targets[-1]
    found = _fit([(time, position - low, rest) for time, position, rest in rows])
    if found is None:
        return None
    (offset, growth), (offset_s, growth_s) = found
    last = max(runs) - min(runs)
    least = survey.units.from_mm(LEAST_MM)
    drift = Drift(
        growth * last,
        offset * last,
        low,
        high - low,
        is_growing=abs(growth) > CLEAR * growth_s and abs(growth * last * (high - low)) > least,
        is_shifting=abs(offset) > CLEAR * offset_s and abs(offset * last) > least,
    )
    return drift if drift.is_growing or drift.is_shifting else None


def _time(reading: Reading) -> float:
    return reading.run + (0.5 if reading.direction is Direction.BACKWARD else 0.0)


def _rows(readings: Sequence[Reading]) -> list[tuple[float, float, float]]:
    """Return time, position and rest of each reading, all less their means at the target and direction."""
    rows = []
    for group in by_approach(readings).values():
        if len(group) < 2:
            continue
        mean, middle = fmean(each.deviation for each in group), fmean(_time(each) for each in group)
        rows += [(_time(each) - middle, each.target, each.deviation - mean) for each in group]
    return rows


def _fit(
    rows: Sequence[tuple[float, float, float]],
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Fit ``rest = (offset + growth * position) * time``; return both, and their standard deviations."""
    a = sum(t * t for t, _, _ in rows)
    b = sum(t * t * x for t, x, _ in rows)
    c = sum(t * t * x * x for t, x, _ in rows)
    p = sum(t * d for t, _, d in rows)
    q = sum(t * x * d for t, x, d in rows)
    determinant = a * c - b * b
    if determinant <= 1e-12 * a * c:
        return None
    offset, growth = (p * c - q * b) / determinant, (q * a - p * b) / determinant
    left = sum((d - (offset + growth * x) * t) ** 2 for t, x, d in rows)
    variance = left / max(len(rows) - 2, 1)
    return (offset, growth), (sqrt(variance * c / determinant), sqrt(variance * a / determinant))


def without_drift(survey: Survey, drift: Drift) -> Survey:
    """Return the readings without the change since the first run."""
    runs = [each.run for each in survey.readings]
    first, last = min(runs), max(runs)
    steady = []
    for each in survey.readings:
        share = (_time(each) - first) / (last - first)
        moved = drift.offset + drift.growth * (each.target - drift.fixed_at)
        steady.append(replace(each, measured=each.measured - share * moved))
    return replace(survey, readings=tuple(steady))


def e_with_and_without(survey: Survey, drift: Drift) -> tuple[float, float]:
    """Return E as measured, and E without the change since the first run, in the units of the readings."""
    return _systematic(survey), _systematic(without_drift(survey, drift))


def drift_line(survey: Survey, drift: Drift) -> str:
    """Return in words what drifts, with E as measured and E without the drift."""
    small = small_unit(survey.units)
    was, steady = e_with_and_without(survey, drift)
    return (
        f"the readings drift: {drift.describe(small)}. E is {small.text(was)} with the drift, "
        f"{small.text(steady)} without. Warm up the axis and measure again, or measure faster"
    )


def _systematic(survey: Survey) -> float:
    found = evaluate(survey)
    every = (found.systematic, found.systematic_forward, found.systematic_backward)
    return next(each for each in every if each is not None)


def at_20_degrees(survey: Survey, expansion_um: float) -> Survey:
    """Return the readings at 20 °C, for a screw that grows by ``expansion_um`` µm a metre and kelvin.

    Each reading has its temperature, or a line ``# temperature: 23.1`` gives one for all. The expanding
    length begins at machine position 0.

    Raises:
        ReadingsError: a reading without a temperature, a coefficient that no material has, or an angle.
    """
    if survey.units is Units.DEGREE:
        raise ReadingsError(f"{survey.source}: remove --to-20c: an angle does not grow with temperature")
    if not 0.0 < expansion_um < MOST_EXPANSION:
        raise ReadingsError(
            f"--to-20c {expansion_um:g}: it must be above 0 and below {MOST_EXPANSION:g} µm per metre and "
            "kelvin; steel has 11.5"
        )
    stated = _stated(survey)
    cold = []
    for each in survey.readings:
        warm = stated if each.temperature_c is None else each.temperature_c
        if warm is None:
            raise ReadingsError(
                f"{survey.source}: no temperature at {each.target:.9g}, run {each.run}: add a column "
                "temperature_c, or a line # temperature: 23.1 for all, or remove --to-20c"
            )
        grown = expansion_um / _PER_METRE_UM * (warm - REFERENCE_C) * each.target
        cold.append(replace(each, measured=each.measured - grown))
    return replace(
        survey,
        readings=tuple(cold),
        facts={**survey.facts, "normalised to 20 °C": f"with {expansion_um:g} µm per metre and kelvin"},
        remarks=(
            *survey.remarks,
            f"normalised to 20 °C with {expansion_um:g} µm per metre and kelvin, from machine position 0",
        ),
    )


def _stated(survey: Survey) -> float | None:
    """Return the temperature that a file states for all its readings."""
    for name, fact in survey.facts.items():
        if name.strip().lower() in {"temperature", "temperature_c", "material temperature"}:
            found = _NUMBER.search(fact)
            if found is None or "f" in fact.lower():
                raise ReadingsError(
                    f"{survey.source}: # {name}: {fact}: give a number in °C, as in # temperature: 23.1"
                )
            return float(found[0])
    return None
