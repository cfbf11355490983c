"""Stops at any moment (M3): never refused, never withdrawn, before everything else.

Forward, the table adds 10 counts to a position; backward, it subtracts 10.
"""

from dataclasses import replace
from typing import Final

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.control import switch
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming, Reference, Role
from gateway.exchange.status import compensation_state, direction_state
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange.connection_bench import ConnectionBench
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, read, write
from tests.exchange.staged_bench import (
    COMMANDED,
    DEEDS,
    JOG_PDU,
    ONLY_ABSOLUTE,
    RUN,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STOP,
    STOP_PDU,
    TRIGGER,
    ZERO_PDU,
    StagedBench,
    staged_plan,
)
from tests.exchange.test_ownership import controller

READ_OTHER = bytes.fromhex("03 0800 0001")


def test_m3_a_waiting_stop_is_sent_although_its_serial_controller_sent_a_new_request() -> None:
    bench = StagedBench()
    bench.go_to(50_000)
    bench.send(READ_OTHER, Port(ControllerPlan("hmi")))
    bench.send(STOP_PDU)
    bench.send(read(ACTUAL))  # the controller gave up waiting and polls
    bench.serve()
    assert bench.drive.moves[-1:] == [("stop", 50_010)]
    assert bench.port.take()[0] == 3  # and nobody answers a request that was given up


def test_m3_a_waiting_stop_is_sent_although_its_connection_closed() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(50_000)
    panel = Port(ControllerPlan("panel"))
    bench.send(READ_OTHER)
    bench.send(STOP_PDU, panel)
    bench.line.controller_gone(panel, bench.now_ns)
    bench.serve()
    assert bench.drive.moves[-1:] == [("stop", 50_010)]
    assert panel.replies == []


def test_m3_a_stop_that_waited_for_long_is_sent_nevertheless() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(50_000)
    bench.send(READ_OTHER)
    bench.send(STOP_PDU, Port(ControllerPlan("panel", timeout_ms=50)))
    bench.wait(400)
    bench.serve()
    assert bench.drive.moves[-1:] == [("stop", 50_010)]


def test_m3_a_stop_is_sent_while_the_gateway_ends_and_nothing_else_is() -> None:
    bench = StagedBench(serial=False)
    bench.run(50_000)
    bench.send(READ_OTHER)  # on the wire when the gateway is told to end
    bench.line.stop(bench.now_ns)
    bench.send(RUN_PDU, transaction_id=8)
    bench.send(STOP_PDU, transaction_id=9)
    was_idle = bench.line.is_idle
    bench.seen.clear()
    bench.serve()
    assert bench.seen == [READ_OTHER, STOP_PDU]
    assert bench.port.replies.pop() == (9, 1, STOP_PDU)
    assert (was_idle, bench.line.is_idle) == (False, True)
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    assert bench.ask(STOP_PDU, operator) == STOP_PDU  # also on a free line


@pytest.mark.parametrize("is_end_read_with_it", [False, True])
def test_m3_a_stop_whose_controller_closes_waits_for_the_connection_to_the_drives(
    is_end_read_with_it: bool,
) -> None:
    bench = ConnectionBench(staged_plan(), connects_on_demand=True)
    bench.ask(write(COMMAND, 1_000))
    bench.ask(RUN_PDU)
    bench.peer_closes()
    why = "its controller closed the connection" if is_end_read_with_it else ""
    bench.line.request(bench.port, 5, 1, STOP_PDU, bench.now_ns, why_given_up=why)
    bench.line.controller_gone(bench.port, bench.now_ns)
    bench.until(20)
    assert STOP_PDU not in bench.seen
    bench.line.link_up(bench.now_ns)
    bench.serve()
    assert bench.seen.count(STOP_PDU) == 1


ALIASES: Final = (0, 255, 9)
"""Unit ids under which the drive of a Modbus/TCP line with one axis may answer too."""


@pytest.mark.parametrize("unit_id", ALIASES)
def test_m3_a_stop_under_another_name_of_the_drive_is_a_stop_of_its_axis(unit_id: int) -> None:
    bench = StagedBench(tcp_drive=True, serial=False)
    bench.go_to(20_000)
    bench.run(80_000)
    bench.drive.pass_by(30_000)
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    assert bench.ask(STOP_PDU, operator, unit_id=unit_id) == STOP_PDU
    assert bench.line.axes[0].motion.state is MotionState.STOPPED
    assert bench.line.axes[0].compensation.accepted is None


