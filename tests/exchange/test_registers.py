"""Words of a position in the drive: written alone, lost, refused, kept under a number (M1, M2, M3, M7)."""

from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from gateway.drives.motion import Action, Form, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.axis.registers import (
    COMPLETENESS_AFTER,
    NEXT_PART,
    Completeness,
    FieldImage,
    Loss,
    NextPart,
)
from gateway.exchange.plan import CompensationMode, ControllerPlan, LineTiming, Reference
from gateway.modbus.registers import BitField, FieldAccess, PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Memory, Port, axis_plan, read, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import (
    BITS,
    MODE,
    ONLY_ABSOLUTE,
    RUN,
    RUN_PDU,
    STOP,
    STOP_PDU,
    TRIGGER,
    StagedBench,
    staged_plan,
    sticky,
)
from tests.support.tables import walk

# === drives on which writing one word of the position starts the motion ==================================

TARGET = PositionField(0x9900, RegisterType.INT32, WordOrder.HIGH_FIRST)
HIGH_FIRST_ACTUAL = PositionField(0x9000, RegisterType.INT32, WordOrder.HIGH_FIRST)
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
    plan = {"command": (TARGET,), "actual": (HIGH_FIRST_ACTUAL,), "motion": ON_LOW_WORD} | changes
    bench = Bench(axis_plan(**plan))
    bench.ask(write(TARGET, 65_530))
    assert bench.memory.get(TARGET) == 65_540  # a whole target is gone to at once
    bench.memory.put(HIGH_FIRST_ACTUAL, 65_540)
    bench.wait(1000)
    bench.seen.clear()
    return bench


class FlagsAreWriteOnly(Memory):
    """A drive that refuses to report its control flags, with this code."""

    def __init__(self, code: int) -> None:
        super().__init__()
        self.code = code

    def answer(self, pdu: bytes) -> bytes:
        is_refused = pdu[0] == 3 and pdu[1:3] == CONTROL_FLAGS.address.to_bytes(2, "big")
        return bytes((0x83, self.code)) if is_refused else super().answer(pdu)


@pytest.mark.parametrize("code", [2, 4])
def test_m2_the_mode_is_known_after_a_first_move_that_resets_it_whatever_it_was(code: int) -> None:
    bench = Bench(
        axis_plan(command=(TARGET,), actual=(HIGH_FIRST_ACTUAL,), motion=ON_LOW_WORD),
        memory=FlagsAreWriteOnly(code),
    )
    told = []
    for counts in (20_000, 40_000, 30_000, 50_000):
        bench.ask(write(TARGET, counts))
        told.append(bench.memory.get(TARGET))
        bench.memory.put(HIGH_FIRST_ACTUAL, told[-1])
        bench.wait(1000)
    assert told == [20_000, 40_010, 29_990, 50_010]


def test_m1_a_word_that_starts_nothing_passes_and_the_starting_one_sends_the_whole_position() -> None:
    bench = starting_bench()
    assert bench.ask(HIGH_WORD) == HIGH_WORD
    assert bench.seen == [HIGH_WORD]
    assert told(bench) == (65_530, 65_540)
    low = bytes.fromhex("06 9901 0000")
    assert bench.ask(low) == low
    assert bench.seen[-1] == write(TARGET, 131_082)  # 0x0002_0000 = 131 072, forward
    assert TARGET.unpack(bench.ask(read(TARGET))[2:]) == 131_072


def test_m1_the_starting_word_alone_is_joined_with_the_other_nominal_word() -> None:
    bench = starting_bench()
    bench.ask(bytes.fromhex("06 9901 0000"))  # 65 530 is 0x0000_FFFA: now 0
    assert bench.memory.get(TARGET) == -10


def test_m1_writing_the_speed_runs_the_target_in_the_register() -> None:
    bench = starting_bench()
    assert bench.ask(SPEED_ALONE) == SPEED_ALONE[:5]
    assert writes(bench) == [SPEED_ALONE]
    assert told(bench) == (65_530, 65_540)


def test_m1_writing_the_speed_runs_a_target_of_which_one_word_came_if_the_drive_holds_it_right() -> None:
    """70 000, 0x0001_1170, is told 0x0001_117A; 135 536, 0x0002_1170, is told 0x0002_117A."""
    bench = starting_bench()
    bench.ask(write(TARGET, 70_000))
    bench.memory.put(HIGH_FIRST_ACTUAL, 70_010)
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
    bench.memory.put(HIGH_FIRST_ACTUAL, 66_540)
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
    plan = {
        "command": (TARGET,),
        "actual": (HIGH_FIRST_ACTUAL,),
        "motion": ON_LOW_WORD,
        "bits": {"done": DONE},
    }
    bench = Bench(axis_plan(**plan | changes), timing=TIMING, serial=False, tcp_drive=True)
    bench.memory.words[DONE.address] = 1 << DONE.bit | 1 << HOMED.bit
    for counts in (1_000, 65_530):
        come_to(bench, counts)
    assert bench.line.axes[0].motion.state is MotionState.ARRIVED
    bench.seen.clear()
    return bench


def come_to(bench: Bench, counts: int) -> None:
    bench.ask(write(TARGET, counts))
    bench.memory.put(HIGH_FIRST_ACTUAL, bench.memory.get(TARGET))
    bench.wait(1200)
    bench.ask(read(HIGH_FIRST_ACTUAL))
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
    assert bench.ask(read(HIGH_FIRST_ACTUAL)) == bytes.fromhex("03 04 0000 FFFA")  # 65 530
    assert told(bench) == (65_530, 65_540)


def test_m2_a_refused_trigger_leaves_no_target_open() -> None:
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
def test_m7_target_and_speed_in_one_frame_are_open_if_it_is_not_acknowledged(is_silent: bool) -> None:
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
    bench.memory.put(HIGH_FIRST_ACTUAL, 150_000)
    bench.wait(1000)
    bench.seen.clear()
    bench.ask(write(TARGET, 100_000))
    flags = [bytes.fromhex("03 9908 0001")] if is_silent else []
    assert bench.seen == [*flags, read(HIGH_FIRST_ACTUAL), bytes.fromhex("10 9900 0002 04 0001 8696")]


