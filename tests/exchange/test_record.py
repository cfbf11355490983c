"""Records: a gateway that was killed is restored from them, with the same words and readings."""

from typing import Any, Final

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gateway.compensation.fingerprint import table_digest
from gateway.compensation.settings import Gain, Outside, OutsideKind, Reversal, ReversalKind, Setpoints
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import DIRECT
from gateway.exchange.axis.record import digest_of_axis
from gateway.exchange.axis.record_layout import Remembered
from gateway.exchange.commands import Disable, Enable, SetReference
from gateway.exchange.control import clear_table, switch
from gateway.exchange.plan import AxisPlan, CompensationMode, Reference
from gateway.exchange.status import axis_status
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import (
    ACTUAL,
    COMMAND,
    LOST_MOTION,
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
    HOME_PDU,
    HOMED_BIT,
    JOG_PDU,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STATUS,
    STOP_PDU,
    STORED_PDU,
    ZERO_PDU,
    StagedBench,
    StagedDrive,
    staged_plan,
)
from tests.soak import repeated

SCREW = make_table([0, 30, 55, 100], [0.02, 0.14, -0.06, 0.1], [0.0, 0.09, -0.1, 0.07], Units.MM)
Op = tuple[str, int, float]


class SilentDrive(Memory):
    """Refuses everything."""

    def answer(self, pdu: bytes) -> bytes:
        return bytes((pdu[0] | 0x80, 6))


def play(bench: RecordBench, ops: list[Op]) -> list[object]:
    """Let a controller command and read; return all that it and the drive got."""
    seen: list[object] = []
    before = len(bench.writes)
    for what, number, share in ops:
        if what in ("move", "follow"):
            start = bench.memory.get(ACTUAL if what == "move" else COMMAND)
            assert bench.ask(write(COMMAND, number))[0] == 16
            told = bench.memory.get(COMMAND)
            bench.memory.put(ACTUAL, round(start + share * (told - start)))
            bench.wait(100.0)
        elif what == "arrive":
            bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
            bench.wait(100.0)
        elif what == "switch":
            switch(bench.line.axes, "x", is_on=bool(number))
        else:
            seen.append(bench.actual())
    return [*seen, *bench.writes[before:]]


def is_enabled(ops: list[Op]) -> int:
    switches = [number for what, number, _ in ops if what == "switch"]
    return switches[-1] if switches else 1


NEAR: Final = 100
"""Counts: more than a correction of the screw."""


def is_called_back(ops: list[Op], at: int) -> bool:
    """Whether an axis that has not left is called back after the kill to where it was before, or near that.

    Without the kill its start is known, and it is flagged; after the kill it counts as on its way.
    """
    *earlier, (what, _, share) = [op for op in ops[:at] if op[0] in ("move", "arrive")]
    before = {number for what, number, _ in earlier if what == "move"}
    is_near = any(abs(op[1] - number) <= NEAR for op in ops[at:] if op[0] == "move" for number in before)
    return (what, share) == ("move", 0.0) and is_near


targets = st.tuples(st.just("move"), st.integers(0, 100_000), st.sampled_from([0.0, 0.3, 0.8, 1.0]))
others = st.tuples(st.sampled_from(["arrive", "read"]), st.just(0), st.just(0.0))
switches = st.tuples(st.just("switch"), st.integers(0, 1), st.just(0.0))


@st.composite
def streams(draw: st.DrawFn) -> list[Op]:
    """Setpoints near each other, some repeated, with reversals; the drive follows or lags a little."""
    at = draw(st.integers(20_000, 80_000))
    ops: list[Op] = []
    steps = st.one_of(st.integers(-400, 400), st.integers(-2, 2))
    for step in draw(st.lists(steps, min_size=2, max_size=40)):
        at += step
        ops.append(("follow", at, draw(st.sampled_from([0.0, 0.5, 1.0])) if ops else 1.0))
        if draw(st.booleans()):
            ops.append(draw(others))
        if draw(st.integers(0, 8)) == 0:
            ops.append(draw(switches))
    return ops


