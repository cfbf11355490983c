"""The numbers of an axis, with the defaults that depend on its units and scale filled in."""

from typing import Final

from gateway.compensation.settings import (
    DEFAULT_MAX_CORRECTION_MM,
    DEFAULT_RELOAD_DISTANCE_MM,
    AxisSettings,
    Backlash,
    ThermalSettings,
    default_hysteresis,
)
from gateway.config.axis_model import AxisSection
from gateway.config.terms_model import ThermalSpec

FLOAT_STEP_COUNTS: Final = 1e-6
"""Next to nothing: 1 µm is what counts then."""


def settings_of(axis: AxisSection) -> AxisSettings:
    """Return what the compensation of an axis works with."""
    units = axis.units
    max_correction = axis.max_correction
    if max_correction is None:
        max_correction = units.from_mm(DEFAULT_MAX_CORRECTION_MM)
    hysteresis = axis.hysteresis
    if hysteresis is None:
        hysteresis = default_hysteresis(units, axis.counts_per_unit / _step_counts(axis))
    return AxisSettings(
        units=units,
        counts_per_unit=axis.counts_per_unit,
        zero_counts=axis.zero_counts,
        machine_offset=axis.machine_offset,
        travel=axis.travel,
        travel_margin=max_correction if axis.travel_margin is None else axis.travel_margin,
        setpoints=axis.setpoints,
        hysteresis=hysteresis,
        reversal=axis.reversal,
        reload_distance=units.from_mm(DEFAULT_RELOAD_DISTANCE_MM)
        if axis.reload is None
        else axis.reload.distance,
        outside=axis.outside,
        modulo=axis.modulo or 0.0,
        gain=axis.gain,
        backlash=None if axis.backlash is None else Backlash(axis.backlash.width, axis.backlash.kind),
        max_correction=max_correction,
        max_slope=axis.max_slope,
        max_speed=axis.max_speed,
        fresh_ms=axis.fresh_ms,
        home_approach=axis.home_approach.sign,
    )


def _step_counts(axis: AxisSection) -> float:
    """Return the counts in one step of the registers that tell positions: 1, or a part of one.

    Where a count is a whole millimetre, as with ``float32``, two of them are no hysteresis.
    """
    if axis.registers is None:
        return 1.0
    places = (*axis.registers.command, *axis.registers.actual)
    steps = (FLOAT_STEP_COUNTS if each.type.is_float else each.scale for each in places)
    return min(1.0, max(steps, default=1.0))


def thermal_of(thermal: ThermalSpec) -> ThermalSettings:
    """Return what the relay has to know of ``thermal``: not where the temperature comes from."""
    return ThermalSettings(
        thermal.alpha,
        thermal.reference,
        thermal.fixed_at,
        thermal.timeout_s,
        thermal.hold_s,
        thermal.rate_per_min,
        thermal.largest_dt,
    )
