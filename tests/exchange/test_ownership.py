"""One writer at a time for each axis (W10): its hold, refusals, and the state after a take-over."""

from dataclasses import replace

import pytest

from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import CompensationMode, ControllerPlan, Role
from gateway.exchange.status import axis_status, compensation_state
from gateway.modbus.registers import PositionField
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, read, write
from tests.exchange.staged_bench import (
    DEEDS,
    HOME_PDU,
    JOG_PDU,
    MODE,
    RUN_PDU,
    STAGED,
    STOP,
    STOP_PDU,
    TRIGGER,
    ZERO_PDU,
    StagedBench,
    StagedDrive,
    staged_plan,
    sticky,
)

HOLD_MS = 5_000.0
"""The default of ``writer_hold_s``."""
MODE_RELATIVE = bytes.fromhex("06 0700 0002")
MODE_ABSOLUTE = bytes.fromhex("06 0700 0001")


def controller(name: str, peer: str = "", role: Role = Role.MOTION) -> Port:
    port = Port(ControllerPlan(name, role))
    port.peer, port.writer = peer, f"{name} ({peer})" if peer else name
    return port


def refusal(pdu: bytes) -> bytes:
    return bytes((pdu[0] | 0x80, 6))


def move(bench: Bench, port: Port, counts: float, *, runs: bool = False) -> None:
    """Write a target, and run it."""
    assert bench.ask(write(COMMAND, counts), port) == write(COMMAND, counts)[:5]
    if runs:
        assert bench.ask(RUN_PDU, port) == RUN_PDU


def writer(bench: Bench, number: int = 0) -> str | None:
    found = axis_status(bench.line.axes[number], bench.now_ns).writer
    assert found is None or isinstance(found, str)
    return found


@pytest.mark.parametrize(
    "pdu",
    [
        write(COMMAND, 7_000),
        bytes.fromhex("06 0606 0001"),
        bytes.fromhex("16 0606 0000 0001"),
        bytes.fromhex("17 0520 0002 0606 0002 04 0000 0000"),
        RUN_PDU,
        JOG_PDU,
        HOME_PDU,
        ZERO_PDU,
        bytes.fromhex("06 050E 0000"),
    ],
)
def test_w10_another_controller_moves_nothing_of_an_axis_that_is_held(pdu: bytes) -> None:
    bench = StagedBench(staged_plan(), serial=False)
    cnc, panel = controller("cnc", "10.0.0.1"), controller("panel", "10.0.0.2")
    move(bench, cnc, 50_000, runs=True)
    seen, moves = len(bench.seen), list(bench.drive.moves)
    bench.wait(HOLD_MS - 10)
    assert bench.ask(pdu, panel) == refusal(pdu)
    assert (len(bench.seen), bench.drive.moves) == (seen, moves)
    assert writer(bench) == "cnc (10.0.0.1)"
    assert bench.line.counters.refused_by == {"panel": 1}
    [event] = [event for event in bench.events if event.kind.name == "second-writer"]
    assert (event.axis, event.detail) == ("x", "panel (10.0.0.2) was refused: cnc (10.0.0.1) moves it")
    assert dict(event.more) == {
        "holder": "cnc (10.0.0.1)",
        "controller": "panel",
        "peer": "10.0.0.2",
        "function_code": pdu[0],
        "unit_id": 1,
    }
    # The one who holds it goes on as if nothing had been.
    assert compensation_state(bench.line.axes[0]) == "active"
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU


def test_w10_each_host_on_a_listener_is_one_writer_with_all_its_connections() -> None:
    bench = Bench(axis_plan())
    first, second = controller("cnc", "10.0.0.1"), controller("cnc", "10.0.0.1")
    other = controller("cnc", "10.0.0.2")
    move(bench, first, 1_000)
    move(bench, second, 2_000)
    assert bench.ask(write(COMMAND, 3_000), other) == refusal(write(COMMAND, 3_000))
    assert bench.memory.get(COMMAND) in (2_000, 2_010)


def test_w10_any_controller_may_read_and_write_what_moves_nothing() -> None:
    bench = StagedBench(staged_plan())
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 1_000)
    assert bench.ask(read(ACTUAL), panel)[0] == 3
    assert bench.ask(bytes.fromhex("06 1000 0001"), panel) == bytes.fromhex("06 1000 0001")
    assert bench.ask(bytes.fromhex("06 1000 0001"), panel, 2) == bytes.fromhex("06 1000 0001")
    assert writer(bench) == "cnc"


