"""The numbers of an axis, with the defaults that depend on its units and scale."""

from dataclasses import replace
from typing import Final

from gateway.compensation.settings import (
    DEFAULT_IN_POSITION_MM,
    DEFAULT_RELOAD_DISTANCE_MM,
    AxisSettings,
    Backlash,
    ThermalSettings,
    default_hysteresis,
    default_max_correction,
)
from gateway.config.axis_model import AxisSection
from gateway.config.terms_model import ThermalSpec
from gateway.drives.strict import planned

SOME_COUNTS: Final = 1e4
"""Assumed end of an axis without travel, for the steps of a ``float32``: 10 m in mm."""


def settings_of(axis: AxisSection) -> AxisSettings:
    """Return the settings of an axis's compensation."""
    units = axis.units
    max_correction = axis.max_correction
    if max_correction is None:
        length = axis.travel[1] - axis.travel[0] if axis.travel else 0.0
        max_correction = default_max_correction(units, length)
    settings = AxisSettings(
        **planned(AxisSettings, axis),
        travel_margin=max_correction if axis.travel_margin is None else axis.travel_margin,
        reload_distance=units.from_mm(DEFAULT_RELOAD_DISTANCE_MM)
        if axis.reload is None
        else axis.reload.distance,
        modulo=axis.modulo or 0.0,
        backlash=None if axis.backlash is None else Backlash(axis.backlash.width, axis.backlash.kind),
        max_correction=max_correction,
        home_approach=axis.home_approach.sign,
        in_position=units.from_mm(DEFAULT_IN_POSITION_MM) if axis.in_position is None else axis.in_position,
        repeat_within_counts=axis.repeat_within,
    )
    settings = replace(settings, step_counts=_step_counts(axis, settings))
    if axis.hysteresis is not None:
        return replace(settings, hysteresis=axis.hysteresis)
    return replace(settings, hysteresis=default_hysteresis(units, settings.step))


def _step_counts(axis: AxisSection, settings: AxisSettings) -> float:
    """Return the counts in one step of the position registers: 1 or less.

    If a count is a whole millimetre, as possible with ``float32``, steps are finer than a count.
    """
    if axis.registers is None:
        return 1.0
    largest_counts = settings.largest_counts or SOME_COUNTS
    fields = (*axis.registers.command, *axis.registers.actual)
    return min(1.0, max((each.field().step_counts(largest_counts) for each in fields), default=1.0))


def thermal_of(thermal: ThermalSpec) -> ThermalSettings:
    """Return the relay's part of ``thermal``: without the source of the temperature."""
    return ThermalSettings(**planned(ThermalSettings, thermal))
