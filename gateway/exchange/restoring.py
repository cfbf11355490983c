"""An axis taken up from its record, where the drive stands as the record says (DESIGN 7)."""

from collections.abc import Callable
from typing import Final, NamedTuple

from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, spec_of_table, with_line
from gateway.compensation.direction import Direction, Travel
from gateway.compensation.errors import SettingsError, TableError
from gateway.compensation.moves import Accepted, Move, State
from gateway.compensation.readback import Fade
from gateway.compensation.settings import Gain
from gateway.compensation.table import CorrectionTable
from gateway.counts import Counts
from gateway.exchange.arrival import Stage
from gateway.exchange.axis import Actual, AxisExchange, Rendering
from gateway.exchange.field_counts import raw_of
from gateway.exchange.record_layout import (
    Remembered,
    RememberedMove,
    RememberedSpec,
    RememberedState,
)
from gateway.exchange.terms import resume_terms
from gateway.times import NS_PER_MS, NS_PER_S

FindTable = Callable[[bytes], CorrectionTable | None]


RECENT_NS: Final = 5 * NS_PER_S
"""A record of this boot and no older may be of a drive that still follows its last setpoint."""
LONGEST_LOOK_NS: Final = 100 * NS_PER_MS
"""So long it is watched whether the drive comes nearer."""


class Finding(NamedTuple):
    """Where the drive was found, told from what the record allows."""

    is_at_target: bool
    """At the last accepted target."""
    has_arrived: bool | None
    """Whether the unproven target reached the drive; None: there is none, or nobody can tell."""
    is_at_unproven: bool


class _TableNotFoundError(Exception):
    """A table that a record names is not to be had."""


def find(axis: AxisExchange, record: Remembered, first: Actual, now: Actual) -> Finding | str | None:
    """Compare where the drive is with where its record says that it may be.

    Returns a sentence where it may not be there, and None where it has to be read once more.

    Of a stream the drive lags behind: one that comes nearer to the last setpoint is on its way there, however
    far it lags, if the record is no older than some seconds.

    Args:
        axis: the axis, which is not changed.
        record: its record.
        first: the first position that was read.
        now: the last one; the same at the first look.
    """
    finding = _find(axis, record, now.counts)
    if finding is not None:
        return finding
    if axis.compensation.is_stream and record.has_target and _is_recent(record, first):
        if _has_come_nearer(axis, record, first.counts, now.counts):
            return Finding(is_at_target=False, has_arrived=None, is_at_unproven=False)
        if now.seen_ns - first.seen_ns <= LONGEST_LOOK_NS:
            return None
    low, high = record.way
    if record.was_at_target or low == high:
        said = f"at {record.corrected_counts:.10g}"
    else:
        said = f"between {low:.10g} and {high:.10g}"
    return f"the drive stands at {now.counts:.10g} counts, and the record says {said}"


def _is_recent(record: Remembered, first: Actual) -> bool:
    at_ns = record.state.at_ns if record.unproven is None else record.unproven.state.at_ns
    return record.is_of_this_boot and 0 <= first.seen_ns - at_ns <= RECENT_NS


def _has_come_nearer(axis: AxisExchange, record: Remembered, before: Counts, now: Counts) -> bool:
    """Whether the drive goes to one of the last two setpoints, by more than a standing one trembles."""
    settings = axis.plan.settings
    near = settings.hysteresis * abs(settings.counts_per_unit)
    targets = [record.corrected_counts]
    if record.unproven is not None:
        targets.append(record.unproven.corrected_counts)
    return any(abs(before - target) - abs(now - target) > near for target in targets)


def why_not_restored(
    axis: AxisExchange, record: Remembered, finding: Finding, actual: Actual, find_table: FindTable
) -> str:
    """Take an axis up from its record; "" when that is done, else why it cannot be; then nothing changes."""
    try:
        state = _state(axis, record.state, find_table, actual.seen_ns)
        unproven = None
        if record.unproven is not None:
            unproven = _state(axis, record.unproven.state, find_table, actual.seen_ns)
    except _TableNotFoundError:
        return "the table that was in force is not the one configured now"
    except (TableError, SettingsError) as error:
        return f"the table that was in force cannot be used any more ({error})"
    _restore(axis, record, state, is_at_target=finding.is_at_target)
    if record.unproven is not None and unproven is not None:
        _follow_unproven(axis, record.unproven, unproven, finding)
    resume_terms(axis, actual.seen_ns)
    return ""


