"""Parts of an axis, each tested alone: its motion, its reference, the target on the wire, its triggers."""

from collections.abc import Callable
from typing import Final

import pytest

from gateway.compensation.moves import Accepted
from gateway.drives.motion import Action, MotionPlan
from gateway.exchange.axis.acknowledge import Acknowledgement, OnWire, Proof
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.interlock import Interlock
from gateway.exchange.axis.motion import Actual, MotionState, RepeatKind
from gateway.exchange.axis.reference import AxisReference, ReferenceState
from gateway.exchange.plan import CompensationMode, Reference
from gateway.modbus.registers import BitField
from tests.exchange.axis_bench import (
    DONE_BIT,
    REACHED,
    acknowledge,
    an_axis,
    do,
    leave_unacknowledged,
    reached,
    see,
    target,
)
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, axis_plan, stream_plan

# --- where it is -------------------------------------------------------------------------------------------


def state(axis: Axis) -> MotionState:
    return axis.motion.state


def arrived(axis: Axis, counts: int, at: int, at_ms: int = 5) -> None:
    """Let an axis go to a target, and its drive report done at a position."""
    acknowledge(axis, counts)
    axis.motion.observe_done(3 * MS, is_done=True)
    axis.observe_actual(ACTUAL, ACTUAL.pack(at), at_ms * MS)
    assert state(axis) is MotionState.ARRIVED


NOT_AT_REST: Final = {
    "unknown": "its position is unknown",
    "stopped": "its position is unknown",
    "unreferenced": "its position is unknown",
    "out-of-reach": "its position is unknown",
    "unacknowledged": "a target of it is not acknowledged",
    "unacknowledged-done": "a target of it is not acknowledged",
    "moving": "it was not seen at its target",
    "moving-from-a-known-start": "it was not seen at its target",
    "done-reported": "",
    "in-window": "",
    "arrived": "",
    "may-have-left": "it was not seen at its target",
    "at-rest": "",
}
"""By hand: why an axis may not be at standstill at its target."""


@pytest.mark.parametrize("way", list(REACHED))
def test_an_axis_is_at_rest_if_its_drive_or_its_position_shows_it(way: str) -> None:
    axis = reached(way)
    assert axis.motion.why_not_at_rest == NOT_AT_REST[way]


def test_an_axis_whose_moving_bit_is_set_is_not_at_rest() -> None:
    axis = an_axis()
    assert axis.motion.why_not_at_rest == ""
    reached("arrived", axis)
    axis.motion.observe_moving(6 * MS, is_moving=True)
    assert axis.motion.why_not_at_rest == "it moves"


def test_a_position_in_the_dry_run_is_compared_with_the_nominal_target() -> None:
    """It need not be where the corrected target is: 50 010. The window is 20 counts on either side."""
    axis = an_axis()
    acknowledge(axis)
    see(axis, 49_979)
    assert axis.motion.why_not_at_rest == "it is not at its target yet"
    see(axis, 49_980)
    assert axis.motion.why_not_at_rest == ""


@pytest.mark.parametrize(
    "command",
    [
        acknowledge,
        leave_unacknowledged,
        lambda axis: do(axis, Action.STOP),
        lambda axis: axis.lose_link(7 * MS),
        lambda axis: axis.wait_for_peers(waits=True),
    ],
)
def test_after_a_command_or_a_loss_the_moving_bit_is_old(command: Callable[[Axis], None]) -> None:
    axis = an_axis()
    acknowledge(axis, 40_000)
    axis.motion.observe_moving(3 * MS, is_moving=True)
    command(axis)
    assert not axis.motion.is_moving