@pytest.mark.parametrize("unit_id", ALIASES)
def test_m3_a_stop_under_another_name_overtakes_and_withdraws_a_waiting_trigger(unit_id: int) -> None:
    bench = StagedBench(tcp_drive=True, serial=False)
    bench.go_to(20_000)
    bench.stage(80_000)
    bench.send(READ_OTHER, Port(ControllerPlan("panel")))
    bench.send(RUN_PDU, transaction_id=2)
    bench.send(STOP_PDU, unit_id=unit_id, transaction_id=3)
    bench.seen.clear()
    bench.serve()
    assert bench.seen == [READ_OTHER, STOP_PDU]
    assert bench.port.replies == [(2, 1, bytes.fromhex("86 06")), (3, unit_id, STOP_PDU)]


@pytest.mark.parametrize("reply", [STOP_PDU, bytes.fromhex("86 02")])
def test_m3_a_stop_that_may_reach_several_axes_gets_one_reply_and_proves_nothing(reply: bytes) -> None:
    x, y = (staged_plan(name=name, unit_id=unit_id) for name, unit_id in (("x", 1), ("y", 2)))
    bench = StagedBench(x, y, tcp_drive=True, serial=False)
    bench.go_to(20_000)
    bench.stage(60_000)
    bench.send(STOP_PDU, unit_id=255)
    assert bench.link.sent == [(255, STOP_PDU)]
    bench.link.sent.clear()
    bench.line.reply(255, reply, bench.now_ns)
    assert bench.port.replies == [(7, 255, reply)]
    bench.port.replies.clear()
    assert bench.trigger() == ("absolute", 60_010)  # another drive may have got the stop


@pytest.mark.parametrize("unit_id", ALIASES)
def test_w7_a_stop_under_another_name_writes_nothing_else(unit_id: int) -> None:
    bench = StagedBench(tcp_drive=True, serial=False)
    bench.go_to(20_000)
    bench.stage(60_000)
    bench.ask(bytes.fromhex("10 050E 0002 04 03E8 0000"), unit_id=unit_id)  # also the register behind it
    assert bench.line.axes[0].motion.state is MotionState.ARRIVED


@pytest.mark.parametrize("unit_id", ALIASES)
def test_w7_a_request_other_than_a_stop_does_not_reach_the_axis_under_another_name(unit_id: int) -> None:
    bench = StagedBench(tcp_drive=True, serial=False)
    bench.go_to(20_000)
    assert bench.ask(RUN_PDU, unit_id=unit_id) == bytes.fromhex("86 0A")
    bench.ask(bytes.fromhex("03 005C 0001"), unit_id=unit_id)
    assert bench.line.axes[0].motion.state is MotionState.ARRIVED


def test_m3_a_stop_passes_while_everything_else_is_refused() -> None:
    bench = StagedBench(staged_plan(motion=ONLY_ABSOLUTE, travel=(0.0, 100.0)))
    bench.refused(write(COMMAND, 150_000))
    assert compensation_state(bench.line.axes[0]) == "blocked"
    bench.trigger(STOP_PDU)
    assert bench.refused(RUN_PDU) == 4


def test_m3_an_axis_that_refuses_triggers_is_blocked_also_after_it_was_switched_off() -> None:
    bench = StagedBench(staged_plan(motion=ONLY_ABSOLUTE, travel=(0.0, 100.0)))
    bench.go_to(50_000)
    bench.refused(write(COMMAND, 150_000))
    switch(bench.line.axes, "x", is_on=False)
    assert compensation_state(bench.line.axes[0]) == "blocked"
    assert bench.refused(RUN_PDU) == 4
    bench.go_to(60_000)
    assert compensation_state(bench.line.axes[0]) == "off"


def test_m5_after_a_stop_the_same_target_again_is_a_move_from_where_the_axis_stands() -> None:
    bench = StagedBench()
    bench.go_to(10_000)
    bench.run(90_000)
    bench.drive.pass_by(95_000)  # overshot
    bench.trigger(STOP_PDU)
    bench.settle()
    assert bench.run(90_000) == ("absolute", 89_990)


def test_a_target_staged_before_homing_is_written_again_before_it_runs() -> None:
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


def test_m3_a_stop_beside_a_target_waits_for_no_read_of_an_unknown_register() -> None:
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