def test_m5_after_a_refused_trigger_a_distance_counts_from_the_last_target() -> None:
    """From 65 530, told 65 540, by 100 to 65 630, told 65 640: 100, 0x64."""
    bench = arrived_bench()
    refuse_speed(bench)
    flags = bytes.fromhex("06 9908 0008")
    assert bench.ask(flags) == flags
    bench.ask(write(TARGET, 100))
    assert writes(bench) == [flags, bytes.fromhex("10 9900 0002 04 0000 0064")]
    assert told(bench) == (65_630, 65_640)


def test_after_a_kill_the_target_before_a_refused_trigger_is_restored() -> None:
    """On its way to 131 056, told 131 066, its high word makes the target 0x0000_FFF0, 65 520.

    From 100 400 that lies behind: 65 510, where the drive holds 65 530. Before, 65 510 had gone out and was
    read as 65 500 after a restart. Now it goes on to 131 066, which reads 131 056: 0x0001_FFF0.
    """
    plan = axis_plan(command=(TARGET,), actual=(HIGH_FIRST_ACTUAL,), motion=ON_LOW_WORD, bits={"done": DONE})
    bench = RecordBench(plan)
    bench.memory.words[DONE.address] = 1 << DONE.bit
    for counts in (-1_000, 1_000):
        come_to(bench, counts)
    bench.ask(write(TARGET, 131_056))
    assert bench.memory.get(TARGET) == 131_066
    bench.memory.words[DONE.address] = 0
    bench.wait(300)
    bench.ask(READ_DONE)
    bench.memory.put(HIGH_FIRST_ACTUAL, 100_000)
    bench.ask(read(HIGH_FIRST_ACTUAL))
    bench.ask(bytes.fromhex("06 9900 0000"))
    bench.memory.put(HIGH_FIRST_ACTUAL, 100_400)
    bench.seen.clear()
    bench.send(SPEED_ALONE)
    bench.serve_reads()
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("90 04")
    bench.memory.put(HIGH_FIRST_ACTUAL, 131_066)
    bench.memory.words[DONE.address] = 1 << DONE.bit
    bench.now_ns += 3000 * MS
    again = bench.restarted()
    [told] = again.told
    assert told.startswith("goes on from its record: nominal 131.056 mm, the drive at 131066 counts")
    assert again.ask(read(HIGH_FIRST_ACTUAL)) == bytes.fromhex("03 04 0001 FFF0")
    again.seen.clear()
    assert again.sent_for(write(TARGET, 132_000)) == write(TARGET, 132_010)
    assert again.line.axes[0].is_unsure is False


def test_m9_without_a_reference_no_target_is_written_again_if_that_starts_it() -> None:
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


def test_m2_a_word_that_starts_nothing_is_written_again() -> None:
    """A drive of single registers: 0x0002_0004 becomes 0x0003_0004 for 196 602, by its high word alone."""
    bench = starting_bench(writes_with=Form.FC06)
    bench.ask(HIGH_WORD)
    bench.seen.clear()
    assert bench.ask(SPEED_ALONE) == SPEED_ALONE[:5]
    assert writes(bench) == [bytes.fromhex("06 9900 0003"), SPEED_ALONE]


def test_m2_no_word_is_written_again_if_another_one_would_start_the_move() -> None:
    """From 196 612, told 0x0003_000E, back to 0x0001_0004, 65 540: told 65 530, 0x0000_FFFA.

    The drive holds 0x0001_000E, so both words would have to be written, the high one first.
    """
    bench = starting_bench(writes_with=Form.FC06)
    bench.ask(write(TARGET, 196_612))
    bench.memory.put(HIGH_FIRST_ACTUAL, 196_622)
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


# === refused parts: how the next part is sent, what a trigger runs =======================================

PROVES, MAY_HAVE_WRITTEN = {"exception_writes_nothing": True}, {"exception_writes_nothing": False}
HIGH_3 = bytes.fromhex("06 0607 0003")
LOW_2000 = bytes.fromhex("06 0606 2000")
HIGH_FRAMES = {
    "FC06": HIGH_3,
    "FC16": bytes.fromhex("10 0607 0001 02 0003"),
    "FC22": bytes.fromhex("16 0607 0000 0003"),
    "FC23": bytes.fromhex("17 0520 0002 0607 0001 02 0003"),
}
LOSS_WALK = """
                    whole         part-refused  torn        parts-lost  parts-buffered
refused-unwritten   part-refused  part-refused  torn        torn        torn
refused             torn          torn          torn        torn        torn
denied              torn          torn          torn        torn        torn
too-early           parts-lost    parts-lost    parts-lost  parts-lost  parts-lost
withdrawn           parts-lost    parts-lost    parts-lost  parts-lost  parts-lost
"""
"""By hand: what was answered with an exception joins nothing, but for what came too early."""
NEXT_WALK = """
                 waits,heard   waits,pipelined  moves,heard  moves,pipelined
whole            completed     completed        completed    completed
part-refused     completed     refused          completed    refused
torn             as-it-came    as-it-came       refused      refused
parts-lost       joined        joined           joined       joined
parts-buffered   joined        joined           joined       joined
"""


@pytest.mark.parametrize(("state", "loss"), list(product(Completeness, Loss)))
def test_m1_the_state_of_a_field_after_a_lost_part_is_what_the_rule_says(
    state: Completeness, loss: Loss
) -> None:
    assert COMPLETENESS_AFTER[state, loss].value == walk(LOSS_WALK)[state.value, loss.value]


