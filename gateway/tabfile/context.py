"""What a reader is told: the options of the file, and facts about its axis."""

import re
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Final

from gateway.compensation.settings import DEFAULT_MAX_SLOPE, default_max_correction
from gateway.compensation.units import Units
from gateway.tabfile.errors import ContextError
from gateway.tabfile.options import COUNTS_PER_UNIT, DECLARED, MAX_POSITION, Quantity, TableOptions

_LIMIT: Final = Quantity("positive", lambda limit: 0 < limit < inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileContext(TableOptions):
    """Facts about the axis and about the old control that wrote the file. None: not known.

    Every length is in ``units``, the machine units of the axis, and every scale in counts per that unit. With
    ``units`` None they are in the units that the file states. ``told_in`` are the units in which they were
    told, where :meth:`in_units` has turned them into others: messages that name an option go by these.

    ``counts_per_unit`` belongs to the drive that is commanded now. With ``same_units`` a file in other units
    than ``units`` is refused; otherwise lengths are converted.

    Raises:
        ContextError: a travel whose ends are not in order, a scale of 0, a slope of 1 or more (which cannot
            be read back), an axis that is no letter, a number that is not finite.
    """

    axis: str | None = None
    units: Units | None = None
    travel: tuple[float, float] | None = None
    counts_per_unit: float | None = None
    max_correction: float | None = None
    max_slope: float = DEFAULT_MAX_SLOPE
    same_units: bool = False
    told_in: Units | None = None

    def __post_init__(self) -> None:
        """Check what can be checked without a file."""
        for name, fact in self.told().items():
            if (quantity := DECLARED[name].quantity) is not None:
                _check(name, fact, quantity)
        _check("counts_per_unit", self.counts_per_unit, COUNTS_PER_UNIT)
        _check("max_correction", self.max_correction, _LIMIT)
        if not 0 < self.max_slope < 1:
            raise ContextError(f"max_slope is {self.max_slope}: it must be above 0 and below 1")
        if self.axis is not None and not re.fullmatch("[A-Za-z]", self.axis):
            raise ContextError(f"axis is {self.axis!r}: it must be one letter, A to Z")
        if self.travel is not None and not -MAX_POSITION < self.travel[0] < self.travel[1] < MAX_POSITION:
            raise ContextError(f"travel is {list(self.travel)}: it must be [lowest, highest], in this order")

    def in_units(self, file_units: Units) -> "FileContext":
        """Return the same facts in the units of a file.

        Raises:
            ValueError: between a length and an angle.
        """
        if self.units is None or self.units is file_units:
            return replace(self, units=file_units, told_in=self.told_in or file_units)
        factor = self.units.convert_factor(file_units)
        options: dict[str, Any] = {
            name: quantity.converted(fact, factor)
            for name, fact in self.told().items()
            if (quantity := DECLARED[name].quantity) is not None
        }
        return replace(
            self,
            **options,
            units=file_units,
            told_in=self.told_in or self.units,
            travel=None if self.travel is None else (self.travel[0] * factor, self.travel[1] * factor),
            max_correction=None if self.max_correction is None else self.max_correction * factor,
            counts_per_unit=None if self.counts_per_unit is None else self.counts_per_unit / factor,
        )

    def option_units(self, file_units: Units) -> Units:
        """Units in which lengths and scales have to be told, for a file in ``file_units``."""
        return self.told_in or self.units or file_units

    def as_told(self, length: float) -> float:
        """Return a length in ``units`` as an option has to say it."""
        return (
            length
            if self.units is None
            else length * self.units.convert_factor(self.option_units(self.units))
        )

    def correction_limit(self, units: Units, span: float) -> float:
        """Largest |correction| that is allowed, in ``units`` (those of this context).

        ``span`` is the length of the table; the travel, where it is told, counts instead.
        """
        if self.max_correction is not None:
            return self.max_correction
        return default_max_correction(units, self.length(span))

    def length(self, span: float) -> float:
        """Length of the axis, as far as it is known."""
        return span if self.travel is None else self.travel[1] - self.travel[0]


def _check(name: str, number: float | None, quantity: Quantity) -> None:
    if number is not None:
        try:
            quantity.check(number)
        except ValueError as error:
            raise ContextError(f"{name} is {number}: {error}") from None
