"""A model of docs/thermal-and-cross.md: it computes the targets of an axis independently of the gateway.

``Heat`` is the effective difference of temperature, ``Nearby`` the term of the other axis, ``Model`` one
axis: its table between points, its gain, its thermal line. It uses no result of the gateway.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from gateway.compensation.settings import Gain, ThermalSettings
from gateway.compensation.table import CorrectionTable
from gateway.exchange.plan import CrossPlan
from gateway.modbus.registers import PositionField

S = 1_000_000_000


def between(positions: Sequence[float], values: Sequence[float], x: float) -> float:
    """Value on the straight lines between points; that of the end beyond it."""
    if x <= positions[0]:
        return values[0]
    for i in range(1, len(positions)):
        if x <= positions[i]:
            share = (x - positions[i - 1]) / (positions[i] - positions[i - 1])
            return values[i - 1] + share * (values[i] - values[i - 1])
    return values[-1]


@dataclass
class Heat:
    """Takes the first value immediately and follows the next ones at a rate. Holds a value while the sensor
    is silent, then fades to 0."""

    settings: ThermalSettings
    kelvin: float = 0.0
    goal: float | None = None
    heard_ns: int | None = None
    at_ns: int = 0
    is_of_another_alpha: bool = False
    """Taken over from a run in which it was worked out with other numbers: the next value counts at once."""

    def at(self, now_ns: int) -> float:
        """Advance to a time."""
        if self.heard_ns is not None:
            silent_s = self.settings.timeout_s + self.settings.hold_s
            fades_ns = self.heard_ns + int(silent_s * S)
            if self.goal is not None:
                self._go(self.goal, min(now_ns, fades_ns) - self.at_ns)
            self._go(0.0, now_ns - max(self.at_ns, fades_ns))
        self.at_ns = now_ns
        return self.kelvin

    def hear(self, celsius: float, now_ns: int) -> None:
        """Take a value of the sensor."""
        self.at(now_ns)
        self.goal = celsius - self.settings.reference
        if self.heard_ns is None or self.is_of_another_alpha:
            self.kelvin = self.goal
        self.is_of_another_alpha = False
        self.heard_ns = now_ns

    def _go(self, goal: float, ns: int) -> None:
        most = max(0, ns) * self.settings.rate_per_min / 60.0 / S
        self.kelvin += max(-most, min(most, goal - self.kelvin))


@dataclass
class Nearby:
    """The other axis by its last target, else by a fresh reading. Else the term is held, and then fades over
    the same time."""

    plan: CrossPlan
    adds: float = 0.0
    held: float = 0.0
    lost_ns: int | None = None

    def look(self, place: float | None, now_ns: int) -> float:
        """Return what it adds to a target that comes now."""
        if place is not None:
            self.adds = self.held = between(self.plan.positions, self.plan.corrections, place)
            self.lost_ns = None
        elif self.lost_ns is None:
            self.lost_ns = now_ns
        else:
            lost = (now_ns - self.lost_ns) / (self.plan.fresh_s * S)
            self.adds = self.held * max(0.0, min(1.0, 2.0 - lost))
        return self.adds


@dataclass
class Model:
    """One axis as its controller and its drive have it."""

    name: str
    command: PositionField
    actual: PositionField
    counts_per_unit: float
    zero_counts: float
    table: CorrectionTable
    heat: Heat | None
    nearby: Nearby | None
    gain: Gain = field(default_factory=Gain)
    is_on: bool = True
    is_referenced: bool = True
    nominal: float | None = None
    """The last target that counts; None: nobody knows."""
    told: float | None = None
    read: tuple[float, int] | None = None
    """The last reading of its actual position, and when it was asked for."""

    def position(self, counts: float) -> float:
        """Machine position of counts."""
        return (counts - self.zero_counts) / self.counts_per_unit

    def place(self, now_ns: int, fresh_s: float) -> float | None:
        """Return its position for the cross term of another axis."""
        if not self.is_referenced:
            return None
        if self.nominal is not None:
            return self.position(self.nominal)
        if self.read is not None and now_ns - self.read[1] <= fresh_s * S:
            return self.position(self.read[0])
        return None

    def line(self, other: "Model", now_ns: int) -> tuple[float, float]:
        """Return offset and slope that are added to the table for a target that comes now."""
        offset = slope = 0.0
        if self.heat is not None:
            slope = -self.heat.settings.alpha * self.heat.at(now_ns)
            offset = -slope * self.heat.settings.fixed_at
        if self.nearby is not None:
            offset += self.nearby.look(other.place(now_ns, self.nearby.plan.fresh_s), now_ns)
        return offset, slope

    def may_be_told(self, counts: float, line: tuple[float, float]) -> list[float]:
        """Return the possible counts for a target: those of its branch, or of all branches if it is
        unknown."""
        if not self.is_on or not self.is_referenced:
            return [counts]
        x, columns = self.position(counts), (self.table.forward, self.table.backward)
        forward, backward = (between(self.table.positions, column, x) for column in columns)
        branches = [self.gain.forward * forward, self.gain.backward * backward]
        before = self.nominal
        if before is None or abs(counts - before) <= 2:  # within the hysteresis of a reading
            branches.append(0.5 * sum(branches))
        else:
            branches = branches[:1] if x > self.position(before) else branches[1:]
        more = line[0] + line[1] * x
        return [counts + self.counts_per_unit * (branch + more) for branch in branches]

    def slack(self) -> float:
        """Return the tolerance: half a count for a rest, half a count for rounding, and 4 ms of a moving
        term."""
        slack = 1.0 + 1e-6
        if self.heat is not None:
            per_s = self.heat.settings.alpha * self.heat.settings.rate_per_min / 60.0 * 1200.0
            slack += 0.004 * per_s * abs(self.counts_per_unit)
        if self.nearby is not None:
            slack += 0.004 * 0.4 / self.nearby.plan.fresh_s * abs(self.counts_per_unit)
        return slack + (0.07 if self.command.type.is_float else 0.0)