@pytest.mark.parametrize(
    ("state", "waits", "heard"), list(product(Completeness, (True, False), (True, False)))
)
def test_m1_the_next_part_is_sent_as_the_rule_says(state: Completeness, waits: bool, heard: bool) -> None:
    column = f"{'waits' if waits else 'moves'},{'heard' if heard else 'pipelined'}"
    assert NEXT_PART[state, waits, heard].value == walk(NEXT_WALK)[column, state.value]


def test_the_tables_are_complete() -> None:
    assert len(COMPLETENESS_AFTER) == len(Completeness) * len(Loss)
    assert len(NEXT_PART) == 4 * len(Completeness)
    assert set(NEXT_PART.values()) == set(NextPart)


def refuse(bench: Bench, pdu: bytes, code: int) -> None:
    """Let the drive refuse a request of the controller, which is told so."""
    bench.send(pdu)
    bench.serve_reads()
    unit_id, sent = bench.link.sent.pop(0)
    bench.seen.append(sent)
    bench.now_ns += 1_000_000
    bench.line.reply(unit_id, bytes((sent[0] | 0x80, code)), bench.now_ns)
    assert bench.port.take() == bytes((pdu[0] | 0x80, code))


def mover(**plan: Any) -> Bench:
    """A drive that goes with each write, at 95 000 = 0x0001_7318."""
    bench = Bench(axis_plan(**plan), tcp_drive=True, serial=False)
    bench.move(95_000)
    return bench


def staged(**plan: Any) -> StagedBench:
    """A drive that waits for a trigger, at 95 000 = 0x0001_7318."""
    bench = StagedBench(staged_plan(**plan), tcp_drive=True, serial=False)
    bench.run(95_000)
    bench.drive.arrive()
    bench.wait(1000)
    bench.ask(read(ACTUAL))
    return bench


# --- drives that move with each write ------------------------------------------------------------------


@pytest.mark.parametrize("frame", HIGH_FRAMES)
@pytest.mark.parametrize("code", [1, 2, 3, 4])
def test_m7_after_a_half_that_was_not_written_the_other_is_joined_with_the_word_in_the_drive(
    frame: str, code: int
) -> None:
    """0x0001_2000 = 73 728, backward 10 less. Of FC23 only 1 proves that nothing was written."""
    bench = mover(**PROVES)
    refuse(bench, HIGH_FRAMES[frame], code)
    if frame == "FC23" and code != 1:
        assert bench.ask(LOW_2000) == bytes.fromhex("86 04")
        assert bench.memory.get(COMMAND) == 95_010
        return
    assert bench.ask(LOW_2000) == LOW_2000
    assert bench.memory.get(COMMAND) == 73_718


@pytest.mark.parametrize("frame", HIGH_FRAMES)
@pytest.mark.parametrize(
    ("code", "plan"),
    [(code, MAY_HAVE_WRITTEN) for code in (2, 4, 5, 6, 0x0A, 0x0B, 0x27)]
    + [(code, PROVES) for code in (5, 6, 0x0A, 0x0B, 0x27)],
)
def test_m7_after_a_doubtful_half_a_mover_gets_both_again(
    frame: str, code: int, plan: dict[str, Any]
) -> None:
    bench = mover(**plan)
    refuse(bench, HIGH_FRAMES[frame], code)
    assert bench.ask(LOW_2000) == bytes.fromhex("86 04")
    assert bench.memory.get(COMMAND) == 95_010  # as before
    assert bench.ask(bytes.fromhex("06 0607 0001")) == bytes.fromhex("06 0607 0001")
    assert bench.memory.get(COMMAND) == 73_718


@pytest.mark.parametrize("code", [1, 4])
def test_m1_a_half_pipelined_after_a_refused_one_is_refused(code: int) -> None:
    bench = mover(**PROVES)
    bench.send(HIGH_3)
    bench.now_ns += 1_000_000
    bench.send(LOW_2000)  # before anybody could have heard
    bench.now_ns += 1_000_000
    bench.serve_reads()
    [(unit_id, sent)] = bench.link.sent
    bench.link.sent.clear()
    bench.line.reply(unit_id, bytes((sent[0] | 0x80, code)), bench.now_ns)
    bench.serve()
    assert [reply for _, _, reply in bench.port.replies] == [bytes((0x86, code)), bytes.fromhex("86 04")]
    assert bench.memory.get(COMMAND) == 95_010


def test_m1_a_half_refused_to_a_second_writer_is_joined_with_no_other() -> None:
    bench = mover()
    panel = Port(ControllerPlan("hmi"))
    bench.send(HIGH_3, panel)
    assert panel.take() == bytes.fromhex("86 06")
    assert bench.ask(LOW_2000) == LOW_2000  # nothing was lost to whoever holds the axis
    assert bench.memory.get(COMMAND) == 73_718
    bench.wait(20_000)  # its hold has ended
    assert bench.ask(bytes.fromhex("06 0606 0000"), panel) == bytes.fromhex("86 04")  # and not 0x0003_0000
    assert bench.memory.get(COMMAND) == 73_718


# --- drives that wait for a trigger --------------------------------------------------------------------


@pytest.mark.parametrize("halves", [(HIGH_3, LOW_2000), (LOW_2000, HIGH_3)], ids=["high", "low"])
@pytest.mark.parametrize(
    ("code", "plan"), [(1, MAY_HAVE_WRITTEN), (4, PROVES), (4, MAY_HAVE_WRITTEN), (6, PROVES), (0x0B, PROVES)]
)
def test_m3_a_trigger_after_a_refused_half_is_refused(
    halves: tuple[bytes, bytes], code: int, plan: dict[str, Any]
) -> None:
    bench = staged(**plan)
    first, second = halves
    refuse(bench, first, code)
    assert bench.ask(second) == second
    moves = list(bench.drive.moves)
    assert bench.ask(RUN_PDU) == bytes((0x86, code))
    assert bench.ask(read(COMMAND))[0] == 3  # reading it back lifts nothing
    assert bench.ask(RUN_PDU) == bytes((0x86, code))
    assert bench.drive.moves == moves
    assert bench.ask(first) == first  # now each word has come anew
    assert bench.trigger() == ("absolute", 0x0003_2000 + 10)


