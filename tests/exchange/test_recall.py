"""How an axis is restored after a kill: its state, and at which end of its last move it is."""

from dataclasses import replace
from typing import Any, Final

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.axis.acknowledge import PROOF_AFTER
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.plan import AxisPlan, Reference
from gateway.exchange.status import axis_status
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import (
    ACTUAL,
    COMMAND,
    MS,
    Bench,
    Memory,
    axis_plan,
    monitor,
    read,
    stream_plan,
    write,
)
from tests.exchange.record_bench import RecordBench, Records
from tests.exchange.staged_bench import (
    COMMANDED,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STAGED,
    STATUS,
    STOP_PDU,
    StagedBench,
    StagedDrive,
    staged_plan,
)
from tests.exchange.test_cross_terms import Y_ACTUAL, Y_COMMAND
from tests.support.tables import walk

# === the state, by where the axis was then and where it is seen ==========================================

STATUS_WORD: Final = 0x0030
READ_STATUS_WORD: Final = bytes.fromhex("03 0030 0001")
DONE, HOMED = 0x0001, 0x0002
BITS: Final = {"done": BitField(STATUS_WORD, 0), "homed": BitField(STATUS_WORD, 1)}


HIGHER: Final = make_table([0, 100], [0.03, 0.03], [0.0, 0.0], Units.MM)


def at_50_mm(**changes: Any) -> RecordBench:
    """An axis that came forward to 50 000, and was seen there."""
    bench = RecordBench(axis_plan(done_drop_ms=0.0, **changes))
    bench.move(20_000, 50_000)
    bench.actual()
    return bench


def report(bench: RecordBench, *words: int) -> None:
    """Let the controller read the status, with these contents one after the other."""
    for word in words:
        bench.memory.words[STATUS_WORD] = word
        bench.ask(READ_STATUS_WORD)


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
def test_an_axis_on_its_way_is_restored_as_moving_whatever_its_bits_were(was_done: bool) -> None:
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
    """Without its master the drive may stop: the next distance begins at its position (M5)."""
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


def test_a_target_on_the_wire_that_the_drive_obeyed_is_the_last_accepted_one() -> None:
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
def test_a_repeat_on_the_wire_does_not_change_what_the_record_restores(bits: dict[str, BitField]) -> None:
    bench = at_50_mm(bits=bits)
    report(bench, DONE, 0, DONE)
    bench.send(write(COMMAND, 50_000))
    while bench.link.sent[0][1] != write(COMMAND, 50_010):
        bench.answers(bench.memory.answer(bench.link.sent[0][1]))
    again = bench.restarted()
    assert again.kinds() == ["line-up", "restored"]
    assert axis_of(again).compensation.accepted == (50_000, 50_010)


def test_m1_a_half_after_a_restart_is_completed_from_the_drive_if_a_half_was_lost_before() -> None:
    """The record does not know what the drive holds. 60 000 is EA60, and is sent as 60 010."""
    bench = at_50_mm()
    bench.send(read(ACTUAL), monitor())
    bench.send(bytes.fromhex("06 0606 0001"))
    bench.line.controller_gone(bench.port, bench.now_ns)
    again = bench.restarted()
    again.seen.clear()
    half = bytes.fromhex("06 0606 EA60")
    assert again.ask(half) == half
    assert again.seen == [read(COMMAND), write(COMMAND, 60_010)]


def test_a_record_that_was_not_used_is_not_used_in_a_later_run_either() -> None:
    bench = at_50_mm()
    bench.memory.put(ACTUAL, 70_000)
    moved = bench.restarted()
    assert moved.kinds() == ["line-up", "record-not-used"]
    moved.memory.put(ACTUAL, 50_010)
    assert moved.restarted().kinds() == ["line-up"]


