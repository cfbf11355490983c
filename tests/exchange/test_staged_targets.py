"""Staged targets and their triggers (M2, M3): no trigger runs a target that the controller does not mean."""

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, ModePlan, MotionPlan, NextTarget, Operation, TriggerPlan
from gateway.exchange.commands import SetGain
from gateway.exchange.control import switch
from gateway.exchange.plan import AxisPlan, ControllerPlan, Reference
from gateway.exchange.status import direction_state
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Port, axis_plan, read, write
from tests.exchange.staged_bench import (
    HOME_PDU,
    JOG_PDU,
    MODE,
    ONLY_ABSOLUTE,
    RUN,
    RUN_PDU,
    STAGED,
    STOP_PDU,
    STORED_PDU,
    TRIGGER,
    StagedBench,
    staged_plan,
    sticky,
)

RUN_HEX = RUN_PDU.hex(" ")
WIDE = PositionField(0x050C, COMMAND.type, COMMAND.order)
"""A target right before the trigger register: one frame can hold both."""


def standing(*plans: AxisPlan, **others: bool) -> StagedBench:
    """Return an axis that went to 50 mm, forward."""
    bench = StagedBench(*plans, **others)
    bench.go_to(50_000)
    return bench


def written(bench: StagedBench, trigger: bytes) -> list[str]:
    """Run a trigger; return the writes to the drive for it."""
    bench.writes()
    bench.trigger(trigger)
    return bench.writes()


def test_m2_a_trigger_runs_a_corrected_target_and_staging_alone_changes_no_reading() -> None:
    # A11: before the trigger of a staged move the readback must not change.
    bench = standing()
    assert bench.actual() == 50_000
    bench.stage(20_000)
    assert bench.drive.moves == [("absolute", 50_010)]
    assert bench.actual() == 50_000
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 20_000


def test_a1_a_target_that_the_gateway_refused_is_not_replaced_by_the_old_one() -> None:
    bench = standing(staged_plan(motion=ONLY_ABSOLUTE, travel=(0.0, 100.0)))
    assert bench.refused(write(COMMAND, 150_000)) == 4
    assert bench.refused(RUN_PDU) == 4
    assert bench.refused(RUN_PDU) == 4
    bench.go_to(60_000)
    assert bench.drive.moves == [("absolute", 50_010), ("absolute", 60_010)]
    assert bench.kinds().count("axis-blocked") == 3  # the block, and each trigger that was refused
    assert "axis-released" in bench.kinds()


@pytest.mark.parametrize("code", [1, 2, 3, 4, 6, 0x27, 0x35])
def test_a1_a_target_that_the_drive_refused_refuses_its_trigger_with_the_same_code(code: int) -> None:
    bench = standing()
    bench.send(write(COMMAND, 20_000))
    bench.answers(bytes((0x90, code)))
    assert bench.port.take() == bytes((0x90, code))
    assert bench.refused(RUN_PDU) == code
    bench.go_to(20_000)
    assert bench.drive.moves[1:] == [("absolute", 19_990)]


def test_a1_a_target_that_was_never_answered_refuses_its_trigger_on_a_serial_line_too() -> None:
    bench = standing()
    assert bench.unanswered(write(COMMAND, 20_000), 1000, 1000) == []  # the line was silent long enough
    assert bench.refused(RUN_PDU) == 0x0B


def test_a1_a_withdrawn_target_refuses_its_trigger() -> None:
    bench = standing()
    bench.send(bytes.fromhex("03 0800 0001"), Port(ControllerPlan("hmi")))
    bench.send(write(COMMAND, 20_000))  # waits
    bench.send(RUN_PDU)  # the serial controller has gone on: its target is withdrawn
    bench.serve()
    assert bench.port.take()[0] == 0x86
    assert bench.drive.moves == [("absolute", 50_010)]


@pytest.mark.parametrize("pdu", [STOP_PDU, bytes.fromhex("06 0800 0001"), read(ACTUAL)])
def test_m3_a_blocked_axis_refuses_triggers_and_nothing_else(pdu: bytes) -> None:
    bench = standing(staged_plan(motion=ONLY_ABSOLUTE, travel=(0.0, 100.0)))
    bench.refused(write(COMMAND, 150_000))
    assert bench.ask(pdu)[0] == pdu[0]


