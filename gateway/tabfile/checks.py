"""Checks for every dialect: a file that was read, against the given options and the axis."""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

from msgspec import Struct

from gateway.compensation.units import Units
from gateway.tabfile.decoded import Lint, LintSeverity, SourceRow
from gateway.tabfile.options import ErrorSense, FileContext, HomeSide, choices, option_hint
from gateway.tabfile.text import SourceText

# --- Two meanings of one file, described and compared, so that a person can choose

AS_THEY_STAND: Final = "positions unchanged"
"""The assumption of the plain meaning, for a file that states positions."""
_SHOWN_POINTS: Final = 4


class Interpretation(Struct, frozen=True):
    """One possible meaning: its assumption, and the resulting points in ascending order."""

    assumption: str
    rows: Sequence[SourceRow]
    units: Units

    def describe(self) -> str:
        """Return one line: the assumption, and the resulting positions of the points."""
        positions = [f"{row.position:.6g}" for row in self.rows]
        if len(positions) > 2 * _SHOWN_POINTS:
            positions = [*positions[:_SHOWN_POINTS], "…", *positions[-_SHOWN_POINTS:]]
        return f"{self.assumption}: {len(self.rows)} points at {', '.join(positions)} {self.units.value}"


def largest_difference(one: Sequence[SourceRow], other: Sequence[SourceRow]) -> tuple[float, float]:
    """Return the largest difference between the corrections of two readings, and its position.

    Outside its points a reading keeps its end value. Both are piecewise linear, so the largest difference is
    at a point of one of them.
    """
    positions = sorted({row.position for row in (*one, *other)})
    largest, where = 0.0, positions[0]
    for first, second in zip(_branches(one), _branches(other), strict=True):
        for position in positions:
            difference = abs(_hold(*first, position) - _hold(*second, position))
            if difference > largest:
                largest, where = difference, position
    return largest, where


def describe_both(one: Interpretation, other: Interpretation) -> tuple[str, ...]:
    """Return both readings in words; the second ends with the difference between them."""
    largest, where = largest_difference(one.rows, other.rows)
    unit = one.units.value
    difference = f"; their corrections differ by at most {largest:.6g} {unit} (at {where:.6g})"
    return (one.describe(), other.describe() + difference)


def _branches(rows: Sequence[SourceRow]) -> tuple[tuple[list[float], list[float]], ...]:
    positions = [row.position for row in rows]
    return (positions, [row.forward for row in rows]), (positions, [row.backward for row in rows])


def _hold(positions: list[float], corrections: list[float], position: float) -> float:
    above = bisect_right(positions, position)
    if above == 0:
        return corrections[0]
    if above == len(positions):
        return corrections[-1]
    share = (position - positions[above - 1]) / (positions[above] - positions[above - 1])
    return corrections[above - 1] + share * (corrections[above] - corrections[above - 1])


# --- Does the range of a table fit its axis?

MAX_EXCESS: Final = 0.2
"""A table may exceed the travel by this fraction of it; beyond, a scale or a start is wrong."""
TOUCH: Final = 1e-6
"""Ranges that share no more than this fraction of the travel do not overlap."""


def context_in_file_units(source: SourceText, context: FileContext, file_units: Units) -> FileContext:
    """Return the context in the units that the file states.

    Raises:
        TabFileError: the axis has other units, and conversion is not allowed or not possible.
    """
    if context.file_units not in (None, file_units):
        assert context.file_units is not None
        raise source.error(
            f"units {file_units.value}, but file_units = {context.file_units.value}",
            f"file_units = {file_units.value!r}, or none",
        )
    if context.units in (None, file_units):
        return context.in_units(file_units)
    assert context.units is not None
    if context.same_units:
        raise source.error(
            f"units {file_units.value}, but the given units are {context.units.value}", f"{file_units.value}"
        )
    try:
        return context.in_units(file_units)
    except ValueError:
        raise source.error(
            f"a table in {file_units.value} for an axis in {context.units.value}",
            "lengths for a linear axis, degrees for a rotary one",
        ) from None


def required_units(source: SourceText, context: FileContext, what: str) -> Units:
    """Return the units of a file that does not state its own; ``what`` names the kind of file.

    Raises:
        TabFileError: the units were not given.
    """
    if context.file_units is None:
        raise source.error(
            f"{what}, which states no units",
            option_hint("file_units"),
        )
    return context.file_units


def check_range(
    source: SourceText, reading: Interpretation, mirror: Interpretation, context: FileContext, remedy: str
) -> None:
    """Check that the range overlaps the travel and does not exceed it by much. Without a travel: no check.

    Raises:
        TabFileError: the range is outside the travel (the error adds the mirrored reading if that one fits),
            or exceeds it by more than a fifth of the travel.
    """
    if context.travel is None:
        return
    low, high = context.travel
    limits = f"travel {low:g} to {high:g} {reading.units.value}"
    first, last = _ends(reading)
    if _overlap(first, last, low, high) <= TOUCH * (high - low):
        found = f"a table from {first:g} to {last:g} {reading.units.value}, outside {limits}"
        if _overlap(*_ends(mirror), low, high) > TOUCH * (high - low):
            raise source.error(
                found + ", but overlapping it with opposite signs",
                remedy,
                readings=describe_both(reading, mirror),
            )
        raise source.error(found, f"a table of this axis; {remedy}")
    excess = max(0.0, low - first) + max(0.0, last - high)
    if excess > MAX_EXCESS * (high - low) * (1 + TOUCH):
        raise source.error(
            f"a table from {first:g} to {last:g} {reading.units.value}, beyond {limits} by "
            f"{excess / (high - low):.0%}",
            f"at most {MAX_EXCESS:.0%} beyond the travel; {remedy} or units",
        )


