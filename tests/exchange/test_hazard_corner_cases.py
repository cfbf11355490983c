"""Sequences that a reviewer found, each of which once moved iron wrong or stopped it too late."""

from dataclasses import replace

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, Form, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import ControllerPlan, Reference
from gateway.modbus.registers import FieldAccess, PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Port, axis_plan, read, write
from tests.exchange.staged_bench import (
    BITS,
    HOME_PDU,
    ONLY_ABSOLUTE,
    RUN_PDU,
    STOP_PDU,
    TRIGGER,
    ZERO_PDU,
    StagedBench,
    staged_plan,
    sticky,
)

CONTROL = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(
            TRIGGER, mask=0x1F, rising=0x10, deeds={0x1F: Operation(Action.ABSOLUTE)}, otherwise=Action.IGNORE
        ),
        TriggerPlan(TRIGGER, mask=0x0F, deeds={0x0F: Operation(Action.IGNORE)}, otherwise=Action.STOP),
    ),
)
"""A control word whose bit 4 starts, and whose enable bits stop."""


def control(value: int) -> bytes:
    return bytes((6,)) + TRIGGER.to_bytes(2, "big") + value.to_bytes(2, "big")


def test_m3_a_start_bit_that_falls_and_rises_in_the_queue_is_withdrawn_by_a_stop() -> None:
    bench = Bench(axis_plan(motion=CONTROL), serial=False)
    for value in (0x0F, 0x1F):
        bench.ask(control(value))
    bench.ask(write(COMMAND, 50_000))
    bench.send(bytes.fromhex("03 0800 0001"), Port(ControllerPlan("hmi")))
    bench.send(control(0x0F), transaction_id=1)
    bench.send(control(0x1F), transaction_id=2)
    bench.send(control(0x06), transaction_id=3)
    bench.seen.clear()
    bench.serve()
    assert control(0x1F) not in bench.seen
    assert (2, 1, bytes.fromhex("86 06")) in bench.port.replies


def test_m3_a_stop_of_two_axes_withdraws_the_targets_of_both() -> None:
    other = PositionField(0x0608, RegisterType.INT32, WordOrder.LOW_FIRST)
    plans = [staged_plan(), staged_plan(name="y", command=(other,), actual=(), bits={})]
    bench = StagedBench(*plans, serial=False)
    bench.send(bytes.fromhex("03 0800 0001"), Port(ControllerPlan("hmi")))
    bench.send(write(other, 50_000), transaction_id=1)
    bench.send(STOP_PDU, transaction_id=2)
    bench.serve()
    assert (1, 1, bytes.fromhex("90 06")) in bench.port.replies
    assert bench.drive.get(other) == 0


def test_m9_a_target_staged_while_corrected_and_run_while_it_passes_is_given_back_as_it_came() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.DRIVE_BIT))
    bench.go_to(20_000)
    bench.stage(50_000)
    bench.drive.set_bits(is_done=True, is_homed=False)
    bench.poll()
    bench.trigger()
    assert bench.drive.moves[-1:] == [("absolute", 50_000)]


def test_m9_after_homing_began_a_target_staged_before_is_given_back_as_it_came() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.DRIVE_BIT))
    bench.go_to(20_000)
    bench.stage(50_000)
    bench.trigger(HOME_PDU)
    bench.drive.set_bits(is_done=True, is_homed=False)
    bench.trigger()
    assert bench.drive.moves[-1:] == [("absolute", 50_000)]


def test_m1_half_of_a_field_that_reads_as_something_else_is_not_completed_from_there() -> None:
    target = replace(COMMAND, access=FieldAccess.WRITE)
    bench = Bench(axis_plan(command=(target,), actual=(replace(COMMAND, access=FieldAccess.READ),)))
    bench.memory.put(COMMAND, 0x0005_4020)
    assert bench.ask(bytes.fromhex("06 0606 9000")) == bytes.fromhex("86 04")
    assert bench.seen == []