def test_a_moving_bit_alone_shows_when_an_axis_may_be_at_rest() -> None:
    """At the end of an unacknowledged distance a position proves it only after the bit has fallen (M5)."""
    axis = Axis(axis_plan(bits={"moving": BitField(0x30, 1)}, done_drop_ms=0.0))
    leave_unacknowledged(axis)
    axis.observe_bit("moving", 3 * MS, is_set=True)
    see(axis, 70_010)
    assert state(axis) is MotionState.UNACKNOWLEDGED
    axis.observe_bit("moving", 4 * MS, is_set=False)
    see(axis, 70_010)
    assert axis.compensation.accepted == Accepted(70_000, 70_010)


def test_the_moving_bit_does_not_decide_if_a_done_bit_is_mapped() -> None:
    axis = an_axis()
    leave_unacknowledged(axis)
    axis.observe_bit("done", 3 * MS, is_set=True)
    axis.observe_bit("moving", 4 * MS, is_set=True)
    see(axis, 70_010)
    assert axis.compensation.accepted == Accepted(70_000, 70_010)


def test_an_axis_of_unknown_branch_does_not_count_as_at_its_target_while_its_reading_is_blended() -> None:
    """Read at 20 000 before any target: it may stand there already, and 50 010 may be the end of its way."""
    axis = an_axis()
    see(axis, 20_000)
    acknowledge(axis, 20_005)  # to 20 015: in the window from its start on
    assert axis.compensation.readback.fade is not None
    assert not axis.motion.is_start_known
    see(axis, 20_014)
    assert state(axis) is MotionState.MOVING


@pytest.mark.parametrize(
    ("way", "after"),
    [
        ("done-reported", MotionState.DONE_REPORTED),
        ("arrived", MotionState.UNKNOWN),
        ("in-window", MotionState.UNKNOWN),
    ],
)
def test_only_a_stream_lags_behind_its_setpoints_when_it_is_done(way: str, after: MotionState) -> None:
    """40 000 counts from its setpoint."""
    axis = reached(way, Axis(stream_plan(bits=DONE_BIT, done_drop_ms=0.0)))
    see(axis, 10_000)
    assert state(axis) is after
    waits = reached("done-reported")
    see(waits, 10_000)
    assert waits.motion.state is MotionState.UNKNOWN


@pytest.mark.parametrize(
    ("counts", "after"),
    [
        (50_030, MotionState.ARRIVED),  # the window: 20 counts from 50 010
        (50_031, MotionState.AT_REST),
        (50_510, MotionState.AT_REST),  # the largest correction: 0.5 mm
        (50_511, MotionState.UNKNOWN),
    ],
)
def test_the_distance_from_its_target_decides_whether_an_axis_is_at_it(
    counts: int, after: MotionState
) -> None:
    axis = reached("arrived")
    see(axis, counts)
    assert state(axis) is after


def test_done_alone_gives_a_known_start_if_no_position_is_mapped() -> None:
    axis = an_axis(has_actual=False)
    acknowledge(axis)
    axis.motion.observe_done(3 * MS, is_done=True)
    acknowledge(axis, 55_000)
    assert axis.motion.is_start_known


@pytest.mark.parametrize(("counts", "is_there"), [(70_030, True), (70_031, False), (990, True), (989, False)])
def test_an_unacknowledged_distance_is_proven_within_the_window_of_its_ends(
    counts: int, is_there: bool
) -> None:
    """From 1010 to 70 010, with a window of 20 counts."""
    axis = an_axis()
    leave_unacknowledged(axis)
    see(axis, counts)
    assert (axis.motion.unacknowledged is None) is is_there


def test_a_done_bit_requested_at_the_moment_of_the_command_counts() -> None:
    axis = an_axis()
    acknowledge(axis)  # at 1 ms
    axis.motion.observe_done(1 * MS - 1, is_done=True)
    assert state(axis) is MotionState.MOVING
    axis.motion.observe_done(1 * MS, is_done=True)
    assert state(axis) is MotionState.DONE_REPORTED


