"""The sign test: whether two readings, or a move, show that an axis is used with the right sign.

report = judge_readings(plan, at=-250.0, forward_reading=-249.99, backward_reading=-249.981)
print(report.test.verdict.value, report.remedy)
"""

from collections.abc import Iterator
from dataclasses import dataclass

from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.curve import Curve
from gateway.compensation.settings import BacklashKind
from gateway.compensation.table import CorrectionTable
from gateway.exchange.plan import AxisPlan
from gateway.metrology.errors import ReadingsError
from gateway.metrology.scale import TRIAL_MOVE, fault_of_trial
from gateway.metrology.sign_test import (
    NOTHING,
    Measurement,
    Pair,
    SignTest,
    SignVerdict,
    TableUse,
    most_telling_position,
    room,
    sign_test,
)
from gateway.plain import JsonObject

UNCERTAINTY_MM = 0.002
"""Uncertainty of a dial gauge with 1 µm marks or a laser in a workshop."""
STEPS = 2
DECIMALS = 6
APPROACH_MM = 1.0
"""In addition to the hysteresis; the same as the overrun of measure."""
COLUMNS = {
    "centroid-2": "exchange its two lists: the first is forward, the one after the comment backward",
    "centroid-3": "exchange its second and third column: away from home, towards home",
}
SENSE = (
    "change the sign of every correction in {file}: it must contain target - measured (the amount to add), "
    "but contains measured - target"
)
DIRECTION = (
    "the axis or the instrument counts the other way: change the sign of counts_per_unit (not "
    "zero_counts), or change the sign of the instrument and measure again"
)
HOMED = {
    BacklashKind.HOMED_FORWARD: BacklashKind.HOMED_BACKWARD,
    BacklashKind.HOMED_BACKWARD: BacklashKind.HOMED_FORWARD,
}
NEGATIVE = (
    "take both readings again, each approached from its own side: they give a lost motion below 0, which "
    "no screw has"
)
OF_A_TABLE = frozenset({SignVerdict.SENSE_INVERTED, SignVerdict.COLUMNS_SWAPPED, SignVerdict.BOTH})
WIDTH = 50
UNITS_RATIO = 2.0
ROUGHLY = 0.25
"""A scaled table explains readings if at most this share of it remains."""