def test_m3_the_same_half_twice_is_not_every_word() -> None:
    bench = staged(**PROVES)
    refuse(bench, HIGH_3, 4)
    for _ in range(2):
        assert bench.ask(LOW_2000) == LOW_2000
        assert bench.ask(RUN_PDU) == bytes.fromhex("86 04")


def test_m3_one_frame_with_all_words_releases_the_trigger() -> None:
    bench = staged(**PROVES)
    refuse(bench, HIGH_3, 4)
    bench.ask(LOW_2000)
    assert bench.run(100_000) == ("absolute", 100_010)


def test_m1_after_a_time_out_a_half_passes_unchanged_and_counts_once_it_is_acknowledged() -> None:
    bench = staged()
    bench.unanswered(HIGH_3, 1000)
    assert bench.ask(LOW_2000) == LOW_2000
    assert bench.seen[-1] == LOW_2000
    assert bench.ask(RUN_PDU)[0] == 0x86
    assert bench.ask(bytes.fromhex("06 0607 0001")) == bytes.fromhex("06 0607 0001")
    assert bench.trigger() == ("absolute", 73_718)


def test_m3_a_word_that_the_drive_refused_is_not_written_again_for_a_trigger() -> None:
    """A drive that takes single registers: 0x0003_0D40 = 200 000."""
    bench = staged(writes_with=Form.FC06, **PROVES)
    low = bytes.fromhex("06 0606 0D40")
    refuse(bench, HIGH_3, 4)
    assert bench.ask(low) == low
    written = len(bench.seen)
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 04")
    assert bench.seen[written:] == []
    assert bench.ask(HIGH_3) == HIGH_3
    assert bench.trigger() == ("absolute", 200_010)


def test_m3_a_half_that_starts_the_motion_is_refused_beside_a_refused_one() -> None:
    """The high word starts; the low one was refused, and its drive holds 0x7318."""
    starts = MotionPlan(starts_on=frozenset({0x0607}))
    bench = Bench(axis_plan(motion=starts, **PROVES), tcp_drive=True, serial=False)
    bench.ask(write(COMMAND, 95_000))
    told = bench.memory.get(COMMAND)
    refuse(bench, LOW_2000, 4)
    assert bench.ask(HIGH_3) == bytes.fromhex("86 04")
    assert bench.memory.get(COMMAND) == told


def test_m3_a_lost_target_of_one_field_is_not_run_after_a_write_to_another_field() -> None:
    """Two paths of one drive: path 1 lost a word, path 0 is written whole and releases its own triggers."""
    second = PositionField(0x0610, COMMAND.type, COMMAND.order)
    deeds = {0: Operation(Action.ABSOLUTE, 0), 1: Operation(Action.ABSOLUTE, 1)}
    motion = MotionPlan(is_staged=True, triggers=(TriggerPlan(0x050E, deeds=deeds),))
    bench = StagedBench(staged_plan(motion=motion, command=(COMMAND, second), **PROVES), tcp_drive=True)
    bench.ask(write(second, 50_000))
    refuse(bench, bytes.fromhex("06 0611 0003"), 4)
    assert bench.ask(bytes.fromhex("06 0610 2000")) == bytes.fromhex("06 0610 2000")
    bench.stage(20_000)
    assert bench.ask(bytes.fromhex("06 050E 0001")) == bytes.fromhex("86 04")
    assert bench.ask(bytes.fromhex("06 050E 0000")) == bytes.fromhex("06 050E 0000")


def test_m1_a_refused_half_is_forgotten_with_the_words_of_its_field() -> None:
    """The link was lost: the next pair goes out with its second half, as any first pair."""
    bench = mover(**PROVES)
    refuse(bench, HIGH_3, 4)
    bench.cut(100)
    assert [bench.ask(LOW_2000), bench.ask(bytes.fromhex("06 0607 0001"))] == [
        bytes.fromhex("86 04"),
        bytes.fromhex("06 0607 0001"),
    ]


# === lost writes: no position is joined from their words =================================================

HIGH_1 = bytes.fromhex("06 0607 0001")
LOW_4 = bytes.fromhex("06 0606 0004")
REFUSED = bytes.fromhex("86 04")


def standing_at(counts: int, **plan: object) -> Bench:
    bench = Bench(axis_plan(**plan))
    bench.move(counts)
    return bench


def test_a_pair_beyond_travel_by_its_first_half_is_sent_when_it_is_written_again() -> None:
    # From 65 530 to 65 540 = 0x0001_0004: the high half alone makes 131 066, outside the travel.
    bench = standing_at(65_530, travel=(0.0, 100.0))
    told = bench.memory.get(COMMAND)
    assert [bench.ask(half) for half in (HIGH_1, LOW_4)] == [REFUSED, REFUSED]
    assert bench.memory.get(COMMAND) == told
    assert bench.ask(HIGH_1) == HIGH_1  # with the low half right before it
    assert bench.memory.get(COMMAND) == 65_550
    assert bench.ask(LOW_4) == LOW_4


def test_an_axis_crosses_zero_in_halves_with_the_second_pair_if_one_half_alone_leaves_its_travel() -> None:
    bench = standing_at(5_000, travel=(-10.0, 10.0))
    # -5 000 = 0xFFFF_EC78: its low half makes 60 536 of 5 000, the high one alone would make 0xFFFF_1388
    low, high = bytes.fromhex("06 0606 EC78"), bytes.fromhex("06 0607 FFFF")
    assert [bench.ask(half) for half in (low, high)] == [REFUSED, REFUSED]
    bench.wait(1000)
    assert [bench.ask(half) for half in (low, high)] == [REFUSED, high]
    assert bench.memory.get(COMMAND) == -5_010