def test_m11_a_group_is_restored_whole_or_not_at_all() -> None:
    """The table of one axis was replaced meanwhile, and the one in force was not kept."""
    x = axis_plan()
    y = axis_plan(name="y", command=(Y_COMMAND,), actual=(Y_ACTUAL,))
    bench = RecordBench(x, y, groups=[["x", "y"]])
    for command, actual in ((COMMAND, ACTUAL), (Y_COMMAND, Y_ACTUAL)):
        for counts in (20_000, 50_000):
            bench.ask(write(command, counts))
            bench.memory.put(actual, bench.memory.get(command))
            bench.ask(read(actual))
    for plans in ((replace(x, table=HIGHER), y), (x, replace(y, table=HIGHER))):
        assert bench.restarted(*plans).kinds() == ["line-up", "record-not-used", "record-not-used"]
    assert bench.restarted().kinds() == ["line-up", "restored", "restored"]


class SilentY(Memory):
    """A converter, which does not reach the drive of y."""

    is_reached = False

    def answer(self, pdu: bytes) -> bytes:
        is_of_y = pdu[1:3] in (Y_COMMAND.address.to_bytes(2, "big"), Y_ACTUAL.address.to_bytes(2, "big"))
        return bytes((pdu[0] | 0x80, 0x0B)) if is_of_y and not self.is_reached else super().answer(pdu)


def test_m11_an_axis_that_waits_for_the_record_of_another_one_says_that_it_reads_1_to_1() -> None:
    x = axis_plan()
    y = axis_plan(name="y", unit_id=2, command=(Y_COMMAND,), actual=(Y_ACTUAL,))
    bench = RecordBench(x, y, groups=[["x", "y"]])
    for unit_id, command, actual in ((1, COMMAND, ACTUAL), (2, Y_COMMAND, Y_ACTUAL)):
        for counts in (20_000, 50_000):
            bench.ask(write(command, counts), unit_id=unit_id)
            bench.memory.put(actual, bench.memory.get(command))
            bench.ask(read(actual), unit_id=unit_id)
    memory = SilentY()
    memory.words = dict(bench.memory.words)
    again = RecordBench(x, y, records=bench.records, memory=memory, groups=[["x", "y"]])
    x_axis, y_axis = again.line.axes
    assert again.actual() == 50_010  # 10 counts beside what the controller commanded
    assert again.told == []
    assert axis_status(x_axis, again.now_ns).reads_uncorrected
    memory.is_reached = True
    again.wait(60_000)
    again.ask(read(Y_ACTUAL), unit_id=2)
    assert again.kinds().count("restored") == 2
    assert again.actual() == 50_000
    assert not any(axis_status(each, again.now_ns).reads_uncorrected for each in (x_axis, y_axis))


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


def stream_without_reference(**changes: Any) -> RecordBench:
    """A stream up to 23 950, the gateway killed, its homed bit clear after that, and its record used."""
    bench = RecordBench(stream_plan(referenced=Reference.DRIVE_BIT, bits=BITS, **changes))
    bench.memory.words[STATUS_WORD] = HOMED
    for counts in range(20_000, 24_000, 50):
        bench.ask(write(COMMAND, counts))
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        bench.ask(read(ACTUAL))
        bench.now_ns += 10_000_000
    bench.memory.words[STATUS_WORD] = 0
    again = bench.restarted()
    report(again, 0)
    again.actual()
    assert "restored" in again.kinds()
    assert axis_of(again).motion.state is MotionState.STOPPED
    return again


def test_a_stream_that_lost_its_reference_keeps_only_its_correction_in_force() -> None:
    """Its homed bit is clear after the kill: positions pass 1:1, and the correction in force fades out."""
    again = stream_without_reference()
    assert again.memory.get(COMMAND) == 23_960
    offsets = []
    for counts in range(23_950, 26_000, 50):
        again.ask(write(COMMAND, counts))
        offsets.append(again.memory.get(COMMAND) - counts)
        again.memory.put(ACTUAL, again.memory.get(COMMAND))
    assert (offsets[0], offsets[-1]) == (10, 0)