def test_a2_direction_is_decided_at_the_trigger_from_where_the_axis_is_then() -> None:
    # Standing at 0, on the way to 100; at 30 the controller stages 50, waits, and triggers: 100 -> 50 is
    # backward, although 30 -> 50 was forward when it was staged.
    bench = StagedBench()
    bench.run(100_000)
    bench.drive.pass_by(30_000)
    assert bench.actual() == 29_997  # 10 counts forward, of which 70 % of the way is still to come
    bench.stage(50_000)
    bench.settle()
    bench.writes()
    bench.trigger()
    assert bench.drive.moves == [("absolute", 100_010), ("absolute", 49_990)]
    assert bench.writes() == [write(COMMAND, 49_990).hex(" "), RUN_HEX]
    assert bench.line.counters.restaged == 2  # the first was the first move of all, staged half-way


@pytest.mark.parametrize(("word", "added"), [(1, []), (0x77, [write(COMMAND, 60_000).hex(" ")])])
def test_m2_a_trigger_adds_a_frame_only_if_the_staged_words_are_not_right(
    word: int, added: list[str]
) -> None:
    """A value that the map does not list runs what the controller wrote."""
    bench = standing()
    bench.stage(60_000)
    pdu = bytes.fromhex(f"06 050E {word:04X}")
    assert written(bench, pdu) == [*added, pdu.hex(" ")]


def test_a2_a_gain_or_table_switched_between_staging_and_trigger_counts_at_the_trigger() -> None:
    bench = standing()
    bench.stage(60_000)
    assert switch(bench.line.axes, "x", is_on=False) == ("x",)
    assert written(bench, RUN_PDU) == [write(COMMAND, 60_000).hex(" "), RUN_HEX]


def test_m2_the_trigger_waits_for_the_acknowledgement_of_the_restaged_target() -> None:
    bench = StagedBench()
    bench.go_to(100_000)
    bench.stage(50_000)
    switch(bench.line.axes, "x", is_on=False)
    bench.send(RUN_PDU)
    assert bench.answers(bytes.fromhex("90 04")) == write(COMMAND, 50_000)
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("86 04")
    assert bench.refused(RUN_PDU) == 4
    bench.go_to(50_000)
    assert bench.drive.moves == [("absolute", 100_010), ("absolute", 50_000)]


def test_m2_a_restaged_target_that_was_never_acknowledged_runs_nothing() -> None:
    bench = StagedBench(serial=False, tcp_drive=True)
    bench.go_to(100_000)
    bench.stage(50_000)
    switch(bench.line.axes, "x", is_on=False)
    bench.missed(RUN_PDU, 1000)
    assert bench.port.take() == bytes.fromhex("86 0B")
    assert bench.refused(RUN_PDU) == 0x0B


def test_w8_without_added_frames_a_trigger_that_needs_one_is_refused() -> None:
    bench = standing(staged_plan(added_frames=False))
    bench.stage(60_000)
    switch(bench.line.axes, "x", is_on=False)
    assert bench.refused(RUN_PDU) == 4


def test_w8_without_added_frames_the_same_target_again_is_rendered_for_the_present_position() -> None:
    """It was jogged past its target, so it must approach from the other side."""
    bench = standing(staged_plan(added_frames=False))
    bench.stage(60_000)
    bench.drive.put(ACTUAL, 90_000)
    bench.actual()
    assert bench.refused(RUN_PDU) == 4
    bench.go_to(60_000)
    assert bench.drive.moves == [("absolute", 50_000), ("absolute", 59_990)]


def test_m2_one_frame_with_target_and_trigger_moves_at_once() -> None:
    bench = StagedBench(staged_plan(command=(WIDE,)))
    frame = bytes.fromhex("10 050C 0003 06 C350 0000 0001")
    assert bench.ask(frame) == frame[:5]
    assert bench.seen[-1] == bytes.fromhex("10 050C 0003 06 C35A 0000 0001")


def test_m3_a_refused_frame_of_target_and_trigger_refuses_the_trigger_alone() -> None:
    bench = StagedBench(staged_plan(command=(WIDE,), travel=(0.0, 60.0)))
    assert bench.refused(bytes.fromhex("10 050C 0003 06 4E20 0001 0001")) == 4
    assert bench.refused(RUN_PDU) == 4


