"""Stops at any moment (M3): never refused, never withdrawn, before everything else."""

from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import ControllerPlan, Reference
from gateway.exchange.status import compensation_state
from tests.exchange.line_bench import ACTUAL, COMMAND, Port, read, write
from tests.exchange.staged_bench import (
    ONLY_ABSOLUTE,
    RUN_PDU,
    STOP_PDU,
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
    bench.stage(90_000)
    bench.trigger()
    bench.drive.pass_by(95_000)  # overshot
    bench.trigger(STOP_PDU)
    bench.settle()
    bench.stage(90_000)
    bench.trigger()
    assert bench.drive.moves[-1] == ("absolute", 89_990)


def test_a_target_staged_before_homing_is_written_anew_before_it_runs() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.HOMING))
    bench.trigger(bytes.fromhex("06 050E 0064"))
    bench.stage(50_000)  # not referenced: it passes as it is
    assert bench.drive.get(COMMAND) == 50_000
    bench.drive.set_bits(is_done=True)
    bench.wait(500)
    bench.poll()
    bench.trigger()
    assert bench.drive.moves[-1] == ("absolute", 50_010)


def test_m6_after_a_stop_the_branch_is_still_known() -> None:
    # Standing at 50 000 by a backward move (49 990). A target 20 counts further back is told 49 990 on the
    # forward branch, where the axis stands already: it is backward all the same.
    bench = StagedBench()
    bench.go_to(80_000)
    bench.go_to(50_000)
    bench.trigger(STOP_PDU)
    bench.poll()
    bench.stage(49_980)
    bench.trigger()
    assert bench.drive.moves[-1:] == [("absolute", 49_970)]


def test_m7_one_lost_reply_is_no_silence() -> None:
    bench = StagedBench()
    bench.go_to(80_000)
    bench.go_to(50_000)
    bench.send(write(COMMAND, 30_000))
    bench.link.sent.clear()
    bench.wait(1000)
    bench.wait(5000)
    bench.stage(49_980)
    bench.trigger()
    assert bench.drive.moves[-1:] == [("absolute", 49_970)]


def test_m3_a_stop_beside_a_target_waits_for_no_register_that_nobody_has_seen() -> None:
    """Whether the drive follows each position decides about the target in the frame, not about the stop."""
    stop = TriggerPlan(COMMAND.end, deeds={1: Operation(Action.STOP)}, otherwise=Action.IGNORE)
    follow = TriggerPlan(0x0800, deeds={1: Operation(Action.FOLLOW_NEXT)}, otherwise=Action.IGNORE)
    bench = StagedBench(staged_plan(motion=MotionPlan(is_staged=True, triggers=(stop, follow))))
    frame = bytes.fromhex("10 0606 0003 06") + COMMAND.pack(9_000) + b"\x00\x01"
    bench.send(frame)
    assert bench.link.take() == frame