def test_a_stream_that_lost_its_reference_keeps_the_offset_of_its_last_setpoint() -> None:
    """The table has 0.5 % of the position: 119.75 there. Half of it is left after half of the 2 mm."""
    table = make_table([0, 100], [0.0, 0.5], [0.0, 0.5], Units.MM)
    again = stream_without_reference(table=table, reload_distance=2.0)
    assert again.memory.get(COMMAND) == 24_070
    for counts in range(23_950, 24_951, 50):
        again.ask(write(COMMAND, counts))
        again.memory.put(ACTUAL, again.memory.get(COMMAND))
    assert again.memory.get(COMMAND) == 25_010


# === a distance or a target that was not seen acknowledged ===============================================

READ_STATUS = bytes.fromhex("03 005C 0001")
START, END = 50_010, 34_990
"""Where the distance of -15 mm from 50 mm begins, forward, and where it ends, backward; it lies on the way
from 20 mm, so that the axis may have been stopped there as well."""


class Started(StagedBench):
    """A gateway that is started at an instant, with a drive in its present state."""

    def __init__(
        self, records: Records, drive: StagedDrive, start_ns: int, plan: AxisPlan | None = None, **others: Any
    ) -> None:
        def attach(line: Any) -> None:
            self.now_ns = start_ns
            self.memory = self.drive = drive
            records.attach(line)

        super().__init__(plan or staged_plan(), before_up=attach, **others)
        self.drive = drive

    @property
    def accepted(self) -> object:
        """The last target that counts."""
        return self.line.axes[0].compensation.accepted


def unsure(bench: Bench) -> bool:
    return bench.line.axes[0].is_unsure


def is_open(bench: Bench) -> bool:
    return bench.line.axes[0].motion.is_distance_unconfirmed


def killed(*, runs: bool = True, distance: int = -15_000, **changes: Any) -> tuple[StagedBench, Records]:
    """Return an axis that went from 20 to 50 mm unseen, and then got a distance; the gateway was killed
    before its reply."""
    records = Records()
    bench = StagedBench(staged_plan(**changes), before_up=records.attach)
    bench.go_to(20_000)
    bench.run(50_000)
    bench.drive.arrive()
    bench.stage(distance)
    bench.send(RUN_RELATIVE_PDU)
    while (pdu := bench.link.take()) != RUN_RELATIVE_PDU:
        bench.line.reply(1, bench.memory.answer(pdu), bench.now_ns)
    record = records.read()
    assert record is not None
    assert record.unacknowledged is not None
    assert not record.was_at_target
    if runs:
        bench.memory.answer(pdu)
        assert bench.drive.moves[-1] == ("relative", float(START + distance - 20))
        bench.drive.arrive()
        assert bench.drive.words[STATUS] & 1 << 4
    return bench, records


def again(bench: StagedBench, records: Records, after_ms: float, plan: AxisPlan | None = None) -> Started:
    return Started(records.copy(), bench.drive, bench.now_ns + int(after_ms * MS), plan)


# --- a distance that ends on the way of the target before ---------------------------------------------------


def test_m5_a_distance_executed_before_a_kill_counts_once_its_end_was_seen_twice() -> None:
    """Before: "the drive is at 34990 counts: a lost target…", it read 34 990, and a distance
    went from there."""
    bench, records = killed()
    started = again(bench, records, 1_300)
    # Where it stands, then whether it is done, and where it stands twice more.
    assert started.seen == [read(ACTUAL), READ_STATUS, read(ACTUAL), read(ACTUAL)]
    assert "restored" in started.kinds()
    assert started.actual() == 35_000
    assert not unsure(started)
    assert started.accepted == (35_000, END)
    assert started.run(-5_000, RUN_RELATIVE_PDU) == ("relative", 29_990.0)


def test_m5_a_servo_with_a_standing_error_counts_as_at_the_end_too() -> None:
    bench, records = killed()
    bench.drive.arrive(standing_error=8)
    started = again(bench, records, 1_300)
    assert started.actual() == 35_008
    assert not unsure(started)
    assert started.accepted == (35_000, END)