@pytest.mark.parametrize("between", [read(ACTUAL), bytes.fromhex("03 0700 0001")])
def test_halves_that_the_gateway_refused_are_not_joined_over_another_request(between: bytes) -> None:
    bench = standing_at(5_000, travel=(-10.0, 10.0))
    low, high = bytes.fromhex("06 0606 EC78"), bytes.fromhex("06 0607 FFFF")
    assert [bench.ask(half) for half in (low, high)] == [REFUSED, REFUSED]
    bench.wait(1000)
    assert bench.ask(low) == REFUSED
    bench.ask(between)
    assert bench.ask(high) == REFUSED
    assert bench.ask(low) == low
    assert bench.memory.get(COMMAND) == -5_010


def test_halves_that_the_gateway_refused_are_not_joined_over_two_connections() -> None:
    bench = Bench(axis_plan(travel=(-10.0, 10.0), has_one_writer=False), serial=False)
    bench.move(5_000)
    low, high = bytes.fromhex("06 0606 EC78"), bytes.fromhex("06 0607 FFFF")
    assert [bench.ask(half) for half in (low, high, low)] == [REFUSED, REFUSED, low]
    bench.move(5_000)
    told = bench.memory.get(COMMAND)
    assert bench.ask(low) == REFUSED
    other = Port(ControllerPlan("hmi"))
    assert bench.ask(high, other) == REFUSED
    assert bench.ask(low) == REFUSED  # the other half that it would join came from somebody else
    assert bench.memory.get(COMMAND) == told


def test_halves_of_different_commands_are_never_joined() -> None:
    bench = standing_at(65_530, travel=(0.0, 100.0))
    told = bench.memory.get(COMMAND)
    assert bench.ask(HIGH_1) == REFUSED
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED
    assert bench.memory.get(COMMAND) == told
    assert "write all of it again" in bench.events[-1].detail


def test_the_next_half_is_not_joined_with_a_refused_pair() -> None:
    bench = standing_at(5_000, travel=(-300.0, 10.0))
    low, high = bytes.fromhex("06 0606 1770"), bytes.fromhex("06 0607 0000")
    for part in ("06 0606 EC78", "06 0607 7FFF"):  # 0x7FFF_EC78 is far outside
        assert bench.ask(bytes.fromhex(part)) == REFUSED
    assert bench.ask(low) == REFUSED  # with the high half right before it: 0x7FFF_1770
    assert [bench.ask(half) for half in (high, low)] == [REFUSED, low]
    assert bench.memory.get(COMMAND) == 6_010


def test_a_withdrawn_half_is_joined_with_the_one_that_withdrew_it() -> None:
    bench = standing_at(65_530)
    hmi = Port(ControllerPlan("hmi"))
    bench.send(bytes.fromhex("03 0700 0001"), hmi)
    bench.send(HIGH_1)  # waits behind the other controller's read
    bench.send(LOW_4)  # the serial controller has gone on
    bench.serve()
    assert bench.port.take() == LOW_4
    assert bench.memory.get(COMMAND) == 65_550


def test_a_half_is_not_joined_with_one_lost_before_a_newer_whole_write() -> None:
    """The part waits for a read, the whole one behind it; both are withdrawn, the newer one first."""
    bench = Bench(axis_plan(), timing=LineTiming(response_timeout_ms=50), serial=False, tcp_drive=True)
    bench.send(HIGH_1)
    assert bench.link.sent[-1][1][0] == 3  # for the other part
    bench.send(write(COMMAND, 50_000))
    bench.line.controller_gone(bench.port, bench.now_ns)
    bench.link.sent.clear()
    bench.wait(60)
    port = Port(ControllerPlan("cnc"))
    bench.send(LOW_4, port)
    bench.serve()
    assert (bench.seen, port.take()) == ([], REFUSED)


def test_a_half_that_a_full_queue_refused_is_lost_until_the_other_follows() -> None:
    bench = Bench(axis_plan(), serial=False)
    bench.move(65_530)
    for number in range(951):  # one is on the wire, 949 have room
        bench.send(bytes.fromhex("03 0700 0001"), transaction_id=number)
    bench.send(HIGH_1, transaction_id=2000)
    bench.serve()
    bench.port.replies.clear()
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED


def test_a_half_that_the_drive_did_not_answer_is_lost_until_the_other_follows() -> None:
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.move(65_530)
    bench.unanswered(HIGH_1, 1000)
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED
    assert bench.ask(HIGH_1) == HIGH_1
    assert bench.memory.get(COMMAND) == 65_550


@pytest.mark.parametrize("stands_at", [0, 1, -1, 300, 65_536, 131_072])
def test_the_first_pair_after_a_start_is_sent_wherever_the_drive_is(stands_at: int) -> None:
    bench = Bench(axis_plan())
    bench.memory.put(COMMAND, stands_at)
    bench.memory.put(ACTUAL, stands_at)
    bench.ask(bytes.fromhex("06 0606 EA60"))  # 60 000 = 0x0000_EA60
    assert bench.ask(bytes.fromhex("06 0607 0000")) == bytes.fromhex("06 0607 0000")
    assert bench.memory.get(COMMAND) in (60_010, 59_990)
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 60_000


def test_a_whole_write_replaces_a_torn_position() -> None:
    bench = standing_at(65_530, travel=(0.0, 100.0))
    bench.ask(HIGH_1)
    bench.move(70_000)
    assert bench.ask(LOW_4) == LOW_4  # 70 000 is 0x0001_1170, so this is 65 540, backward
    assert bench.memory.get(COMMAND) == 65_530


def lost_acknowledgement() -> Bench:
    """An axis that was sent from 50 000 back to 20 000, got there, and whose reply was lost."""
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.move(50_000)
    bench.send(write(COMMAND, 20_000))
    bench.serve_reads()
    bench.memory.answer(bench.link.take())
    bench.wait(1000)
    bench.port.take()
    bench.memory.put(ACTUAL, 19_990)
    bench.wait(1000)
    return bench


