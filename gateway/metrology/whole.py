"""What readings say as a whole: their scale, and whether the machine changed while they were taken."""

from gateway.compensation.units import Units
from gateway.metrology.deviation import small_unit
from gateway.metrology.drift import drift_line, drift_of, e_with_and_without
from gateway.metrology.readings import Survey
from gateway.metrology.scale import ScaleError, scale_of

WORTH_MM = 0.001
"""Over all targets: a linear part that makes less is not worth a word."""


def notes_of(survey: Survey, counts_per_unit: float | None = None, *, with_scale: bool = True) -> list[str]:
    """Return a sentence for each.

    Raises:
        ReadingsError: see :func:`gateway.metrology.readings.mean_corrections`.
    """
    notes = []
    scale = _scale(survey) if with_scale else None
    targets = [each.target for each in survey.readings]
    if scale is not None and abs(scale.share) * (max(targets) - min(targets)) > survey.units.from_mm(
        WORTH_MM
    ):
        notes.append(scale.describe(counts_per_unit))
    drift = drift_of(survey)
    if drift is not None:
        notes.append(drift_line(survey, drift))
    return notes


def _scale(survey: Survey) -> ScaleError | None:
    """Return the linear part; None on a rotary axis, whose turn is a turn."""
    return None if survey.units is Units.DEGREE else scale_of(survey.readings)


def json_of(survey: Survey) -> dict[str, object]:
    """Return the same as plain data; null where there is nothing."""
    scale, drift, small = _scale(survey), drift_of(survey), small_unit(survey.units)
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