def test_a3_a_done_bit_that_flickers_does_not_flip_the_branch_of_the_same_target() -> None:
    bench = Bench(axis_plan(bits=BITS))
    bench.move(50_000)
    told = bench.seen[-1]
    for error, word in ((15, 1 << 4), (15, 0), (-15, 1 << 4), (-15, 0)):
        bench.memory.put(ACTUAL, 50_010 + error)
        bench.memory.write(0x005C, word.to_bytes(2, "big"))
        bench.ask(bytes.fromhex("03 005C 0001"))
        bench.wait(100)
        bench.ask(write(COMMAND, 50_000))
        assert bench.seen[-1] == told


def test_m4_after_the_done_bit_dropped_a_reading_tells_whether_the_axis_was_moved_away() -> None:
    bench = Bench(axis_plan(bits=BITS))
    bench.move(50_000)
    for word in (1 << 4, 0):
        bench.memory.write(0x005C, word.to_bytes(2, "big"))
        bench.ask(bytes.fromhex("03 005C 0001"))
    bench.memory.put(ACTUAL, 80_000)
    bench.wait(100)
    bench.ask(write(COMMAND, 50_000))
    assert bench.seen[-1] == write(COMMAND, 49_990)


def gantry(**changes: object) -> StagedBench:
    plans = [staged_plan(name=name, unit_id=unit, **changes) for name, unit in (("y1", 1), ("y2", 2))]
    return StagedBench(*plans, groups=[["y1", "y2"]])


def ask(bench: StagedBench, unit_id: int, pdu: bytes) -> bytes:
    bench.send(pdu, unit_id=unit_id)
    bench.serve()
    return bench.port.take()


def lose(bench: StagedBench, unit_id: int, pdu: bytes) -> None:
    bench.send(pdu, unit_id=unit_id)
    while bench.link.sent[0][1][0] == 3:
        bench.serve_reads()
    bench.link.take()
    bench.line.reply(unit_id, bytes((pdu[0] | 0x80, 4)), bench.now_ns)
    bench.port.take()


ONE_FRAME = bytes.fromhex("10 050C 0003 06 C350 0000 0001")
WIDE = PositionField(0x050C, RegisterType.INT32, WordOrder.LOW_FIRST)


def test_m11_a_frame_of_target_and_trigger_does_not_run_while_the_other_axis_lost_its_own() -> None:
    bench = gantry(command=(WIDE,))
    lose(bench, 1, ONE_FRAME)
    assert ask(bench, 2, ONE_FRAME) == bytes.fromhex("90 04")
    assert bench.drive.moves == []
    for unit_id in (1, 2):  # given again, both run: the one refused for the other's sake holds up nobody
        assert ask(bench, unit_id, ONE_FRAME) == ONE_FRAME[:5]


def test_m11_a_drive_that_moves_at_once_waits_for_its_beam_too() -> None:
    plans = [axis_plan(name=name, unit_id=unit) for name, unit in (("y1", 1), ("y2", 2))]
    bench = StagedBench(*plans, groups=[["y1", "y2"]])
    lose(bench, 1, write(COMMAND, 50_000))
    assert ask(bench, 2, write(COMMAND, 50_000)) == bytes.fromhex("90 04")
    assert ask(bench, 1, write(COMMAND, 50_000))[0] == 0x10
    assert ask(bench, 2, write(COMMAND, 50_000))[0] == 0x10


def test_w7_a_trigger_to_another_name_of_the_unit_is_refused_and_a_stop_is_not() -> None:
    bench = StagedBench(serial=False, tcp_drive=True)
    bench.stage(50_000)
    for unit_id in (0, 255):
        assert ask(bench, unit_id, RUN_PDU) == bytes.fromhex("86 0A")
        assert ask(bench, unit_id, ZERO_PDU) == bytes.fromhex("86 0A")
        assert ask(bench, unit_id, STOP_PDU) == STOP_PDU


def test_a16_a_position_set_on_a_drive_without_triggers_is_noticed() -> None:
    bench = Bench(axis_plan(settable=frozenset({0})))
    bench.move(50_000)
    bench.ask(write(ACTUAL, 0))
    assert "reference-lost" in bench.kinds()


def test_a16_a_homing_that_was_stopped_or_refused_makes_no_reference() -> None:
    bits = {name: bit for name, bit in BITS.items() if name != "homed"}
    for pdus in ((HOME_PDU, STOP_PDU), (None,)):
        bench = StagedBench(staged_plan(referenced=Reference.HOMING, bits=bits))
        for pdu in pdus:
            if pdu is None:
                lose(bench, 1, HOME_PDU)
            else:
                bench.trigger(pdu)
        bench.drive.set_bits(is_done=True)
        bench.wait(500)
        bench.poll()
        assert "axis-referenced" not in bench.kinds()