def test_a_trigger_of_a_target_from_before_the_start_of_the_gateway_is_refused() -> None:
    bench = StagedBench()
    bench.memory.put(COMMAND, 50_000)
    assert bench.refused(RUN_PDU) == 4
    assert "stored-move" in bench.kinds()


def test_a19_the_start_of_a_stored_position_is_refused_unless_it_may_pass_uncorrected() -> None:
    bench = standing()
    assert bench.refused(STORED_PDU) == 4
    passing = sticky(passes_stored_moves=True)
    bench = StagedBench(staged_plan(motion=passing))
    bench.trigger(STORED_PDU)
    assert bench.drive.moves == [("stored", 0)]


# --- modes: before, inside, after -------------------------------------------------------------------------


def set_mode(bench: StagedBench, value: int) -> None:
    pdu = bytes.fromhex(f"06 {MODE:04X} {value:04X}")
    assert bench.ask(pdu) == pdu


def test_m2_a_mode_that_was_never_seen_is_read() -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    bench.memory.words[MODE] = 1
    bench.run(50_000)
    assert bytes.fromhex("03 0700 0001") in bench.seen
    assert bench.drive.moves == [("absolute", 50_010)]


def test_m2_a_mode_written_after_the_target_counts() -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    set_mode(bench, 1)
    bench.go_to(50_000)
    bench.stage(10_000)
    set_mode(bench, 2)
    bench.trigger()
    # 50 000 + 10 000 stays forward: the distance is the same on both scales
    assert bench.drive.moves == [("absolute", 50_010), ("relative", 60_010)]


@pytest.mark.parametrize("value", [7, 0, 0xFFFF])
def test_an_unknown_mode_passes_untouched_and_is_counted(value: int) -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    set_mode(bench, value)
    bench.run(50_000)
    assert bench.memory.get(COMMAND) == 50_000
    assert bench.line.counters.unknown_modes == 1
    assert bench.kinds().count("unknown-mode") == 1


def test_each_target_that_passes_in_a_frame_of_unknown_meaning_is_flagged() -> None:
    """The event comes once for the same unknown value; the status says it until a target is corrected."""
    bench = StagedBench(staged_plan(command=(WIDE,)))
    frame = "10 050C 0003 06 {:04X} 0000 {:04X}"
    assert bench.ask(bytes.fromhex(frame.format(20_000, RUN)))[0] == 0x10
    assert bench.memory.get(WIDE) == 20_010
    for counts in (30_000, 10_000, 40_000):
        assert bench.ask(bytes.fromhex(frame.format(counts, 9)))[0] == 0x10  # 9 is no value that is known
        assert bench.memory.get(WIDE) == counts
        assert direction_state(bench.line.axes[0]) == "unsure"
    bench.drive.stand_at(40_000)
    bench.ask(bytes.fromhex(frame.format(60_000, RUN)))
    assert bench.memory.get(WIDE) == 60_010
    assert direction_state(bench.line.axes[0]) == "forward"


@pytest.mark.parametrize("before", ["kill", "link"])
def test_m2_a_kept_target_is_not_run_in_a_mode_that_the_drive_does_not_report(before: str) -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    if before == "link":
        set_mode(bench, 1)
        bench.stage(0)  # 10 0606 0002 04 0000 0000: written as it came
        bench.line.link_down(bench.now_ns)
        bench.line.link_up(bench.now_ns)
    bench.drive.put(COMMAND, 5_010)  # 5000 as the gateway before this one corrected it
    bench.send(RUN_PDU)
    assert bench.answers(bytes.fromhex("83 02")) == bytes.fromhex("03 0700 0001")
    assert (bench.port.take(), bench.link.sent) == (bytes.fromhex("86 04"), [])
    assert bench.kinds()[-1] == "stored-move"
    set_mode(bench, 1)
    bench.go_to(5_000)
    assert bench.drive.moves == [("absolute", 5_010)]


