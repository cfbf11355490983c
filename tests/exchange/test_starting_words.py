"""Drives on which writing one word of the position starts the motion (M1), and words written alone."""

import pytest

from gateway.drives.motion import Action, Form, ModePlan, MotionPlan
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.plan import LineTiming, Reference
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import MS, Bench, axis_plan, read, write
from tests.exchange.record_bench import RecordBench

TARGET = PositionField(0x9900, RegisterType.INT32, WordOrder.HIGH_FIRST)
ACTUAL = PositionField(0x9000, RegisterType.INT32, WordOrder.HIGH_FIRST)
LOW_WORD = 0x9901
SPEED = 0x9904
CONTROL_FLAGS = ModePlan(0x9908, actions={0: Action.ABSOLUTE, 8: Action.RELATIVE}, resets_to=0)
DONE, HOMED = BitField(0x9005, 3), BitField(0x9005, 4)
READ_DONE = bytes.fromhex("03 9005 0001")
HIGH_WORD = bytes.fromhex("06 9900 0002")
SPEED_ALONE = bytes.fromhex("10 9904 0002 04 0000 1388")
TIMING = LineTiming(response_timeout_ms=300.0)
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
    assert bench.ask(HIGH_WORD) == HIGH_WORD
    assert bench.seen == [HIGH_WORD]
    assert told(bench) == (65_530, 65_540)


def test_m1_the_starting_word_sends_the_whole_position_corrected() -> None:
    bench = starting_bench()
    bench.ask(HIGH_WORD)
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
    assert bench.ask(SPEED_ALONE) == SPEED_ALONE[:5]
    assert writes(bench) == [SPEED_ALONE]
    assert told(bench) == (65_530, 65_540)


def test_m1_it_runs_a_target_of_which_one_word_came_where_the_drive_holds_it_right() -> None:
    """70 000, 0x0001_1170, is told 0x0001_117A; 135 536, 0x0002_1170, is told 0x0002_117A."""
    bench = starting_bench()
    bench.ask(write(TARGET, 70_000))
    bench.memory.put(ACTUAL, 70_010)
    bench.wait(1000)
    bench.ask(HIGH_WORD)
    bench.seen.clear()
    assert bench.ask(SPEED_ALONE) == SPEED_ALONE[:5]
    assert writes(bench) == [SPEED_ALONE]
    assert bench.memory.get(TARGET) == 135_546
    assert told(bench) == (135_536, 135_546)


def test_m2_the_relative_flag_counts_for_one_move_only() -> None:
    bench = starting_bench()
    relative = bytes.fromhex("10 9900 0009 12 0000 03E8 0000 0000 0000 0000 0000 0000 0008")
    bench.ask(relative)
    assert bench.seen[-1][6:10] == (1000).to_bytes(4, "big")
    assert told(bench) == (66_530, 66_540)
    bench.memory.put(ACTUAL, 66_540)
    bench.wait(1000)
    bench.ask(write(TARGET, 60_000))
    assert bench.memory.get(TARGET) == 59_990


@pytest.mark.parametrize("flags", [1, 2, 9, 0x8000])
def test_unknown_flags_pass_untouched_and_are_counted(flags: int) -> None:
    bench = starting_bench()
    frame = bytes.fromhex(f"10 9900 0009 12 0000 03E8 0000 0000 0000 0000 0000 0000 {flags:04X}")
    assert bench.sent_for(frame) == frame
    assert bench.line.counters.unknown_modes == 1


def test_m3_a_starting_word_after_a_lost_one_is_refused() -> None:
    bench = starting_bench()
    bench.send(HIGH_WORD)
    bench.answers(bytes.fromhex("86 04"))
    bench.port.take()
    bench.wait(300)
    assert bench.ask(bytes.fromhex("06 9901 0000")) == bytes.fromhex("86 04")
    assert bench.ask(SPEED_ALONE) == bytes.fromhex("90 04")


# --- what the gateway adds starts nothing (M2, W5) ----------------------------------------------------------


def arrived_bench(**changes: object) -> Bench:
    """Modbus/TCP on both sides; it came up to 65 530, was told 65 540 for it and stands there."""
    plan = {"command": (TARGET,), "actual": (ACTUAL,), "motion": ON_LOW_WORD, "bits": {"done": DONE}}
    bench = Bench(axis_plan(**plan | changes), timing=TIMING, serial=False, tcp_drive=True)
    bench.memory.words[DONE.address] = 1 << DONE.bit | 1 << HOMED.bit
    for counts in (1_000, 65_530):
        come_to(bench, counts)
    assert bench.line.axes[0].motion.state is MotionState.ARRIVED
    bench.seen.clear()
    return bench


