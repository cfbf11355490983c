"""A correction table as a Mint program.

Mint wants the nut's place at even theoretical (motor) positions A + i x increment: the inverse of our curve
there. Between two entries it draws a straight line, so bends of the curve that lie between them are cut; how
much that costs is worked out and said. A table that came from a Mint program fits its increment again.

Mark A has no correction, by definition. Where the table begins with one, A is put below it, and the
correction grows from there, slowly, before the table begins.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.tabfile.context import FileContext
from gateway.tabfile.mint import NAME
from gateway.tabfile.writing import EVEN_TOLERANCE, WriteOptions, Written, unwritable

DECIMALS: Final = 8
_NOTHING: Final = 1e-9
_FIT_MM: Final = 1e-6
"""Points that are not evenly spaced are only written where an increment fits them as well as this."""
_RAMP: Final = 0.004
"""Largest slope with which a first correction grows from 0 at mark A."""
_PARTS: Final = (1, 2, 3, 4)


@dataclass(frozen=True, slots=True)
class _Curve:
    """One direction: points, and the motor positions that belong to them; held outside."""

    positions: Sequence[float]
    corrections: Sequence[float]
    images: Sequence[float]

    def correction(self, position: float) -> float:
        return _along(self.positions, self.corrections, position)

    def nut(self, motor: float) -> float:
        """Return the position whose corrected one is ``motor``."""
        return motor - _along(self.images, self.corrections, motor)


@dataclass(frozen=True, slots=True)
class _Plan:
    """Entries for one increment, and the largest difference from the table, and where that is."""

    start: float
    increment: float
    entries: tuple[tuple[float, ...], tuple[float, ...]]
    difference: float
    place: float


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table for axis ``file_axis`` (0 unless told) with the increment that fits best.

    Raises:
        TabFileError: an axis that is no number, or uneven points that no even increment fits.
    """
    axis = "0" if options.file_axis is None else options.file_axis
    if not (axis.isascii() and axis.isdigit()):
        raise unwritable(NAME, f"axis {axis!r}", "the number of an axis: --to-file-axis N")
    increments = _increments(table)
    plans = [plan for increment in increments if (plan := _plan(table, increment)) is not None]
    fit = table.units.from_mm(_FIT_MM)
    best = next((plan for plan in plans if plan.difference <= fit), plans[0] if plans else None)
    if best is None or (not _is_even(table) and best.difference > fit):
        found = "points that are not evenly spaced and fit no even increment"
        if best is not None:
            found += f" (off by {best.difference:.3g} {table.units.value} at {best.place:g})"
        raise unwritable(NAME, found, "an even grid: --resample STEP")
    context = FileContext(file_units=table.units, file_axis=axis, file_start=best.start)
    return Written(_program(table, best, axis), _losses(table, best, options), context)


def _is_even(table: CorrectionTable) -> bool:
    step = (table.last - table.first) / (len(table.positions) - 1)
    return all(
        abs(position - (table.first + index * step)) <= EVEN_TOLERANCE * step / 2
        for index, position in enumerate(table.positions)
    )


def _curves(table: CorrectionTable) -> tuple[_Curve, _Curve]:
    return _curve(table.positions, table.forward), _curve(table.positions, table.backward)


def _curve(positions: Sequence[float], corrections: Sequence[float]) -> _Curve:
    return _Curve(positions, corrections, [x + c for x, c in zip(positions, corrections, strict=True)])


def _increments(table: CorrectionTable) -> list[float]:
    """Return increments that may fit, best first: the step of an even grid, parts of a motor distance."""
    found = [(table.last - table.first) / (len(table.positions) - 1)] if _is_even(table) else []
    gaps = [after - before for curve in _curves(table) for before, after in pairwise(_bends(curve))]
    found += [min(gaps) / part for part in _PARTS]
    return [increment for length in found if (increment := float(f"{length:.10g}")) > 0]


def _bends(curve: _Curve) -> list[float]:
    """Return the motor positions of the first point and of those at which the curve bends, or of both ends.

    The last point is no bend: where one direction ends before the other, it is only held up to there.
    """
    bends = [curve.images[0]]
    for index in range(1, len(curve.positions) - 1):
        low, high = curve.positions[index - 1], curve.positions[index + 1]
        share = (curve.positions[index] - low) / (high - low)
        chord = curve.corrections[index - 1] * (1 - share) + curve.corrections[index + 1] * share
        if abs(curve.corrections[index] - chord) > _NOTHING:
            bends.append(curve.images[index])
    return bends if len(bends) > 1 else [curve.images[0], curve.images[-1]]