@pytest.mark.parametrize(
    ("stands_at", "told"),
    [(19_990, 19_990), (19_993, 19_990), (0, 20_010)],
    ids=["there", "3 counts beside it, with 2 of hysteresis", "jogged away meanwhile"],
)
def test_the_same_target_after_a_lost_acknowledgement_is_the_same_words_unless_the_axis_was_moved(
    stands_at: int, told: int
) -> None:
    bench = lost_acknowledgement()
    bench.memory.put(ACTUAL, stands_at)
    assert bench.sent_for(write(COMMAND, 20_000)) == write(COMMAND, told)


@pytest.mark.parametrize("pdu", [write(COMMAND, 20_000), read(COMMAND)])
def test_the_same_target_or_the_drives_command_register_proves_a_lost_acknowledgement(pdu: bytes) -> None:
    bench = lost_acknowledgement()
    reply = bench.ask(pdu)
    assert pdu[0] != 3 or COMMAND.unpack(reply[2:]) == 20_000
    assert bench.actual() == 20_000


@pytest.mark.parametrize("on_forward_branch", [True, False])
def test_after_a_restart_the_target_where_the_axis_stands_does_not_move_it(on_forward_branch: bool) -> None:
    bench = Bench(axis_plan())
    bench.memory.put(ACTUAL, 50_010 if on_forward_branch else 49_990)
    assert bench.command(50_000) == (50_010 if on_forward_branch else 49_990)


def test_the_first_direction_is_decided_on_the_drives_scale() -> None:
    # The axis stands at 50.31 mm of the drive, which is 50.00 mm nominal; 50.10 mm lies forward of it.
    from gateway.compensation.table import make_table
    from gateway.compensation.units import Units

    bench = Bench(axis_plan(table=make_table([0, 100], [0.31, 0.31], [0.29, 0.29], Units.MM)))
    bench.memory.put(ACTUAL, 50_310)
    assert bench.command(50_100) == 50_410


def test_a_request_that_became_too_old_during_an_added_read_is_not_sent() -> None:
    bench = Bench(axis_plan(), serial=False)
    hasty = Port(ControllerPlan("plc", timeout_ms=100))
    bench.send(write(COMMAND, 50_000), hasty)
    assert bench.link.take() == read(ACTUAL)
    bench.wait(600)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent == []
    assert bench.kinds()[-1] == "withdrawn"


def test_the_same_target_through_another_register_keeps_its_correction() -> None:
    narrow = PositionField(0x0700, RegisterType.INT16)
    coarse = PositionField(0x0702, RegisterType.INT16, scale=100.0)
    bench = Bench(axis_plan(command=(COMMAND, narrow, coarse)))
    bench.move(32_765)
    assert bench.ask(write(narrow, 32_765)) == bytes.fromhex("90 04")  # 32 775 does not fit
    bench.move(32_000)
    assert bench.ask(write(coarse, 320)) == write(coarse, 320)[:5]
    bench.memory.put(ACTUAL, bench.memory.get(coarse) * 100)
    assert bench.actual() == 32_000


def test_a_cyclic_image_with_two_command_fields_never_flips() -> None:
    other = PositionField(0x0608, COMMAND.type, COMMAND.order)
    bench = Bench(axis_plan(command=(COMMAND, other)))
    image = bytes.fromhex("10 0606 0004 08 C350 0000 4E20 0000")  # 50 000 and 20 000
    bench.ask(image)
    first = bench.seen[-1]
    for actual in (10_000, 45_000, 15_000, 30_000):
        bench.memory.put(ACTUAL, actual)
        bench.ask(read(ACTUAL))
        bench.wait(30)
        assert bench.sent_for(image) == first


def test_a_target_after_a_jog_that_was_seen_is_no_repeat() -> None:
    bench = standing_at(50_000)
    bench.actual()
    bench.memory.put(ACTUAL, 80_000)  # somebody jogged the axis
    bench.actual()
    bench.wait(100)
    assert bench.command(50_000) == 49_990  # backward from 80 mm


def test_an_actual_position_that_is_no_number_is_ignored() -> None:
    reported = PositionField(0x0520, RegisterType.FLOAT32)
    bench = Bench(axis_plan(actual=(reported,)))
    bench.memory.put(reported, 90_000.0)
    bench.ask(read(reported))
    bench.wait(3_600_000)
    bench.memory.write(reported.address, bytes.fromhex("7FC0 0000"))
    assert bench.command(50_000) == 50_000  # half way, flagged: the hour-old position is not used
    assert bench.kinds()[-1] == "direction-unsure"


# === a loss during an older write is not healed by the acknowledgement of that ===========================

TRIGGER_REFUSED = bytes.fromhex("86 06")


def test_m3_a_target_that_a_stop_withdrew_is_not_replaced_by_the_one_on_the_wire() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(50_000)
    bench.send(write(COMMAND, 20_000), transaction_id=1)
    bench.send(write(COMMAND, 30_000), transaction_id=2)
    bench.send(STOP_PDU, Port(ControllerPlan("panel")))
    bench.serve()
    assert [pdu.hex() for _, _, pdu in bench.port.replies] == ["9006", "1006060002"]
    bench.port.replies.clear()
    assert bench.ask(RUN_PDU) == TRIGGER_REFUSED
    assert bench.go_to(30_000) == ("absolute", 29_990)


def test_m3_a_half_that_was_withdrawn_is_not_joined_with_what_was_on_the_wire() -> None:
    bench = StagedBench()
    bench.go_to(50_000)
    bench.send(bytes.fromhex("06 0606 1111"))  # on the wire: 0x0000_1111
    bench.send(bytes.fromhex("06 0607 0001"))  # waits
    bench.send(bytes.fromhex("03 0800 0001"))  # the controller went on: the part is withdrawn
    bench.serve()
    bench.port.replies.clear()
    bench.wait(500)
    assert bench.ask(bytes.fromhex("06 0606 2222")) == bytes.fromhex("06 0606 2222")
    assert bench.ask(RUN_PDU)[0] == 0x86
    assert bench.ask(bytes.fromhex("06 0607 0001")) == bytes.fromhex("06 0607 0001")
    assert bench.trigger() == ("absolute", 74_284)  # 0x0001_2222 = 74 274, forward