def test_m5_a_distance_that_never_reached_the_drive_is_void_once_its_start_was_seen_twice() -> None:
    bench, records = killed(runs=False)
    started = again(bench, records, 1_300)
    assert started.actual() == 50_000
    assert not unsure(started)
    assert started.accepted == (50_000, START)
    assert started.run(5_000, RUN_RELATIVE_PDU) == ("relative", 55_010.0)


@pytest.mark.parametrize("place", [START, END])
def test_m5_no_reading_counts_before_done_drop_ms_have_passed(place: int) -> None:
    """Until 1,000 ms have passed the done bit may be that of the move before: no more reads are sent."""
    bench, records = killed(runs=place == END)
    started = again(bench, records, 400)
    assert started.seen == [read(ACTUAL)]
    assert started.actual() == (50_000 if place == START else 35_000)
    assert unsure(started)
    started.stage(-5_000)
    assert started.refused(RUN_RELATIVE_PDU) == 6
    started.wait(700)
    started.seen.clear()
    started.trigger(RUN_RELATIVE_PDU)  # looked at twice for it
    assert started.seen[:3] == [READ_STATUS, read(ACTUAL), read(ACTUAL)]
    assert started.drive.moves[-1] == ("relative", 44_990.0 if place == START else 29_990.0)
    assert not unsure(started)


def test_m5_the_end_of_a_drive_that_starts_late_counts_once_it_was_seen_twice() -> None:
    """At 400 ms it stands at the start, done: it starts at 600 ms, and is at the end at 1,400 ms."""
    bench, records = killed(runs=False)
    started = again(bench, records, 400)
    assert started.actual() == 50_000
    started.wait(200)
    started.drive.act(2)
    started.drive.arrive()
    started.wait(800)
    started.poll()
    started.actual()
    assert unsure(started)
    started.actual()
    assert started.actual() == 35_000
    assert started.accepted == (35_000, END)


def test_m5_an_axis_that_is_not_done_counts_as_at_neither_end() -> None:
    """It passes the end of the distance on its way to the target before: done is down."""
    bench, records = killed(runs=False)
    bench.drive.put(ACTUAL, END)
    bench.drive.set_bits(is_done=False)
    started = again(bench, records, 1_300)
    assert unsure(started)
    started.stage(-5_000)
    assert started.refused(RUN_RELATIVE_PDU) == 6
    started.wait(500)
    started.drive.put(COMMANDED, START)
    started.drive.arrive()
    started.poll()
    started.actual()
    started.actual()
    assert started.actual() == 50_000
    assert started.accepted == (50_000, START)
    assert not unsure(started)


def test_m5_an_axis_seen_once_at_an_end_and_then_elsewhere_counts_as_at_neither_end() -> None:
    bench, records = killed()
    started = again(bench, records, 400)
    started.wait(700)
    started.poll()
    assert started.actual() == 35_000
    started.drive.put(ACTUAL, 34_900)
    started.actual()
    started.drive.put(ACTUAL, END)
    started.actual()
    assert is_open(started)
    started.actual()
    assert not is_open(started)


def test_m5_two_readings_of_an_axis_that_creeps_through_the_window_prove_nothing() -> None:
    """Eight counts further between them: within the window of 20, not within the hysteresis of 2."""
    bench, records = killed()
    started = again(bench, records, 400)
    started.wait(700)
    started.poll()
    for counts in (END - 12, END - 4, END + 4, END + 12):
        started.drive.put(ACTUAL, counts)
        started.actual()
    assert is_open(started)


