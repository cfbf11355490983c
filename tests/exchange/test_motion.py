"""The position of an axis: old done bits, short reversals, unseen jogs and distances (M4, M5, M6)."""

from typing import Any

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.axis.reach import READABILITY_AFTER
from gateway.exchange.commands import SetGain
from gateway.exchange.control import switch
from gateway.exchange.plan import ControllerPlan, Late, LineTiming, Reference
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import (
    ACTUAL,
    COMMAND,
    MS,
    Bench,
    Memory,
    Port,
    axis_plan,
    monitor,
    read,
    stream_plan,
    write,
)
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import (
    BITS,
    COMMANDED,
    HOME_PDU,
    HOMED_BIT,
    JOG_PDU,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STATUS,
    STOP_PDU,
    ZERO_PDU,
    StagedBench,
    StagedDrive,
    relative_by,
    staged_plan,
)
from tests.support.tables import walk

DONE = BitField(0x0031, 0)
READ_DONE = bytes.fromhex("03 0031 0001")
WIDE = make_table([0, 100], [0.09, 0.09], [0.01, 0.01], Units.MM)
WORN = make_table([0, 200], [0.41, 0.41], [-0.26, -0.26], Units.MM)
"""410 counts more going forward, 260 less going backward."""
SCREW = make_table([40, 50, 60, 70], [0.3, 0.35, 0.48, 0.5], [-0.3, -0.316, -0.25, -0.2], Units.MM)


def told(bench: Bench) -> float:
    return bench.memory.get(COMMAND)


def unsure(bench: Bench) -> bool:
    return bench.line.axes[0].is_unsure


def done(bench: Bench, *, is_set: bool) -> None:
    """Let the controller poll the done bit."""
    bench.memory.words[DONE.address] = int(is_set)
    assert bench.ask(READ_DONE)[-1] == int(is_set)


# --- rule 5: done of the move before -----------------------------------------------------------------------


def test_m6_a_done_bit_of_the_move_before_is_no_arrival() -> None:
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}))
    bench.move(60_000)
    done(bench, is_set=True)
    bench.ask(write(COMMAND, 100_000))
    bench.wait(20)
    done(bench, is_set=True)  # the drive has not started yet
    bench.memory.put(ACTUAL, 80_000)
    bench.wait(300)
    assert bench.command(90_000) == 90_410
    assert not unsure(bench)


def test_m6_done_that_fell_and_rose_with_the_axis_in_its_window_is_arrival() -> None:
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}))
    bench.ask(write(COMMAND, 60_000))
    done(bench, is_set=False)
    bench.wait(300)
    bench.memory.put(ACTUAL, 60_410 + 5)  # the servo stands five counts off
    done(bench, is_set=True)
    bench.actual()
    frames = len(bench.seen)
    assert bench.command(60_003) == 60_413
    assert len(bench.seen) == frames + 1
    assert not unsure(bench)


def test_m6_done_that_did_not_fall_counts_after_done_drop_ms() -> None:
    for later_ms, stage in ((900, MotionState.MOVING), (1001, MotionState.ARRIVED)):
        bench = Bench(axis_plan(table=WORN, bits={"done": DONE}, actual=()))
        bench.ask(write(COMMAND, 60_000))
        bench.wait(later_ms)
        done(bench, is_set=True)
        assert bench.line.axes[0].motion.state is stage


def test_m6_a_position_on_the_way_from_a_known_start_shows_the_direction() -> None:
    """The reading could belong to either branch of a standing axis, which does not matter."""
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}))
    bench.move(60_000)
    done(bench, is_set=True)
    bench.actual()
    bench.ask(write(COMMAND, 50_000))
    done(bench, is_set=False)
    bench.memory.put(ACTUAL, 55_000)
    bench.wait(300)
    place = bench.actual()
    assert bench.command(place + 100) == place + 100 + 410
    assert not unsure(bench)


def test_m6_a_sample_has_the_time_of_its_request() -> None:
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}, actual=()), serial=False, tcp_drive=True)
    bench.ask(write(COMMAND, 60_000))
    done(bench, is_set=False)
    bench.memory.words[DONE.address] = 1
    bench.send(write(COMMAND, 100_000))
    bench.send(READ_DONE)  # asked before the target was acknowledged, sent and answered after it
    bench.serve()
    bench.port.replies.clear()
    assert bench.line.axes[0].motion.state is MotionState.MOVING


def test_m9_a_read_that_waited_behind_another_one_is_no_jump() -> None:
    """It came before the other read and was sent after it: samples are ordered by when they were sent."""
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}), serial=False)
    bench.move(60_000)
    bench.actual()
    panel = monitor()
    bench.send(READ_DONE)
    bench.send(read(ACTUAL), port=panel)
    bench.now_ns += 30 * MS
    bench.send(read(ACTUAL))
    bench.serve()
    bench.wait(300)
    bench.serve()
    assert bench.seen[-3:] == [READ_DONE, read(ACTUAL), read(ACTUAL)]
    bench.port.replies.clear()
    assert ACTUAL.unpack(panel.take()[2:]) == 60_000
    assert bench.command(60_003) == 60_413
    assert not unsure(bench)


def test_m6_a_moving_bit_does_not_make_an_old_done_bit_count() -> None:
    moving = BitField(DONE.address, 1)
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE, "moving": moving}, actual=()))
    bench.ask(write(COMMAND, 60_000))
    for _ in range(2):
        bench.memory.words[DONE.address] = 0b11  # it moves; done is still that of the move before
        bench.ask(READ_DONE)
    assert bench.line.axes[0].motion.state is MotionState.MOVING


def test_m6_in_position_alone_never_is_arrival() -> None:
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}, actual=(), done_is_in_position=True))
    bench.ask(write(COMMAND, 60_000))
    done(bench, is_set=False)
    bench.wait(2000)
    done(bench, is_set=True)
    assert bench.line.axes[0].motion.state is MotionState.MOVING


# --- rule 6: short reversals -------------------------------------------------------------------------------


