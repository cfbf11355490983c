"""Cut-through on one line: frames are parsed as they arrive, and forwarded where that is allowed.

:class:`Forwarding` is the only part that the rest of the exchange knows. Only a line whose configuration asks
for cut-through has one. One :class:`Forwarder` follows the requests of each controller port, and one the
replies of the drives. A forwarder sees the bytes of all frames, as the decoder does, each from the first byte
after a silence. A frame that is not forwarded takes the usual path, and the forwarder learns from it how the
port delivers bytes.

Requests and replies differ in what is expected, which judge decides, where bytes are sent and what is
learned. A :class:`Way` has these differences: :class:`RequestWay` or :class:`ReplyWay`. Forwarded bytes are
sent by the line, like complete frames (:class:`ForwardingLine`).
"""

from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from gateway.exchange.axis.acknowledge import SteadyTarget
from gateway.exchange.cut_through.delay import (
    CRC_BYTES,
    REMEMBERED,
    Delays,
    FrameShape,
    Piece,
    guard_ns,
    margin_ns,
)
from gateway.exchange.cut_through.frame import ForwardedFrame, ForwardEvent, ForwardingPace, ForwardState
from gateway.exchange.cut_through.line import ForwardingLine
from gateway.exchange.cut_through.replies import Replies, ReplyJudge, reply_shape_of
from gateway.exchange.cut_through.requests import WRITE, Heads, RequestJudge, beginning_of, shape_of
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.fast_path import ReadPath, WritePath
from gateway.exchange.ports import ControllerPort, DriveLink, Stamps
from gateway.exchange.tap import Tap
from gateway.exchange.transaction import FastPath, Phase, Transaction
from gateway.modbus.rtu_arrival import Progress, ReplyArrival, RequestArrival
from gateway.modbus.rtu_line import pause_ns
from gateway.status.line import CutThroughStatus, Forwarded
from gateway.times import NS_PER_MS, NS_PER_US

ABORTED_SILENCES: Final = 3
"""Number of silences after an aborted frame: a receiver that cannot tell its length must see where it
ends."""
WASTED: Final = frozenset(
    {
        ForwardEvent.UNFIT,
        ForwardEvent.REFUSED,
        ForwardEvent.CHANGED,
        ForwardEvent.STALLED,
        ForwardEvent.ANEW,
        ForwardEvent.MET,
    }
)
"""Reasons for which a frame was aborted that would have been sent completely if stored."""


class SerialTiming(NamedTuple):
    """Timing of a serial wire: its character time, and its silence between frames."""

    char_ns: int
    silence_ns: int
    """3.5 characters, or the fixed time that replaces them."""

    @property
    def pause_ns(self) -> int:
        """The longest pause between two characters of a frame: 1.5 characters, or the fixed time for them."""
        return pause_ns(self.silence_ns)


class Pauses:
    """The time between pieces of a frame, learned from the last complete frames."""

    __slots__ = ("_longest", "longest_ns")

    def __init__(self, char_ns: int) -> None:
        self._longest: deque[int] = deque((char_ns,), maxlen=REMEMBERED)
        self.longest_ns = char_ns

    def add(self, pieces: Sequence[Piece]) -> None:
        """Learn from a complete frame."""
        longest_ns = 0
        for before, piece in pairwise(pieces):
            longest_ns = max(longest_ns, piece.came_ns - before.came_ns)
        self._longest.append(longest_ns)
        self.longest_ns = max(self._longest)


class Totals:
    """The results of all frames of one way since the start."""

    __slots__ = ("ended", "gain_ns", "stored")

    def __init__(self) -> None:
        self.ended = dict.fromkeys(ForwardEvent, 0)
        """Frames by their result: COMMITTED were forwarded, KEPT were stored."""
        self.stored = dict.fromkeys(ForwardEvent, 0)
        """Those of these frames of which no byte was sent."""
        self.gain_ns = 0
        """Sum over all forwarded frames: the time from the first byte sent until the frame was complete."""

    def status(self) -> Forwarded:
        """Return the counts for the status: forwarded, stored or aborted, and why."""
        whole = self.ended[ForwardEvent.COMMITTED]
        return Forwarded(
            cut_through=whole,
            gain_us=round(self.gain_ns / whole / NS_PER_US) if whole else None,
            stored={event.value: number for event, number in self.stored.items() if number},
            spoilt={
                event.value: number - self.stored[event]
                for event, number in self.ended.items()
                if event is not ForwardEvent.COMMITTED and number > self.stored[event]
            },
        )