def check_goes_on(plan: AxisPlan, ops: list[Op], at: int) -> RecordBench:
    bench = RecordBench(plan)
    play(bench, ops[:at])
    bench.actual()  # what the start of the other one reads
    again = bench.restarted()
    assert "restored" in again.kinds()
    again.now_ns = bench.now_ns
    if not is_enabled(ops[:at]):  # the configuration decides after a start: tell it the same
        switch(again.line.axes, "x", is_on=False)
    rest = [("read", 0, 0.0), *ops[at:], ("read", 0, 0.0), ("arrive", 0, 0.0), ("read", 0, 0.0)]
    assert play(again, rest) == play(bench, rest)
    return again


@settings(max_examples=repeated(500))
@given(st.lists(st.one_of(targets, targets, others, switches), min_size=1, max_size=12), st.data())
def test_targets_continue_after_a_kill_with_the_same_words_and_readings(ops: list[Op], data: Any) -> None:
    ops = [("move", 50_000, 1.0), ("arrive", 0, 0.0), *ops]
    at = data.draw(st.integers(2, len(ops)))
    assume(not is_called_back(ops, at))
    check_goes_on(axis_plan(table=SCREW), ops, at)


@settings(max_examples=repeated(500))
@given(
    streams(),
    st.sampled_from(
        [
            None,
            Reversal(ReversalKind.CYCLES, 7),
            Reversal(ReversalKind.STEP),
            Reversal(ReversalKind.TIME_MS, 900),
        ]
    ),
    st.data(),
)
def test_setpoints_continue_after_a_kill_with_the_same_words(
    ops: list[Op], reversal: Reversal | None, data: Any
) -> None:
    at = data.draw(st.integers(1, len(ops)))
    check_goes_on(stream_plan(table=SCREW, reversal=reversal, reload_distance=1.5), ops, at)


def test_a_change_over_requested_before_the_kill_is_made_after_it() -> None:
    """Off and on again without a setpoint between: the correction in force is not the requested one."""
    ops: list[Op] = [("follow", at, 1.0) for at in (30_000, 31_000, 32_000, 33_000)]
    ops += [("switch", 0, 0.0), ("switch", 1, 0.0)]
    ops += [("follow", at, 1.0) for at in (33_400, 33_800, 33_600, 33_200, 32_800, 32_000)]
    check_goes_on(stream_plan(table=SCREW), ops, 6)


def test_m1_a_half_after_a_restart_is_completed_from_the_record() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    again = bench.restarted()
    part = bytes.fromhex("06 0606") + (20_001).to_bytes(2, "big")
    assert again.ask(part) == part
    assert again.writes == [write(COMMAND, 20_011)]  # one count forward, as far as a reading tells
    assert again.line.axes[0].is_unsure
    assert read(COMMAND) not in again.seen


@settings(max_examples=repeated(400))
@given(streams(), st.integers(11, 400), st.booleans(), st.data())
def test_a_reading_after_the_kill_decides_about_a_setpoint_on_the_wire(
    ops: list[Op], step: int, has_arrived: bool, data: Any
) -> None:
    ops = [op for op in ops if op[0] == "follow"]
    bench = RecordBench(stream_plan(table=SCREW))
    play(bench, ops)
    at = ops[-1][1] + data.draw(st.sampled_from([-step, step]))
    bench.send(write(COMMAND, at))
    pdu = bench.link.take()
    if has_arrived:
        bench.memory.answer(pdu)
    bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
    again = bench.restarted()
    assert "restored" in again.kinds()
    if has_arrived:  # the run that was not killed gets its reply
        bench.line.reply(1, pdu[:5], bench.now_ns)
    else:  # and where it was lost on the way, what was before is what counts
        bench = RecordBench(stream_plan(table=SCREW))
        play(bench, ops)
    bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
    bench.port.replies.clear()
    bench.actual()
    again.now_ns = bench.now_ns
    rest = [("follow", at + i * step, 1.0) for i in (1, 2, 3, 1, -1)]
    rest = [each for op in rest for each in (op, ("read", 0, 0.0))]
    assert play(again, [("read", 0, 0.0), *rest]) == play(bench, [("read", 0, 0.0), *rest])


