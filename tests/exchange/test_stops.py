"""Stops at any moment (M3): never refused, never withdrawn, before everything else."""

from dataclasses import replace

from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import ControllerPlan, Reference
from gateway.exchange.status import compensation_state, direction_state
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, read, write
from tests.exchange.staged_bench import (
    COMMANDED,
    DEEDS,
    JOG_PDU,
    ONLY_ABSOLUTE,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STOP,
    STOP_PDU,
    TRIGGER,
    ZERO_PDU,
    StagedBench,
    staged_plan,
)

READ_OTHER = bytes.fromhex("03 0800 0001")


def test_m3_a_waiting_stop_goes_out_although_its_serial_controller_went_on() -> None:
    bench = StagedBench()
    bench.go_to(50_000)
    bench.send(READ_OTHER, Port(ControllerPlan("hmi")))
    bench.send(STOP_PDU)
    bench.send(read(ACTUAL))  # the controller gave up waiting and polls
    bench.serve()
    assert bench.drive.moves[-1:] == [("stop", 50_010)]
    assert bench.port.take()[0] == 3  # and nobody answers a request that was given up


def test_m3_a_waiting_stop_goes_out_although_its_connection_closed() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(50_000)
    panel = Port(ControllerPlan("panel"))
    bench.send(READ_OTHER)
    bench.send(STOP_PDU, panel)
    bench.line.controller_gone(panel, bench.now_ns)
    bench.serve()
    assert bench.drive.moves[-1:] == [("stop", 50_010)]
    assert panel.replies == []


def test_m3_a_stop_that_waited_for_long_goes_out_all_the_same() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(50_000)
    bench.send(READ_OTHER)
    bench.send(STOP_PDU, Port(ControllerPlan("panel", timeout_ms=50)))
    bench.wait(400)
    bench.serve()
    assert bench.drive.moves[-1:] == [("stop", 50_010)]


def test_m3_a_stop_passes_where_everything_else_is_refused() -> None:
    bench = StagedBench(staged_plan(motion=ONLY_ABSOLUTE, travel=(0.0, 100.0)))
    bench.refused(write(COMMAND, 150_000))
    assert compensation_state(bench.line.axes[0]) == "blocked"
    bench.trigger(STOP_PDU)
    assert bench.refused(RUN_PDU) == 4


def test_m5_after_a_stop_the_same_target_again_is_a_move_from_where_the_axis_stands() -> None:
    bench = StagedBench()
    bench.go_to(10_000)
    bench.run(90_000)
    bench.drive.pass_by(95_000)  # overshot
    bench.trigger(STOP_PDU)
    bench.settle()
    assert bench.run(90_000) == ("absolute", 89_990)


def test_a_target_staged_before_homing_is_written_anew_before_it_runs() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.HOMING))
    bench.trigger(bytes.fromhex("06 050E 0064"))
    bench.stage(50_000)  # not referenced: it passes as it is
    assert bench.drive.get(COMMAND) == 50_000
    bench.drive.set_bits(is_done=True)
    bench.wait(500)
    bench.poll()
    assert bench.trigger() == ("absolute", 50_010)


def test_m6_after_a_stop_the_branch_is_still_known() -> None:
    # Standing at 50 000 by a backward move (49 990). A target 20 counts further back is told 49 990 on the
    # forward branch, where the axis stands already: it is backward all the same.
    bench = StagedBench()
    bench.go_to(80_000, 50_000)
    bench.trigger(STOP_PDU)
    bench.poll()
    assert bench.run(49_980) == ("absolute", 49_970)


def test_m7_one_lost_reply_is_no_silence() -> None:
    bench = StagedBench()
    bench.go_to(80_000, 50_000)
    bench.missed(write(COMMAND, 30_000), 1000)
    bench.wait(5000)
    assert bench.run(49_980) == ("absolute", 49_970)


def test_m3_a_stop_beside_a_target_waits_for_no_register_that_nobody_has_seen() -> None:
    """Whether the drive follows each position decides about the target in the frame, not about the stop."""
    stop = TriggerPlan(COMMAND.end, deeds={1: Operation(Action.STOP)}, otherwise=Action.IGNORE)
    follow = TriggerPlan(0x0800, deeds={1: Operation(Action.FOLLOW_NEXT)}, otherwise=Action.IGNORE)
    bench = StagedBench(staged_plan(motion=MotionPlan(is_staged=True, triggers=(stop, follow))))
    frame = bytes.fromhex("10 0606 0003 06") + COMMAND.pack(9_000) + b"\x00\x01"
    bench.send(frame)
    assert bench.link.take() == frame


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