def test_w10_a_stop_of_another_controller_passes_and_takes_nothing_over() -> None:
    bench = StagedBench(staged_plan())
    cnc, panel = controller("cnc"), controller("panel")
    operator = controller("pendant", role=Role.OPERATOR)
    move(bench, cnc, 5_000, runs=True)
    for port in (panel, operator):
        assert bench.ask(STOP_PDU, port) == STOP_PDU
    assert [kind for kind, _ in bench.drive.moves] == ["absolute", "stop", "stop"]
    assert writer(bench) == "cnc"
    assert bench.ask(JOG_PDU, panel) == refusal(JOG_PDU)


def test_w10_the_hold_ends_writer_hold_s_after_the_last_move() -> None:
    bench = Bench(axis_plan(writer_hold_s=2.0))
    cnc, panel = controller("cnc"), controller("panel")
    for counts in (1_000, 2_000, 3_000):  # the first goes the slow path, the others the fast one
        move(bench, cnc, counts)
        bench.wait(1_900)
    assert bench.ask(write(COMMAND, 9_000), panel) == refusal(write(COMMAND, 9_000))
    bench.wait(110)
    assert writer(bench) is None
    move(bench, panel, 4_000)
    assert writer(bench) == "panel"
    assert bench.ask(write(COMMAND, 5_000), cnc) == refusal(write(COMMAND, 5_000))
    # A read of the one who holds it is no move.
    bench.wait(1_500)
    assert bench.ask(read(ACTUAL), panel)[0] == 3
    bench.wait(600)
    move(bench, cnc, 5_000)


def test_w10_an_idle_write_takes_no_axis_over() -> None:
    """An alarm reset of a panel, or the release of a trigger, moves nothing and prepares nothing."""
    bench = StagedBench(staged_plan())
    cnc, panel = controller("cnc"), controller("panel")
    assert bench.ask(LET_GO, panel) == LET_GO
    move(bench, cnc, 1_000)  # not held by the panel
    bench.wait(HOLD_MS + 1_000)  # the operator has a break
    assert bench.ask(LET_GO, panel) == LET_GO
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU  # its target is still there
    assert bench.drive.moves == [("absolute", 1_010)]
    assert bench.ask(LET_GO, panel) == refusal(LET_GO)  # the axis is held again


def test_w10_an_idle_write_to_a_register_that_can_follow_takes_the_axis_over() -> None:
    """After it the writer's next position would mean something else."""
    follows = TriggerPlan(
        TRIGGER,
        deeds={0: Operation(Action.IGNORE), 5: Operation(Action.FOLLOW), STOP: Operation(Action.STOP)},
    )
    bench = StagedBench(staged_plan(motion=MotionPlan(is_staged=True, triggers=(follows,))))
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 1_000)
    assert bench.ask(bytes.fromhex("06 050E 0005"), cnc)[0] == 6
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(LET_GO, panel) == LET_GO
    assert writer(bench) == "panel"
    assert bench.ask(write(COMMAND, 2_000), cnc) == refusal(write(COMMAND, 2_000))


def test_w10_the_hold_ends_two_seconds_after_the_last_connection_of_its_writer() -> None:
    bench = Bench(axis_plan(), serial=False)
    first, second = controller("cnc", "10.0.0.1"), controller("cnc", "10.0.0.1")
    panel = controller("panel", "10.0.0.2")
    move(bench, first, 1_000)
    assert bench.ask(read(ACTUAL), second)[0] == 3
    bench.line.controller_gone(first, bench.now_ns)
    assert bench.ask(write(COMMAND, 9_000), panel) == refusal(write(COMMAND, 9_000))
    move(bench, second, 2_000)
    bench.line.controller_gone(second, bench.now_ns)
    bench.wait(2_000)
    assert bench.ask(write(COMMAND, 9_000), panel) == refusal(write(COMMAND, 9_000))
    bench.wait(1)
    assert writer(bench) is None
    move(bench, panel, 3_000)


def test_w10_a_short_hold_is_not_prolonged_when_its_writer_disconnects() -> None:
    bench = Bench(axis_plan(writer_hold_s=0.5), serial=False)
    cnc, panel = controller("cnc", "10.0.0.1"), controller("panel", "10.0.0.2")
    move(bench, cnc, 1_000)
    bench.line.controller_gone(cnc, bench.now_ns)
    bench.wait(510)
    move(bench, panel, 3_000)