def test_m3_a_mode_that_was_withdrawn_is_not_replaced_by_the_one_on_the_wire() -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    bench.memory.words[MODE] = 1
    bench.go_to(50_000)
    bench.stage(1_000)
    bench.send(bytes.fromhex("06 0700 0001"))
    bench.send(bytes.fromhex("06 0700 0002"))
    bench.send(bytes.fromhex("03 0800 0001"))
    bench.serve()
    bench.port.replies.clear()
    assert bench.ask(RUN_PDU)[0] == 0x86
    assert bench.ask(bytes.fromhex("06 0700 0002"))[0] == 6
    assert bench.trigger() == ("relative", 51_010)


def test_m3_a_part_whose_loss_shows_after_that_of_a_newer_one_is_not_joined() -> None:
    image = FieldImage(COMMAND)
    image.settle(bytes(4), bytes(4))
    later, sooner = 100 * MS, 90 * MS
    lose(image, b"\x00\x02", later)  # was withdrawn at once
    lose(image, b"\x00\x01", sooner)  # that this one was not sent is known only now
    for follows_ns in (later, sooner):
        assert image.completed(0, b"\x12\x34", 150 * MS, follows_ns) is None


def lose(image: FieldImage, high: bytes, arrived_ns: int) -> None:
    image.lose(Loss.WITHDRAWN, 1, high, arrived_ns=arrived_ns, follows_ns=0, now_ns=arrived_ns)


def test_m1_a_lost_half_that_was_written_again_may_wait_for_the_other() -> None:
    image = FieldImage(COMMAND)
    lose(image, b"\x00\x01", 100 * MS)
    image.buffer(1, b"\x00\x01", 250 * MS, 100 * MS)
    assert image.completed(0, b"\x12\x34", 900 * MS, 700 * MS) == bytes.fromhex("1234 0001")


def test_m3_halves_that_came_at_the_same_instant_are_lost_in_their_order() -> None:
    bench = StagedBench(tcp_drive=True, timing=LineTiming(response_timeout_ms=100))
    port = Port(ControllerPlan("cnc", timeout_ms=100))
    bench.go_to(50_000)
    bench.send(bytes.fromhex("06 0606 1111"), port, transaction_id=1)  # on the wire: 0x0000_1111
    bench.send(bytes.fromhex("10 0605 0002 04 0000 2222"), port, transaction_id=2)
    bench.send(bytes.fromhex("06 0607 0001"), port, transaction_id=3)
    bench.send(STOP_PDU, Port(ControllerPlan("panel")))  # refuses both that wait
    bench.link.sent.clear()
    bench.wait(100)  # and nobody answers the first
    bench.serve()
    bench.ask(bytes.fromhex("06 0607 0001"))
    assert bench.refused(RUN_PDU) == 6  # the newest low half is 2222, and it was lost
    assert bench.ask(bytes.fromhex("06 0606 2222")) == bytes.fromhex("06 0606 2222")
    assert bench.trigger() == ("absolute", 74_284)  # 0x0001_2222 = 74 274, forward


# === halves of an old connection: those of a newer one never complete them ===============================
READ = bytes.fromhex("03 0700 0001")


@pytest.mark.parametrize("is_broken", [False, True])
def test_m1_a_half_that_was_refused_is_not_completed_over_a_newer_connection(*, is_broken: bool) -> None:
    # From 65 530 to 65 540 = 0x0001_0004: the high half alone makes 131 066, outside the travel.
    bench = Bench(axis_plan(travel=(0.0, 100.0)), serial=False)
    bench.move(65_530)
    told = bench.memory.get(COMMAND)
    assert bench.ask(HIGH_1) == REFUSED
    bench.line.controller_gone(bench.port, bench.now_ns, is_broken=is_broken)
    bench.port = Port(ControllerPlan("cnc"))
    assert bench.ask(LOW_4) == REFUSED  # before: 06 0606 0004, and the drive at 65 550
    assert bench.memory.get(COMMAND) == told
    assert bench.ask(HIGH_1) == HIGH_1  # both of its own, one right behind the other
    assert bench.memory.get(COMMAND) == 65_550


def test_m1_a_half_that_was_withdrawn_with_its_connection_is_not_completed_either() -> None:
    bench = Bench(axis_plan(), serial=False)
    bench.move(65_530)
    told = bench.memory.get(COMMAND)
    bench.send(READ, Port(ControllerPlan("hmi")))
    bench.send(HIGH_1)  # waits behind the other controller's read
    bench.line.controller_gone(bench.port, bench.now_ns)
    newer = Port(ControllerPlan("cnc"))
    assert bench.ask(LOW_4, newer) == REFUSED
    assert bench.memory.get(COMMAND) == told


@pytest.mark.parametrize("is_broken", [False, True])
def test_m1_a_half_on_the_wire_when_its_connection_broke_off_is_not_completed(*, is_broken: bool) -> None:
    bench = StagedBench(serial=False)
    image = bench.line.axes[0].fields[0]
    image.lose_all_words()  # nothing is known of its drive: halves go out as they came
    bench.send(HIGH_1)
    assert bench.link.sent[-1][1] == HIGH_1
    bench.line.controller_gone(bench.port, bench.now_ns, is_broken=is_broken)
    bench.serve()
    # A controller that has closed its connection may go on with the other half.
    expected = Completeness.ALL_LOST if is_broken else Completeness.PARTS_BUFFERED
    assert image.completeness is expected