def test_w7_a_trigger_to_another_name_of_the_unit_is_refused_and_a_stop_is_not() -> None:
    bench = StagedBench(serial=False, tcp_drive=True)
    bench.stage(50_000)
    for unit_id in (0, 255):
        assert bench.ask(RUN_PDU, unit_id=unit_id) == bytes.fromhex("86 0A")
        assert bench.ask(ZERO_PDU, unit_id=unit_id) == bytes.fromhex("86 0A")
        assert bench.ask(STOP_PDU, unit_id=unit_id) == STOP_PDU


def test_m3_a_stop_does_not_wait_for_the_frames_that_another_unit_needs() -> None:
    bench = StagedBench(staged_plan(), staged_plan(name="y", unit_id=2), serial=False)
    for unit_id in (1, 2):
        bench.ask(write(COMMAND, 50_000), unit_id=unit_id)
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


def test_m3_a_mask_that_certainly_clears_the_enable_bits_is_a_stop() -> None:
    bench = Bench(axis_plan(motion=CONTROL, travel=(0.0, 60.0)))
    bench.ask(write(COMMAND, 90_000))
    stop = bytes.fromhex("16 050E FFF0 0000")
    assert bench.ask(stop) == stop


WIDE = PositionField(0x050C, RegisterType.INT32, WordOrder.LOW_FIRST)


def test_m3_a_broadcast_stop_passes_with_a_position_in_its_frame() -> None:
    bench = StagedBench(staged_plan(command=(WIDE,)))
    bench.send(bytes.fromhex("10 050C 0003 06 0000 0000 03E8"), unit_id=0)
    bench.serve()
    assert bench.drive.moves[-1][0] == "stop"


def test_w6_bytes_that_never_end_do_not_keep_the_line_for_ever() -> None:
    bench = StagedBench()
    bench.missed(read(ACTUAL), 1000)
    bench.send(STOP_PDU)
    for _ in range(40):
        bench.line.stray(bench.now_ns)
        bench.wait(100)
    assert bench.link.sent == [(1, STOP_PDU)] * 2  # at once, and again when three silences have passed
    bench.serve()
    assert bench.drive.moves == [("stop", 0)] * 2


OTHER_TRIGGER = 0x0608


OTHER = PositionField(0x0700, RegisterType.INT32, WordOrder.LOW_FIRST)


def two_on_a_unit() -> StagedBench:
    """Two staged axes with one unit id; x stands at 80 000, where it was jogged, and 50 000 is staged."""
    y = replace(
        staged_plan(),
        name="y",
        command=(OTHER,),
        actual=(PositionField(0x0720, RegisterType.INT32, WordOrder.LOW_FIRST),),
        commanded=(),
        motion=MotionPlan(is_staged=True, triggers=(TriggerPlan(OTHER_TRIGGER, deeds=DEEDS),)),
        bits={},
    )
    bench = StagedBench(staged_plan(), y, serial=False)
    for counts in (-5000, 20_000):
        bench.run(counts)
        bench.wait(100)
        bench.drive.arrive()
        bench.wait(1200)
        bench.actual()
    bench.stage(50_000)
    bench.ask(JOG_PDU)
    for place in (ACTUAL, COMMANDED):
        bench.drive.put(place, 80_000)
    bench.drive.set_bits(is_done=True)
    bench.wait(2000)
    bench.actual()
    return bench


def test_a_stop_in_a_frame_with_a_newer_target_withdraws_the_trigger_of_the_older_one() -> None:
    """M2, M3: the trigger of 50 000 has its target on the wire, 49 990 for it comes backward, when a frame
    with 70 000 and a stop of y comes. The trigger is refused, and the next one runs 70 000: 69 990."""
    bench = two_on_a_unit()
    bench.seen.clear()
    bench.send(RUN_PDU, transaction_id=1)
    newer = bytes.fromhex("10 0606 0003 06") + COMMAND.pack(70_000) + STOP.to_bytes(2, "big")
    is_first = True
    while bench.link.sent:
        unit_id, pdu = bench.link.sent.pop(0)
        bench.seen.append(pdu)
        if is_first:
            bench.send(newer, transaction_id=2)
            is_first = False
        bench.now_ns += MS
        bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
    assert [pdu[:6].hex() for pdu in bench.seen if pdu[0] == 16] == ["100606000204", "100606000306"]
    assert bench.seen.count(RUN_PDU) == 0
    assert [(number, pdu.hex()) for number, _, pdu in bench.port.replies] == [(1, "8606"), (2, "1006060003")]
    bench.port.replies.clear()
    assert bench.trigger() == ("absolute", 69_990)