def test_w10_a_controller_with_a_new_connection_for_each_request_holds_its_axis() -> None:
    bench = StagedBench(staged_plan(), serial=False)
    panel = controller("panel", "10.0.0.2")
    for pdu in (write(COMMAND, 4_000), RUN_PDU, write(COMMAND, 5_000), RUN_PDU):
        cnc = controller("cnc", "10.0.0.1")
        assert bench.ask(pdu, cnc) == pdu[:5]
        bench.line.controller_gone(cnc, bench.now_ns)
        bench.wait(900)
        assert bench.ask(JOG_PDU, panel) == refusal(JOG_PDU)
    assert [kind for kind, _ in bench.drive.moves] == ["absolute", "absolute"]


def test_w10_a_controller_that_connects_again_is_the_same_writer() -> None:
    bench = StagedBench(staged_plan())
    cnc = controller("cnc", "10.0.0.1")
    move(bench, cnc, 4_000)
    bench.line.controller_gone(cnc, bench.now_ns)
    assert bench.ask(RUN_PDU, controller("cnc", "10.0.0.1")) == RUN_PDU
    assert [kind for kind, _ in bench.drive.moves] == ["absolute"]


def test_w10_a_refused_frame_does_not_void_the_target_of_the_writer() -> None:
    """Its target is still in the drive, and its trigger runs it (M3 applies to the refused controller)."""
    bench = StagedBench(staged_plan())
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    assert bench.ask(write(COMMAND, 9_000), panel) == refusal(write(COMMAND, 9_000))
    assert bench.ask(bytes.fromhex("06 0606 0001"), panel)[1] == 6
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU
    [(kind, counts)] = bench.drive.moves
    assert (kind, abs(counts - 4_000) <= 10) == ("absolute", True)


def test_w10_requests_of_another_controller_that_were_never_sent_do_not_void_it_either() -> None:
    bench = StagedBench(staged_plan(), serial=False)
    cnc, panel = controller("cnc", "10.0.0.1"), controller("panel", "10.0.0.2")
    move(bench, cnc, 4_000)
    bench.send(read(ACTUAL), cnc)  # the line is busy
    for number in range(2_000):  # twice what has room: what is more is refused at once
        bench.send(write(COMMAND, 9_000 + number), panel)
    assert {pdu.hex() for _, _, pdu in panel.replies} == {"9006"}  # the queue was full
    bench.line.controller_gone(panel, bench.now_ns)
    bench.serve()
    cnc.replies.clear()
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU


def test_m3_a_trigger_does_not_run_the_target_of_another_writer_also_after_its_hold() -> None:
    bench = StagedBench(staged_plan())
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(RUN_PDU, panel) == refusal(RUN_PDU)
    assert bench.drive.moves == []
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU  # nor was anything taken from the one who wrote it


def test_m3_a_target_that_was_refused_to_a_second_writer_is_not_triggered_later() -> None:
    bench = StagedBench(staged_plan())
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    assert bench.ask(write(COMMAND, 9_000), panel) == refusal(write(COMMAND, 9_000))
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(RUN_PDU, panel) == refusal(RUN_PDU)
    move(bench, panel, 9_000, runs=True)
    [(_, counts)] = bench.drive.moves
    assert abs(counts - 9_000) <= 10


def test_m3_a_writer_that_takes_an_axis_over_by_a_jog_does_not_run_the_target_before() -> None:
    bench = StagedBench(staged_plan())
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(JOG_PDU, panel) == JOG_PDU
    assert bench.ask(RUN_PDU, panel) == refusal(RUN_PDU)
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(RUN_PDU, cnc) == refusal(RUN_PDU)  # and neither does the former one
    move(bench, cnc, 6_000, runs=True)
    assert [kind for kind, _ in bench.drive.moves] == ["jog", "absolute"]


def test_m1_parts_of_two_writers_never_make_one_position() -> None:
    bench = Bench(axis_plan(added_frames=False))
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 0x0001_0000)
    low, high = bytes.fromhex("06 0606 0005"), bytes.fromhex("06 0607 0000")
    assert bench.ask(high, panel) == refusal(high)
    bench.wait(HOLD_MS + 1_000)
    before = bench.memory.get(COMMAND)
    # its other part was refused: it is not combined with that of the other one
    assert bench.ask(low, panel)[0] == 0x86
    assert bench.memory.get(COMMAND) == before


