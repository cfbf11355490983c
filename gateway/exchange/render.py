"""From a commanded position to the words that the drive receives (M2 to M6, M8).

A relative move starts at the last accepted target, if nothing else has moved the axis since and the drive
counts from there (M5). Otherwise it starts where the drive says, if the axis is at standstill: at the drive's
own commanded position, or at the actual one. It never starts at a position of a moving axis.

Only two things of an axis change here, both in its ``correction``: what a stream begins with, and what its
terms request.
"""

from math import inf, isfinite
from typing import Final, NamedTuple

from gateway.catalogue import refusals
from gateway.compensation.correction_spec import NOTHING, CorrectionSpec
from gateway.compensation.direction import Direction
from gateway.compensation.errors import OutOfTableError, OutsideTravelError
from gateway.compensation.moves import Accepted, EstimateKind, Move, PositionEstimate
from gateway.compensation.settings import Setpoints
from gateway.counts import Counts
from gateway.drives.motion import Action, NextTarget
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import (
    MAY_BE_ELSEWHERE,
    ON_BRANCH,
    Actual,
    MotionState,
    RepeatKind,
    Reported,
)
from gateway.exchange.field_counts import counts_of, steps_of
from gateway.exchange.kept_words import may_keep_words, spec_of_words
from gateway.exchange.plan import MOVING_BIT
from gateway.exchange.refusal import refused
from gateway.exchange.request import Prefetched, Standstill
from gateway.modbus.errors import RegisterRangeError
from gateway.times import NS_PER_MS, NS_PER_S

MAY_BE_UNDER_WAY: Final = frozenset({MotionState.MOVING, MotionState.DONE_REPORTED, MotionState.IN_WINDOW})
"""States in which the drive may not have completed the last target."""
SEEN_LATELY_NS: Final = 500 * NS_PER_MS
"""Maximum age of an actual position from which a stream begins, where none can be read."""


class RefusedPositionError(Exception):
    """A position that must not reach the drive (M8); the message says why."""


class RenderContext(NamedTuple):
    """What is needed to render a target: monotonic time, and an actual position that was read for it."""

    now_ns: int
    fresh: Actual | None
    is_refused: bool = False
    """The position was requested, and the drive did not report it."""


class Base(NamedTuple):
    """Where a relative move starts, on both scales (M5)."""

    nominal_counts: Counts
    corrected_counts: Counts
    is_at_rest: bool
    """The axis is known to be at standstill there."""
    is_assumed: bool = False
    """The branch on which the axis is there is unknown."""


def render_repeat(axis: Axis, number: int) -> Rendering:
    """Render exactly the same words as before; accepting them changes nothing."""
    image = axis.fields[number]
    assert image.nominal_words is not None
    assert image.corrected_words is not None
    words = image.nominal_words if axis.passes_unchanged else image.corrected_words
    return Rendering(number, image.nominal_words, words, 0.0, None)


def as_it_came(axis: Axis, number: int) -> Rendering:
    """Return a staged target with the controller's own words; its end is unknown."""
    nominal_words = axis.fields[number].nominal_words
    assert nominal_words is not None
    return Rendering(number, nominal_words, nominal_words, 0.0, None, is_distance=True)