class Forwarding:
    """Cut-through on one line.

    Args:
        line: carries out what the line does for a forwarded request.
        link: the link to the drives; asked for its time stamps.
        units: the register maps of the line.
        wire: the wire of the drives.
        gap_ns: silence that the drives need before each request.
        stored_units: unit ids of devices that are no axes: only silence marks the end of their frames.
        on_change: called after each step of a forwarded frame: the deadline of the line may have changed.
        report_no_gain: called once for each port and direction in which cut-through gains nothing, with the
            reason.
        report_fault: called with a sentence for an impossible pair.
        tap: sees the traffic. It does not see frames that are incomplete.
    """

    def __init__(
        self,
        line: ForwardingLine,
        link: DriveLink,
        units: UnitMaps,
        wire: SerialTiming,
        *,
        gap_ns: int,
        stored_units: frozenset[int],
        on_change: Callable[[], None],
        report_no_gain: Callable[[str], None],
        report_fault: Callable[[str], None],
        tap: Tap | None,
    ) -> None:
        self.tap = tap
        self.line = line
        self.link = link
        self.units = units
        self.wire = wire
        self.stored_units = stored_units
        self.silence_ns = max(gap_ns, ABORTED_SILENCES * wire.silence_ns)
        """After an aborted request."""
        self.requests = Totals()
        self.replies = Totals()
        self.underruns = 0
        """Number of frames inside which the transmitter was empty."""
        self.on_change = on_change
        self.report_no_gain = report_no_gain
        self.report_fault = report_fault
        self._reported: set[tuple[str, str]] = set()
        self._reply_way = ReplyWay(self)
        self.drives = self._reply_way.forwarder
        """Follows the replies of the drives."""
        self._ways: dict[ControllerPort, RequestWay] = {}

    # --- the ports of controllers -----------------------------------------------------------------------

    def follow(self, port: ControllerPort, wire: SerialTiming) -> "Forwarder":
        """Follow the requests of an opened port, on its wire."""
        way = self._ways[port] = RequestWay(self, port, wire)
        return way.forwarder

    def gone(self, port: ControllerPort, now_ns: int) -> None:
        """A port was lost."""
        way = self._ways.pop(port, None)
        if way is not None:
            way.forwarder.end(ForwardEvent.GONE, now_ns)

    def way_of(self, port: ControllerPort | None) -> "RequestWay | None":
        """Return the way of the requests of a port; None: they are not followed."""
        return None if port is None else self._ways.get(port)

    @property
    def is_leaving(self) -> bool:
        """Whether a part of a frame was sent, and the rest must follow in time."""
        forwarders = [self.drives, *(way.forwarder for way in self._ways.values())]
        return any(forwarder.is_leaving for forwarder in forwarders)

    # --- what the line reports of its transactions ------------------------------------------------------

    def end_request(self, transaction: Transaction, why: ForwardEvent, now_ns: int) -> None:
        """Send no more of the request that is being forwarded."""
        way = self.way_of(transaction.port)
        assert way is not None
        way.forwarder.end(why, now_ns)

    def end_reply(self, why: ForwardEvent, now_ns: int) -> None:
        """The reply is not needed any more, or will not come."""
        self.drives.end(why, now_ns)

    def expect(self, transaction: Transaction) -> None:
        """Expect the reply to this request next; drop what came of another one."""
        self._reply_way.expect(transaction)

    def answered(self, path: FastPath, transaction: Transaction, reply: bytes, now_ns: int) -> bytes | None:
        """Return the result of ``path.answered``, which is called once for each reply."""
        return self._reply_way.nominal_reply(transaction) or path.answered(transaction, reply, now_ns)

    def add(self, transaction: Transaction, reply: bytes, passed: bytes | None, now_ns: int) -> None:
        """Remember an answered request, and the gateway's own time for it and for its reply.

        ``passed``: the reply as its controller got it, if the request took the fast path.
        """
        way = self.way_of(transaction.port)
        pdu = transaction.pdu
        if way is None or transaction.added is not None:
            return
        asked, answered = self.link.stamps, way.port.stamps
        way.own_ns = asked.sent_ns - (transaction.started_ns or transaction.arrived_ns)
        self._reply_way.own_ns = answered.sent_ns - now_ns
        if reply[0] != pdu[0] or transaction.unit_id in self.stored_units:
            return
        if pdu[0] == WRITE and reply != pdu[:5]:
            return
        if passed is not None and isinstance(transaction.path, ReadPath):
            way.replies.add(transaction, passed)
        sent = _sent_pdu(transaction)
        unit_id = bytes((transaction.unit_id,))
        path = self.units.path_of(transaction.unit_id, pdu)
        way.heads.add(path, unit_id + pdu, unit_id + sent)

    # --- statistics -------------------------------------------------------------------------------------

    def learn(
        self, way: "Way", controller: str, delays: Delays, shape: FrameShape, frame: ForwardedFrame
    ) -> None:
        """Learn from the arrival of a frame, whatever its result; report once if forwarding gains nothing."""
        if shape.late is not None:
            delays.measure(shape.late, frame.pieces, way.own_ns, frame.written_need_ns)
        delay = delays.measure(shape, frame.pieces, way.own_ns, frame.written_need_ns)
        if delay.no_gain is None or (controller, way.what) in self._reported:
            return
        self._reported.add((controller, way.what))
        begins_ms, whole_ms = (each / NS_PER_MS for each in delay.no_gain)
        self.report_no_gain(
            f"{way.what} of {controller}: one of {shape.length} bytes could begin to leave {begins_ms:.2f} "
            f"ms after its first bytes came, and is whole after {whole_ms:.2f} ms"
        )

    def status(self) -> CutThroughStatus:
        """Return the counts of requests and replies since the start."""
        return CutThroughStatus(
            requests=self.requests.status(), replies=self.replies.status(), torn=self.underruns
        )


