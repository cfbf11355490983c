"""A gauge block between an instrument and its stop: its length, and how well that is known.

The limits of the grades are those of ISO 3650 (as DIN 861 has them): the largest deviation of the length at
any point from the nominal length. A length within ±t is a rectangular distribution with the standard
uncertainty ``t / sqrt(3)``. A certificate gives the deviation, and its expanded uncertainty (k = 2).

A file of readings states it in comment lines, in µm::

    # block_grade: 1                   K, 0, 1, 2, or unknown: then the block shows no scale
    # block_deviation_um: 0.12         in place of a grade: actual less nominal length, from its certificate,
    # block_uncertainty_um: 0.10       and the uncertainty of that (k = 2)
    # block_temperature_range: 0.5     K, largest difference of the temperatures of block and axis
    # dial_error_um: 3                 limit of the error of the gauge over its range, from its data sheet
"""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import hypot, inf, isfinite, sqrt
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError

UM_PER_MM: Final = 1000.0
EXPANSION: Final = 11.5e-6
"""Per kelvin, of steel: for a difference of the temperatures of block and axis."""
COVERAGE: Final = 2.0
"""k of an expanded uncertainty."""
LENGTHS_MM: Final = (10, 25, 50, 75, 100, 150, 200, 250, 300, 400, 500, 600, 700, 800, 900, 1000)
"""Upper ends of the ranges of nominal lengths."""


class Grade(Enum):
    """The grade of a gauge block."""

    K = "k"
    ZERO = "0"
    ONE = "1"
    TWO = "2"
    UNKNOWN = "unknown"
    """Nothing is known about its length: it shows differences along the axis, and no scale."""


_ONE: Final = (0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.4, 1.8, 2.2, 2.6, 3.0, 3.4, 3.8, 4.2)
LIMITS_UM: Final = {
    Grade.K: _ONE,
    Grade.ZERO: (0.12, 0.14, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.9, 1.1, 1.3, 1.5, 1.7, 1.9, 2.0),
    Grade.ONE: _ONE,
    Grade.TWO: (0.45, 0.6, 0.8, 1.0, 1.2, 1.6, 2.0, 2.4, 2.8, 3.6, 4.4, 5.0, 6.0, 6.5, 7.5, 8.0),
}
"""Largest deviation of each range of lengths."""


@dataclass(frozen=True, slots=True)
class Standard:
    """What is known about the blocks of a walk, and about the gauge. Lengths in µm, temperatures in kelvin.

    ``uncertainty_um`` is expanded (k = 2) and excludes a grade.

    Raises:
        ReadingsError: a number below 0, a grade and an uncertainty, or neither.
    """

    grade: Grade | None = None
    deviation_um: float = 0.0
    uncertainty_um: float | None = None
    temperature_range: float = 0.0
    dial_error_um: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("uncertainty_um", "temperature_range", "dial_error_um"):
            number = getattr(self, name)
            if number is not None and not (isfinite(number) and number >= 0.0):
                raise ReadingsError(f"{KEYS[name]} {number:g}: it must be 0 or more")
        if not isfinite(self.deviation_um):
            raise ReadingsError(f"{KEYS['deviation_um']} {self.deviation_um:g}: it must be a finite number")
        if (self.grade is None) == (self.uncertainty_um is None):
            raise ReadingsError(
                "the block: give either its grade (block_grade: K, 0, 1, 2, or unknown), or from its "
                "certificate block_deviation_um and block_uncertainty_um"
            )

    @property
    def is_length_known(self) -> bool:
        """Whether it shows a scale."""
        return self.grade is not Grade.UNKNOWN

    def uncertainty_of(self, length_mm: float) -> float:
        """Return the standard uncertainty of a block's length, in mm; infinity for an unknown length.

        >>> round(Standard(Grade.ONE).uncertainty_of(50.0) * 1000 * 3**0.5, 6)
        0.4
        """
        if not self.is_length_known:
            return inf
        if self.uncertainty_um is not None:
            own = self.uncertainty_um / COVERAGE
        else:
            assert self.grade is not None, "one of both is given"
            own = limit_um(self.grade, length_mm) / sqrt(3.0)
        warmth = EXPANSION * self.temperature_range * length_mm * UM_PER_MM / sqrt(3.0)
        return hypot(own, warmth) / UM_PER_MM

    def describe(self) -> str:
        """Return it in words.

        >>> Standard(Grade.ONE).describe(), Standard(None, 0.12, 0.1).describe()
        ('grade 1', '+0.12 µm ± 0.1 µm by its certificate')
        """
        if self.grade is Grade.UNKNOWN:
            return "of unknown length"
        if self.grade is not None:
            return f"grade {self.grade.value.upper()}"
        return f"{self.deviation_um:+g} µm ± {self.uncertainty_um:g} µm by its certificate"

    def facts(self) -> dict[str, str]:
        """Return the lines of a file of readings."""
        numbers = {
            "deviation_um": self.deviation_um or None,
            "uncertainty_um": self.uncertainty_um,
            "temperature_range": self.temperature_range or None,
            "dial_error_um": self.dial_error_um or None,
        }
        found = {} if self.grade is None else {GRADE: self.grade.value}
        return found | {KEYS[name]: f"{value:g}" for name, value in numbers.items() if value is not None}


GRADE: Final = "block_grade"
KEYS: Final = {
    "deviation_um": "block_deviation_um",
    "uncertainty_um": "block_uncertainty_um",
    "temperature_range": "block_temperature_range",
    "dial_error_um": "dial_error_um",
}
"""The keys in a file of readings, by field."""


def limit_um(grade: Grade, length_mm: float) -> float:
    """Return the largest deviation that a grade allows a block, in µm; ISO 3650.

    >>> limit_um(Grade.TWO, 50.0), limit_um(Grade.ZERO, 25.4)
    (0.8, 0.2)
    """
    limits = LIMITS_UM[grade]
    return limits[min(bisect_left(LENGTHS_MM, length_mm), len(limits) - 1)]


def standard_of(facts: Mapping[str, str]) -> Standard:
    """Return the standard that the facts of a file state.

    Raises:
        ReadingsError: a value that is not allowed, or nothing about the block's length.
    """
    grade = None
    if (stated := facts.get(GRADE)) is not None:
        try:
            grade = Grade(stated.strip().lower())
        except ValueError:
            raise ReadingsError(
                f"# {GRADE}: {stated}: allowed are K, 0, 1, 2, and unknown; it is on the block's box"
            ) from None
    numbers: dict[str, float] = {}
    for field, key in KEYS.items():
        if (stated := facts.get(key)) is not None:
            try:
                numbers[field] = float(stated)
            except ValueError:
                raise ReadingsError(f"# {key}: {stated}: it must be a number, as in # {key}: 0.1") from None
    return Standard(grade, **numbers)


def in_mm(length: float, units: Units) -> float:
    """Return a length of an axis in mm."""
    return length / units.from_mm(1.0)
