"""A line between two wires that cuts through: bytes come, and are sent, at their own times.

A character takes 1 ms on either wire, so that times can be worked out by hand. The silence between frames is
3.5 ms; a pause inside a frame may have 1.5 ms. The line is that of ``line_bench``, with the real decoders and
forwarders, and with ports and a link that record.
"""

from collections.abc import Callable
from typing import Any

from gateway.exchange.cut_through.delay import FrameShape
from gateway.exchange.cut_through.forward import SerialTiming
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.plan import AxisPlan, ControllerPlan, Role
from gateway.modbus.crc import append_crc
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder
from tests.exchange.cut_bench import learn
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Link, Port, stream_plan, write
from tests.exchange.test_fast_path import CURVE

CHAR_NS = MS
WIRE = SerialTiming(CHAR_NS, 3_500_000)
PLAN = stream_plan(table=CURVE)
Left = list[tuple[float, str]]
"""Instants in ms from when a happening began, and what left then, in hex."""


class PiecePort(Port):
    """A controller's serial port, which also records replies that are sent in pieces."""

    def __init__(self, site: "Site", plan: ControllerPlan) -> None:
        super().__init__(plan)
        self.site = site
        self.left: list[tuple[int, bytes]] = []
        self.on_piece: Callable[[], None] = lambda: None
        self.is_busy = False
        self.decoder = RtuRequestDecoder(WIRE.silence_ns)

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        super().send_reply(transaction_id, unit_id, pdu)
        self.left.append((self.site.bench.now_ns, append_crc(bytes((unit_id,)) + pdu)))

    def may_forward(self, now_ns: int) -> bool:
        return not self.is_busy

    def forward(self, piece: bytes) -> None:
        self.stamps.ready_ns = self.site.bench.now_ns
        self.on_piece()
        self.left.append((self.site.bench.now_ns, piece))
        self.stamps.sent_ns = self.site.bench.now_ns

    def forward_last(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        self.replies.append((transaction_id, unit_id, pdu))
        self.forward(rest)


class PieceLink(Link):
    """The link to the drives, which also records requests that are sent in pieces."""

    def __init__(self) -> None:
        super().__init__(is_serial=True)
        self.now_ns: Callable[[], int] = lambda: 0
        self.left: list[tuple[int, bytes]] = []
        self.on_piece: Callable[[], None] = lambda: None
        self.is_busy = False
        self.decoder = RtuReplyDecoder(WIRE.silence_ns)

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        super().send_request(unit_id, pdu)
        if unit_id:
            self.decoder.expect(unit_id, pdu)
        self.forward(append_crc(bytes((unit_id,)) + pdu))

    def abandon(self) -> None:
        super().abandon()
        self.decoder.cancel()

    def may_forward(self, now_ns: int) -> bool:
        return not self.is_busy

    def forward(self, piece: bytes) -> None:
        self.stamps.ready_ns = self.now_ns()
        self.on_piece()
        self.left.append((self.now_ns(), piece))
        self.stamps.sent_ns, self.stamps.wire_ns_per_byte = self.now_ns(), CHAR_NS

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        self.sent.append((unit_id, pdu))
        self.decoder.expect(unit_id, pdu)
        self.forward(rest)


class Site:
    """The line, a motion controller ``cnc`` and a second one, ``panel``; time passes in :meth:`pass_to`."""

    def __init__(self, *plans: AxisPlan, **options: Any) -> None:
        self.link = PieceLink()
        self.bench = Bench(*(plans or (PLAN,)), link=self.link, cut_through=WIRE, **options)
        self.link.now_ns = lambda: self.bench.now_ns
        self.line = self.bench.line
        assert self.line.forwarding is not None
        self.forwarding = self.line.forwarding
        self.cnc = PiecePort(self, ControllerPlan("cnc", serial=True))
        self.panel = PiecePort(self, ControllerPlan("panel", serial=True, role=Role.OPERATOR))
        self.bench.port = self.cnc
        self.forwarder = self.forwarding.follow(self.cnc, WIRE)
        way = self.forwarding.way_of(self.cnc)
        assert way is not None
        self.way = way
        self.forwarders = {self.cnc: self.forwarder, self.panel: self.forwarding.follow(self.panel, WIRE)}

    # --- before -------------------------------------------------------------------------------------------

    def measure(self, *shapes: FrameShape, of_replies: bool = False) -> None:
        """Measure the delay of a shape with enough frames, character by character."""
        learn(self.way.replies.delays if of_replies else self.way.heads.delays, *shapes, char_ns=CHAR_NS)

    def settle(self) -> None:
        """Send a stored stream until no correction is blended any more: it ends at 10 000 counts."""
        for counts in range(2_000, 10_001, 160):
            self.bench.ask(write(COMMAND, counts))
            self.bench.memory.put(ACTUAL, self.bench.memory.get(COMMAND))
            self.pass_to(self.bench.now_ns + 10 * MS)
        self.forget()
        self.link.decoder.cancel()

    def forget(self) -> None:
        """Forget the bytes sent so far."""
        for each in (self.link, self.cnc, self.panel):
            each.left.clear()
        self.link.sent.clear()
        self.cnc.replies.clear()
        self.panel.replies.clear()

    # --- time and bytes -----------------------------------------------------------------------------------

    def pass_to(self, until_ns: int) -> None:
        """Let time pass, and call each timer when it falls due."""
        while (due_ns := min(self._deadlines(), default=until_ns)) < until_ns:
            self.bench.now_ns = max(due_ns, self.bench.now_ns)
            self._due(self.bench.now_ns)
        self.bench.now_ns = until_ns

    def _deadlines(self) -> list[int]:
        found = [each.deadline_ns for each in self.forwarders.values()]
        found += [port.decoder.deadline_ns for port in self.forwarders]
        found += [self.forwarding.drives.deadline_ns, self.link.decoder.deadline_ns, self.line.deadline_ns]
        return [each for each in found if each is not None]

    def _due(self, now_ns: int) -> None:
        for port, forwarder in self.forwarders.items():
            forwarder.tick(now_ns)
            assert isinstance(port, PiecePort)
            self._requests(port, port.decoder.on_silence(now_ns))
        self.forwarding.drives.tick(now_ns)
        for unit_id, pdu in self.link.decoder.on_silence(now_ns):
            self.line.reply(unit_id, pdu, now_ns)
        self.line.tick(now_ns)

    def _requests(self, port: PiecePort, requests: list[tuple[int, bytes]]) -> None:
        for unit_id, pdu in requests:
            self.line.request(port, 0, unit_id, pdu, self.bench.now_ns)

    def hear(self, port: PiecePort, data: bytes) -> None:
        """Feed bytes of a controller now."""
        now_ns = self.bench.now_ns
        has_left = self.forwarders[port].feed(data, now_ns, is_fresh=port.decoder.is_between_frames)
        requests = port.decoder.feed(data, now_ns)
        self._requests(port, requests[has_left:])

    def answer(self, data: bytes) -> None:
        """Feed bytes of the drives now."""
        now_ns, decoder = self.bench.now_ns, self.link.decoder
        self.forwarding.drives.feed(data, now_ns, is_fresh=decoder.is_at_reply)
        counters = decoder.counters
        before = counters.stray_bytes, counters.stray_frames + counters.foreign
        replies = decoder.feed(data, now_ns)
        if (counters.stray_bytes, counters.stray_frames + counters.foreign) != before:
            is_frame = counters.stray_frames + counters.foreign != before[1]
            self.line.stray(now_ns, unit_id=decoder.late_unit_id if is_frame else -1)
        for unit_id, pdu in replies:
            self.line.reply(unit_id, pdu, now_ns)

    def come(self, frame: bytes, port: PiecePort | None = None, *, since_ns: int = 0) -> int:
        """Feed a frame of a controller character by character; return when its first bit came."""
        began_ns = since_ns or self.bench.now_ns
        for number in range(len(frame)):
            self.pass_to(began_ns + (number + 1) * CHAR_NS)
            self.hear(port or self.cnc, frame[number : number + 1])
        return began_ns

    def reply(self, frame: bytes) -> int:
        """Feed a reply of the drives character by character; return when its first bit came."""
        began_ns = self.bench.now_ns
        for number in range(len(frame)):
            self.pass_to(began_ns + (number + 1) * CHAR_NS)
            self.answer(frame[number : number + 1])
        return began_ns

    def serve(self) -> None:
        """Let the drive answer the request on the wire now."""
        current = self.line._transactions.current
        assert current is not None
        self.answer(frame_of(self.bench.memory.answer(self.link.sent[-1][1]), current.wire_unit_id))

    # --- what left ----------------------------------------------------------------------------------------

    def to_drives(self, began_ns: int) -> Left:
        """Return the bytes sent to the drives, and forget them."""
        left, self.link.left = self.link.left, []
        return [((when - began_ns) / MS, data.hex(" ")) for when, data in left]

    def to_cnc(self, began_ns: int) -> Left:
        """Return the bytes sent to the controller, and forget them."""
        left, self.cnc.left = self.cnc.left, []
        return [((when - began_ns) / MS, data.hex(" ")) for when, data in left]

    def requests(self) -> dict[ForwardEvent, int]:
        """Return how forwarded requests ended."""
        found = self.forwarding.requests.ended.items()
        return {event: count for event, count in found if count and event is not ForwardEvent.KEPT}

    def replies(self) -> dict[ForwardEvent, int]:
        """Return how forwarded replies ended."""
        return {event: count for event, count in self.forwarding.replies.ended.items() if count}


def frame_of(pdu: bytes, unit_id: int = 1) -> bytes:
    """Return a frame with its check sum."""
    return append_crc(bytes((unit_id,)) + pdu)