def come_to(bench: Bench, counts: int) -> None:
    bench.ask(write(TARGET, counts))
    bench.memory.put(ACTUAL, bench.memory.get(TARGET))
    bench.wait(1200)
    bench.ask(read(ACTUAL))
    bench.ask(READ_DONE)


def writes(bench: Bench) -> list[bytes]:
    return [pdu for pdu in bench.seen if pdu[0] != 3]


def told(bench: Bench) -> tuple[float, float] | None:
    """The last accepted target, nominal and corrected."""
    accepted = bench.line.axes[0].compensation.accepted
    return None if accepted is None else (accepted.nominal_counts, accepted.corrected_counts)


def refuse_speed(bench: Bench) -> None:
    """The high word makes the target 0x0002_FFFA, 196 602.

    It would be told 196 612, 0x0003_0004, where the drive holds 0x0002_0004: writing that anew would start
    it. So nothing of it reaches the drive, and it stands where it stood.
    """
    assert bench.ask(HIGH_WORD) == HIGH_WORD
    bench.send(SPEED_ALONE)
    bench.serve_reads()
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("90 04")
    assert writes(bench) == [HIGH_WORD]
    assert bench.memory.read(SPEED, 2) == bytes(4)
    assert bench.line.axes[0].motion.state is MotionState.ARRIVED
    assert told(bench) == (65_530, 65_540)
    assert "writing it starts the move" in bench.events[-1].detail
    bench.seen.clear()


def test_w5_a_trigger_that_is_withdrawn_has_moved_nothing() -> None:
    """It came up to 65 530 and stands at 65 540; before, ``10 9900 0002 04 0003 0004`` had gone out."""
    bench = arrived_bench()
    refuse_speed(bench)
    bench.line.controller_gone(bench.port, bench.now_ns)
    bench.wait(1000)
    assert bench.link.sent == []
    assert bench.ask(read(ACTUAL)) == bytes.fromhex("03 04 0000 FFFA")  # 65 530
    assert told(bench) == (65_530, 65_540)


def test_m2_a_trigger_alone_leaves_no_target_without_an_answer() -> None:
    """Nothing is out that a drive could refuse or leave unanswered; 100 000 lies ahead: 100 010, 0x186AA."""
    bench = arrived_bench()
    refuse_speed(bench)
    bench.wait(301)
    bench.wait(1000)
    assert bench.line.counters.timeouts == 0
    bench.ask(write(TARGET, 100_000))
    assert writes(bench) == [bytes.fromhex("10 9900 0002 04 0001 86AA")]
    assert bench.line.axes[0].is_unsure is False


@pytest.mark.parametrize("is_silent", [False, True])
def test_m7_target_and_speed_in_one_frame_are_in_doubt_where_it_is_not_acknowledged(is_silent: bool) -> None:
    """196 602 goes out as 196 612, 0x0003_0004, and the speed with it.

    The drive went there all the same, and is at 150 000 when 100 000 is asked for: that is read, lies behind
    it, and is told 99 990, 0x1_8696. After a silence the flags are read first.
    """
    bench = arrived_bench()
    refuse_speed(bench)
    block = bytes.fromhex("10 9900 0007 0E 0002 FFFA 0000 000A 0000 1388 001E")
    bench.send(block)
    bench.serve_reads()
    sent = bench.link.take()
    assert sent == bytes.fromhex("10 9900 0007 0E 0003 0004 0000 000A 0000 1388 001E")
    if is_silent:
        bench.wait(1001)  # its controller has that much patience
        assert bench.port.take() == bytes.fromhex("90 0B")
    else:
        bench.line.reply(1, bytes.fromhex("90 04"), bench.now_ns)
        assert bench.port.take() == bytes.fromhex("90 04")
    assert bench.line.axes[0].motion.state is MotionState.UNACKNOWLEDGED
    bench.memory.words[DONE.address] = 0
    bench.memory.put(ACTUAL, 150_000)
    bench.wait(1000)
    bench.seen.clear()
    bench.ask(write(TARGET, 100_000))
    flags = [bytes.fromhex("03 9908 0001")] if is_silent else []
    assert bench.seen == [*flags, read(ACTUAL), bytes.fromhex("10 9900 0002 04 0001 8696")]


def test_m5_after_a_refused_trigger_a_distance_counts_from_where_the_axis_stands() -> None:
    """From 65 530, told 65 540, by 100 to 65 630, told 65 640: 100, 0x64."""
    bench = arrived_bench()
    refuse_speed(bench)
    flags = bytes.fromhex("06 9908 0008")
    assert bench.ask(flags) == flags
    bench.ask(write(TARGET, 100))
    assert writes(bench) == [flags, bytes.fromhex("10 9900 0002 04 0000 0064")]
    assert told(bench) == (65_630, 65_640)


