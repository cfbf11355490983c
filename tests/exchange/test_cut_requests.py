"""Forwarded requests are equal to stored ones, or are spoilt: on real axes."""

from collections.abc import Callable
from random import Random

import pytest

from gateway.exchange.axis.acknowledge import SteadyTarget
from gateway.exchange.cut_through.delay import Delays, read_shape, write_shape
from gateway.exchange.cut_through.frame import ForwardedFrame, ForwardEvent, ForwardState
from gateway.exchange.cut_through.requests import Heads, RequestJudge, leave_on
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.plan import AxisPlan
from gateway.exchange.transaction import FastPath, Transaction
from gateway.modbus.crc import INVERTED, append_crc, residue_after
from gateway.modbus.rtu_arrival import Progress, RequestArrival
from tests.exchange.cut_bench import CHAR_NS, PACE, characters, learn, play
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, read, stream_plan, write
from tests.exchange.test_fast_path import CURVE

WRITE_SHAPE = write_shape(2, 0, 2)


def frame_of(pdu: bytes, unit_id: int = 1) -> bytes:
    return append_crc(bytes((unit_id,)) + pdu)


class Way:
    """A stream over a line that stores, and beside it a forwarder for the next frame."""

    def __init__(self, plan: AxisPlan | None = None) -> None:
        self.bench = Bench(plan or stream_plan(table=CURVE))
        self.units = UnitMaps(self.bench.line.axes, is_serial=True)
        self.heads = Heads(Delays(CHAR_NS, CHAR_NS, CHAR_NS))
        self.is_free = True
        self.left: list[Transaction] = []
        self.events: list[ForwardEvent] = []
        learn(self.heads.delays, WRITE_SHAPE, read_shape())

    def store(self, pdu: bytes) -> bytes:
        """Send a stored request, and let it be acknowledged; return the frame to the drive."""
        self.bench.ask(pdu)
        sent = self.bench.seen[-1]
        self.heads.add(self.units.path_of(1, pdu), b"\x01" + pdu, b"\x01" + sent)
        return sent

    def stream(self, *counts: float) -> bytes:
        """Send stored setpoints, one in 10 ms; return the last frame to the drive."""
        for each in counts:
            sent = self.store(write(COMMAND, each))
            self.bench.now_ns += 10 * MS
        return sent

    def settle(self) -> bytes:
        """Send a stream until no correction is blended any more: it ends at 10 000 counts."""
        return self.stream(*range(2_000, 10_001, 40))

    def begin(self) -> ForwardedFrame:
        """Return a forwarder for the next frame."""

        def leaves(path: FastPath, pdu: bytes, target: SteadyTarget | None, now_ns: int) -> bytes | None:
            transaction = Transaction(self.bench.port, 0, 1, pdu, now_ns)
            sent = leave_on(path, transaction, target, now_ns)
            if sent is not None:
                self.left.append(transaction)
            return sent

        judge = RequestJudge(self.bench.port, self.units, self.heads, lambda *_: self.is_free, leaves)
        self.events = []
        return ForwardedFrame(RequestArrival(), judge, PACE, self.events.append)

    def forwarded(
        self, frame: bytes, meanwhile: Callable[[], None] = lambda: None, after_bytes: int = 12
    ) -> ForwardedFrame:
        """Feed a frame character by character; call ``meanwhile`` after ``after_bytes`` of them."""
        forwarded = self.begin()
        came = characters(frame, from_ns=self.bench.now_ns)
        play(forwarded, came[:after_bytes])
        meanwhile()
        play(forwarded, came[after_bytes:], came[-1][0] + 100 * CHAR_NS)
        return forwarded


def settled() -> Way:
    way = Way()
    way.settle()
    return way


@pytest.mark.parametrize("seed", range(5))
def test_a_stream_is_sent_as_if_it_had_been_stored(seed: int) -> None:
    rng, way = Random(seed), settled()
    counts, step = 10_000, 40
    outcomes = []
    for number in range(110):
        step = -step if number % 40 == 39 else step
        counts += step * rng.randint(0, 2)
        forwarded = way.forwarded(frame_of(write(COMMAND, counts)))
        sent = way.store(write(COMMAND, counts))  # the same line, the same instant, stored
        way.bench.now_ns += 10 * MS
        outcomes.append(forwarded.state)
        if forwarded.state is ForwardState.WHOLE:
            assert forwarded.left == frame_of(sent)
        elif (
            forwarded.state is ForwardState.ABORTED
        ):  # the way turns: the slow path decides, and the drive gets no frame
            assert way.events[-1] is ForwardEvent.REFUSED
            assert residue_after(forwarded.left) == INVERTED
            assert forwarded.arrival.progress is Progress.GOOD
        else:  # the correction of the turn is blended
            assert forwarded.left == b""
    assert outcomes.count(ForwardState.WHOLE) > 60
    assert outcomes.count(ForwardState.ABORTED) == 2  # once for each turn


def test_a_spoilt_target_is_filled_with_the_words_in_the_drive() -> None:
    way = Way()
    last = way.settle()
    forwarded = way.forwarded(frame_of(write(COMMAND, 9_000)))
    assert forwarded.state is ForwardState.ABORTED
    assert forwarded.left[1:-2] == last


def test_a_target_is_spoilt_if_another_writer_takes_the_axis_over_meanwhile() -> None:
    way = settled()
    hold = way.bench.line.axes[0].hold
    forwarded = way.forwarded(
        frame_of(write(COMMAND, 10_120)), lambda: hold.move("panel (192.168.0.9)", way.bench.now_ns)
    )
    assert (forwarded.state, way.events[-1], way.left) == (ForwardState.ABORTED, ForwardEvent.CHANGED, [])