def render(
    axis: Axis,
    number: int,
    nominal_words: bytes,
    seen: RenderContext,
) -> Rendering:
    """Render a complete target with the correction in force.

    If the axis passes 1:1, the words are sent unchanged, and the correction is only computed.

    Args:
        axis: whose target.
        number: which of the axis's command fields.
        nominal_words: the target as commanded, in the field's format.
        seen: the time, and the position that was read for it.

    Raises:
        RefusedPositionError: the corrected position must not reach the drive (M8).
    """
    field_ = axis.plan.command[number]
    raw = field_.unpack(nominal_words)
    is_passing = axis.passes_unchanged
    spec = spec_of_words(axis, number, nominal_words)
    is_kept = spec is None or may_keep_words(axis, spec)
    unacknowledged = axis.motion.unacknowledged if is_kept else None
    if unacknowledged is not None and not _is_unacknowledged(unacknowledged, number, nominal_words):
        unacknowledged = None
    if unacknowledged is not None and axis.compensation.is_stream and not is_passing:
        return unacknowledged  # the drive may hold it: the same setpoint keeps its words (M4)
    if needs_offset(axis):
        axis.correction.begin_stream(number, nominal_words, _first_actual(axis, seen), _former(axis))
        is_passing = axis.passes_unchanged
    repeat_kind = axis.repeat_kind(number, nominal_words) if is_kept else RepeatKind.NEW
    if repeat_kind is RepeatKind.SAME_WORDS:
        return _again(axis)
    if repeat_kind is RepeatKind.UNSEEN:
        raise refused(refusals.POSITION_WITHHELD, axis.plan.name)
    if not isfinite(raw):
        if is_passing:
            return Rendering(number, nominal_words, nominal_words, 0.0, None)
        raise RefusedPositionError(refusals.NO_POSITION.sentence(raw=raw))
    try:
        move = _plan_move(axis, counts_of(field_, raw), seen, is_kept=is_kept)
        if move.state.is_unsure and unacknowledged is not None:
            return flagged(unacknowledged)  # no better knowledge: the same target keeps its words (M4)
        corrected_words = nominal_words
        if move.correction_counts:
            corrected_words = field_.pack(raw + steps_of(field_, move.correction_counts))
    except (OutOfTableError, OutsideTravelError, RegisterRangeError) as error:
        raise RefusedPositionError(str(error)) from error
    corrected_counts = counts_of(field_, field_.unpack(corrected_words))
    sent = nominal_words if is_passing else corrected_words
    return Rendering(number, nominal_words, sent, corrected_counts, move)


def render_distance(
    axis: Axis,
    number: int,
    distance_words: bytes,
    base: Base,
    seen: RenderContext,
    *,
    is_passing: bool,
) -> Rendering:
    """Render a relative move through the absolute nominal position, so that errors do not add up (M5).

    Raises:
        RefusedPositionError: the axis must not go to its end (M8).
    """
    field_ = axis.plan.command[number]
    raw = field_.unpack(distance_words)
    if not isfinite(raw):
        raise RefusedPositionError(refusals.NO_DISTANCE.sentence(raw=raw))
    if not raw:
        return Rendering(number, distance_words, distance_words, 0.0, None, is_distance=True)
    nominal_counts = base.nominal_counts + counts_of(field_, raw)
    estimate = PositionEstimate(base.nominal_counts, EstimateKind.REACHED) if base.is_at_rest else None
    try:
        move = _plan_move(axis, nominal_counts, seen, estimate)
        is_unsure = move.state.is_unsure or base.is_assumed
        move = move._replace(state=move.state._replace(is_unsure=is_unsure, at_ns=seen.now_ns))
        corrected_counts = nominal_counts + move.correction_counts
        steps = steps_of(field_, corrected_counts - base.corrected_counts)
        words = field_.pack(steps)
    except (OutOfTableError, OutsideTravelError, RegisterRangeError) as error:
        raise RefusedPositionError(str(error)) from error
    ends_at = base.corrected_counts + counts_of(field_, steps)
    if is_passing:
        words, ends_at = distance_words, base.corrected_counts + counts_of(field_, raw)
    start = Accepted(base.nominal_counts, base.corrected_counts)
    return Rendering(number, distance_words, words, ends_at, move, is_distance=True, start=start)


def needs_offset(axis: Axis) -> bool:
    """Whether the next streamed setpoint is the first, and an offset may be in force before it.

    That is possible if the axis has a table, referenced or not, or had one: the last run may have used it.
    """
    compensation, correction = axis.compensation, axis.correction
    is_first = compensation.is_stream and compensation.state.position is None
    if not is_first or correction.is_dry_run:
        return False
    return correction.base is not NOTHING or bool(_former(axis))