def test_p14_a_position_in_a_velocity_frame_is_no_target() -> None:
    bench = StagedBench(staged_plan(motion=sticky(), travel=(10.0, 100.0)))
    set_mode(bench, 3)
    bench.stage(0)  # a don't-care outside the travel
    assert bench.memory.get(COMMAND) == 0
    bench.trigger()


def test_m3_a_lost_mode_refuses_triggers_until_it_was_accepted() -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    set_mode(bench, 1)
    bench.go_to(50_000)
    bench.send(bytes.fromhex("06 0700 0002"))
    bench.answers(bytes.fromhex("86 04"))
    bench.port.take()
    bench.stage(60_000)
    assert bench.refused(RUN_PDU) == 4
    set_mode(bench, 2)
    assert bench.run(10_000) == ("relative", 60_010)


# --- stops ------------------------------------------------------------------------------------------------


def test_m3_a_stop_goes_to_the_head_of_the_queue_and_withdraws_requests_that_would_move_its_axis() -> None:
    bench = standing(serial=False)
    hmi = Port(ControllerPlan("hmi"))
    bench.send(bytes.fromhex("03 0800 0001"), hmi)
    bench.send(write(COMMAND, 20_000), transaction_id=1)
    bench.send(RUN_PDU, transaction_id=2)
    bench.send(read(ACTUAL), transaction_id=3)
    bench.send(STOP_PDU, hmi, transaction_id=4)
    bench.writes()
    bench.serve()
    assert bench.writes() == [STOP_PDU.hex(" ")]
    answers = {transaction: pdu for transaction, _, pdu in bench.port.replies}
    assert answers[1] == bytes.fromhex("90 06")
    assert answers[2] == bytes.fromhex("86 06")
    assert answers[3][0] == 3
    assert bench.drive.moves == [("absolute", 50_010), ("stop", 50_010)]


def test_m3_a_stop_overtakes_a_move_that_is_still_being_prepared() -> None:
    bench = standing(serial=False)
    bench.stage(20_000)
    bench.wait(5000)
    bench.drive.set_bits(is_done=False)
    bench.poll()  # something else moves the axis: where it is must be read first
    bench.send(RUN_PDU, transaction_id=1)
    assert bench.link.sent[0][1][0] == 3
    bench.send(STOP_PDU, transaction_id=2)
    bench.serve()
    assert {t: p.hex(" ") for t, _, p in bench.port.replies} == {1: "86 06", 2: STOP_PDU.hex(" ")}
    assert [kind for kind, _ in bench.drive.moves] == ["absolute", "stop"]


def test_m3_a_stop_is_sent_although_the_queue_is_full() -> None:
    bench = StagedBench(serial=False)
    for number in range(40):
        bench.send(bytes.fromhex("03 0800 0001"), transaction_id=number)
    bench.send(STOP_PDU, transaction_id=99)
    bench.serve()
    assert (99, 1, STOP_PDU) in bench.port.replies
    assert bench.seen.index(STOP_PDU) == 1


def test_a4e_a_stop_between_the_halves_of_a_target_passes_at_once() -> None:
    bench = standing()
    assert bench.ask(bytes.fromhex("06 0606 4E20")) == bytes.fromhex("06 0606 4E20")
    assert bench.trigger(STOP_PDU)[0] == "stop"


def test_m2_nothing_is_written_again_to_a_drive_that_moves_with_each_write() -> None:
    """Such a drive has a trigger too. With half the gain 60 000 would be other words: refused with 4."""
    bench = StagedBench(staged_plan(motion=MotionPlan(triggers=STAGED.triggers)))
    bench.stage(60_000)
    bench.drive.pass_by(55_000)
    assert bench.ask(STOP_PDU) == STOP_PDU
    bench.line.command(SetGain(axes=("x",), forward=0.5, backward=0.5), bench.now_ns)
    bench.writes()
    assert bench.refused(RUN_PDU) == 4
    assert bench.writes() == []


# --- broadcasts -------------------------------------------------------------------------------------------


def broadcast(bench: StagedBench, pdu: bytes) -> None:
    bench.send(pdu, unit_id=0)
    bench.serve()
    assert bench.port.replies == []
    bench.wait(100)


