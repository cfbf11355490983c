"""Forwarded replies are equal to stored ones, or are spoilt: on real axes."""

from collections.abc import Callable
from dataclasses import replace
from random import Random

import pytest

from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.cut_through.delay import Delays, FrameShape, acknowledgement_shape, reply_shape
from gateway.exchange.cut_through.frame import ForwardedFrame, ForwardEvent, ForwardState
from gateway.exchange.cut_through.replies import Replies, ReplyJudge, reply_shape_of
from gateway.exchange.plan import AxisPlan
from gateway.exchange.transaction import Transaction
from gateway.modbus.crc import INVERTED, append_crc, residue_after
from gateway.modbus.registers import BitField
from gateway.modbus.rtu_arrival import Progress, ReplyArrival
from tests.exchange.cut_bench import CHAR_NS, PACE, characters, learn, play
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, read, stream_plan, write
from tests.exchange.test_fast_path import CURVE

STATUS = 0x0522
BLOCK = bytes.fromhex("03 05 20 00 03")
"""Actual position and status in one read."""
PLAN = stream_plan(table=CURVE, bits={"done": BitField(STATUS, 0)})


class Way:
    """A line on which the reply to the request on the wire comes character by character."""

    def __init__(self, *plans: AxisPlan) -> None:
        self.bench = Bench(*(plans or (PLAN,)))
        self.replies = Replies(Delays(CHAR_NS, CHAR_NS, CHAR_NS))
        self.events: list[ForwardEvent] = []

    def measure(self, shape: FrameShape | None) -> None:
        assert shape is not None
        if shape.late is not None:
            self.measure(shape.late)
        learn(self.replies.delays, shape)

    def settle(self) -> None:
        """Send a stream until no correction is blended any more."""
        for counts in range(2_000, 10_001, 40):
            self.bench.ask(write(COMMAND, counts))
            self.bench.memory.put(ACTUAL, self.bench.memory.get(COMMAND))
            self.bench.now_ns += 10 * MS

    def ask(
        self, pdu: bytes, meanwhile: Callable[[], None] = lambda: None, reply: bytes = b""
    ) -> tuple[ForwardedFrame, bytes]:
        """Send a request; return the forwarded reply, and the reply as the line would send it whole."""
        bench = self.bench
        bench.send(pdu)
        [(unit_id, sent)] = bench.link.sent
        bench.link.sent.clear()
        transaction = bench.line._transactions.current
        assert isinstance(transaction, Transaction)
        reply = reply or bench.memory.answer(sent)
        shape = reply_shape_of(transaction)
        if shape is not None:
            self.measure(shape)
        judge = ReplyJudge(transaction, self.replies)
        self.events = []
        forwarded = ForwardedFrame(ReplyArrival(unit_id, sent), judge, PACE, self.events.append)
        came = characters(append_crc(bytes((unit_id,)) + reply), from_ns=bench.now_ns)
        play(forwarded, came[:-1])
        meanwhile()
        play(forwarded, came[-1:], came[-1][0] + 100 * CHAR_NS)
        bench.now_ns += MS
        bench.line.reply(unit_id, reply, bench.now_ns)
        passed = bench.port.take()
        self.replies.add(transaction, passed)
        bench.now_ns += 10 * MS
        return forwarded, passed


def settled() -> Way:
    way = Way()
    way.settle()
    return way


@pytest.mark.parametrize("seed", range(4))
def test_replies_are_sent_as_if_they_had_been_stored(seed: int) -> None:
    rng, way = Random(seed), settled()
    counts, states = 10_000, []
    for pdu in (BLOCK, read(ACTUAL), read(COMMAND)):
        forwarded, _ = way.ask(pdu)
        assert forwarded.state is ForwardState.STORED  # nothing is known that it could be filled with
    for number in range(80):
        counts += 40 if number < 50 else -40
        kind = rng.randrange(4)
        request = (write(COMMAND, counts), BLOCK, read(ACTUAL), read(COMMAND))[kind]
        lag = rng.randint(0, 30)
        way.bench.memory.put(ACTUAL, way.bench.memory.get(COMMAND) - lag)
        way.bench.memory.words[STATUS] = rng.randint(0, 3)
        forwarded, passed = way.ask(request)
        states.append(forwarded.state)
        if forwarded.state is ForwardState.WHOLE:
            assert forwarded.left == append_crc(b"\x01" + passed)
        else:  # the slow path took the target: of its reply nothing leaves early
            assert (kind, forwarded.state, forwarded.left) == (0, ForwardState.STORED, b"")
    assert states.count(ForwardState.WHOLE) > 40


def test_the_shapes_of_replies() -> None:
    way = settled()
    found = []
    for pdu in (write(COMMAND, 10_040), read(ACTUAL), BLOCK, bytes.fromhex("03 01 00 00 02")):
        way.bench.send(pdu)
        assert way.bench.line._transactions.current is not None
        found.append(reply_shape_of(way.bench.line._transactions.current))
        way.bench.serve()
        way.bench.port.take()
    assert found == [acknowledgement_shape(), reply_shape(2, [(0, 2)]), reply_shape(3, [(0, 2)]), None]


