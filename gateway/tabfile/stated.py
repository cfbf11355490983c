"""Checks for files that state their positions, in the coordinates of the machine."""

from collections.abc import Sequence

from gateway.compensation.units import Units
from gateway.tabfile.context import FileContext
from gateway.tabfile.decoded import SourceRow
from gateway.tabfile.ranges import check_own_range, check_start
from gateway.tabfile.readings import AS_THEY_STAND, Reading
from gateway.tabfile.text import SourceText


def check_stated(source: SourceText, rows: Sequence[SourceRow], units: Units, context: FileContext) -> None:
    """Check stated positions against a told start and the travel, both in ``units``.

    Raises:
        TabFileError: the file starts elsewhere, misses the travel, or sticks far out of it.
    """
    check_start(source, rows, context)
    reading = Reading(AS_THEY_STAND, rows, units)
    check_own_range(source, reading, context, "a table of this axis, or the right travel")


def is_closed(rows: Sequence[SourceRow]) -> bool:
    """Whether both directions end with the value that they began with, as a full turn must."""
    first, last = rows[0], rows[-1]
    return first.forward_value == last.forward_value and first.backward_value == last.backward_value