def test_a_target_is_spoilt_if_the_link_of_its_axis_was_lost_meanwhile() -> None:
    way = settled()
    forwarded = way.forwarded(
        frame_of(write(COMMAND, 10_120)), lambda: way.bench.line.axes[0].lose_link(way.bench.now_ns)
    )
    assert forwarded.state is ForwardState.ABORTED
    assert way.left == []


def test_a_read_is_sent_from_its_function_code_on_whatever_it_reads() -> None:
    way = Way()
    way.stream(10_000, 10_040)
    way.store(read(ACTUAL))
    for pdu in (read(ACTUAL), bytes.fromhex("03 01 00 00 07")):
        frame = frame_of(pdu)
        forwarded = way.forwarded(frame)
        assert (forwarded.state, forwarded.left) == (ForwardState.WHOLE, frame)
    # One that cuts a position goes the slow path: nothing that a drive could take for a frame has left.
    forwarded = way.forwarded(frame_of(bytes.fromhex("03 05 20 00 01")))
    assert (forwarded.state, way.events[-1]) == (ForwardState.ABORTED, ForwardEvent.UNFIT)


def test_a_read_that_cuts_a_position_does_not_prevent_forwarding_of_the_others() -> None:
    way = Way()
    way.store(bytes.fromhex("03 05 20 00 01"))
    way.store(read(ACTUAL))
    forwarded = way.forwarded(frame_of(read(ACTUAL)))
    assert (forwarded.state, forwarded.left) == (ForwardState.WHOLE, frame_of(read(ACTUAL)))


@pytest.mark.parametrize(
    "pdu",
    [
        "06 06 06 00 00",  # a single register
        "10 06 06 00 02 04 00 00 00 00",  # a position that was not written before
        "10 06 08 00 02 04 00 00 00 00",  # other registers
        "17 05 20 00 02 06 06 00 02 04 00 00 00 00",  # read and write in one
        "05 00 01 FF 00",
        "04 05 20 00 02",  # a function that has not been used
    ],
)
def test_a_request_with_an_unknown_beginning_is_stored(pdu: str) -> None:
    way = Way()
    way.bench.ask(write(COMMAND, 10_000))
    way.store(read(ACTUAL))
    forwarded = way.forwarded(frame_of(bytes.fromhex(pdu)))
    assert (forwarded.state, forwarded.left) == (ForwardState.STORED, b"")


def test_no_forwarding_begins_while_the_line_is_not_free() -> None:
    way = settled()
    way.is_free = False
    assert way.forwarded(frame_of(write(COMMAND, 10_120))).state is ForwardState.STORED


def test_a_broadcast_and_another_unit_are_stored() -> None:
    way = settled()
    for unit_id in (0, 2):
        assert way.forwarded(frame_of(write(COMMAND, 10_120), unit_id)).state is ForwardState.STORED


def test_two_writes_that_begin_alike_are_both_stored() -> None:
    way = settled()
    block = bytes.fromhex("10 06 06 00 03 06") + write(COMMAND, 10_120)[6:] + b"\0\0"
    way.store(block)
    assert way.forwarded(frame_of(write(COMMAND, 10_160))).state is ForwardState.STORED
    way.stream(*range(10_200, 14_000, 40))
    assert way.forwarded(frame_of(write(COMMAND, 14_000))).state is ForwardState.STORED


def test_the_first_block_with_a_known_beginning_is_spoilt_and_those_after_it_are_stored() -> None:
    way = settled()
    block = bytes.fromhex("10 06 06 00 03 06") + write(COMMAND, 10_120)[6:] + b"\0\0"
    forwarded = way.forwarded(frame_of(block))
    assert (forwarded.state, way.events[-1]) == (ForwardState.ABORTED, ForwardEvent.UNFIT)
    assert forwarded.arrival.progress is Progress.GOOD
    assert len(forwarded.left) == WRITE_SHAPE.length
    way.store(block)
    assert way.forwarded(frame_of(block)).state is ForwardState.STORED


def test_a_target_for_an_axis_whose_drive_fell_silent_is_stored() -> None:
    way = settled()
    way.bench.line.axes[0].fall_silent(way.bench.now_ns, way.bench.now_ns)
    forwarded = way.forwarded(frame_of(write(COMMAND, 10_120)))
    assert (forwarded.state, way.left) == (ForwardState.STORED, [])


def test_requests_are_stored_until_the_port_was_measured() -> None:
    heads = Heads(Delays(CHAR_NS, CHAR_NS, CHAR_NS))
    way = Way()
    pdu = write(COMMAND, 10_000)
    path = way.units.path_of(1, pdu)
    heads.add(path, b"\x01" + pdu, b"\x01" + pdu)
    assert heads.opening(b"\x01" + pdu[:3]) is None
    learn(heads.delays, WRITE_SHAPE)
    opening = heads.opening(b"\x01" + pdu[:3])
    assert opening is not None
    assert (opening.shape, opening.delay_ns, opening.filler) == (WRITE_SHAPE, 4000, b"\x01" + pdu)
    assert heads.opening(b"\x01" + pdu[:2]) is None


def test_another_port_is_another_controller() -> None:
    way = settled()
    other = Port()
    other.writer = "panel"
    judge = RequestJudge(other, way.units, way.heads, lambda *_: True, lambda *_: None)
    forwarded = ForwardedFrame(RequestArrival(), judge, PACE, way.events.append)
    play(forwarded, characters(frame_of(write(COMMAND, 10_120))))
    assert forwarded.state is ForwardState.STORED
