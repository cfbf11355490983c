"""Facts that a table file cannot prove about itself, given by the user. Each option is declared here, once.

:class:`TableOptions` is the source of the keys of ``table_options`` in the configuration, the options of
``pitch-gateway table`` with their help, the options of the readers with checks and units, and the hints in
errors. A new option is a field there, and its name in ``USES`` of each reader that needs it.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from math import inf
from types import MappingProxyType
from typing import Annotated, Any, Final, get_args, get_origin

from msgspec import Struct

from gateway.compensation.settings import DEFAULT_MAX_SLOPE, default_max_correction
from gateway.compensation.units import Units
from gateway.tabfile.errors import ContextError

MIN_SCALE: Final = 1e-6
MAX_SCALE: Final = 1e12
MAX_POSITION: Final = 1e9
"""Limit of any real machine: beyond it a number is a mistake, and sums would lose their digits."""


class V1Layout(Enum):
    """Whether the first value of a version 1 file belongs to home or to the first point away from it."""

    LISTED = "listed"
    IMPLICIT = "implicit"


class HomeSide(Enum):
    """The end of travel at which the axis homes; the rest of its travel lies on the other side of 0."""

    PLUS = "plus"
    MINUS = "minus"


class ErrorSense(Enum):
    """The meaning of an error in a file: actual position - commanded position, or the reverse."""

    ACTUAL_MINUS_COMMAND = "actual_minus_command"
    COMMAND_MINUS_ACTUAL = "command_minus_actual"

    @property
    def to_correction(self) -> float:
        """Factor from an error of this sense to the amount to add.

        >>> ErrorSense.ACTUAL_MINUS_COMMAND.to_correction
        -1.0
        """
        return -1.0 if self is ErrorSense.ACTUAL_MINUS_COMMAND else 1.0


# --- The declaration of an option


class Quantity(Struct, frozen=True):
    """Range of numbers for an option."""

    rule: str
    """The rule, for an error message."""
    is_allowed: Callable[[float], bool]
    is_length: bool = False
    is_per_length: bool = False

    def check(self, number: float) -> float:
        """Return an allowed number.

        Raises:
            ValueError: it is not allowed; the text has the rule.
        """
        if not self.is_allowed(number):
            raise ValueError(f"it must be {self.rule} and of a sensible size")
        return number

    def converted(self, number: float, factor: float) -> float:
        """Return a number in other units; ``factor`` converts a length to them.

        >>> COUNTS_PER_UNIT.converted(25400.0, 25.4)
        1000.0
        """
        if self.is_length:
            return number * factor
        return number / factor if self.is_per_length else number


class Renamed(Struct, frozen=True):
    """For an option with an old name: its new name, and the formats for which the old one holds."""

    to: str
    formats: frozenset[str]


class TableOption(Struct, frozen=True):
    """The texts about an option, for all places where users can give it."""

    description: str
    """For the reference of keys."""
    help: str
    """For the command line."""
    metavar: str | None = None
    """Placeholder for its value there."""
    typed_as: str = ""
    """The command-line option that sets it together with something else, without the dashes."""
    is_for_all: bool = False
    """It has a meaning for every format."""
    renamed: Renamed | None = None
    """It is an old name, which stays accepted."""


def _is_scale(number: float) -> bool:
    return MIN_SCALE <= abs(number) <= MAX_SCALE


def _is_position(number: float) -> bool:
    return abs(number) < MAX_POSITION


def _is_distance(number: float) -> bool:
    return 0 < number < MAX_POSITION


COUNTS_PER_UNIT: Final = Quantity("not 0", _is_scale, is_per_length=True)
LENGTH: Final = Quantity("a position", _is_position, is_length=True)
DISTANCE: Final = Quantity("a distance above 0", _is_distance, is_length=True)
CountsPerUnit = Annotated[float, COUNTS_PER_UNIT]
Length = Annotated[float, LENGTH]
Distance = Annotated[float, DISTANCE]


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """Facts that the user can give about a file. None: not given."""

    file_counts_per_unit: Annotated[
        CountsPerUnit | None,
        TableOption(
            "version 1: encoder counts per unit of the control that the file was made for, negative for its "
            "Dir Rev",
            "Encoder counts of the OLD control per machine unit, negative if its Dir Rev was Y (files "
            "that hold counts).",
            "N",
        ),
    ] = None
    v1_layout: Annotated[
        V1Layout | None,
        TableOption(
            "version 1: whether the first value belongs to home or to one interval from it",
            "Centroid version 1: does the first value belong to home (listed) or to the first "
            "interval (implicit)?",
        ),
    ] = None
    file_start: Annotated[
        Length | None,
        TableOption(
            "version 2: machine position of the first point. Mint: machine position of mark A, needed where "
            "`PRECISIONOFFSET` is missing or not 0",
            "Position of the lowest point (Mint: of mark A), if the file does not prove it.",
            "S",
        ),
    ] = None
    increment: Annotated[
        Distance | None,
        TableOption(
            "Mint: distance of the points, where the program does not set `PRECISIONINCREMENT`",
            "Distance between the points of a Mint table, if the program does not set PRECISIONINCREMENT.",
            "STEP",
        ),
    ] = None
    file_home: Annotated[
        HomeSide | None,
        TableOption(
            "the end at which the axis of the file homes",
            "End of travel at which the axis homes; checked against the file.",
        ),
    ] = None
    format: Annotated[
        str | None,
        TableOption(
            "name of the format where the text fits several, such as LinuxCNC's two types",
            "Format of the file, if its text fits several: see 'table formats'.",
            "NAME",
            is_for_all=True,
        ),
    ] = None
    file_units: Annotated[
        Units | None,
        TableOption(
            "units of a file that states none; every length in this table stays in units of the axis",
            "Machine units of a file that states none; a file that states others is refused. Default "
            "for Centroid version 1: inch.",
            typed_as="units",
            is_for_all=True,
        ),
    ] = None
    file_axis: Annotated[
        str | None,
        TableOption(
            "what a file that holds several axes calls this one",
            "Name of this axis in a file with several axes.",
            "NAME",
        ),
    ] = None
    error_sense: Annotated[
        ErrorSense | None,
        TableOption(
            "what the file means by an error: where the nut was less where it should be, or the reverse. For "
            "every format whose errors have no fixed sign; ISG and TwinCAT CNC: where it is not given, "
            "actual less command",
            "What the file calls an error, for formats that leave it open (see 'table formats').",
        ),
    ] = None
    fagor_sense: Annotated[
        ErrorSense | None,
        TableOption(
            "old name of `error_sense`, for Fagor tables only; stays accepted",
            "Old name of --error-sense, for Fagor tables only.",
            renamed=Renamed("error_sense", frozenset({"fagor-8055", "fagor-8065"})),
        ),
    ] = None
    isg_sense: Annotated[
        ErrorSense | None,
        TableOption(
            "old name of `error_sense`, for ISG and TwinCAT CNC tables only; stays accepted",
            "Old name of --error-sense, for ISG and TwinCAT CNC tables only.",
            renamed=Renamed("error_sense", frozenset({"isg"})),
        ),
    ] = None

    def given(self) -> dict[str, Any]:
        """Return the given options by name.

        >>> TableOptions(file_axis="X", file_start=0.0).given()
        {'file_start': 0.0, 'file_axis': 'X'}
        """
        facts = {name: getattr(self, name) for name in DECLARED}
        return {name: fact for name, fact in facts.items() if fact is not None}

    def given_under_old_names(self, format_name: str) -> Iterator[tuple[str, str, Any]]:
        """Yield old name, new name and value of the options given under an old name valid for a format.

        An old name of other formats does not change: taken for this format, it could reverse a sign.
        """
        for old, given in self.given().items():
            renamed = DECLARED[old].option.renamed
            if renamed is not None and format_name in renamed.formats:
                yield old, renamed.to, given

    def under_new_names(self, format_name: str) -> "TableOptions":
        """Return the options without old names valid for a format; a value under the new name has priority.

        >>> TableOptions(isg_sense=ErrorSense.COMMAND_MINUS_ACTUAL).under_new_names("isg").error_sense.value
        'command_minus_actual'
        >>> TableOptions(isg_sense=ErrorSense.COMMAND_MINUS_ACTUAL).under_new_names("fagor-8055").error_sense
        """
        options = self
        for old, new, given in self.given_under_old_names(format_name):
            options = replace(options, **{old: None, new: getattr(options, new) or given})
        return options


# --- Derived from the declarations


class Declared(Struct, frozen=True):
    """An option as declared."""

    name: str
    type: Any
    """Type of its values: float, str or an enumeration."""
    quantity: Quantity | None
    option: TableOption

    @property
    def typed(self) -> str:
        """Its name on the command line.

        >>> DECLARED["file_axis"].typed, DECLARED["file_units"].typed
        ('--file-axis', '--units')
        """
        return f"--{(self.option.typed_as or self.name).replace('_', '-')}"


def _declared() -> Iterator[Declared]:
    for field in fields(TableOptions):
        hint, option = get_args(field.type)
        [values] = [part for part in get_args(hint) if part is not type(None)]
        kind, quantity = get_args(values) if get_origin(values) is Annotated else (values, None)
        yield Declared(field.name, kind, quantity, option)


DECLARED: Final[Mapping[str, Declared]] = MappingProxyType({each.name: each for each in _declared()})
OPTIONS: Final = tuple(
    name for name, each in DECLARED.items() if not each.option.is_for_all and each.option.renamed is None
)
"""Options for some formats only, without old names."""


def choices(name: str) -> str:
    """Return the allowed values of an option that is one of several words.

    >>> choices("v1_layout")
    "v1_layout = 'listed' or 'implicit'"
    """
    *words, last = (repr(member.value) for member in DECLARED[name].type)
    return f"{name} = {', '.join(words)} or {last}"


def option_hint(name: str, value: str = "") -> str:
    """Return what to set: in the configuration, and on the command line.

    >>> option_hint("file_axis", "'X'")
    "file_axis = 'X' (--file-axis on the command line)"
    >>> option_hint("file_units")
    "file_units = 'mm', 'inch' or 'degree' (--units on the command line)"
    """
    text = f"{name} = {value}" if value else choices(name)
    return f"{text} ({typed(name)})"


def typed(name: str) -> str:
    """Return the command-line name of an option, for the end of a hint."""
    return f"{DECLARED[name].typed} on the command line"


# --- The input of a reader: the options of the file, and facts about its axis

_LIMIT: Final = Quantity("positive", lambda limit: 0 < limit < inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileContext(TableOptions):
    """Facts about the axis and about the old control that wrote the file. None: unknown.

    Every length is in ``units``, the machine units of the axis, and every scale in counts per that unit. With
    ``units`` None they are in the units that the file states. ``given_in`` are the units in which the user
    gave them, if :meth:`in_units` converted them; messages that name an option use these.

    ``counts_per_unit`` belongs to the present drive. With ``same_units`` a file in units other than ``units``
    is refused; otherwise lengths are converted.

    Raises:
        ContextError: a travel whose ends are not in order, a scale of 0, a slope of 1 or more (which has no
            inverse), an axis that is not a letter, a number that is not finite.
    """

    axis: str | None = None
    units: Units | None = None
    travel: tuple[float, float] | None = None
    counts_per_unit: float | None = None
    max_correction: float | None = None
    max_slope: float = DEFAULT_MAX_SLOPE
    same_units: bool = False
    given_in: Units | None = None

    def __post_init__(self) -> None:
        """Check everything that needs no file."""
        for name, fact in self.given().items():
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
            return replace(self, units=file_units, given_in=self.given_in or file_units)
        factor = self.units.convert_factor(file_units)
        options: dict[str, Any] = {
            name: quantity.converted(fact, factor)
            for name, fact in self.given().items()
            if (quantity := DECLARED[name].quantity) is not None
        }
        return replace(
            self,
            **options,
            units=file_units,
            given_in=self.given_in or self.units,
            travel=None if self.travel is None else (self.travel[0] * factor, self.travel[1] * factor),
            max_correction=None if self.max_correction is None else self.max_correction * factor,
            counts_per_unit=None if self.counts_per_unit is None else self.counts_per_unit / factor,
        )

    def option_units(self, file_units: Units) -> Units:
        """Units for the options with lengths and scales, for a file in ``file_units``."""
        return self.given_in or self.units or file_units

    def as_given(self, length: float) -> float:
        """Return a length from ``units`` in the units of the options."""
        return (
            length
            if self.units is None
            else length * self.units.convert_factor(self.option_units(self.units))
        )

    def correction_limit(self, units: Units, span: float) -> float:
        """Largest allowed |correction|, in ``units`` (those of this context).

        ``span`` is the length of the table; a given travel is used instead.
        """
        if self.max_correction is not None:
            return self.max_correction
        return default_max_correction(units, self.length(span))

    def length(self, span: float) -> float:
        """Length of the axis, as far as known."""
        return span if self.travel is None else self.travel[1] - self.travel[0]


def _check(name: str, number: float | None, quantity: Quantity) -> None:
    if number is not None:
        try:
            quantity.check(number)
        except ValueError as error:
            raise ContextError(f"{name} is {number}: {error}") from None