def test_a_kill_after_a_refused_trigger_finds_the_target_that_the_drive_goes_to() -> None:
    """On its way to 131 056, told 131 066, its high word makes the target 0x0000_FFF0, 65 520.

    From 100 400 that lies behind: 65 510, where the drive holds 65 530. Before, 65 510 had gone out and was
    read as 65 500 after a restart. Now it goes on to 131 066, which reads 131 056: 0x0001_FFF0.
    """
    plan = axis_plan(command=(TARGET,), actual=(ACTUAL,), motion=ON_LOW_WORD, bits={"done": DONE})
    bench = RecordBench(plan)
    bench.memory.words[DONE.address] = 1 << DONE.bit
    for counts in (-1_000, 1_000):
        come_to(bench, counts)
    bench.ask(write(TARGET, 131_056))
    assert bench.memory.get(TARGET) == 131_066
    bench.memory.words[DONE.address] = 0
    bench.wait(300)
    bench.ask(READ_DONE)
    bench.memory.put(ACTUAL, 100_000)
    bench.ask(read(ACTUAL))
    bench.ask(bytes.fromhex("06 9900 0000"))
    bench.memory.put(ACTUAL, 100_400)
    bench.seen.clear()
    bench.send(SPEED_ALONE)
    bench.serve_reads()
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("90 04")
    bench.memory.put(ACTUAL, 131_066)
    bench.memory.words[DONE.address] = 1 << DONE.bit
    bench.now_ns += 3000 * MS
    again = bench.restarted()
    [told] = again.told
    assert told.startswith("goes on from its record: nominal 131.056 mm, the drive at 131066 counts")
    assert again.ask(read(ACTUAL)) == bytes.fromhex("03 04 0001 FFF0")
    again.seen.clear()
    assert again.sent_for(write(TARGET, 132_000)) == write(TARGET, 132_010)
    assert again.line.axes[0].is_unsure is False


def test_m9_without_a_reference_no_target_is_written_anew_that_would_start() -> None:
    """It was told 65 540 for 65 530, and may have been switched off since; 100 000 is 0x0001_86A0, 1:1."""
    bench = arrived_bench(bits={"done": DONE, "homed": HOMED}, referenced=Reference.DRIVE_BIT)
    assert bench.memory.get(TARGET) == 65_540
    bench.memory.words[DONE.address] = 1 << DONE.bit
    bench.ask(READ_DONE)
    bench.seen.clear()
    assert bench.ask(SPEED_ALONE) == bytes.fromhex("90 04")
    assert writes(bench) == []
    bench.ask(write(TARGET, 100_000))
    assert writes(bench) == [bytes.fromhex("10 9900 0002 04 0001 86A0")]
    assert bench.ask(SPEED_ALONE) == SPEED_ALONE[:5]
    assert writes(bench)[1:] == [SPEED_ALONE]


def test_m2_a_word_that_starts_nothing_is_written_anew() -> None:
    """A drive of single registers: 0x0002_0004 becomes 0x0003_0004 for 196 602, by its high word alone."""
    bench = starting_bench(writes_with=Form.FC06)
    bench.ask(HIGH_WORD)
    bench.seen.clear()
    assert bench.ask(SPEED_ALONE) == SPEED_ALONE[:5]
    assert writes(bench) == [bytes.fromhex("06 9900 0003"), SPEED_ALONE]


def test_m2_no_word_is_written_anew_where_another_one_would_start() -> None:
    """From 196 612, told 0x0003_000E, back to 0x0001_0004, 65 540: told 65 530, 0x0000_FFFA.

    The drive holds 0x0001_000E, so both words would have to be written, the high one first.
    """
    bench = starting_bench(writes_with=Form.FC06)
    bench.ask(write(TARGET, 196_612))
    bench.memory.put(ACTUAL, 196_622)
    bench.wait(1000)
    bench.ask(bytes.fromhex("06 9900 0001"))
    bench.seen.clear()
    assert bench.ask(SPEED_ALONE) == bytes.fromhex("90 04")
    assert writes(bench) == []


def test_m5_a_distance_whose_rewriting_would_start_it_is_refused() -> None:
    bench = starting_bench()
    flags = bytes.fromhex("06 9908 0008")
    assert bench.ask(flags) == flags
    bench.seen.clear()
    # the speed runs 65 530 as a distance; the drive holds 65 540, and writing it anew would already be a move
    assert bench.ask(SPEED_ALONE) == bytes.fromhex("90 04")
    assert [pdu for pdu in bench.seen if pdu[0] != 3] == []