def test_m6_a_reversal_shorter_than_the_hysteresis_counts() -> None:
    bench = Bench(axis_plan(table=WORN, hysteresis=0.05))
    for counts, corrected in ((100_000, 100_410), (60_000, 59_740), (60_030, 60_440)):
        assert bench.reach(counts) == corrected


def test_m6_a_trembling_target_is_reported_and_repeat_within_counts_ends_it() -> None:
    bench = Bench(axis_plan(table=WORN))
    bench.move(60_000)
    for number in range(12):
        bench.ask(write(COMMAND, 60_001 - number % 2))
        bench.memory.put(ACTUAL, told(bench))
        bench.wait(100)
    assert bench.kinds().count("branch-hunts") == 1
    bench = Bench(axis_plan(table=WORN, repeat_within_counts=1))
    bench.move(60_000)
    for number in range(12):
        assert bench.command(60_001 - number % 2) == 60_001 - number % 2 + 410
        bench.memory.put(ACTUAL, told(bench))
        bench.wait(100)
    assert "branch-hunts" not in bench.kinds()


# --- rule 7: unseen motion ---------------------------------------------------------------------------------


def jogged(**changes: object) -> Bench:
    """Return an axis that went to 100 mm, was read as done there, and was jogged to 150 mm unseen."""
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}, **changes))
    bench.ask(write(COMMAND, 100_000))
    done(bench, is_set=False)
    bench.wait(500)
    bench.memory.put(ACTUAL, 100_410)
    done(bench, is_set=True)
    bench.actual()
    bench.memory.put(ACTUAL, 150_000)
    bench.wait(1200)
    return bench


@pytest.mark.parametrize(("counts", "corrected"), [(120_000, 119_740), (100_000, 99_740), (160_000, 160_410)])
def test_m6_the_position_of_an_unseen_axis_is_read_before_it_moves(counts: int, corrected: int) -> None:
    bench = jogged()
    assert bench.frames(write(COMMAND, counts)) == [read(ACTUAL), write(COMMAND, corrected)]


def test_m6_an_unseen_axis_that_may_not_be_read_is_flagged() -> None:
    bench = jogged(safe_read=False)
    assert bench.command(120_000) == 120_410
    assert unsure(bench)


def test_m4_a_servo_with_a_standing_error_counts_as_at_its_target() -> None:
    bench = jogged()
    bench.memory.put(ACTUAL, 100_410 - 15)
    assert bench.command(100_000) == 100_410
    bench.wait(1200)
    assert bench.command(100_003) == 100_413


def test_m6_no_position_is_read_for_an_axis_that_its_controller_polls() -> None:
    bench = jogged()
    bench.memory.put(ACTUAL, 100_410)
    bench.actual()
    bench.wait(496)
    assert bench.frames(write(COMMAND, 100_000)) == [write(COMMAND, 100_410)]


def test_m6_a_done_bit_read_after_a_pause_does_not_show_the_position() -> None:
    """The jog is over by then, and the bit is set as before. A controller that polls all the time would have
    read it clear."""
    bench = jogged()
    done(bench, is_set=True)
    assert bench.frames(write(COMMAND, 120_000)) == [read(ACTUAL), write(COMMAND, 119_740)]
    for _ in range(4):
        bench.wait(400)
        done(bench, is_set=True)
    assert bench.frames(write(COMMAND, 120_000)) == [write(COMMAND, 119_740)]


def test_m6_an_axis_that_is_done_elsewhere_is_no_longer_on_its_way() -> None:
    """Sent to 100 mm, jogged to 150 mm: its arrival was not read; it is done, and is elsewhere."""
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}))
    bench.ask(write(COMMAND, 100_000))
    bench.wait(1100)
    done(bench, is_set=True)
    bench.memory.put(ACTUAL, 150_000)
    bench.actual()
    assert bench.command(100_000) == 99_740
    assert not unsure(bench)


def test_m4_an_axis_held_on_its_way_gets_the_same_words_over_a_switch() -> None:
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}))
    bench.ask(write(COMMAND, 100_000))
    bench.memory.put(ACTUAL, 50_000)
    for _ in range(4):
        bench.wait(400)
        bench.actual()
    bench.line.axes[0].correction.enable(is_on=False)
    assert bench.command(100_000) == 100_410


def test_m4_an_axis_that_is_on_its_way_gets_the_same_words_again() -> None:
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}))
    bench.ask(write(COMMAND, 100_000))
    bench.wait(1100)
    for counts in (90_000, 90_100, 90_200):  # half a millimetre in a second
        bench.memory.put(ACTUAL, counts)
        bench.actual()
        bench.wait(200)
    assert bench.command(100_000) == 100_410


def test_the_added_read_does_not_count_towards_the_deadline() -> None:
    bench = jogged(deadline_ms=5.0, late=Late.REJECT)
    bench.send(write(COMMAND, 120_000))
    unit_id, pdu = bench.link.sent.pop()
    assert pdu == read(ACTUAL)
    bench.now_ns += 8 * MS
    bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
    assert bench.link.take() == write(COMMAND, 119_740)


# --- rule 4: unacknowledged distances ----------------------------------------------------------------------


@pytest.mark.parametrize("reply", ["lost", "refused"])
@pytest.mark.parametrize("has_run", [True, False])
def test_m5_a_reading_shows_the_end_of_an_unacknowledged_distance(reply: str, has_run: bool) -> None:
    bench = standing_with_done()
    distance(bench, reply, has_run=has_run)
    assert unsure(bench)
    bench.wait(1100)
    if has_run:
        bench.drive.arrive()
    assert bench.actual() == (55_000 if has_run else 45_000)
    assert not unsure(bench)
    bench.run(10_000, RUN_RELATIVE_PDU)
    # 65.000 forward: 0.49 mm more; 55.000: 0.415
    assert bench.drive.moves[-1] == ("relative", 65_490 if has_run else 55_415)


def standing_with_done() -> StagedBench:
    bench = StagedBench(staged_plan(table=SCREW, commanded=()), serial=False, tcp_drive=True)
    bench.drive.put(ACTUAL, 44_000)
    bench.go_to(60_000)
    assert bench.go_to(45_000)[1] == 44_692
    return bench


