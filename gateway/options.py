"""The declaration of a command's option: once, as a field of the dataclass that programs use too.

A field is ``Annotated[TYPE, Option(...)]``. A command with a parameter of that class takes each field as an
option (:func:`gateway.cli.options.takes_options`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Option:
    """The texts and limits of a field, beside its type and its default."""

    help: str
    """In the help of the command; for a program, the meaning of the field."""
    name: str = ""
    """On the command line, without the dashes; empty: as the field, with dashes."""
    metavar: str | None = None
    """Placeholder for its value there."""
    min: float | None = None
    """The smallest allowed number."""
    max: float | None = None
    one_of: Callable[[], Sequence[str]] | None = None
    """Returns the only allowed words; a shell completes them."""
    is_read_by_us: bool = False
    """A file that may be unreadable or missing: the code that opens it reports that."""