def test_a_standing_axis_reads_its_target_and_repeats_it_with_the_same_words() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000)
    assert bench.reach(20_000) == 19_990
    again = bench.restarted()
    [told] = again.told
    assert told == (
        "goes on from its record: nominal 20 mm, the drive at 19990 counts, backward, progress of a reversal "
        "0, of a change-over 1, generation 4"
    )
    assert again.actual() == 20_000
    assert ACTUAL.unpack(again.ask(read(COMMAND))[2:]) == 20_000
    assert again.move(20_000) == write(COMMAND, 19_990)
    assert again.actual() == 20_000


def test_without_a_record_the_reading_jumps_by_the_correction() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    bench.records.buffers["x"] = bytearray(len(bench.records.buffers["x"]))
    again = bench.restarted()
    assert again.told == []
    assert again.actual() == 19_990


def test_readings_do_not_jump_after_a_kill_in_the_middle_of_a_move() -> None:
    """10 to 30 mm forward after a backward move: 20 counts are faded out over 20 mm."""
    bench = RecordBench(axis_plan())
    bench.move(50_000, 10_000)
    bench.ask(write(COMMAND, 30_000))
    bench.memory.put(ACTUAL, 20_000)
    expected = bench.actual()
    assert expected == 20_000  # 19 990 through the new map, and half of 20 counts
    again = bench.restarted()
    assert again.actual() == expected
    again.memory.put(ACTUAL, 30_010)
    assert again.actual() == 30_000


def test_an_axis_moved_by_hand_meanwhile_starts_without_its_record() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    bench.actual()  # it was seen to arrive: its way does not count any more
    bench.memory.put(ACTUAL, 19_993)
    again = bench.restarted()
    assert again.told == [
        "the drive is at 19993 counts, and the record says at 19990; it starts without its record"
    ]
    assert again.records.read() is None
    assert again.actual() == 19_993


def reads_uncorrected(bench: RecordBench) -> bool:
    return axis_status(bench.line.axes[0], bench.now_ns).reads_uncorrected


def test_the_status_says_that_such_an_axis_reads_uncorrected_until_its_first_target() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    bench.actual()
    assert not reads_uncorrected(bench)
    assert not reads_uncorrected(bench.restarted())  # goes on from its record
    bench.memory.put(ACTUAL, 19_993)
    again = bench.restarted()
    assert again.actual() == 19_993
    assert reads_uncorrected(again)
    again.line.command(Disable(axes=("x",)), again.now_ns)
    assert not reads_uncorrected(again)  # off, which says as much
    again.line.command(Enable(axes=("x",)), again.now_ns)
    assert reads_uncorrected(again)
    again.move(50_000)
    assert not reads_uncorrected(again)
    assert again.actual() == 50_000


@pytest.mark.parametrize("was_homed", [True, False])
def test_an_axis_that_is_homed_after_the_start_reads_right(was_homed: bool) -> None:
    bench = RecordBench(staged_plan(referenced=Reference.DRIVE_BIT, motion=DIRECT), memory=StagedDrive())
    bench.move(50_000, 20_000)
    bench.memory.put(ACTUAL, 60_000)
    bench.memory.write(STATUS, (was_homed << HOMED_BIT).to_bytes(2, "big"))
    again = bench.restarted()
    assert reads_uncorrected(again) is was_homed
    for is_homed in (False, True):
        again.memory.write(STATUS, (is_homed << HOMED_BIT).to_bytes(2, "big"))
        again.ask(bytes.fromhex("03 005C 0001"))
    assert axis_status(again.line.axes[0], again.now_ns).compensation == "active"
    assert not reads_uncorrected(again)