def test_m3_a_mode_that_was_refused_to_a_second_writer_has_to_come_again() -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    cnc, panel = controller("cnc"), controller("panel")
    assert bench.ask(MODE_ABSOLUTE, cnc) == MODE_ABSOLUTE
    move(bench, cnc, 4_000, runs=True)
    bench.settle(is_polled=False)
    assert bench.ask(MODE_RELATIVE, panel) == refusal(MODE_RELATIVE)
    bench.wait(HOLD_MS + 1_000)
    # It means a distance, and the drive would take it for a place.
    assert bench.ask(write(COMMAND, 100), panel) == write(COMMAND, 100)[:5]
    assert bench.ask(RUN_PDU, panel) == refusal(RUN_PDU)
    assert bench.ask(MODE_RELATIVE, panel) == MODE_RELATIVE
    assert bench.ask(RUN_PDU, panel) == RUN_PDU
    assert [kind for kind, _ in bench.drive.moves] == ["absolute", "relative"]
    assert bench.drive.words[MODE] == 2


def test_w10_any_controller_may_move_an_axis_without_one_writer() -> None:
    bench = StagedBench(staged_plan(has_one_writer=False))
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    assert bench.ask(RUN_PDU, panel) == RUN_PDU
    move(bench, panel, 5_000)
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU
    assert writer(bench) == "cnc"
    assert "second-writer" not in bench.kinds()


def test_w10_controllers_may_take_turns_on_the_fast_path_too() -> None:
    bench = Bench(axis_plan(has_one_writer=False))
    ports = [controller("cnc"), controller("panel")]
    for number in range(6):
        port = ports[number % 2]
        move(bench, port, 1_000 * number)
        assert writer(bench) == port.writer
        assert abs(bench.memory.get(COMMAND) - 1_000 * number) <= 10


def test_w10_a_group_is_held_as_a_whole() -> None:
    plans = [staged_plan(name=name, unit_id=n) for n, name in enumerate(("y1", "y2", "z"), start=1)]
    bench = StagedBench(*plans, groups=[("y1", "y2")])
    cnc, panel = controller("cnc"), controller("panel")
    assert bench.ask(write(COMMAND, 1_000), cnc, 1) == write(COMMAND, 1_000)[:5]
    assert bench.ask(write(COMMAND, 2_000), panel, 2) == refusal(write(COMMAND, 2_000))
    assert bench.ask(write(COMMAND, 2_000), panel, 3) == write(COMMAND, 2_000)[:5]
    assert [writer(bench, n) for n in range(3)] == ["cnc", "cnc", "panel"]
    for _ in range(3):  # one of them moves on and holds the other one
        bench.wait(HOLD_MS - 1_000)
        assert bench.ask(write(COMMAND, 1_000), cnc, 1) == write(COMMAND, 1_000)[:5]
    assert bench.ask(write(COMMAND, 2_000), panel, 2) == refusal(write(COMMAND, 2_000))
    assert [writer(bench, n) for n in range(3)] == ["cnc", "cnc", None]


def test_w10_a_broadcast_trigger_is_refused_if_another_writer_holds_one_axis() -> None:
    plans = [staged_plan(name=name, unit_id=n) for n, name in enumerate(("x", "y"), start=1)]
    bench = StagedBench(*plans, serial=False)
    cnc, panel = controller("cnc"), controller("panel")
    assert bench.ask(write(COMMAND, 1_000), cnc, 1) == write(COMMAND, 1_000)[:5]
    assert bench.ask(write(COMMAND, 2_000), panel, 2) == write(COMMAND, 2_000)[:5]
    for port in (cnc, panel):
        bench.send(RUN_PDU, port, 0)
        assert port.take() == refusal(RUN_PDU)
    assert bench.drive.moves == []
    bench.send(STOP_PDU, panel, 0)
    assert [unit_id for unit_id, _ in bench.link.sent] == [0]


def test_w10_a_second_writer_is_reported_once_a_minute() -> None:
    bench = Bench(axis_plan())
    cnc, panel = controller("cnc"), controller("panel")
    for _ in range(90):
        move(bench, cnc, 1_000)
        assert bench.ask(write(COMMAND, 9_000), panel) == refusal(write(COMMAND, 9_000))
        bench.now_ns += 999 * MS  # the move took one
    details = [event.detail for event in bench.events if event.kind.name == "second-writer"]
    assert details == [
        "panel was refused: cnc moves it",
        "panel was refused: cnc moves it, 60 times since the last note",
    ]


