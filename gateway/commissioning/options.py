"""How an option of a command is declared: once, as a field of the dataclass that a program fills in too.

A field is ``Annotated[TYPE, Option(...)]``. A command that has a parameter of that class takes each field as
an option (:func:`gateway.cli.options.takes_options`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Option:
    """What is said about a field beside its type and its default."""

    help: str
    """In the help of the command; a program reads it as what the field means."""
    name: str = ""
    """On the command line, without the dashes; empty: as the field, with dashes."""
    metavar: str | None = None
    """What stands for its value there."""
    min: float | None = None
    """The least number that is taken."""
    max: float | None = None
    one_of: Callable[[], Sequence[str]] | None = None
    """Returns the only words that are taken, with which a shell completes."""
    is_read_by_us: bool = False
    """A file that may be unreadable or missing: whoever opens it says so."""
