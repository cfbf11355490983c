"""What readings say as a whole: their scale, and whether the machine changed while they were taken."""

from gateway.compensation.units import Units
from gateway.metrology.drift import drift_line, drift_of, e_with_and_without
from gateway.metrology.readings import Survey, small_unit
from gateway.metrology.scale import LEAST_TURNS, is_short, told_scale
from gateway.metrology.wrong_runs import aside_notes

WORTH_MM = 0.001
"""Over all targets: a linear part that makes less is not worth a word."""


def notes_of(
    survey: Survey,
    counts_per_unit: float | None = None,
    *,
    with_scale: bool = True,
    lead: float | None = None,
) -> list[str]:
    """Return a sentence for each; ``lead`` is the longest length after which the error may repeat.

    Raises:
        ReadingsError: see :func:`gateway.metrology.readings.mean_corrections`.
    """
    notes = aside_notes(survey)
    notes += _scale_notes(survey, counts_per_unit, lead) if with_scale else []
    drift = drift_of(survey)
    if drift is not None:
        notes.append(drift_line(survey, drift))
    return notes


def _scale_notes(survey: Survey, counts_per_unit: float | None, lead: float | None) -> list[str]:
    targets = [each.target for each in survey.readings]
    span = max(targets) - min(targets)
    scale = told_scale(survey, lead)
    if scale is not None:
        is_worth_it = abs(scale.share) * span > survey.units.from_mm(WORTH_MM)
        return [scale.describe(counts_per_unit)] if is_worth_it else []
    if survey.units is Units.DEGREE or not is_short(survey, lead):
        return []
    told = "" if lead is not None else ", or tell the lead (--lead) if that is so many turns"
    said = (
        f"the readings span {span:.6g} {survey.units.value}, a few turns of the screw: they tell no scale. "
        f"For it, measure over {LEAST_TURNS} turns and more{told}"
    )
    return [said]


def json_of(survey: Survey, lead: float | None = None) -> dict[str, object]:
    """Return the same as plain data; null where there is nothing."""
    scale, drift, small = told_scale(survey, lead), drift_of(survey), small_unit(survey.units)
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