SERVO_COIL = MotionPlan(
    triggers=(
        *CONTROL.triggers,
        TriggerPlan(0x19, is_coil=True, deeds={0: Operation(Action.STOP), 1: Operation(Action.IGNORE)}),
    ),
)
"""The same drive with a coil that switches its servo on and off."""
SERVO_ON = bytes.fromhex("05 0019 FF00")
SERVO_OFF = bytes.fromhex("05 0019 0000")


def stopped_on_a_busy_line(older: bytes, stop: bytes, panel: Port | None = None) -> Bench:
    """Return a bench on which a request and then a stop waited: the stop was sent first."""
    bench = Bench(axis_plan(motion=SERVO_COIL), serial=False)
    bench.send(READ_OTHER, Port(ControllerPlan("hmi")))  # on the wire
    bench.send(older, transaction_id=8)
    bench.send(stop, panel or bench.port, transaction_id=9)
    bench.seen.clear()
    bench.serve()
    assert bench.seen[:2] == [READ_OTHER, stop]
    return bench


@pytest.mark.parametrize(
    ("older", "stop"),
    [
        (control(0x0F), control(0x06)),
        (bytes.fromhex("10 050D 0002 04 0000 000F"), control(0x06)),
        (bytes.fromhex("16 050E 0000 000F"), control(0x06)),
        (bytes.fromhex("06 050D 0001"), bytes.fromhex("10 050D 0002 04 0002 0006")),
        (SERVO_ON, SERVO_OFF),
        (bytes.fromhex("0F 0018 0003 01 02"), SERVO_OFF),
    ],
    ids=["register", "registers", "mask", "register beside the control word", "coil", "coils"],
)
@pytest.mark.parametrize("is_panel", [False, True], ids=["same controller", "operator"])
def test_m3_an_older_value_of_what_a_stop_has_written_is_withdrawn(
    older: bytes, stop: bytes, *, is_panel: bool
) -> None:
    """Behind the stop it would switch the servo on again, or let the axis go on to its target."""
    panel = Port(ControllerPlan("panel", role=Role.OPERATOR)) if is_panel else None
    bench = stopped_on_a_busy_line(older, stop, panel)
    assert bench.seen == [READ_OTHER, stop]
    assert (8, 1, bytes((older[0] | 0x80, 6))) in bench.port.replies
    bench.send(older, transaction_id=10)  # after the stop its controller may still want it
    bench.serve()
    assert bench.seen == [READ_OTHER, stop, older]


@pytest.mark.parametrize(
    "other",
    [bytes.fromhex("06 050D 0001"), bytes.fromhex("06 050F 0001"), SERVO_ON],
    ids=lambda o: o.hex(" "),
)
def test_m3_what_a_stop_has_not_written_is_sent_behind_it(other: bytes) -> None:
    bench = stopped_on_a_busy_line(other, control(0x06))
    assert bench.seen == [READ_OTHER, control(0x06), other]


def test_m3_the_release_of_a_coil_is_sent_behind_a_stop_of_another_unit() -> None:
    bench = Bench(
        axis_plan(motion=SERVO_COIL),
        axis_plan(name="y", unit_id=2, motion=SERVO_COIL),
        serial=False,
    )
    bench.send(READ_OTHER, Port(ControllerPlan("hmi")))
    bench.send(SERVO_ON, transaction_id=8)
    bench.send(SERVO_OFF, transaction_id=9, unit_id=2)
    bench.seen.clear()
    bench.serve()
    assert bench.seen == [READ_OTHER, SERVO_OFF, SERVO_ON]


def test_m3_the_release_of_a_jog_of_another_axis_is_sent_behind_a_stop() -> None:
    """One frame writes the jog coils of two axes; a stop of the first does not keep the second going."""
    plans = []
    for number, name in enumerate("xy"):
        jog = {1: Operation(Action.OTHER_MOTION), 0: Operation(Action.IGNORE)}
        off = {0: Operation(Action.STOP), 1: Operation(Action.IGNORE)}
        coils = (
            TriggerPlan(0x20 + number, is_coil=True, deeds=jog),
            TriggerPlan(0x10 + number, is_coil=True, deeds=off),
        )
        command = PositionField(0x0606 + 2 * number, RegisterType.INT32, WordOrder.LOW_FIRST)
        plans.append(axis_plan(name=name, command=(command,), actual=(), motion=MotionPlan(triggers=coils)))
    bench = Bench(*plans, serial=False)
    bench.ask(bytes.fromhex("05 0021 FF00"))  # y jogs
    release = bytes.fromhex("0F 0010 0012 03 03 00 00")  # both servos stay on, no coil jogs
    servo_off = bytes.fromhex("05 0010 0000")
    bench.send(READ_OTHER, Port(ControllerPlan("hmi")))
    bench.send(release, transaction_id=8)
    bench.send(servo_off, Port(ControllerPlan("panel", role=Role.OPERATOR)), transaction_id=9)
    bench.seen.clear()
    bench.serve()
    assert bench.seen == [READ_OTHER, servo_off, release]