def test_w10_after_more_refused_frames_than_are_remembered_everything_counts_as_lost() -> None:
    deeds = {**STAGED.triggers[0].deeds, **{n: Operation(Action.OTHER_MOTION) for n in range(2_000, 2_040)}}
    plan = staged_plan(motion=replace(STAGED, triggers=(replace(STAGED.triggers[0], deeds=deeds),)))
    bench = StagedBench(plan)
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    for number in range(2_000, 2_040):
        jog = bytes.fromhex("06 050E") + number.to_bytes(2, "big")
        assert bench.ask(jog, panel) == refusal(jog)
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(JOG_PDU, panel) == JOG_PDU
    assert bench.ask(RUN_PDU, panel) == refusal(RUN_PDU)
    move(bench, panel, 1_000, runs=True)


# === what a frame of another one changes beside the stop in it is never run (M3) =========================

SPAN_TRIGGER = 0x0608
"""A trigger right behind the target: one frame writes both."""
RUN_SPAN = bytes.fromhex("06 0608 0001")


class SpanDrive(StagedDrive):
    """As the other one, with its trigger right behind the target."""

    def write(self, address: int, data: bytes) -> None:
        super().write(address, data)
        words = len(data) // 2
        if address <= SPAN_TRIGGER < address + words:
            at = 2 * (SPAN_TRIGGER - address)
            self.act(int.from_bytes(data[at : at + 2], "big"))


def span_bench(**changes: object) -> StagedBench:
    motion = MotionPlan(is_staged=True, triggers=(TriggerPlan(SPAN_TRIGGER, deeds=DEEDS),))
    bench = StagedBench(staged_plan(motion=motion, **changes), serial=False)
    bench.drive = bench.memory = SpanDrive()
    return bench


def image(counts: int, trigger: int) -> bytes:
    """Target and trigger in one frame; the lower word comes first."""
    low, high = counts & 0xFFFF, counts >> 16
    return bytes.fromhex("10 0606 0003 06") + b"".join(n.to_bytes(2, "big") for n in (low, high, trigger))


@pytest.mark.parametrize("role", [Role.MOTION, Role.OPERATOR])
@pytest.mark.parametrize("compensation", [CompensationMode.ON, CompensationMode.OFF])
def test_m3_a_target_beside_the_stop_of_another_controller_never_runs(
    role: Role, compensation: CompensationMode
) -> None:
    bench = span_bench(compensation=compensation)
    cnc, panel = controller("cnc"), controller("panel", role=role)
    move(bench, cnc, 4_000)
    stop = image(9_000, STOP)
    assert bench.ask(stop, panel) == stop[:5]  # a stop is never refused
    assert bench.ask(RUN_SPAN, cnc) == refusal(RUN_SPAN)
    assert [kind for kind, _ in bench.drive.moves] == ["stop"]
    assert writer(bench) == "cnc"
    move(bench, cnc, 5_000)
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    [_, (kind, counts)] = bench.drive.moves
    assert (kind, abs(counts - 5_000) <= 10) == ("absolute", True)


def test_m3_a_target_beside_the_writers_own_stop_replaces_that_of_another_controller() -> None:
    bench = span_bench(compensation=CompensationMode.OFF)
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    for port, counts in ((panel, 9_000), (cnc, 5_000)):
        stop = image(counts, STOP)
        assert bench.ask(stop, port) == stop[:5]
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    assert bench.drive.moves[2:] == [("absolute", 5_000)]


@pytest.mark.parametrize("role", [Role.MOTION, Role.OPERATOR])
def test_m3_a_stop_of_another_controller_with_the_same_target_does_not_void_it(role: Role) -> None:
    bench = span_bench()
    cnc, panel = controller("cnc"), controller("panel", role=role)
    move(bench, cnc, 4_000)
    stop = image(4_000, STOP)
    assert bench.ask(stop, panel) == stop[:5]
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    assert [kind for kind, _ in bench.drive.moves] == ["stop", "absolute"]


def test_m3_a_target_beside_the_writers_own_stop_runs() -> None:
    bench = span_bench()
    cnc = controller("cnc")
    move(bench, cnc, 4_000)
    stop = image(5_000, STOP)
    assert bench.ask(stop, cnc) == stop[:5]
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    assert [kind for kind, _ in bench.drive.moves] == ["stop", "absolute"]


