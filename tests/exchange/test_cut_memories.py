"""What cut-through remembers: beginnings of requests, what forwarding has gained, pauses, totals."""

from typing import Final

import pytest

from gateway.exchange.cut_through.delay import (
    REMEMBERED,
    Delays,
    Piece,
    read_shape,
    reply_shape,
    write_shape,
)
from gateway.exchange.cut_through.forward import WASTED, Pauses, Totals
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.cut_through.replies import REMEMBERED_REPLIES, Replies
from gateway.exchange.cut_through.requests import (
    REMEMBERED_BEGINNINGS,
    STORED_FOR,
    WEIGHED_AT_LEAST,
    Heads,
)
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.transaction import FastPath, Transaction
from tests.exchange.cut_bench import CHAR_NS, learn
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, read, stream_plan, write

PATH: Final = FastPath(5)
"""Of a read without any mapped content."""
READ: Final = bytes.fromhex("01 03 0200 0003")
OTHER_READ: Final = bytes.fromhex("01 03 0300 0001")
WRITE: Final = b"\x01" + write(COMMAND, 1000)
LONGER: Final = b"\x01" + bytes.fromhex("10 0606 0003 06 03E8 0000 0000")


POSITION: Final = read(ACTUAL)
REPLY: Final = bytes.fromhex("03 04 2710 0000")
SHAPE: Final = reply_shape(2, [(0, 2)])
UNITS: Final = UnitMaps(Bench(stream_plan()).line.axes, is_serial=True)


def heads() -> Heads:
    found = Heads(Delays(CHAR_NS, CHAR_NS, CHAR_NS))
    learn(found.delays, read_shape(), write_shape(2, 0, 2))
    return found


