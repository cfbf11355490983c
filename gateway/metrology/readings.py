"""What an instrument measured: the raw material of a table."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from statistics import fmean

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError

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

    @property
    def deviation(self) -> float:
        """Measured less target: positive where the nut went too far (ISO 230-2 clause 3)."""
        return self.measured - self.target


@dataclass(frozen=True, slots=True)
class Survey:
    """All readings of one axis in one set-up, in the order in which they were taken.

    ``facts`` says what the instrument's file tells beside the readings: machine, serial number, date,
    temperature, by the names that the file uses. ``source`` is the file, or what took the readings.
    """

    readings: tuple[Reading, ...]
    units: Units
    axis: str | None = None
    source: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)


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