@dataclass(frozen=True, slots=True)
class SignReport:
    """A sign test of one axis, on the controller's scale."""

    plan: AxisPlan
    nominal_position: float
    uncertainty: float
    test: SignTest

    @property
    def remedy(self) -> str:
        """What to change; empty for no change."""
        file = self.plan.table_name
        if not file and self.test.verdict in OF_A_TABLE:
            return self._remedy_of_backlash()
        columns = COLUMNS.get(self.plan.table_format, "exchange the corrections of its two directions")
        return {
            SignVerdict.RIGHT: "",
            SignVerdict.SENSE_INVERTED: SENSE.format(file=file),
            SignVerdict.COLUMNS_SWAPPED: f"in {file} {columns}",
            SignVerdict.BOTH: f"{SENSE.format(file=file)}; and {columns}",
            SignVerdict.DIRECTION_INVERTED: DIRECTION,
            SignVerdict.CANNOT_TELL: self._better_position(),
            SignVerdict.NOTHING_FITS: self._why_nothing(),
        }[self.test.verdict]

    def _remedy_of_backlash(self) -> str:
        """What to change if the axis has no table but a backlash, which cannot have a wrong sign."""
        backlash = self.plan.settings.backlash
        other = None if backlash is None else HOMED.get(backlash.kind)
        if self.test.verdict is not SignVerdict.BOTH or other is None:
            return NEGATIVE
        return f'in backlash of [axis.{self.plan.name}] write kind = "{other.value}"'

    def lines(self) -> Iterator[str]:
        """Yield the report, line by line."""
        test, units = self.test, self.plan.settings.units.value
        corrected_by = f"table {self.plan.table_name}" if self.plan.table_name else "backlash alone"
        yield f"axis {self.plan.name} at {self.nominal_position:.6g} {units}, {corrected_by}"
        yield f"{'':<{WIDTH}} {'forward':>12} {'backward':>12}   off by"
        yield _row("the readings require", test.measured.forward, test.measured.backward)
        yield _row(
            "the table adds" if self.plan.table_name else "the backlash adds",
            test.table.forward,
            test.table.backward,
        )
        for way, pair in test.expected.items():
            forward, backward = test.position - pair.forward, test.position - pair.backward
            yield f"{_row(f'it would be, {way.value}', forward, backward)}   {test.off_by[way]:.6g}"
        yield f"verdict: {test.verdict.value}{self._among()}"
        if self.remedy:
            yield f"  {self.remedy}"
        if test.is_right and not test.tells_direction:
            yield "  so near its zero the readings do not show whether the axis itself goes the right way"

    def as_data(self) -> JsonObject:
        """Return everything for scripts."""
        test = self.test
        return {
            "axis": self.plan.name,
            "units": self.plan.settings.units.value,
            "position": self.nominal_position,
            "uncertainty": self.uncertainty,
            "verdict": test.verdict.value,
            "candidates": [way.value for way in test.candidates],
            "measured": {"forward": test.measured.forward, "backward": test.measured.backward},
            "table": {"forward": test.table.forward, "backward": test.table.backward},
            "off_by": {way.value: distance for way, distance in test.off_by.items()},
            "share": test.share,
            "tells_direction": test.tells_direction,
            "best": {"position": self._best_nominal(), "separation": test.best.separation},
            "remedy": self.remedy,
        }

    def _among(self) -> str:
        if self.test.verdict is not SignVerdict.CANNOT_TELL:
            return ""
        return f": {' or '.join(way.value for way in self.test.candidates)}"

    def _best_nominal(self) -> float:
        return self.test.best.position - self.plan.settings.machine_offset

    def _better_position(self) -> str:
        best, units = self.test.best, self.plan.settings.units.value
        wrong = (
            "" if TableUse.RIGHT in self.test.candidates else "the table is used wrongly; to find out how: "
        )
        if best.separation <= 2.0 * self.uncertainty:
            return (
                f"{wrong}the readings must be better than ±{best.separation / 2.0:.4g} {units} "
                "(--uncertainty): right and wrong use of this table differ nowhere by more than "
                f"{best.separation:.4g} {units}"
            )
        return (
            f"{wrong}measure at {self._best_nominal():.6g} {units}, where right and wrong use differ by "
            f"{best.separation:.4g} {units}, or with a smaller --uncertainty"
        )

    def _why_nothing(self) -> str:
        test, units = self.test, self.plan.settings.units.value
        shift = test.measured.forward - test.table.forward
        if abs(shift - (test.measured.backward - test.table.backward)) <= 2.0 * self.uncertainty:
            return (
                "set the zero of the instrument at the position where the table is 0, approached in that "
                f"direction: both readings are off by the same {shift:.6g} {units}"
            )
        if self._is_scaled():
            return (
                "check the units of the table and file_counts_per_unit: the readings are about "
                f"{test.share:.3g} times its values"
            )
        return (
            "check that the table was made for this screw, that the compensation was off, and that each "
            "reading was approached from far enough on its side"
        )

    def _is_scaled(self) -> bool:
        """Whether the table, times a number that is far from 1, explains the readings."""
        test, share = self.test, self.test.share
        if share is None or 1.0 / UNITS_RATIO < abs(share) < UNITS_RATIO:
            return False
        scaled = Pair(share * test.table.forward, share * test.table.backward)
        allowed = max(2.0 * self.uncertainty, ROUGHLY * scaled.distance(NOTHING))
        return test.measured.distance(scaled) <= allowed


def _row(name: str, forward: float, backward: float) -> str:
    return f"{name:<{WIDTH}} {forward:>+12.6f} {backward:>+12.6f}"