def distance(bench: StagedBench, reply: str, *, has_run: bool) -> None:
    """Trigger +10 mm; the drive runs it or not, and does not acknowledge it."""
    bench.stage(10_000)
    bench.send(RUN_RELATIVE_PDU)
    bench.serve_writes()
    pdu = bench.link.take()
    assert pdu == RUN_RELATIVE_PDU
    if has_run:
        bench.memory.answer(pdu)
        assert bench.drive.moves[-1] == ("relative", 55_415)
    if reply == "lost":
        bench.wait(1000)
    else:
        bench.line.reply(1, bytes.fromhex("86 04"), bench.now_ns)
    bench.port.take()


def test_m5_a_moving_bit_alone_shows_that_a_distance_has_ended() -> None:
    plan = staged_plan(table=SCREW, commanded=(), bits={"moving": BITS["moving"]})
    bench = StagedBench(plan, serial=False, tcp_drive=True)
    bench.drive.put(ACTUAL, 44_000)
    bench.go_to(60_000, 45_000)
    bench.stage(10_000)
    bench.send(RUN_RELATIVE_PDU)
    while (pdu := bench.link.take()) != RUN_RELATIVE_PDU:
        bench.line.reply(1, bench.memory.answer(pdu), bench.now_ns)
    bench.memory.answer(pdu)
    bench.wait(1000)
    bench.port.take()
    bench.drive.set_bits(is_done=False)
    bench.poll()
    bench.actual()
    assert bench.line.axes[0].motion.is_distance_unconfirmed
    bench.drive.arrive()
    bench.poll()
    bench.wait(1100)
    assert bench.actual() == 55_000
    assert not bench.line.axes[0].motion.is_distance_unconfirmed


def test_m5_there_is_no_base_before_done_drop_ms_have_passed() -> None:
    bench = standing_with_done()
    distance(bench, "refused", has_run=True)
    bench.drive.set_bits(is_done=True)  # still that of the move before
    bench.stage(10_000)
    assert bench.refused(RUN_RELATIVE_PDU) == 6
    bench.drive.set_bits(is_done=False)
    bench.poll()
    bench.drive.arrive()
    bench.poll()
    assert bench.actual() == 55_000


@pytest.mark.parametrize("base", [Action.RELATIVE_TO_ACTUAL, Action.RELATIVE_TO_COMMANDED])
def test_m5_a_done_bit_of_the_move_before_gives_no_base(base: Action) -> None:
    """The drive reports done until it has started: a position on the way is no base."""
    bench = StagedBench(staged_plan(table=SCREW, motion=relative_by(base), commanded=()))
    bench.go_to(45_000)
    bench.run(60_000)
    bench.drive.put(ACTUAL, 50_000)
    bench.drive.set_bits(is_done=True)
    moves = len(bench.drive.moves)
    bench.stage(1_000)
    assert bench.refused(RUN_RELATIVE_PDU) == 6
    bench.drive.put(ACTUAL, 60_480 - 8)  # 60.000 forward, eight counts off: there
    bench.trigger(RUN_RELATIVE_PDU)
    assert len(bench.drive.moves) == moves + 1


def test_m5_a_done_bit_after_a_jog_counts_only_after_done_drop_ms() -> None:
    bench = StagedBench(staged_plan(table=SCREW, commanded=()))
    bench.go_to(45_000)
    bench.trigger(JOG_PDU)
    bench.drive.put(ACTUAL, 50_000)
    bench.drive.set_bits(is_done=True)
    bench.stage(1_000)
    assert bench.refused(RUN_RELATIVE_PDU) == 6
    bench.wait(1000)
    assert bench.trigger(RUN_RELATIVE_PDU)[0] == "relative"


def test_m5_a_done_bit_counts_immediately_after_a_jog_whose_end_was_seen() -> None:
    bench = StagedBench(staged_plan(table=SCREW, commanded=()))
    bench.go_to(45_000)
    bench.trigger(JOG_PDU)
    bench.drive.set_bits(is_done=False)
    bench.poll()
    bench.trigger(STOP_PDU)
    bench.drive.put(ACTUAL, 50_000)
    bench.drive.set_bits(is_done=True)
    bench.poll()
    assert bench.run(1_000, RUN_RELATIVE_PDU)[0] == "relative"


def test_m5_a_set_position_is_no_motion() -> None:
    bench = StagedBench(staged_plan(table=SCREW, commanded=(), referenced=Reference.SET_POSITION))
    bench.drive.put(ACTUAL, 50_000)
    bench.wait(5000)
    bench.trigger(ZERO_PDU)
    bench.wait(50)
    bench.poll()
    assert bench.run(1_000, RUN_RELATIVE_PDU)[0] == "relative"


def test_m5_a_distance_that_passed_unchanged_is_also_a_motion() -> None:
    plan = staged_plan(
        table=SCREW, motion=relative_by(Action.RELATIVE_TO_ACTUAL, passes_unknown_relative=True), commanded=()
    )
    bench = StagedBench(plan)
    bench.trigger(JOG_PDU)
    bench.drive.put(ACTUAL, 52_000)
    bench.drive.set_bits(is_done=False)
    bench.wait(3000)
    bench.run(10_000, RUN_RELATIVE_PDU)
    assert bench.memory.get(COMMAND) == 10_000
    bench.wait(20)
    bench.drive.put(ACTUAL, 52_000)
    bench.drive.set_bits(is_done=True)  # still that of before
    bench.trigger(RUN_RELATIVE_PDU)
    assert bench.kinds().count("base-unknown") == 2
    assert bench.memory.get(COMMAND) == 10_000


def test_m5_a_distance_has_no_base_if_the_added_read_is_refused() -> None:
    """The axis may have been jogged, and the drive would count from its new position."""
    bench = StagedBench(staged_plan(table=SCREW, commanded=(), motion=relative_by(Action.RELATIVE)))
    bench.go_to(45_000)
    bench.stage(10_000)
    bench.wait(1200)
    moves = list(bench.drive.moves)
    bench.send(RUN_RELATIVE_PDU)
    for _ in range(2):
        assert bench.answers(bytes.fromhex("83 06")) == read(ACTUAL)
    bench.serve()
    assert bench.port.take() == bytes.fromhex("86 06")
    assert bench.drive.moves == moves