def test_m3_an_older_stop_that_is_sent_once_more_does_not_undo_a_newer_one() -> None:
    """Halt keeps the servo on. It is sent once more after servo off, so that is sent once more too."""
    halt, servo_off = control(0x010F), control(0x0006)
    motion = MotionPlan(
        triggers=(
            TriggerPlan(TRIGGER, mask=0x010F, deeds={0x0F: Operation(Action.IGNORE)}, otherwise=Action.STOP),
        )
    )
    bench = Bench(axis_plan(motion=motion), serial=False, timing=LineTiming(response_timeout_ms=200.0))
    panel = Port(ControllerPlan("panel", role=Role.OPERATOR))
    bench.send(READ_OTHER)
    bench.link.sent.clear()
    bench.wait(1_000)  # no answer: a late one may come
    bench.send(halt, panel)
    assert bench.link.sent == [(1, halt)]
    bench.link.sent.clear()  # its reply is lost
    bench.send(servo_off)
    bench.seen.clear()
    for _ in range(150):
        bench.wait(20)
        bench.serve()
    assert bench.seen == [servo_off, halt, servo_off]
    assert bench.port.replies[-1][2] == servo_off
    assert panel.replies[-1][2] == halt


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


def test_m3_a_stop_does_not_wait_for_added_frames_of_another_unit() -> None:
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


def test_m3_stops_whose_controllers_have_given_up_do_not_accumulate() -> None:
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


def test_w6_bytes_that_never_end_do_not_block_the_line_for_ever() -> None:
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


def test_a_prerequisite_of_a_target_is_read_again_if_a_stop_is_sent_first() -> None:
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


def test_an_axis_seen_elsewhere_after_a_target_at_its_position_was_moved() -> None:
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


# === frames that do more: they also run, stage or set something of another axis ==========================


# --- a frame that stops one axis and acts on another one ----------------------------------------------------

NEXT_TRIGGER = TRIGGER + 1
NEXT_ACTUAL = PositionField(0x0720, RegisterType.INT32, WordOrder.LOW_FIRST)
NEXT_STATUS = 0x005D
NEXT_RUN_PDU, NEXT_STOP_PDU = bytes.fromhex("06 050F 0001"), bytes.fromhex("06 050F 03E8")
STRANGE = bytes.fromhex("03 0900 0001")


def stop_beside(word: int) -> bytes:
    """FC16 that stops x and writes a word into the trigger of y, the register behind."""
    return bytes.fromhex("10 050E 0002 04 03E8") + word.to_bytes(2, "big")


def next_plan(**changes: object) -> AxisPlan:
    """Return the plan of y, whose trigger is the register behind that of x; 2 runs a distance."""
    deeds = {**DEEDS, 2: Operation(Action.RELATIVE)}
    plan: dict[str, object] = {
        "name": "y",
        "command": (OTHER,),
        "actual": (NEXT_ACTUAL,),
        "commanded": (),
        "motion": MotionPlan(is_staged=True, triggers=(TriggerPlan(NEXT_TRIGGER, deeds=deeds),)),
        "bits": {"done": BitField(NEXT_STATUS, 4)},
    }
    return replace(staged_plan(), **(plan | changes))  # type: ignore[arg-type]


def arrive_next(bench: StagedBench, counts: float | None = None) -> None:
    """Let y come to its target, or to ``counts``, and its controller see it."""
    bench.memory.put(NEXT_ACTUAL, bench.memory.get(OTHER) if counts is None else counts)
    bench.memory.words[NEXT_STATUS] = 16
    bench.wait(1200)
    bench.ask(bytes.fromhex("03 005D 0001"))
    bench.ask(read(NEXT_ACTUAL))


def run_next(bench: StagedBench, counts: float) -> float:
    """Stage and run a target of y; return where it goes."""
    bench.ask(write(OTHER, counts))
    bench.ask(NEXT_RUN_PDU)
    return bench.memory.get(OTHER)


