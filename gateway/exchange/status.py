"""The exchange's part of the status model. Positions are in units, each on its own scale.

``exchange.status_words`` lists the states that it shows.
"""

from collections.abc import Callable
from typing import Final

from msgspec import UNSET

from gateway.compensation.settings import Setpoints
from gateway.counts import Counts
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.gantry import GantryState
from gateway.exchange.axis.motion import Actual
from gateway.exchange.line import LineExchange
from gateway.status.axis import SHOWN_S, AxisStatus, GroupStatus, Reading, Shares, TableStatus
from gateway.status.line import LINE_COUNTERS, LineStatus
from gateway.times import NS_PER_S

CORRECTED: Final = frozenset({"active", "blending", "outside"})
SHOWN_NS: Final = int(SHOWN_S * NS_PER_S)


def line_status(line: LineExchange, now_ns: int) -> LineStatus:
    """Return the exchange's part of one line's status."""
    counters = line.counters
    status = LineStatus(
        state="up" if line.is_up else "down",
        unit_ids=line.unit_ids_status(now_ns),
        cut_through=UNSET if line.forwarding is None else line.forwarding.status(),
    )
    for name in LINE_COUNTERS:
        if hasattr(counters, name):
            setattr(status, name, getattr(counters, name))
    return status


def axes_status(line: LineExchange, now_ns: int) -> dict[str, AxisStatus]:
    """Return each axis's part of the status model, by name."""
    found: dict[str, AxisStatus] = {}
    for axis in line.axes:
        status = found[axis.plan.name] = axis_status(axis, now_ns)
        status.rivals = line.writer_conflict(axis.plan.name, now_ns)
    return found


def axis_status(axis: Axis, now_ns: int) -> AxisStatus:
    """Return one axis's part of the status model."""
    settings, terms = axis.plan.settings, axis.correction.terms
    accepted = axis.compensation.accepted
    actual = _shown(axis.motion.actual, now_ns)

    def units(counts: Counts | None) -> float | None:
        if counts is None:
            return None
        return axis.compensation.machine_position(counts) - settings.machine_offset

    correction: float | None = None
    if accepted is not None:
        correction = (accepted.corrected_counts - accepted.nominal_counts) / settings.counts_per_unit
    return AxisStatus(
        compensation=compensation_state(axis),
        is_enabled=axis.correction.is_enabled,
        reads_uncorrected=axis.recall.reads_uncorrected and compensation_state(axis) in CORRECTED,
        units=settings.units.value,
        direction=direction_state(axis),
        gain=Shares(forward=settings.gain.forward, backward=settings.gain.backward),
        travel=settings.travel,
        correction=correction,
        nominal_setpoint=units(None if accepted is None else accepted.nominal_counts),
        corrected_setpoint=units(None if accepted is None else accepted.corrected_counts),
        nominal_actual=units(None if actual is None else axis.motion.nominal_of(actual.counts)),
        corrected_actual=units(None if actual is None else actual.counts),
        last_actual=_last_actual(axis, units, now_ns),
        actual_age_s=None if actual is None else round((now_ns - actual.seen_ns) / NS_PER_S, 3),
        writer=axis.hold.writer if axis.hold.is_held(now_ns) else None,
        table=_table_status(axis),
        group=_group_status(axis, now_ns),
        terms=None if terms is None else terms.status(axis.compensation, now_ns),
    )


def _last_actual(axis: Axis, units: Callable[[Counts | None], float | None], now_ns: int) -> Reading | None:
    """Return the newest reading, however old; None: there was none, or it is void."""
    actual = axis.motion.actual
    if actual is None:
        return None
    return Reading(
        nominal=units(axis.motion.nominal_of(actual.counts)),
        corrected=units(actual.counts),
        age_s=round((now_ns - actual.seen_ns) / NS_PER_S, 3),
    )


def _shown(actual: Actual | None, now_ns: int) -> Actual | None:
    """Return a reading that still says where the axis is; else None."""
    return None if actual is None or now_ns - actual.seen_ns > SHOWN_NS else actual


def direction_state(axis: Axis) -> str:
    """Return the direction as the status shows it: forward, backward, unknown or unsure."""
    return "unsure" if axis.is_unsure else axis.compensation.state.travel.direction.name.lower()


def compensation_state(axis: Axis) -> str:
    """Return the state of the compensation as the status shows it.

    A block comes first: an axis that was switched off refuses triggers too, until it passes positions 1:1.
    A gain of 0 switches off too, unless terms are added to the table: they have no gain.
    """
    if axis.blocked_by is not None and not axis.passes_unchanged:
        return "blocked"
    if not axis.correction.is_enabled:
        return "off"
    if axis.plan.table is None:
        return "no-table"
    if axis.plan.settings.gain.is_zero and axis.correction.terms is None:
        return "off"
    if not axis.reference.is_referenced:
        return "unreferenced"
    if axis.correction.is_dry_run:
        return "shadow"
    accepted = axis.compensation.accepted
    if accepted is not None and axis.compensation.is_outside(accepted.nominal_counts):
        return "outside"
    is_stream = axis.plan.settings.setpoints is Setpoints.STREAM
    return "blending" if is_stream and axis.compensation.is_blending else "active"


def _group_status(axis: Axis, now_ns: int) -> GroupStatus | None:
    """Return the decision that its group follows (M11); None: it is in no group."""
    gantry = axis.member.gantry
    if gantry is None:
        return None
    fixed = None if gantry.is_over(now_ns) else axis.member.fixed
    return GroupStatus(
        state=GantryState.OPEN.value if fixed is None else gantry.state.value,
        has_gone=fixed is not None and fixed.has_gone,
        is_put_off=fixed is not None and gantry.has_put_off,
        is_skewed=gantry.is_skewed,
        skew=gantry.skew,
    )


def _table_status(axis: Axis) -> TableStatus:
    plan = axis.plan
    return TableStatus(
        file=plan.table_name or None,
        format=plan.table_format or None,
        sha256=plan.table_digest or None,
        compiled=None if plan.table is None else plan.table.digest or None,
        points=0 if plan.table is None else len(plan.table.positions),
        status="none" if plan.table is None else "active",
    )