def test_a_record_counts_if_the_axis_is_within_the_hysteresis() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    bench.actual()
    bench.memory.put(ACTUAL, 19_992)
    assert bench.restarted().actual() == 20_002


@pytest.mark.parametrize(
    "changes",
    [
        {"counts_per_unit": 1000.5},
        {"zero_counts": 1.0},
        {"machine_offset": 0.5},
        {"outside": Outside(OutsideKind.REFUSE)},
        {"setpoints": Setpoints.STREAM},
        {"unit_id": 2},
        {"actual": (PositionField(0x0530, RegisterType.INT32, WordOrder.LOW_FIRST),)},
    ],
)
def test_a_record_made_under_other_settings_does_not_count(changes: dict[str, Any]) -> None:
    assert digest_of_axis(axis_plan(**changes)) != digest_of_axis(axis_plan())


def test_settings_that_do_not_change_the_scale_do_not_end_the_record() -> None:
    for changes in ({"gain": Gain(0.5, 0.5)}, {"max_speed": 1.0}, {"table": SCREW}, {"lost_ms": 5.0}):
        assert digest_of_axis(axis_plan(**changes)) == digest_of_axis(axis_plan())


@pytest.mark.parametrize(
    ("plan", "why"),
    [
        ({"table": SCREW}, "the table that was in force is not the one configured now"),
        ({"compensation": CompensationMode.OFF}, "the compensation of the axis is off"),
    ],
)
def test_a_record_does_not_count_with_another_table_or_without_compensation(
    plan: dict[str, Any], why: str
) -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    again = bench.restarted(axis_plan(**plan))
    assert again.told == [f"{why}; it starts without its record"]
    assert again.actual() == 19_990
    assert "table" in plan or again.records.read() is None


@pytest.mark.parametrize(
    ("plan", "told"),
    [({"table": SCREW}, 10_030), ({"gain": Gain(0.5, 0.5)}, 9_995)],  # 20 to 10 mm: a third of 0.09 mm
)
def test_the_old_table_or_gain_stays_in_force_until_the_next_different_target(
    plan: dict[str, Any], told: int
) -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    tables = {table_digest(LOST_MOTION): LOST_MOTION}
    again = bench.restarted(axis_plan(**plan), find_table=tables.get if "table" in plan else None)
    assert again.actual() == 20_000
    assert again.move(20_000) == write(COMMAND, 19_990)
    assert again.move(10_000) == write(COMMAND, told)


@pytest.mark.parametrize("referenced", [Reference.HOMING, Reference.SET_POSITION])
def test_a_reference_by_homing_or_set_position_is_not_restored(referenced: Reference) -> None:
    bench = RecordBench(staged_plan(referenced=referenced, motion=DIRECT))
    bench.line.command(SetReference(axis="x"), bench.now_ns)
    bench.move(50_000)
    assert bench.reach(20_000) == 19_990
    again = bench.restarted()
    assert again.told == ["the axis is not referenced now; it starts without its record"]
    assert again.actual() == 19_990


@pytest.mark.parametrize("is_homed", [True, False])
def test_a_homed_bit_is_read_before_the_record_counts(is_homed: bool) -> None:
    bench = RecordBench(staged_plan(referenced=Reference.DRIVE_BIT, motion=DIRECT), memory=StagedDrive())
    bench.move(50_000, 20_000)
    bench.memory.write(STATUS, (is_homed << HOMED_BIT).to_bytes(2, "big"))
    again = bench.restarted()
    assert [pdu.hex() for pdu in again.seen] == ["03005c0001", "0305200002"]
    assert again.actual() == (20_000 if is_homed else 19_990)


def test_without_added_reads_the_first_reading_of_the_controller_decides() -> None:
    bench = RecordBench(axis_plan(safe_read=False))
    bench.move(50_000)
    bench.actual()
    bench.move(20_000)
    told = bench.memory.get(ACTUAL)
    again = bench.restarted()
    assert (again.seen, again.told) == ([], [])
    assert again.actual() == 20_000
    assert told != 20_000
    assert "restored" in again.kinds()