def test_a18_a_broadcast_trigger_is_refused_while_an_axis_is_blocked() -> None:
    other = staged_plan(name="y", unit_id=2, motion=ONLY_ABSOLUTE, travel=(0.0, 100.0))
    bench = StagedBench(staged_plan(), other)
    bench.stage(60_000)
    assert bench.ask(write(COMMAND, 150_000), unit_id=2) == bytes.fromhex("90 04")
    broadcast(bench, RUN_PDU)
    assert bench.drive.moves == []


def test_a18_a_broadcast_stop_always_passes() -> None:
    bench = StagedBench(staged_plan(motion=ONLY_ABSOLUTE, travel=(0.0, 100.0)))
    bench.refused(write(COMMAND, 150_000))
    broadcast(bench, STOP_PDU)
    assert bench.drive.moves == [("stop", 0)]


def test_a18_a_broadcast_trigger_runs_right_words_and_the_position_is_read_afterwards() -> None:
    bench = standing()
    bench.stage(60_000)
    broadcast(bench, RUN_PDU)
    bench.drive.arrive()
    bench.stage(55_000)
    bench.seen.clear()
    bench.trigger()
    assert read(ACTUAL) in bench.seen
    assert bench.drive.moves[-2:] == [("absolute", 60_010), ("absolute", 54_990)]


def test_w5_a_broadcast_whose_target_is_rewritten_first_is_not_withdrawn_by_the_next_request() -> None:
    """An RTU controller waits for no reply to a broadcast. With half the gain 60 000 is 60 005."""
    bench = standing()
    bench.stage(60_000)
    bench.line.command(SetGain(axes=("x",), forward=0.5, backward=0.5), bench.now_ns)
    bench.send(RUN_PDU, unit_id=0)
    assert bench.link.sent == [(1, write(COMMAND, 60_005))]
    bench.send(read(ACTUAL))
    bench.serve()
    bench.wait(200)
    bench.serve()
    assert bench.drive.moves[-1] == ("absolute", 60_005), bench.kinds()


# --- homing and what follows ------------------------------------------------------------------------------


def test_a_homing_command_passes_and_positions_pass_unchanged_until_the_drive_is_homed() -> None:
    bench = standing(staged_plan(referenced=Reference.DRIVE_BIT))
    bench.trigger(HOME_PDU)
    bench.drive.set_bits(is_done=False, is_homed=False)
    bench.drive.pass_by(123)
    assert bench.actual() == 123
    bench.drive.set_bits(is_done=True, is_homed=True)
    bench.wait(500)
    assert bench.go_to(20_000) == ("absolute", 20_010)


def test_m2_a_staged_target_is_written_again_1_to_1_if_its_mode_is_unknown_at_the_trigger() -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    set_mode(bench, 1)
    bench.go_to(50_000)
    bench.stage(60_000)
    set_mode(bench, 9)
    assert written(bench, RUN_PDU) == [write(COMMAND, 60_000).hex(" "), RUN_HEX]
    assert bench.line.counters.unknown_modes == 1


# --- sequences that several rules have a part in ---------------------------------------------------------


FOLLOWING = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(TRIGGER, deeds={1: Operation(Action.START), 0xFFFB: Operation(Action.FOLLOW_NEXT)}),
    ),
)


def test_m2_a_position_that_an_unknown_mode_may_follow_passes_unchanged() -> None:
    bench = StagedBench(staged_plan(motion=FOLLOWING, added_frames=False))
    bench.ask(write(COMMAND, 50_000))
    assert bench.drive.get(COMMAND) == 50_000
    assert bench.line.counters.unknown_modes == 1


@pytest.mark.parametrize(("word", "told"), [(0xFFFB, 50_010), (0xFFFC, 50_000)], ids=["follow", "unknown"])
def test_m2_targets_are_corrected_while_following_is_on_and_pass_while_its_register_is_unknown(
    word: int, told: int
) -> None:
    bench = StagedBench(staged_plan(motion=FOLLOWING))
    pdu = bytes.fromhex(f"06 050E {word:04X}")
    assert bench.ask(pdu) == pdu
    bench.ask(write(COMMAND, 50_000))
    assert bench.drive.get(COMMAND) == told
    assert word != 0xFFFB or bench.line.axes[0].compensation.accepted is not None