def test_m5_the_direction_is_unknown_if_the_machine_was_switched_off_meanwhile() -> None:
    bench, records = killed()
    for buffer in records.buffers.values():
        buffer[42:58] = bytes(16)  # the boot
    started = again(bench, records, 3_000)
    assert started.seen == [read(ACTUAL)]
    assert unsure(started)
    for _ in range(3):
        started.poll()
        started.actual()
    started.stage(-5_000)
    assert started.refused(RUN_RELATIVE_PDU) == 6
    # a target from where it stands: 60 mm is forward for certain
    assert started.run(60_000) == ("absolute", 60_010.0)
    assert not unsure(started)


def test_m5_after_a_power_cycle_no_reading_counts_before_done_drop_ms_have_passed_since_the_start() -> None:
    """The clock of another boot says nothing of when the distance was sent, 1.3 s before the start."""
    bench, records = killed(runs=False)
    for buffer in records.buffers.values():
        buffer[42:58] = bytes(16)  # the boot
    started = again(bench, records, 1_300)
    for after_ms, is_still_open in ((0, True), (900, True), (200, False)):
        started.wait(after_ms)
        started.poll()
        for _ in range(2):
            started.actual()
        assert is_open(started) is is_still_open
    assert started.accepted == (50_000, START)


def test_m5_ends_nearer_than_two_windows_prove_nothing() -> None:
    """30 counts there and 20 more for the branch are 50, in windows of 26 counts to both sides."""
    bench, records = killed(distance=-30, in_position=0.026)
    assert bench.drive.moves[-1] == ("relative", 49_960.0)
    started = again(bench, records, 1_300, staged_plan(in_position=0.026))
    assert unsure(started)
    for _ in range(3):
        started.poll()
        started.actual()
    started.stage(-5_000)
    assert started.refused(RUN_RELATIVE_PDU) == 6


def test_m5_the_start_of_a_distance_after_a_stop_is_unknown() -> None:
    bench = StagedBench(staged_plan(), before_up=(records := Records()).attach)
    bench.go_to(20_000)
    bench.run(50_000)
    bench.drive.pass_by(40_000)
    bench.trigger(STOP_PDU)
    bench.settle()
    bench.stage(-10_000)
    bench.send(RUN_RELATIVE_PDU)
    while (pdu := bench.link.take()) != RUN_RELATIVE_PDU:
        bench.line.reply(1, bench.memory.answer(pdu), bench.now_ns)
    bench.memory.answer(pdu)
    bench.drive.arrive()
    started = again(bench, records, 1_300)
    assert unsure(started)
    started.stage(-5_000)
    assert started.refused(RUN_RELATIVE_PDU) == 6
    started.trigger(STOP_PDU)  # a stop ends that: it is read where it stands, and flagged
    started.wait(1_100)
    started.trigger(RUN_RELATIVE_PDU)
    assert unsure(started)


def test_m5_a_distance_begins_where_the_drive_has_stopped_on_its_way_to_the_target_on_the_wire() -> None:
    """From 50 mm back to 20 mm: 35 000 there is 35 010. 5 mm more are 40 010, and forward 40 020."""
    bench = StagedBench(staged_plan(), before_up=(records := Records()).attach)
    bench.go_to(50_000)
    bench.stage(20_000)
    bench.send(RUN_PDU)
    bench.serve_reads()
    assert bench.link.sent == [(1, RUN_PDU)]
    bench.memory.answer(RUN_PDU)
    bench.drive.stand_at(35_000)
    started = again(bench, records, 1_300)
    assert started.actual() == 35_010
    started.wait(1_100)
    assert started.run(5_000, RUN_RELATIVE_PDU) == ("relative", 40_020.0)
    assert not unsure(started)


def test_m5_a_second_kill_restores_the_same_as_the_first() -> None:
    bench, records = killed()
    first = again(bench, records, 200)
    assert is_open(first)
    second = Started(records.copy(), bench.drive, first.now_ns + 300 * MS)
    assert is_open(second)
    third = Started(records.copy(), bench.drive, second.now_ns + 700 * MS)
    assert third.accepted == (35_000, END)
    assert third.actual() == 35_000


