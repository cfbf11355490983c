"""Drives on which writing one word of the position starts the motion (M1), and words written alone."""

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import Bench, axis_plan, read, write

TARGET = PositionField(0x9900, RegisterType.INT32, WordOrder.HIGH_FIRST)
ACTUAL = PositionField(0x9000, RegisterType.INT32, WordOrder.HIGH_FIRST)
LOW_WORD = 0x9901
SPEED = 0x9904
CONTROL_FLAGS = ModePlan(0x9908, actions={0: Action.ABSOLUTE, 8: Action.RELATIVE}, resets_to=0)
ON_LOW_WORD = MotionPlan(modes=(CONTROL_FLAGS,), starts_on=frozenset({LOW_WORD, SPEED, SPEED + 1}))


def starting_bench(**changes: object) -> Bench:
    plan = {"command": (TARGET,), "actual": (ACTUAL,), "motion": ON_LOW_WORD} | changes
    bench = Bench(axis_plan(**plan))
    bench.ask(write(TARGET, 65_530))
    bench.memory.put(ACTUAL, bench.memory.get(TARGET))
    bench.wait(1000)
    bench.seen.clear()
    return bench


def test_m1_a_whole_target_is_gone_to_at_once() -> None:
    bench = starting_bench()
    assert bench.memory.get(TARGET) == 65_540


def test_m1_the_word_that_starts_nothing_waits_and_goes_out_as_it_came() -> None:
    bench = starting_bench()
    high = bytes.fromhex("06 9900 0002")
    assert bench.ask(high) == high
    assert bench.seen == [high]
    accepted = bench.line.axes[0].compensation.accepted
    assert accepted is not None
    assert accepted.nominal_counts == 65_530


def test_m1_the_starting_word_sends_the_whole_position_corrected() -> None:
    bench = starting_bench()
    bench.ask(bytes.fromhex("06 9900 0002"))
    low = bytes.fromhex("06 9901 0000")
    assert bench.ask(low) == low
    # 0x0002_0000 = 131 072, forward
    assert bench.seen[-1] == write(TARGET, 131_082)
    assert TARGET.unpack(bench.ask(read(TARGET))[2:]) == 131_072


def test_m1_the_starting_word_alone_keeps_the_other_as_the_controller_wrote_it() -> None:
    bench = starting_bench()
    bench.ask(bytes.fromhex("06 9901 0000"))  # 65 530 is 0x0000_FFFA: now 0
    assert bench.memory.get(TARGET) == -10


def test_m1_writing_the_speed_runs_the_target_that_stands_there() -> None:
    bench = starting_bench()
    bench.ask(bytes.fromhex("06 9900 0002"))  # 0x0002_FFFA = 196 602
    bench.seen.clear()
    speed = bytes.fromhex("10 9904 0002 04 0000 1388")
    bench.ask(speed)
    writes = [pdu for pdu in bench.seen if pdu[0] != 3]
    assert writes == [write(TARGET, 196_612), speed]


def test_m2_the_relative_flag_counts_for_one_move_only() -> None:
    bench = starting_bench()
    relative = bytes.fromhex("10 9900 0009 12 0000 03E8 0000 0000 0000 0000 0000 0000 0008")
    bench.ask(relative)
    assert bench.seen[-1][6:10] == (1000).to_bytes(4, "big")
    accepted = bench.line.axes[0].compensation.accepted
    assert accepted is not None
    assert accepted.nominal_counts == 66_530
    bench.memory.put(ACTUAL, 66_540)
    bench.wait(1000)
    bench.ask(write(TARGET, 60_000))
    assert bench.memory.get(TARGET) == 59_990


@pytest.mark.parametrize("flags", [1, 2, 9, 0x8000])
def test_unknown_flags_pass_untouched_and_are_counted(flags: int) -> None:
    bench = starting_bench()
    frame = bytes.fromhex("10 9900 0009 12 0000 03E8 0000 0000 0000 0000 0000 0000") + flags.to_bytes(
        2, "big"
    )
    bench.ask(frame)
    assert bench.seen[-1] == frame
    assert bench.line.counters.unknown_modes == 1


def test_m3_a_starting_word_after_a_lost_one_is_refused() -> None:
    bench = starting_bench()
    bench.send(bytes.fromhex("06 9900 0002"))
    bench.link.take()
    bench.line.reply(1, bytes.fromhex("86 04"), bench.now_ns)
    bench.port.take()
    bench.wait(300)
    assert bench.ask(bytes.fromhex("06 9901 0000")) == bytes.fromhex("86 04")
    assert bench.ask(bytes.fromhex("10 9904 0002 04 0000 1388")) == bytes.fromhex("90 04")


def test_m5_a_distance_whose_rewriting_would_start_it_is_refused() -> None:
    bench = starting_bench()
    flags = bytes.fromhex("06 9908 0008")
    assert bench.ask(flags) == flags
    bench.seen.clear()
    # the speed runs 65 530 as a distance; the drive holds 65 540, and writing it anew would already be a move
    assert bench.ask(bytes.fromhex("10 9904 0002 04 0000 1388")) == bytes.fromhex("90 04")
    assert [pdu for pdu in bench.seen if pdu[0] != 3] == []
