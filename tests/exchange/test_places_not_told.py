"""Where a reading cannot decide: an axis that something else has just moved, a drive that refuses to tell."""

from dataclasses import replace
from typing import Any

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action
from gateway.exchange.axis.reach import READABILITY_AFTER
from gateway.exchange.plan import ControllerPlan
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import (
    ACTUAL,
    COMMAND,
    MS,
    Bench,
    Memory,
    Port,
    axis_plan,
    read,
    stream_plan,
    write,
)
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import (
    COMMANDED,
    JOG_PDU,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STOP_PDU,
    StagedBench,
    StagedDrive,
    relative_by,
    staged_plan,
)
from tests.exchange.world_trace import played
from tests.support.tables import walk
from tests.verify.designs import BY_NAME

WORN = make_table([0, 200], [0.41, 0.41], [-0.26, -0.26], Units.MM)
"""410 counts more going forward, 260 less going backward."""
DONE = BitField(0x0031, 0)
BUSY, ADDRESS = bytes.fromhex("83 06"), bytes.fromhex("83 02")


def unsure(bench: Bench) -> bool:
    return bench.line.axes[0].is_unsure


# --- right after a motion that is no target: within done_drop_ms, 1,000 ms ----------------------------------


def jogged(at: int, *, ms: float = 300, is_done: bool = True, **changes: Any) -> StagedBench:
    """An axis that arrived at 45 mm forward, was jogged, and is somewhere then."""
    bench = StagedBench(staged_plan(table=WORN, **changes))
    bench.go_to(45_000)
    bench.trigger(JOG_PDU)
    bench.drive.put(ACTUAL, at)
    bench.drive.put(COMMANDED, at)
    bench.drive.set_bits(is_done=is_done)
    bench.wait(ms)
    return bench


@pytest.mark.parametrize(
    ("stands_at", "told", "is_flagged"),
    [
        (80_000, 59_740, False),  # beyond both branches of 60 mm, 60 410 and 59 740
        (50_000, 60_410, False),
        (60_100, 60_410, True),  # between them: it keeps its branch, forward
        (60_410, 60_410, True),  # just where one of them is: it may be passing by
        (59_740, 60_410, True),
    ],
)
def test_m6_an_axis_just_jogged_is_looked_at_and_may_be_flagged(
    stands_at: int, told: int, is_flagged: bool
) -> None:
    bench = jogged(stands_at)
    bench.stage(60_000)
    bench.seen.clear()
    bench.trigger(RUN_PDU)
    assert bench.seen[0] == read(ACTUAL)
    assert bench.drive.moves[-1] == ("absolute", float(told))
    assert unsure(bench) is is_flagged


def test_m6_a_second_later_it_stands_where_one_of_its_branches_is() -> None:
    bench = jogged(59_740, ms=1_001)
    assert bench.run(60_000) == ("absolute", 59_740.0)
    assert not unsure(bench)


def test_m6_a_jog_that_was_seen_to_end_needs_no_second() -> None:
    bench = jogged(59_740, is_done=False)
    bench.poll()
    bench.trigger(STOP_PDU)
    bench.poll()
    assert bench.run(60_000) == ("absolute", 59_740.0)
    assert not unsure(bench)


def test_m6_it_may_have_come_past_its_target_while_the_reading_was_on_its_way() -> None:
    """200 mm/s in 20 ms are 4 mm: 3 mm away is not far enough, 5 mm is."""
    for stands_at, is_flagged in ((63_000, True), (65_000, False)):
        bench = jogged(stands_at)
        bench.stage(60_000)
        bench.send(RUN_PDU)
        assert bench.link.sent[0][1] == read(ACTUAL)
        bench.now_ns += 19 * MS
        bench.serve()
        assert bench.port.take() == RUN_PDU
        assert bench.drive.moves[-1] == ("absolute", 59_740.0)
        assert unsure(bench) is is_flagged


