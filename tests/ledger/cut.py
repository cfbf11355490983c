"""Lines between two serial wires whose frames may leave while they arrive (``cut_through``).

Characters take their time here, on the controller's wire and on that of the drives; adapters hand them over
one by one or in lumps. Masters pause inside of frames, break off and garble any byte. Ports and link are what
the relay's are, in virtual time: the decoders and forwarders of the gateway, and beside them two wires that
hear everything (``buses``).
"""

import random
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from gateway.exchange.cut_through.forward import Forwarder, Forwarding, SerialTiming
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, silence_ns
from tests.ledger.buses import ABORTED_SILENCES, Bus, reply_length, request_length
from tests.ledger.clock import MS, Clock
from tests.ledger.controllers import SerialMaster
from tests.ledger.events import Book
from tests.ledger.exchanges import Frame
from tests.ledger.frames import rtu
from tests.ledger.wires import RtuWire

BAUD_RATES: Final = (9_600, 19_200, 38_400)
BITS: Final = 11
PAUSES: Final = (0.0005, 0.002, 0.02)
"""Share of frames with a pause inside: a port that often makes one gains nothing."""
BURSTS_MS: Final = (0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 16.0)
"""Every so often an adapter hands over what has come; 0: each character."""


class Speeds(NamedTuple):
    """How fast both wires of a line are, and how their adapters hand characters over."""

    controller: SerialTiming
    drives: SerialTiming
    controller_burst_ns: int
    drives_burst_ns: int
    pauses: float


