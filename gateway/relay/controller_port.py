"""Controllers: one port for each accepted TCP connection, one for each serial line.

A port decodes whole requests from the bytes and passes them to the exchange in the same call. No cycle of the
loop comes between the last byte of a request and the write to the drive.
"""

from collections.abc import Callable
from typing import Final

from gateway.clock import boot_ns
from gateway.exchange.cut_through.forward import Forwarder, SerialTiming
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan
from gateway.exchange.ports import ControllerPort, writer_name
from gateway.modbus.mbap import Adu, MbapCounters, MbapDecoder, encode_mbap, too_long
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from gateway.modbus.rtu import Frame, RtuRequestDecoder, encode_rtu
from gateway.modbus.rtu_echo import Echo, ReplyEcho
from gateway.relay.pacing import PacedReplies, WireWriter
from gateway.relay.pulse import FRESH_NS, Beats
from gateway.transport.channel import IN_ORDER, Channel
from gateway.transport.endpoints import host_of
from gateway.transport.timer import Timer

TOO_SLOW: Final = "it came in pieces for longer than its controller's timeout_ms"
STOOD_STILL: Final = "it waited longer than its controller's timeout_ms while the relay was stopped"
HAS_GONE: Final = "its controller closed the connection"
SENT_ANOTHER: Final = "its controller sent another request"
NO_OTHERS: Final[list[Adu]] = []
"""For bytes that hold no further request."""
NO_FRAMES: Final[list[Frame]] = []
"""The same, for RTU."""


class Asked:
    """When a controller sent its last request, on any of its connections."""

    def __init__(self) -> None:
        self.newest_ns = 0
        """When its newest whole request came; 0: never."""


class MbapControllerPort(ControllerPort):
    """One Modbus/TCP connection of a controller."""

    def __init__(
        self,
        plan: ControllerPlan,
        exchange: LineExchange,
        counters: MbapCounters,
        on_malformed: Callable[[str], None],
        *,
        beats: Beats,
        asked: Asked | None = None,
    ) -> None:
        super().__init__(plan)
        self._asked = asked or Asked()
        self._exchange = exchange
        self._beats = beats
        self._on_malformed = on_malformed
        self._decoder = MbapDecoder(counters)
        self._fresh_ns = min(FRESH_NS, self.patience_ns)
        self._channel: Channel | None = None
        self.asked_ns = 0
        """When its last whole request came; 0: never."""
        self.unfinished_ns = 0
        """Since when a request is incomplete; 0: none is."""

    @property
    def is_served(self) -> bool:
        """Whether it got a reply."""
        return self.stamps.sent_ns > 0

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``."""
        self._channel = channel
        self.peer = host_of(channel.peer)
        self.writer = writer_name(self.plan.name, self.peer)

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``.

        Two things end the connection: a request that began longer ago than the controller's patience, which
        is not forwarded, and a header with an impossible length. The controller waits for no reply after
        either of them.
        """
        channel = self._channel
        if channel is None:
            return
        began_ns = self.unfinished_ns or now_ns
        decoder = self._decoder
        pdu = decoder.one(data)
        is_one = len(pdu) > 0
        requests = NO_OTHERS if is_one else decoder.feed(data)
        is_any = is_one or len(requests) > 0
        why_given_up = TOO_SLOW if is_any and now_ns - began_ns > self.patience_ns else ""
        beats = self._beats
        may_be_old = beats.stood_still(now_ns, self._fresh_ns)
        if may_be_old and beats.stood_still(now_ns, self.patience_ns):
            why_given_up = STOOD_STILL
        if is_any and not why_given_up and channel.has_gone(asks=may_be_old):
            why_given_up = HAS_GONE
        if is_one:
            transaction_id, unit_id = decoder.transaction_id, decoder.unit_id
            self._exchange.request(self, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)
        for transaction_id, unit_id, pdu in requests:
            self._exchange.request(self, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)
        if is_any:
            self.asked_ns = self._asked.newest_ns = now_ns
            self.unfinished_ns = 0
        if not is_one:
            self.unfinished_ns = 0 if decoder.is_between_frames else self.unfinished_ns or now_ns
        is_broken = len(decoder.broken_by) > 0
        if is_broken:
            self._refuse(decoder.broken_by, channel.peer)
        if is_broken or why_given_up:
            channel.close()
            self._channel = None
        beats.traffic(now_ns)

    def _refuse(self, head: bytes, peer: str) -> None:
        """Answer a request of impossible length with an exception, if that is possible."""
        answer = too_long(head)
        if answer is not None:
            self.send_reply(*answer)
        self._on_malformed(peer)

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        self._channel = None
        self._exchange.controller_gone(self, now_ns, is_broken=reason not in IN_ORDER)

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """See ``ControllerPort``."""
        if self._channel is not None:
            self._channel.write(encode_mbap(transaction_id, unit_id, pdu))
            self.stamps.sent_ns = boot_ns()