def test_bits_from_before_the_command_do_not_show_that_it_has_begun() -> None:
    """The drive clears its done bit within 5 ms. Moving and standing again, both before the command, are of
    the motion before."""
    axis = Axis(axis_plan(bits=DONE_BIT, done_drop_ms=5.0))
    axis.targets.acknowledge(target(axis, 50_000), 4 * MS)
    axis.motion.observe_done(2 * MS, is_done=False)
    axis.motion.observe_done(3 * MS, is_done=True)
    axis.motion.observe_done(5 * MS, is_done=True)
    assert state(axis) is MotionState.MOVING
    axis.motion.observe_done(6 * MS, is_done=False)
    axis.motion.observe_done(7 * MS, is_done=True)
    assert state(axis) is MotionState.DONE_REPORTED


@pytest.mark.parametrize(("max_speed", "jumped"), [(0.0, False), (200.0, True)])
def test_a_jump_is_detected_only_if_max_speed_is_known(max_speed: float, jumped: bool) -> None:
    """30 mm in 1 ms. At most 2 * (200 mm/s * 1 ms + 0.5 mm) = 1.4 mm are possible."""
    axis = Axis(axis_plan(max_speed=max_speed))
    before = Actual(50_000, 0)
    assert axis.motion.has_jumped(before, Actual(80_000, 1 * MS)) is jumped
    assert not axis.motion.has_jumped(before, Actual(51_400, 1 * MS))


def test_an_axis_in_another_motion_has_an_unknown_position() -> None:
    axis = an_axis()
    acknowledge(axis)
    do(axis, Action.OTHER_MOTION)
    assert axis.motion.why_not_at_rest == "its position is unknown"
    stopped = an_axis()
    do(stopped, Action.STOP)
    assert stopped.motion.why_not_at_rest == ""


def test_in_a_dry_run_a_position_is_read_as_the_drive_reports_it() -> None:
    axis = Axis(axis_plan(compensation=CompensationMode.SHADOW))
    acknowledge(axis)
    assert axis.motion.nominal_of(50_010) == 50_010
    live = an_axis()
    acknowledge(live)
    assert live.motion.nominal_of(50_010) == 50_000


def test_a_way_begins_at_the_reached_target_or_at_the_last_seen_position() -> None:
    """It stood 5 counts before its target."""
    axis = an_axis()
    arrived(axis, 50_000, 50_005)
    acknowledge(axis, 60_000)
    ways = [axis.compensation.way]
    see(axis, 55_000)
    acknowledge(axis, 70_000)
    ways.append(axis.compensation.way)
    assert ways == [(50_010, 60_010), (55_000, 70_010)]


def test_a_position_from_before_another_reference_is_void() -> None:
    axis = an_axis()
    see(axis, 50_000)
    axis.wait_for_peers(waits=True)
    axis.wait_for_peers(waits=False)
    assert axis.motion.actual is None


def test_an_axis_that_is_done_at_its_target_has_arrived_also_while_its_reading_is_blended() -> None:
    axis = an_axis()
    see(axis, 20_000)
    acknowledge(axis, 20_005)
    axis.motion.observe_done(3 * MS, is_done=True)
    see(axis, 20_014)
    assert state(axis) is MotionState.ARRIVED


@pytest.mark.parametrize(
    ("is_under_way", "is_for_distance", "after"),
    [
        (True, False, MotionState.MOVING),
        (True, True, MotionState.UNKNOWN),
        (False, False, MotionState.UNKNOWN),
    ],
)
def test_only_an_axis_that_has_not_arrived_counts_as_on_its_way(
    is_under_way: bool, is_for_distance: bool, after: MotionState
) -> None:
    """On the way from 40 010 to 50 010."""
    axis = an_axis()
    arrived(axis, 40_000, 40_010)
    if is_under_way:
        acknowledge(axis, 50_000)
    else:
        arrived(axis, 50_000, 50_010, at_ms=1005)
    axis.motion.take_poll(Actual(45_000, 2005 * MS), is_for_distance=is_for_distance)
    assert state(axis) is after


