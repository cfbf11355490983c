"""What a record must not say any more: whatever moves an axis otherwise, or may have, changes it at once."""

import pytest

from gateway.exchange.axis.record_layout import Remembered
from gateway.exchange.control import switch
from gateway.exchange.plan import AxisPlan, Reference
from gateway.modbus.registers import PositionField, RegisterType
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Memory, axis_plan, monitor, read, write
from tests.exchange.record_bench import RecordBench, Records
from tests.exchange.staged_bench import (
    COMMANDED,
    HOME_PDU,
    JOG_PDU,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STOP_PDU,
    STORED_PDU,
    ZERO_PDU,
    StagedBench,
    staged_plan,
)
from tests.exchange.world_trace import played

UNKNOWN_PDU = bytes.fromhex("06 050E 0BAD")


def said(records: Records) -> Remembered:
    record = records.read()
    assert record is not None
    return record


def staged(plan: AxisPlan | None = None) -> tuple[StagedBench, Records]:
    """An axis that went from 0 to 50 mm and stands there, as its record says."""
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
def test_what_moves_an_axis_otherwise_ends_the_record_before_the_frame_goes_out(pdu: bytes) -> None:
    bench, records = staged()
    bench.send(pdu)
    while bench.link.sent[0][1] != pdu:  # words that were corrected are taken back first
        bench.line.reply(1, bench.memory.answer(bench.link.take()), bench.now_ns)
    assert records.read() is None
    bench.serve()
    assert records.read() is None


def test_a_stored_position_ends_it_too() -> None:
    bench, records = staged()
    assert bench.refused(STORED_PDU) == 4  # it never reaches the drive
    assert said(records).has_target
    switch(bench.line.axes, "x", is_on=False)
    bench.go_to(40_000)
    bench.send(STORED_PDU)
    assert records.read() is None


def test_a_stop_leaves_the_way_and_no_target() -> None:
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


@pytest.mark.parametrize("is_answered", [False, True])
def test_a_distance_begins_where_a_stop_has_ended_the_way_before_a_kill(is_answered: bool) -> None:
    """M5: from 50 mm (50,010) to 20 mm (19,990), and stopped half-way, at 35,000: half of the difference has
    faded, so that reads 35 mm. 5 mm more are forward, 40,010, whether the stop was answered or not."""
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


def test_the_record_is_written_before_the_frame_goes_out_and_again_after_the_reply() -> None:
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


def test_several_targets_of_an_axis_in_one_frame_leave_none_that_a_record_could_name() -> None:
    """It may be on its way to any of the three: what is named has to be all that is open."""
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
def test_a_refused_target_is_as_the_register_map_says(writes_nothing: bool) -> None:
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


def test_a_half_that_was_lost_on_the_way_leaves_the_words_unknown() -> None:
    records = Records()
    bench = Bench(axis_plan(), before_up=records.attach, serial=False)
    bench.move(50_000)
    assert said(records).knows_words
    bench.send(read(ACTUAL), monitor())
    bench.send(bytes.fromhex("06 0606 0001"))
    bench.line.controller_gone(bench.port, bench.now_ns)
    record = said(records)
    assert (record.nominal_counts, record.knows_words) == (50_000, False)


def test_a_lost_line_leaves_the_record_and_what_comes_back_ends_it() -> None:
    bench, records = staged()
    before = said(records)
    bench.send(read(ACTUAL))
    bench.line.link_down(bench.now_ns)
    assert said(records) == before
    bench.link.sent.clear()
    bench.line.link_up(bench.now_ns)
    assert records.read() is None  # this run has forgotten the target, and so has the record


def test_a_register_that_moves_others_about_ends_it() -> None:
    remap = PositionField(0x0900, RegisterType.INT16)
    records = Records()
    bench = Bench(axis_plan(remapping=(remap,)), before_up=records.attach)
    bench.move(50_000)
    bench.send(write(remap, 1))
    assert records.read() is None
    bench.serve()
    assert records.read() is None


def test_switching_off_is_no_motion_and_the_record_follows_with_the_next_target() -> None:
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
    """A distance of -30 mm from 50 mm: on the wire, not answered."""
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


def test_m5_a_distance_on_the_wire_counts_where_its_end_is_found() -> None:
    bench, records = relative_bench()
    bench.memory.answer(bench.link.take())
    assert bench.drive.moves[-1] == ("relative", 19_990.0)
    bench.drive.arrive()
    again = restarted(bench, records)
    assert again.actual() == 20_000
    accepted = again.line.axes[0].compensation.accepted
    assert accepted == (20_000, 19_990)


