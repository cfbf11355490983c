"""The state in which an axis goes on after a kill, by where it was then and where it is seen."""

from typing import Any, Final

import pytest

from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.plan import Reference
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import ACTUAL, COMMAND, axis_plan, read, stream_plan, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import STAGED

STATUS: Final = 0x0030
READ_STATUS: Final = bytes.fromhex("03 0030 0001")
DONE, HOMED = 0x0001, 0x0002
BITS: Final = {"done": BitField(STATUS, 0), "homed": BitField(STATUS, 1)}


def at_50_mm(**changes: Any) -> RecordBench:
    """An axis that came forward to 50 000, and was seen there."""
    bench = RecordBench(axis_plan(done_drop_ms=0.0, **changes))
    bench.move(20_000, 50_000)
    bench.actual()
    return bench


def report(bench: RecordBench, *words: int) -> None:
    """Let the controller read the status, with these contents one after the other."""
    for word in words:
        bench.memory.words[STATUS] = word
        bench.ask(READ_STATUS)


def axis_of(bench: RecordBench) -> Axis:
    [axis] = bench.line.axes
    return axis


@pytest.mark.parametrize(
    ("words", "after"),
    [
        ((), MotionState.IN_WINDOW),
        ((DONE,), MotionState.ARRIVED),
        ((DONE, 0), MotionState.MAY_HAVE_LEFT),
    ],
)
def test_at_its_target_an_axis_is_in_the_state_that_its_bits_gave(
    words: tuple[int, ...], after: MotionState
) -> None:
    bench = at_50_mm(bits=BITS)
    report(bench, *words)
    assert axis_of(bench).motion.state is after
    again = bench.restarted()
    assert again.kinds() == ["line-up", "restored"]
    assert axis_of(again).motion.state is after
    assert axis_of(again).fields[0].corrected_words == COMMAND.pack(50_010)


@pytest.mark.parametrize("was_done", [False, True])
def test_on_its_way_it_moves_whatever_its_bits_said_before(was_done: bool) -> None:
    bench = at_50_mm(bits=BITS)
    report(bench, DONE if was_done else 0)
    bench.ask(write(COMMAND, 80_000))
    bench.memory.put(ACTUAL, 65_000)
    again = bench.restarted()
    assert again.kinds() == ["line-up", "restored"]
    axis = axis_of(again)
    assert axis.motion.state is MotionState.MOVING
    assert axis.compensation.accepted == (80_000, 80_010)


def test_a_drive_with_triggers_may_have_stopped_on_its_way() -> None:
    """Without its master it may stop: the next distance begins where it is (M5)."""
    bench = RecordBench(axis_plan(motion=STAGED))
    for counts in (20_000, 50_000):
        bench.ask(write(COMMAND, counts))
        bench.ask(bytes.fromhex("06 050E 0001"))
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND) if counts == 20_000 else 35_000)
        bench.actual()
    again = bench.restarted()
    assert again.kinds() == ["line-up", "restored"]
    assert axis_of(again).motion.state is MotionState.STOPPED
    assert axis_of(again).compensation.accepted is None


def test_a_target_that_was_on_the_wire_and_was_obeyed_is_the_last_one() -> None:
    bench = at_50_mm()
    bench.send(write(COMMAND, 80_000))
    [(_, pdu)] = bench.link.sent
    bench.memory.answer(pdu)  # and nobody takes note of it
    bench.memory.put(ACTUAL, 80_010)
    again = bench.restarted()
    assert again.kinds() == ["line-up", "restored"]
    axis = axis_of(again)
    assert axis.compensation.accepted == (80_000, 80_010)
    assert (axis.fields[0].nominal_words, axis.fields[0].corrected_words) == (
        COMMAND.pack(80_000),
        COMMAND.pack(80_010),
    )


@pytest.mark.parametrize("bits", [{}, BITS])
def test_a_repeat_on_the_wire_changes_nothing_of_a_record(bits: dict[str, BitField]) -> None:
    bench = at_50_mm(bits=bits)
    report(bench, DONE, 0, DONE)
    bench.send(write(COMMAND, 50_000))
    while bench.link.sent[0][1] != write(COMMAND, 50_010):
        bench.answers(bench.memory.answer(bench.link.sent[0][1]))
    again = bench.restarted()
    assert again.kinds() == ["line-up", "restored"]
    assert axis_of(again).compensation.accepted == (50_000, 50_010)


def test_a_record_that_did_not_count_counts_for_no_later_run_either() -> None:
    bench = at_50_mm()
    bench.memory.put(ACTUAL, 70_000)
    moved = bench.restarted()
    assert moved.kinds() == ["line-up", "record-not-used"]
    moved.memory.put(ACTUAL, 50_010)
    assert moved.restarted().kinds() == ["line-up"]


def test_a_stream_waits_for_its_homed_bit_before_its_record_counts() -> None:
    plan = stream_plan(referenced=Reference.DRIVE_BIT, bits=BITS, safe_read=False)
    bench = RecordBench(plan)
    report(bench, HOMED)
    for counts in range(20_000, 21_000, 50):
        bench.ask(write(COMMAND, counts))
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        bench.ask(read(ACTUAL))
        bench.now_ns += 10_000_000
    again = bench.restarted()
    again.ask(read(ACTUAL))
    assert again.told == []
    report(again, HOMED)
    again.ask(read(ACTUAL))
    assert again.kinds()[-1] == "restored"


def test_a_stream_that_is_not_referenced_any_more_keeps_only_what_it_stands_on() -> None:
    """Its homed bit is clear after the kill: positions pass 1:1, and the correction in force fades out."""
    bench = RecordBench(stream_plan(referenced=Reference.DRIVE_BIT, bits=BITS))
    bench.memory.words[STATUS] = HOMED
    for counts in range(20_000, 24_000, 50):
        bench.ask(write(COMMAND, counts))
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        bench.ask(read(ACTUAL))
        bench.now_ns += 10_000_000
    assert bench.memory.get(COMMAND) == 23_960
    bench.memory.words[STATUS] = 0
    again = bench.restarted()
    report(again, 0)
    again.actual()
    assert "restored" in again.kinds()
    assert axis_of(again).motion.state is MotionState.STOPPED
    offsets = []
    for counts in range(23_950, 26_000, 50):
        again.ask(write(COMMAND, counts))
        offsets.append(again.memory.get(COMMAND) - counts)
        again.memory.put(ACTUAL, again.memory.get(COMMAND))
    assert (offsets[0], offsets[-1]) == (10, 0)
