"""The uncertainty of A, and whether A keeps a limit: a budget like ISO/TR 230-9 (ISO 230-2, annex A).

Each contribution is an expanded uncertainty with k = 2. For a value known to be in a range R it is ``0.6 R``
(twice the standard deviation of a rectangular distribution, R / sqrt(12), which is 0.577 R)::

    instrument      from its certificate, for the length
    alignment       0.6 h² / (2 L): the beam or scale leaves the axis by h over the length L (cosine)
    temperature     0.6 a L R(T): the screw or machine is known to within R(T)
    expansion       0.6 |T - 20| L R(a): the coefficient is known to within R(a)
    environment     0.6 E: the change in an hour of a drift test (table drift)
    repeatability   2 s / sqrt(n): of the mean at the target with the largest s

They are added as squares. A limit is kept if A + U is within it, not kept if A - U exceeds it (the rule of
ISO 14253-1), and undecided between. Source: each is derived as written here. The published scope of ISO 230-2
says that it requires such a budget. The standards themselves were not available.
"""

from dataclasses import dataclass
from math import hypot, isfinite, sqrt
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation
from gateway.metrology.readings import small_unit
from gateway.plain import JsonObject

RANGE: Final = 0.6
"""Of a range: its expanded uncertainty."""


@dataclass(frozen=True, slots=True)
class UncertaintyInputs:
    """Known facts beside the readings; lengths in their units, temperatures in kelvin."""

    instrument: float = 0.0
    misalignment: float = 0.0
    temperature_range: float = 0.0
    expansion: float = 11.5e-6
    """Per kelvin."""
    expansion_range: float = 0.0
    off_20: float = 0.0
    """Distance of the temperature from 20 °C."""
    environment: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ReadingsError: one is below 0 or not a number.
        """
        for name in self.__slots__:
            number = getattr(self, name)
            if not (isfinite(number) and number >= 0.0):
                raise ReadingsError(f"uncertainty: {name.replace('_', ' ')} {number:g}: it must be 0 or more")


@dataclass(frozen=True, slots=True)
class UncertaintyBudget:
    """The contributions by name, and their sum; expanded, k = 2."""

    parts: tuple[tuple[str, float], ...]

    @property
    def expanded(self) -> float:
        """U."""
        return hypot(*(part for _, part in self.parts))


def growing_parts(inputs: UncertaintyInputs, length: float) -> tuple[tuple[str, float], ...]:
    """Return the contributions that grow from 0 at home to these over a length; expanded, k = 2."""
    cosine = inputs.misalignment**2 / (2 * length) if length else 0.0
    return (
        ("instrument", inputs.instrument),
        ("alignment", RANGE * cosine),
        ("temperature", RANGE * inputs.expansion * length * inputs.temperature_range),
        ("expansion", RANGE * inputs.off_20 * length * inputs.expansion_range),
    )


def budget_of(found: Evaluation, inputs: UncertaintyInputs) -> UncertaintyBudget:
    """Return the budget of A for the measured length."""
    length = found.targets[-1].target - found.targets[0].target
    approaches = [way for each in found.targets for way in (each.forward, each.backward) if way is not None]
    means = [2 * way.s / sqrt(len(way.deviations)) for way in approaches if way.s is not None]
    return UncertaintyBudget(
        (
            *growing_parts(inputs, length),
            ("environment", RANGE * inputs.environment),
            ("repeatability", max(means, default=0.0)),
        )
    )


def verdict(value: float, expanded: float, limit: float) -> str:
    """Return whether a limit is kept.

    >>> verdict(8.0, 1.5, 10.0), verdict(9.0, 1.5, 10.0), verdict(12.0, 1.5, 10.0)
    ('kept', 'undecided', 'not kept')
    """
    if value + expanded <= limit:
        return "kept"
    return "not kept" if value - expanded > limit else "undecided"


def inputs_of(
    units: Units, instrument_um: float, misalignment_mm: float, temperature: float, environment_um: float
) -> UncertaintyInputs:
    """Return the given values, in the units of the readings.

    Raises:
        ReadingsError: a number below 0.
    """
    factor = small_unit(units).factor
    return UncertaintyInputs(
        instrument=instrument_um / factor,
        misalignment=units.from_mm(misalignment_mm),
        temperature_range=temperature,
        environment=environment_um / factor,
    )


def limit_line(found: Evaluation, budget: UncertaintyBudget, limit_um: float) -> str:
    """Return whether A keeps a limit, with the budget.

    Raises:
        ReadingsError: the readings give no A, or the limit is not above 0.
    """
    small = small_unit(found.units)
    parts = ", ".join(f"{name} {small.text(part)}" for name, part in budget.parts if part)
    accuracy = _accuracy(found, limit_um)
    text = verdict(accuracy, budget.expanded, limit_um / small.factor)
    return (
        f"A = {small.text(accuracy)} with U = {small.text(budget.expanded)} (k = 2; {parts}): the limit of "
        f"{limit_um:g} {small.name} is {text}"
    )


def limit_json(found: Evaluation, budget: UncertaintyBudget, limit_um: float) -> JsonObject:
    """Return the same as plain data. Raises ReadingsError: see :func:`limit_line`."""
    small = small_unit(found.units)
    accuracy = _accuracy(found, limit_um)
    return {
        f"limit_{small.key}": limit_um,
        f"a_{small.key}": accuracy * small.factor,
        f"u_{small.key}": budget.expanded * small.factor,
        "parts": {name: part * small.factor for name, part in budget.parts},
        "verdict": verdict(accuracy, budget.expanded, limit_um / small.factor),
    }


def _accuracy(found: Evaluation, limit_um: float) -> float:
    if not limit_um > 0.0:
        raise ReadingsError(f"--limit {limit_um:g}: it must be above 0")
    if found.accuracy is None:
        raise ReadingsError(
            "--limit: these readings give no A of both directions: measure two runs, from both sides at "
            "every target"
        )
    return found.accuracy
