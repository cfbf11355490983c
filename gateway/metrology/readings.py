"""What an instrument measured: the raw material of a table."""

from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf, isfinite
from statistics import fmean, median
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.circumstances import check_together, is_same_axis
from gateway.metrology.errors import ReadingsError

NEAR: Final = 0.01
"""Targets nearer than this share of the usual distance are one target, written in two ways; of several files
it is the distance of the finest."""
APPROACHES = (Direction.FORWARD, Direction.BACKWARD)


@dataclass(frozen=True, slots=True)
class Reading:
    """One stop at a target, and where the instrument saw the nut: in machine units, from the same zero.

    ``run`` counts the passes over the targets, from 1, those of each direction for themselves.
    """

    target: float
    direction: Direction
    measured: float
    run: int = 1
    temperature_c: float | None = None
    """Of the screw or the machine when it was taken; None where nobody said."""

    @property
    def deviation(self) -> float:
        """Measured less target: positive where the nut went too far (ISO 230-2 clause 3)."""
        return self.measured - self.target


@dataclass(frozen=True, slots=True)
class Survey:
    """All readings of one axis in one set-up, in the order in which they were taken.

    ``facts`` says what the instrument's file tells beside the readings: machine, serial number, date,
    temperature, by the names that the file uses. ``source`` is the file, or what took the readings.
    ``remarks`` name what is odd about the readings but does not keep them from being used, with a remedy.
    """

    readings: tuple[Reading, ...]
    units: Units
    axis: str | None = None
    source: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def in_units(self, units: Units) -> "Survey":
        """Return the same readings in other units.

        Raises:
            ValueError: between a length and an angle.
        """
        if units is self.units:
            return self
        factor = self.units.convert_factor(units)
        readings = (
            replace(each, target=each.target * factor, measured=each.measured * factor)
            for each in self.readings
        )
        return replace(self, readings=tuple(readings), units=units)


@dataclass(frozen=True, slots=True)
class MeanCorrections:
    """Corrections at the measured targets, lowest target first; None where a direction has no reading."""

    targets: tuple[float, ...]
    forward: tuple[float | None, ...]
    backward: tuple[float | None, ...]


def mean_corrections(readings: Iterable[Reading]) -> MeanCorrections:
    """Mean of ``target - measured`` at each target, for each direction of approach.

    Raises:
        ReadingsError: no readings, a number that is not finite, or a reading without a direction.
    """
    found: dict[tuple[float, Direction], list[float]] = {}
    for number, reading in enumerate(readings, start=1):
        check_reading(reading, number)
        found.setdefault((reading.target, reading.direction), []).append(reading.target - reading.measured)
    if not found:
        raise ReadingsError("no readings: measure every target from both sides")
    targets = tuple(sorted({target for target, _ in found}))
    forward, backward = (
        tuple(fmean(found[target, way]) if (target, way) in found else None for target in targets)
        for way in APPROACHES
    )
    return MeanCorrections(targets, forward, backward)


def merged(surveys: Sequence[Survey]) -> Survey:
    """Return several surveys of one axis as one: the runs of each are counted on from those before.

    Raises:
        ReadingsError: no survey, other units, another axis, with a table and without, or one target that is
            written in two ways.
    """
    if not surveys:
        raise ReadingsError("no readings: name at least one file")
    first, *others = surveys
    readings = list(first.readings)
    usual = _usual_distance(first)
    for other in others:
        for what, one, two, is_same in (
            ("units", first.units.value, other.units.value, first.units is other.units),
            ("axis", first.axis, other.axis, is_same_axis(first.axis, other.axis)),
        ):
            if not is_same:
                raise ReadingsError(
                    f"{first.source} is of {what} {one}, {other.source} of {what} {two}: "
                    "only readings of one axis in one unit go together"
                )
        check_together(first.source, first.facts, other.source, other.facts)
        # A fine run of two turns lies beside a grid: its targets are nearer than those of the grid.
        usual = min(usual, _usual_distance(other))
        _check_targets(readings, other, NEAR * usual)
        runs = max((reading.run for reading in readings), default=0)
        readings.extend(replace(reading, run=reading.run + runs) for reading in other.readings)
    return replace(
        first,
        readings=tuple(readings),
        axis=next((survey.axis for survey in surveys if survey.axis is not None), None),
        source=", ".join(survey.source for survey in surveys),
        facts={key: fact for survey in reversed(surveys) for key, fact in survey.facts.items()},
        remarks=(*(remark for survey in surveys for remark in survey.remarks), *_doubled(surveys)),
    )


def _usual_distance(survey: Survey) -> float:
    """Return the median distance of neighbouring targets; infinity with one target."""
    targets = sorted({reading.target for reading in survey.readings})
    return median([high - low for low, high in pairwise(targets)] or [inf])


def _check_targets(readings: Sequence[Reading], other: Survey, nearer: float) -> None:
    """Check that no target of a further survey is one of those before, written in another way.

    Raises:
        ReadingsError: one lies beside another by less than ``nearer``.
    """
    targets = sorted({reading.target for reading in readings})
    for spelt in sorted({reading.target for reading in other.readings}):
        at = bisect_left(targets, spelt)
        for near in targets[max(at - 1, 0) : at + 1]:
            if 0.0 < abs(near - spelt) < nearer < inf:
                raise ReadingsError(
                    f"{other.source} has target {spelt:.9g}, which is {near:.9g} in the files before: "
                    "the same number for one target in all"
                )


def _doubled(surveys: Sequence[Survey]) -> list[str]:
    return [
        f"{other.source}: the same readings as {one.source}: if that is one measurement, name it once, or "
        "its scatter looks smaller than it is"
        for index, other in enumerate(surveys)
        for one in surveys[:index]
        if one.readings == other.readings
    ]


def check_reading(reading: Reading, number: int) -> None:
    """Check one reading; ``number`` counts from 1.

    Raises:
        ReadingsError: a number that is not finite, or no direction.
    """
    if not isfinite(reading.target) or not isfinite(reading.measured):
        raise ReadingsError(
            f"reading {number}: target {reading.target}, measured {reading.measured}: "
            "both must be finite numbers"
        )
    if reading.direction not in APPROACHES:
        raise ReadingsError(
            f"reading {number} at {reading.target:.9g}: direction {reading.direction.name.lower()}; "
            "it must be forward or backward, as the target was approached"
        )
