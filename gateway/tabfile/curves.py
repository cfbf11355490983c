"""Small sums over the rows of a file that the loader and the lints share."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from gateway.tabfile.decoded import SourceRow

BRANCHES: Final = ("forward", "backward")


def corrections(rows: Sequence[SourceRow], branch: str) -> list[float]:
    """Return the corrections of one direction, in machine units."""
    return [row.forward if branch == "forward" else row.backward for row in rows]


def line_of(row: SourceRow, branch: str) -> int | None:
    """Return the line that holds the correction of one direction."""
    return row.forward_line if branch == "forward" else row.backward_line


def steepest(rows: Sequence[SourceRow]) -> tuple[float, SourceRow, SourceRow]:
    """Return the largest slope of either direction, signed, and the two points it lies between.

    The steepest of slopes without a value (positions that coincide) is infinite.
    """
    found = (0.0, rows[0], rows[-1])
    for before, after in pairwise(rows):
        width = after.position - before.position
        for change in (after.forward - before.forward, after.backward - before.backward):
            slope = change / width if width > 0 else float("inf")
            if not abs(slope) <= abs(found[0]):
                found = (slope, before, after)
    return found


def second_differences(rows: Sequence[SourceRow], branch: str) -> list[float]:
    """Return the bends of one direction, see :func:`bends`."""
    return bends([row.position for row in rows], corrections(rows, branch))


def bends(places: Sequence[float], values: Sequence[float]) -> list[float]:
    """Return, for each inner point, |twice its distance from the line through its neighbours|."""
    differences = []
    for i in range(1, len(places) - 1):
        share = (places[i] - places[i - 1]) / (places[i + 1] - places[i - 1])
        chord = values[i - 1] + share * (values[i + 1] - values[i - 1])
        differences.append(2 * abs(values[i] - chord))
    return differences
