"""What a file does not say about itself and its axis, told from outside."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from math import inf
from typing import Final

from gateway.compensation.settings import DEFAULT_MAX_SLOPE, default_max_correction
from gateway.compensation.units import Units
from gateway.tabfile.errors import ContextError

MIN_SCALE: Final = 1e-6
MAX_SCALE: Final = 1e12
MAX_POSITION: Final = 1e9
"""Bounds of what can be a machine: beyond them a number is a slip, and sums would lose their digits."""


class V1Layout(Enum):
    """Whether the first value of a version 1 file belongs to home or to the first point away from it."""

    LISTED = "listed"
    IMPLICIT = "implicit"


class HomeSide(Enum):
    """The end of travel at which the axis homes; the rest of its travel lies on the other side of 0."""

    PLUS = "plus"
    MINUS = "minus"


class ErrorSense(Enum):
    """What a file means by an error: where the nut was less where it should be, or the reverse."""

    ACTUAL_MINUS_COMMAND = "actual_minus_command"
    COMMAND_MINUS_ACTUAL = "command_minus_actual"

    @property
    def to_correction(self) -> float:
        """Factor that turns an error of this sense into the amount to add.

        >>> ErrorSense.ACTUAL_MINUS_COMMAND.to_correction
        -1.0
        """
        return -1.0 if self is ErrorSense.ACTUAL_MINUS_COMMAND else 1.0


@dataclass(frozen=True, slots=True)
class FileContext:
    """Facts about the axis and about the old control that wrote the file. None: not known.

    Every length is in ``units``, the machine units of the axis, and every scale in counts per that unit. With
    ``units`` None they are in the units that the file states. ``told_in`` are the units in which they were
    told, where :meth:`in_units` has turned them into others: messages that name an option go by these.

    ``file_counts_per_unit`` belongs to the OLD control (encoder counts per revolution x revolutions per unit,
    negative where its Dir Rev was Y), ``counts_per_unit`` to the drive that is commanded now. ``format``
    names the dialect where the text fits several; ``file_units`` are those of a file that states none;
    ``file_axis`` is what a file that holds several axes calls this one; ``increment`` is the distance of the
    points of a program that does not set it; ``error_sense`` holds for every
    format whose errors have no fixed sense, ``fagor_sense`` and ``isg_sense`` for one each. With
    ``same_units`` a file in other units than ``units`` is refused; otherwise lengths are converted.

    Raises:
        ContextError: a travel whose ends are not in order, a scale of 0, a slope of 1 or more (which cannot
            be read back), an axis that is no letter, a number that is not finite.
    """

    axis: str | None = None
    units: Units | None = None
    travel: tuple[float, float] | None = None
    file_counts_per_unit: float | None = None
    v1_layout: V1Layout | None = None
    file_start: float | None = None
    increment: float | None = None
    file_home: HomeSide | None = None
    counts_per_unit: float | None = None
    max_correction: float | None = None
    max_slope: float = DEFAULT_MAX_SLOPE
    same_units: bool = False
    format: str | None = None
    file_units: Units | None = None
    file_axis: str | None = None
    fagor_sense: ErrorSense | None = None
    isg_sense: ErrorSense | None = None
    error_sense: ErrorSense | None = None
    told_in: Units | None = None

    def __post_init__(self) -> None:
        """Check what can be checked without a file."""
        for name in ("file_counts_per_unit", "counts_per_unit"):
            _check(name, getattr(self, name), lambda scale: MIN_SCALE <= abs(scale) <= MAX_SCALE, "not 0")
        _check("max_correction", self.max_correction, lambda limit: 0 < limit < inf, "positive")
        if not 0 < self.max_slope < 1:
            raise ContextError(f"max_slope is {self.max_slope}: it must be above 0 and below 1")
        _check("increment", self.increment, lambda step: 0 < step < MAX_POSITION, "a distance above 0")
        if self.axis is not None and not re.fullmatch("[A-Za-z]", self.axis):
            raise ContextError(f"axis is {self.axis!r}: it must be one letter, A to Z")
        _check("file_start", self.file_start, lambda start: abs(start) < MAX_POSITION, "a position")
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
        return replace(
            self,
            units=file_units,
            told_in=self.told_in or self.units,
            travel=None if self.travel is None else (self.travel[0] * factor, self.travel[1] * factor),
            file_start=None if self.file_start is None else self.file_start * factor,
            increment=None if self.increment is None else self.increment * factor,
            max_correction=None if self.max_correction is None else self.max_correction * factor,
            file_counts_per_unit=_per(self.file_counts_per_unit, factor),
            counts_per_unit=_per(self.counts_per_unit, factor),
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


def _check(name: str, number: float | None, is_good: Callable[[float], bool], what: str) -> None:
    if number is not None and not is_good(number):
        raise ContextError(f"{name} is {number}: it must be {what} and of a sensible size")


def _per(scale: float | None, factor: float) -> float | None:
    return None if scale is None else scale / factor
