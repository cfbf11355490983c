"""Stops whose frame does more: it also runs, stages or sets something of another axis.

The table adds 10 counts to a position that is come to forward and takes 10 away backward.
"""

from dataclasses import replace

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming, Role
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange.connection_bench import ConnectionBench
from tests.exchange.line_bench import Port, read, write
from tests.exchange.staged_bench import DEEDS, STOP, STOP_PDU, TRIGGER, StagedBench, staged_plan

OTHER = PositionField(0x0700, RegisterType.INT32, WordOrder.LOW_FIRST)
OTHER_TRIGGER = 0x0608


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
    """Let a read of another controller time out: its answer may come yet."""
    bench.missed(STRANGE, 101, port=Port(ControllerPlan("plc", timeout_ms=100.0)))
    bench.seen.clear()


def serve_for(bench: StagedBench, ms: int) -> None:
    """Answer what comes, and let time pass."""
    for _ in range(ms // 10):
        bench.serve()
        bench.wait(10)


def test_a_stop_that_runs_a_distance_of_another_axis_leaves_once_after_the_silence() -> None:
    """W5, W6: 1000 of y would run twice if the frame left early and once more."""
    bench = side_by_side()
    bench.ask(write(OTHER, 1000))
    owe_silence(bench)
    bench.send(stop_beside(2))
    assert bench.link.sent == []
    serve_for(bench, 400)
    assert bench.seen == [stop_beside(2)]
    assert [pdu.hex() for _, _, pdu in bench.port.replies] == ["10050e0002"]


def test_a_stop_that_writes_nothing_for_another_axis_leaves_early_and_once_more() -> None:
    """M3, W6: y's trigger gets 0, which does nothing, once or twice; while late frames may come an echo of
    the address alone is no answer."""
    bench = side_by_side()
    owe_silence(bench)
    bench.send(stop_beside(0))
    assert bench.link.sent == [(1, stop_beside(0))]
    serve_for(bench, 400)
    assert bench.seen == [stop_beside(0), stop_beside(0)]


def test_a_stop_that_comes_after_a_run_beside_a_stop_ends_it() -> None:
    """M3: y's own stop goes at once, and once more behind the frame that runs y and waits for the silence."""
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
def test_on_a_new_connection_a_stop_leaves_twice_unless_it_runs_another_axis(stop: bytes, times: int) -> None:
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


def test_a_target_that_runs_beside_a_stop_with_words_that_are_not_right_is_flagged() -> None:
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


def test_a_target_that_runs_beside_a_stop_with_the_right_words_is_not_flagged() -> None:
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


def test_what_a_stop_of_another_controller_writes_for_an_axis_that_it_does_not_move_is_not_run() -> None:
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


def test_a_stop_that_writes_an_impossible_target_of_another_axis_passes_as_it_came() -> None:
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


def test_a_stop_that_runs_another_axis_does_not_leave_its_target_to_be_written_afterwards() -> None:
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
    """M3: trigger 1000 stops x and runs y, whose target its drive has refused."""
    runs = (TriggerPlan(TRIGGER, deeds={STOP: Operation(Action.ABSOLUTE), 0: Operation(Action.IGNORE)}),)
    y = next_plan(unit_id=2, motion=MotionPlan(is_staged=True, triggers=runs))
    bench = StagedBench(staged_plan(), y)
    bench.send(write(OTHER, 7000), unit_id=2)
    unit_id, _ = bench.link.sent.pop(0)
    bench.line.reply(unit_id, bytes.fromhex("90 03"), bench.now_ns)
    bench.send(STOP_PDU, unit_id=0)
    assert bench.link.sent == [(0, STOP_PDU)]
    assert bench.line.axes[1].is_unsure