@pytest.mark.parametrize("stands_at", [50_000, 56_000])
def test_m5_there_is_no_base_if_the_axis_is_at_neither_end(stands_at: int) -> None:
    bench = standing_with_done()
    distance(bench, "lost", has_run=True)
    bench.drive.arrive()
    bench.drive.put(ACTUAL, stands_at)
    bench.wait(1100)
    bench.stage(10_000)
    assert bench.refused(RUN_RELATIVE_PDU) == 6
    assert unsure(bench)
    bench.run(50_000)
    assert not bench.line.axes[0].motion.is_distance_unconfirmed


def test_m5_there_is_no_base_if_both_ends_lie_in_the_window() -> None:
    bench = standing_with_done()
    bench.drive.pass_by(44_692)
    bench.stage(-10)
    bench.send(RUN_RELATIVE_PDU)
    bench.serve_writes()
    bench.memory.answer(bench.link.take())
    bench.wait(1000)
    bench.port.take()
    bench.drive.arrive()
    bench.wait(1100)
    bench.stage(-10)
    assert bench.refused(RUN_RELATIVE_PDU) == 6


# --- references that are lost and found --------------------------------------------------------------------

HOMED = BitField(0x0031, 5)


def homed(bench: Bench, *, is_set: bool) -> None:
    bench.memory.words[HOMED.address] = is_set << HOMED.bit
    bench.ask(READ_DONE)


def test_m9_a_retained_target_moves_nothing_when_the_reference_is_lost_and_found() -> None:
    bench = Bench(axis_plan(table=WORN, referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}))
    homed(bench, is_set=True)
    bench.move(100_000)
    assert bench.reach(60_000) == 59_740
    for is_set in (False, True, False):
        homed(bench, is_set=is_set)
        for _ in range(3):
            assert bench.command(60_000) == 59_740
    assert bench.command(70_000) == 70_000  # another one passes 1:1
    bench.memory.put(ACTUAL, 70_000)
    homed(bench, is_set=True)
    assert bench.command(70_000) == 70_000
    assert bench.reach(80_000) == 80_410


@pytest.mark.parametrize("is_staged_again", [True, False])
def test_m9_a_retained_target_keeps_its_words_without_a_reference(is_staged_again: bool) -> None:
    bench = StagedBench(staged_plan(table=WORN, referenced=Reference.DRIVE_BIT))
    assert bench.go_to(60_000)[1] == 60_410
    bench.drive.set_bits(is_done=True, is_homed=False)
    bench.poll()
    if is_staged_again:
        bench.stage(60_000)
    assert bench.trigger()[1] == 60_410
    bench.drive.set_bits(is_done=True, is_homed=False)  # the drive on the bench shows it with each move
    bench.poll()
    assert bench.run(70_000)[1] == 70_000


def test_m9_a_target_after_homing_is_a_new_one() -> None:
    bench = StagedBench(staged_plan(table=WORN, referenced=Reference.HOMING))
    bench.line.axes[0].declare_referenced()
    assert bench.go_to(60_000)[1] == 60_410
    bench.ask(HOME_PDU)
    bench.drive.put(ACTUAL, 0)
    bench.drive.set_bits(is_done=True)
    bench.wait(500)
    bench.poll()
    assert bench.go_to(60_000)[1] == 60_410
    bench.ask(HOME_PDU)
    assert bench.go_to(60_000)[1] == 60_000  # while it homes


def test_m9_a_retained_target_moves_nothing_after_a_silence_in_which_the_reference_was_lost() -> None:
    plan = axis_plan(table=WORN, referenced=Reference.HOMING)
    bench = Bench(plan, timing=LineTiming(drain_ms=1))
    bench.line.axes[0].declare_referenced()
    bench.move(100_000, 60_000)
    for _ in range(3):
        bench.unanswered(write(COMMAND, 60_000), 1001, 2)
    bench.wait(1000)  # then it is tried again
    assert bench.command(60_000) == 59_740
    assert not bench.line.axes[0].reference.is_referenced
    assert bench.command(60_001) == 60_001


def homed_bench() -> Bench:
    """Return an axis whose reference depends on the homed bit, after a move backward to 60 mm."""
    plan = axis_plan(table=WORN, referenced=Reference.DRIVE_BIT, bits={"homed": HOMED})
    bench = Bench(plan, timing=LineTiming(drain_ms=1), memory=homed_memory())
    bench.move(100_000)
    assert bench.reach(60_000) == 59_740
    return bench


def homed_memory() -> Memory:
    memory = Memory()
    memory.words[HOMED.address] = 1 << HOMED.bit
    return memory


def be_silent(bench: Bench, times: int) -> None:
    for _ in range(times):
        bench.unanswered(read(ACTUAL), 1001, 2)
    bench.wait(1000)  # then it is tried again


def cut(bench: Bench, ms: float) -> None:
    bench.line.link_down(bench.now_ns)
    bench.wait(ms)
    bench.line.link_up(bench.now_ns)


@pytest.mark.parametrize("trouble", ["a short silence", "a long silence", "a short cut", "a long cut"])
def test_m9_a_repeat_moves_nothing_if_the_homed_bit_is_clear_afterwards(trouble: str) -> None:
    bench = homed_bench()
    bench.memory.words[HOMED.address] = 0
    if "silence" in trouble:
        be_silent(bench, 1 if "short" in trouble else 3)
    else:
        cut(bench, 500 if "short" in trouble else 3000)
        bench.serve()
    assert bench.command(60_000) == 59_740
    assert not bench.line.axes[0].reference.is_referenced
    assert bench.command(60_001) == 60_001