def _plan(table: CorrectionTable, increment: float) -> _Plan | None:
    """Return the entries for one increment; None where they would be many more than the table's points."""
    start, forward, backward = _from_mark(table, increment)
    end = max(forward.images[-1], backward.images[-1])
    size = max(1, ceil((end - start) / increment - EVEN_TOLERANCE))
    if size > 4 * len(forward.positions) + (table.first - start) / increment:
        return None
    motors = [start + index * increment for index in range(1, size + 1)]
    entries = tuple(
        tuple(round(curve.nut(motor) - start, DECIMALS) + 0.0 for motor in motors)
        for curve in (forward, backward)
    )
    difference, place = 0.0, table.first
    for curve, places in zip((forward, backward), entries, strict=True):
        read = _curve(
            [start, *(start + place for place in places)],
            [0.0, *(index * increment - place for index, place in enumerate(places, start=1))],
        )
        for at in (*table.positions, *read.positions):
            off = abs(read.correction(at) - curve.correction(at)) if table.first <= at <= table.last else 0.0
            if off > difference:
                difference, place = off, at
    return _Plan(start, increment, (entries[0], entries[1]), difference, place)


def _from_mark(table: CorrectionTable, increment: float) -> tuple[float, _Curve, _Curve]:
    """Return where mark A is, and both curves from there."""
    largest = max(abs(table.forward[0]), abs(table.backward[0]))
    if largest <= _NOTHING:
        return (float(f"{table.first:.12g}"), *_curves(table))
    # It has grown up when the motor may still be below the table.
    ready = 2 * largest
    count = ceil((ready + largest / _RAMP) / increment)
    start = float(f"{table.first - count * increment:.12g}")
    before = [start, table.first - ready]
    return (
        start,
        _curve([*before, *table.positions], [0.0, table.forward[0], *table.forward]),
        _curve([*before, *table.positions], [0.0, table.backward[0], *table.backward]),
    )


def _along(places: Sequence[float], values: Sequence[float], at: float) -> float:
    above = bisect_right(places, at)
    if above == 0:
        return values[0]
    if above == len(places):
        return values[-1]
    share = (at - places[above - 1]) / (places[above] - places[above - 1])
    return values[above - 1] + share * (values[above] - values[above - 1])


def _program(table: CorrectionTable, plan: _Plan, axis: str) -> str:
    names = ["fwdTable"] if table.is_unidirectional else ["fwdTable", "revTable"]
    lines = [
        f"' Leadscrew table of axis {axis} in {table.units.value}, mark A at {plan.start:.12g}",
        *(
            f"DIM {name}({len(entries)}) = {', '.join(map(_number, entries))}"
            for name, entries in zip(names, plan.entries, strict=False)
        ),
        f"PRECISIONTABLE({axis}, {', '.join(names)})",
        f"PRECISIONINCREMENT.{axis} = {plan.increment:.10g}",
        f"PRECISIONOFFSET.{axis} = {plan.start:.12g}",
    ]
    if table.is_unidirectional:
        lines.append(f"' Switch it on with the single table mode of axis {axis}")
    else:
        lines.append(f"BACKLASHMODE.{axis} = _blOFF : REM the tables hold the lost motion")
        lines.append(f"PRECISIONMODE.{axis} = _lsDUAL_TABLE")
    return "".join(f"{line}\n" for line in lines)


def _number(value: float) -> str:
    return f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")


def _losses(table: CorrectionTable, plan: _Plan, options: WriteOptions) -> tuple[str, ...]:
    unit = table.units.value
    between = (
        f"Mint draws straight lines between even motor positions {plan.increment:.10g} apart: the curve "
        f"differs by up to {plan.difference:.3g} {unit} (at {plan.place:g})"
    )
    losses = [
        between,
        f"positions are rounded to {DECIMALS} decimals; units ({unit}) are not in the file",
        "check the sign of PRECISIONOFFSET on the control: its guide describes both",
    ]
    if plan.start < table.first:
        losses.append(
            f"mark A has no correction, so it is put at {plan.start:g}, and the first one grows up to "
            f"{table.first:g}"
        )
    if options.file_axis is None:
        losses.append("no axis was told: the program is for axis 0")
    return tuple(losses)
