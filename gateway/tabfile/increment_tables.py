"""Sums of increments <-> tables: scale, place, turns, and the rounding that keeps sums true."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import (
    AS_THEY_STAND,
    Reading,
    check_home,
    check_own_range,
    context_in_file_units,
    told_units,
)
from gateway.tabfile.csv_text import axis_letter, csv_file
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.increments import HEADER, TURN_DEGREES, Increments, Sum, System, is_turn
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import SourceText
from gateway.tabfile.writing import (
    EVEN_TOLERANCE,
    NEEDS_SCALE,
    WriteOptions,
    Written,
    even_step,
    one_curve,
    unwritable,
)

HOLDS: Final = ('outside = "hold"',)
"""Beyond the last point no more steps follow, so the sum stays as it is."""


@dataclass(frozen=True, slots=True)
class Meaning:
    """What sums become: how many values make one count, the rule in words, what no source proves of it."""

    values_per_count: int
    rule: str
    assumed: tuple[str, ...] = ()


def decode(
    source: SourceText,
    context: FileContext,
    file: Increments,
    sums: Sequence[Sum],
    meaning: Meaning,
) -> Decoded:
    """Make points of sums.

    The reference point is 0 of the machine unless ``file_start`` says where the lowest point lies.

    Raises:
        TabFileError: units or scale not told, a turn whose values do not sum up to 0, more than a turn,
            another axis, a range that does not fit the travel.
    """
    units = told_units(source, context, "a table of increments")
    context = context_in_file_units(source, context, units)
    scale = _scale(source, context, units)
    _check_turn(source, units, file, sums)
    axis = axis_letter(source, file.csv, context)
    start = context.file_start
    offset = 0.0 if start is None else start - sums[0].step * file.interval
    rows = tuple(
        SourceRow(
            total.step * file.interval + offset + 0.0,
            *(total.total * file.magnification / (scale * meaning.values_per_count) + 0.0,) * 2,
            *(total.total,) * 2,
            *(total.line,) * 2,
        )
        for total in sums
    )
    check_home(source, rows, context)
    remedy = "a table of this axis; the right file_units, file_start and travel"
    check_own_range(source, Reading(AS_THEY_STAND, rows, units), context, remedy)
    turn = TURN_DEGREES if is_turn(units, len(rows) - 1, file.interval) else None
    place = f"the reference point {file.reference} is {offset:g} {units.value}"
    told = "as file_start tells" if start is not None else "the zero of the machine (file_start moves it)"
    return Decoded(
        rows,
        units,
        context,
        "values, summed",
        meaning.rule,
        meaning.rule,
        axis=axis,
        decisions=(f"{place}, {told}", *_scale_told(context, scale, units), *meaning.assumed),
        behaves_as=HOLDS if turn is None else (f"modulo = {turn:g}",),
        modulo=turn,
    )


def _scale(source: SourceText, context: FileContext, units: Units) -> float:
    """Return the counts of the old control in one unit of the file."""
    scale = context.file_counts_per_unit
    if scale is None or scale <= 0:
        found = "no file_counts_per_unit" if scale is None else f"file_counts_per_unit {scale:g}"
        raise source.error(
            f"a table of increments, which holds counts, and {found}",
            f"file_counts_per_unit = counts of the OLD control per {context.option_units(units).value}, the "
            "unit of the axis, above 0 (1000 where it counts in 0.001 of that)",
        )
    return scale


def _scale_told(context: FileContext, scale: float, units: Units) -> tuple[str, ...]:
    """Say what a scale is that was told per unit of the axis, where the file has other units."""
    told = context.option_units(units)
    if told is units:
        return ()
    rule = f"file_counts_per_unit is told per {told.value}, the unit of the axis"
    return (f"{scale:.9g} counts per {units.value}: {rule}",)


def _check_turn(source: SourceText, units: Units, file: Increments, sums: Sequence[Sum]) -> None:
    steps = sums[-1].step - sums[0].step
    if is_turn(units, steps, file.interval):
        total = sums[-1].total - sums[0].total
        if total:
            raise source.error(
                f"values that sum up to {total} over a turn: the error would grow with every turn",
                "a sum of 0 over 360 degrees",
                line=sums[-1].line,
            )
    elif units is Units.DEGREE and steps * file.interval > 360.0:
        raise source.error(
            f"{steps} intervals of {file.interval:g} degrees",
            "at most one turn, 360 degrees",
            line=file.csv.rows[4].number,
        )


@dataclass(frozen=True, slots=True)
class Steps:
    """What a writer makes of a table: ``totals`` at all its points, in values; ``zero`` is the reference."""

    interval: float
    magnification: int
    zero: int
    totals: tuple[int, ...]

    def across(self, section: int) -> int:
        """Return the value of a section, counted from 0."""
        return self.totals[section + 1] - self.totals[section]


def round_steps(table: CorrectionTable, options: WriteOptions, system: System, per_count: int) -> Steps:
    """Round the sums, not the steps: no sum is off by more than half a value, however long the table is.

    The smallest magnification that keeps all steps in range is taken.

    Raises:
        TabFileError: no scale told, an uneven grid, no point at 0, a correction there, a turn that does not
            close, a step that is out of range.
    """
    dialect, scale = system.title, options.file_counts_per_unit
    if scale is None or scale <= 0:
        found = "no counts per unit of the old control" if scale is None else f"{scale:g} counts per unit"
        raise unwritable(dialect, found, f"{NEEDS_SCALE}, above 0")
    step = even_step(table, dialect)
    zero = min(range(len(table.positions)), key=lambda index: abs(table.positions[index]))
    if abs(table.positions[zero]) > EVEN_TOLERANCE * step / 2:
        raise unwritable(
            dialect,
            f"no point at 0 (nearest: {table.positions[zero]:g})",
            "a table that has one: its sums begin there",
        )
    means, _ = one_curve(table)
    steps = Steps(step, 1, zero, ())
    for magnification in range(1, system.max_magnification + 1):
        unit = magnification / (scale * per_count)
        steps = Steps(step, magnification, zero, tuple(round(mean / unit) for mean in means))
        if _misfit(steps, system) is None:
            break
    misfit = _misfit(steps, system)
    if misfit is not None:
        raise unwritable(
            dialect,
            f"a step of {steps.across(misfit)} between {table.positions[misfit]:g} and "
            f"{table.positions[misfit + 1]:g} (magnification {steps.magnification})",
            f"{system.lowest_value} to {system.highest_value}: a finer grid, or fewer counts per unit",
        )
    if steps.totals[zero]:
        raise unwritable(
            dialect,
            f"a correction of {means[zero]:.6g} {table.units.value} at 0",
            "0 there: subtract it from the whole table first",
        )
    is_closed = steps.totals[0] == steps.totals[-1]
    if is_turn(table.units, len(steps.totals) - 1, step) and not is_closed:
        raise unwritable(dialect, "a turn whose ends differ", "the same correction at both ends")
    return steps


def _misfit(steps: Steps, system: System) -> int | None:
    return next(
        (
            section
            for section in range(len(steps.totals) - 1)
            if not system.lowest_value <= steps.across(section) <= system.highest_value
        ),
        None,
    )


@dataclass(frozen=True, slots=True)
class Rows:
    """What goes into a file; ``resolution`` is what one value is worth, in units of the table."""

    parameters: tuple[int | str, ...]
    points: list[tuple[int, int]]
    resolution: float


def written(table: CorrectionTable, options: WriteOptions, system: System, rows: Rows) -> Written:
    """Return the text of a file, what it does not hold and what its reader must be told."""
    comments = [f"{system.title}: increments, counted from the reference point"]
    if options.axis is not None:
        comments.append(f"axis: {options.axis.upper()}")
    lines = [f"{name},{number}" for name, number in zip(system.parameters, rows.parameters, strict=True)]
    lines += [",".join(HEADER), *(f"{point},{value}" for point, value in rows.points)]
    _, lost_motion = one_curve(table)
    unit, scale = table.units.value, options.file_counts_per_unit
    told = f"read it with file_units {unit} and file_counts_per_unit {scale:g}"
    losses = (
        f"sums are whole values: a resolution of {rows.resolution:.6g} {unit}",
        *lost_motion,
        f"units and counts are not in the file: {told}",
    )
    context = FileContext(axis=options.axis, file_units=table.units, file_counts_per_unit=scale)
    return Written(csv_file(comments, lines, len(rows.points)), losses, context)