def random_speeds(rng: random.Random) -> Speeds:
    """Mostly two wires that are equally fast."""
    bauds = [rng.choice(BAUD_RATES)] * 2 if rng.random() < 0.6 else [rng.choice(BAUD_RATES) for _ in range(2)]
    wires = [SerialTiming(BITS * 1_000_000_000 // baud, silence_ns(baud)) for baud in bauds]
    bursts = [int(rng.choice(BURSTS_MS) * MS) for _ in wires]
    return Speeds(wires[0], wires[1], bursts[0], bursts[1], rng.choice(PAUSES))


def handed_over(data: bytes, begin_ns: int, char_ns: int, burst_ns: int) -> Iterator[tuple[int, bytes]]:
    """Give what an adapter hands over, and when, of characters that come without a pause."""
    burst, at_ns = b"", 0
    for index in range(len(data)):
        ends_ns = begin_ns + (index + 1) * char_ns
        due_ns = -(-ends_ns // burst_ns) * burst_ns if burst_ns else ends_ns
        if burst and due_ns != at_ns:
            yield at_ns, burst
            burst = b""
        burst, at_ns = burst + data[index : index + 1], due_ns
    yield at_ns, burst


class ForwardingWire(RtuWire):
    """RTU on a serial bus, to which requests may leave in pieces."""

    speeds: Speeds
    bus: Bus
    _leaving_unit = 0

    def become(self, speeds: Speeds) -> None:
        """Say how fast it is; before the first byte."""
        self.speeds = speeds
        self.bus = Bus(
            speeds.drives,
            "the drives",
            request_length,
            self._ledger.book,
            lambda: self._ledger.witness(self._leaving_unit).journal,
            silences=ABORTED_SILENCES,
        )
        self._decoder = RtuReplyDecoder(speeds.drives.silence_ns)

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        self._leaving_unit = unit_id
        frame, fault = self._accounted(unit_id, pdu)
        data = self._framed(unit_id, pdu)
        self._put(data, frame, fault, self.bus.whole(data, self._clock.now_ns))

    def may_forward(self, now_ns: int) -> bool:
        return self._is_open and self.bus.may_begin(now_ns)

    def forward(self, piece: bytes) -> None:
        if self.bus.may_begin(self._clock.now_ns):
            self._leaving_unit = piece[0]
        self._ledger.witness(self._leaving_unit).journal.note("leaves", piece)
        self.bus.piece(piece, self._clock.now_ns)

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        frame, fault = self._accounted(unit_id, pdu)
        data = self._framed(unit_id, pdu)
        self._put(data, frame, fault, self.bus.leave(rest, data, self._clock.now_ns))

    def drop(self) -> None:
        """Lose the connection, in the middle of a frame too."""
        super().drop()
        self.bus.break_off()

    def _send_back(self, data: bytes, frame: Frame, at_ns: int) -> None:
        wire, burst_ns = self.speeds.drives, self.speeds.drives_burst_ns
        begin_ns = max(at_ns, self.bus.ends_ns + wire.silence_ns)
        cut, pause_ns = len(data), 0
        if self._rng.random() < self.speeds.pauses and len(data) > 4:
            cut, pause_ns = self._rng.randrange(1, len(data)), int(self._rng.uniform(0.1, 3.0) * wire.char_ns)
        for came_ns, burst in handed_over(data[:cut], begin_ns, wire.char_ns, burst_ns):
            self._clock.at(came_ns, self._hearing(burst, frame))
        if cut < len(data):
            begin_ns += cut * wire.char_ns + pause_ns
            for came_ns, burst in handed_over(data[cut:], begin_ns, wire.char_ns, burst_ns):
                self._clock.at(came_ns, self._hearing(burst, frame))

    def _hearing(self, burst: bytes, frame: Frame) -> Callable[[], None]:
        return lambda: self._heard(burst, frame)

    def _received(self, data: bytes) -> None:
        line, now_ns = self.line, self._clock.now_ns
        assert line is not None
        assert line.forwarding is not None
        self.bus.other_end(now_ns)
        counters, decoder, forwarder = self._decoder.counters, self._decoder, line.forwarding.drives
        stray_bytes, frames = counters.stray_bytes, counters.stray_frames + counters.foreign
        is_at_reply = decoder.is_at_reply
        replies = decoder.feed(data, now_ns)
        # What leaves with the last byte is held against what the drive said with it.
        if replies:
            self._ledger.delivering(replies[0][1], self._heard_for)
        forwarder.feed(data, now_ns, is_fresh=is_at_reply)
        call_when_due(self._clock, forwarder)
        is_frame = counters.stray_frames + counters.foreign != frames
        if is_frame or counters.stray_bytes != stray_bytes:
            line.stray(now_ns, unit_id=decoder.late_unit_id if is_frame else -1)
        if decoder.deadline_ns is not None:
            self._clock.at(decoder.deadline_ns, self._silent)
        for number, (unit_id, pdu) in enumerate(replies):
            if number:
                self._ledger.delivering(pdu, self._heard_for)
            line.reply(unit_id, pdu, now_ns)
            self._ledger.delivered()


class ForwardingMaster(SerialMaster):
    """A controller on a serial wire, whose requests come a character after the other."""

    speeds: Speeds
    bus: Bus
    forwarder: Forwarder

    def become(self, speeds: Speeds) -> None:
        """Say how fast its wire is, and let its requests be followed; before the first one."""
        self.speeds = speeds
        book = self._ledger.book
        self.bus = Bus(
            speeds.controller,
            "the controller",
            reply_length,
            book,
            lambda: self._ledger.witness(0 if self._step is None else self._step[0]).journal,
        )
        self._decoder = RtuRequestDecoder(speeds.controller.silence_ns)
        assert self._line.forwarding is not None
        self.forwarder = self._line.forwarding.follow(self, speeds.controller)

    # --- requests ----------------------------------------------------------------------------------------

    def _send(self, data: bytes) -> float:
        """See ``SerialMaster``: with pauses, broken off, with any byte damaged."""
        rng, seen = self._rng, self._ledger.book.seen
        wire, burst_ns = self.speeds.controller, self.speeds.controller_burst_ns
        chance, cut, pause_ns = rng.random(), len(data), 0
        if chance < self.speeds.pauses:
            cut, pause_ns = rng.randrange(1, len(data)), int(rng.uniform(0.5, 30.0) * wire.char_ns)
            seen["requests with a pause inside"] += 1
        elif 0.02 < chance < 0.03:
            data = data[: rng.randrange(1, len(data))]
            cut = len(data)
            seen["requests broken off"] += 1
        elif 0.03 < chance < 0.04:
            index = rng.randrange(len(data))
            data = data[:index] + bytes((data[index] ^ 1 << rng.randrange(8),)) + data[index + 1 :]
            seen["requests damaged"] += 1
        begin_ns = max(self._clock.now_ns, self.bus.ends_ns + wire.silence_ns)
        end_ns = begin_ns + len(data) * wire.char_ns + pause_ns
        for came_ns, burst in handed_over(data[:cut], begin_ns, wire.char_ns, burst_ns):
            self._clock.at(came_ns, self._coming(burst))
        if cut < len(data):
            begin_ns += cut * wire.char_ns + pause_ns
            for came_ns, burst in handed_over(data[cut:], begin_ns, wire.char_ns, burst_ns):
                self._clock.at(came_ns, self._coming(burst))
        return (end_ns - self._clock.now_ns) / MS

    def _coming(self, burst: bytes) -> Callable[[], None]:
        return lambda: self._come(burst)

    def _come(self, burst: bytes) -> None:
        now_ns, forwarder, decoder = self._clock.now_ns, self.forwarder, self._decoder
        self.bus.other_end(now_ns)
        is_fresh = decoder.is_between_frames
        requests = decoder.feed(burst, now_ns)
        # One that leaves with its last byte has arrived with it.
        is_one = len(requests) == 1
        if is_one:
            self._ledger.arrived(self.book, 0, *requests[0], now_ns)
        has_left = forwarder.feed(burst, now_ns, is_fresh=is_fresh)
        call_when_due(self._clock, forwarder)
        if is_one and not has_left:
            self._line.request(self, 0, *requests[0], now_ns)
        elif not is_one:
            self._take(requests)
        self._await_silence()

    # --- replies -----------------------------------------------------------------------------------------

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        ends_ns = self.bus.whole(rtu(unit_id, pdu), self._clock.now_ns)
        self._heard(unit_id, pdu, (ends_ns - self._clock.now_ns) / MS)

    def may_forward(self, now_ns: int) -> bool:
        return self.bus.may_begin(now_ns)

    def forward(self, piece: bytes) -> None:
        self.bus.piece(piece, self._clock.now_ns)

    def forward_last(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        ends_ns = self.bus.leave(rest, rtu(unit_id, pdu), self._clock.now_ns)
        self._heard(unit_id, pdu, (ends_ns - self._clock.now_ns) / MS)


def call_when_due(clock: Clock, forwarder: Forwarder) -> None:
    """Have a forwarder called when it wants to be."""
    deadline_ns = forwarder.deadline_ns
    if deadline_ns is None:
        return

    def due() -> None:
        forwarder.tick(clock.now_ns)
        after_ns = forwarder.deadline_ns
        if after_ns is not None and (after_ns > clock.now_ns or after_ns != deadline_ns):
            call_when_due(clock, forwarder)

    clock.at(deadline_ns, due)


def check_counts(forwarding: Forwarding, wire: ForwardingWire, master: ForwardingMaster, book: Book) -> None:
    """Hold what the line has counted against what both wires heard; and put it into the book."""
    wire.bus.finish()
    master.bus.finish()
    for what, totals, bus in (
        ("requests", forwarding.requests, wire.bus),
        ("replies", forwarding.replies, master.bus),
    ):
        ended, stored = totals.ended, totals.stored
        book.seen[f"cut line: {what} cut through"] += ended[ForwardEvent.COMMITTED]
        for event, count in ended.items():
            if event is not ForwardEvent.COMMITTED:
                book.seen[f"cut line: {what} stored, {event.value}"] += stored[event]
                book.seen[f"cut line: {what} spoilt, {event.value}"] += count - stored[event]
        aborted = sum(ended.values()) - sum(stored.values()) - ended[ForwardEvent.COMMITTED]
        told, heard = (ended[ForwardEvent.COMMITTED], aborted), (bus.in_pieces, bus.not_whole)
        if heard != told:
            book.violation("counted-otherwise", f"{what}: whole, spoilt {heard} heard, {told} told", None)
    book.seen["cut line: torn"] += forwarding.underruns