FOLLOWING = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(TRIGGER, deeds={1: Operation(Action.START), 0xFFFB: Operation(Action.FOLLOW_NEXT)}),
    ),
)


def test_m2_what_a_drive_follows_and_cannot_be_known_passes_as_it_came() -> None:
    bench = StagedBench(staged_plan(motion=FOLLOWING, added_frames=False))
    bench.ask(write(COMMAND, 50_000))
    assert bench.drive.get(COMMAND) == 50_000
    assert bench.line.counters.unknown_modes == 1


def test_m2_following_is_switched_on_before_any_target_and_each_is_corrected_then() -> None:
    bench = StagedBench(staged_plan(motion=FOLLOWING))
    follow = bytes.fromhex("06 050E FFFB")
    assert bench.ask(follow) == follow
    bench.ask(write(COMMAND, 50_000))
    assert bench.drive.get(COMMAND) == 50_010
    accepted = bench.line.axes[0].compensation.accepted
    assert accepted is not None


def test_m2_targets_pass_as_they_come_while_the_trigger_register_holds_something_unknown() -> None:
    bench = StagedBench(staged_plan(motion=FOLLOWING))
    bench.ask(bytes.fromhex("06 050E FFFC"))
    bench.ask(write(COMMAND, 50_000))
    assert bench.drive.get(COMMAND) == 50_000


def test_m1_halves_that_the_drive_acknowledged_may_come_slowly() -> None:
    bench = StagedBench(staged_plan(writes_with=Form.FC06, motion=ONLY_ABSOLUTE))
    for part in ("06 0606 FFFA", "06 0607 0000"):
        assert bench.ask(bytes.fromhex(part)) == bytes.fromhex(part)
        bench.wait(700)
    bench.trigger()
    assert bench.drive.moves == [("absolute", 65_540)]


def test_m3_a_stop_does_not_wait_for_the_frames_that_another_unit_needs() -> None:
    bench = StagedBench(staged_plan(), staged_plan(name="y", unit_id=2), serial=False)
    for unit_id in (1, 2):
        ask(bench, unit_id, write(COMMAND, 50_000))
    bench.send(RUN_PDU, unit_id=2, transaction_id=1)
    assert bench.link.sent[0][1][0] == 3
    bench.send(STOP_PDU, unit_id=1, transaction_id=2)
    bench.seen.clear()
    bench.serve()
    assert bench.seen.index(STOP_PDU) == 1
    assert bench.seen[-1] == RUN_PDU


def test_m3_stops_that_nobody_waits_for_do_not_pile_up() -> None:
    bench = StagedBench(serial=False)
    bench.send(bytes.fromhex("03 0800 0001"))
    for _ in range(100):
        panel = Port(ControllerPlan("panel"))
        bench.send(STOP_PDU, panel)
        bench.line.controller_gone(panel, bench.now_ns)
    for number in range(100):
        bench.send(STOP_PDU, transaction_id=number)
    bench.seen.clear()
    bench.serve()
    assert bench.seen.count(STOP_PDU) == 100  # each that is waited for


def test_m9_an_axis_that_passes_is_never_blocked() -> None:
    bench = StagedBench(staged_plan(table=None), serial=False)
    bench.send(write(COMMAND, 50_000))
    bench.link.sent.clear()
    bench.wait(1000)
    bench.wait(1000)
    bench.port.replies.clear()
    bench.trigger()
    assert bench.ask(bytes.fromhex("06 0606 1234")) == bytes.fromhex("06 0606 1234")


def test_m3_a_mask_that_certainly_clears_the_enable_bits_is_a_stop() -> None:
    bench = Bench(axis_plan(motion=CONTROL, travel=(0.0, 60.0)))
    bench.ask(write(COMMAND, 90_000))
    stop = bytes.fromhex("16 050E FFF0 0000")
    assert bench.ask(stop) == stop


