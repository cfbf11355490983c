"""Steps of a run in the record: a setpoint that continues it changes few numbers, and only these are
written."""

import pytest

from gateway.exchange.axis.record_layout import PAGE, SLOTS_AT, STEPS_AT, RecordSlots, Remembered
from tests.exchange.line_bench import ACTUAL, COMMAND, stream_plan, write
from tests.exchange.record_bench import RecordBench

STEP = 100
"""Counts from setpoint to setpoint: 0.1 mm."""
STEP_BYTES = 128
"""As far as a step may reach in its page."""


def steady() -> RecordBench:
    """A stream whose change-over at its start is over."""
    bench = RecordBench(stream_plan())
    for counts in range(0, 60_000, STEP):
        follow(bench, counts)
    return bench


def follow(bench: RecordBench, counts: int) -> None:
    """Feed one setpoint, to which the axis goes at once."""
    bench.ask(write(COMMAND, counts))
    bench.memory.put(ACTUAL, bench.memory.get(COMMAND))


def data_of(bench: RecordBench) -> bytes:
    return bytes(bench.records.buffers["x"])


def read(data: bytes | bytearray) -> Remembered:
    found = RecordSlots(memoryview(bytearray(data)), bytes(16)).read()
    assert found is not None
    return found


def last_sent(bench: RecordBench) -> int:
    return int(COMMAND.unpack(bench.writes[-1][6:10]))


def test_a_setpoint_that_continues_a_run_writes_steps_and_no_slot() -> None:
    bench = steady()
    before = data_of(bench)
    follow(bench, 60_000)
    after = data_of(bench)
    changed = {i for i in range(len(before)) if before[i] != after[i]}
    assert changed
    assert all(any(at <= i < at + STEP_BYTES for at in STEPS_AT) for i in changed)
    assert {at // PAGE for at in STEPS_AT} == {at // PAGE for at in SLOTS_AT}


def test_a_step_names_the_accepted_and_the_sent_setpoint() -> None:
    bench = steady()
    was_sent = last_sent(bench)
    follow(bench, 60_000)
    sent = last_sent(bench)
    record = read(data_of(bench))
    assert (record.nominal_counts, record.corrected_counts) == (60_000, sent)
    assert record.came_from == (59_900, was_sent)
    assert list(record.way) == [was_sent, sent]
    assert (record.state.position, record.state.extreme) == (60.0, 60.0)
    assert record.unacknowledged is None
    bench.send(write(COMMAND, 60_100))
    later = read(data_of(bench))
    move = later.unacknowledged
    assert later.nominal_counts == 60_000
    assert move is not None
    assert (move.nominal_counts, move.corrected_counts) == (60_100, last_of(bench))
    assert move.state.position == 60.1


def last_of(bench: RecordBench) -> int:
    return int(COMMAND.unpack(bench.link.take()[6:10]))


@pytest.mark.parametrize("flip", [0x01, 0x80])
def test_a_torn_step_makes_the_one_before_count(flip: int) -> None:
    bench = steady()
    follow(bench, 60_000)
    before = data_of(bench)
    bench.send(write(COMMAND, 60_100))
    after = data_of(bench)
    places = [i for i in range(len(before)) if before[i] != after[i]]
    assert len({i // PAGE for i in places}) == 1
    for place in places:
        torn = bytearray(after)
        torn[place] ^= flip
        assert read(torn) == read(before)
        assert read(after) != read(before)


def test_steps_of_an_older_slot_do_not_count() -> None:
    bench = steady()
    follow(bench, 60_000)
    stepped = data_of(bench)
    follow(bench, 59_000)  # a reversal: a slot is written whole again
    whole = bytearray(data_of(bench))
    found = read(whole)
    for at in STEPS_AT:
        whole[at : at + STEP_BYTES] = stepped[at : at + STEP_BYTES]
    assert read(whole) == found
    assert found.nominal_counts == 59_000


@pytest.mark.parametrize("number", [0, 1, 2, 3, 7])
def test_a_gateway_restored_from_steps_sends_what_it_would_have_sent(number: int) -> None:
    bench = steady()
    for i in range(number):
        follow(bench, 60_000 + STEP * i)
    again = bench.restarted()
    walk = [60_000 + STEP * i for i in range(number, number + 5)]
    walk += [counts - 30 for counts in reversed(walk)]
    for counts in walk:
        follow(bench, counts)
        follow(again, counts)
    assert again.kinds().count("restored") == 1, again.told
    assert again.writes[-len(walk) :] == bench.writes[-len(walk) :]


def test_a_status_between_two_setpoints_changes_nothing_of_what_is_sent() -> None:
    bench, other = steady(), steady()
    for counts in range(60_000, 61_000, STEP):
        follow(bench, counts)
        follow(other, counts)
        assert other.line.axes[0].compensation.state.position == counts / 1000
    assert bench.writes == other.writes
    ours, theirs = read(data_of(bench)), read(data_of(other))
    assert ours.nominal_counts == theirs.nominal_counts == 60_900
    assert ours.corrected_counts == theirs.corrected_counts
    assert ours.way == theirs.way
