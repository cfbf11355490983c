"""The link to the drives of one line: it frames requests and finds the expected reply.

There are two kinds. RTU, over a serial port or through a serial device server: replies carry no number, so a
reply belongs to the one outstanding request. Without one, all bytes go to the exchange as stray bytes.
Modbus/TCP: the gateway numbers its own requests; a reply with another number is late and is dropped.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.compiled import mypyc_attr
from gateway.exchange.cut_through.forward import Forwarder
from gateway.exchange.line import LineExchange
from gateway.exchange.ports import DriveLink
from gateway.modbus.mbap import LARGEST_SENT, MbapDecoder, answers_with, encode_mbap
from gateway.modbus.rtu import RtuReplyDecoder, encode_rtu
from gateway.modbus.rtu_replies import RETURNED_OFTEN
from gateway.relay.pacing import WireWriter
from gateway.transport.channel import CLOSED_BY_PEER, Channel
from gateway.transport.tcp import TcpConnector
from gateway.transport.timer import Timer

BROADCAST_UNIT_ID: Final = 0
LAST_ID: Final = 0xFFFF
FIRST_ID: Final = 1
"""Transaction ids towards drives run from here to ``LAST_ID`` and wrap. 0 is left out: servers that ignore
the id reply with 0, and their reply would match any request."""
NONE: Final = -1
"""Used instead of a transaction id while no reply is awaited."""
UNANSWERED_LIMIT: Final = 1024
"""This many ids of unanswered requests are not used again; older ones are forgotten. No drive replies more
than a thousand time-outs late."""
NEWEST: Final = 32
NEWEST_MASK: Final = (1 << NEWEST) - 1


@dataclass(slots=True)
class Instead:
    """What came instead of the replies of one unit id."""

    total: int = 0
    """Unanswered requests during which it came."""
    newest: int = 0
    """One bit for each of the newest unanswered requests, the last in the lowest bit; 1: it came."""

    def add(self, *, came: bool) -> None:
        """Count an unanswered request."""
        self.total += came
        self.newest = (self.newest << 1 | came) & NEWEST_MASK

    def among(self, timeouts: int) -> int:
        """Return during how many of the last ``timeouts`` unanswered requests, 32 at most, it came."""
        return (self.newest & ((1 << min(timeouts, NEWEST)) - 1)).bit_count()


@dataclass(slots=True)
class OtherIds(Instead):
    """Replies of one unit id with a transaction id that no request had."""

    asked_id: int = 0
    """Transaction id of the newest such request."""
    answered_id: int = 0
    """Transaction id of the reply that came instead."""

    def __str__(self) -> str:
        """Say what the drive does."""
        return answers_with(self.asked_id, self.answered_id)


@mypyc_attr(allow_interpreted_subclasses=True)
class Link(DriveLink):
    """What a line needs of its drive link beyond what the exchange needs."""

    def __init__(self, *, is_serial: bool) -> None:
        super().__init__(is_serial=is_serial)
        self.connector: TcpConnector | None = None
        """Makes and ends its connections; None: it is a serial port, or a test provides the channel."""
        self.opened_channel: Channel | None = None
        self.was_asked = False
        """Whether anything was sent on the current or last connection."""
        self.damage: dict[int, Instead] = {}
        """Unanswered requests during which bytes came that made no frame, by unit id. Always empty on TCP,
        which damages nothing."""
        self.other_ids: dict[int, OtherIds] = {}
        """Unanswered requests during which a reply with another transaction id came, by unit id. Always empty
        on RTU."""

    @property
    def returns_requests(self) -> bool:
        """Whether the adapter echoes, and the configuration does not say so."""
        return False

    def over(self, connector: TcpConnector) -> None:
        """Set what makes its connections; called before the first one."""
        self.connector = connector
        self.connects = True

    @property
    def bytes_received(self) -> int:
        """How many bytes have come on the current or last connection."""
        return 0 if self.opened_channel is None else self.opened_channel.count_received()

    def want(self) -> None:
        """See ``DriveLink``."""
        if self.connector is not None:
            self.connector.want()

    def renew(self) -> None:
        """See ``DriveLink``."""
        if self.connector is not None:
            self.connector.renew()

    def hang_up(self, *, returns: bool) -> None:
        """See ``DriveLink``."""
        if self.connector is not None:
            self.connector.hang_up(returns=returns)

    def attach(self, exchange: LineExchange) -> None:
        """Set the exchange that gets the replies; called before the first byte comes."""
        raise NotImplementedError

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``."""
        raise NotImplementedError

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``."""
        raise NotImplementedError

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        raise NotImplementedError

    def counters(self) -> dict[str, int]:
        """Return the framing counters, for the status."""
        raise NotImplementedError

    def close(self) -> None:
        """Release the timers, if there are any."""


class RtuDriveLink(Link):
    """RTU frames to the drives, over a wire or over TCP.

    ``gap_ns``: silence that the drives need before each request; ``wire_gap_ns``: silence that a wire needs.
    ``has_echo``: the adapter echoes; this class removes the echo of forwarded requests. ``on_return`` is
    called once if the adapter echoes without ``has_echo``.
    """

    def __init__(
        self,
        gap_ns: int,
        decoder: RtuReplyDecoder,
        wire_gap_ns: int = 0,
        *,
        has_echo: bool = False,
        on_return: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(is_serial=True)
        self._on_return = on_return
        self._has_reported_return = False
        self._decoder = decoder
        self._wire = WireWriter(gap_ns, wire_gap_ns)
        self._timer = Timer(self._silent)
        self._exchange: LineExchange
        self._forwarder: Forwarder | None = None
        self._forward_timer: Timer | None = None
        self._has_echo = has_echo
        self._own = b""
        """Forwarded bytes of which the echo has not come completely."""
        self._heard_own = b""
        """The part of their echo that has come."""
        self._asked_unit_id = 0
        self._damaged_before = 0
        """Count of damage when the newest request was sent."""
        self.stamps = self._wire.stamps

    @property
    def returns_requests(self) -> bool:
        """See ``Link``."""
        return self._decoder.returned >= RETURNED_OFTEN

    def attach(self, exchange: LineExchange) -> None:
        """See ``Link``."""
        self._exchange = exchange
        if exchange.forwarding is not None:
            self._forwarder = exchange.forwarding.drives
            self._forward_timer = Timer(self._forward_due)

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """See ``DriveLink``. A broadcast expects no reply."""
        if len(self._own):
            self._forget_own()
        self.was_asked = True
        self._asked_unit_id = unit_id
        self._damaged_before = self._decoder.counters.damaged
        if unit_id != BROADCAST_UNIT_ID:
            self._decoder.expect(unit_id, pdu)
        else:
            self._decoder.expect_echo(unit_id, pdu)
        self._wire.write(encode_rtu(unit_id, pdu))

    def may_forward(self, now_ns: int) -> bool:
        """See ``DriveLink``."""
        return self._wire.may_begin(now_ns)

    def forward(self, piece: bytes) -> None:
        """See ``DriveLink``."""
        if self._has_echo:
            self._own += piece
        self._wire.write(piece)

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """See ``DriveLink``."""
        self._asked_unit_id = unit_id
        self._damaged_before = self._decoder.counters.damaged
        self._decoder.expect_unechoed(unit_id, pdu)
        self.forward(rest)

    def abandon(self) -> None:
        """See ``DriveLink``."""
        self._forget_own()
        if self._decoder.is_expecting:
            self._decoder.cancel()
            self._timer.arm(None)
            damage = self.damage.setdefault(self._asked_unit_id, Instead())
            damage.add(came=self._decoder.counters.damaged != self._damaged_before)

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``."""
        self.opened_channel, self.was_asked = channel, False
        self._decoder.reset()
        self._forget_own()
        self._wire.opened(channel, now_ns)
        self._exchange.link_up(now_ns)

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``."""
        self._wire.heard(now_ns)
        if self._forwarder is not None:
            data = self._forward(self._forwarder, data, now_ns)
            if not data:
                return
        decoder = self._decoder
        pdu = decoder.one(data)
        if len(pdu):
            self._timer.arm(decoder.deadline_ns)  # first: see _pass_on
            self._exchange.reply(data[0], pdu, now_ns)
            return
        counters = decoder.counters
        stray_bytes, frames = counters.stray_bytes, counters.stray_frames + counters.foreign
        replies = decoder.feed(data, now_ns)
        if decoder.returned >= RETURNED_OFTEN and not self._has_reported_return:
            self._has_reported_return = True
            self._on_return()
        is_frame = counters.stray_frames + counters.foreign != frames
        if is_frame or counters.stray_bytes != stray_bytes:
            self._exchange.stray(now_ns, unit_id=decoder.late_unit_id if is_frame else -1)
        self._pass_on(replies, now_ns)

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        self._decoder.reset()
        self._forget_own()
        self._timer.arm(None)
        self._wire.closed()
        self._exchange.link_down(now_ns, reason, is_orderly=reason == CLOSED_BY_PEER)

    def counters(self) -> dict[str, int]:
        """See ``Link``."""
        counters = self._decoder.counters
        return {
            "damaged": counters.damaged,
            "crc_errors": counters.crc_errors,
            "dropped_bytes": counters.dropped_bytes,
            "stray_bytes": counters.stray_bytes,
            "stray_frames": counters.stray_frames,
            "foreign_frames": counters.foreign,
            "echoes": counters.echoes,
        }

    def close(self) -> None:
        """See ``Link``."""
        self._timer.close()
        if self._forward_timer is not None:
            self._forward_timer.close()

    def _forward(self, forwarder: Forwarder, data: bytes, now_ns: int) -> bytes:
        """Forward the bytes of a reply that may be sent; return the received bytes without the echo."""
        if self._own:
            data = self._without_own(data)
        if data:
            forwarder.feed(data, now_ns, is_fresh=self._decoder.is_at_reply)
            self._arm_forwarding(forwarder)
        return data

    def _without_own(self, data: bytes) -> bytes:
        """Remove the echo of the own request, byte by byte.

        The first byte that differs shows that this is no echo, or that something collided with it on the
        wire. Then all bytes count as sent by the drives.
        """
        heard = self._heard_own + data
        count = min(len(self._own), len(heard))
        if heard[:count] != self._own[:count]:
            self._forget_own()
            return heard
        if count < len(self._own) or not self._decoder.is_expecting:
            # More of the request may follow.
            self._heard_own = heard[:count]
            return heard[count:]
        self._forget_own()
        self._decoder.counters.echoes += 1
        return heard[count:]

    def _forget_own(self) -> None:
        self._own = self._heard_own = b""

    def _forward_due(self, now_ns: int) -> None:
        if self._forwarder is not None:
            self._forwarder.tick(now_ns)
            self._arm_forwarding(self._forwarder)

    def _arm_forwarding(self, forwarder: Forwarder) -> None:
        if self._forward_timer is not None:
            self._forward_timer.arm(forwarder.deadline_ns)

    def _silent(self, now_ns: int) -> None:
        decoder = self._decoder
        foreign = decoder.counters.foreign
        replies = decoder.on_silence(now_ns)
        if decoder.counters.foreign != foreign:
            self._exchange.stray(now_ns, unit_id=decoder.late_unit_id)
        self._pass_on(replies, now_ns)

    def _pass_on(self, replies: list[tuple[int, bytes]], now_ns: int) -> None:
        # Armed first: inside reply() the exchange may send its next request, which arms the timer again.
        self._timer.arm(self._decoder.deadline_ns)
        for unit_id, pdu in replies:
            self._exchange.reply(unit_id, pdu, now_ns)


@dataclass(frozen=True, slots=True)
class ReplyUnitIds:
    """Which unit id the replies of a Modbus/TCP line carry.

    With several drives behind one connection, another unit id is another drive. With one drive the
    transaction id is enough: some published servers reply with unit id 0 or 1 to every request.
    """

    are_many: bool = False
    answers_as: int | None = None
    """The unit id in the replies of a single drive, if it is known."""


class MbapDriveLink(Link):
    """Modbus/TCP to the drives, with its own transaction ids.

    ``gap_ns``: silence before each request. ``on_wrong_unit`` gets the requested unit id and the one in the
    reply, once for each pair. ``on_other_id`` gets a unit id and what it replies with, once for each unit id.
    """

    def __init__(
        self,
        gap_ns: int,
        unit_ids: ReplyUnitIds = ReplyUnitIds(),
        on_wrong_unit: Callable[[int, int], None] = lambda _asked, _answered: None,
        on_other_id: Callable[[int, OtherIds], None] = lambda _unit_id, _other_ids: None,
    ) -> None:
        super().__init__(is_serial=False)
        self._on_other_id = on_other_id
        self._gap_ns = gap_ns
        self._unit_ids = unit_ids
        self._on_wrong_unit = on_wrong_unit
        self._reported: set[tuple[int, int]] = set()
        self._wrong_units = 0
        self._wire = WireWriter(gap_ns)
        self._decoder = MbapDecoder(longest_length=LARGEST_SENT)
        self._channel: Channel | None = None
        self._exchange: LineExchange
        self._last_id = 0
        self._awaited_id = NONE
        self._other_id = self._other_for = NONE
        """Id of the newest reply that matches no request, and the id that was awaited when it came."""
        self._awaited_unit_id = 0
        self._unanswered: dict[int, int] = {}
        """Unit ids of the unanswered requests, by transaction id."""
        self._late = 0
        self._malformed = 0
        self.stamps = self._wire.stamps

    def attach(self, exchange: LineExchange) -> None:
        """See ``Link``."""
        self._exchange = exchange

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """See ``DriveLink``."""
        transaction_id = self._new_id()
        self.was_asked = True
        self._awaited_id = transaction_id
        self._awaited_unit_id = unit_id
        self._wire.write(encode_mbap(transaction_id, unit_id, pdu))

    def abandon(self) -> None:
        """See ``DriveLink``."""
        if self._awaited_id == NONE:
            return
        self._unanswered[self._awaited_id] = self._awaited_unit_id
        if len(self._unanswered) > UNANSWERED_LIMIT:
            del self._unanswered[next(iter(self._unanswered))]
        self._count_unanswered(self._awaited_id, self._awaited_unit_id)
        self._awaited_id = NONE

    def came_instead(self, unit_id: int) -> str:
        """See ``DriveLink``."""
        other_ids = self.other_ids.get(unit_id)
        return str(other_ids) if other_ids is not None and other_ids.among(1) else ""

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``."""
        self._channel = self.opened_channel = channel
        self.was_asked = False
        self._decoder = MbapDecoder(longest_length=LARGEST_SENT)
        self._awaited_id = self._other_for = NONE
        self._unanswered.clear()
        self._wire.opened(channel, now_ns - self._gap_ns)
        self._exchange.link_up(now_ns)

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``. A connection that does not carry Modbus/TCP is closed and opened again."""
        self._wire.heard(now_ns)
        decoder = self._decoder
        pdu = decoder.one(data)
        if len(pdu):
            self._take(decoder.transaction_id, decoder.unit_id, pdu, now_ns)
        else:
            for transaction_id, unit_id, pdu in decoder.feed(data):
                self._take(transaction_id, unit_id, pdu, now_ns)
        if len(self._decoder.broken_by) and self._channel is not None:
            self._malformed += 1
            self._channel.close()
            self._channel = None

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        self._channel = None
        self._awaited_id = NONE
        self._wire.closed()
        if len(self._decoder.broken_by):
            reason = f"closed after a malformed header: {self._decoder.broken_by.hex(' ')}"
        self._exchange.link_down(now_ns, reason, is_orderly=reason == CLOSED_BY_PEER)

    def counters(self) -> dict[str, int]:
        """See ``Link``."""
        return {
            "late_replies": self._late,
            "malformed": self._malformed,
            "crc_errors": 0,
            "wrong_units": self._wrong_units,
        }

    def _take(self, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int) -> None:
        if transaction_id != self._awaited_id:
            asked_unit_id = self._unanswered.pop(transaction_id, -1)
            if asked_unit_id < 0 and self._is_other_id(transaction_id, unit_id):
                self._other_id, self._other_for = transaction_id, self._awaited_id
            else:
                self._late += 1
            self._exchange.stray(now_ns, unit_id=asked_unit_id)
        elif unit_id == self._awaited_unit_id or self._is_answer_all_the_same(unit_id):
            self._awaited_id = NONE
            self._exchange.reply(self._awaited_unit_id, pdu, now_ns)
        else:
            self._exchange.stray(now_ns)

    def _is_answer_all_the_same(self, unit_id: int) -> bool:
        """Whether a reply with the right transaction id is valid although its unit id differs."""
        if unit_id == self._unit_ids.answers_as:
            return True
        self._wrong_units += 1
        pair = self._awaited_unit_id, unit_id
        if pair not in self._reported:
            self._reported.add(pair)
            self._on_wrong_unit(*pair)
        return not self._unit_ids.are_many

    def _is_other_id(self, transaction_id: int, unit_id: int) -> bool:
        """Whether an id that belongs to no unanswered request is meant for the awaited request.

        The id of the request before is excluded: its reply may have come twice.
        """
        if self._awaited_id == NONE or (self._unit_ids.are_many and unit_id != self._awaited_unit_id):
            return False
        return transaction_id == 0 or transaction_id != self._awaited_id - 1

    def _count_unanswered(self, asked_id: int, unit_id: int) -> None:
        """Record what came instead of a reply."""
        came = self._other_for == asked_id
        other_ids = self.other_ids.get(unit_id)
        is_first = other_ids is None
        if other_ids is None:
            if not came:
                return
            other_ids = self.other_ids[unit_id] = OtherIds()
        other_ids.add(came=came)
        if came:
            other_ids.asked_id, other_ids.answered_id = asked_id, self._other_id
        if is_first:
            self._on_other_id(unit_id, other_ids)

    def _new_id(self) -> int:
        candidate = self._last_id + 1 if self._last_id < LAST_ID else FIRST_ID
        while len(self._unanswered) and candidate in self._unanswered:
            candidate = candidate + 1 if candidate < LAST_ID else FIRST_ID
        self._last_id = candidate
        return candidate
