"""Targets that the drive keeps under a number, of a kind that nobody knows (M2, M9)."""

from dataclasses import replace
from typing import Any

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import CompensationMode, Reference
from gateway.modbus.registers import PositionField
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, read, write
from tests.exchange.staged_bench import BITS, RUN, STOP, TRIGGER, StagedBench, staged_plan

PATH_3 = PositionField(0x0620, COMMAND.type, COMMAND.order)
MODE_0, MODE_3 = 0x0700, 0x0703
ABSOLUTE_3, JUMPING_3 = bytes.fromhex("06 0703 0001"), bytes.fromhex("06 0703 4001")
RUN_0, RUN_3 = bytes.fromhex("06 050E 0001"), bytes.fromhex("06 050E 0004")
REFUSED = bytes.fromhex("86 04")
KINDS = {1: Action.ABSOLUTE, 2: Action.RELATIVE, 3: Action.STORED, 7: Action.OTHER_MOTION}
PATHS = MotionPlan(
    is_staged=True,
    modes=(ModePlan(MODE_0, actions=KINDS), ModePlan(MODE_3, actions=KINDS)),
    triggers=(
        TriggerPlan(
            TRIGGER,
            deeds={
                0: Operation(Action.IGNORE),
                RUN: Operation(Action.START, 0),
                4: Operation(Action.START, 1),
                STOP: Operation(Action.STOP),
                100: Operation(Action.HOME),
            },
        ),
    ),
)


def bench(kind: int = 0x4001, **plan: Any) -> StagedBench:
    """A drive that keeps 77 777 under path 3, of a kind with which it goes on to another path."""
    motion = plan.pop("motion", PATHS)
    found = StagedBench(staged_plan(command=(COMMAND, PATH_3), motion=motion, **plan), tcp_drive=True)
    found.drive.put(PATH_3, 77_777)
    found.drive.write(MODE_3, kind.to_bytes(2, "big"))
    return found


def ran(line: Bench) -> int:
    """How often path 3 was run."""
    return line.seen.count(RUN_3)


@pytest.mark.parametrize("kind", [0x4001, 0x00C2, 9, 0])
@pytest.mark.parametrize("is_read", [True, False], ids=["asked by the gateway", "read by the controller"])
def test_m9_a_kept_target_of_a_kind_that_nobody_knows_is_refused(kind: int, is_read: bool) -> None:
    line = bench(kind)
    if not is_read:
        line.ask(bytes.fromhex("03 0703 0001"))
    assert line.ask(RUN_3) == REFUSED
    assert ran(line) == 0
    assert line.kinds()[-1] == "stored-move"


def test_m9_it_is_refused_after_its_kind_was_written_too() -> None:
    line = bench()
    assert line.ask(JUMPING_3) == JUMPING_3
    assert (line.ask(RUN_3), ran(line)) == (REFUSED, 0)


def test_m9_it_is_refused_in_a_frame_that_writes_another_path() -> None:
    motion = replace(PATHS, triggers=(replace(PATHS.triggers[0], address=0x0608),))
    line = bench(motion=motion)
    frame = bytes.fromhex("10 0606 0003 06 4E20 0000 0004")  # 20 000 into path 0, and path 3 runs
    assert line.ask(frame) == bytes.fromhex("90 04")


def test_m2_one_that_came_through_the_gateway_passes_untouched_and_displaces_its_axis() -> None:
    line = bench()
    line.ask(ABSOLUTE_3)
    line.ask(write(PATH_3, 50_000))
    line.ask(JUMPING_3)
    assert line.ask(RUN_3) == RUN_3
    assert line.drive.get(PATH_3) == 50_000  # as its controller wrote it
    assert line.line.axes[0].motion.state.value == "unknown"
    assert line.line.axes[0].is_unsure


def test_m9_it_is_refused_again_once_its_words_were_forgotten() -> None:
    line = bench()
    line.ask(write(PATH_3, 50_000))
    line.ask(JUMPING_3)
    line.line.link_down(line.now_ns)
    line.line.link_up(line.now_ns)
    line.serve()
    assert (line.ask(RUN_3), ran(line)) == (REFUSED, 0)


@pytest.mark.parametrize(
    "plan",
    [{"compensation": CompensationMode.OFF}, {"referenced": Reference.HOMING}, {"table": None}],
    ids=["off", "not homed", "no table"],
)
def test_m9_an_axis_that_passes_1_to_1_runs_it(plan: dict[str, Any]) -> None:
    """A machine that homes by a stored path has to be able to."""
    line = bench(bits=BITS, **plan)
    assert (line.ask(RUN_3), ran(line)) == (RUN_3, 1)


def test_m9_stops_and_mapped_homing_pass() -> None:
    line = bench()
    for pdu in (bytes.fromhex("06 050E 03E8"), bytes.fromhex("06 050E 0064"), bytes.fromhex("06 050E 0000")):
        assert line.ask(pdu) == pdu


def test_m9_a_value_without_a_number_passes_as_before() -> None:
    line = bench()
    odd = bytes.fromhex("06 050E 0200")
    assert line.ask(odd) == odd


def test_m9_with_stored_moves_uncorrected_it_passes_and_its_axis_is_flagged() -> None:
    line = bench(motion=replace(PATHS, passes_stored_moves=True))
    line.stage(20_000)
    line.ask(bytes.fromhex("06 0700 0001"))
    line.trigger(RUN_0)
    line.drive.arrive()
    line.wait(1000)
    line.ask(read(ACTUAL))
    assert "direction-unsure" not in line.kinds()
    assert (line.ask(RUN_3), ran(line)) == (RUN_3, 1)
    assert line.line.axes[0].is_unsure
    assert line.kinds()[-1] == "direction-unsure"


def test_m3_with_stored_moves_uncorrected_a_torn_one_stays_refused() -> None:
    line = bench(motion=replace(PATHS, passes_stored_moves=True))
    line.unanswered(write(PATH_3, 50_000), 1000)
    line.wait(1000)
    assert line.ask(RUN_3)[0] == 0x86
    assert ran(line) == 0