@pytest.mark.parametrize("stands_at", [59_740, 52_000])
@pytest.mark.parametrize("trouble", ["a long silence", "a cut"])
def test_m6_a_repeat_is_rendered_again_if_the_homed_bit_is_still_set(trouble: str, stands_at: int) -> None:
    """The axis may have been moved: its position is read, and an axis at its target gets the same words."""
    bench = homed_bench()
    bench.memory.put(ACTUAL, stands_at)
    if trouble == "a cut":
        cut(bench, 3000)
        bench.serve()
    else:
        be_silent(bench, 3)
    assert bench.command(60_000) == (59_740 if stands_at == 59_740 else 60_410)  # from 52 mm it comes forward
    assert not unsure(bench)


# --- what a refusal proves ---------------------------------------------------------------------------------


def test_m7_exception_1_proves_that_nothing_was_written() -> None:
    bench = Bench(axis_plan(table=WORN))
    bench.move(100_000, 60_000)
    data = COMMAND.pack(70_000)
    both = bytes.fromhex("17 0520 0002 0606 0002 04") + data
    bench.send(both)
    bench.line.reply(1, bench.memory.answer(bench.link.take()), bench.now_ns)  # it is looked at first
    bench.answers(bytes.fromhex("97 01"))
    assert bench.port.take() == bytes.fromhex("97 01")
    axis = bench.line.axes[0]
    assert axis.compensation.accepted == (60_000, 59_740)
    assert axis.motion.unacknowledged is None
    assert bench.actual() == 60_000
    assert bench.reach(60_010) == 60_420
    assert not unsure(bench)


def test_m7_an_unanswered_target_with_the_words_of_the_one_before_is_proven_by_its_arrival() -> None:
    """50 000 is 50 010, and so is 50 005 with half the gain: the drive goes there in any case."""
    bench = Bench(axis_plan())
    bench.move(20_000)
    assert bench.command(50_000) == 50_010
    bench.memory.put(ACTUAL, 30_000)
    bench.actual()
    bench.line.command(SetGain(axes=("x",), forward=0.5, backward=0.5), bench.now_ns)
    bench.send(write(COMMAND, 50_005))
    bench.serve_reads()
    assert bench.link.take() == write(COMMAND, 50_010)
    bench.wait(1_001)  # nobody answers
    bench.wait(1_001)  # the line is silent
    bench.port.replies.clear()
    readings = []
    for counts in (40_000, 50_010):
        bench.memory.put(ACTUAL, counts)
        readings.append(bench.actual())
    assert readings == [39_990, 50_005]


# --- sequences that several rules have a part in ---------------------------------------------------------


def test_a3_a_done_bit_that_flickers_does_not_flip_the_branch_of_the_same_target() -> None:
    bench = Bench(axis_plan(bits=BITS))
    bench.move(50_000)
    told = bench.seen[-1]
    for error, word in ((15, 1 << 4), (15, 0), (-15, 1 << 4), (-15, 0)):
        bench.memory.put(ACTUAL, 50_010 + error)
        bench.memory.write(0x005C, word.to_bytes(2, "big"))
        bench.ask(bytes.fromhex("03 005C 0001"))
        bench.wait(100)
        assert bench.sent_for(write(COMMAND, 50_000)) == told


def test_m4_a_reading_after_the_done_bit_dropped_shows_whether_the_axis_was_moved_away() -> None:
    bench = Bench(axis_plan(bits=BITS))
    bench.move(50_000)
    for word in (1 << 4, 0):
        bench.memory.write(0x005C, word.to_bytes(2, "big"))
        bench.ask(bytes.fromhex("03 005C 0001"))
    bench.memory.put(ACTUAL, 80_000)
    bench.wait(100)
    assert bench.sent_for(write(COMMAND, 50_000)) == write(COMMAND, 49_990)


def test_a11_the_reading_does_not_jump_at_a_reversal_although_the_last_one_is_old() -> None:
    bench = StagedBench()
    bench.go_to(50_000)
    bench.run(80_000)
    bench.drive.pass_by(51_000)
    bench.actual()
    bench.settle()  # the controller sees the done bit, and reads no position
    bench.run(20_000)
    assert bench.actual() == 80_000  # it has not moved yet
    bench.drive.pass_by(50_000)
    assert bench.actual() == 50_000  # half of the way: half of the 20 counts between the branches


def test_m4_a_repeat_whose_reply_was_lost_does_not_change_the_branch() -> None:
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.move(50_000)
    told = bench.seen[-1]
    bench.memory.put(ACTUAL, 50_025)  # 15 counts beside it, with 2 of hysteresis
    bench.unanswered(write(COMMAND, 50_000), 1000)
    assert bench.sent_for(write(COMMAND, 50_000)) == told


# === where a reading cannot decide: an axis just moved otherwise, a drive that refuses to tell ===========
BUSY, ADDRESS = bytes.fromhex("83 06"), bytes.fromhex("83 02")


# --- right after a motion that is no target: within done_drop_ms, 1,000 ms ----------------------------------


def just_jogged(at: int, *, ms: float = 300, is_done: bool = True, **changes: Any) -> StagedBench:
    """Return an axis that arrived at 45 mm forward, was jogged, and is then at a given position."""
    bench = StagedBench(staged_plan(table=WORN, **changes))
    bench.go_to(45_000)
    bench.trigger(JOG_PDU)
    bench.drive.put(ACTUAL, at)
    bench.drive.put(COMMANDED, at)
    bench.drive.set_bits(is_done=is_done)
    bench.wait(ms)
    return bench


@pytest.mark.parametrize(
    ("stands_at", "told", "is_flagged"),
    [
        (80_000, 59_740, False),  # beyond both branches of 60 mm, 60 410 and 59 740
        (50_000, 60_410, False),
        (60_100, 60_410, True),  # between them: it keeps its branch, forward
        (60_410, 60_410, True),  # just where one of them is: it may be passing by
        (59_740, 60_410, True),
    ],
)
def test_m6_the_position_of_an_axis_just_jogged_is_read_and_its_branch_may_be_flagged(
    stands_at: int, told: int, is_flagged: bool
) -> None:
    bench = just_jogged(stands_at)
    bench.stage(60_000)
    bench.seen.clear()
    bench.trigger(RUN_PDU)
    assert bench.seen[0] == read(ACTUAL)
    assert bench.drive.moves[-1] == ("absolute", float(told))
    assert unsure(bench) is is_flagged