def test_m5_a_distance_that_never_arrived_leaves_no_base() -> None:
    bench, records = relative_bench()
    again = restarted(bench, records)
    assert "restored" in again.kinds()
    assert again.actual() == 50_000
    assert again.line.axes[0].compensation.accepted is None


def test_m5_an_axis_found_on_its_way_is_no_base_for_a_distance() -> None:
    bench, records = staged()
    bench.run(20_000)
    bench.drive.put(ACTUAL, 30_000)
    bench.drive.put(COMMANDED, 30_000)
    expected = bench.actual()
    again = restarted(bench, records)
    assert again.actual() == expected
    assert again.line.axes[0].compensation.accepted is None


@pytest.mark.parametrize("found", [50_010, 19_990, 35_000])
def test_either_target_counts_where_it_is_found(found: int) -> None:
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


# --- traces that ``make verify`` found --------------------------------------------------------------------


def test_a_gateway_that_was_killed_does_not_take_the_start_of_the_last_way_for_known() -> None:
    """M6: its record keeps the fade of the reading, and not that it fades from a start that was assumed.

    9007 is 9172.10 forward and 8936.08 backward, half-way 9054.09; 9019 half-way 9066.24.
    """
    world = played(
        "killed-near",
        """
        read, ack: 03 0520 0002 -> 0000 0000
        to 0: 10 0606 0002 04 232F 0000, obey: 10 0606 0002 04 23D4 0000, arrive  # 9172, not acknowledged
        kill, to 1: 10 0606 0002 04 233B 0000, ack: 03 0520 0002 -> 23D4 0000  # 9019
        ack: 10 0606 0002 04 236A 0000                                         # half-way to 9066, flagged
        kill, ack: 03 0520 0002 -> 23D4 0000                                   # it has not begun to move
        to 0, has: 10 0606 0002 04 235E 0000                                   # not 22E8, as it was sent
        """,
    )
    assert world.is_sending_unsure()


def test_a_gateway_that_was_killed_takes_no_target_for_reached_where_the_way_before_begins_there() -> None:
    """M6: 9007 was given again and not answered before the axis had begun to go from there to 9019.

    9007 is 9172.10 forward and 8936.08 backward, 9019 forward 9184.29.
    """
    played(
        "killed-near",
        """
        to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 23D4 0000, arrive  # forward to 9172
        to 1: 10 0606 0002 04 233B 0000, ack: 03 0520 0002 -> 23D4 0000, ack: 10 0606 0002 04 23E0 0000
        to 0, ack: 03 0520 0002 -> 23D4 0000    # it has not begun to move
        kill, ack: 03 0520 0002 -> 23D4 0000    # 10 0606 0002 04 23D4 0000 never came
        arrive, to 0                            # it stands at 9184
        ack: 03 0520 0002 -> 23E0 0000          # not 10 … 23D4: that would be forward
        has: 10 0606 0002 04 22E8 0000
        """,
    )


def test_a_record_leaves_open_which_of_two_targets_sent_an_axis_to_one_on_the_way_to_the_other() -> None:
    """M6, 5: the axis may have gone back, or not have begun yet. It reads 203, where it was sent, flagged.

    9007 is 9172 forward; 203 is 34.92 backward.
    """
    world = played(
        "s-killed-onward",
        """
        to 2: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 23D4 0000                                   # the way is 0 to 9172
        to 0: 10 0606 0002 04 00CB 0000, ack: 03 0520 0002 -> 05DD 0000  # seen at 1501
        obey: 10 0606 0002 04 0023 0000                                  # back to 35, not acknowledged
        kill, ack: 03 0520 0002 -> 05DD 0000, arrive, kill, ack: 03 0520 0002 -> 0023 0000
        """,
    )
    assert [event.kind.name for event in world.told] == ["restored", "direction-unsure"]
    assert round(world.sides[0].line.axes[0].motion.nominal_of(35)) == 203


def test_a_record_counts_at_each_kill_as_at_the_first() -> None:
    """5: a setpoint is lost, the axis stands at the one before. A start keeps what its record says."""
    lost = """
        to 0: 10 0606 0002 04 03EB 0000, ack: 03 0520 0002 -> 0000 0000, ack  # 1003
        to 2: 10 0606 0002 04 232F 0000
        ack: 10 0606 0002 04 235E 0000          # 9054, half of its blend has gone
        to 0, has: 10 0606 0002 04 034C 0000    # never acknowledged
        arrive                                  # at 9054
    """
    for kills in (1, 2, 3):
        world = played("s-killed-stream", lost + kills * "kill, ack: 03 0520 0002 -> 235E 0000\n")
        assert [event.kind.name for event in world.told] == ["restored"]
        assert world.said(0).direction == "forward"
