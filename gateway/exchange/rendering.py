"""From a commanded position to the words that the drive is told (M2 to M6, M8).

Nothing is changed here but with what a stream begins (:func:`take_offset`).
"""

from math import isfinite
from typing import Final, NamedTuple

from gateway.compensation.correction_spec import NOTHING
from gateway.compensation.errors import OutOfTableError, OutsideTravelError
from gateway.compensation.moves import Accepted, Move, Place, PlaceKind
from gateway.compensation.settings import Setpoints
from gateway.counts import Counts
from gateway.drives.motion import Action
from gateway.exchange.arrival import Stage
from gateway.exchange.axis import Actual, AxisExchange, Rendering
from gateway.exchange.field_counts import counts_of, steps_of
from gateway.exchange.shadow import Shadow
from gateway.exchange.terms import follow_terms
from gateway.modbus.errors import RegisterRangeError
from gateway.times import NS_PER_MS, NS_PER_S

RECENT_NS: Final = 500 * NS_PER_MS
"""An actual position seen so long ago says where a stream begins, where none can be read."""


class RefusedPositionError(Exception):
    """A position that must not reach the drive (M8); the message says why."""


class Seen(NamedTuple):
    """What a target is rendered with: monotonic time, and an actual position that was read for it."""

    now_ns: int
    fresh: Actual | None


class Base(NamedTuple):
    """Where a relative move starts, in both frames (M5)."""

    nominal_counts: Counts
    corrected_counts: Counts
    is_standing: bool
    """The axis is known to stand there."""


def is_repeat(axis: AxisExchange, shadow: Shadow, nominal_words: bytes) -> bool:
    """Whether a command field is written with what the drive acknowledged there already (M4)."""
    return (
        axis.compensation.accepted is not None
        and not shadow.is_torn
        and shadow.nominal_words == nominal_words
        and shadow.corrected_words is not None
    )


def render_repeat(axis: AxisExchange, shadow: Shadow, *, is_passing: bool) -> Rendering:
    """Render exactly the same words as before; accepting them changes nothing."""
    assert shadow.nominal_words is not None
    assert shadow.corrected_words is not None
    words = shadow.nominal_words if is_passing else shadow.corrected_words
    return Rendering(axis, shadow, shadow.nominal_words, words, 0.0, None)


def as_it_came(axis: AxisExchange, shadow: Shadow) -> Rendering:
    """Return a staged target with the words of the controller itself; where it leads is not known."""
    assert shadow.nominal_words is not None
    return Rendering(axis, shadow, shadow.nominal_words, shadow.nominal_words, 0.0, None, is_distance=True)


def render(
    axis: AxisExchange,
    number: int,
    nominal_words: bytes,
    seen: Seen,
) -> Rendering:
    """Render a whole target with the correction in force.

    Where the axis passes 1:1 its words go out as they came, and what they would have become is worked out.

    Args:
        axis: whose target.
        number: which of the axis's command fields.
        nominal_words: the target as commanded, in the field's own form.
        seen: when, and where the axis was read to be.

    Raises:
        RefusedPositionError: the corrected position must not reach the drive (M8).
    """
    field_ = axis.plan.command[number]
    shadow = axis.shadows[number]
    raw = field_.unpack(nominal_words)
    if needs_offset(axis):
        take_offset(axis, number, nominal_words, seen)
    is_passing = axis.passes_unchanged
    held = axis.held
    if held is not None and held.shadow is shadow and held.nominal_words == nominal_words:
        return Rendering(axis, shadow, nominal_words, held.corrected_words, 0.0, None)
    if not isfinite(raw):
        if is_passing:
            return Rendering(axis, shadow, nominal_words, nominal_words, 0.0, None)
        raise RefusedPositionError(f"{raw} is not a position")
    try:
        move = _plan_move(axis, counts_of(field_, raw), seen)
        if move.state.is_unsure and _is_unproven(axis, shadow, nominal_words) and axis.unproven:
            return axis.unproven  # nothing tells better: the same target is the same words (M4)
        corrected_words = nominal_words
        if move.correction_counts:
            corrected_words = field_.pack(raw + steps_of(field_, move.correction_counts))
    except (OutOfTableError, OutsideTravelError, RegisterRangeError) as error:
        raise RefusedPositionError(str(error)) from error
    corrected_counts = counts_of(field_, field_.unpack(corrected_words))
    sent = nominal_words if is_passing else corrected_words
    return Rendering(axis, shadow, nominal_words, sent, corrected_counts, move)