def side_by_side(**changes: object) -> StagedBench:
    """Two axes whose triggers lie side by side, on a serial line that is asked over TCP; y stands at 5010."""
    timing = LineTiming(response_timeout_ms=100.0, drain_ms=50.0, retry_ms=200.0)
    bench = StagedBench(staged_plan(), next_plan(**changes), serial=False, timing=timing)
    bench.port = Port(ControllerPlan("cnc", timeout_ms=5000.0))
    for counts in (0, 5000):
        run_next(bench, counts)
        arrive_next(bench)
    return bench


def owe_silence(bench: StagedBench) -> None:
    """Let a read of another controller time out: its answer may still come."""
    bench.missed(STRANGE, 101, port=Port(ControllerPlan("plc", timeout_ms=100.0)))
    bench.seen.clear()


def serve_for(bench: StagedBench, ms: int) -> None:
    """Answer the sent requests, and let time pass."""
    for _ in range(ms // 10):
        bench.serve()
        bench.wait(10)


def test_a_stop_that_runs_a_distance_of_another_axis_is_sent_once_after_the_silence() -> None:
    """W5, W6: 1000 of y would run twice if the frame left early and once more."""
    bench = side_by_side()
    bench.ask(write(OTHER, 1000))
    owe_silence(bench)
    bench.send(stop_beside(2))
    assert bench.link.sent == []
    serve_for(bench, 400)
    assert bench.seen == [stop_beside(2)]
    assert [pdu.hex() for _, _, pdu in bench.port.replies] == ["10050e0002"]


def test_a_stop_that_does_nothing_to_another_axis_is_sent_early_and_once_more() -> None:
    """M3, W6: y's trigger gets 0, which does nothing, once or twice; while late frames may come an echo of
    the address alone is no answer."""
    bench = side_by_side()
    owe_silence(bench)
    bench.send(stop_beside(0))
    assert bench.link.sent == [(1, stop_beside(0))]
    serve_for(bench, 400)
    assert bench.seen == [stop_beside(0), stop_beside(0)]


def test_m3_a_target_in_a_stop_that_was_sent_early_is_lost_until_that_is_answered() -> None:
    place = replace(COMMAND, address=TRIGGER + 1)
    bench = StagedBench(staged_plan(motion=ONLY_ABSOLUTE, command=(place,)))
    bench.ask(write(place, 50_000))
    bench.unanswered(READ_OTHER, 1_001)
    stop = bytes.fromhex("10 050E 0003 06 03E8") + place.pack(60_000)
    bench.missed(stop, 1_001)
    assert bench.kinds()[-1] == "axis-blocked"
    bench.wait(1_001)  # the silence, after which it is sent once more
    assert bench.link.sent == [(1, stop)]
    bench.serve()
    assert bench.kinds()[-1] == "axis-released"


def test_a_stop_after_a_frame_that_runs_its_axis_is_sent_immediately_and_after_that_frame() -> None:
    """M3: y's own stop is sent immediately, and once more after the frame that runs y and waits for the
    silence."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    owe_silence(bench)
    bench.send(stop_beside(1), transaction_id=8)
    bench.send(NEXT_STOP_PDU, transaction_id=9)
    serve_for(bench, 600)
    assert bench.seen == [NEXT_STOP_PDU, stop_beside(1), NEXT_STOP_PDU]
    replies = [(number, pdu.hex()) for number, _, pdu in bench.port.replies]
    assert replies == [(8, "10050e0002"), (9, "06050f03e8")]


def test_a_stop_of_another_axis_is_answered_before_one_that_waits_for_the_silence() -> None:
    plans = (staged_plan(), next_plan(), staged_plan(name="z", unit_id=2))
    timing = LineTiming(response_timeout_ms=100.0, drain_ms=50.0, retry_ms=200.0)
    bench = StagedBench(*plans, serial=False, timing=timing)
    owe_silence(bench)
    bench.send(stop_beside(1))
    panel = Port(ControllerPlan("panel", timeout_ms=5000.0))
    bench.send(STOP_PDU, panel, unit_id=2)
    assert bench.link.sent == [(2, STOP_PDU)]
    bench.line.reply(2, STOP_PDU, bench.now_ns)
    assert panel.take() == STOP_PDU


@pytest.mark.parametrize(("stop", "times"), [(STOP_PDU, 2), (stop_beside(1), 1)])
def test_on_a_new_connection_a_stop_is_sent_twice_unless_it_runs_another_axis(
    stop: bytes, times: int
) -> None:
    """A write without an answer may be executed behind the first one (W5)."""
    bench = ConnectionBench(staged_plan(lost_ms=700.0), next_plan(lost_ms=700.0), retry_ms=0.0)
    for _ in range(3):
        bench.send(write(OTHER, 5_000), Port(ControllerPlan("cnc", timeout_ms=200.0)))
        bench.link.sent.clear()
        bench.until(200)
    bench.returns(20, 201)
    bench.send(stop)
    for _ in range(2):
        bench.serve()
        bench.until(700)
    assert bench.seen.count(stop) == times


def test_stops_on_a_busy_line_keep_their_order_whatever_else_they_do() -> None:
    """M3: a frame that stops x and runs y waits, and a stop of y comes: y is stopped last."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    bench.seen.clear()
    bench.send(STRANGE, transaction_id=7)
    bench.send(stop_beside(1), transaction_id=8)
    bench.send(NEXT_STOP_PDU, transaction_id=9)
    bench.serve()
    assert bench.seen == [STRANGE, stop_beside(1), NEXT_STOP_PDU]
    assert [number for number, _, _ in bench.port.replies] == [7, 8, 9]


def test_an_operator_sets_no_mode_of_another_axis_beside_a_stop_and_takes_nothing_over() -> None:
    """W10: x's trigger and y's mode register lie side by side. The writer of y goes on: 6000 runs as 6010."""
    modes = (ModePlan(NEXT_TRIGGER, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE}),)
    runs = (TriggerPlan(OTHER_TRIGGER, deeds={1: Operation(Action.START), 0: Operation(Action.IGNORE)}),)
    y = next_plan(motion=MotionPlan(is_staged=True, modes=modes, triggers=runs))
    bench = StagedBench(staged_plan(), y, serial=False)
    run_pdu = bytes.fromhex("06 0608 0001")
    bench.ask(NEXT_RUN_PDU)
    for counts in (1000, 5000):
        bench.ask(write(OTHER, counts))
        bench.ask(run_pdu)
        arrive_next(bench)
    bench.wait(6000)
    bench.seen.clear()
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    bench.send(stop_beside(2), port=operator)
    bench.serve()
    assert bench.seen == []
    assert [pdu.hex() for _, _, pdu in operator.replies] == ["9001"]
    bench.ask(write(OTHER, 6000))
    bench.ask(run_pdu)
    assert bench.memory.get(OTHER) == 6010
    assert bench.seen[-1] == run_pdu


