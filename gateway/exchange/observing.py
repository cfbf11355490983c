"""What a drive's positions and status bits say about where its axis is."""

from math import isfinite

from gateway.counts import Counts
from gateway.exchange.axis import Actual, AxisExchange
from gateway.exchange.field_counts import counts_of
from gateway.exchange.plan import ALARM_BIT, DONE_BIT, HOMED_BIT, MOVING_BIT
from gateway.modbus.registers import PositionField
from gateway.times import NS_PER_S


def observe_actual(axis: AxisExchange, field_: PositionField, words: bytes, now_ns: int) -> Actual | None:
    """Note an actual position as the drive reported it; None where it is no number."""
    raw = field_.unpack(words)
    if not isfinite(raw):
        return None
    before, now = axis.actual, Actual(counts_of(field_, raw), now_ns)
    axis.actual = now
    if axis.memory is not None and axis.memory.recalled is not None:
        axis.memory.decide(now)
    _prove(axis, before, now)
    axis.compensation.observe(now.counts)
    is_at_rest = axis.was_at_target or axis.is_done_seen
    _watch(axis, now.counts)
    if before is not None and is_at_rest:
        _watch_for_jump(axis, before, now)
    return now


def _prove(axis: AxisExchange, before: Actual | None, now: Actual) -> None:
    """Take a target that was never acknowledged as accepted when the axis is seen to have gone there (M7)."""
    unproven = axis.unproven
    if unproven is None or before is None:
        return
    settings = axis.plan.settings
    near = settings.hysteresis * abs(settings.counts_per_unit)
    if abs(now.counts - unproven.corrected_counts) <= near < abs(before.counts - unproven.corrected_counts):
        axis.accept(unproven)


def observe_bit(axis: AxisExchange, name: str, now_ns: int, *, is_set: bool) -> None:
    """Note one of the drive's status bits."""
    was_referenced = axis.is_referenced
    if name == DONE_BIT:
        observe_done(axis, is_done=is_set)
    elif name == MOVING_BIT:
        axis.is_moving = is_set
    elif name == ALARM_BIT:
        if is_set and not axis.is_alarmed:
            _observe_alarm(axis)
        axis.is_alarmed = is_set
    elif name == HOMED_BIT and axis.reference.follows_bit:
        axis.see_homed_bit(now_ns, is_set=is_set)
    if name == axis.homed_bit:
        axis.reference.see_end_of_homing(now_ns, is_set=is_set)
        axis.follow_reference(was_referenced=was_referenced)


def observe_done(axis: AxisExchange, *, is_done: bool) -> None:
    """Note the drive's done bit.

    A second motion after a target was reached is not of our making; or the bit has flickered, which the
    next reading of the position tells.
    """
    if axis.is_done_seen and not is_done:
        axis.may_have_left = True
    axis.is_done_seen = is_done and axis.compensation.accepted is not None and not axis.may_have_left
    axis.was_at_target |= axis.is_done_seen


def _observe_alarm(axis: AxisExchange) -> None:
    """Note that the drive has given up: it stands somewhere, and may have lost its reference."""
    axis.forget_place()
    axis.lose()


def _watch(axis: AxisExchange, corrected_counts: Counts) -> None:
    """Notice that something else moved the axis away from where it had been sent (M4)."""
    accepted = axis.compensation.accepted
    if accepted is None:
        return
    settings = axis.plan.settings
    distance = abs(corrected_counts - accepted.corrected_counts) / abs(settings.counts_per_unit)
    if distance <= settings.max_correction:
        axis.may_have_left = False
    if distance <= settings.hysteresis:
        axis.was_at_target = True
    elif axis.was_at_target and distance > settings.max_correction:
        axis.compensation.forget_target()
        axis.was_at_target = axis.is_done_seen = axis.is_branch_known = False


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
