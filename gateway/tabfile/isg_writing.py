"""Writes compensation lists for the ISG kernel: the other half of :mod:`isg`, which has the grammar."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.context import FileContext
from gateway.tabfile.isg_keys import DEFAULT_MAX_POINTS, NAME, PER_UNIT
from gateway.tabfile.options import ErrorSense
from gateway.tabfile.writing import WriteOptions, Written, unwritable

_DECIMALS: Final = 2
"""0.01 of 0.1 µm is a nanometre."""
_ROUNDING: Final = 0.5 * 10**-_DECIMALS


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table in unit 1, or in increments if the scale of the old control is told.

    Numbers are rounded to 0.01 of the unit. Points on an even grid become an interval, others setpoints.

    Raises:
        TabFileError: inches without a scale, a negative scale, points that fall together once rounded.
    """
    scale = options.file_counts_per_unit
    if scale is None and table.units is Units.INCH:
        found = "a table in inch: lengths are in 0.1 µm"
        raise unwritable(NAME, found, "mm (--to-units mm), or increments (--to-counts-per-unit N)")
    if scale is not None and scale < 0:
        raise unwritable(NAME, f"{scale:g} increments per {table.units.value}", "a scale above 0")
    sense = options.sense or ErrorSense.ACTUAL_MINUS_COMMAND
    factor = PER_UNIT if scale is None else scale
    positions = [round(position * factor, _DECIMALS) for position in table.positions]
    if any(after <= before for before, after in pairwise(positions)):
        found = f"points closer than {10**-_DECIMALS:g} of its unit"
        raise unwritable(NAME, found, "points further apart (--resample STEP), or --to-counts-per-unit N")
    lines = _settings(table, positions, is_metric=scale is None)
    if options.is_modulo:
        lines.append(("kw.ssfk.modulo", "1"))
    if options.axis is not None:
        lines.insert(0, ("kopf.log_achs_name", f"{options.axis.upper()}-ACHSE"))
    branches = [("pos", table.forward)]
    if not table.is_unidirectional:
        branches.append(("neg", table.backward))
    for name, curve in branches:
        for index, correction in enumerate(curve):
            error = _text(sense.to_correction * correction * factor)
            lines.append((f"kw.ssfk.table[{index}].{name}", error))
    context = FileContext(
        axis=options.axis,
        units=None,
        file_counts_per_unit=scale,
        file_units=table.units,
        error_sense=sense,
    )
    return Written(
        "".join(f"{key:<35} {value}\n" for key, value in lines), _losses(positions, scale), context
    )


def _settings(
    table: CorrectionTable, positions: Sequence[float], *, is_metric: bool
) -> list[tuple[str, str]]:
    """Return the lines before the values, those of free positions included."""
    size = len(positions)
    interval = round((positions[-1] - positions[0]) / (size - 1), _DECIMALS)
    is_even = interval > 0 and all(
        abs(position - (positions[0] + index * interval)) < _ROUNDING
        for index, position in enumerate(positions)
    )
    lines = [
        ("kw.ssfk.unit", str(int(is_metric))),
        ("kw.ssfk.interval", _text(interval) if is_even else "0"),
        ("kw.ssfk.kw_startpos", _text(positions[0])),
        ("kw.ssfk.kw_nr_max", str(size)),
        ("kw.ssfk.bilateral", str(int(not table.is_unidirectional))),
    ]
    if size > DEFAULT_MAX_POINTS:
        lines.append(("kw.ssfk.max_points", str(size)))
    if not is_even:
        lines.extend(
            (f"kw.ssfk.table[{index}].setpoint", _text(position)) for index, position in enumerate(positions)
        )
    return lines


def _losses(positions: Sequence[float], scale: float | None) -> tuple[str, ...]:
    unit = "0.1 µm (0.0001 degree)" if scale is None else "an increment"
    losses = [
        f"positions and values are rounded to 0.01 of {unit}; kernels before V3.1.3132 take whole numbers"
    ]
    if len(positions) > DEFAULT_MAX_POINTS:
        losses.append(
            f"{len(positions)} points need a kernel that knows max_points (from V3.1.3079.06), others take "
            f"{DEFAULT_MAX_POINTS}"
        )
    return tuple(losses)


def _text(number: float) -> str:
    """Return a number without the zeros that say nothing."""
    return f"{round(number, _DECIMALS) + 0.0:.{_DECIMALS}f}".rstrip("0").rstrip(".")
