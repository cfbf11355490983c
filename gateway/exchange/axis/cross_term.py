"""What the position of another axis adds to an axis: straightness, sag, squareness."""

from collections.abc import Mapping
from typing import NamedTuple

from gateway.compensation.curve import Curve
from gateway.compensation.moves import Accepted
from gateway.compensation.table import make_table
from gateway.counts import Counts
from gateway.exchange.axis.motion import Motion
from gateway.exchange.axis.reference import AxisReference
from gateway.exchange.plan import AxisPlan, CrossPlan
from gateway.times import NS_PER_S


class Partner(NamedTuple):
    """What a term needs of another axis: where it is, and whether it is referenced."""

    motion: Motion
    reference: AxisReference


class CrossTerm:
    """One table over the position of another axis."""

    __slots__ = ("_correction", "_plan", "largest", "partner", "seen")

    def __init__(self, plan: CrossPlan, axis: AxisPlan) -> None:
        units = axis.settings.units
        table = make_table(plan.positions, plan.corrections, plan.corrections, units)
        self._correction = Curve(table, modulo=plan.modulo).forward
        self.largest = max(map(abs, plan.corrections))
        """The largest correction that it adds, in units."""
        self._plan = plan
        self.partner: Partner | None = None
        self.seen: Accepted | None = None

    def join(self, axes: Mapping[str, Partner]) -> None:
        """Find the other axis among these."""
        self.partner = axes.get(self.axis, self.partner)

    def refresh(self) -> None:
        """Use the last target of the other axis from now on."""
        self.seen = self.target

    @property
    def axis(self) -> str:
        """Name of the other axis."""
        return self._plan.axis

    @property
    def referenced_partner(self) -> Partner | None:
        """The other axis, if it exists, is referenced and its registers were not remapped; else None."""
        partner = self.partner
        if partner is None or partner.reference.is_remapped or not partner.reference.is_referenced:
            return None
        return partner

    @property
    def target(self) -> Accepted | None:
        """The last accepted target of the other axis, if it says where that axis is; else None."""
        partner = self.referenced_partner
        return None if partner is None else partner.motion.compensation.accepted

    def position(self, now_ns: int) -> Counts | None:
        """Return where the other axis is, in nominal counts; None: unknown.

        After a stop or a jog it has no target: then a fresh reading of its actual position is used.
        """
        target, partner = self.target, self.referenced_partner
        if target is not None:
            return target.nominal_counts
        if partner is None or partner.motion.actual is None:
            return None
        age_ns = now_ns - partner.motion.actual.seen_ns
        is_fresh = age_ns <= self._plan.fresh_s * NS_PER_S
        return partner.motion.nominal_of(partner.motion.actual.counts) if is_fresh else None

    def correction(self, nominal_counts: Counts) -> float:
        """Return the correction for a position of the other axis, in units."""
        assert self.partner is not None
        position = self.partner.motion.compensation.machine_position(nominal_counts)
        return self._correction(position * self._plan.scale)