@pytest.mark.parametrize(("counts", "after"), [(39_990, MotionState.MOVING), (39_989, MotionState.UNKNOWN)])
def test_an_axis_beyond_the_window_of_its_way_was_moved_by_something_else(
    counts: int, after: MotionState
) -> None:
    """From 40 010 to 50 010, with a window of 20 counts."""
    axis = an_axis()
    arrived(axis, 40_000, 40_010)
    acknowledge(axis, 50_000)
    axis.motion.see_way(Actual(counts, 9 * MS))
    assert state(axis) is after


def test_every_position_is_on_a_way_with_an_unknown_start() -> None:
    axis = an_axis()
    acknowledge(axis)
    axis.motion.see_way(Actual(10_000, 9 * MS))
    assert state(axis) is MotionState.MOVING


@pytest.mark.parametrize(("counts", "is_proven"), [(70_012, True), (70_013, False)])
def test_an_unacknowledged_target_is_proven_within_the_hysteresis(counts: int, is_proven: bool) -> None:
    """Within its hysteresis: 2 counts of 70 010 (M7)."""
    axis = an_axis()
    axis.targets.leave_unacknowledged(target(axis, 70_000), 1 * MS)
    see(axis, 60_000)
    see(axis, counts)
    assert (axis.motion.unacknowledged is None) is is_proven


@pytest.mark.parametrize(("counts", "is_proven"), [(70_012, True), (70_013, False)])
def test_an_axis_that_creeps_proves_nothing(counts: int, is_proven: bool) -> None:
    """The target of a record: two readings at its end decide, at most the hysteresis of 2 counts apart."""
    axis = an_axis()
    rendering = target(axis, 70_000, is_distance=True)._replace(proof=Proof.TWO)
    axis.targets.leave_unacknowledged(rendering, 1 * MS)
    axis.motion.observe_done(3 * MS, is_done=True)
    see(axis, 70_010)
    assert state(axis) is MotionState.UNACKNOWLEDGED
    see(axis, counts)
    assert (axis.motion.unacknowledged is None) is is_proven


def test_without_an_open_target_no_reading_proves_one() -> None:
    axis = an_axis()
    assert axis.motion.proof_at(Actual(70_010, 9 * MS)) is Proof.NONE
    axis.targets.leave_unacknowledged(target(axis, 70_000), 1 * MS)  # its start is unknown
    assert axis.motion.proof_at(Actual(70_010, 9 * MS)) is Proof.NONE


def test_an_axis_continues_in_the_state_of_its_record() -> None:
    """It starts at 9 ms: a bit requested before that is older."""
    axis = an_axis()
    axis.compensation.accept_again(Accepted(50_000, 50_010))
    axis.motion.resume(MotionState.ARRIVED, 9 * MS, 0)
    assert axis.motion.last_number == 0
    axis.motion.observe_done(9 * MS - 1, is_done=False)
    assert state(axis) is MotionState.ARRIVED
    axis.motion.observe_done(9 * MS, is_done=False)
    assert state(axis) is MotionState.MAY_HAVE_LEFT


@pytest.mark.parametrize(
    ("way", "has_actual", "kind"),
    [
        ("arrived", True, RepeatKind.UNSEEN),
        ("moving", True, RepeatKind.NEW),
        ("moving", False, RepeatKind.SAME_WORDS),
    ],
)
def test_a_staged_target_from_before_a_lost_link_is_repeated_if_it_was_seen_there(
    way: str, has_actual: bool, kind: RepeatKind
) -> None:
    axis = reached(way, an_axis(has_actual=has_actual, motion=MotionPlan(is_staged=True)))
    axis.lose_link(7 * MS)
    assert axis.repeat_kind(0, COMMAND.pack(50_000)) is kind
    assert axis.repeat_kind(0, COMMAND.pack(50_001)) is RepeatKind.NEW