def test_a_target_before_any_reading_ends_the_record() -> None:
    bench = RecordBench(axis_plan(safe_read=False))
    bench.move(50_000)
    again = bench.restarted()
    again.move(60_000)
    assert again.told == ["a target came before the axis was read; it starts without its record"]


def test_a_second_kill_before_the_drive_answered_does_not_change_the_record() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    records = bench.records.copy()
    silent = Bench(axis_plan(), before_up=records.attach, memory=SilentDrive())
    silent.line.tick(silent.line.deadline_ns or 0)
    assert records.read() == bench.records.read()
    silent.line.link_down(silent.now_ns)
    assert records.read() == bench.records.read()


class Dumb(Memory):
    """Refuses every request until ``speaks`` is set."""

    speaks = False

    def answer(self, pdu: bytes) -> bytes:
        return super().answer(pdu) if self.speaks else bytes((pdu[0] | 0x80, 6))


def test_the_reading_that_restores_an_axis_is_nominal_although_its_table_was_cleared() -> None:
    """At 20 mm, backward: the drive is at 19 990. The table is cleared before a reading has decided about the
    record."""
    before = RecordBench(axis_plan())
    before.move(50_000)
    before.reach(20_000)
    drive = Dumb()
    drive.words = dict(before.memory.words)
    find = {table_digest(LOST_MOTION): LOST_MOTION}.get
    again = RecordBench(
        *before.plans, records=before.records.copy(), memory=drive, find_table=find, start_ns=before.now_ns
    )
    clear_table(again.line.axes, "x")
    drive.speaks = True
    for _ in range(2):
        assert again.ask(read(ACTUAL)) == b"\x03\x04" + ACTUAL.pack(20_000)
    assert again.told[0].startswith("goes on from its record: nominal 20 mm")


# === what it must not say any more: whatever else moves an axis, or may have, changes it =================

UNKNOWN_PDU = bytes.fromhex("06 050E 0BAD")


def said(records: Records) -> Remembered:
    record = records.read()
    assert record is not None
    return record


def staged(plan: AxisPlan | None = None) -> tuple[StagedBench, Records]:
    """Return an axis that went from 0 to 50 mm, and its record, which says so."""
    records = Records()
    bench = StagedBench(plan or staged_plan(), before_up=records.attach)
    bench.go_to(50_000)
    record = said(records)
    assert (record.nominal_counts, record.corrected_counts) == (50_000, 50_010)
    assert (record.has_target, record.was_at_target, record.was_done_seen) == (True, True, True)
    assert record.unacknowledged is None
    return bench, records


@pytest.mark.parametrize(("readings", "was_there"), [((50_022, 50_010), True), ((50_010, 50_022), False)])
def test_the_newest_reading_decides_whether_it_is_at_its_target(
    readings: tuple[int, int], was_there: bool
) -> None:
    """Both lie in the window of 25 counts, but only one within the hysteresis of 2."""
    records = Records()
    bench = Bench(axis_plan(in_position=0.025), before_up=records.attach)
    bench.ask(write(COMMAND, 50_000))
    for counts in readings:
        bench.memory.put(ACTUAL, counts)
        bench.actual()
    assert said(records).was_at_target is was_there


@pytest.mark.parametrize(
    "pdu", [HOME_PDU, ZERO_PDU, JOG_PDU, UNKNOWN_PDU], ids=["home", "zero", "jog", "odd"]
)
def test_another_motion_ends_the_record_before_its_frame_is_sent(pdu: bytes) -> None:
    bench, records = staged()
    bench.send(pdu)
    while bench.link.sent[0][1] != pdu:  # words that were corrected are taken back first
        bench.line.reply(1, bench.memory.answer(bench.link.take()), bench.now_ns)
    assert records.read() is None
    bench.serve()
    assert records.read() is None