def test_an_operator_that_stops_one_axis_and_leaves_the_other_alone_takes_nothing_over() -> None:
    """M3, W10: x is stopped and y's trigger gets 0, while y is held and when it is not any more: its writer
    may run what it wrote."""
    bench = side_by_side()
    bench.ask(write(OTHER, 6000))
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    for wait_ms in (0, 6000):
        bench.wait(wait_ms)
        bench.seen.clear()
        bench.send(stop_beside(0), port=operator)
        bench.serve()
        assert bench.seen == [stop_beside(0)]
    bench.ask(NEXT_RUN_PDU)
    assert bench.memory.get(OTHER) == 6010
    assert bench.seen[-1] == NEXT_RUN_PDU


def test_a_target_run_beside_a_stop_with_wrong_words_is_flagged() -> None:
    """M2, M3: 7000 of y was staged as 7010 on its way from 5000 to 10 000. From there it is 6990, but a stop
    waits for no other frame: y runs 7010 and its branch is flagged, until the next target: 2000 is 1990."""
    bench = side_by_side()
    run_next(bench, 10_000)
    bench.ask(write(OTHER, 7000))
    before = bench.memory.get(OTHER)
    arrive_next(bench, 10_010)
    bench.seen.clear()
    assert bench.ask(stop_beside(1)) == stop_beside(1)[:5]
    assert bench.seen == [stop_beside(1)]
    assert bench.memory.get(OTHER) == before == 7010
    y = bench.line.axes[1]
    assert y.is_unsure
    assert bench.kinds()[-1] == "direction-unsure"
    arrive_next(bench)
    assert run_next(bench, 2000) == 1990
    assert not y.is_unsure