# --- its reference -----------------------------------------------------------------------------------------


def reference(kind: Reference, *bits: str) -> AxisReference:
    fields = {name: BitField(0x30, at) for at, name in enumerate(bits)}
    return AxisReference(axis_plan(referenced=kind, bits=fields), pytest.fail)


def test_a_reference_is_lost_only_after_its_bit_was_seen() -> None:
    bit = reference(Reference.DRIVE_BIT, "homed")
    was_lost = [bit.is_lost]
    for at_ms, is_set in ((1, False), (2, True)):
        bit.see_homed_bit(at_ms * MS, is_set=is_set)
        was_lost.append(bit.is_lost)
    assert was_lost == [False, True, False]


@pytest.mark.parametrize(("bits", "ends"), [(("done", "homed"), "homed"), (("done",), "done")])
def test_homing_ends_with_its_own_bit_or_else_with_done(bits: tuple[str, ...], ends: str) -> None:
    assert reference(Reference.HOMING, *bits).bit == ends


def test_the_homed_bit_counts_100_ms_after_a_homing_began() -> None:
    bit = reference(Reference.DRIVE_BIT, "homed")
    bit.begin_homing(5 * MS, is_certain=True)
    bit.see_homed_bit(105 * MS - 1, is_set=True)
    assert bit.is_homing
    bit.see_homed_bit(105 * MS, is_set=True)
    assert bit.state is ReferenceState.REFERENCED


def test_a_bit_that_decides_is_read_again_after_a_second() -> None:
    bit = reference(Reference.DRIVE_BIT, "homed")
    assert bit.needs_reading(0, before_target=False)
    bit.see_homed_bit(5 * MS, is_set=True)
    assert not bit.needs_reading(1005 * MS, before_target=True)
    assert bit.needs_reading(1005 * MS + 1, before_target=True)
    assert not bit.needs_reading(1005 * MS + 1, before_target=False)


def test_no_bit_is_read_where_none_decides() -> None:
    assert not reference(Reference.ABSOLUTE).needs_reading(9000 * MS, before_target=True)
    homing = reference(Reference.HOMING, "homed")
    assert not homing.needs_reading(9000 * MS, before_target=True)
    homing.begin_homing(9000 * MS, is_certain=True)
    assert homing.needs_reading(9000 * MS, before_target=True)
    assert not homing.needs_reading(9000 * MS, before_target=False)


# --- what is on the wire, and triggers ---------------------------------------------------------------------


def test_a_record_names_the_target_that_is_on_the_wire_until_another_motion_is() -> None:
    axis = an_axis()
    wire, one, other = Acknowledgement(pytest.fail), target(axis, 1000), target(axis, 2000)
    steps: list[Callable[[], None]] = [
        lambda: wire.name(one),  # nothing is on the wire
        lambda: wire.send(None),
        lambda: wire.name(one),
        lambda: wire.name(other),
        lambda: wire.let_go(one),
        wire.send_motion,
    ]
    named = []
    for step in steps:
        step()
        named.append(wire.pending)
    assert named == [None, None, one, one, one, None]
    assert wire.on_wire is OnWire.MOTION


def test_an_open_target_is_named_while_it_is_the_same() -> None:
    axis = an_axis()
    leave_unacknowledged(axis)
    axis.acknowledgement.go_on_naming(axis.motion.unacknowledged)
    axis.motion.observe_done(3 * MS, is_done=True)
    assert axis.acknowledgement.pending is axis.motion.unacknowledged
    acknowledge(axis)
    assert axis.acknowledgement.pending is None


def test_triggers_are_refused_until_a_target_from_after_the_loss_is_whole() -> None:
    interlock = Interlock(pytest.fail)
    sent_in = interlock.epoch
    assert interlock.refuse(4, is_own=True)
    assert not interlock.complete(sent_in)
    assert interlock.complete(interlock.epoch)
    assert not interlock.is_blocked
