"""Warnings about readings as a whole: unit, ends, scale, a machine that changed during the measurement."""

from collections.abc import Sequence
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.drift import drift_line, drift_of, e_with_and_without
from gateway.metrology.readings import MeanCorrections, Reading, Survey, mean_corrections, small_unit
from gateway.metrology.scale import LEAST_TURNS, is_short, reliable_scale
from gateway.metrology.wrong_runs import offset_notes
from gateway.plain import JsonObject

TINY_MM: Final = 0.0002
"""No screw is as good: the deviations are in a larger unit than stated."""
HUGE_MM: Final = 1.0
"""No screw is as bad: the deviations may be in micrometres."""
LOST_AT_AN_END: Final = 0.25
"""Share of the smallest reversal elsewhere: an end below it has no reversal."""
_LEAST_OTHERS: Final = 3
WORTH_MM: Final = 0.001
"""Over all targets: a smaller linear part is not reported."""


def plausibility_warnings(readings: Sequence[Reading], units: Units) -> list[str]:
    """Return a sentence for each warning; a table can be made in spite of them.

    Raises:
        ReadingsError: see :func:`gateway.metrology.readings.mean_corrections`.
    """
    means = mean_corrections(readings)
    return [*_unit(readings, units), *_ends(means, units)]


def _unit(readings: Sequence[Reading], units: Units) -> list[str]:
    if units is Units.DEGREE:
        return []
    # The zero of the instrument does not matter: only the differences of the deviations count.
    deviations = [each.deviation for each in readings]
    largest = max(deviations) - min(deviations)
    if not 0.0 < largest < units.from_mm(TINY_MM) and largest <= units.from_mm(HUGE_MM):
        return []
    difference = f"{largest:.3g} {units.value}"
    return [f"check the unit of the numbers: all deviations together differ by {difference}"]


def _ends(means: MeanCorrections, units: Units) -> list[str]:
    reversals = {
        target: forward - backward
        for target, forward, backward in zip(means.targets, means.forward, means.backward, strict=True)
        if forward is not None and backward is not None
    }
    found = []
    for end in (means.targets[0], means.targets[-1]):
        others = [
            size for target, size in reversals.items() if target not in (means.targets[0], means.targets[-1])
        ]
        if end not in reversals or len(others) < _LEAST_OTHERS or min(others) * max(others) <= 0.0:
            continue
        least = min(map(abs, others))
        if abs(reversals[end]) < LOST_AT_AN_END * least:
            found.append(
                f"at {end:.9g} both directions differ by {abs(reversals[end]):.3g} {units.value}, "
                f"elsewhere by at least {least:.3g}. If the axis reversed there without going beyond, both "
                "readings are of one direction: measure with an overrun larger than the lost motion"
            )
    return found


def notes_of(
    survey: Survey,
    counts_per_unit: float | None = None,
    *,
    with_scale: bool = True,
    lead: float | None = None,
) -> list[str]:
    """Return a sentence for each; ``lead`` is the longest possible period of the error.

    Raises:
        ReadingsError: see :func:`gateway.metrology.readings.mean_corrections`.
    """
    notes = offset_notes(survey)
    notes += _scale_notes(survey, counts_per_unit, lead) if with_scale else []
    drift = drift_of(survey)
    if drift is not None:
        notes.append(drift_line(survey, drift))
    return notes


def _scale_notes(survey: Survey, counts_per_unit: float | None, lead: float | None) -> list[str]:
    scale = reliable_scale(survey, lead)
    if scale is not None:
        is_worth_it = abs(scale.share) * survey.span > survey.units.from_mm(WORTH_MM)
        return [scale.describe(counts_per_unit)] if is_worth_it else []
    if survey.units is Units.DEGREE or not is_short(survey, lead):
        return []
    hint = "" if lead is not None else ", or give the lead (--lead) if the range is that long"
    text = (
        f"to find the scale, measure over {LEAST_TURNS} turns or more{hint}. These readings cover "
        f"{survey.span:.6g} {survey.units.value}, only a few turns of the screw"
    )
    return [text]


def json_of(survey: Survey, lead: float | None = None) -> JsonObject:
    """Return the same as plain data, with null for no value."""
    scale, drift, small = reliable_scale(survey, lead), drift_of(survey), small_unit(survey.units)
    was, steady = (0.0, 0.0) if drift is None else e_with_and_without(survey, drift)
    return {
        "scale": None
        if scale is None
        else {"um_per_m": scale.share * 1e6, "counts_per_unit_factor": scale.counts_factor},
        "drift": None
        if drift is None
        else {
            "growth_um_per_m": drift.growth * 1e6,
            "kelvin_of_steel": drift.kelvin_of_steel,
            f"shift_{small.key}": drift.offset * small.factor,
            f"e_{small.key}": was * small.factor,
            f"e_without_{small.key}": steady * small.factor,
        },
    }