def _former(axis: Axis) -> tuple[CorrectionSpec, ...]:
    """Return what the last run may have left in force; a group has that of all its axes, or none (M11)."""
    is_known = all(peer.correction.former for peer in axis.peers)
    return axis.correction.former if is_known else ()


def _first_actual(axis: Axis, seen: RenderContext) -> Actual | None:
    """Return where the axis is when a stream begins: as read for it, or as seen lately; None: unknown."""
    actual = axis.motion.actual
    if seen.fresh is not None or axis.reach.asked_actual is not None or actual is None:
        return seen.fresh
    return actual if seen.now_ns - actual.seen_ns <= SEEN_LATELY_NS else None


def needs_actual(axis: Axis, nominal_counts: Counts, now_ns: int) -> bool:
    """Whether an actual position must be read before this target can be rendered (M6).

    Also true if its drive refuses to report it.
    """
    if axis.reach.asked_actual is None and not axis.reach.is_unreadable:
        return False
    if needs_offset(axis):
        return True
    if axis.correction.requested is NOTHING or not axis.member.goes_as_referenced:
        return False
    accepted = axis.compensation.accepted
    is_same = accepted is not None and accepted.nominal_counts == nominal_counts
    if is_same and may_keep_words(axis, axis.compensation.state.spec):
        return axis.motion.state in MAY_BE_ELSEWHERE  # is it still there? (M4)
    if axis.plan.settings.setpoints is Setpoints.STREAM:
        return False
    if is_same:
        return axis.correction.has_branches and not axis.motion.has_arrived
    return axis.correction.has_branches and _estimated_position(axis, nominal_counts, now_ns) is None


def needs_poll(axis: Axis, now_ns: int, action: Action) -> bool:
    """Whether to read the position of an axis that was unseen for a while before its next move (M5, M6).

    Never in a stream, and not if it makes no difference: one branch only, an absolute target.
    """
    is_asked = axis.reach.asked_actual is not None or axis.reach.is_unreadable
    return is_asked and _is_doubtful(axis, now_ns, action)


def lacks_poll(axis: Axis, seen: RenderContext) -> bool:
    """Whether a target is sent again although the drive refused the reading that it needs (M6)."""
    if axis.compensation.is_stream:
        return False
    if not axis.reach.is_unreadable:
        return seen.is_refused
    return axis.motion.state in MAY_BE_ELSEWHERE or _is_doubtful(axis, seen.now_ns, Action.ABSOLUTE)


def _is_doubtful(axis: Axis, now_ns: int, action: Action) -> bool:
    if axis.compensation.is_stream or axis.compensation.accepted is None or not axis.plan.actual:
        return False
    counts = axis.correction.has_branches or action.is_relative
    return counts and not axis.passes_unchanged and axis.motion.is_unseen(now_ns)


def render_limit(axis: Axis, number: int, nominal_words: bytes) -> bytes:
    """Return the corrected words of a limit: half-way between the branches, independent of any motion.

    A limit of 0 passes unchanged, because for many drives it means that there is none.

    Raises:
        RefusedPositionError: it does not fit its register.
    """
    field_ = axis.plan.limits[number]
    raw = field_.unpack(nominal_words)
    if not raw or not isfinite(raw) or axis.passes_unchanged:
        return nominal_words
    settings = axis.plan.settings
    position = axis.compensation.machine_position(counts_of(field_, raw))
    correction = axis.correction.requested.map_at(0.5).correction(position) * settings.counts_per_unit
    try:
        return field_.pack(raw + steps_of(field_, correction))
    except RegisterRangeError as error:
        raise RefusedPositionError(str(error)) from error