def _find(axis: AxisExchange, record: Remembered, counts: Counts) -> Finding | None:
    """Compare where the drive is with where it may be; None where the record cannot be true.

    Between two targets of which one is not proven, the nearer one counts.
    """
    settings = axis.plan.settings
    near = settings.hysteresis * abs(settings.counts_per_unit)
    low, high = record.way
    from_target = abs(counts - record.corrected_counts)
    is_at_target = record.has_target and from_target <= near
    is_on_way = is_at_target or (not record.was_at_target and low - near <= counts <= high + near)
    move = record.unproven
    if move is None:
        return Finding(is_at_target, None, is_at_unproven=False) if is_on_way else None
    from_move = abs(counts - move.corrected_counts)
    if from_move <= near and not (is_at_target and from_target <= from_move):
        return Finding(is_at_target=False, has_arrived=True, is_at_unproven=True)
    if is_on_way:
        return Finding(is_at_target, False if is_at_target else None, is_at_unproven=False)
    low, high = min(low, move.corrected_counts), max(high, move.corrected_counts)
    if low - near <= counts <= high + near:
        return Finding(is_at_target=False, has_arrived=True, is_at_unproven=False)
    return None


def _state(axis: AxisExchange, numbers: RememberedState, find_table: FindTable, now_ns: int) -> State:
    return State(
        position=numbers.position,
        travel=Travel(Direction(numbers.direction), numbers.extreme),
        progress=numbers.progress,
        spec=_spec(axis, numbers.spec, find_table),
        previous=None if numbers.previous is None else _spec(axis, numbers.previous, find_table),
        change=numbers.change,
        change_distance=numbers.change_distance,
        is_unsure=numbers.is_unsure,
        at_ns=min(numbers.at_ns, now_ns),  # the clock begins anew with the machine
    )


def _spec(axis: AxisExchange, numbers: RememberedSpec, find_table: FindTable) -> CorrectionSpec:
    """Return the correction that numbers stand for: the one wanted now, where it is the same.

    Raises:
        _TableNotFoundError: its table is not to be had.
        TableError, SettingsError: its table does not go with the settings of the axis.
    """
    if not numbers.digest:
        return CorrectionSpec(offset=numbers.offset) if numbers.offset else NOTHING
    wanted, gain = axis.wanted, Gain(numbers.forward_gain, numbers.backward_gain)
    if numbers.was_wanted and wanted.table_digest == numbers.digest and wanted.gain == gain:
        is_same = (wanted.offset, wanted.tilt) == (numbers.offset, numbers.tilt)
        return wanted if is_same else with_line(wanted, numbers.offset, numbers.tilt)
    table = find_table(numbers.digest)
    if table is None:
        raise _TableNotFoundError
    found = spec_of_table(table, axis.plan.settings, gain, numbers.digest)
    return with_line(found, numbers.offset, numbers.tilt) if numbers.offset or numbers.tilt else found


def _restore(axis: AxisExchange, record: Remembered, state: State, *, is_at_target: bool) -> None:
    compensation = axis.compensation
    accepted = None
    if is_at_target or (record.has_target and not _may_have_stopped(axis)):
        accepted = Accepted(record.nominal_counts, record.corrected_counts)
    fade = None if record.fade is None else Fade(*record.fade)
    compensation.resume(state, accepted, record.anchor_counts, fade)
    compensation.way = record.way
    axis.is_branch_known = True
    axis.arrival.resume(
        _stage(record) if is_at_target else Stage.UNDER_WAY,
        state.at_ns if record.is_of_this_boot else 0,
    )
    shadow = axis.last_shadow = axis.shadows[record.number]
    if accepted is not None and record.knows_words:
        field = axis.plan.command[record.number]
        shadow.settle(
            field.pack(raw_of(field, accepted.nominal_counts)),
            field.pack(raw_of(field, accepted.corrected_counts)),
        )


def _stage(record: Remembered) -> Stage:
    if record.may_have_left:
        return Stage.MAY_HAVE_LEFT
    return Stage.ARRIVED if record.was_done_seen else Stage.SEEN_THERE


def _may_have_stopped(axis: AxisExchange) -> bool:
    """Whether an axis that was found on its way may go no further, and its next distance begin where it is.

    A drive that is only told positions gets its target once more, or another one; one that takes stops and
    distances may have stopped for want of a master, and its target must be no base of a distance (M5).
    """
    return axis.plan.has_rules


def _follow_unproven(axis: AxisExchange, move: RememberedMove, state: State, finding: Finding) -> None:
    """Take the target that was on its way as accepted, or as one that nobody acknowledged."""
    field = axis.plan.command[move.number]
    nominal_words = corrected_words = b""
    if not move.is_distance:
        nominal_words = field.pack(raw_of(field, move.nominal_counts))
        corrected_words = field.pack(raw_of(field, move.corrected_counts))
    compensation = axis.compensation
    correction_counts = move.corrected_counts - move.nominal_counts
    planned = Move(move.nominal_counts, correction_counts, compensation.map_of(state), state)
    rendering = Rendering(
        axis,
        axis.shadows[move.number],
        nominal_words,
        corrected_words,
        move.corrected_counts,
        planned,
        move.is_distance,
        compensation.accepted if move.is_distance else None,
    )
    if not finding.has_arrived:
        axis.fail(rendering, axis.heard_ns)
        return
    if axis.plan.has_rules:
        axis.accept(rendering, axis.heard_ns)
    else:
        axis.commit(rendering, axis.heard_ns)
    if not finding.is_at_unproven and _may_have_stopped(axis):
        axis.forget_place(keeps_branch=True)