@pytest.mark.parametrize("change", [{"added_frames": False}, {"safe_read": False}])
def test_m6_where_nothing_may_be_added_it_keeps_its_branch_and_is_flagged(change: dict[str, bool]) -> None:
    bench = StagedBench(staged_plan(table=WORN, **change))
    bench.ask(read(ACTUAL))
    bench.go_to(45_000)
    assert bench.go_to(46_000)[1] == 46_410
    bench.trigger(JOG_PDU)
    bench.drive.put(ACTUAL, 80_000)
    bench.wait(700)  # older than what counts as fresh, 500 ms
    bench.stage(60_000)
    bench.seen.clear()
    bench.trigger(RUN_PDU)
    assert bench.seen == [RUN_PDU]
    assert bench.drive.moves[-1] == ("absolute", 60_410.0)
    assert unsure(bench)


@pytest.mark.parametrize("change", [{}, {"added_frames": False}, {"safe_read": False}, {"bits": {}}])
def test_m5_a_distance_right_after_a_jog_is_refused(change: dict[str, Any]) -> None:
    bench = jogged(80_000, **change)
    bench.stage(1_000)
    assert bench.refused(RUN_RELATIVE_PDU) == 6


# --- a drive that answers a look with an exception ---------------------------------------------------------


class Reluctant(Memory):
    """Refuses reads of its actual position, as often as it is told to."""

    def __init__(self, *refusals: bytes) -> None:
        super().__init__()
        self.refusals = list(refusals)

    def answer(self, pdu: bytes) -> bytes:
        if pdu == read(ACTUAL) and self.refusals:
            return self.refusals.pop(0)
        return super().answer(pdu)


def unseen(*refusals: bytes, jogged_to: int = 150_000, **changes: object) -> Bench:
    """An axis that arrived at 100 mm forward, was jogged unseen, and whose drive refuses reads then."""
    memory = Reluctant()
    bench = Bench(axis_plan(table=WORN, bits={"done": DONE}, **changes), memory=memory)
    bench.ask(write(COMMAND, 100_000))
    memory.words[DONE.address] = 0
    bench.ask(bytes.fromhex("03 0031 0001"))
    memory.words[DONE.address] = 1
    memory.put(ACTUAL, 100_410)
    bench.wait(500)
    bench.ask(bytes.fromhex("03 0031 0001"))
    bench.actual()
    memory.put(ACTUAL, jogged_to)
    bench.wait(1_200)
    memory.refusals = list(refusals)
    bench.seen.clear()
    return bench


@pytest.mark.parametrize("code", [0x05, 0x06, 0x01, 0x02, 0x04, 0x0B, 0x33])
def test_w8_a_look_that_was_refused_is_asked_once_more(code: int) -> None:
    """Before: 120 410, and the axis comes from 150 mm: 0.67 mm off, flagged."""
    bench = unseen(bytes((0x83, code)))
    assert bench.ask(write(COMMAND, 120_000)) == write(COMMAND, 120_000)[:5]
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 119_740)]
    assert not unsure(bench)


def test_m6_an_axis_that_was_moved_a_little_while_unseen_assumes_the_branch_of_a_near_target() -> None:
    """The drive at 100.61 mm is 100.2 mm forward and 100.87 mm backward; 100.6 mm lies between both."""
    bench = unseen(jogged_to=100_610)
    bench.ask(write(COMMAND, 100_600))
    assert bench.seen == [read(ACTUAL), write(COMMAND, 101_010)]
    assert unsure(bench)


def test_w8_busy_is_asked_once_more_for_each_target() -> None:
    bench = unseen(BUSY, BUSY, BUSY)
    bench.ask(write(COMMAND, 120_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 120_410)]
    assert unsure(bench)
    bench.wait(1_200)
    # it stands at 150 mm yet
    assert bench.frames(write(COMMAND, 110_000)) == [read(ACTUAL), read(ACTUAL), write(COMMAND, 109_740)]
    assert not unsure(bench)


def test_w8_what_is_refused_twice_is_not_asked_before_the_link_comes_up() -> None:
    bench = unseen(ADDRESS, ADDRESS)
    bench.ask(write(COMMAND, 120_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 120_410)]
    assert unsure(bench)
    for counts in (110_000, 130_000):
        bench.wait(1_200)
        assert bench.frames(write(COMMAND, counts)) == [write(COMMAND, counts + 410)]  # its branch is kept
        assert unsure(bench)
    told = [event.detail for event in bench.events if event.kind.name == "direction-unsure"]
    why = "its position could not be determined; it keeps its branch; its drive refuses to report its actual"
    assert told == [f"{why} position"]
    bench.cut(100)
    # it stands at 150 mm
    assert bench.frames(write(COMMAND, 140_000)) == [read(ACTUAL), write(COMMAND, 139_740)]
    assert not unsure(bench)