def nominal_limit(axis: Axis, number: int, words: bytes) -> bytes:
    """Convert the words of a limit that is read back to what the controller wrote."""
    image = axis.limit_fields[number]
    if image.nominal_words is not None and image.corrected_words == words:
        return image.nominal_words
    field_ = axis.plan.limits[number]
    raw = field_.unpack(words)
    if not raw or not isfinite(raw) or axis.passes_unchanged:
        return words
    counts = counts_of(field_, raw)
    position = axis.compensation.machine_position(counts)
    correction = axis.correction.requested.map_at(0.5).solve(position, position).correction
    return field_.pack(raw - steps_of(field_, correction * axis.plan.settings.counts_per_unit))


def _again(axis: Axis) -> Rendering:
    """Return the same words as before a loss: an axis that is there does not move.

    The branch is unknown if the reference was lost and found again, or if the axis was not seen since.
    Without a reference the words have no meaning.
    """
    assert axis.motion.superseded is not None
    number, nominal_words, corrected_words, corrected_counts, move, *_ = axis.motion.superseded
    if not axis.reference.is_referenced:
        return Rendering(number, nominal_words, corrected_words, 0.0, None)
    if axis.motion.superseded.is_other_reference or not axis.motion.is_seen_at_superseded:
        move = move._replace(state=move.state._replace(is_unsure=True))
    return Rendering(number, nominal_words, corrected_words, corrected_counts, move)


def _is_unacknowledged(unacknowledged: Rendering, number: int, nominal_words: bytes) -> bool:
    is_same = unacknowledged.number == number and unacknowledged.nominal_words == nominal_words
    return is_same and not unacknowledged.is_distance


def flagged(rendering: Rendering) -> Rendering:
    """Return the same words as before, with a branch that is only assumed now."""
    move = rendering.move
    if move is None:
        return rendering
    return rendering._replace(move=move._replace(state=move.state._replace(is_unsure=True)))


def _plan_move(
    axis: Axis,
    nominal_counts: Counts,
    seen: RenderContext,
    estimate: PositionEstimate | None = None,
    *,
    is_kept: bool = True,
) -> Move:
    compensation = axis.compensation
    accepted = compensation.accepted
    now_ns, fresh, _ = seen
    if is_kept and accepted is not None and accepted.nominal_counts == nominal_counts:
        again = compensation.again()  # the same target, perhaps through another register of the axis
        return again._replace(state=again.state._replace(is_unsure=True)) if lacks_poll(axis, seen) else again
    correction = axis.correction
    if correction.terms is not None and correction.terms.is_due(now_ns):
        correction.follow_terms(now_ns)
    if axis.plan.settings.setpoints is Setpoints.STREAM:
        return compensation.plan(nominal_counts, None, now_ns)
    is_doubtful = fresh is None and _is_doubtful(axis, now_ns, Action.ABSOLUTE)
    # Other targets may wait before this one.
    is_doubtful |= accepted is None and axis.plan.next_target is NextTarget.QUEUED
    if accepted is not None and accepted.nominal_counts == nominal_counts:
        # Rendered again for a group: the axis moves only by the change of its words (M11).
        estimate = (
            PositionEstimate(accepted.corrected_counts, EstimateKind.ON_DRIVE)
            if axis.motion.has_arrived
            else estimate
        )
    else:
        estimate = estimate or _estimated_position(axis, nominal_counts, now_ns)
    used = fresh if estimate is None else None
    if used is not None:
        estimate = _measured(axis, used)
    if estimate is None and accepted is not None and not axis.plan.actual and "done" not in axis.plan.bits:
        # The position is unknown. The order of targets is the best estimate, and the result is flagged.
        estimate = PositionEstimate(accepted.nominal_counts, EstimateKind.ASSUMED)
    if estimate is None and axis.motion.superseded is not None:
        # No reading is possible. Its target from before the loss is the best estimate, and flagged.
        estimate, is_doubtful = (
            PositionEstimate(axis.motion.superseded.corrected_counts, EstimateKind.ON_DRIVE),
            True,
        )
    move = compensation.plan(nominal_counts, estimate, now_ns)
    if used is not None:
        is_doubtful |= may_have_passed(axis, nominal_counts + move.correction_counts, used, now_ns)
    is_doubtful |= _turns_if_queued(axis, move)
    return move._replace(state=move.state._replace(is_unsure=True)) if is_doubtful else move


