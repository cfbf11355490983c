"""What the writers of all dialects share."""

from dataclasses import dataclass
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import ErrorSense, FileContext, V1Layout

EVEN_TOLERANCE: Final = 1e-4
"""Every point must be within this fraction of a step of its even position, the readers' tolerance."""
HOME_TOLERANCE: Final = 1e-6
NEEDS_SCALE: Final = "counts per unit for this file: --to-counts-per-unit N"
LARGER_SCALE: Final = "a larger scale: --to-counts-per-unit N"
"""Remedy for a scale that is missing or too small; only the option can state it."""


@dataclass(frozen=True, slots=True)
class WriteOptions:
    """Facts that a file needs but a table does not contain.

    ``axis`` is the letter for the file. ``file_counts_per_unit`` is the encoder counts of the reading control
    per unit of the table, negative if its Dir Rev is Y. ``file_axis`` is this axis's name in a file that can
    hold several axes. ``sense`` is that of the errors in a file without a fixed sense. ``is_modulo``: the
    table repeats at its end, so both ends are one position.
    """

    axis: str | None = None
    file_counts_per_unit: float | None = None
    v1_layout: V1Layout | None = None
    file_axis: str | None = None
    sense: ErrorSense | None = None
    is_modulo: bool = False


@dataclass(frozen=True, slots=True)
class Written:
    """Text of a file, its losses, and the options that its reader needs."""

    text: str
    losses: tuple[str, ...]
    context: FileContext
    encoding: str = "utf-8"
    """The encoding that the reading system needs."""


def unwritable(dialect: str, found: str, allowed: str) -> TabFileError:
    """Return the error of a table that a dialect cannot hold."""
    return TabFileError(FileProblem(f"a file of {dialect}", found, allowed))


def even_step(table: CorrectionTable, dialect: str) -> float:
    """Return the distance between neighbouring points.

    Raises:
        TabFileError: the points are not evenly spaced.
    """
    step = (table.last - table.first) / (len(table.positions) - 1)
    for index, position in enumerate(table.positions):
        if abs(position - (table.first + index * step)) > EVEN_TOLERANCE * step / 2:
            raise unwritable(
                dialect,
                f"points that are not evenly spaced (at {position:g})",
                "an even grid: --resample STEP",
            )
    return step


def one_curve(table: CorrectionTable) -> tuple[list[float], tuple[str, ...]]:
    """Return one correction for both directions, their mean, and the losses."""
    means = [(f + b) / 2 for f, b in zip(table.forward, table.backward, strict=True)]
    if table.is_unidirectional:
        return means, ()
    loss = (
        "one correction for both directions: the mean is written; lost motion of up to "
        f"{table.max_reversal():.6g} {table.units.value} is not in the file"
    )
    return means, (loss,)


def home_side(table: CorrectionTable, dialect: str) -> int:
    """Return +1 if the table begins at home (0), -1 if it ends there.

    Raises:
        TabFileError: 0 is not at either end.
    """
    if abs(table.first) <= HOME_TOLERANCE:
        return 1
    if abs(table.last) <= HOME_TOLERANCE:
        return -1
    raise unwritable(
        dialect, f"positions from {table.first:g} to {table.last:g}", "a range that begins or ends at home, 0"
    )
