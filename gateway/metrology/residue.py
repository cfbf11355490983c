"""What a table leaves: predicted at the targets from readings without it, and between them."""

from dataclasses import replace
from typing import Final, NamedTuple

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.evaluation import Evaluation
from gateway.metrology.lead import Period
from gateway.metrology.readings import Small, Survey, small_unit
from gateway.metrology.tables import correction_at
from gateway.plain import JsonObject

NOT_JUDGED: Final = "not known from these readings: too few or too many targets"


# --- At the targets


def predicted_residue(survey: Survey, table: CorrectionTable) -> Survey:
    """Return the readings as predicted with a table in use: each deviation plus the correction there.

    To first order. With the drive at ``m`` the nut is at ``m + e(m)``. A table sends the drive to ``x +
    c(x)``, so the nut to ``x + c(x) + e(x + c(x))``; this computes ``x + c(x) + e(x)``. The difference is at
    most the largest slope of the error times the largest correction: with 50 µm and 0.001, 0.05 µm. Scatter
    does not change, noise included; only a new measurement shows the new scatter.

    Outside the table its end values hold, and a remark says so: with another policy of the axis less is
    corrected there. The table is converted to the units of the readings.

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
    # The rounding of a conversion must put no target outside.
    margin = 1e-9 * max(abs(table.first), abs(table.last))
    low, high = table.first - margin, table.last + margin
    outside = {each.target for each in survey.readings if not low <= each.target <= high}
    if not outside:
        return []
    remark = (
        f"targets from {min(outside):.9g} to {max(outside):.9g} are outside the table, {table.first:.9g} "
        f"to {table.last:.9g} {table.units.value}: predicted with its end values held"
    )
    return [remark]


# --- Between the targets


class LeftOut(NamedTuple):
    """E that a table leaves between the targets, predicted by leaving out, in the units of the readings.

    Half of the curves that the readings allow leave more than ``e``, and nine of ten between ``low`` and
    ``high``. What repeats with ``unseen`` is in none of them, because every target confuses it with a slower
    curve. Then the readings give no upper bound: ``e`` and ``high`` are None, and at least ``low`` is left.
    """

    e: float | None
    low: float
    high: float | None
    unseen: tuple[Period, ...] = ()
    unsettled: str = ""
    """What must be resolved first: runs that do not fit the others."""

    @property
    def unknown(self) -> str:
        """The reason why the readings do not determine it, in words; empty if they do."""
        if self.unsettled:
            return f"not known from these readings: {self.unsettled}"
        names = " and ".join(each.name for each in self.unseen)
        if not names:
            return ""
        return (
            "not known from these readings: their targets cannot separate an error that repeats with "
            f"{names} from a slower curve"
        )


def left_out_json(units: Units, left_out: LeftOut | None, when: str = "") -> JsonObject:
    """Return E between the targets, predicted by leaving out, and its bounds.

    Null is for what the readings do not determine, with the reason, and the unseen periods as lengths in the
    units of the readings.
    """
    small = small_unit(units)
    names = (f"left_out_e{when}", f"left_out_e_low{when}", f"left_out_e_high{when}")
    numbers: tuple[float | None, ...] = (None,) * len(names)
    if left_out is not None and not left_out.unsettled:
        numbers = (left_out.e, left_out.low, left_out.high)
    lengths = {
        f"{name}_{small.key}": None if number is None else number * small.factor
        for name, number in zip(names, numbers, strict=True)
    }
    return {
        **lengths,
        f"left_out_unknown{when}": (NOT_JUDGED if left_out is None else left_out.unknown) or None,
        f"left_out_unseen_periods{when}": [each.length for each in left_out.unseen] if left_out else [],
    }


def predicted_json(predicted: Evaluation, left_out: LeftOut | None) -> JsonObject:
    """Return the predicted E at the targets and between them."""
    small = small_unit(predicted.units)
    at_targets = None if predicted.systematic is None else predicted.systematic * small.factor
    return {f"e_{small.key}": at_targets, **left_out_json(predicted.units, left_out)}


def left_out_line(before: Evaluation, left_out: LeftOut) -> str:
    """Return what the table will leave where there are no readings."""
    small = small_unit(before.units)
    was = ""
    if before.systematic is not None:
        was = f"; at the targets it was {small.text(before.systematic)} before"
    return f"between its points the table will leave {left_out_text(small, left_out)}{was}"


def left_out_text(small: Small, left_out: LeftOut) -> str:
    """Return E between the targets with its bounds, and what these do not include."""
    if left_out.unsettled:
        return f"an E that is {left_out.unknown}"
    if left_out.e is None or left_out.high is None:
        return f"at least E = {small.text(left_out.low)}; its full size is {left_out.unknown}"
    return (
        f"E = {small.text(left_out.e)} (predicted by leaving out; {small.text(left_out.low)} to "
        f"{small.text(left_out.high)} in nine of ten cases)"
    )
