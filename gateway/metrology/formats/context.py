"""Facts that a file of readings does not contain, given by the user."""

from dataclasses import dataclass
from enum import Enum

from gateway.compensation.units import Units
from gateway.tabfile.text import SourceText


class Runs(Enum):
    """The directions of the runs of a file that does not prove them."""

    ALTERNATE = "alternate"
    """Odd runs in the order of the targets, even runs back."""
    FORWARD = "forward"
    """All runs towards greater positions."""
    BACKWARD = "backward"
    """All runs towards smaller positions."""


@dataclass(frozen=True, slots=True)
class ReadingsContext:
    """Facts about the readings; None: unknown, or stated by the file.

    ``units`` are those of the positions. A file that states others, or another axis, is refused.
    """

    format: str | None = None
    units: Units | None = None
    axis: str | None = None
    runs: Runs | None = None


def settled_units(
    source: SourceText, context: ReadingsContext, stated: Units | None, line: int | None = None
) -> Units:
    """Return the units of a file that states ``stated``.

    Raises:
        TabFileError: the units are unknown, or file and context differ.
    """
    if stated is None:
        if context.units is not None:
            return context.units
        raise source.error(
            "no units: the file does not state the unit of its numbers",
            "a heading such as target_mm or dro_inch, or --units mm, inch or degree",
            line=line,
        )
    if context.units is not None and context.units is not stated:
        found = f"positions in {stated.value}, but units = {context.units.value}"
        raise source.error(
            found,
            f"--units {stated.value} (or none), or a heading that says {context.units.value}",
            line=line,
        )
    return stated


def settled_axis(source: SourceText, context: ReadingsContext, stated: str | None) -> str | None:
    """Return the axis of a file that states ``stated``; if that is a longer text, the given axis is used.

    Raises:
        TabFileError: file and context name different axes.
    """
    if context.axis and stated and len(stated) == 1 and stated.casefold() != context.axis.casefold():
        raise source.error(
            f"readings of axis {stated}, but axis = {context.axis}",
            f"the readings of axis {context.axis}, or --axis {stated}",
        )
    return context.axis or stated or None