def render_distance(
    axis: AxisExchange,
    number: int,
    distance_words: bytes,
    base: Base,
    seen: Seen,
    *,
    is_passing: bool,
) -> Rendering:
    """Render a relative move: through the absolute nominal position, so that no error adds up (M5).

    Raises:
        RefusedPositionError: where it would end must not be gone to (M8).
    """
    field_ = axis.plan.command[number]
    shadow = axis.shadows[number]
    raw = field_.unpack(distance_words)
    if not isfinite(raw):
        raise RefusedPositionError(f"{raw} is not a distance")
    if not raw:
        return Rendering(axis, shadow, distance_words, distance_words, 0.0, None, is_distance=True)
    nominal_counts = base.nominal_counts + counts_of(field_, raw)
    place = Place(base.nominal_counts, PlaceKind.REACHED) if base.is_standing else None
    try:
        move = _plan_move(axis, nominal_counts, seen, place)
        corrected_counts = nominal_counts + move.correction_counts
        steps = steps_of(field_, corrected_counts - base.corrected_counts)
        words = field_.pack(steps)
    except (OutOfTableError, OutsideTravelError, RegisterRangeError) as error:
        raise RefusedPositionError(str(error)) from error
    ends_at = base.corrected_counts + counts_of(field_, steps)
    if is_passing:
        words, ends_at = distance_words, base.corrected_counts + counts_of(field_, raw)
    start = Accepted(base.nominal_counts, base.corrected_counts)
    return Rendering(axis, shadow, distance_words, words, ends_at, move, is_distance=True, start=start)


def needs_offset(axis: AxisExchange) -> bool:
    """Whether the next streamed setpoint is the first, and an offset may be in force before it.

    It may where the axis has a table, referenced or not: the run before may have had one.
    """
    compensation = axis.compensation
    is_first = compensation.is_stream and compensation.state.position is None
    return is_first and not axis.is_shadow and axis.base is not NOTHING


def take_offset(axis: AxisExchange, number: int, nominal_words: bytes, seen: Seen) -> None:
    """Let the offset that the drive has be in force before the first setpoint of a stream (M6).

    Read for this setpoint; where the gateway may not read, seen in passing a moment ago.
    """
    actual = seen.fresh
    if actual is None and axis.asked_actual is None and axis.actual is not None:
        is_recent = seen.now_ns - axis.actual.seen_ns <= RECENT_NS
        actual = axis.actual if is_recent else None
    field_ = axis.plan.command[number]
    raw = field_.unpack(nominal_words)
    if actual is None or not isfinite(raw):
        return
    settings = axis.plan.settings
    fields = (field_, axis.plan.actual[0])
    slack = sum(0.5 * each.step_counts(settings.largest_counts) for each in fields)
    slack /= abs(settings.counts_per_unit)
    position = axis.compensation.machine_position(actual.counts)
    slack += 0.0 if axis.terms is None else axis.terms.largest_at(position)
    rest = axis.compensation.assume_offset(actual.counts, counts_of(field_, raw), axis.base, slack)
    axis.began = (axis.compensation.state.spec.offset, rest)


def needs_actual(axis: AxisExchange, nominal_counts: Counts, now_ns: int) -> bool:
    """Whether an actual position has to be read before this target can be rendered (M6)."""
    if axis.asked_actual is None:
        return False
    if needs_offset(axis):
        return True
    if axis.wanted is NOTHING or not axis.is_referenced:
        return False
    accepted = axis.compensation.accepted
    if accepted is not None and accepted.nominal_counts == nominal_counts:
        return axis.arrival.may_have_left  # is it still there? (M4)
    if axis.plan.settings.setpoints is Setpoints.STREAM:
        return False
    return axis.has_branches and _known_place(axis, nominal_counts, now_ns) is None


def needs_look(axis: AxisExchange, now_ns: int, action: Action) -> bool:
    """Whether to look first if the axis still stands at its target: nobody has seen it for a while (M5, M6).

    Never in a stream, and not where it makes no difference: a correction of one branch, an absolute target.
    """
    return axis.asked_actual is not None and _is_doubtful(axis, now_ns, action)


def _is_doubtful(axis: AxisExchange, now_ns: int, action: Action) -> bool:
    if axis.compensation.is_stream or axis.compensation.accepted is None or not axis.plan.actual:
        return False
    counts = axis.has_branches or action.is_relative
    return counts and not axis.passes_unchanged and axis.is_unseen(now_ns)