def test_w8_one_refusal_now_and_then_does_not_end_the_looks() -> None:
    bench = unseen(ADDRESS)
    for counts in (120_000, 110_000, 100_000):
        bench.memory.put(ACTUAL, 150_000)
        bench.wait(1_200)
        bench.seen.clear()
        bench.memory.refusals = [ADDRESS]  # type: ignore[attr-defined]
        bench.ask(write(COMMAND, counts))
        assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, counts - 260)]
        assert not unsure(bench)


@pytest.mark.parametrize("refusals", [(BUSY, BUSY), (ADDRESS, ADDRESS)])
def test_m6_the_same_target_again_keeps_its_words_and_is_flagged(refusals: tuple[bytes, ...]) -> None:
    """It may have been jogged, and comes from there."""
    bench = unseen(*refusals)
    bench.ask(write(COMMAND, 100_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 100_410)]
    assert unsure(bench)


def test_w8_a_drive_that_tells_its_controller_is_asked_again_once() -> None:
    """Two exceptions in a row, and never again: a jog that nobody sees must not cost the branch for weeks."""
    bench = unseen(ADDRESS, ADDRESS)
    bench.ask(write(COMMAND, 120_000))
    assert bench.actual() == 150_000 - 410
    for refusals, frames in (
        ([], [read(ACTUAL), write(COMMAND, 109_740)]),
        ([ADDRESS], [read(ACTUAL), read(ACTUAL), write(COMMAND, 99_740)]),
    ):
        bench.wait(1_200)
        bench.seen.clear()
        bench.memory.refusals = list(refusals)  # type: ignore[attr-defined]
        bench.ask(write(COMMAND, 110_000 if not refusals else 100_000))
        assert bench.seen == frames
        assert not unsure(bench)


def test_m6_where_it_is_not_asked_any_more_the_same_target_again_is_flagged() -> None:
    bench = unseen(ADDRESS, ADDRESS, jogged_to=100_410)
    bench.ask(write(COMMAND, 120_000))
    bench.wait(1_200)
    assert bench.frames(write(COMMAND, 120_000)) == [write(COMMAND, 120_410)]
    assert unsure(bench)


def test_w8_both_reads_leave_within_half_of_what_its_controller_waits() -> None:
    """1,000 ms: after 501 ms it is not asked again, and the target goes without; after 500 ms it is."""
    for after_ms, reads in ((500, 2), (501, 1)):
        bench = unseen(BUSY)
        bench.send(write(COMMAND, 120_000))
        assert bench.link.take() == read(ACTUAL)
        bench.now_ns += after_ms * MS
        bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
        bench.serve()
        assert bench.seen.count(read(ACTUAL)) == reads - 1
        assert bench.memory.get(COMMAND) == (119_740 if reads == 2 else 120_410)
        assert unsure(bench) is (reads == 1)


class ReluctantDrive(StagedDrive):
    """The same of a drive that waits for a trigger."""

    def __init__(self) -> None:
        super().__init__()
        self.refusals: list[bytes] = []

    def answer(self, pdu: bytes) -> bytes:
        if pdu == read(ACTUAL) and self.refusals:
            return self.refusals.pop(0)
        return super().answer(pdu)


def refusing(*refusals: bytes) -> StagedBench:
    """A staged axis that arrived at 45 mm forward, and was not seen for a while."""
    drive = ReluctantDrive()
    plan = staged_plan(table=WORN, commanded=(), motion=relative_by(Action.RELATIVE))
    bench = StagedBench(plan, serial=False)
    bench.drive = bench.memory = drive
    bench.go_to(45_000)
    bench.wait(1_200)
    drive.refusals = list(refusals)
    return bench


