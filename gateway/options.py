"""The declaration of a command's option: once, as a field of the dataclass that programs use too.

A field is ``Annotated[TYPE, Option(...)]`` of a class that inherits from :class:`Options`. A command with a
parameter of that class takes each field as an option (:func:`gateway.cli.options.takes_options`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import isfinite
from typing import get_args


class OptionError(ValueError):
    """The value of an option is not allowed. The message names the field, the value and the limits."""

    def __init__(self, field: str, why: str) -> None:
        """``why``: what was found and what is allowed."""
        super().__init__(f"{field}: {why}")
        self.field = field
        self.why = why


@dataclass(frozen=True, slots=True)
class Option:
    """The texts and limits of a field, beside its type and its default."""

    help: str
    """In the help of the command; for a program, the meaning of the field."""
    name: str = ""
    """On the command line, without the dashes; empty: as the field, with dashes."""
    metavar: str | None = None
    """Placeholder for its value there."""
    shown_default: str | bool = True
    """What the help says about the default: the value itself, nothing, or these words."""
    min: float | None = None
    """The smallest allowed number."""
    max: float | None = None
    one_of: Callable[[], Sequence[str | int]] | None = None
    """Returns the only allowed values; a shell completes them."""
    is_read_by_us: bool = False
    """A file that may be unreadable or missing: the code that opens it reports that."""

    def check(self, field: str, value: object) -> None:
        """Check a value. None is always allowed; a number must be finite.

        Raises:
            OptionError: the value is not allowed.
        """
        if value is not None and self.one_of is not None and value not in (allowed := self.one_of()):
            raise OptionError(field, f"found {value!r}; allowed: {', '.join(map(str, allowed))}")
        for number in value if isinstance(value, list | tuple) else (value,):
            if isinstance(number, int | float) and not self._is_allowed(number):
                raise OptionError(field, f"found {number!r}; allowed: {self._limits(number)}")

    def _is_allowed(self, number: float) -> bool:
        return (
            _is_finite(number)
            and (self.min is None or number >= self.min)
            and (self.max is None or number <= self.max)
        )

    def _limits(self, number: float) -> str:
        limits = [] if _is_finite(number) else ["a finite number"]
        limits += [] if self.min is None else [f"at least {self.min:g}"]
        limits += [] if self.max is None else [f"at most {self.max:g}"]
        return ", ".join(limits)


def _is_finite(number: float) -> bool:
    return isinstance(number, int) or isfinite(number)  # a large int has no float


@dataclass(frozen=True, slots=True)
class Options:
    """Base of a group of options.

    Raises:
        OptionError: a value is not allowed.

    >>> from typing import Annotated
    >>> @dataclass(frozen=True)
    ... class Pace(Options):
    ...     runs: Annotated[int, Option("Runs up and down.", min=1, max=1000)] = 5
    >>> Pace(runs=0)
    Traceback (most recent call last):
    gateway.options.OptionError: runs: found 0; allowed: at least 1, at most 1000
    """

    def __post_init__(self) -> None:
        """Check each value by the declaration of its field."""
        for field in fields(self):
            for declared in get_args(field.type)[1:]:
                if isinstance(declared, Option):
                    declared.check(field.name, getattr(self, field.name))