def test_m5_the_branch_of_the_next_target_is_decided_on_the_scale_of_the_drive() -> None:
    bench, records = killed()
    started = again(bench, records, 400)
    # its two branches are 35 015 and 34 995: it stands just short of both
    assert started.run(35_005) == ("absolute", 35_015.0)
    assert not unsure(started)


def test_m5_a_distance_has_the_time_of_its_trigger() -> None:
    """The target was rendered, and writing it again took 700 ms: the time to start begins with the
    trigger."""
    bench = StagedBench(staged_plan(), before_up=(records := Records()).attach)
    bench.go_to(20_000)
    bench.run(50_000)
    bench.drive.arrive()
    bench.stage(-15_000)
    bench.send(RUN_RELATIVE_PDU)
    while (pdu := bench.link.take()) != RUN_RELATIVE_PDU:
        if pdu[0] == 16:
            bench.now_ns += 700 * MS
        bench.line.reply(1, bench.memory.answer(pdu), bench.now_ns)
    record = records.read()
    assert record is not None
    assert record.unacknowledged is not None
    assert record.unacknowledged.state.at_ns == bench.now_ns


# --- the same of a target ----------------------------------------------------------------------------------


def retargeted() -> tuple[RecordBench, bytes]:
    """From 20 mm to 80 mm, and on the way, at 60 mm, back to 35 mm: on the wire, not answered."""
    bench = RecordBench(axis_plan())
    bench.move(20_000)
    bench.actual()
    bench.ask(write(COMMAND, 80_000))
    bench.memory.put(ACTUAL, 60_000)
    bench.wait(600)
    bench.send(write(COMMAND, 35_000))
    bench.serve_reads()
    pdu = bench.link.take()
    assert pdu == write(COMMAND, 34_990)
    return bench, pdu


@pytest.mark.parametrize("beside", [0, 7])
def test_m6_a_target_on_the_way_of_the_one_before_counts_once_it_was_seen_twice(beside: int) -> None:
    """Also of a servo that stands some counts off: it read 35 007 - 10, on the branch of 80 mm."""
    bench, pdu = retargeted()
    bench.memory.answer(pdu)
    bench.memory.put(ACTUAL, 34_990 + beside)
    bench.now_ns += 1_300 * MS
    started = bench.restarted()
    assert started.actual() == 35_000 + beside
    assert not unsure(started)
    assert started.move(35_000) == write(COMMAND, 34_990)
    assert started.move(36_000) == write(COMMAND, 36_010)


def test_m6_the_branch_is_flagged_until_the_target_was_seen_twice() -> None:
    bench, pdu = retargeted()
    bench.memory.answer(pdu)
    bench.memory.put(ACTUAL, 34_990)
    bench.now_ns += 300 * MS
    started = bench.restarted()
    assert started.actual() == 35_000
    assert unsure(started)
    started.wait(1_000)
    started.actual()
    started.actual()
    assert not unsure(started)


def test_m6_an_axis_that_continues_to_the_target_before_has_that_one() -> None:
    """The axis passed the lost target when it was read, and is at 80 mm 1.1 s later."""
    bench, _ = retargeted()
    bench.memory.put(ACTUAL, 34_990)
    bench.now_ns += 300 * MS
    started = bench.restarted()
    started.memory.put(ACTUAL, 80_010)
    started.wait(1_100)
    started.actual()
    assert started.actual() == 80_000
    assert not unsure(started)


# --- the table ---------------------------------------------------------------------------------------------


def test_every_reading_at_an_end_leads_where_the_table_says() -> None:
    """By hand: two readings at one end decide; a reading elsewhere begins the count again."""
    by_hand = walk("""
             one           two       at-start      at-end    none
    start    not-executed  at-start  not-executed  at-start  none
    end      executed      at-end    at-end        executed  none
    neither  one           two       two           two       none
    """)
    rows = PROOF_AFTER.items()
    assert by_hand == {
        (proof.value, end.value): then.value for proof, row in rows for end, then in row.items()
    }
