"""One line: who may send next, what is sent, whose reply comes back. Sans-IO; time is an argument.

States of the line:

- *down*: no way to the drives; requests are answered 0x0A (serial controllers: silence).
- *free*: the next request is sent in the same call in which it arrives.
- *busy*: one exchange is on the wire (W6); others wait, stops at their head (M3).
- *resting*: nothing is sent until an instant passes: the turnaround after a broadcast, or the silence after a
  time-out, so that a late reply never answers the next request (W6).
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Final

from gateway.exchange import control
from gateway.exchange.access import only_reads
from gateway.exchange.added_frames import reads_at_start
from gateway.exchange.answering import answer, note_broadcast, note_discrete
from gateway.exchange.axis import AxisExchange
from gateway.exchange.counters import LineCounters
from gateway.exchange.dispatch import Units, is_acting_on
from gateway.exchange.effects import note_unknown
from gateway.exchange.events import Event, EventKind
from gateway.exchange.groups import end_remapped, join
from gateway.exchange.life import QUEUE_LIMIT, Exchange, WaitingExchanges
from gateway.exchange.losses import lose, note_learned, note_unsent
from gateway.exchange.meaning import Meaning
from gateway.exchange.news import AxisNews
from gateway.exchange.plan import AxisPlan, LineTiming, Role
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.remembering import note_sending
from gateway.exchange.rest import Rest
from gateway.modbus.pdu import BROADCAST_UNIT_ID, ExceptionCode, exception_pdu, is_exception
from gateway.times import NS_PER_MS

LOST: Final = ExceptionCode.SERVER_DEVICE_FAILURE
REMAPPED: Final = "its drive's registers were moved about; corrected again after a restart of the gateway"


class LineExchange:
    """The exchanges of one line and the axes on it."""

    def __init__(
        self,
        axes: Sequence[AxisPlan],
        timing: LineTiming,
        link: DriveLink,
        on_event: Callable[[Event], None],
        groups: Iterable[Iterable[str]] = (),
    ) -> None:
        self.axes = [AxisExchange(plan) for plan in axes]
        join(self.axes, groups)
        self.counters = LineCounters()
        self._units = Units(self.axes, is_serial=link.is_serial)
        self._link = link
        self._on_event = on_event
        self._news = AxisNews(self.axes, on_event)
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self._rest = Rest(timing)
        self._waiting = WaitingExchanges()
        self._current: Exchange | None = None
        self.is_up = False
        """Whether there is a way to the drives."""
        self._is_stopping = False
        self._silent_units: set[int] = set()
        self._arrived_ns = 0

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` wants to be called; a few milliseconds late does no harm."""
        return self._rest.until_ns if self._current is None else self._current.deadline_ns

    @property
    def is_idle(self) -> bool:
        """Whether no exchange is on the wire."""
        return self._current is None

    # --- from controllers ------------------------------------------------------------------------------

    def request(
        self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int
    ) -> None:
        """Take a whole request; it goes out in this very call when the line is free."""
        if not pdu:
            self.counters.malformed += 1
            return
        if port.plan.serial:
            self._give_up(port, "its controller sent another request", now_ns)
        if self._is_stopping:
            return
        self._arrived_ns = max(now_ns, self._arrived_ns + 1)  # losses are told apart by it (M3)
        exchange = Exchange(port, transaction_id, unit_id, pdu, self._arrived_ns)
        is_free = self._current is None and self._rest.until_ns is None and not self._waiting
        role, may_write = port.plan.role, not only_reads(pdu)
        stops: list[Meaning] = []
        if self._units.have_rules and may_write and not (is_free and role is Role.MOTION):
            stops = self._units.stops_of(unit_id, pdu)
        may_stop = role is Role.OPERATOR and bool(stops) and self._units.only_stops(unit_id, pdu)
        if role is not Role.MOTION and may_write and not may_stop:
            self._refuse(exchange, ExceptionCode.ILLEGAL_FUNCTION)
        elif not self.is_up:
            self._note_unsent(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
            self._fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
        elif is_free:
            self._start(exchange, now_ns)
        elif stops:
            self._overtake(exchange, stops, now_ns)
        elif self._waiting.count(port) >= QUEUE_LIMIT:
            self._note_unsent(exchange, ExceptionCode.SERVER_DEVICE_BUSY)
            self._refuse(exchange, ExceptionCode.SERVER_DEVICE_BUSY)
        else:
            self._waiting.add(exchange)

    def _overtake(self, stop: Exchange, stops: list[Meaning], now_ns: int) -> None:
        """Put a stop at the head of the queue, and withdraw what would move its axes afterwards (M3)."""
        axes = [meaning.axis for meaning in stops]
        reason = "a stop of its axis came after it"
        for exchange in self._waiting.withdraw(lambda each: is_acting_on(self._units, each, axes)):
            self._overtaken(exchange, reason, now_ns)
        current = self._current
        if current and current.added and is_acting_on(self._units, current, axes):
            current.overtaken_by = reason
        stop.is_stop = True
        if not self._waiting.add_stop(stop):  # the same stop waits already, many times
            self._refuse(stop, ExceptionCode.SERVER_DEVICE_BUSY)

    def _overtaken(self, exchange: Exchange, reason: str, now_ns: int) -> None:
        self._withdrawn(exchange, reason, now_ns, ExceptionCode.SERVER_DEVICE_BUSY)
        self._refuse(exchange, ExceptionCode.SERVER_DEVICE_BUSY)

    def controller_gone(self, port: ControllerPort, now_ns: int) -> None:
        """Withdraw what a closed connection still has waiting (W5)."""
        self._give_up(port, "its connection closed", now_ns)

    def _give_up(self, port: ControllerPort, reason: str, now_ns: int) -> None:
        """Withdraw what a controller has given up on; a reply to what is on the wire is not for it (W5)."""
        for exchange in self._waiting.withdraw(lambda each: each.port is port and not each.is_stop):
            self._withdrawn(exchange, reason, now_ns)
        for exchange in self._waiting:
            exchange.is_orphan |= exchange.port is port
        if self._current and self._current.port is port:
            self._current.is_orphan = True

    # --- from people (errors: ControlError) ------------------------------------------------------------

    def enable(self, axis: str, now_ns: int) -> tuple[str, ...]:
        """Apply the table of an axis and its group; return their names."""
        return control.switch(self.axes, axis, is_wanted=True)

    def disable(self, axis: str, now_ns: int) -> tuple[str, ...]:
        """Apply the table of an axis and its group no longer; return their names."""
        return control.switch(self.axes, axis, is_wanted=False)

    def reference(self, axis: str, now_ns: int) -> tuple[str, ...]:
        """Take an axis as standing where its drive says."""
        names = control.declare(self.axes, axis)
        self._news.look(self.axes)
        return names

    # --- from the drives -------------------------------------------------------------------------------

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that the link framed for the exchange on the wire."""
        exchange = self._current
        if exchange is None or unit_id != exchange.wire_unit_id or not pdu:
            self.stray(now_ns)
            return
        if unit_id in self._silent_units:
            self._silent_units.discard(unit_id)
            self._on_event(Event(EventKind.DRIVE_ANSWERS, None, f"unit id {unit_id}"))
        axes = self._units.axes_of(unit_id)
        for axis in axes:
            if axis.silent_since_ns is not None:
                axis.end_silence(is_answer=True)
        if exchange.added is not None:
            self._current = None
            self._learn(exchange, pdu, now_ns)
        else:
            self._answer(exchange, pdu, now_ns)
            self._current = None
        if axes:
            self._news.look(axes)
        self._next(now_ns)

    def _answer(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        self.counters.exchanges += 1
        if is_exception(pdu):
            self.counters.exceptions += 1
        if not exchange.rewritings:
            self._send_reply(exchange, pdu)
            note_discrete(self._units.get(exchange.unit_id), exchange.pdu, pdu, now_ns)
            return
        for rewriting in exchange.rewritings:
            answer(rewriting, pdu, now_ns, partial(self._send_reply, exchange))
            self.counters.unmapped_reads += rewriting.reads_unmapped
        self._end_if_remapped(exchange)

    def _learn(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        """Take note of the reply to a frame of the gateway's own, and go on with what it was for."""
        code = note_learned(exchange, pdu, self.counters, now_ns)
        if exchange.port is None:
            return
        if code is not None:
            self._note_unsent(exchange, code)
            self._refuse(exchange, code)
        elif self._waiting.has_stops and not exchange.overtaken_by:
            exchange.added = None
            self._waiting.put_back(exchange)
        else:
            self._start(exchange, now_ns)

    def stray(self, now_ns: int, *, is_frame: bool = False) -> None:
        """Note bytes from the drives that answer nothing; a resting line must fall silent first (W6).

        A whole frame that nobody asked for means that a drive answers late or twice, and that the next reply
        may be that of another request: a serial line is left alone until it is silent.
        """
        self.counters.late += 1
        if self._rest.is_draining:
            self._rest.disturb(now_ns)
        elif is_frame and self._link.is_serial and self._current is None:
            self._rest.drain(now_ns)
            detail = f"a frame that answers nothing: waiting for {self._rest.drain_ms:g} ms of silence"
            self._on_event(Event(EventKind.LATE_REPLY, None, detail))

    def link_up(self, now_ns: int) -> None:
        """Note that the drives can be reached."""
        if self.is_up:
            return
        self.is_up = True
        self._on_event(Event(EventKind.LINE_UP))
        self._rest.resume(now_ns)
        for axis in self.axes:
            axis.silent_until_ns = now_ns
            axis.end_silence(is_answer=True)
        for read in reads_at_start(self.axes):
            unit_id = read.axis.plan.unit_id
            self._waiting.add(Exchange(None, 0, unit_id, read.pdu, now_ns, added=read))
        self._news.look(self.axes)
        self._next(now_ns)

    def link_down(self, now_ns: int) -> None:
        """Note that the drives cannot be reached: nothing waits for them any longer."""
        if not self.is_up:
            return
        self.is_up = False
        if not self._is_stopping:  # closing it ourselves is no news
            self._on_event(Event(EventKind.LINE_DOWN))
        current, self._current = self._current, None
        is_busy = current is not None or self._rest.is_draining
        self._rest.break_off(owes_silence=self._link.is_serial and is_busy)
        for axis in self.axes:
            axis.link_lost(now_ns)
        if current is not None:
            self._lose(current, now_ns)
            self._fail(current, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND)
        for exchange in self._waiting.withdraw(lambda _: True):
            self._note_unsent(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
            self._fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
        self._news.look(self.axes)

    # --- time ------------------------------------------------------------------------------------------

    def tick(self, now_ns: int) -> None:
        """Do what has fallen due."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return
        if self._current is not None:
            self._time_out(self._current, now_ns)
        else:
            self._rest.end()
        self._next(now_ns)

    def stop(self, now_ns: int) -> None:
        """Send nothing new; the exchange on the wire ends as it would have (see :attr:`is_idle`)."""
        self._is_stopping = True
        for exchange in self._waiting.withdraw(lambda _: True):
            self._withdrawn(exchange, "the gateway stops", now_ns)

    # --- sending ---------------------------------------------------------------------------------------

    def _next(self, now_ns: int) -> None:
        while self._waiting and self._current is None and self._rest.until_ns is None:
            self._start(self._waiting.pop(), now_ns)

    def _start(self, exchange: Exchange, now_ns: int) -> None:
        """Send an exchange, or the frame that it needs first; or withdraw or refuse it."""
        reason = "the gateway stops" if self._is_stopping else exchange.why_given_up(now_ns)
        if reason:
            self._withdrawn(exchange, reason, now_ns)
        elif exchange.overtaken_by:
            self._overtaken(exchange, exchange.overtaken_by, now_ns)
        elif exchange.port is None:
            self._send(exchange, exchange.pdu, exchange.unit_id, now_ns)
        else:
            self._start_request(exchange, now_ns)

    def _start_request(self, exchange: Exchange, now_ns: int) -> None:
        for axis in self._units.axes_of(exchange.unit_id):
            if axis.silent_since_ns is not None:
                axis.end_silence(is_answer=False)
        try:
            added, pdu = self._units.next_to_send(exchange, now_ns)
        except RefusedRequestError as refusal:
            self._on_event(Event(refusal.kind, refusal.axis or None, refusal.reason))
            self._note_unsent(exchange, refusal.code)
            self._refuse(exchange, refusal.code)
            return
        exchange.added = added
        if added is not None:
            self._send(exchange, added.pdu, added.axis.plan.unit_id, now_ns)
            return
        for rewriting in exchange.rewritings:
            self.counters.unknown_modes += note_unknown(rewriting.request.meanings)
            note_sending(rewriting)
        self._send(exchange, pdu, exchange.unit_id, now_ns)

    def _send(self, exchange: Exchange, pdu: bytes, unit_id: int, now_ns: int) -> None:
        exchange.sent_ns = now_ns
        exchange.wire_unit_id = unit_id
        if unit_id == BROADCAST_UNIT_ID and self._link.is_serial:
            self._link.send_request(unit_id, pdu)
            self.counters.broadcasts += 1
            self._rest.turn_around(now_ns)
            for rewriting in exchange.rewritings:
                note_broadcast(rewriting, now_ns)
            self._news.look(self.axes)
            return
        self._current = exchange
        patience_ns = self._response_timeout_ns
        if exchange.port is not None and exchange.added is None:
            patience_ns = max(patience_ns, int(exchange.port.plan.timeout_ms * NS_PER_MS))
        exchange.deadline_ns = now_ns + patience_ns
        self._link.send_request(unit_id, pdu)

    # --- endings ---------------------------------------------------------------------------------------

    def _time_out(self, exchange: Exchange, now_ns: int) -> None:
        self._link.abandon()
        self._current = None
        self.counters.timeouts += 1
        unit_id = exchange.wire_unit_id
        if unit_id not in self._silent_units:
            self._silent_units.add(unit_id)
            self._on_event(Event(EventKind.DRIVE_SILENT, None, f"unit id {unit_id}"))
        self._lose(exchange, now_ns)
        axes = self._units.axes_of(unit_id)
        for axis in axes:
            axis.doubt(now_ns)
        self._news.look(axes)
        if self._link.is_serial:
            self._rest.drain(now_ns)
        self._fail(exchange, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND)

    def _lose(self, exchange: Exchange, now_ns: int) -> None:
        """Take note of an exchange whose reply never came."""
        code = ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND
        lose(exchange, code, now_ns)
        if exchange.added is not None:
            self._note_unsent(exchange, code)
        self._end_if_remapped(exchange)

    def _note_unsent(self, exchange: Exchange, code: int) -> None:
        """Take note of a request that never reached the drive (M3)."""
        if exchange.port is not None and not only_reads(exchange.pdu):
            note_unsent(self._units, exchange, code)
            self._news.look(self._units.axes_of(exchange.unit_id))

    def _end_if_remapped(self, exchange: Exchange) -> None:
        """End the compensation of a unit whose registers may mean something else now, acknowledged or not."""
        if exchange.added is None:
            for axis in end_remapped(exchange.rewritings):
                self._on_event(Event(EventKind.COMPENSATION_ENDED, axis.plan.name, REMAPPED))

    def _send_reply(self, exchange: Exchange, pdu: bytes) -> None:
        port = exchange.port
        if port is None or exchange.is_orphan:
            return
        if not (port.plan.serial and exchange.unit_id == BROADCAST_UNIT_ID):  # nobody answers a broadcast
            port.send_reply(exchange.transaction_id, exchange.unit_id, pdu)

    def _fail(self, exchange: Exchange, code: ExceptionCode) -> None:
        """Say that a drive cannot be had: an exception on TCP, silence on a serial line (W7)."""
        if exchange.port is not None and not exchange.port.plan.serial:
            self._send_reply(exchange, exception_pdu(exchange.pdu[0], code))

    def _refuse(self, exchange: Exchange, code: int) -> None:
        """Answer what the gateway itself refuses, on serial lines too (W7)."""
        self.counters.refused += 1
        self._send_reply(exchange, exception_pdu(exchange.pdu[0], code))

    def _withdrawn(self, exchange: Exchange, reason: str, now_ns: int, code: int = LOST) -> None:
        self._note_unsent(exchange, code)
        self.counters.withdrawn += 1
        if exchange.port is not None:
            detail = f"a request of {exchange.port.plan.name} was not sent: {reason}"
            self._on_event(Event(EventKind.WITHDRAWN, None, detail))