def test_a_stored_position_ends_the_record_too() -> None:
    bench, records = staged()
    assert bench.refused(STORED_PDU) == 4  # it never reaches the drive
    assert said(records).has_target
    switch(bench.line.axes, "x", is_on=False)
    bench.go_to(40_000)
    bench.send(STORED_PDU)
    assert records.read() is None


def test_a_stop_keeps_the_way_in_the_record_and_removes_the_target() -> None:
    bench, records = staged()
    bench.run(20_000)
    bench.send(STOP_PDU)
    for has_target in (True, False):  # while it is on the wire, and after its reply
        record = said(records)
        assert (record.has_target, record.was_at_target) == (has_target, False)
        assert record.way == (19_990.0, 50_010.0)
        assert record.state.direction == -1
        bench.serve()
        bench.port.replies.clear()
    bench.send(JOG_PDU)
    assert records.read() is None


def test_a_stop_after_a_target_that_was_not_acknowledged_ends_the_record_before_it_is_sent() -> None:
    """It ends one of two ways, and a record has room for a target on the wire, not for a stop as well."""
    bench, records = staged()
    bench.stage(20_000)
    bench.send(RUN_PDU)
    bench.serve_reads()
    assert bench.link.take() == RUN_PDU
    bench.wait(1_001)  # nobody answers
    bench.wait(1_001)  # the line is silent
    record = said(records)
    assert record.unacknowledged is not None
    assert record.unacknowledged.nominal_counts == 20_000
    bench.send(STOP_PDU)
    assert bench.link.take() == STOP_PDU
    assert records.read() is None


@pytest.mark.parametrize("is_answered", [False, True])
def test_a_distance_begins_where_a_stop_has_ended_the_way_before_a_kill(is_answered: bool) -> None:
    """M5: from 50 mm (50,010) to 20 mm (19,990), and stopped half-way at 35,000. Half of the difference has
    faded there, so the axis reads 35 mm. 5 mm more are forward, 40,010, whether the stop was answered or
    not."""
    bench, records = staged()
    bench.run(20_000)
    bench.send(STOP_PDU)
    if is_answered:
        bench.serve()
    again = StagedBench(staged_plan(), before_up=records.attach)
    for place in (ACTUAL, COMMANDED):
        again.memory.put(place, 35_000)
    again.drive.set_bits(is_done=True)
    again.serve()
    again.wait(1200)
    again.stage(5_000)
    assert again.ask(RUN_RELATIVE_PDU) == RUN_RELATIVE_PDU
    assert again.drive.moves == [("relative", 40_010)]


def test_a_staged_target_changes_nothing_until_its_trigger() -> None:
    bench, records = staged()
    before = said(records)
    bench.stage(20_000)
    assert said(records) == before
    bench.send(RUN_PDU)
    record = said(records)
    assert (record.nominal_counts, record.has_target) == (50_000, True)
    assert record.unacknowledged is not None
    assert (record.unacknowledged.nominal_counts, record.unacknowledged.corrected_counts) == (20_000, 19_990)
    bench.serve()
    record = said(records)
    assert (record.nominal_counts, record.unacknowledged) == (20_000, None)


def test_the_record_is_written_before_the_frame_is_sent_and_again_after_the_reply() -> None:
    records = Records()
    at_send: list[Remembered | None] = []
    at_reply: list[Remembered | None] = []
    bench = Bench(axis_plan(), before_up=records.attach)
    bench.move(50_000)
    send_request, send_reply = bench.link.send_request, bench.port.send_reply

    def noted_request(unit_id: int, pdu: bytes) -> None:
        at_send.append(records.read())
        send_request(unit_id, pdu)

    def noted_reply(transaction_id: int, unit_id: int, pdu: bytes) -> None:
        at_reply.append(records.read())
        send_reply(transaction_id, unit_id, pdu)

    bench.link.send_request = noted_request  # type: ignore[method-assign]
    bench.port.send_reply = noted_reply  # type: ignore[method-assign]
    bench.ask(write(COMMAND, 60_000))
    assert [r.unacknowledged.nominal_counts for r in at_send if r and r.unacknowledged] == [60_000]
    # The controller does not wait for the record: its reply is out before the target is taken as accepted.
    assert [r.nominal_counts for r in at_reply if r] == [50_000]
    assert said(records).nominal_counts == 60_000