class Forwarder:
    """Follows arriving frames one after the other: the requests of one port, or the replies of the drives.

    Args:
        way: what is special about these frames.
        forwarding: of the line.
        in_ns: time of one character on the incoming wire.
    """

    __slots__ = ("_came", "_forwarding", "_frame", "_last_ns", "_now_ns", "_pauses", "_way")

    def __init__(self, way: "Way", forwarding: Forwarding, in_ns: int) -> None:
        self._way = way
        self._forwarding = forwarding
        self._pauses = Pauses(in_ns)
        self._frame: ForwardedFrame | None = None
        """The frame that arrives, or that came last. None: nothing of the arriving one is forwarded."""
        self._came: ForwardedFrame | None = None
        """A complete frame from which the port has not learned yet."""
        self._last_ns = 0
        """When the last bytes came."""
        self._now_ns = 0

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` must be called."""
        return None if self._frame is None else self._frame.deadline_ns

    @property
    def is_leaving(self) -> bool:
        """Whether bytes of the arriving frame were sent and others must follow."""
        return self._frame is not None and self._frame.is_on_the_way

    def feed(self, data: bytes, now_ns: int, *, is_fresh: bool) -> bool:
        """Take bytes, before the decoder does; return whether they ended a frame that was sent with them.

        The decoder yields that frame too; such a request must not be sent again. ``is_fresh``: the decoder
        holds no bytes, and a reply of the drives begins with these.
        """
        silent_ns, self._last_ns, self._now_ns = now_ns - self._last_ns, now_ns, now_ns
        if is_fresh and self._way.begins(silent_ns, self._frame):
            if self._frame is not None and self._frame.is_on_the_way:
                # The loop was late: the decoder dropped the rest before the guard timer was served.
                self.end(ForwardEvent.STALLED, now_ns)
            self._learn()
            self._frame = self._way.begin(self._pauses.longest_ns, self._happened)
        frame = self._frame
        if frame is None:
            return False
        was, previous_progress = frame.state, frame.arrival.progress
        out = frame.feed(data, now_ns)
        if previous_progress is not Progress.GOOD and frame.arrival.progress is Progress.GOOD:
            self._came = frame
        return self._go_on(frame, was, out)

    def tick(self, now_ns: int) -> None:
        """Do what is due."""
        frame = self._frame
        if frame is not None:
            self._now_ns = now_ns
            self._go_on(frame, frame.state, frame.tick(now_ns))

    def end(self, why: ForwardEvent, now_ns: int) -> None:
        """Send no more of the arriving frame. A request takes the usual path if all of it comes."""
        frame = self._frame
        if frame is not None:
            self._now_ns = now_ns
            self._go_on(frame, frame.state, frame.go_on(why, now_ns))

    def drop(self) -> None:
        """Drop what came; nothing more of it is sent."""
        self._frame = None

    def _happened(self, event: ForwardEvent) -> None:
        """Handle an event of the arriving frame while its step still runs."""
        frame = self._frame
        assert frame is not None
        if event is ForwardEvent.OPENED:
            self._way.opened(frame.expected, self._now_ns)
        elif frame.is_over:
            totals = self._way.totals
            totals.ended[event] += 1
            totals.stored[event] += frame.state is ForwardState.STORED
            if frame.state is ForwardState.WHOLE:
                gain_ns = self._now_ns - frame.began_ns
                totals.gain_ns += gain_ns
                self._way.gained(frame.expected, gain_ns)
            elif frame.state is ForwardState.ABORTED and event in WASTED:
                self._way.wasted(frame.expected)

    def _go_on(self, frame: ForwardedFrame, was: ForwardState, out: bytes) -> bool:
        """Write what is to be sent; return whether all of it was sent with its own CRC."""
        if not out and frame.state is was:
            return False
        if out:
            stamps = self._way.send(frame, out, self._now_ns)
            is_measured = stamps.sent_ns > 0
            ready_ns = stamps.ready_ns if is_measured else self._now_ns
            frame.written(len(out), ready_ns, stamps.sent_ns if is_measured else self._now_ns)
        if frame.is_over:
            self._forwarding.underruns += frame.gap_ns > 0
            self._way.ended(frame, out, self._now_ns)
        self._forwarding.on_change()
        return frame.state is ForwardState.WHOLE

    def _learn(self) -> None:
        """Learn from the frame before, when the next one begins: this never delays a byte."""
        frame, self._came = self._came, None
        if frame is not None:
            self._pauses.add(frame.pieces)
            self._way.learn(frame)


class Way:
    """What differs between requests and replies: expectation, judge, destination and what is learned.

    Args:
        forwarding: of the line.
        what: the kind of frame, in one word.
        totals: the results of these frames.
        in_ns: time of one character on the incoming wire.
    """

    __slots__ = ("forwarder", "forwarding", "own_ns", "totals", "what")

    def __init__(self, forwarding: Forwarding, what: str, totals: Totals, in_ns: int) -> None:
        self.forwarding = forwarding
        self.what = what
        self.totals = totals
        self.forwarder = Forwarder(self, forwarding, in_ns)
        self.own_ns = 0
        """Time that the gateway took between reading and writing the last answered one."""

    def begins(self, silent_ns: int, frame: ForwardedFrame | None) -> bool:
        """Whether a new frame begins after a silence and after this frame."""
        raise NotImplementedError

    def begin(self, longest_ns: int, on_event: Callable[[ForwardEvent], None]) -> ForwardedFrame | None:
        """Return the frame that begins now; None: nothing of it is forwarded.

        ``longest_ns``: the longest time between its pieces.
        """
        raise NotImplementedError

    def opened(self, expected: bytes, now_ns: int) -> None:
        """The first bytes of a frame are about to be sent."""

    def send(self, frame: ForwardedFrame, piece: bytes, now_ns: int) -> Stamps:
        """Send a piece of a frame, the last one if the frame is WHOLE; return the time stamps."""
        raise NotImplementedError

    def gained(self, expected: bytes, gain_ns: int) -> None:
        """A frame was forwarded, and began to be sent this much earlier than if stored."""

    def wasted(self, expected: bytes) -> None:
        """A frame was aborted that would have been sent completely if stored."""
        raise NotImplementedError

    def ended(self, frame: ForwardedFrame, filling: bytes, now_ns: int) -> None:
        """Nothing more of a frame is sent; ``filling``: the bytes that were sent last."""
        raise NotImplementedError

    def learn(self, frame: ForwardedFrame) -> None:
        """Learn from a complete frame, whatever its result."""
        raise NotImplementedError


class RequestWay(Way):
    """The way of the requests of one port to the drives."""

    __slots__ = ("_transaction", "heads", "port", "replies", "wire")

    def __init__(self, forwarding: Forwarding, port: ControllerPort, wire: SerialTiming) -> None:
        super().__init__(forwarding, "requests", forwarding.requests, wire.char_ns)
        drives = forwarding.wire
        self.port = port
        self.wire = wire
        """The incoming wire."""
        self.heads = Heads(Delays(wire.char_ns, drives.char_ns, margin_ns(drives.char_ns)))
        self.replies = Replies(Delays(drives.char_ns, wire.char_ns, margin_ns(wire.char_ns)))
        """The replies to the port."""
        self._transaction: Transaction | None = None
        """The request that is being sent; None: there is none, or the line did not allow it."""

    def begins(self, silent_ns: int, frame: ForwardedFrame | None) -> bool:
        """See ``Way``."""
        return silent_ns >= self.wire.silence_ns

    def begin(self, longest_ns: int, on_event: Callable[[ForwardEvent], None]) -> ForwardedFrame | None:
        """See ``Way``."""
        forwarding = self.forwarding
        line = forwarding.line
        judge = RequestJudge(self.port, forwarding.units, self.heads, line.may_forward, self._commit)
        pace = _pace(self.wire, forwarding.wire, longest_ns)
        return ForwardedFrame(RequestArrival(), judge, pace, on_event, forwarding.report_fault)

    def opened(self, expected: bytes, now_ns: int) -> None:
        """See ``Way``."""
        self._transaction = self.forwarding.line.begin(self.port, expected, now_ns)

    def _commit(self, path: FastPath, pdu: bytes, target: SteadyTarget | None, now_ns: int) -> bytes | None:
        """Let the rest of the request be sent; None: it may not be."""
        transaction = self._transaction
        if transaction is None:
            return None
        return self.forwarding.line.commit(transaction, path, pdu, target, now_ns)

    def send(self, frame: ForwardedFrame, piece: bytes, now_ns: int) -> Stamps:
        """See ``Way``."""
        forwarding, transaction = self.forwarding, self._transaction
        if transaction is not None and frame.state is ForwardState.WHOLE:
            forwarding.line.forward_last(transaction, frame.left[1:-CRC_BYTES], piece, now_ns)
            forwarding.expect(transaction)
        elif transaction is not None:
            forwarding.line.forward(transaction, piece, now_ns)
        return forwarding.link.stamps

    def gained(self, expected: bytes, gain_ns: int) -> None:
        """See ``Way``."""
        self.heads.pay(expected, gain_ns)

    def wasted(self, expected: bytes) -> None:
        """See ``Way``. The sender waits for the filling and for the silence behind it."""
        forwarding = self.forwarding
        self.heads.pay(expected, -(forwarding.silence_ns + len(expected) * forwarding.wire.char_ns))

    def ended(self, frame: ForwardedFrame, filling: bytes, now_ns: int) -> None:
        """See ``Way``."""
        transaction, self._transaction = self._transaction, None
        if transaction is not None and frame.state is ForwardState.ABORTED:
            forwarding = self.forwarding
            # Counted from the writing: the process may have been suspended between reading and writing.
            written_ns = forwarding.link.stamps.sent_ns + len(filling) * forwarding.wire.char_ns
            until_ns = max(frame.empty_ns, written_ns) + forwarding.silence_ns
            forwarding.line.aborted(transaction, until_ns, now_ns)

    def learn(self, frame: ForwardedFrame) -> None:
        """See ``Way``."""
        data = frame.arrival.data
        self.heads.saw(data)
        shape = shape_of(self.forwarding.units.path_of(data[0], data[1:-CRC_BYTES]), data)
        if shape is not None:
            self.forwarding.learn(self, self.port.name, self.heads.delays, shape, frame)
            self.heads.came(beginning_of(data))


class ReplyWay(Way):
    """The way of the replies of the drives to the controllers."""

    __slots__ = ("_judge", "_transaction")

    def __init__(self, forwarding: Forwarding) -> None:
        super().__init__(forwarding, "replies", forwarding.replies, forwarding.wire.char_ns)
        self._transaction: Transaction | None = None
        """The transaction whose reply is followed."""
        self._judge: ReplyJudge | None = None

    def expect(self, transaction: Transaction) -> None:
        """Expect the reply to this request next; drop what came of another one."""
        self._transaction, self._judge = transaction, None
        self.forwarder.drop()

    def nominal_reply(self, transaction: Transaction) -> bytes | None:
        """Return the reply on the nominal scale, as computed when all of it had come; None: not computed."""
        judge = self._judge
        return judge.nominal_reply if judge is not None and self._transaction is transaction else None

    def begins(self, silent_ns: int, frame: ForwardedFrame | None) -> bool:
        """See ``Way``. A request has one reply."""
        return frame is None

    def begin(self, longest_ns: int, on_event: Callable[[ForwardEvent], None]) -> ForwardedFrame | None:
        """See ``Way``."""
        transaction = self._transaction
        if transaction is None or transaction.phase is not Phase.SENT or transaction.is_orphan:
            return None
        asked = self.forwarding.way_of(transaction.port)
        if asked is None or reply_shape_of(transaction) is None:
            return None
        self._judge = ReplyJudge(transaction, asked.replies)
        arrival = ReplyArrival(transaction.wire_unit_id, transaction.pdu)
        pace = _pace(self.forwarding.wire, asked.wire, longest_ns)
        return ForwardedFrame(arrival, self._judge, pace, on_event, self.forwarding.report_fault)

    def send(self, frame: ForwardedFrame, piece: bytes, now_ns: int) -> Stamps:
        """See ``Way``."""
        transaction, tap = self._transaction, self.forwarding.tap
        assert transaction is not None
        port = transaction.port
        assert port is not None
        if frame.state is ForwardState.WHOLE:
            reply = frame.left[1:-CRC_BYTES]
            if tap is not None:
                tap.answered_early(port, transaction.transaction_id, transaction.unit_id, reply)
            port.forward_last(transaction.transaction_id, transaction.unit_id, reply, piece)
        else:
            port.forward(piece)
        return port.stamps

    def wasted(self, expected: bytes) -> None:
        """See ``Way``. The controller must repeat its request, so such replies are stored for a while."""
        transaction = self._transaction
        if transaction is not None:
            asked, shape = self.forwarding.way_of(transaction.port), reply_shape_of(transaction)
            if asked is not None and shape is not None:
                asked.replies.rest(shape)

    def ended(self, frame: ForwardedFrame, filling: bytes, now_ns: int) -> None:
        """See ``Way``."""
        if self._transaction is not None and (
            frame.state is ForwardState.WHOLE or frame.state is ForwardState.ABORTED
        ):
            self._transaction.give_up()  # its controller has received these bytes and gets no other reply

    def learn(self, frame: ForwardedFrame) -> None:
        """See ``Way``."""
        judge = frame.judge
        assert isinstance(judge, ReplyJudge)
        asked, shape = self.forwarding.way_of(judge.transaction.port), reply_shape_of(judge.transaction)
        if asked is not None and shape is not None:
            self.forwarding.learn(self, asked.port.name, asked.replies.delays, shape, frame)
            asked.replies.came(shape)


def _pace(comes_on: SerialTiming, leaves_on: SerialTiming, longest_ns: int) -> ForwardingPace:
    """Return the pace of a frame whose pieces are at most ``longest_ns`` apart."""
    return ForwardingPace(leaves_on.char_ns, comes_on.pause_ns + longest_ns, guard_ns(leaves_on.char_ns))


def _sent_pdu(transaction: Transaction) -> bytes:
    """Return a request as it was sent."""
    path, target, pdu = transaction.path, transaction.target, transaction.pdu
    if target is not None and isinstance(path, WritePath):
        start, end = path.byte_range
        return pdu[:start] + target.corrected_words + pdu[end:]
    requests = transaction.requests
    return requests[0].sent_pdu if len(requests) == 1 else pdu