def test_m2_an_opcode_frame_that_is_too_short_passes_unchanged() -> None:
    block = PositionField(0x00F7, RegisterType.INT32, WordOrder.HIGH_FIRST, block=0x00F5)
    bench = Bench(axis_plan(command=(block,), actual=()))
    bench.ask(bytes.fromhex("10 00F5 0004 08 0002 012C 0000 C350"))
    short = bytes.fromhex("10 00F5 0003 06 0002 012C 0001")
    assert bench.sent_for(short) == short


def test_m2_words_that_passed_unchanged_read_back_as_they_were_written() -> None:
    mode = ModePlan(0x0605, actions={0: Action.ABSOLUTE}, is_in_frame=True)
    bench = Bench(axis_plan(motion=MotionPlan(modes=(mode,))))
    bench.ask(bytes.fromhex("10 0605 0003 06 0000") + COMMAND.pack(50_000))
    bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
    assert bench.command(33) == 33
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 33


def test_a18_after_a_broadcast_trigger_the_axis_reads_back_what_was_commanded() -> None:
    bench = StagedBench()
    bench.go_to(80_000)
    bench.actual()
    bench.stage(50_000)
    bench.send(RUN_PDU, unit_id=0)
    bench.serve()
    bench.wait(100)
    bench.drive.arrive()
    assert bench.drive.moves[-1:] == [("absolute", 49_990)]
    assert bench.actual() == 50_000


def test_m3_a_trigger_with_an_unknown_mode_does_not_run_a_target_from_before_a_lost_link() -> None:
    offset = make_table([0, 100], [0.05, 0.05], [0.05, 0.05], Units.MM)
    bench = StagedBench(staged_plan(table=offset, motion=sticky(), safe_read=False))
    bench.ask(bytes.fromhex("06 0700 0001"))
    bench.go_to(50_000)
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    bench.serve()
    assert bench.refused(RUN_PDU) == 4


def test_a_target_that_could_not_be_written_again_reads_back_as_it_was_written() -> None:
    """M1: 5000 is staged forward, 5010. Jogged to 9000 it is backward, 4990: the drive refuses that. Its
    register holds 5010, or 4990 should the refusal lie; both are the 5000 that the controller wrote."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(0)
    bench.stage(5000)
    assert bench.memory.get(COMMAND) == 5010
    bench.ask(JOG_PDU)
    bench.drive.stand_at(9000)
    bench.wait(1200)
    bench.send(RUN_PDU)
    while bench.link.sent:
        unit_id, pdu = bench.link.sent.pop(0)
        reply = bytes.fromhex("90 04") if pdu[0] == 16 else bench.memory.answer(pdu)
        bench.line.reply(unit_id, reply, bench.now_ns)
    assert pdu == write(COMMAND, 4990)
    assert bench.port.take() == bytes.fromhex("86 04")
    for held in (5010, 4990):
        bench.memory.put(COMMAND, held)
        assert bench.ask(read(COMMAND)) == b"\x03\x04" + COMMAND.pack(5000)


# --- a target that comes during a move, where the controller decides what the drive does then -------------


@pytest.mark.parametrize(
    ("at", "target", "told", "direction"),
    [
        (30_000, 50_000, 50_010, "unsure"),  # from 30 000 forward, from 100 000 backward
        (30_000, 20_000, 19_990, "backward"),  # backward from both
        (30_000, 120_000, 120_010, "forward"),
    ],
)
def test_m6_a_target_during_a_move_is_flagged_where_the_two_directions_differ(
    at: int, target: int, told: int, direction: str
) -> None:
    bench = StagedBench(staged_plan(next_target=NextTarget.UNKNOWN))
    assert bench.run(100_000) == ("absolute", 100_010)
    bench.wait(1000)
    bench.drive.pass_by(at)
    assert bench.run(target) == ("absolute", told)
    assert direction_state(bench.line.axes[0]) == direction


def test_m6_a_target_at_standstill_is_not_flagged_whatever_the_drive_does_during_a_move() -> None:
    bench = StagedBench(staged_plan(next_target=NextTarget.UNKNOWN))
    bench.go_to(100_000)
    assert bench.run(50_000) == ("absolute", 49_990)
    assert direction_state(bench.line.axes[0]) == "backward"