def test_several_targets_of_an_axis_in_one_frame_end_the_record_until_the_reply() -> None:
    """The axis may be on its way to any of the three, and a record can name only one open target."""
    fields = [COMMAND, *(PositionField(COMMAND.address + 2 * i, RegisterType.INT32) for i in (1, 2))]
    records = Records()
    bench = Bench(axis_plan(command=tuple(fields)), before_up=records.attach)
    bench.ask(write(COMMAND, 50_000))
    bench.memory.put(ACTUAL, 50_010)
    bench.actual()
    assert said(records).has_target
    targets = b"".join(field.pack(counts) for field, counts in zip(fields, (1, 2, 3), strict=True))
    pdu = b"\x10" + COMMAND.address.to_bytes(2, "big") + b"\x00\x06\x0c" + targets
    bench.send(pdu)
    while bench.link.sent[0][1][0] != 0x10:
        bench.line.reply(1, bench.memory.answer(bench.link.take()), bench.now_ns)
    assert records.read() is None
    bench.line.reply(1, pdu[:5], bench.now_ns)
    assert said(records).nominal_counts == 3


@pytest.mark.parametrize("is_alarmed", [True, False])
def test_an_alarm_or_a_lost_reference_ends_the_record(is_alarmed: bool) -> None:
    bench, records = staged(staged_plan(referenced=Reference.DRIVE_BIT))
    bench.drive.set_bits(is_done=True, is_homed=is_alarmed, is_alarmed=is_alarmed)
    bench.poll()
    assert records.read() is None


def test_an_axis_that_something_else_moved_away_has_no_record() -> None:
    bench, records = staged()
    bench.actual()
    bench.drive.put(ACTUAL, 52_000)
    bench.actual()
    assert records.read() is None


def test_a_lost_reply_leaves_both_targets_possible() -> None:
    records = Records()
    bench = Bench(axis_plan(), before_up=records.attach)
    bench.move(50_000)
    bench.send(write(COMMAND, 20_000))
    bench.serve_reads()
    bench.link.sent.clear()
    for _ in range(2):
        record = said(records)
        assert record.nominal_counts == 50_000
        assert record.unacknowledged is not None
        assert record.unacknowledged.nominal_counts == 20_000
        bench.wait(1_001)  # nobody answers
    bench.wait(1_000)  # the line is silent
    bench.port.replies.clear()
    bench.send(write(COMMAND, 30_000))  # a third one: three places are more than a record says
    bench.serve_reads()
    assert records.read() is None
    bench.serve()
    assert said(records).nominal_counts == 30_000


@pytest.mark.parametrize("writes_nothing", [True, False])
def test_the_register_map_decides_what_a_refused_target_leaves_in_the_record(writes_nothing: bool) -> None:
    records = Records()
    bench = Bench(axis_plan(exception_writes_nothing=writes_nothing), before_up=records.attach)
    bench.move(50_000)
    bench.actual()
    bench.send(write(COMMAND, 60_000))
    bench.serve_reads()
    bench.link.sent.clear()
    bench.line.reply(1, bytes.fromhex("90 04"), bench.now_ns)
    record = said(records)
    assert record.nominal_counts == 50_000
    assert (record.unacknowledged is None) is writes_nothing


def test_a_lost_half_makes_the_words_unknown() -> None:
    records = Records()
    bench = Bench(axis_plan(), before_up=records.attach, serial=False)
    bench.move(50_000)
    assert said(records).knows_words
    bench.send(read(ACTUAL), monitor())
    bench.send(bytes.fromhex("06 0606 0001"))
    bench.line.controller_gone(bench.port, bench.now_ns)
    record = said(records)
    assert (record.nominal_counts, record.knows_words) == (50_000, False)