def test_m6_a_second_after_a_jog_the_reading_shows_the_branch() -> None:
    bench = just_jogged(59_740, ms=1_001)
    assert bench.run(60_000) == ("absolute", 59_740.0)
    assert not unsure(bench)


def test_m6_the_reading_shows_the_branch_immediately_after_a_jog_whose_end_was_seen() -> None:
    bench = just_jogged(59_740, is_done=False)
    bench.poll()
    bench.trigger(STOP_PDU)
    bench.poll()
    assert bench.run(60_000) == ("absolute", 59_740.0)
    assert not unsure(bench)


def test_m6_an_axis_may_have_passed_its_target_since_the_reading() -> None:
    """200 mm/s in 20 ms are 4 mm: 3 mm away is not far enough, 5 mm is."""
    for stands_at, is_flagged in ((63_000, True), (65_000, False)):
        bench = just_jogged(stands_at)
        bench.stage(60_000)
        bench.send(RUN_PDU)
        assert bench.link.sent[0][1] == read(ACTUAL)
        bench.now_ns += 19 * MS
        bench.serve()
        assert bench.port.take() == RUN_PDU
        assert bench.drive.moves[-1] == ("absolute", 59_740.0)
        assert unsure(bench) is is_flagged


@pytest.mark.parametrize(
    ("is_released", "answers_after_ms", "is_flagged"),
    [(False, 60, False), (True, 4, False), (True, 60, True)],
)
def test_m6_an_axis_that_goes_on_after_a_halt_may_have_passed_its_target_since_the_reading(
    is_released: bool, answers_after_ms: int, is_flagged: bool
) -> None:
    """It is read 1 mm before its target. At 200 mm/s it goes 0.8 mm in 4 ms, and 12 mm in 60."""
    bench = StagedBench(staged_plan(max_speed=200.0, commanded=()))
    bench.go_to(10_000)
    bench.run(90_000)
    bench.poll()
    bench.drive.pass_by(50_000)
    bench.trigger(STOP_PDU)
    bench.poll()
    bench.wait(1_000)
    bench.drive.set_bits(is_done=not is_released)
    bench.poll()
    bench.drive.pass_by(59_000)
    bench.stage(60_000)
    bench.send(RUN_PDU)
    assert [pdu for _, pdu in bench.link.sent] == [read(ACTUAL)]
    bench.wait(answers_after_ms - 1)
    bench.serve()
    assert bench.drive.moves[-1] == ("absolute", 60_010.0)
    assert unsure(bench) is is_flagged


@pytest.mark.parametrize("then", ["no poll", "a poll", "a poll with done 0"])
@pytest.mark.parametrize("has_moving", [True, False], ids=["moving", "done"])
def test_m6_after_a_stop_the_moving_bit_says_whether_the_axis_moves(then: str, has_moving: bool) -> None:
    """It moved when it was asked before its stop; 800 ms later its drive is read 60 ms before the target.

    A done bit may stay 0 after a stop: where a moving bit is mapped, that one decides, from the stop on.
    """
    bits = {name: bit for name, bit in BITS.items() if has_moving or name != "moving"}
    bench = StagedBench(staged_plan(max_speed=0.0, commanded=(), bits=bits))
    bench.go_to(10_000)
    bench.run(90_000)
    bench.poll()
    bench.drive.pass_by(50_000)
    bench.trigger(STOP_PDU)
    if then == "a poll with done 0":
        bench.drive.write(STATUS, (1 << HOMED_BIT).to_bytes(2, "big"))
    if then != "no poll":
        bench.poll()
    bench.wait(800)
    bench.stage(80_000)
    bench.send(RUN_PDU)
    bench.wait(60)
    bench.serve()
    assert unsure(bench) is (then != "a poll" and not has_moving)


@pytest.mark.parametrize("change", [{"added_frames": False}, {"safe_read": False}])
def test_m6_without_added_frames_a_jogged_axis_keeps_its_branch_and_is_flagged(
    change: dict[str, bool],
) -> None:
    bench = StagedBench(staged_plan(table=WORN, **change))
    bench.ask(read(ACTUAL))
    bench.go_to(45_000)
    assert bench.go_to(46_000)[1] == 46_410
    bench.trigger(JOG_PDU)
    bench.drive.put(ACTUAL, 80_000)
    bench.wait(700)  # older than what counts as fresh, 500 ms
    bench.stage(60_000)
    bench.seen.clear()
    bench.trigger(RUN_PDU)
    assert bench.seen == [RUN_PDU]
    assert bench.drive.moves[-1] == ("absolute", 60_410.0)
    assert unsure(bench)


@pytest.mark.parametrize("change", [{}, {"added_frames": False}, {"safe_read": False}, {"bits": {}}])
def test_m5_a_distance_right_after_a_jog_is_refused(change: dict[str, Any]) -> None:
    bench = just_jogged(80_000, **change)
    bench.stage(1_000)
    assert bench.refused(RUN_RELATIVE_PDU) == 6


# --- a drive that answers an added read with an exception --------------------------------------------------


class Reluctant(Memory):
    """Refuses reads of its actual position, once for each entry of ``refusals``."""

    def __init__(self, *refusals: bytes) -> None:
        super().__init__()
        self.refusals = list(refusals)

    def answer(self, pdu: bytes) -> bytes:
        if pdu == read(ACTUAL) and self.refusals:
            return self.refusals.pop(0)
        return super().answer(pdu)


def unseen(*refusals: bytes, jogged_to: int = 150_000, **changes: object) -> Bench:
    """Return an axis that arrived at 100 mm forward, was jogged unseen, and whose drive then refuses
    reads."""
    memory = Reluctant()
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}, **changes), memory=memory)
    bench.ask(write(COMMAND, 100_000))
    memory.words[DONE.address] = 0
    bench.ask(bytes.fromhex("03 0031 0001"))
    memory.words[DONE.address] = 1
    memory.put(ACTUAL, 100_410)
    bench.wait(500)
    bench.ask(bytes.fromhex("03 0031 0001"))
    bench.actual()
    memory.put(ACTUAL, jogged_to)
    bench.wait(1_200)
    memory.refusals = list(refusals)
    bench.seen.clear()
    return bench