def _turns_if_queued(axis: Axis, move: Move) -> bool:
    """Whether a target gets the other branch if its drive first completes the one before, as it may."""
    accepted = axis.compensation.accepted
    is_either = axis.plan.next_target is NextTarget.UNKNOWN and axis.motion.state in MAY_BE_UNDER_WAY
    if not is_either or accepted is None:
        return False
    steps = move.nominal_counts - accepted.nominal_counts
    ahead = steps * axis.plan.settings.counts_per_unit > 0
    return ahead is not (move.state.travel.direction is Direction.FORWARD)


def _estimated_position(axis: Axis, nominal_counts: Counts, now_ns: int) -> PositionEstimate | None:
    """Estimate where the axis is, from passing traffic (M6)."""
    accepted = axis.compensation.accepted
    if accepted is not None and (axis.motion.has_arrived or axis.plan.next_target is NextTarget.QUEUED):
        return PositionEstimate(
            accepted.nominal_counts, EstimateKind.REACHED
        )  # it is there, or will be before it moves to the next target
    if (
        accepted is not None
        and axis.motion.state is MotionState.DONE_REPORTED
        and axis.reach.asked_actual is None
    ):
        return PositionEstimate(accepted.nominal_counts, EstimateKind.ASSUMED)
    actual = axis.motion.actual
    settings = axis.plan.settings
    if actual is None or not settings.max_speed:
        return None
    age_ns = now_ns - actual.seen_ns
    if age_ns > settings.fresh_ms * NS_PER_MS:
        return None
    estimate = _measured(axis, actual)
    return None if abs(nominal_counts - estimate.counts) <= _reach_counts(axis, age_ns) else estimate


def _reach_counts(axis: Axis, age_ns: int) -> float:
    """How far the axis may have moved since it was seen; if its speed is unknown: 0 while that is fresh."""
    settings = axis.plan.settings
    if not settings.max_speed:
        return 0.0 if age_ns <= settings.fresh_ms * NS_PER_MS else inf
    return settings.max_speed * age_ns / NS_PER_S * abs(settings.counts_per_unit)


def _may_run(axis: Axis, actual: Actual) -> bool:
    """Whether something other than a target may have been moving the axis when it was seen (M6).

    A drive whose halt was taken back goes on to its old target.
    """
    motion = axis.motion
    if motion.state is MotionState.STOPPED:
        return motion.is_moving if MOVING_BIT in axis.plan.bits else motion.reported is Reported.MOVES
    return motion.state is MotionState.UNKNOWN and not motion.may_stand(actual.seen_ns)


def may_have_passed(axis: Axis, corrected_counts: Counts, fresh: Actual, now_ns: int) -> bool:
    """Whether an axis that moves may have passed its new target since it was read (M6).

    On its way to the last target it moves in one direction only, and no further than that.
    """
    reach_counts = _reach_counts(axis, now_ns - fresh.seen_ns)
    away_counts = corrected_counts - fresh.counts
    if _may_run(axis, fresh):
        return abs(away_counts) <= reach_counts
    accepted = axis.compensation.accepted
    if accepted is None or axis.motion.state is not MotionState.MOVING:
        return False
    ahead_counts = accepted.corrected_counts - fresh.counts
    if away_counts * ahead_counts <= 0 or abs(away_counts) >= abs(ahead_counts):
        return False
    return abs(away_counts) <= reach_counts