def test_a_target_run_beside_a_stop_with_the_right_words_is_not_flagged() -> None:
    """M2, M3: 9000 of y stands in the drive as 9010, for it goes forward: nothing has to be written."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    assert bench.frames(stop_beside(1)) == [stop_beside(1)]
    y = bench.line.axes[1]
    assert not y.is_unsure
    arrive_next(bench)
    assert bench.ask(read(NEXT_ACTUAL)) == b"\x03\x04" + OTHER.pack(9000)
    assert run_next(bench, 8000) == 7990


def test_a_stop_passes_although_it_runs_another_axis_whose_target_was_refused() -> None:
    """M3: the drive refused 7000 of y. x is stopped; y runs what it has, is flagged, and stays blocked."""
    bench = side_by_side()
    bench.send(write(OTHER, 7000))
    bench.answers(bytes.fromhex("90 03"))
    bench.port.replies.clear()
    bench.seen.clear()
    assert bench.ask(stop_beside(1)) == stop_beside(1)[:5]
    assert bench.seen == [stop_beside(1)]
    assert bench.line.axes[1].is_unsure
    assert bench.ask(NEXT_RUN_PDU) == bytes.fromhex("86 03")


def test_a_stop_passes_although_it_runs_another_axis_that_another_controller_holds() -> None:
    """M3, W10: the second controller's stop of x runs y's 9000, which is right as it stands. It takes nothing
    over: its own trigger of y is refused, and the first one goes on: 8000 is 7990."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    bench.seen.clear()
    other = Port(ControllerPlan("plc"))
    for pdu, reply in ((stop_beside(1), stop_beside(1)[:5]), (NEXT_RUN_PDU, b"\x86\x06")):
        bench.send(pdu, port=other)
        bench.serve()
        assert other.replies[-1][2] == reply
    assert bench.seen == [stop_beside(1)]
    arrive_next(bench)
    assert run_next(bench, 8000) == 7990


def test_a_target_that_a_stop_of_another_controller_writes_for_another_axis_is_not_run() -> None:
    """M3, W10: x's trigger lies before y's position. The second controller stops x and writes 3000 for y,
    2990 backward; the trigger of y's writer is refused until it has written its own again."""
    field = PositionField(NEXT_TRIGGER, RegisterType.INT32, WordOrder.LOW_FIRST)
    runs = (TriggerPlan(OTHER_TRIGGER, deeds={1: Operation(Action.ABSOLUTE), 0: Operation(Action.IGNORE)}),)
    y = next_plan(command=(field,), motion=MotionPlan(is_staged=True, triggers=runs))
    bench = StagedBench(staged_plan(), y, serial=False)
    run_pdu = bytes.fromhex("06 0608 0001")
    for counts in (0, 5000):
        bench.ask(write(field, counts))
        bench.ask(run_pdu)
        arrive_next(bench, bench.memory.get(field))
    bench.ask(write(field, 6000))
    bench.seen.clear()
    other = Port(ControllerPlan("plc"))
    bench.send(bytes.fromhex("10 050E 0003 06 03E8") + field.pack(3000), port=other)
    bench.serve()
    assert bench.seen == [bytes.fromhex("10 050E 0003 06 03E8") + field.pack(2990)]
    assert [pdu.hex() for _, _, pdu in other.replies] == ["10050e0003"]
    assert bench.ask(run_pdu) == b"\x86\x06"
    bench.ask(write(field, 6000))
    assert bench.ask(run_pdu) == run_pdu
    assert bench.memory.get(field) == 6010


def test_a_stop_that_writes_an_impossible_target_of_another_axis_passes_unchanged() -> None:
    """M3, M8: y goes to each position at once, and 2147483647 would not fit corrected. x is stopped, y goes
    there uncorrected and is flagged."""
    field = PositionField(NEXT_TRIGGER, RegisterType.INT32, WordOrder.LOW_FIRST)
    y = next_plan(command=(field,), motion=MotionPlan())
    bench = StagedBench(staged_plan(), y, serial=False)
    for counts in (0, 5000):
        bench.ask(write(field, counts))
        arrive_next(bench, bench.memory.get(field))
    bench.seen.clear()
    pdu = bytes.fromhex("10 050E 0003 06 03E8") + field.pack(2_147_483_647)
    assert bench.ask(pdu) == pdu[:5]
    assert bench.seen == [pdu]
    assert bench.line.axes[1].is_unsure