def render_limit(axis: AxisExchange, number: int, nominal_words: bytes) -> bytes:
    """Return what a limit becomes: half-way between the branches, whatever moves at the moment.

    A limit of 0 passes as it is, because for many drives it means that there is none.

    Raises:
        RefusedPositionError: it does not fit its register.
    """
    field_ = axis.plan.limits[number]
    raw = field_.unpack(nominal_words)
    if not raw or not isfinite(raw) or axis.passes_unchanged:
        return nominal_words
    settings = axis.plan.settings
    position = axis.compensation.machine_position(counts_of(field_, raw))
    correction = axis.wanted.map_at(0.5).correction(position) * settings.counts_per_unit
    try:
        return field_.pack(raw + steps_of(field_, correction))
    except RegisterRangeError as error:
        raise RefusedPositionError(str(error)) from error


def nominal_limit(axis: AxisExchange, shadow: Shadow, number: int, words: bytes) -> bytes:
    """Turn the words of a limit that is read back into what the controller wrote."""
    if shadow.nominal_words is not None and shadow.corrected_words == words:
        return shadow.nominal_words
    field_ = axis.plan.limits[number]
    raw = field_.unpack(words)
    if not raw or not isfinite(raw) or axis.passes_unchanged:
        return words
    counts = counts_of(field_, raw)
    position = axis.compensation.machine_position(counts)
    correction = axis.wanted.map_at(0.5).solve(position, position).correction
    return field_.pack(raw - steps_of(field_, correction * axis.plan.settings.counts_per_unit))


def _is_unproven(axis: AxisExchange, shadow: Shadow, nominal_words: bytes) -> bool:
    unproven = axis.unproven
    if unproven is None or unproven.is_distance:
        return False
    return unproven.shadow is shadow and unproven.nominal_words == nominal_words


def _plan_move(axis: AxisExchange, nominal_counts: Counts, seen: Seen, place: Place | None = None) -> Move:
    compensation = axis.compensation
    accepted = compensation.accepted
    now_ns, fresh = seen
    if accepted is not None and accepted.nominal_counts == nominal_counts:
        return compensation.again()  # the same target through another register of the axis
    if axis.terms is not None and axis.terms.is_due(now_ns):
        follow_terms(axis, now_ns)
    if axis.plan.settings.setpoints is Setpoints.STREAM:
        return compensation.plan(nominal_counts, None, now_ns)
    is_doubtful = fresh is None and _is_doubtful(axis, now_ns, Action.ABSOLUTE)
    place = place or _known_place(axis, nominal_counts, now_ns)
    if place is None and fresh is not None:
        place = _measured(axis, fresh)
    if place is None and accepted is not None and not axis.plan.actual and "done" not in axis.plan.bits:
        # Nothing tells where this axis is; the order of its targets is the best there is, and flagged.
        place = Place(accepted.nominal_counts, PlaceKind.ASSUMED)
    move = compensation.plan(nominal_counts, place, now_ns)
    return move._replace(state=move.state._replace(is_unsure=True)) if is_doubtful else move


def _known_place(axis: AxisExchange, nominal_counts: Counts, now_ns: int) -> Place | None:
    """Where the axis is, as far as passing traffic told it (M6)."""
    accepted = axis.compensation.accepted
    if accepted is not None and axis.arrival.is_proven:
        return Place(accepted.nominal_counts, PlaceKind.REACHED)
    if accepted is not None and axis.arrival.stage is Stage.DONE_SAID and axis.asked_actual is None:
        return Place(accepted.nominal_counts, PlaceKind.ASSUMED)
    actual = axis.actual
    settings = axis.plan.settings
    if actual is None or not settings.max_speed:
        return None
    age_ns = now_ns - actual.seen_ns
    if age_ns > settings.fresh_ms * NS_PER_MS:
        return None
    place = _measured(axis, actual)
    reach = settings.max_speed * age_ns / NS_PER_S * abs(settings.counts_per_unit)
    return None if abs(nominal_counts - place.counts) <= reach else place


def _measured(axis: AxisExchange, actual: Actual) -> Place:
    """Turn a measured position back where its branch is known; else leave it on the drive's scale."""
    if axis.is_shadow:
        return Place(actual.counts, PlaceKind.MEASURED)
    if not axis.is_branch_known:
        return Place(actual.counts, PlaceKind.ON_DRIVE)
    return Place(axis.nominal_of(actual.counts), PlaceKind.MEASURED)