def _measured(axis: Axis, actual: Actual) -> PositionEstimate:
    """Convert a measured position back if its branch is known; else leave it on the drive's scale."""
    if axis.correction.is_dry_run:
        return PositionEstimate(actual.counts, EstimateKind.MEASURED)
    if axis.motion.state not in ON_BRANCH:
        kept = axis.motion.superseded
        if kept is not None and axis.motion.is_seen_at_superseded and not kept.is_other_reference:
            near = axis.plan.settings.hysteresis_counts
            if abs(actual.counts - kept.corrected_counts) <= near:  # as certain as before the loss
                return PositionEstimate(kept.move.nominal_counts, EstimateKind.REACHED)
        return PositionEstimate(
            actual.counts, EstimateKind.ON_WAY if _may_run(axis, actual) else EstimateKind.ON_DRIVE
        )
    if not axis.motion.knows_branch:
        return PositionEstimate(actual.counts, EstimateKind.ON_WAY)
    # With an unknown start, a reading that still fades is not used as a position, not even at the target.
    fades = axis.compensation.readback.fade is not None
    is_start_unknown = axis.motion.state is MotionState.MOVING and not axis.motion.is_start_known
    if is_start_unknown and (fades or not axis.motion.is_at_target(actual.counts)):
        return PositionEstimate(actual.counts, EstimateKind.ON_WAY)
    return PositionEstimate(axis.motion.nominal_of(actual.counts), EstimateKind.MEASURED)


# --- where a distance starts -------------------------------------------------------------------------------


def base_of(axis: Axis, action: Action, prefetched: Prefetched) -> Base | None:
    """Return where a relative move starts, as far as it is known; None: unknown."""
    if axis.motion.is_distance_unconfirmed or is_position_withheld(axis, prefetched):
        return None
    accepted = axis.compensation.accepted
    is_certain = axis.motion.has_arrived and action is not Action.RELATIVE_TO_ACTUAL
    if accepted is not None and (action is Action.RELATIVE or is_certain):
        return Base(accepted.nominal_counts, accepted.corrected_counts, is_at_rest=axis.motion.has_arrived)
    name = axis.plan.name
    standstill = prefetched.standstill.get(name, Standstill.UNKNOWN)
    if counts_from_commanded(axis, action):
        counts = prefetched.commanded.get(name)
        return None if counts is None else _base_at(axis, counts, standstill, tolerance=0.0)
    actual = prefetched.actual.get(name)
    if actual is None:
        return None
    settings = axis.plan.settings
    tolerance = settings.hysteresis_counts
    if action is Action.RELATIVE_TO_ACTUAL:
        return _base_at(axis, actual.counts, standstill, tolerance=0.0)
    return _base_at(axis, actual.counts, standstill, tolerance=tolerance)


def is_position_withheld(axis: Axis, prefetched: Prefetched) -> bool:
    """Whether the drive was asked for its position and did not report it: it may have been jogged (M6)."""
    return axis.plan.name in prefetched.actual and prefetched.actual[axis.plan.name] is None


def counts_from_commanded(axis: Axis, action: Action) -> bool:
    """Whether a distance counts from the drive's own commanded position, and that can be read."""
    return axis.reach.asked_commanded is not None and action is not Action.RELATIVE_TO_ACTUAL


def _base_at(axis: Axis, counts: Counts, standstill: Standstill, *, tolerance: float) -> Base | None:
    """Return the base at a position that the drive reported.

    A bit that may be older than the last move counts only if the position is at the end of that move.
    """
    accepted = axis.compensation.accepted
    if accepted is not None and abs(counts - accepted.corrected_counts) <= tolerance:
        return Base(accepted.nominal_counts, accepted.corrected_counts, is_at_rest=True)
    is_certain = standstill is Standstill.CONFIRMED or (
        standstill is Standstill.SAYS_SO and axis.motion.is_at_target(counts)
    )
    if not is_certain:
        return None
    nominal_counts = round(axis.motion.nominal_of(counts))
    return Base(nominal_counts, counts, is_at_rest=True, is_assumed=not axis.motion.knows_branch)
