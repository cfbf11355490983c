"""Tests of several parts of an axis together, and of all axes of a group (M4, M11)."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import pytest

from gateway.compensation.correction_spec import NOTHING
from gateway.compensation.moves import Accepted
from gateway.compensation.settings import Gain
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, ModePlan, MotionPlan
from gateway.exchange.axis.acknowledge import Rendering, SteadyTarget
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.gantry import Gantry, GantryEvent
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.axis.reference import ReferenceEvent
from gateway.exchange.axis.reports import AxisReports
from gateway.exchange.commands import EndDryRun
from gateway.exchange.control import switch
from gateway.exchange.group import join_groups, report_skew, settle_group
from gateway.exchange.kept_words import is_other, is_repeat, keeps_other_words, may_keep_words, spec_of_words
from gateway.exchange.plan import CompensationMode, Reference
from gateway.modbus.registers import BitField
from tests.exchange.axis_bench import (
    DONE_BIT,
    acknowledge,
    an_axis,
    do,
    kinds,
    leave_unacknowledged,
    reached,
    see,
    target,
)
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, stream_plan, write

# === losses, other writers, another zero, what is reported ===============================================

NOMINAL: Final = COMMAND.pack(50_000)
CORRECTED: Final = COMMAND.pack(50_010)
STAGED: Final = MotionPlan(is_staged=True, modes=(ModePlan(0x32),))
REPEAT: Final = Rendering(0, NOMINAL, CORRECTED, 50_010, None)


def state(axis: Axis) -> MotionState:
    return axis.motion.state


def see_at(axis: Axis, counts: int, at_ms: float) -> None:
    axis.observe_actual(ACTUAL, ACTUAL.pack(counts), int(at_ms * MS))


# --- what is seen of it ------------------------------------------------------------------------------------


def test_only_an_axis_that_was_unseen_for_long_counts_as_off_its_way() -> None:
    """From 40 010 to 50 010; its reading is 30 000. The last frame before it was the acknowledgement at 1
    ms."""
    unseen_ms = an_axis().plan.unseen_ms
    for late_ms, after in ((0.0, MotionState.MOVING), (0.1, MotionState.UNKNOWN)):
        axis = reached("moving-from-a-known-start")
        see_at(axis, 30_000, 1 + unseen_ms + late_ms)
        assert state(axis) is after


def test_the_motion_of_an_axis_that_jumped_is_unknown_also_while_its_target_is_open() -> None:
    """From 30 mm to 60 mm in 1 ms, done."""
    axis = reached("unacknowledged-done")
    see_at(axis, 30_000, 5)
    assert state(axis) is MotionState.UNACKNOWLEDGED
    see_at(axis, 60_000, 6)
    assert state(axis) is MotionState.UNKNOWN


def test_only_a_rising_alarm_makes_the_motion_unknown() -> None:
    axis = an_axis(bits={"alarm": BitField(0x30, 2)})
    states = []
    for is_set in (True, True, False, True):
        acknowledge(axis)
        axis.observe_bit("alarm", 5 * MS, is_set=is_set)
        states.append(state(axis))
    moving, unknown = MotionState.MOVING, MotionState.UNKNOWN
    assert states == [unknown, moving, moving, unknown]


def test_the_homed_bit_is_not_read_again_for_a_reading() -> None:
    """Read at 1 ms; for a target the bit is too old after a second."""
    axis = an_axis(referenced=Reference.DRIVE_BIT, bits={"homed": BitField(0x30, 3)})
    axis.observe_bit("homed", 1 * MS, is_set=True)
    assert axis.needs_reference(2_000 * MS, is_target=True)
    assert not axis.needs_reference(2_000 * MS, is_target=False)


def test_the_homed_bit_is_not_read_again_for_a_stream() -> None:
    bits = {"homed": BitField(0x30, 3)}
    axis = Axis(stream_plan(referenced=Reference.DRIVE_BIT, bits=bits))
    axis.observe_bit("homed", 1 * MS, is_set=True)
    assert not axis.needs_reference(2_000 * MS, is_target=True)


@pytest.mark.parametrize(("words", "is_read"), [((1,), False), ((1, 0), True), ((1, 0, 1), True)])
def test_the_position_is_read_before_a_repeat_if_the_axis_may_have_moved(
    words: tuple[int, ...], is_read: bool
) -> None:
    """Its done bit fell, or fell and rose, since: the position is read before the repeat (M4)."""
    bench = Bench(axis_plan(bits=DONE_BIT, done_drop_ms=0.0))
    bench.move(20_000, 50_000)
    bench.actual()
    for word in words:
        bench.memory.words[0x30] = word
        bench.ask(bytes.fromhex("03 0030 0001"))
    repeat = write(COMMAND, 50_000)
    expected = [read(ACTUAL)] if is_read else []
    assert bench.frames(repeat) == [*expected, write(COMMAND, 50_010)]


# --- losses ------------------------------------------------------------------------------------------------


def test_after_a_fault_of_the_program_an_axis_with_a_homed_bit_passes_1_to_1_and_is_blocked() -> None:
    axis = an_axis(referenced=Reference.DRIVE_BIT, bits={"homed": BitField(0x30, 3)})
    axis.observe_bit("homed", 1 * MS, is_set=True)
    acknowledge(axis)
    was_passing = [axis.passes_unchanged]
    axis.report_fault("a sentence")
    was_passing.append(axis.passes_unchanged)
    assert was_passing == [False, True]
    assert axis.interlock.is_blocked
    assert kinds(axis) == ["internal-fault", "axis-blocked", "reference-lost"]


def test_after_a_fault_of_the_program_the_motion_is_unknown() -> None:
    axis = reached("moving")
    axis.report_fault("a sentence")
    assert state(axis) is MotionState.UNKNOWN
    assert not axis.passes_unchanged  # no bit could show its reference again


def test_an_axis_that_is_forgotten_has_neither_a_known_position_nor_known_words() -> None:
    axis = reached("arrived")
    axis.forget()
    assert state(axis) is MotionState.UNKNOWN
    assert axis.fields[0].nominal_words is None


def test_after_a_lost_link_the_last_position_is_forgotten() -> None:
    axis = reached("arrived")
    axis.lose_link(9 * MS)
    assert axis.motion.actual is None


def test_an_open_target_stays_open_over_a_silence_and_the_record_names_it() -> None:
    axis = reached("unacknowledged")
    open_target = axis.motion.unacknowledged
    axis.acknowledgement.go_on_naming(open_target)
    axis.fall_silent(2 * MS, 2 * MS)
    until_ns = int((3 + axis.plan.lost_ms) * MS)
    axis.end_silence(is_answer=True, until_ns=until_ns)
    assert state(axis) is MotionState.UNACKNOWLEDGED
    assert axis.acknowledgement.pending is open_target
    assert axis.motion.sent_off_ns == until_ns


def test_a_move_of_the_zero_voids_words_and_positions() -> None:
    axis = reached("arrived")
    axis.move_zero(is_certain=True)
    assert (axis.fields[0].nominal_words, axis.fields[0].corrected_words) == (NOMINAL, None)
    assert axis.motion.actual is None
    assert axis.compensation.accepted is not None


def test_a_stream_begins_again_after_its_zero_was_moved() -> None:
    axis = Axis(stream_plan())
    acknowledge(axis)
    axis.move_zero(is_certain=True)
    assert axis.compensation.accepted is None
    assert axis.compensation.state.position is None
    assert not axis.passes_unchanged
    lost = Axis(stream_plan(referenced=Reference.SET_POSITION))
    lost.move_zero(is_certain=True)
    assert lost.passes_unchanged


def test_compensation_ends_once() -> None:
    axis = an_axis()
    axis.end()
    axis.end()
    assert kinds(axis) == ["compensation-ended"]
    assert axis.correction.requested is NOTHING


# --- its group ---------------------------------------------------------------------------------------------


def test_an_axis_of_a_group_is_corrected_when_all_of_them_are_referenced() -> None:
    other = axis_plan(name="y", unit_id=2, referenced=Reference.SET_POSITION)
    x, y = Bench(axis_plan(), other, groups=[["x", "y"]]).line.axes
    was_passing = [x.passes_unchanged]
    y.declare_referenced()
    was_passing.append(x.passes_unchanged)
    assert was_passing == [True, False]
    assert not y.passes_unchanged


def test_releasing_an_axis_without_a_fixed_decision_changes_nothing() -> None:
    axis = reached("arrived")
    axis.release()
    axis.member.keep_no_other_words()
    assert state(axis) is MotionState.ARRIVED
    assert axis.member.fixed is None


def test_a_group_fixes_the_position_at_which_the_controller_takes_an_axis_to_be() -> None:
    """Its last target; without one, its last reading; else none."""
    axis = an_axis()
    fixed = []
    steps: list[Callable[[], None]] = [lambda: None, lambda: see(axis, 30_000), lambda: acknowledge(axis)]
    for step in steps:
        step()
        axis.member.fix(None, keeps_words=False)
        assert axis.member.fixed is not None
        fixed.append(axis.member.fixed.nominal_counts)
        axis.member.release()
    assert fixed[0] is None
    assert fixed[1] == pytest.approx(axis.motion.nominal_of(30_000), abs=20.0)
    assert fixed[2] == 50_000


# --- another plan ------------------------------------------------------------------------------------------


def test_after_a_dry_run_a_position_is_read_with_its_correction() -> None:
    axis = an_axis(compensation=CompensationMode.SHADOW)
    axis.end_dry_run()
    acknowledge(axis)
    assert axis.motion.nominal_of(50_010) == 50_000
    assert axis.plan.compensation is CompensationMode.ON
    bench = Bench(axis_plan(compensation=CompensationMode.SHADOW))
    assert bench.line.command(EndDryRun(axes=("x",)), bench.now_ns) == {"x": "next-target"}


def test_other_limits_count_from_now_on() -> None:
    axis = an_axis()
    other = axis_plan(max_correction=0.25)
    axis.limit(other)
    assert axis.compensation.settings is other.settings
    assert axis.motion.plan is other


def test_without_a_table_a_correction_has_no_branches() -> None:
    axis = an_axis()
    has_branches = [axis.correction.has_branches]
    axis.correction.enable(is_on=False)
    has_branches.append(axis.correction.has_branches)
    assert has_branches == [True, False]


# --- another writer ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("motion", "is_held", "is_blocked"),
    [(STAGED, True, True), (STAGED, False, False), (MotionPlan(), True, False)],
)
def test_a_target_that_a_former_writer_staged_does_not_run_for_the_next_one(
    motion: MotionPlan, is_held: bool, is_blocked: bool
) -> None:
    axis = an_axis(motion=motion)
    acknowledge(axis)
    if is_held:
        axis.rules.stage(0)
    axis.take_over("cnc", 4)
    assert axis.fields[0].is_incomplete
    assert axis.interlock.is_blocked is is_blocked


@pytest.mark.parametrize(("motion", "is_blocked"), [(STAGED, True), (MotionPlan(), False)])
def test_after_more_losses_than_are_remembered_everything_counts_as_lost(
    motion: MotionPlan, is_blocked: bool
) -> None:
    axis = an_axis(motion=motion)
    acknowledge(axis)
    axis.lose_everything(4)
    assert axis.fields[0].is_incomplete
    assert axis.rules.lost_mode(0) == (4 if is_blocked else None)
    assert axis.blocked_by == (4 if is_blocked else None)


def test_a_field_without_a_mode_loses_none() -> None:
    axis = an_axis(motion=MotionPlan(is_staged=True, modes=(None,)))
    axis.lose_everything(4)
    assert axis.interlock.epoch == 1  # of the block alone


@pytest.mark.parametrize(
    ("motion", "numbers", "is_blocked"),
    [(STAGED, [0], True), (STAGED, [], False), (MotionPlan(), [0], False)],
)
def test_a_target_that_a_stop_of_another_controller_changed_must_come_again(
    motion: MotionPlan, numbers: list[int], is_blocked: bool
) -> None:
    axis = an_axis(motion=motion)
    acknowledge(axis)
    axis.overwrite(numbers, "panel", 4)
    assert axis.fields[0].is_incomplete is bool(numbers)
    assert axis.hold.overwritten_by == ("panel" if numbers else "")
    assert axis.interlock.is_blocked is is_blocked


# --- targets -----------------------------------------------------------------------------------------------


def test_a_repeat_is_a_sign_of_life_and_advances_the_time_of_the_blend() -> None:
    axis = reached("arrived")
    axis.targets.acknowledge(REPEAT, 11 * MS)
    times = [(axis.motion.heard_ns, axis.compensation.state.at_ns)]
    axis.targets.acknowledge_steady(0, SteadyTarget(NOMINAL, CORRECTED, 0.0, 0, None), 12 * MS)
    times.append((axis.motion.heard_ns, axis.compensation.state.at_ns))
    assert times == [(11 * MS, 11 * MS), (12 * MS, 12 * MS)]
    assert state(axis) is MotionState.ARRIVED


@pytest.mark.parametrize(
    ("way", "after"),
    [
        ("arrived", MotionState.ARRIVED),
        ("out-of-reach", MotionState.SUPERSEDED),
        ("unknown", MotionState.UNKNOWN),
    ],
)
def test_a_repeat_without_an_acknowledgement_does_not_change_a_known_position(
    way: str, after: MotionState
) -> None:
    """If its target is unknown, it may have moved: the words in the drive are then unknown."""
    axis = reached(way)
    axis.fields[0].settle(NOMINAL, CORRECTED)
    sent_off_ns = axis.motion.sent_off_ns
    axis.targets.leave_unacknowledged(REPEAT, 11 * MS)
    assert state(axis) is after
    is_open = way == "unknown"
    assert axis.motion.sent_off_ns == (11 * MS if is_open else sent_off_ns)
    assert (axis.fields[0].nominal_words is None) is is_open


def test_words_without_an_acknowledgement_are_unknown_and_may_be_corrected_ones() -> None:
    axis = an_axis()
    axis.fields[0].settle(NOMINAL, NOMINAL)
    axis.targets.leave_unacknowledged(target(axis, 50_000), 11 * MS)
    assert axis.fields[0].may_be_corrected
    assert axis.fields[0].nominal_words is None


@pytest.mark.parametrize(
    ("corrected", "after"), [(CORRECTED, MotionState.SUPERSEDED), (NOMINAL, MotionState.UNACKNOWLEDGED)]
)
def test_a_run_of_the_target_from_before_a_lost_link_keeps_the_same_words(
    corrected: bytes, after: MotionState
) -> None:
    axis = reached("out-of-reach")
    run = target(axis, 50_000)._replace(corrected_words=corrected)
    axis.targets.leave_run_unacknowledged(run, 11 * MS)
    assert state(axis) is after
    assert axis.motion.sent_off_ns == 11 * MS


def test_after_a_run_of_an_unknown_target_the_motion_is_unknown() -> None:
    axis = reached("arrived")
    axis.targets.leave_run_unacknowledged(REPEAT._replace(nominal_words=b"\0\0\0\1"), 11 * MS)
    assert state(axis) is MotionState.UNKNOWN


@pytest.mark.parametrize(
    ("number", "words", "after"),
    [
        (0, COMMAND.pack(70_010), MotionState.MOVING),
        (0, CORRECTED, MotionState.UNACKNOWLEDGED),
        (1, COMMAND.pack(70_010), MotionState.UNACKNOWLEDGED),
    ],
)
def test_an_open_target_is_proven_by_its_words_read_from_its_own_field(
    number: int, words: bytes, after: MotionState
) -> None:
    axis = an_axis()
    axis.targets.leave_unacknowledged(target(axis, 70_000), 1 * MS)
    axis.targets.prove_by_words(number, words)
    assert state(axis) is after


@pytest.mark.parametrize(("is_lost", "is_known"), [(False, True), (True, False)])
def test_words_read_back_after_a_lost_link_are_those_from_before_it(is_lost: bool, is_known: bool) -> None:
    axis = reached("out-of-reach")
    if is_lost:
        axis.fields[0].lose_all_words()
    axis.targets.read_back(0, CORRECTED)
    assert axis.fields[0].nominal_words == (NOMINAL if is_known else None)


def test_words_that_the_controller_wrote_since_are_not_those_from_before() -> None:
    axis = reached("out-of-reach")
    axis.fields[0].settle(COMMAND.pack(1), COMMAND.pack(2))
    axis.targets.read_back(0, CORRECTED)
    assert axis.fields[0].nominal_words == COMMAND.pack(1)


def test_a_staged_target_was_not_run_until_a_trigger_runs_one() -> None:
    axis = an_axis()
    axis.targets.mark_staged()
    held = [axis.targets.holds_unrun]
    axis.targets.mark_run(Action.RELATIVE)
    held.append(axis.targets.holds_unrun)
    assert held == [True, False]
    assert axis.targets.last_run is Action.RELATIVE


# --- what is reported --------------------------------------------------------------------------------------


def reports() -> AxisReports:
    return an_axis().reports


def names(told: AxisReports) -> list[str]:
    return [event.kind.name for event in told.take(is_unsure=False)]


def test_unknown_contents_are_reported_once_until_they_change() -> None:
    told = reports()
    for contents in (((1, 2),), ((1, 2),), ((1, 3),)):
        told.report_unknown(contents)
    assert names(told) == ["unknown-mode"] * 2


def test_rewriting_targets_is_reported_once_in_a_minute() -> None:
    told = reports()
    counts = []
    for at_ms in (5, 60_004, 60_005):
        told.report_rewritten(1, at_ms * MS)
        counts.append(len(names(told)))
    assert counts == [1, 0, 1]


@pytest.mark.parametrize(("offset", "rest", "count"), [(0.5, 0.0, 1), (0.0, 0.5, 1), (0.0, 0.0, 0)])
def test_a_stream_that_begins_beside_its_first_setpoint_is_reported(
    offset: float, rest: float, count: int
) -> None:
    told = reports()
    told.begin_stream(offset, rest)
    told.report_beginning()
    told.report_beginning()
    assert names(told) == ["stream-began"] * count


def test_a_stop_voids_the_accepted_target() -> None:
    axis = reached("arrived", an_axis(bits=DONE_BIT))
    do(axis, Action.STOP)
    assert axis.compensation.accepted is None
    leave_unacknowledged(axis)
    axis.motion.run_not(Accepted(1000, 1010))
    assert axis.compensation.accepted == Accepted(1000, 1010)


# === what the axes of a group know of each other: skew, the end of a decision, words that are kept
#
# Three axes; 1000 counts per mm. Each is told directly what its drive did.
#
OTHER_TABLE: Final = make_table([0, 100], [0.02, 0.02], [-0.02, -0.02], Units.MM)
JOINED_MS: Final = 200
"""Words of one target come within so long."""


def group(*names: str, **changes: Any) -> tuple[Gantry, list[Axis]]:
    """Axes of one group, each at 20 000 counts."""
    axes = [an_axis(name=name, **changes) for name in names]
    join_groups(axes, [names])
    for axis in axes:
        acknowledge(axis, 20_000)
    gantry = axes[0].member.gantry
    assert gantry is not None
    return gantry, axes


def begin(gantry: Gantry, axes: list[Axis], *gone: Axis) -> None:
    """The first trigger is sent, and some axes start."""
    gantry.fix(axes[0].plan.name, 1 * MS)
    for axis in axes:
        axis.member.fix(None, keeps_words=False)
    gantry.happens(GantryEvent.LEFT)
    gantry.happens(GantryEvent.WENT)
    for axis in gone:
        axis.member.go_as_fixed(0, 2 * MS)


def details(axis: Axis) -> list[str]:
    return [event.detail for event in axis.take_events() if event.kind.name == "group-skewed"]


# --- skew --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x_counts", "y_counts", "skewed"),
    [
        (30_000, 50_000, "skewed by +30 mm"),
        (50_000, 30_000, "skewed by +30 mm"),
        (10_000, 25_000, "skewed by -10 mm"),
    ],
)
def test_the_skew_is_the_longest_way_that_an_axis_has_gone(x_counts: int, y_counts: int, skewed: str) -> None:
    gantry, axes = group("x", "y", "z")
    x, y, z = axes
    begin(gantry, axes, x, y)
    acknowledge(x, x_counts)
    acknowledge(y, y_counts)
    report_skew(z, 4)
    [detail] = details(z)
    assert detail.endswith(skewed)
    assert gantry.is_skewed


@pytest.mark.parametrize("lost", [0, 1])
def test_the_skew_is_unknown_if_one_axis_has_an_unknown_way(lost: int) -> None:
    gantry, axes = group("x", "y", "z")
    x, y, z = axes
    begin(gantry, axes, x, y)
    acknowledge(x, 30_000)
    acknowledge(y, 40_000)
    do(axes[lost], Action.STOP)
    report_skew(z, 4)
    [detail] = details(z)
    assert detail.endswith("skewed by an unknown amount")
    assert gantry.skew is None


def test_the_skew_is_unknown_if_the_start_of_an_axis_is_unknown() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    do(x, Action.STOP)
    begin(gantry, axes, x)
    acknowledge(x, 30_000)
    report_skew(y, 4)
    assert [detail.endswith("by an unknown amount") for detail in details(y)] == [True]


def test_a_group_in_which_no_axis_has_moved_is_not_skewed() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    begin(gantry, axes, x)
    report_skew(y, 4)
    assert details(y) == []
    assert not gantry.is_skewed


def test_an_axis_that_started_itself_or_while_none_had_started_reports_no_skew() -> None:
    gantry, axes = group("x", "y", "z")
    x, y, _ = axes
    report_skew(x, 4)
    begin(gantry, axes, x, y)
    acknowledge(y, 40_000)
    report_skew(x, 4)
    assert details(x) == []
    alone = an_axis()
    report_skew(alone, 4)
    assert details(alone) == []


# --- the end of a decision ---------------------------------------------------------------------------------


def test_a_decision_ends_when_all_axes_have_started() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    begin(gantry, axes, x)
    settle_group(x, 3 * MS)
    was_under_way = [gantry.is_under_way]
    y.member.go_as_fixed(0, 3 * MS)
    settle_group(x, 3 * MS)
    was_under_way.append(gantry.is_under_way)
    assert was_under_way == [True, False]
    assert x.member.fixed is None


def test_missing_words_of_a_target_are_awaited_for_200_ms() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    begin(gantry, axes, x)
    y.member.go_as_fixed(0b10, 3 * MS)
    was_under_way = []
    for at_ns in ((3 + JOINED_MS) * MS, (3 + JOINED_MS) * MS + 1):
        settle_group(x, at_ns)
        was_under_way.append(gantry.is_under_way)
    assert was_under_way == [True, False]


def test_references_found_while_nothing_is_decided_count_for_the_group() -> None:
    _, axes = group("x", "y", referenced=Reference.SET_POSITION)
    for axis in axes:
        axis.reference.happens(ReferenceEvent.DECLARED)
    assert all(axis.passes_unchanged for axis in axes)
    settle_group(axes[0], 3 * MS)
    assert not any(axis.passes_unchanged for axis in axes)


def test_an_axis_whose_registers_have_another_meaning_ends_the_decision() -> None:
    gantry, axes = group("x", "y")
    begin(gantry, axes, axes[0])
    axes[1].end()
    assert gantry.is_open


@pytest.mark.parametrize("is_found_again", [False, True])
def test_a_reference_lost_during_a_decision_is_lost_when_the_decision_ends(is_found_again: bool) -> None:
    gantry, axes = group("x", "y", referenced=Reference.SET_POSITION)
    x, _ = axes
    for axis in axes:
        axis.declare_referenced()
    begin(gantry, axes, x)
    x.lose_reference()
    if is_found_again:
        x.declare_referenced()
    see(x, 30_000)
    was_passing = [x.passes_unchanged]
    gantry.happens(GantryEvent.ENDED)
    was_passing.append(x.passes_unchanged)
    assert was_passing == [False, not is_found_again]
    assert (x.motion.actual is None) is is_found_again  # it may be counted from another zero


def test_a_reference_found_during_a_decision_counts_when_the_decision_ends() -> None:
    gantry, axes = group("x", "y", referenced=Reference.SET_POSITION)
    x, y = axes
    begin(gantry, axes, x)
    x.declare_referenced()
    y.declare_referenced()
    was_passing = [x.passes_unchanged]
    gantry.happens(GantryEvent.ENDED)
    was_passing.append(x.passes_unchanged)
    assert was_passing == [True, False]


# --- another switch, table or gain -------------------------------------------------------------------------


def test_a_correction_differs_by_its_switch_its_table_or_its_gain() -> None:
    axis, off = an_axis(), an_axis(compensation=CompensationMode.OFF)
    asked = axis.correction.requested
    same = an_axis().correction.requested
    assert same.curve is not asked.curve
    others = {
        "the same": asked,
        "the same table once more": same,
        "off": NOTHING,
        "another table": an_axis(table=OTHER_TABLE).correction.requested,
        "half of it": replace(asked, gain=Gain(0.5, 0.5)),
        "a new digest": replace(asked, table_digest=b"?"),
    }
    assert [name for name, spec in others.items() if is_other(axis, spec)] == [
        "off",
        "another table",
        "half of it",
    ]
    assert [name for name, spec in others.items() if not is_other(off, spec)] == ["off"]


def test_words_are_a_repeat_if_the_drive_acknowledged_them() -> None:
    def repeats(axis: Axis, number: int = 0, words: bytes = NOMINAL) -> bool:
        return is_repeat(axis, number, words)

    axis = an_axis(command=(COMMAND, replace(COMMAND, address=0x0610)))
    acknowledge(axis)
    assert repeats(axis)
    assert not repeats(axis, words=COMMAND.pack(50_001))
    assert not repeats(axis, 1)
    axis.fields[1].settle(NOMINAL, COMMAND.pack(50_020))
    assert repeats(axis, 1)  # of another field, which holds it
    axis.fields[0].settle(NOMINAL, COMMAND.pack(50_020))
    assert not repeats(axis)  # a word in it was replaced
    axis.fields[1].invalidate()
    assert not repeats(axis, 1)
    stopped = an_axis()
    acknowledge(stopped)
    do(stopped, Action.STOP)
    assert not repeats(stopped)
    lost = an_axis()
    acknowledge(lost)
    lost.fields[0].lose_all_words()
    assert not repeats(lost)


def test_words_that_a_target_may_keep_have_the_correction_of_that_target() -> None:
    axis = an_axis()
    acknowledge(axis)
    in_force = axis.compensation.state.spec
    assert spec_of_words(axis, 0, NOMINAL) is in_force
    assert spec_of_words(axis, 0, COMMAND.pack(50_001)) is None
    axis.lose_link(9 * MS)
    assert spec_of_words(axis, 0, NOMINAL) is in_force
    assert spec_of_words(axis, 0, COMMAND.pack(50_001)) is None


def test_an_open_target_keeps_its_own_correction() -> None:
    """It went to 20 000 without the table, and was sent to 50 000 with it."""
    axis = an_axis()
    axis.correction.enable(is_on=False)
    acknowledge(axis, 20_000)
    axis.correction.enable(is_on=True)
    was_other = [keeps_other_words(axis)]
    axis.targets.leave_unacknowledged(target(axis, 50_000), 9 * MS)
    was_other.append(keeps_other_words(axis))
    assert was_other == [True, False]


def test_a_target_from_before_a_lost_link_keeps_its_correction() -> None:
    axis = reached("out-of-reach")
    assert not keeps_other_words(axis)
    axis.correction.enable(is_on=False)
    assert keeps_other_words(axis)


def test_one_axis_of_a_group_keeps_other_words_only_if_all_do() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    asked = x.correction.requested
    assert may_keep_words(x, asked)
    assert not may_keep_words(x, NOTHING)  # y uses the table
    assert may_keep_words(an_axis(), NOTHING)
    begin(gantry, axes, x)
    assert not may_keep_words(x, NOTHING)
    x.member.release()
    x.member.fix(None, keeps_words=True)
    assert may_keep_words(x, NOTHING)
    for axis in axes:
        axis.member.release()
        axis.correction.enable(is_on=False)
    assert may_keep_words(x, asked)  # y does as well
    x.targets.leave_unacknowledged(target(x, 50_000), 9 * MS)
    assert not may_keep_words(x, asked)  # seen elsewhere, it is rendered anew
    assert not may_keep_words(y, asked)  # so is y


# --- over a line -------------------------------------------------------------------------------------------


class Gantries(Bench):
    """Axis x on unit id 1 and axis y on unit id 2, both at 20 000 and done with it."""

    def __init__(self, **changes: Any) -> None:
        both = (axis_plan(**changes), axis_plan(name="y", unit_id=2, **changes))
        super().__init__(*both, groups=[["x", "y"]])
        for unit_id in (1, 2):
            self.ask(write(COMMAND, 20_000), unit_id=unit_id)
        self.memory.put(ACTUAL, 20_010)
        self.ask(read(ACTUAL))
        self.ask(read(ACTUAL), unit_id=2)
        gantry = self.line.axes[0].member.gantry
        assert gantry is not None
        assert gantry.is_open
        self.gantry = gantry


def test_another_target_for_the_first_axis_begins_a_new_decision() -> None:
    """Switched off after x has started: y is corrected as x was, and the next target of x is sent 1:1."""
    bench = Gantries()
    assert bench.sent_for(write(COMMAND, 50_000)) == write(COMMAND, 50_010)
    since_ns = bench.gantry.since_ns
    switch(bench.line.axes, "x", is_on=False)
    assert bench.sent_for(write(COMMAND, 50_000)) == write(COMMAND, 50_010)  # the same one
    assert bench.gantry.since_ns == since_ns
    assert bench.sent_for(write(COMMAND, 60_000)) == write(COMMAND, 60_000)
    assert bench.gantry.since_ns > since_ns


@pytest.mark.parametrize("is_later", [False, True])
def test_only_a_word_of_another_target_begins_a_new_decision(*, is_later: bool) -> None:
    """50 000 is C350 0000 with its low word first, 120 000 is D4C0 0001. A word that comes late belongs to
    another target."""
    bench = Gantries()
    bench.ask(bytes.fromhex("06 0606 D4C0"))
    since_ns = bench.gantry.since_ns
    if is_later:
        bench.wait(JOINED_MS + 1)
    bench.ask(bytes.fromhex("06 0607 0001"))
    assert (bench.gantry.since_ns > since_ns) is is_later
    if not is_later:
        assert bench.memory.get(COMMAND) == 120_010
        bench.ask(bytes.fromhex("06 0606 C350"))  # a word of another one
        assert bench.gantry.since_ns > since_ns