def test_a_stop_that_runs_another_axis_refuses_its_waiting_target() -> None:
    """M3: 9000 of y waits as the frame comes that stops x and runs y. The stop goes first and y runs what it
    has, 5010; so 9000 is refused, y is flagged, and its next trigger is refused."""
    bench = side_by_side()
    bench.seen.clear()
    bench.send(STRANGE, transaction_id=7)
    bench.send(write(OTHER, 9000), transaction_id=8)
    bench.send(stop_beside(1), transaction_id=9)
    bench.serve()
    assert bench.seen == [STRANGE, stop_beside(1)]
    replies = {number: pdu.hex() for number, _, pdu in bench.port.replies}
    assert (replies[8], replies[9]) == ("9006", "10050e0002")
    bench.port.replies.clear()
    assert bench.line.axes[1].is_unsure
    assert bench.ask(NEXT_RUN_PDU) == b"\x86\x06"


def test_a_broadcast_that_stops_one_drive_and_runs_a_blocked_one_reaches_both() -> None:
    """M3: trigger 1000 stops x and runs y, whose drive has refused its target."""
    runs = (TriggerPlan(TRIGGER, deeds={STOP: Operation(Action.ABSOLUTE), 0: Operation(Action.IGNORE)}),)
    y = next_plan(unit_id=2, motion=MotionPlan(is_staged=True, triggers=runs))
    bench = StagedBench(staged_plan(), y)
    bench.send(write(OTHER, 7000), unit_id=2)
    unit_id, _ = bench.link.sent.pop(0)
    bench.line.reply(unit_id, bytes.fromhex("90 03"), bench.now_ns)
    bench.send(STOP_PDU, unit_id=0)
    assert bench.link.sent == [(0, STOP_PDU)]
    assert bench.line.axes[1].is_unsure


# === a broadcast stop that another drive takes for a target ==============================================
OTHER_ACTUAL = PositionField(0x0710, RegisterType.INT32, WordOrder.LOW_FIRST)


def test_m3_a_drive_that_takes_a_stop_for_a_target_keeps_its_writer_and_its_words() -> None:
    """Low word first: 4000 is 0FA0 0000, 9000 is 2328 0000; 9216 + 10 counts of correction is 240A 0000."""
    motion = MotionPlan(is_staged=True, triggers=(TriggerPlan(OTHER_TRIGGER, deeds=DEEDS),))
    staged = replace(axis_plan(name="y", unit_id=2, command=(OTHER,), actual=(OTHER_ACTUAL,)), motion=motion)
    bench = Bench(axis_plan(name="x", unit_id=1), staged)
    cnc, panel = controller("cnc"), controller("panel")

    def ask(port: object, pdu: str, unit_id: int = 1) -> None:
        bench.send(bytes.fromhex(pdu), port, unit_id)  # type: ignore[arg-type]
        bench.serve()
        bench.wait(1000)
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))

    ask(cnc, "10 0606 0002 04 0FA0 0000")
    ask(cnc, "03 0520 0002")
    ask(panel, f"10 0606 0003 06 2328 0000 {STOP:04X}", 0)
    cnc.replies.clear()
    ask(cnc, "06 0606 2400")
    assert [pdu.hex(" ") for _, _, pdu in cnc.replies] == ["06 06 06 24 00"]
    assert bench.seen[-1] == bytes.fromhex("10 0606 0002 04 240A 0000")
    assert bench.line.axes[0].hold.writer == "cnc"


def test_m3_a_stop_in_a_frame_that_cuts_a_position_in_its_read_reaches_the_drive() -> None:
    """FC23 reads 125 registers from the second one of the position on: with the first they are too many."""
    bench = StagedBench()
    bench.go_to(50_000)
    bench.run(20_000)
    span = (ACTUAL.address + 1).to_bytes(2, "big") + (125).to_bytes(2, "big")
    stop, run = (
        b"\x17" + span + TRIGGER.to_bytes(2, "big") + b"\x00\x01\x02" + value.to_bytes(2, "big")
        for value in (STOP, RUN)
    )
    assert bench.ask(run) == bytes.fromhex("97 02")
    moves, told = len(bench.drive.moves), bench.kinds().count("refused-value")
    refused = bench.line.counters.refused
    assert bench.ask(stop) == bytes.fromhex("97 02")  # which says nothing of what was written
    assert bench.line.counters.refused == refused + 1
    assert bench.kinds().count("refused-value") == told + 1
    assert bench.seen[-1] == stop
    assert [kind for kind, _ in bench.drive.moves[moves:]] == ["stop"]
    assert bench.line.axes[0].motion.state is MotionState.STOPPED