@pytest.mark.parametrize("refusal", [BUSY, ADDRESS])
def test_m5_a_distance_before_which_the_look_is_refused_twice_gets_6(refusal: bytes) -> None:
    bench = refusing(refusal, refusal)
    bench.stage(10_000)
    bench.seen.clear()
    assert bench.refused(RUN_RELATIVE_PDU) == 6
    assert bench.seen == [read(ACTUAL), read(ACTUAL)]
    bench.wait(100)
    bench.seen.clear()
    bench.stage(10_000)
    if refusal == ADDRESS:  # it is not asked, and gets 6 all the same
        assert bench.refused(RUN_RELATIVE_PDU) == 6
        assert read(ACTUAL) not in bench.seen
    else:
        assert bench.trigger(RUN_RELATIVE_PDU) == ("relative", 55_410.0)


def test_m3_a_stop_goes_between_both_reads() -> None:
    bench = refusing(BUSY)
    bench.stage(60_000)
    bench.send(RUN_PDU)
    assert bench.link.take() == read(ACTUAL)
    stopper = Port(ControllerPlan("pad"))
    bench.send(STOP_PDU, port=stopper)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent[0][1] == STOP_PDU
    moves = len(bench.drive.moves)
    bench.serve()
    assert stopper.take() == STOP_PDU
    assert bench.port.take() == bytes.fromhex("86 06")  # a stop of its axis came after it
    assert [kind for kind, _ in bench.drive.moves[moves:]] == ["stop"]


def test_w8_what_the_start_reads_is_asked_once_more_too() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    for refusals, is_restored in (((BUSY,), True), ((ADDRESS,), True), ((BUSY, BUSY), False)):
        memory = Reluctant(*refusals)
        memory.words = dict(bench.memory.words)
        started = RecordBench(
            *bench.plans, records=bench.records.copy(), memory=memory, start_ns=bench.now_ns
        )
        assert started.seen == [read(ACTUAL), read(ACTUAL)]
        assert ("restored" in started.kinds()) is is_restored
        assert started.actual() == 20_000  # what passes decides then


def test_w8_a_drive_of_a_stream_that_becomes_busy_is_watched_no_longer() -> None:
    """It stood a millimetre behind its last setpoint when it was read first, and says "busy" from then on."""
    bench = RecordBench(stream_plan())
    for counts in (30_000, 30_100, 30_200):
        bench.ask(write(COMMAND, counts))
    memory = Reluctant()
    memory.words = dict(bench.memory.words)
    memory.put(ACTUAL, 29_000)
    memory.refusals = [memory.answer(read(ACTUAL)), *[BUSY] * 500]
    started = RecordBench(
        *bench.plans, records=bench.records.copy(), memory=memory, start_ns=bench.now_ns + 5 * MS
    )
    assert started.seen == [read(ACTUAL)] * 3
    assert len(memory.refusals) == 498


def test_w8_a_first_setpoint_is_read_for_once_more() -> None:
    memory = Reluctant(BUSY)
    bench = Bench(stream_plan(table=WORN), memory=memory)
    memory.put(ACTUAL, 50_410)
    bench.ask(write(COMMAND, 50_000))
    assert bench.seen == [read(ACTUAL), read(ACTUAL), write(COMMAND, 50_410)]


def test_every_answer_leads_where_the_table_says() -> None:
    """By hand: columns are what is known, rows what the drive answers."""
    by_hand = walk("""
                open          refused-once  refused
    place       open          open          refused
    passing     open          refused-once  refused-once
    refusal     refused-once  refused       refused
    link-lost   open          open          open
    """)
    rows = READABILITY_AFTER.items()
    assert by_hand == {(now.value, told.value): then.value for now, row in rows for told, then in row.items()}


# --- traces that ``make verify`` found --------------------------------------------------------------------


def test_a_reading_decides_no_branch_after_two_targets_that_came_without_one() -> None:
    """M6: where the axis stood when its last target came was assumed: its reading is the drive's."""
    world = played(
        "late-start",
        """
        to 0: 10 0606 0002 04 E4A5 FFFF, ack: 03 0520 0002 -> 0000 0000  # -7003
        ack: 10 0606 0002 04 E425 FFFF, arrive                           # backward to -7131
        to 1: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> E425 FFFF  # 9007
        ack: 10 0606 0002 04 23D4 0000  # 80 ms pass, and it has not begun to move
        to 0, ack: 03 0520 0002 -> E425 FFFF, ack: 10 0606 0002 04 E502 FFFF  # flagged: nothing tells it
        to 1, ack: 10 0606 0002 04 23D4 0000                             # by the reading of 80 ms ago
        to 0, ack: 03 0520 0002 -> E425 FFFF  # where the backward branch puts -7003
        has: 10 0606 0002 04 E502 FFFF                                   # forward to -6910, flagged
        """,
    )
    assert world.is_sending_unsure()


