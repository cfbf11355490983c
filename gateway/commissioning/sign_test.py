"""What a sign test says, and what to change because of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gateway.compensation.settings import BacklashKind
from gateway.exchange.plan import AxisPlan
from gateway.metrology.sign_test import NOTHING, Pair, SignTest, Verdict, Way

COLUMNS = {
    "centroid-2": "exchange its two lists: the first is forward, the one behind the comment backward",
    "centroid-3": "exchange its second and third column: away from home, towards home",
}
SENSE = (
    "turn the sign of every correction in {file}: it has to hold target less measured, the amount to add, "
    "and holds measured less target"
)
DIRECTION = (
    "the axis goes the other way: turn the sign of counts_per_unit (with zero_counts as it is), or the "
    "instrument counts the other way: turn its sign and measure again"
)
HOMED = {
    BacklashKind.HOMED_FORWARD: BacklashKind.HOMED_BACKWARD,
    BacklashKind.HOMED_BACKWARD: BacklashKind.HOMED_FORWARD,
}
NEGATIVE = (
    "the readings ask for a lost motion below 0, which no screw has: take both again, each one approached "
    "from its own side"
)
OF_A_TABLE = frozenset({Verdict.SENSE_INVERTED, Verdict.COLUMNS_SWAPPED, Verdict.BOTH})
WIDTH = 50
UNITS_RATIO = 2.0
ROUGHLY = 0.25
"""A scaled table explains readings when no more than this share of it is left over."""


@dataclass(frozen=True, slots=True)
class SignReport:
    """A sign test of one axis, on the controller's scale."""

    plan: AxisPlan
    nominal_position: float
    uncertainty: float
    test: SignTest

    @property
    def remedy(self) -> str:
        """What to change; empty when nothing is to be changed."""
        file = self.plan.table_name
        if not file and self.test.verdict in OF_A_TABLE:
            return self._remedy_of_backlash()
        columns = COLUMNS.get(self.plan.table_format, "exchange the corrections of its two directions")
        return {
            Verdict.RIGHT: "",
            Verdict.SENSE_INVERTED: SENSE.format(file=file),
            Verdict.COLUMNS_SWAPPED: f"in {file} {columns}",
            Verdict.BOTH: f"{SENSE.format(file=file)}; and {columns}",
            Verdict.DIRECTION_INVERTED: DIRECTION,
            Verdict.CANNOT_TELL: self._better_place(),
            Verdict.NOTHING_FITS: self._why_nothing(),
        }[self.test.verdict]

    def _remedy_of_backlash(self) -> str:
        """What to change where the axis has no table but a backlash, of which a sign cannot be wrong."""
        backlash = self.plan.settings.backlash
        other = None if backlash is None else HOMED.get(backlash.kind)
        if self.test.verdict is not Verdict.BOTH or other is None:
            return NEGATIVE
        return f'in backlash of [axis.{self.plan.name}] write kind = "{other.value}"'

    def text(self) -> Iterator[str]:
        """Yield the report, line by line."""
        test, units = self.test, self.plan.settings.units.value
        corrected_by = f"table {self.plan.table_name}" if self.plan.table_name else "backlash alone"
        yield f"axis {self.plan.name} at {self.nominal_position:.6g} {units}, {corrected_by}"
        yield f"{'':<{WIDTH}} {'forward':>12} {'backward':>12}   off by"
        yield _row("the readings ask for", test.measured.forward, test.measured.backward)
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
            yield "  this near its zero nothing tells whether the axis itself goes the right way"

    def as_json(self) -> dict[str, Any]:
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
        if self.test.verdict is not Verdict.CANNOT_TELL:
            return ""
        return f": {' or '.join(way.value for way in self.test.candidates)}"

    def _best_nominal(self) -> float:
        return self.test.best.position - self.plan.settings.machine_offset

    def _better_place(self) -> str:
        best, units = self.test.best, self.plan.settings.units.value
        wrong = "" if Way.RIGHT in self.test.candidates else "the table is used wrongly; to tell how: "
        if best.separation <= 2.0 * self.uncertainty:
            return (
                f"{wrong}nowhere does this table differ by more than {best.separation:.4g} {units} from "
                "itself used wrongly: the readings have to be better than "
                f"±{best.separation / 2.0:.4g} {units} (--uncertainty)"
            )
        return (
            f"{wrong}measure at {self._best_nominal():.6g} {units}, where the ways differ by "
            f"{best.separation:.4g} {units}, or with a smaller --uncertainty"
        )

    def _why_nothing(self) -> str:
        test, units = self.test, self.plan.settings.units.value
        shift = test.measured.forward - test.table.forward
        if abs(shift - (test.measured.backward - test.table.backward)) <= 2.0 * self.uncertainty:
            return (
                f"both readings are off by the same {shift:.6g} {units}: the instrument's zero is not the "
                "table's; set it to the position where the table is 0, approached in that direction"
            )
        if self._is_scaled():
            return (
                f"the readings are about {test.share:.3g} times what the table says: check its units and "
                "file_counts_per_unit"
            )
        return (
            "the screw is not the one that the table was made for, or the readings were not taken with the "
            "compensation off, approached from far enough on either side"
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