@pytest.mark.parametrize("code", [0x05, 0x06, 0x01, 0x02, 0x04, 0x0B, 0x33])
def test_w8_a_refused_read_of_the_position_is_repeated_once(code: int) -> None:
    """Before: 120 410, and the axis comes from 150 mm: 0.67 mm off, flagged."""
    bench = unseen(bytes((0x83, code)))
    assert bench.ask(write(COMMAND, 120_000)) == write(COMMAND, 120_000)[:5]
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 119_740)]
    assert not unsure(bench)


def test_m6_an_axis_moved_a_little_while_unseen_assumes_the_branch_of_a_near_target() -> None:
    """The drive at 100.61 mm is 100.2 mm forward and 100.87 mm backward; 100.6 mm lies between both."""
    bench = unseen(jogged_to=100_610)
    bench.ask(write(COMMAND, 100_600))
    assert bench.seen == [read(ACTUAL), write(COMMAND, 101_010)]
    assert unsure(bench)


def test_w8_a_read_answered_with_busy_is_repeated_once_for_each_target() -> None:
    bench = unseen(BUSY, BUSY, BUSY)
    bench.ask(write(COMMAND, 120_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 120_410)]
    assert unsure(bench)
    bench.wait(1_200)
    # it stands at 150 mm yet
    assert bench.frames(write(COMMAND, 110_000)) == [read(ACTUAL), read(ACTUAL), write(COMMAND, 109_740)]
    assert not unsure(bench)


def test_w8_a_read_refused_twice_in_a_row_is_not_sent_again_until_the_link_comes_up() -> None:
    bench = unseen(ADDRESS, ADDRESS)
    bench.ask(write(COMMAND, 120_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 120_410)]
    assert unsure(bench)
    for counts in (110_000, 130_000):
        bench.wait(1_200)
        assert bench.frames(write(COMMAND, counts)) == [write(COMMAND, counts + 410)]  # its branch is kept
        assert unsure(bench)
    told = [event.detail for event in bench.events if event.kind.name == "direction-unsure"]
    why = (
        "its position is not known well enough; its branch is assumed; its drive refuses to report its actual"
    )
    assert told == [f"{why} position"]
    bench.cut(100)
    # it stands at 150 mm
    assert bench.frames(write(COMMAND, 140_000)) == [read(ACTUAL), write(COMMAND, 139_740)]
    assert not unsure(bench)


def test_w8_single_refusals_do_not_end_the_added_reads() -> None:
    bench = unseen(ADDRESS)
    for counts in (120_000, 110_000, 100_000):
        bench.memory.put(ACTUAL, 150_000)
        bench.wait(1_200)
        bench.seen.clear()
        bench.memory.refusals = [ADDRESS]  # type: ignore[attr-defined]
        bench.ask(write(COMMAND, counts))
        assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, counts - 260)]
        assert not unsure(bench)


@pytest.mark.parametrize("refusals", [(BUSY, BUSY), (ADDRESS, ADDRESS)])
def test_m6_the_same_target_again_keeps_its_words_and_is_flagged(refusals: tuple[bytes, ...]) -> None:
    """The axis may have been jogged, and may come from another position."""
    bench = unseen(*refusals)
    bench.ask(write(COMMAND, 100_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 100_410)]
    assert unsure(bench)


def test_w8_a_drive_that_reports_its_position_to_its_controller_is_tried_again_once() -> None:
    """Two exceptions in a row must not end the reads for ever: else one unseen jog makes the branch wrong for
    weeks."""
    bench = unseen(ADDRESS, ADDRESS)
    bench.ask(write(COMMAND, 120_000))
    assert bench.actual() == 150_000 - 410
    for refusals, frames in (
        ([], [read(ACTUAL), write(COMMAND, 109_740)]),
        ([ADDRESS], [read(ACTUAL), read(ACTUAL), write(COMMAND, 99_740)]),
    ):
        bench.wait(1_200)
        bench.seen.clear()
        bench.memory.refusals = list(refusals)  # type: ignore[attr-defined]
        bench.ask(write(COMMAND, 110_000 if not refusals else 100_000))
        assert bench.seen == frames
        assert not unsure(bench)


def test_m6_the_same_target_again_is_flagged_once_added_reads_have_ended() -> None:
    bench = unseen(ADDRESS, ADDRESS, jogged_to=100_410)
    bench.ask(write(COMMAND, 120_000))
    bench.wait(1_200)
    assert bench.frames(write(COMMAND, 120_000)) == [write(COMMAND, 120_410)]
    assert unsure(bench)


def test_w8_both_reads_are_sent_within_half_of_the_controllers_time_out() -> None:
    """1,000 ms: after 500 ms the read is repeated; after 501 ms it is not, and the target is sent without
    it."""
    for after_ms, reads in ((500, 2), (501, 1)):
        bench = unseen(BUSY)
        bench.send(write(COMMAND, 120_000))
        assert bench.link.take() == read(ACTUAL)
        bench.now_ns += after_ms * MS
        bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
        bench.serve()
        assert bench.seen.count(read(ACTUAL)) == reads - 1
        assert bench.memory.get(COMMAND) == (119_740 if reads == 2 else 120_410)
        assert unsure(bench) is (reads == 1)


class ReluctantDrive(StagedDrive):
    """A drive that waits for a trigger and refuses reads of its actual position."""

    def __init__(self) -> None:
        super().__init__()
        self.refusals: list[bytes] = []

    def answer(self, pdu: bytes) -> bytes:
        if pdu == read(ACTUAL) and self.refusals:
            return self.refusals.pop(0)
        return super().answer(pdu)