def test_a_target_given_again_after_its_axis_moved_on_is_flagged_where_nothing_tells_its_branch() -> None:
    """M6: its axis has moved on since its words went out. Seen at 9184, it is backward."""
    onward = """
        to 1: 10 0606 0002 04 233B 0000, ack: 03 0520 0002 -> 0000 0000  # 9019
        ack: 10 0606 0002 04 23E0 0000  # forward to 9184; it is on its way at 1501
        to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 05DD 0000  # 9007
        refuse: 10 0606 0002 04 23D4 0000, arrive                        # 90 04: the axis goes on to 9184
        to 0, refuse: 03 0520 0002,
    """
    assert played("deaf", onward + "refuse: 03 0520 0002, has: 10 0606 0002 04 23D4 0000").is_sending_unsure()
    played("deaf", onward + "ack: 03 0520 0002 -> 23E0 0000, has: 10 0606 0002 04 22E8 0000")


def test_a_target_that_is_repeated_while_its_axis_is_on_its_way_keeps_its_branch() -> None:
    """M4: an axis that begins late has not been moved otherwise."""
    played(
        replace(BY_NAME["short"], is_prompt=False),
        """
        to 1: 10 0606 0002 04 2330 0000, ack: 03 0520 0002 -> 0000 0000  # 9008
        ack: 10 0606 0002 04 23D5 0000, arrive                           # forward to 9173
        read, ack: 03 0520 0002 -> 23D5 0000, status, ack: 03 005C 0001 -> 0110  # it has arrived
        to 0: 10 0606 0002 04 232F 0000, ack: 10 0606 0002 04 22E8 0000  # 9007: backward to 8936; 80 ms pass
        wait, wait                                                       # unseen_ms is 160
        to 0, ack: 03 0520 0002 -> 23D5 0000                             # it has not moved yet
        ack: 10 0606 0002 04 22E8 0000                                   # not 23D4, which is forward
        """,
    )


def test_a_reading_that_fades_from_an_assumed_start_decides_no_branch_in_the_window_of_its_target() -> None:
    """M6: 9008 was obeyed and not acknowledged, 9007 lies a count beside it: the axis stands where it stood.

    Its reading fades from 1:1, 9173, to 9007 within that count. Forward 9008 is 9173.12, backward 8937.09.
    """
    world = played(
        "read-back",
        """
        jog, read, ack: 03 0520 0002 -> 0BB9 0000                              # 3001
        to 1: 10 0606 0002 04 2330 0000, obey: 10 0606 0002 04 23D5 0000       # 9008: 9173, not acknowledged
        wait, wait, to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 2364 0000  # 9060: between them
        has: 10 0606 0002 04 235E 0000, arrive          # half-way to 9054, flagged, lost; it stands at 9173
        wait, wait, to 0, ack: 03 0520 0002 -> 23D5 0000
        ack: 10 0606 0002 04 23D4 0000                  # it has come there forward
        to 1, ack: 03 0520 0002 -> 23D5 0000
        has: 10 0606 0002 04 23D5 0000                  # not 22E9, as it was sent
        """,
    )
    assert world.is_sending_unsure()


def test_a_reading_in_coarser_steps_than_the_target_is_the_nearest_one_of_an_axis_that_stands_there() -> None:
    """8932 is 9095.98 forward, sent as 9096: 910 in steps of 10 counts. 893 is nearest to 8932."""
    played(
        "s-coarse",
        """
        to 1: 10 0606 0002 04 22E4 0000, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 2388 0000, arrive  # forward to 9096
        read, ack: 03 0520 0002 -> 038E 0000    # 910
        told: 03 04 037D 0000                   # not 037E, 894
        """,
    )