def test_m3_a_broadcast_stop_passes_with_a_position_in_its_frame() -> None:
    bench = StagedBench(staged_plan(command=(WIDE,)))
    bench.send(bytes.fromhex("10 050C 0003 06 0000 0000 03E8"), unit_id=0)
    bench.serve()
    assert bench.drive.moves[-1][0] == "stop"


def test_w4_a_recast_half_is_answered_in_its_own_form_whatever_the_drive_says() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.send(bytes.fromhex("06 0606 1234"))
    bench.serve_reads()
    bench.link.take()
    bench.line.reply(1, bytes.fromhex("10 0606 0000"), bench.now_ns)
    assert bench.port.take() == bytes.fromhex("86 04")


def test_w6_bytes_that_never_end_do_not_keep_the_line_for_ever() -> None:
    bench = StagedBench()
    bench.send(read(ACTUAL))
    bench.link.sent.clear()
    bench.wait(1000)
    bench.send(STOP_PDU)
    for _ in range(40):
        bench.line.stray(bench.now_ns)
        bench.wait(100)
    assert bench.link.sent == [(1, STOP_PDU)] * 2  # at once, and again when three silences have passed
    bench.serve()
    assert bench.drive.moves == [("stop", 0)] * 2


def test_m2_an_opcode_frame_that_is_too_short_passes_as_it_came() -> None:
    block = PositionField(0x00F7, RegisterType.INT32, WordOrder.HIGH_FIRST, block=0x00F5)
    bench = Bench(axis_plan(command=(block,), actual=()))
    bench.ask(bytes.fromhex("10 00F5 0004 08 0002 012C 0000 C350"))
    short = bytes.fromhex("10 00F5 0003 06 0002 012C 0001")
    bench.ask(short)
    assert bench.seen[-1] == short


def test_m2_what_passed_untouched_reads_back_as_it_was_written() -> None:
    mode = ModePlan(0x0605, actions={0: Action.ABSOLUTE}, is_in_frame=True)
    bench = Bench(axis_plan(motion=MotionPlan(modes=(mode,))))
    bench.ask(bytes.fromhex("10 0605 0003 06 0000") + COMMAND.pack(50_000))
    bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
    bench.ask(write(COMMAND, 33))
    assert bench.memory.get(COMMAND) == 33
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 33


def test_a11_the_reading_does_not_jump_at_a_reversal_although_the_last_one_is_old() -> None:
    bench = StagedBench()
    bench.go_to(50_000)
    bench.stage(80_000)
    bench.trigger()
    bench.drive.pass_by(51_000)
    bench.actual()
    bench.settle()  # the controller sees the done bit, and reads no position
    bench.stage(20_000)
    bench.trigger()
    assert bench.actual() == 80_000  # it has not moved yet
    bench.drive.pass_by(50_000)
    assert bench.actual() == 50_000  # half of the way: half of the 20 counts between the branches


def test_m4_a_repeat_whose_reply_was_lost_leaves_the_branch_as_it_is() -> None:
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.move(50_000)
    told = bench.seen[-1]
    bench.memory.put(ACTUAL, 50_025)  # 15 counts beside it, with 2 of hysteresis
    bench.send(write(COMMAND, 50_000))
    bench.link.sent.clear()
    bench.wait(1000)
    bench.port.take()
    bench.ask(write(COMMAND, 50_000))
    assert bench.seen[-1] == told


def test_m11_a_target_that_is_refused_at_its_trigger_keeps_the_other_axis_from_running() -> None:
    bench = gantry(travel=(0.0, 100.0))
    for unit_id, counts in ((1, 350_000), (2, 60_000)):
        ask(bench, unit_id, write(COMMAND, counts))
    assert ask(bench, 1, RUN_PDU) == bytes.fromhex("86 04")
    assert ask(bench, 2, RUN_PDU) == bytes.fromhex("86 04")
    assert bench.drive.moves == []


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


def test_m3_a_trigger_whose_mode_nobody_knows_does_not_run_what_was_left_from_before_a_lost_link() -> None:
    offset = make_table([0, 100], [0.05, 0.05], [0.05, 0.05], Units.MM)
    bench = StagedBench(staged_plan(table=offset, motion=sticky(), safe_read=False))
    bench.ask(bytes.fromhex("06 0700 0001"))
    bench.go_to(50_000)
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    bench.serve()
    assert bench.refused(RUN_PDU) == 4