def test_m3_a_mode_that_was_refused_in_fc23_is_not_forgotten_for_another_fc23() -> None:
    """Both frames read the same register; they write different ones, and each loss counts."""
    bench = StagedBench(staged_plan(motion=sticky()))
    cnc, panel = controller("cnc"), controller("panel")
    assert bench.ask(MODE_ABSOLUTE, cnc) == MODE_ABSOLUTE
    move(bench, cnc, 4_000, runs=True)
    bench.settle(is_polled=False)
    mode = bytes.fromhex("17 005C 0001 0700 0001 02 0002")
    distance = bytes.fromhex("17 005C 0001 0606 0002 04 0064 0000")
    for pdu in (mode, distance):
        assert bench.ask(pdu, panel) == refusal(pdu)
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(distance, panel)[0] == 0x17
    assert bench.ask(RUN_PDU, panel) == refusal(RUN_PDU)  # it would be a place
    assert len(bench.drive.moves) == 1


LET_GO = bytes.fromhex("06 050E 0000")


def test_m3_a_controller_may_end_its_jog_although_another_one_took_the_axis_over() -> None:
    bench = StagedBench()
    pendant, cnc, other = controller("pendant"), controller("cnc"), controller("other")
    assert bench.ask(JOG_PDU, pendant) == JOG_PDU
    bench.wait(HOLD_MS + 1_000)  # the button is still held
    move(bench, cnc, 4_000)
    assert bench.ask(LET_GO, other) == refusal(LET_GO)
    assert bench.ask(LET_GO, pendant) == LET_GO
    assert bench.ask(JOG_PDU, pendant) == refusal(JOG_PDU)
    assert writer(bench) == "cnc"
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU
    assert bench.ask(LET_GO, pendant) == refusal(LET_GO)  # its jog has ended: this is another move
    assert [kind for kind, _ in bench.drive.moves] == ["jog", "absolute"]


def test_w10_a_group_that_was_taken_over_moves_with_frames_that_write_and_run() -> None:
    """M11: the targets of the former writer are lost for both axes, and no axis may wait for the other
    one."""
    motion = MotionPlan(starts_on=frozenset({COMMAND.address}), is_staged=True)
    plans = [axis_plan(name=name, unit_id=n, motion=motion) for n, name in enumerate(("y1", "y2"), start=1)]
    bench = Bench(*plans, groups=[("y1", "y2")])
    cnc, panel = controller("cnc"), controller("panel")
    for port, counts in ((cnc, 1_000), (panel, 2_000), (cnc, 3_000)):
        for unit_id in (1, 2):
            assert bench.ask(write(COMMAND, counts), port, unit_id) == write(COMMAND, counts)[:5]
        bench.wait(HOLD_MS + 10_000)


def test_w10_a_group_that_was_taken_over_runs_no_target_of_its_former_writer() -> None:
    plans = [staged_plan(name=name, unit_id=n) for n, name in enumerate(("y1", "y2"), start=1)]
    bench = StagedBench(*plans, groups=[("y1", "y2")])
    cnc, panel = controller("cnc"), controller("panel")
    for unit_id in (1, 2):
        assert bench.ask(write(COMMAND, 1_000), cnc, unit_id) == write(COMMAND, 1_000)[:5]
    bench.wait(HOLD_MS + 10_000)
    assert bench.ask(write(COMMAND, 2_000), panel, 1) == write(COMMAND, 2_000)[:5]
    for unit_id in (1, 2):
        assert bench.ask(RUN_PDU, panel, unit_id)[0] == 0x86
    assert bench.drive.moves == []
    for unit_id in (1, 2):
        assert bench.ask(write(COMMAND, 2_000), panel, unit_id) == write(COMMAND, 2_000)[:5]
    for unit_id in (1, 2):
        assert bench.ask(RUN_PDU, panel, unit_id) == RUN_PDU


def test_w10_a_target_of_the_former_writer_that_never_ran_blocks_no_frames_that_write_and_run() -> None:
    """M11: the panel writes and runs in one frame, so it never writes the target of the CNC again."""
    place = PositionField(TRIGGER + 1, COMMAND.type, COMMAND.order)
    plans = [staged_plan(name=name, unit_id=n, command=(place,)) for n, name in enumerate(("y1", "y2"), 1)]
    bench = Bench(*plans, groups=[("y1", "y2")])
    cnc, panel = controller("cnc"), controller("panel")
    for unit_id in (1, 2):
        assert bench.ask(write(place, 1_000), cnc, unit_id) == write(place, 1_000)[:5]
    bench.wait(HOLD_MS + 10_000)
    write_and_run = bytes.fromhex("10 050E 0003 06 0001") + write(place, 2_000)[6:]
    for unit_id in (1, 2):
        assert bench.ask(write_and_run, panel, unit_id) == write_and_run[:5]