def begun(way: Way, pdu: bytes) -> tuple[Transaction, ForwardedFrame]:
    """Send a request; return it, and a forwarder for its reply."""
    way.bench.send(pdu)
    transaction = way.bench.line._transactions.current
    assert transaction is not None
    judge = ReplyJudge(transaction, way.replies)
    return transaction, ForwardedFrame(ReplyArrival(1, pdu), judge, PACE, way.events.append)


def test_a_spoilt_reply_is_filled_with_the_words_of_the_reply_before() -> None:
    way = settled()
    _, before = way.ask(BLOCK)
    way.bench.memory.put(ACTUAL, 9_000)
    _, forwarded = begun(way, BLOCK)
    # Its head has left, and the first word of a position that is never whole.
    play(forwarded, characters(b"\x01" + way.bench.memory.answer(BLOCK)[:4]), 90_000)
    assert (forwarded.state, way.events[-1]) == (ForwardState.ABORTED, ForwardEvent.STALLED)
    assert forwarded.left[:-2] == b"\x01" + before
    assert residue_after(forwarded.left) == INVERTED


def test_each_position_in_a_reply_is_converted_as_that_of_its_axis() -> None:
    """x stands at 10 012 and y at 10 010, each for 10 000: 0000 2710."""
    command, actual = replace(COMMAND, address=0x0702), replace(ACTUAL, address=0x0522)
    way = Way(stream_plan(table=CURVE), stream_plan(name="y", command=(command,), actual=(actual,)))
    way.settle()
    for counts in range(2_000, 10_001, 40):
        way.bench.ask(write(command, counts))
        way.bench.memory.put(actual, way.bench.memory.get(command))
        way.bench.now_ns += 10 * MS
    assert [way.bench.memory.get(place) for place in (ACTUAL, actual)] == [10_012, 10_010]
    both = bytes.fromhex("03 0520 0004")
    way.ask(both)
    forwarded, _ = way.ask(both)
    assert forwarded.state is ForwardState.WHOLE
    assert forwarded.left[:-2] == bytes.fromhex("01 03 08 2710 0000 2710 0000")


def test_w4_an_acknowledgement_of_other_registers_gets_no_check_sum() -> None:
    way = settled()
    forwarded, passed = way.ask(write(COMMAND, 10_040), reply=bytes.fromhex("10 FF FF 00 02"))
    assert passed == bytes.fromhex("10 FF FF 00 02")
    assert (forwarded.state, way.events[-1]) == (ForwardState.ABORTED, ForwardEvent.CHANGED)
    assert forwarded.arrival.progress is Progress.GOOD
    # It has gone on as it came: only its check sum is not the right one.
    assert forwarded.left[:-2] == bytes.fromhex("01 10 FF FF 00 02")


def test_an_exception_is_stored() -> None:
    way = settled()
    forwarded, passed = way.ask(write(COMMAND, 10_040), reply=b"\x90\x04")
    assert (forwarded.state, forwarded.left, passed) == (ForwardState.STORED, b"", b"\x90\x04")


def test_the_reply_to_a_request_on_the_slow_path_is_stored() -> None:
    way = settled()
    for _ in range(2):
        way.ask(read(COMMAND))
    way.bench.line.axes[0].fall_silent(way.bench.now_ns, way.bench.now_ns)
    transaction, forwarded = begun(way, read(COMMAND))
    play(forwarded, characters(append_crc(b"\x01" + way.bench.memory.answer(read(COMMAND)))))
    assert (transaction.path, forwarded.state) == (None, ForwardState.STORED)


@pytest.mark.parametrize(
    ("after_bytes", "state", "why"),
    [(0, ForwardState.STORED, ForwardEvent.KEPT), (5, ForwardState.ABORTED, ForwardEvent.REFUSED)],
)
def test_a_reading_that_may_prove_a_target_is_stored_or_spoilt(
    after_bytes: int, state: ForwardState, why: ForwardEvent
) -> None:
    """If that is known before forwarding begins, the reply is stored; else it is spoilt."""
    way = settled()
    way.ask(read(COMMAND))
    axis = way.bench.line.axes[0]
    _, forwarded = begun(way, read(COMMAND))
    words = axis.fields[0].nominal_words
    assert words is not None
    came = characters(append_crc(b"\x01" + way.bench.memory.answer(read(COMMAND))))
    play(forwarded, came[:after_bytes])
    axis.motion.enter(MotionState.UNACKNOWLEDGED, Rendering(0, words, b"\0\0\0\1", 1.0, None))
    play(forwarded, came[after_bytes:])
    assert (forwarded.state, way.events[-1]) == (state, why)
    assert len(forwarded.left) == (reply_shape(2, [(0, 2)]).length if state is ForwardState.ABORTED else 0)