@pytest.mark.parametrize("before", Completeness)
def test_a_connection_that_breaks_off_tears_what_was_acknowledged_in_part(before: Completeness) -> None:
    image = FieldImage(COMMAND)
    image.settle(bytes(4), bytes(4))
    match before:
        case Completeness.ALL_LOST:
            image.lose_all_words(5)
        case Completeness.PART_REFUSED:
            image.lose(Loss.REFUSED_UNWRITTEN, 0, b"\0\1", arrived_ns=5, follows_ns=0, now_ns=6)
        case Completeness.PARTS_LOST:
            image.lose(Loss.WITHDRAWN, 0, b"\0\1", arrived_ns=5, follows_ns=0, now_ns=6)
        case Completeness.PARTS_BUFFERED:
            image.buffer(0, b"\0\1", 5, 0)
    assert image.completeness is before
    image.forget_parts()
    after = Completeness.ALL_LOST if before is Completeness.PARTS_BUFFERED else before
    assert image.completeness is after
    completed = {
        Completeness.WHOLE: bytes.fromhex("0000 0004"),
        Completeness.PART_REFUSED: bytes.fromhex("0000 0004"),
    }
    # Of another connection, whose request before this one came at 0 or never.
    assert image.completed(1, b"\0\4", 10, 0) == completed.get(after)


def test_m1_half_of_a_field_is_not_completed_from_a_register_that_reads_differently() -> None:
    target = replace(COMMAND, access=FieldAccess.WRITE)
    bench = Bench(axis_plan(command=(target,), actual=(replace(COMMAND, access=FieldAccess.READ),)))
    bench.memory.put(COMMAND, 0x0005_4020)
    assert bench.ask(bytes.fromhex("06 0606 9000")) == bytes.fromhex("86 04")
    assert bench.seen == []


def test_m1_acknowledged_halves_may_come_slowly() -> None:
    bench = StagedBench(staged_plan(writes_with=Form.FC06, motion=ONLY_ABSOLUTE))
    for part in ("06 0606 FFFA", "06 0607 0000"):
        assert bench.ask(bytes.fromhex(part)) == bytes.fromhex(part)
        bench.wait(700)
    bench.trigger()
    assert bench.drive.moves == [("absolute", 65_540)]


def test_w4_a_recast_half_is_answered_in_its_own_form_whatever_the_drive_says() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.send(bytes.fromhex("06 0606 1234"))
    bench.serve_reads()
    bench.answers(bytes.fromhex("10 0606 0000"))
    assert bench.port.take() == bytes.fromhex("86 04")


# === targets that the drive keeps under a number =========================================================

PATH_3 = PositionField(0x0620, COMMAND.type, COMMAND.order)
MODE_0, MODE_3 = 0x0700, 0x0703
ABSOLUTE_3, JUMPING_3 = bytes.fromhex("06 0703 0001"), bytes.fromhex("06 0703 4001")
RUN_0, RUN_3 = bytes.fromhex("06 050E 0001"), bytes.fromhex("06 050E 0004")
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


def keeping(kind: int = 0x4001, **plan: Any) -> StagedBench:
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
def test_m9_the_trigger_of_a_stored_target_of_unknown_kind_is_refused(kind: int, is_read: bool) -> None:
    line = keeping(kind)
    if not is_read:
        line.ask(bytes.fromhex("03 0703 0001"))
    assert line.ask(RUN_3) == REFUSED
    assert ran(line) == 0
    assert line.kinds()[-1] == "stored-move"


@pytest.mark.parametrize("is_forgotten", [False, True])
def test_m9_a_stored_target_is_refused_after_its_kind_was_written_or_its_words_were_forgotten(
    *, is_forgotten: bool
) -> None:
    line = keeping()
    if is_forgotten:
        line.ask(write(PATH_3, 50_000))
    assert line.ask(JUMPING_3) == JUMPING_3
    if is_forgotten:
        line.cut(0)
    assert (line.ask(RUN_3), ran(line)) == (REFUSED, 0)


def test_m9_the_trigger_of_a_stored_target_is_refused_in_a_frame_that_writes_another_path() -> None:
    motion = replace(PATHS, triggers=(replace(PATHS.triggers[0], address=0x0608),))
    line = keeping(motion=motion)
    frame = bytes.fromhex("10 0606 0003 06 4E20 0000 0004")  # 20 000 into path 0, and path 3 runs
    assert line.ask(frame) == bytes.fromhex("90 04")


def test_m2_a_stored_target_written_through_the_gateway_passes_and_makes_the_motion_unknown() -> None:
    line = keeping()
    line.ask(ABSOLUTE_3)
    line.ask(write(PATH_3, 50_000))
    line.ask(JUMPING_3)
    assert line.ask(RUN_3) == RUN_3
    assert line.drive.get(PATH_3) == 50_000  # as its controller wrote it
    assert line.line.axes[0].motion.state.value == "unknown"
    assert line.line.axes[0].is_unsure


@pytest.mark.parametrize(
    "plan",
    [{"compensation": CompensationMode.OFF}, {"referenced": Reference.HOMING}, {"table": None}],
    ids=["off", "not homed", "no table"],
)
def test_m9_an_axis_that_passes_1_to_1_runs_a_stored_target(plan: dict[str, Any]) -> None:
    """A machine that homes by a stored path has to be able to."""
    line = keeping(bits=BITS, **plan)
    assert (line.ask(RUN_3), ran(line)) == (RUN_3, 1)


@pytest.mark.parametrize("word", [STOP, 100, 0, 0x200], ids=["stop", "homing", "nothing", "unknown"])
def test_m9_a_trigger_that_runs_no_stored_target_passes(word: int) -> None:
    pdu = bytes.fromhex(f"06 050E {word:04X}")
    assert keeping().ask(pdu) == pdu


def test_m9_with_stored_moves_uncorrected_a_stored_target_runs_and_its_axis_is_flagged() -> None:
    line = keeping(motion=replace(PATHS, passes_stored_moves=True))
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


def test_m3_with_stored_moves_uncorrected_a_torn_stored_target_is_still_refused() -> None:
    line = keeping(motion=replace(PATHS, passes_stored_moves=True))
    line.unanswered(write(PATH_3, 50_000), 1000)
    line.wait(1000)
    assert line.ask(RUN_3)[0] == 0x86
    assert ran(line) == 0