def unit_reads(count: int) -> list[bytes]:
    """Reads with so many beginnings: units from 2 on, with functions 3 and 4."""
    return [bytes((2 + number // 2, 3 + number % 2)) + READ[2:] for number in range(count)]


def add(memory: Heads, *reads: bytes) -> None:
    for each in reads:
        memory.add(PATH, each, each)


def is_expected(memory: Heads, begun: bytes = READ[:2]) -> bool:
    return memory.opening(begun) is not None


def test_reads_of_other_registers_are_expected_too() -> None:
    memory = heads()
    add(memory, READ, OTHER_READ)
    assert is_expected(memory)
    memory.add(None, OTHER_READ, OTHER_READ)  # one of them took the slow path
    assert is_expected(memory)


def test_a_write_that_continues_differently_is_stored_from_then_on() -> None:
    memory, units = heads(), UnitMaps(Bench(stream_plan()).line.axes, is_serial=True)
    memory.add(units.path_of(1, WRITE[1:]), WRITE, WRITE)
    was_expected = [is_expected(memory, WRITE[:4])]
    memory.add(units.path_of(1, LONGER[1:]), LONGER, LONGER)
    was_expected.append(is_expected(memory, WRITE[:4]))
    memory.add(units.path_of(1, WRITE[1:]), WRITE, WRITE)
    was_expected.append(is_expected(memory, WRITE[:4]))
    assert was_expected == [True, False, False]


def test_all_beginnings_are_forgotten_when_their_maximum_is_reached() -> None:
    memory = heads()
    *most, last = unit_reads(REMEMBERED_BEGINNINGS)
    add(memory, READ, *most)
    was_expected = [is_expected(memory), is_expected(memory, most[-1][:2])]
    add(memory, READ, last)  # the first one is known
    was_expected += [is_expected(memory), is_expected(memory, last[:2])]
    assert was_expected == [True, True, False, True]


def test_the_gain_of_forwarding_is_forgotten_with_the_beginnings() -> None:
    memory = heads()
    add(memory, READ)
    for _ in range(WEIGHED_AT_LEAST):
        memory.pay(READ, -1)
    was_expected = [is_expected(memory)]
    add(memory, *unit_reads(REMEMBERED_BEGINNINGS), READ)
    was_expected.append(is_expected(memory))
    for _ in range(WEIGHED_AT_LEAST - 1):
        memory.pay(READ, -1)
    add(memory, *unit_reads(REMEMBERED_BEGINNINGS), READ)
    memory.pay(READ, -1)
    was_expected.append(is_expected(memory))
    assert was_expected == [False, True, True]


@pytest.mark.parametrize(("gain_ns", "goes_on"), [(1, True), (0, True), (-1, False)])
def test_forwarding_that_loses_time_ends_for_a_while(gain_ns: int, goes_on: bool) -> None:
    memory = heads()
    add(memory, READ)
    was_expected = []
    for _ in range(WEIGHED_AT_LEAST):
        was_expected.append(is_expected(memory))
        memory.pay(READ, gain_ns)
    assert all(was_expected)
    assert is_expected(memory) is goes_on
    for _ in range(STORED_FOR - 1):
        memory.came(READ)
    assert is_expected(memory) is goes_on
    memory.came(READ)
    assert is_expected(memory)
    memory.pay(READ, gain_ns)  # what was lost before that is not weighed once more
    assert is_expected(memory)


def asked(pdu: bytes = POSITION, unit_id: int = 1) -> Transaction:
    """A read of a position on its fast path."""
    path = UNITS.path_of(1, POSITION)
    assert path is not None
    transaction = Transaction(None, 0, unit_id, pdu, 0)
    transaction.path = path
    return transaction


def replies() -> Replies:
    found = Replies(Delays(CHAR_NS, CHAR_NS, CHAR_NS))
    learn(found.delays, SHAPE)
    return found


def test_after_a_spoilt_reply_those_of_its_shape_are_stored_for_a_while() -> None:
    memory = replies()
    memory.add(asked(), REPLY)
    was_expected = [memory.opening(asked()) is not None]
    memory.rest(SHAPE)
    for _ in range(STORED_FOR - 1):
        memory.came(SHAPE)
        was_expected.append(memory.opening(asked()) is not None)
    memory.came(SHAPE)
    was_expected.append(memory.opening(asked()) is not None)
    assert was_expected == [True, *[False] * (STORED_FOR - 1), True]


def test_all_replies_are_forgotten_when_their_maximum_is_reached() -> None:
    memory = replies()
    first, *most, last = [
        asked(POSITION[:4] + bytes((2 + number % 2,)), 1 + number // 2)
        for number in range(REMEMBERED_REPLIES + 1)
    ]
    for each in (first, *most, first):  # the first one is known
        memory.add(each, REPLY)
    was_expected = [memory.opening(each) is not None for each in (first, most[-1])]
    memory.add(last, REPLY)
    was_expected += [memory.opening(each) is not None for each in (first, last)]
    assert was_expected == [True, True, False, True]


def test_the_longest_pause_is_that_of_the_last_frames() -> None:
    pauses = Pauses(100)
    longest = [pauses.longest_ns]
    pauses.add([Piece(0, 1), Piece(300, 2), Piece(500, 3)])
    longest.append(pauses.longest_ns)
    for _ in range(REMEMBERED):
        pauses.add([Piece(0, 1), Piece(50, 2)])
    longest.append(pauses.longest_ns)
    assert longest == [100, 300, 50]


def test_the_totals_say_what_was_forwarded_stored_and_spoilt() -> None:
    """Three were forwarded, each 2 µs early. Four did not fit; of one of these nothing had been sent."""
    totals = Totals()
    totals.ended[ForwardEvent.COMMITTED] = 3
    totals.gain_ns = 6_000
    totals.ended[ForwardEvent.KEPT] = totals.stored[ForwardEvent.KEPT] = 5
    totals.ended[ForwardEvent.UNFIT], totals.stored[ForwardEvent.UNFIT] = 4, 1
    status = totals.status()
    assert (status.cut_through, status.gain_us) == (3, 2)
    assert status.stored == {"kept": 5, "unfit": 1}
    assert status.spoilt == {"unfit": 3}
    assert Totals().status().gain_us is None


def test_a_spoilt_frame_counts_as_wasted_if_it_would_have_been_sent_stored() -> None:
    """A bad or overtaken frame does not count, nor one whose wire or port was lost: stored, it would not be
    sent either."""
    none_left = {ForwardEvent.BAD, ForwardEvent.OVERTAKEN, ForwardEvent.GONE, ForwardEvent.LOST}
    no_ends = {ForwardEvent.OPENED, ForwardEvent.FITTED, ForwardEvent.JUDGED}
    well = {ForwardEvent.KEPT, ForwardEvent.COMMITTED}
    assert set(ForwardEvent) - none_left - no_ends - well == WASTED