def refusing(*refusals: bytes) -> StagedBench:
    """Return a staged axis that arrived at 45 mm forward, and was not read for a while."""
    drive = ReluctantDrive()
    plan = staged_plan(table=WORN, commanded=(), motion=relative_by(Action.RELATIVE))
    bench = StagedBench(plan, serial=False)
    bench.drive = bench.memory = drive
    bench.go_to(45_000)
    bench.wait(1_200)
    drive.refusals = list(refusals)
    return bench


@pytest.mark.parametrize("refusal", [BUSY, ADDRESS])
def test_m5_a_distance_whose_added_read_is_refused_twice_gets_exception_6(refusal: bytes) -> None:
    bench = refusing(refusal, refusal)
    bench.stage(10_000)
    bench.seen.clear()
    assert bench.refused(RUN_RELATIVE_PDU) == 6
    assert bench.seen == [read(ACTUAL), read(ACTUAL)]
    bench.wait(100)
    bench.seen.clear()
    bench.stage(10_000)
    if refusal == ADDRESS:  # it is not asked, and gets 6 all the same
        assert bench.refused(RUN_RELATIVE_PDU) == 6
        assert read(ACTUAL) not in bench.seen
    else:
        assert bench.trigger(RUN_RELATIVE_PDU) == ("relative", 55_410.0)


def test_m3_a_stop_is_sent_between_both_reads() -> None:
    bench = refusing(BUSY)
    bench.stage(60_000)
    bench.send(RUN_PDU)
    assert bench.link.take() == read(ACTUAL)
    stopper = Port(ControllerPlan("pad"))
    bench.send(STOP_PDU, port=stopper)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent[0][1] == STOP_PDU
    moves = len(bench.drive.moves)
    bench.serve()
    assert stopper.take() == STOP_PDU
    assert bench.port.take() == bytes.fromhex("86 06")  # a stop of its axis came after it
    assert [kind for kind, _ in bench.drive.moves[moves:]] == ["stop"]


def test_w8_a_refused_read_at_the_start_is_repeated_once_too() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    for refusals, is_restored in (((BUSY,), True), ((ADDRESS,), True), ((BUSY, BUSY), False)):
        memory = Reluctant(*refusals)
        memory.words = dict(bench.memory.words)
        started = RecordBench(
            *bench.plans, records=bench.records.copy(), memory=memory, start_ns=bench.now_ns
        )
        assert started.seen == [read(ACTUAL), read(ACTUAL)]
        assert ("restored" in started.kinds()) is is_restored
        assert started.actual() == 20_000  # what passes decides then


def test_w8_the_drive_of_a_stream_is_no_longer_read_once_it_becomes_busy() -> None:
    """At the first reading it was a millimetre behind its last setpoint; from then on it answers "busy"."""
    bench = RecordBench(stream_plan())
    for counts in (30_000, 30_100, 30_200):
        bench.ask(write(COMMAND, counts))
    memory = Reluctant()
    memory.words = dict(bench.memory.words)
    memory.put(ACTUAL, 29_000)
    memory.refusals = [memory.answer(read(ACTUAL)), *[BUSY] * 500]
    started = RecordBench(
        *bench.plans, records=bench.records.copy(), memory=memory, start_ns=bench.now_ns + 5 * MS
    )
    assert started.seen == [read(ACTUAL)] * 3
    assert len(memory.refusals) == 498


def test_w8_a_refused_read_before_a_first_setpoint_is_repeated_once() -> None:
    memory = Reluctant(BUSY)
    bench = Bench(stream_plan(table=WORN), memory=memory)
    memory.put(ACTUAL, 50_410)
    bench.ask(write(COMMAND, 50_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 50_410)]


def test_every_answer_leads_where_the_table_says() -> None:
    """By hand: columns are what is known, rows what the drive answers."""
    by_hand = walk("""
                open          refused-once  refused
    place       open          open          refused
    passing     open          refused-once  refused-once
    refusal     refused-once  refused       refused
    link-lost   open          open          open
    """)
    rows = READABILITY_AFTER.items()
    assert by_hand == {(now.value, told.value): then.value for now, row in rows for told, then in row.items()}


@pytest.mark.parametrize(
    ("max_speed", "answers_after_ms", "target", "told", "is_flagged"),
    [
        (200.0, 45, 40_000, 40_010, False),  # it has gone 9 mm of 10
        (200.0, 60, 40_000, 40_010, True),  # 12 mm: it may be beyond its target, which is backward then
        (200.0, 300, 20_000, 19_990, False),  # behind it, and further with each moment
        (200.0, 300, 95_000, 95_010, False),  # beyond its last target, which it does not pass
        (0.0, 18, 40_000, 40_010, False),  # its speed is not known, and the reading is fresh (20 ms)
        (0.0, 60, 40_000, 40_010, True),
        (0.0, 60, 20_000, 19_990, False),
        (0.0, 60, 95_000, 95_010, False),
    ],
)
def test_m6_an_axis_that_may_have_passed_its_target_since_it_was_read_is_flagged(
    max_speed: float, answers_after_ms: int, target: int, told: int, is_flagged: bool
) -> None:
    bench = Bench(axis_plan(max_speed=max_speed))
    bench.move(10_000)
    bench.actual()
    bench.wait(1_000)
    bench.ask(write(COMMAND, 90_000))
    bench.wait(100)
    bench.memory.put(ACTUAL, 30_000)
    bench.send(write(COMMAND, target))
    [(_, asked)] = bench.link.sent
    assert asked == read(ACTUAL)
    bench.wait(answers_after_ms)
    bench.serve()
    assert bench.memory.get(COMMAND) == told
    assert unsure(bench) is is_flagged


def test_m6_an_assumed_branch_stays_flagged_as_long_as_it_is_in_force() -> None:
    """Half-way between 50 090 and 50 010, because it may have come from either side."""
    bench = Bench(axis_plan(table=WIDE, safe_read=False))
    assert bench.command(50_000) == 50_050
    assert unsure(bench)
    switch(bench.line.axes, "x", is_on=False)
    assert bench.command(50_000) == 50_050  # the same target keeps its words
    assert unsure(bench)
    assert bench.command(60_000) == 60_000
    assert not unsure(bench)