class RtuControllerPort(ControllerPort):
    """A controller that uses RTU, over a serial port or through a serial device server.

    On a wire a reply begins at least ``gap_ns`` after the last byte of the request; without a wire there is
    no wait. ``wire`` allows cut-through, if the line uses it. With ``echo`` the echo of its replies is
    removed; ``on_echo`` is called once if the adapter echoes and the configuration does not say so.
    """

    def __init__(
        self,
        plan: ControllerPlan,
        exchange: LineExchange,
        decoder: RtuRequestDecoder,
        gap_ns: int,
        wire: SerialTiming | None = None,
        *,
        beats: Beats,
        asked: Asked | None = None,
        echo: ReplyEcho | None = None,
        on_echo: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(plan)
        self._echo = echo
        self._on_echo = on_echo
        self._has_reported_echo = False
        self._asked = asked or Asked()
        self._exchange = exchange
        self._beats = beats
        self._decoder = decoder
        self._gap_ns = gap_ns
        self._wire = wire
        self._forwarder: Forwarder | None = None
        self._forward_timer: Timer | None = None
        self._channel: Channel | None = None
        self._timer: Timer | None = None
        self._replies: PacedReplies | None = None
        self._wire_writer: WireWriter | None = None
        self.asked_ns = 0
        """When its last whole request came; 0: never."""
        self.whole = 0
        """Whole requests so far."""
        self._replied_unit_id = -1
        self._replied_pdu = self._replied_frame = b""
        """The newest reply and its frame: the replies to all writes of one position are equal."""
        self.unfinished_ns = 0
        """Always 0: a silence ends an incomplete request."""

    async def drained(self) -> None:
        """Wait until every reply has been sent after its silence."""
        if self._replies is not None:
            await self._replies.drained()

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``."""
        self._decoder.reset()
        if self._echo is not None:
            self._echo.begin_anew()
        self._channel = channel
        self.peer = host_of(channel.peer)
        self.writer = writer_name(self.plan.name, self.peer)
        self._timer = Timer(self._silent)
        self._wire_writer = WireWriter(0, self._gap_ns)
        self.stamps = self._wire_writer.stamps
        self._wire_writer.opened(channel, now_ns)
        self._replies = PacedReplies(self._wire_writer, self._expect_echo)
        if self._wire is not None and self._exchange.forwarding is not None:
            self._forwarder = self._exchange.forwarding.follow(self, self._wire)
        if self._forwarder is not None:
            self._forward_timer = Timer(self._forward_due)

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``."""
        if self._wire_writer is not None:
            self._wire_writer.heard(now_ns)
        if self._echo is not None:
            data = self._without_echo(self._echo, data, now_ns)
            if not data:
                return
        has_left = self._forwarder is not None and self._forward(self._forwarder, data, now_ns)
        decoder = self._decoder
        pdu = decoder.one(data, now_ns)
        requests = NO_FRAMES if len(pdu) else decoder.feed(data, now_ns)
        if has_left:
            self.asked_ns = self._asked.newest_ns = now_ns
            self.whole += 1
            pdu, requests = b"", requests[1:]
        is_one = len(pdu) > 0
        replies = self._replies
        if replies is not None and replies.is_waiting and (has_left or is_one or len(requests)):
            replies.discard()  # the controller has given up on it
        beats = self._beats
        why_given_up = ""
        if beats.stood_still(now_ns, self.patience_ns):
            why_given_up = STOOD_STILL
            decoder.reset()
        elif (is_one or len(requests)) and self._channel is not None:
            asks = beats.stood_still(now_ns, FRESH_NS)
            why_given_up = HAS_GONE if self._channel.has_gone(asks=asks) else ""
        if self._timer is not None:
            self._timer.arm(decoder.deadline_ns)
        if is_one:
            self._exchange.request(self, 0, data[0], pdu, now_ns, why_given_up=why_given_up)
            self.asked_ns = self._asked.newest_ns = now_ns
            self.whole += 1
        elif len(requests):
            self._pass_on(requests, now_ns, why_given_up)
        beats.traffic(now_ns)

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        if self._timer is not None and self._replies is not None:
            self._timer.close()
            self._replies.close()
        if self._forward_timer is not None:
            self._forward_timer.close()
        self._timer = self._forward_timer = self._channel = self._forwarder = None
        self._wire_writer = self._replies = None
        self._exchange.controller_gone(self, now_ns, is_broken=reason not in IN_ORDER)

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """See ``ControllerPort``."""
        if self._replies is not None:
            if unit_id != self._replied_unit_id or pdu != self._replied_pdu:
                self._replied_frame = encode_rtu(unit_id, pdu)
                self._replied_unit_id, self._replied_pdu = unit_id, pdu
            self._replies.send(self._replied_frame, self.newest_ns + self.patience_ns)

    def may_forward(self, now_ns: int) -> bool:
        """See ``ControllerPort``."""
        if self._echo is not None and self._echo.echo is Echo.UNKNOWN:
            return False  # the first reply shows whether the adapter echoes: it is sent whole
        wire, replies = self._wire_writer, self._replies
        return wire is not None and replies is not None and wire.may_begin(now_ns) and not replies.is_waiting

    def forward(self, piece: bytes) -> None:
        """See ``ControllerPort``."""
        if self._wire_writer is not None:
            self._expect_echo(piece)
            self._wire_writer.write(piece)

    def forward_last(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """See ``ControllerPort``."""
        self.forward(rest)

    def counters(self) -> dict[str, int]:
        """Return the framing counters, for the status."""
        counters = self._decoder.counters
        return {
            "whole": self.whole,
            "damaged": counters.damaged,
            "crc_errors": counters.crc_errors,
            "dropped_bytes": counters.dropped_bytes,
            "echoes": 0 if self._echo is None else self._echo.echoes,
        }

    @property
    def returns_replies(self) -> bool:
        """Whether its adapter echoes, and the configuration does not say so."""
        return self._echo is not None and self._echo.is_undeclared

    def _expect_echo(self, sent: bytes) -> None:
        """Expect the echo of sent bytes.

        As long as it is unknown whether the adapter echoes, no echo is expected of bytes that are sent during
        a request: the rest of that request is no echo.
        """
        echo = self._echo
        if echo is None or echo.echo is Echo.ABSENT:
            return
        if echo.echo is Echo.PRESENT or self._decoder.is_between_frames:
            wire_ns = self._gap_ns + len(sent) * self.stamps.wire_ns_per_byte
            echo.sent(sent, boot_ns(), wire_ns)

    def _without_echo(self, echo: ReplyEcho, data: bytes, now_ns: int) -> bytes:
        if echo.is_expected:
            has_slept = self._beats.stood_still(now_ns, FRESH_NS)
            data = echo.take(data, now_ns, has_slept=has_slept)
        elif data == self._replied_frame:
            wire_ns = 2 * len(data) * self.stamps.wire_ns_per_byte
            soonest_ns = self.stamps.sent_ns + wire_ns + self._gap_ns if wire_ns else 0
            data = b"" if echo.came_back(data, now_ns, soonest_ns) else data
        if echo.is_undeclared and not self._has_reported_echo:
            self._has_reported_echo = True
            self._on_echo()
        return data

    def _forward(self, forwarder: Forwarder, data: bytes, now_ns: int) -> bool:
        """Forward the bytes that may be sent; return whether they completed a forwarded request."""
        if self._beats.stood_still(now_ns, self.patience_ns):
            forwarder.end(ForwardEvent.STALLED, now_ns)
            return False
        has_left = forwarder.feed(data, now_ns, is_fresh=self._decoder.is_between_frames)
        self._arm_forwarding(forwarder)
        return has_left

    def _forward_due(self, now_ns: int) -> None:
        if self._forwarder is not None:
            self._forwarder.tick(now_ns)
            self._arm_forwarding(self._forwarder)

    def _arm_forwarding(self, forwarder: Forwarder) -> None:
        if self._forward_timer is not None:
            self._forward_timer.arm(forwarder.deadline_ns)

    def _silent(self, now_ns: int) -> None:
        requests = self._decoder.on_silence(now_ns)
        if self._replies is not None and requests:
            self._replies.discard()
        if self._timer is not None:
            self._timer.arm(self._decoder.deadline_ns)
        has_stood_still = self._beats.stood_still(now_ns, self.patience_ns)
        self._pass_on(requests, now_ns, STOOD_STILL if has_stood_still else "")

    def _pass_on(self, requests: list[tuple[int, bytes]], now_ns: int, why_all: str = "") -> None:
        last = len(requests) - 1
        for number, (unit_id, pdu) in enumerate(requests):
            # A controller that sends another request has given up on this one. It never waits for a
            # broadcast.
            is_given_up = number != last and unit_id != BROADCAST_UNIT_ID
            why = why_all or (SENT_ANOTHER if is_given_up else "")
            self._exchange.request(self, 0, unit_id, pdu, now_ns, why_given_up=why)
        if requests:
            self.asked_ns = self._asked.newest_ns = now_ns
            self.whole += len(requests)
