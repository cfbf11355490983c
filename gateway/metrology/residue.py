"""What a table would leave of an error that was measured without it."""

from dataclasses import replace

from gateway.compensation.table import CorrectionTable
from gateway.metrology.lookup import correction_at
from gateway.metrology.readings import Survey


def predicted_residue(survey: Survey, table: CorrectionTable) -> Survey:
    """Return the readings as they would be with a table in use: each deviation plus the correction there.

    To first order. With the drive at ``m`` the nut stands at ``m + e(m)``; a table sends the drive to
    ``x + c(x)``, so the nut to ``x + c(x) + e(x + c(x))``, of which this takes ``x + c(x) + e(x)``. What it
    leaves out is at most the largest slope of the error times the largest correction: with 50 µm and
    0.001, 0.05 µm. Scatter is taken as it was, noise and all; only a new measurement shows what is new.

    Outside the table its end values are held, and a remark says so: with another policy of the axis less is
    corrected there. The table is taken in the units of the readings.

    Raises:
        ValueError: between a length and an angle.
    """
    here = table.in_units(survey.units)
    return replace(
        survey,
        readings=tuple(
            replace(each, measured=each.measured + correction_at(here, each.target, each.direction))
            for each in survey.readings
        ),
        source=f"{survey.source} (predicted)",
        remarks=(*survey.remarks, *_uncovered(survey, here)),
    )


def _uncovered(survey: Survey, table: CorrectionTable) -> list[str]:
    # The rounding of a conversion puts no target outside.
    margin = 1e-9 * max(abs(table.first), abs(table.last))
    low, high = table.first - margin, table.last + margin
    outside = {each.target for each in survey.readings if not low <= each.target <= high}
    if not outside:
        return []
    remark = (
        f"outside the table, {table.first:.9g} to {table.last:.9g} {table.units.value}, lie targets from "
        f"{min(outside):.9g} to {max(outside):.9g}: predicted with its end values held there"
    )
    return [remark]