def check_own_range(source: SourceText, reading: Interpretation, context: FileContext, remedy: str) -> None:
    """Check the range of a file whose positions have their own sign; its mirrored reading has the other sign.

    Raises:
        TabFileError: see :func:`check_range`.
    """
    mirrored = tuple(row._replace(position=-row.position + 0.0) for row in reversed(reading.rows))
    mirror = Interpretation("positions mirrored", mirrored, reading.units)
    check_range(source, reading, mirror, context, remedy)


def check_home(source: SourceText, rows: Sequence[SourceRow], context: FileContext) -> None:
    """Check a given home side against the side that the positions prove.

    Raises:
        TabFileError: the positions are on the other side of home.
    """
    proven = proven_home(rows)
    if context.file_home is not None and proven not in (None, context.file_home):
        assert proven is not None
        raise source.error(
            f"positions from {rows[0].position:g} to {rows[-1].position:g}, so home is at the "
            f"{proven.value} end, but file_home is {context.file_home.value}",
            f"file_home = {proven.value!r}, or none",
        )


def check_start(source: SourceText, rows: Sequence[SourceRow], context: FileContext) -> None:
    """Check a given start against a file that proves its own.

    Raises:
        TabFileError: the file starts at another position.
    """
    if context.file_start is None:
        return
    step = (rows[-1].position - rows[0].position) / (len(rows) - 1)
    if abs(context.file_start - rows[0].position) > 1e-4 * step:
        found, given = context.as_given(rows[0].position), context.as_given(context.file_start)
        raise source.error(
            f"a lowest position of {found:.9g}, but file_start is {given:.9g}",
            f"file_start = {found:.9g}, or none",
        )


def proven_home(rows: Sequence[SourceRow]) -> HomeSide | None:
    """Return the end at which the axis homes if all positions lie on one side of 0, else None."""
    if rows[-1].position <= 0:
        return HomeSide.PLUS
    return HomeSide.MINUS if rows[0].position >= 0 else None


def unused_options(context: FileContext, format_name: str, names: Iterable[str]) -> tuple[Lint, ...]:
    """Return a remark for each given option that this dialect does not use."""
    return tuple(
        Lint("R3", LintSeverity.WARNING, f"{name} has no effect for {format_name}: remove it")
        for name in names
        if getattr(context, name) is not None
    )


def under_new_names(
    source: SourceText, context: FileContext, format_name: str
) -> tuple[FileContext, tuple[Lint, ...]]:
    """Return the context with the values of old option names, and a remark for each of them.

    Raises:
        TabFileError: both names of an option were given, and they contradict each other.
    """
    remarks: list[Lint] = []
    for old, new, given in context.given_under_old_names(format_name):
        now = getattr(context, new)
        if now not in (None, given):
            raise source.error(
                f"{old} {given.value} and {new} {now.value}", f"only {new}, with the right value"
            )
        context = replace(context, **{old: None, new: given})
        message = f"write {new} = {given.value!r}: {old} is its old name, which is still accepted"
        remarks.append(Lint("R14", LintSeverity.INFO, message))
    return context, tuple(remarks)


def _ends(reading: Interpretation) -> tuple[float, float]:
    return reading.rows[0].position, reading.rows[-1].position


def _overlap(first: float, last: float, low: float, high: float) -> float:
    return min(last, high) - max(first, low)


# --- Files that state their positions, in the coordinates of the machine


def check_stated(source: SourceText, rows: Sequence[SourceRow], units: Units, context: FileContext) -> None:
    """Check stated positions against a given start and the travel, both in ``units``.

    Raises:
        TabFileError: the file starts at another position, is outside the travel, or exceeds it by much.
    """
    check_start(source, rows, context)
    reading = Interpretation(AS_THEY_STAND, rows, units)
    check_own_range(source, reading, context, "the right travel")


def is_closed(rows: Sequence[SourceRow]) -> bool:
    """Whether both directions end with their first value, as a full revolution must."""
    first, last = rows[0], rows[-1]
    return first.forward_value == last.forward_value and first.backward_value == last.backward_value


# --- The sense of the errors in a file: which of two readings its author meant

RULES: Final = {
    ErrorSense.ACTUAL_MINUS_COMMAND: "error = actual - commanded: subtracted",
    ErrorSense.COMMAND_MINUS_ACTUAL: "error = commanded - actual: added unchanged",
}
"""How an error becomes the amount to add, in words."""
_READINGS: Final = (
    "actual_minus_command: an error of +0.01 means that the nut is 0.01 too far, so 0.01 is subtracted",
    "command_minus_actual: an error of +0.01 means that the nut is 0.01 short, so 0.01 is added",
)


def required_sense(
    source: SourceText,
    context: FileContext,
    what: str,
    why: str = "no manual states the sign of its errors",
) -> ErrorSense:
    """Return the sense of the errors in a file that does not prove it.

    ``what`` names the kind of file, ``why`` gives the reason for the question.

    Raises:
        TabFileError: the sense was not given; the error shows both readings.
    """
    if context.error_sense is None:
        raise source.error(
            f"{what}: {why}",
            f"{choices('error_sense')}; one test move shows which is right",
            readings=_READINGS,
        )
    return context.error_sense