def test_what_was_read_for_a_target_before_a_stop_went_first_is_read_again() -> None:
    """M6: x goes to 100 000 and is read at 50 000 for 60 000. A stop of y takes its turn and 240 ms; by then
    x is at 98 000, so 60 000 is backward: 59 990."""
    y = replace(staged_plan(), name="y", unit_id=2)
    bench = Bench(axis_plan(max_speed=200.0), y, serial=False)
    bench.move(-5000, 0)
    bench.wait(100)
    bench.actual()
    bench.ask(write(COMMAND, 100_000))
    bench.wait(250)
    bench.memory.put(ACTUAL, 50_000)
    bench.send(write(COMMAND, 60_000))
    bench.line.request(Port(ControllerPlan("pendant")), 9, 2, STOP_PDU, bench.now_ns)
    unit_id, pdu = bench.link.sent.pop(0)
    assert pdu == read(ACTUAL)
    bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
    unit_id, pdu = bench.link.sent.pop(0)
    assert (unit_id, pdu) == (2, STOP_PDU)
    bench.now_ns += 240 * MS
    bench.memory.put(ACTUAL, 98_000)
    bench.line.reply(unit_id, pdu, bench.now_ns)
    bench.serve()
    assert bench.seen[-1] == write(COMMAND, 59_990)


CONTROL_WORD = 0x3100


BY_BITS = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(CONTROL_WORD, mask=0x0050, rising=0x10, deeds={0x10: Operation(Action.START)}),
        TriggerPlan(CONTROL_WORD, mask=0x010F, deeds={0x0F: Operation(Action.IGNORE)}, otherwise=Action.STOP),
    ),
)


def test_a_mask_that_clears_the_enable_bit_stops_whatever_the_other_bits_are() -> None:
    """M3: the control word is not known after a write that timed out, and the axis is blocked. AND 0xFFFE
    leaves bit 0 clear: no such word means anything but a stop."""
    bench = Bench(axis_plan(motion=BY_BITS), serial=False, tcp_drive=True)
    control = b"\x06" + CONTROL_WORD.to_bytes(2, "big")
    bench.ask(control + b"\x00\x0f")
    for lost in (write(COMMAND, 5000), control + b"\x00\x0f"):
        bench.unanswered(lost, 1001)
    bench.seen.clear()
    stop = bytes.fromhex("16 3100 FFFE 0000")
    assert bench.ask(stop) == stop
    assert bench.seen == [stop]


def test_an_axis_that_was_told_to_stay_and_is_seen_elsewhere_later_has_been_moved() -> None:
    """M4, M6: it stands at 1000 (1010), is stopped and sent there once more. Somebody jogs it to 3000. Seen
    there after a while, it is sent to 1000 once more: that is backward, 990, and certain."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(1000)
    bench.ask(STOP_PDU)
    bench.trigger()
    bench.drive.stand_at(3000)
    bench.wait(1200)
    bench.ask(read(ACTUAL))
    bench.trigger()
    assert bench.drive.moves == [("absolute", 1010), ("stop", 1010), ("absolute", 1010), ("absolute", 990)]
    assert direction_state(bench.line.axes[0]) == "backward"


def stopped_on_a_flagged_way() -> StagedBench:
    """It stands at 1000 (1010), and has not begun to go to -3000 (-3010) when 1000 comes: 990, flagged."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(1000)
    for target in (-3000, 1000):
        bench.run(target)
    assert direction_state(bench.line.axes[0]) == "unsure"
    bench.ask(STOP_PDU)
    return bench


def test_an_axis_that_was_stopped_on_a_way_whose_branch_was_assumed_stays_flagged() -> None:
    """M6: it reads 1020, so 1000 is backward still; but that branch was assumed, and 990 is not certain."""
    bench = stopped_on_a_flagged_way()
    bench.trigger()
    moves = [("absolute", 1010), ("absolute", -3010), ("absolute", 990), ("stop", 1010), ("absolute", 990)]
    assert bench.drive.moves == moves
    assert direction_state(bench.line.axes[0]) == "unsure"


def test_a_distance_from_a_way_whose_branch_was_assumed_is_flagged() -> None:
    """M5, M6: nobody knows whether 1010 is 1000 forward or 1020 backward."""
    bench = stopped_on_a_flagged_way()
    bench.wait(1200)
    bench.run(500, RUN_RELATIVE_PDU)
    assert direction_state(bench.line.axes[0]) == "unsure"