def test_a_lost_link_keeps_the_record_until_the_link_comes_up() -> None:
    bench, records = staged()
    before = said(records)
    bench.send(read(ACTUAL))
    bench.line.link_down(bench.now_ns)
    assert said(records) == before
    bench.link.sent.clear()
    bench.line.link_up(bench.now_ns)
    assert records.read() is None  # this run has forgotten the target, and so has the record


def test_a_write_to_a_remapping_register_ends_the_record() -> None:
    remap = PositionField(0x0900, RegisterType.INT16)
    records = Records()
    bench = Bench(axis_plan(remapping=(remap,)), before_up=records.attach)
    bench.move(50_000)
    bench.send(write(remap, 1))
    assert records.read() is None
    bench.serve()
    assert records.read() is None


def test_switching_off_reaches_the_record_with_the_next_target() -> None:
    records = Records()
    bench = Bench(axis_plan(), before_up=records.attach)
    bench.move(50_000)
    switch(bench.line.axes, "x", is_on=False)
    assert said(records).state.spec.digest
    bench.move(60_000)
    record = said(records)
    assert (record.corrected_counts, record.state.spec.digest) == (60_000, b"")


def restarted(bench: Bench, records: Records) -> RecordBench:
    memory = Memory()
    memory.words = dict(bench.memory.words)
    return RecordBench(staged_plan(), records=records.copy(), memory=memory, start_ns=bench.now_ns)


def relative_bench() -> tuple[StagedBench, Records]:
    """Return an axis with a distance of -30 mm from 50 mm on the wire, not answered."""
    bench, records = staged()
    bench.stage(-30_000)
    bench.send(RUN_RELATIVE_PDU)
    while bench.link.sent and bench.link.sent[0][1] != RUN_RELATIVE_PDU:
        _, pdu = bench.link.sent.pop(0)
        bench.line.reply(1, bench.memory.answer(pdu), bench.now_ns)
    record = said(records)
    assert record.unacknowledged is not None
    assert record.unacknowledged.is_distance
    return bench, records


def test_m5_a_distance_on_the_wire_counts_if_the_axis_is_at_its_end() -> None:
    bench, records = relative_bench()
    bench.memory.answer(bench.link.take())
    assert bench.drive.moves[-1] == ("relative", 19_990.0)
    bench.drive.arrive()
    again = restarted(bench, records)
    assert again.actual() == 20_000
    accepted = again.line.axes[0].compensation.accepted
    assert accepted == (20_000, 19_990)


def test_m5_a_distance_that_never_reached_the_drive_gives_no_base() -> None:
    bench, records = relative_bench()
    again = restarted(bench, records)
    assert "restored" in again.kinds()
    assert again.actual() == 50_000
    assert again.line.axes[0].compensation.accepted is None


def test_m5_an_axis_on_its_way_gives_no_base_for_a_distance() -> None:
    bench, records = staged()
    bench.run(20_000)
    bench.drive.put(ACTUAL, 30_000)
    bench.drive.put(COMMANDED, 30_000)
    expected = bench.actual()
    again = restarted(bench, records)
    assert again.actual() == expected
    assert again.line.axes[0].compensation.accepted is None


@pytest.mark.parametrize("found", [50_010, 19_990, 35_000])
def test_the_target_at_which_the_axis_is_counts(found: int) -> None:
    records = Records()
    bench = Bench(axis_plan(), before_up=records.attach)
    bench.move(50_000)
    bench.actual()
    bench.send(write(COMMAND, 20_000))
    bench.link.sent.clear()
    memory = Memory()
    memory.put(ACTUAL, found)
    again = RecordBench(axis_plan(), records=records.copy(), memory=memory, start_ns=bench.now_ns)
    # On the way: half of the 20 counts between both branches has been faded out.
    assert again.actual() == {50_010: 50_000, 19_990: 20_000, 35_000: 35_000}[found]
    again.memory.put(ACTUAL, 19_990)
    assert again.actual() == 20_000