@dataclass(frozen=True, slots=True)
class TrialMove:
    """A move of a known length, and the resulting fault of ``counts_per_unit``."""

    plan: AxisPlan
    commanded: float
    moved: float
    fault: str
    """Empty if its size and sign are right."""

    def as_data(self) -> JsonObject:
        """Return everything for scripts."""
        return {
            "axis": self.plan.name,
            "units": self.plan.settings.units.value,
            "commanded": self.commanded,
            "moved": self.moved,
            "fault": self.fault,
        }

    def lines(self) -> Iterator[str]:
        """Yield the report, line by line."""
        units = self.plan.settings.units.value
        right = f"it moved by {self.moved:.6g} {units}: counts_per_unit has the right size and sign"
        yield f"axis {self.plan.name}: {self.fault or right}"


def judge_move(plan: AxisPlan, moved: float) -> TrialMove:
    """Judge the actual length of a commanded :data:`TRIAL_MOVE`.

    Raises:
        ReadingsError: it is not a number.
    """
    settings = plan.settings
    fault = fault_of_trial(moved, settings.counts_per_unit, settings.units)
    return TrialMove(plan, TRIAL_MOVE[settings.units], moved, fault)


def judge_readings(
    plan: AxisPlan,
    at: float,
    forward_reading: float,
    backward_reading: float,
    uncertainty: float | None = None,
) -> SignReport:
    """Judge two readings of an axis with a table at one position, approached from both sides.

    All are on the controller's scale, in units of the axis. ``uncertainty``: of a reading; None: the usual
    one.

    Raises:
        ReadingsError: the axis has no table, the position is outside it, or a value is not a number.
    """
    settings, table = plan.settings, table_of(plan)
    curve = _curve(plan)
    if uncertainty is None:
        uncertainty = usual_uncertainty(plan)
    offset = settings.machine_offset
    position = at + offset
    measurement = Measurement(
        position,
        Pair(forward_reading + offset, backward_reading + offset),
        uncertainty,
        # The error of a worn screw is up to the largest correction; the opposite sign doubles that.
        largest=2.0 * settings.max_correction,
        # The axis counts the other way about machine zero, or the instrument about its own.
        mirrored=(-position, offset - at),
    )
    if not curve.covers(position):
        raise ReadingsError(
            f"{at:g} is outside its table, {table.first - offset:g} to {table.last - offset:g}: measure "
            "inside it"
        )
    return SignReport(plan, at, uncertainty, sign_test(curve, measurement, _inside(plan)))


def usual_uncertainty(plan: AxisPlan) -> float:
    """Return the usual uncertainty of a reading, in units of the axis."""
    settings = plan.settings
    return max(settings.units.from_mm(UNCERTAINTY_MM), STEPS * settings.step)


def best_position(plan: AxisPlan) -> float:
    """Return the most telling position for readings, on the controller's scale.

    Raises:
        ReadingsError: the axis has no table.
    """
    position = most_telling_position(_curve(plan), _inside(plan)).position
    return round(position - plan.settings.machine_offset, DECIMALS)


def table_of(plan: AxisPlan) -> CorrectionTable:
    """Return the table of an axis. Raises ReadingsError: it has none."""
    if plan.table is None:
        raise ReadingsError(f"axis.{plan.name}.table: missing; name the table to test")
    return plan.table


def _curve(plan: AxisPlan) -> Curve:
    curve = spec_of_table(table_of(plan), plan.settings).curve
    assert curve is not None, "of a table"
    return curve


def approach_of(plan: AxisPlan) -> float:
    """Return the distance of approach to a position, in units: more than the axis ignores as no move."""
    settings = plan.settings
    return settings.units.from_mm(APPROACH_MM) + settings.hysteresis


def _inside(plan: AxisPlan) -> tuple[float, float] | None:
    """Return the range for a sign test, in machine positions; None: everywhere (a rotary axis)."""
    settings = plan.settings
    return None if settings.modulo else room(table_of(plan), settings.travel, approach_of(plan))
