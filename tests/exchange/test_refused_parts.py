"""Parts of a position that were refused: what the next part becomes, what a trigger runs (M1, M3, M7)."""

from itertools import product
from typing import Any

import pytest

from gateway.drives.motion import Action, Form, MotionPlan, Operation, TriggerPlan
from gateway.exchange.axis.registers import COMPLETENESS_AFTER, NEXT_PART, Completeness, Loss, NextPart
from gateway.exchange.plan import ControllerPlan
from gateway.modbus.registers import PositionField
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Port, axis_plan, read, write
from tests.exchange.staged_bench import RUN_PDU, StagedBench, staged_plan
from tests.support.tables import walk

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
def test_m1_a_lost_part_leaves_its_field_as_the_rule_says(state: Completeness, loss: Loss) -> None:
    assert COMPLETENESS_AFTER[state, loss].value == walk(LOSS_WALK)[state.value, loss.value]


@pytest.mark.parametrize(
    ("state", "waits", "heard"), list(product(Completeness, (True, False), (True, False)))
)
def test_m1_the_next_part_becomes_what_the_rule_says(state: Completeness, waits: bool, heard: bool) -> None:
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
def test_m7_after_a_half_that_was_not_written_the_other_joins_what_is_held(frame: str, code: int) -> None:
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
def test_m1_a_half_that_was_pipelined_behind_a_refused_one_is_refused(code: int) -> None:
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


def test_m1_a_half_that_was_refused_for_another_writer_joins_nothing() -> None:
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
def test_m3_a_trigger_behind_a_refused_half_is_refused(
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


def test_m1_after_a_time_out_a_half_goes_out_as_it_came_and_counts_when_it_was_acknowledged() -> None:
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


def test_m3_a_half_that_starts_the_motion_does_not_run_beside_one_that_was_refused() -> None:
    """The high word starts; the low one was refused, and its drive holds 0x7318."""
    starts = MotionPlan(starts_on=frozenset({0x0607}))
    bench = Bench(axis_plan(motion=starts, **PROVES), tcp_drive=True, serial=False)
    bench.ask(write(COMMAND, 95_000))
    told = bench.memory.get(COMMAND)
    refuse(bench, LOW_2000, 4)
    assert bench.ask(HIGH_3) == bytes.fromhex("86 04")
    assert bench.memory.get(COMMAND) == told


def test_m3_a_lost_target_of_one_field_is_not_run_because_another_one_was_written() -> None:
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


def test_m1_a_refused_half_is_forgotten_with_the_words_that_it_stood_beside() -> None:
    """The link was lost: the next pair goes out with its second half, as any first pair."""
    bench = mover(**PROVES)
    refuse(bench, HIGH_3, 4)
    bench.cut(100)
    assert [bench.ask(LOW_2000), bench.ask(bytes.fromhex("06 0607 0001"))] == [
        bytes.fromhex("86 04"),
        bytes.fromhex("06 0607 0001"),
    ]
