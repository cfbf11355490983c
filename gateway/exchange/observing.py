"""What a drive's positions and status bits say about where its axis is."""

from math import isfinite

from gateway.exchange.arrival import Sign, Stage
from gateway.exchange.axis import Actual, AxisExchange
from gateway.exchange.field_counts import counts_of
from gateway.exchange.plan import ALARM_BIT, DONE_BIT, HOMED_BIT, MOVING_BIT
from gateway.modbus.registers import PositionField
from gateway.times import NS_PER_S


def observe_actual(axis: AxisExchange, field_: PositionField, words: bytes, asked_ns: int) -> Actual | None:
    """Note an actual position as it was when asked at ``asked_ns``; None where it is no number."""
    raw = field_.unpack(words)
    if not isfinite(raw):
        return None
    before, now = axis.actual, Actual(counts_of(field_, raw), asked_ns)
    axis.actual = now
    axis.heard_ns = asked_ns
    if axis.memory is not None and axis.memory.recalled is not None:
        axis.memory.decide(now)
    _prove(axis, before, now)
    axis.compensation.observe(now.counts)
    is_at_rest = axis.arrival.is_at_rest
    _watch(axis, now)
    if before is not None and is_at_rest:
        _watch_for_jump(axis, before, now)
    return now


def _prove(axis: AxisExchange, before: Actual | None, now: Actual) -> None:
    """Take a target that was never acknowledged as accepted when the axis is seen to have gone there (M7)."""
    unproven = axis.unproven
    if unproven is None:
        return
    if unproven.is_distance:
        prove_distance(axis, now)
        return
    if before is None:
        return
    settings = axis.plan.settings
    near = settings.hysteresis * abs(settings.counts_per_unit)
    if abs(now.counts - unproven.corrected_counts) <= near < abs(before.counts - unproven.corrected_counts):
        axis.accept(unproven, now.seen_ns)


def prove_distance(axis: AxisExchange, now: Actual) -> None:
    """Find out whether a distance that was never acknowledged has run: from which of its ends (M5).

    Only of an axis that has had the time to start and may stand. At neither of the ends, or at both, nobody
    knows where the next distance would begin.
    """
    unproven = axis.unproven
    start = None if unproven is None or not unproven.is_distance else unproven.start
    if unproven is None or start is None or not axis.arrival.may_stand(now.seen_ns):
        return
    window = axis.plan.settings.in_position_counts
    is_at_end = abs(now.counts - unproven.corrected_counts) <= window
    is_at_start = abs(now.counts - start.corrected_counts) <= window
    if is_at_end and not is_at_start:
        axis.accept(unproven, now.seen_ns)
    elif is_at_start and not is_at_end:
        axis.go_nowhere()


def observe_bit(axis: AxisExchange, name: str, asked_ns: int, *, is_set: bool) -> None:
    """Note one of the drive's status bits, as it was when asked at ``asked_ns``."""
    if not axis.is_unseen(asked_ns):  # whoever looks again does not see by it where the axis has been since
        axis.heard_ns = asked_ns
    was_referenced = axis.is_referenced
    if name == DONE_BIT:
        observe_done(axis, asked_ns, is_done=is_set)
    elif name == MOVING_BIT:
        axis.is_moving = is_set
        if DONE_BIT not in axis.plan.bits:  # a done bit may be older than this one
            axis.arrival.hear(asked_ns, moves=is_set)
    elif name == ALARM_BIT:
        if is_set and not axis.is_alarmed:
            _observe_alarm(axis)
        axis.is_alarmed = is_set
    elif name == HOMED_BIT and axis.reference.follows_bit:
        axis.see_homed_bit(asked_ns, is_set=is_set)
    if name == axis.homed_bit:
        axis.reference.see_end_of_homing(asked_ns, is_set=is_set)
        axis.follow_reference(was_referenced=was_referenced)


def observe_done(axis: AxisExchange, asked_ns: int, *, is_done: bool) -> None:
    """Note the drive's done bit; of an axis that goes nowhere we know it only says whether it moves."""
    if axis.compensation.accepted is not None or axis.unproven is not None:
        axis.arrival.see_done(asked_ns, is_done=is_done)
    else:
        axis.arrival.hear(asked_ns, moves=not is_done)


def _observe_alarm(axis: AxisExchange) -> None:
    """Note that the drive has given up: it stands somewhere, and may have lost its reference."""
    axis.forget_place()
    axis.lose()


def _watch(axis: AxisExchange, actual: Actual) -> None:
    """Notice that the axis has come to its target, or that something else moved it away from there (M4)."""
    accepted = axis.compensation.accepted
    if accepted is None:
        return
    settings = axis.plan.settings
    sign = Sign.AWAY
    if axis.is_at_target(actual.counts):
        sign = Sign.THERE
    elif abs(actual.counts - accepted.corrected_counts) <= settings.max_correction_counts:
        sign = Sign.NEAR
    elif axis.compensation.is_stream and axis.arrival.stage is Stage.DONE_SAID:
        return  # a stream lags behind its setpoints, done or not
    if axis.arrival.see_place(actual.seen_ns, sign):
        axis.compensation.forget_target()
        axis.is_branch_known = False


def _watch_for_jump(axis: AxisExchange, before: Actual, now: Actual) -> None:
    """Notice that an axis at rest stands where no motion can have brought it (M9).

    Its drive counts from another zero now.
    """
    settings = axis.plan.settings
    if not settings.max_speed:
        return
    distance = abs(now.counts - before.counts) / abs(settings.counts_per_unit)
    reach = settings.max_speed * (now.seen_ns - before.seen_ns) / NS_PER_S + settings.max_correction
    if distance > 2.0 * reach:
        axis.forget_place()
        axis.lose()
