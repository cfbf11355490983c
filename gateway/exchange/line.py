"""One line: who may send next, what is sent, whose reply comes back. Sans-IO; time is an argument.

States of the line:

- *down*: no way to the drives; requests are answered 0x0A (serial controllers: silence).
- *free*: the next request is sent in the same call in which it arrives.
- *busy*: one exchange is on the wire (W6); others wait.
- *resting*: nothing is sent until an instant passes: the turnaround after a broadcast, or the silence after a
  time-out, so that a late reply never answers the next request (W6).
"""

from collections.abc import Callable, Sequence

from gateway.exchange.access import ACCESS, only_reads
from gateway.exchange.added_reads import homed_read, learn, next_read
from gateway.exchange.axis import NS_PER_MS, AxisExchange
from gateway.exchange.counters import LineCounters
from gateway.exchange.events import Event, EventKind
from gateway.exchange.life import QUEUE_LIMIT, Exchange, WaitingExchanges
from gateway.exchange.plan import AxisPlan, LineTiming, Role
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.rewriting import Known, RefusedRequestError, answer, prepare, written_axes
from gateway.exchange.unit import UnitMap
from gateway.modbus.pdu import BROADCAST_UNIT_ID, ExceptionCode, exception_pdu


class LineExchange:
    """The exchanges of one line and the axes on it."""

    def __init__(
        self,
        axes: Sequence[AxisPlan],
        timing: LineTiming,
        link: DriveLink,
        on_event: Callable[[Event], None],
    ) -> None:
        self.axes = [AxisExchange(plan) for plan in axes]
        self.counters = LineCounters()
        self.deadline_ns: int | None = None
        """When :meth:`tick` wants to be called; a few milliseconds late does no harm."""
        self._units = {
            unit_id: UnitMap(axis for axis in self.axes if axis.plan.unit_id == unit_id)
            for unit_id in {axis.plan.unit_id for axis in self.axes}
        }
        self._link = link
        self._on_event = on_event
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self._drain_ns = int((timing.drain_ms or timing.response_timeout_ms) * NS_PER_MS)
        self._turnaround_ns = int(timing.turnaround_ms * NS_PER_MS)
        self._waiting = WaitingExchanges()
        self._current: Exchange | None = None
        self._rest_until_ns: int | None = None
        self._is_draining = False
        self._is_up = False
        self._is_stopping = False
        self._is_silent = False

    @property
    def is_idle(self) -> bool:
        """Whether no exchange is on the wire."""
        return self._current is None

    @property
    def is_up(self) -> bool:
        """Whether there is a way to the drives."""
        return self._is_up

    # --- from controllers ------------------------------------------------------------------------------

    def request(
        self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int
    ) -> None:
        """Take a whole request; it goes out in this very call when the line is free."""
        exchange = Exchange(port, transaction_id, unit_id, pdu, now_ns)
        if port.plan.serial:
            self._supersede(port)
        if self._is_stopping:
            return
        if port.plan.role is Role.MONITOR and not only_reads(pdu):
            self._refuse(exchange, ExceptionCode.ILLEGAL_FUNCTION)
        elif not self._is_up:
            self._fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
        elif self._current is None and self._rest_until_ns is None and not self._waiting:
            self._start(exchange, now_ns)
        elif self._waiting.count(port) >= QUEUE_LIMIT:
            self._refuse(exchange, ExceptionCode.SERVER_DEVICE_BUSY)
        else:
            self._waiting.add(exchange)

    def controller_gone(self, port: ControllerPort, now_ns: int) -> None:
        """Withdraw what a closed connection still has waiting (W5)."""
        for exchange in self._waiting.withdraw(lambda waiting: waiting.port is port):
            self._withdrawn(exchange, "its connection closed")
        if self._current is not None and self._current.port is port:
            self._current.is_orphan = True

    def _supersede(self, port: ControllerPort) -> None:
        """A serial controller that sends again has given up on what it sent before (W5)."""
        for exchange in self._waiting.withdraw(lambda waiting: waiting.port is port):
            self._withdrawn(exchange, "its controller sent another request")
        if self._current is not None and self._current.port is port:
            self._current.is_orphan = True

    # --- from the drives -------------------------------------------------------------------------------

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that the link framed for the exchange on the wire."""
        exchange = self._current
        if exchange is None or unit_id != exchange.unit_id:
            self.stray(now_ns)
            return
        self._note_silence(exchange, is_silent=False)
        if exchange.added_read is not None:
            self._learn(exchange, pdu, now_ns)
            return
        self.counters.exchanges += 1
        if pdu[0] & 0x80:
            self.counters.exceptions += 1
        if exchange.rewriting is not None:
            pdu, changed = answer(exchange.rewriting, pdu, now_ns)
            for axis, is_referenced in changed:
                self._reference_changed(axis, is_referenced=is_referenced)
        self._current = None
        self._send_reply(exchange, pdu)
        self._next(now_ns)

    def stray(self, now_ns: int) -> None:
        """Note bytes from the drives that answer nothing; a resting line must fall silent first (W6)."""
        self.counters.late += 1
        if self._is_draining and self._rest_until_ns is not None:
            self._rest_until_ns = self.deadline_ns = now_ns + self._drain_ns

    def link_up(self, now_ns: int) -> None:
        """Note that the drives can be reached."""
        if self._is_up:
            return
        self._is_up = True
        self._on_event(Event(EventKind.LINE_UP))
        for axis in self.axes:
            read = homed_read(axis)
            if read is not None:
                exchange = Exchange(None, 0, axis.plan.unit_id, read.pdu, now_ns)
                exchange.added_read = read
                self._waiting.add(exchange)
        self._next(now_ns)

    def link_down(self, now_ns: int) -> None:
        """Note that the drives cannot be reached: nothing waits for them any longer."""
        if not self._is_up:
            return
        self._is_up = False
        if not self._is_stopping:  # closing it ourselves is no news
            self._on_event(Event(EventKind.LINE_DOWN))
        current, self._current = self._current, None
        self._rest_until_ns = self.deadline_ns = None
        self._is_draining = False
        for axis in self.axes:
            axis.link_lost()
        if current is not None:
            self._fail(current, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND)
        for exchange in self._waiting.withdraw(lambda _: True):
            self._fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)

    # --- time ------------------------------------------------------------------------------------------

    def tick(self, now_ns: int) -> None:
        """Do what has fallen due."""
        if self.deadline_ns is None or now_ns < self.deadline_ns:
            return
        if self._current is not None:
            self._time_out(self._current, now_ns)
        elif self._rest_until_ns is not None:
            self._rest_until_ns = self.deadline_ns = None
            self._is_draining = False
            self._next(now_ns)

    def stop(self, now_ns: int) -> None:
        """Send nothing new; the exchange on the wire ends as it would have (see :attr:`is_idle`)."""
        self._is_stopping = True
        for exchange in self._waiting.withdraw(lambda _: True):
            self._withdrawn(exchange, "the gateway stops")

    # --- sending ---------------------------------------------------------------------------------------

    def _next(self, now_ns: int) -> None:
        while self._waiting and self._current is None and self._rest_until_ns is None:
            exchange = self._waiting.pop()
            port = exchange.port
            if port is not None and now_ns - exchange.arrived_ns > port.plan.timeout_ms * NS_PER_MS:
                self._withdrawn(exchange, "it waited longer than its controller's timeout_ms")
                continue
            self._start(exchange, now_ns)
        if self._current is None and self._rest_until_ns is None:
            self.deadline_ns = None

    def _start(self, exchange: Exchange, now_ns: int) -> None:
        pdu = exchange.pdu
        if exchange.added_read is None:
            unit_id = exchange.unit_id
            unit = self._units.get(unit_id)
            look = ACCESS.get(pdu[0])
            access = None if look is None else look(pdu)
            if access is not None and unit_id == BROADCAST_UNIT_ID and self._link.is_serial:
                if access.write_quantity and self._broadcast_hits(
                    access.write_address, access.write_quantity
                ):
                    self._note_refusal(
                        "a broadcast cannot carry a position that each axis corrects differently"
                    )
                    return
            elif access is not None and unit is not None:
                exchange.known = exchange.known or Known()
                exchange.added_read = next_read(unit, pdu, access, exchange.known, now_ns)
                if exchange.added_read is not None:
                    pdu = exchange.added_read.pdu
                else:
                    try:
                        exchange.rewriting = prepare(unit, pdu, access, exchange.known, now_ns)
                    except RefusedRequestError as refusal:
                        self._note_refusal(refusal.reason, refusal.axis)
                        self._answer_exception(exchange, refusal.code)
                        return
                    pdu = exchange.rewriting.sent_pdu
        self._send(exchange, pdu, now_ns)

    def _send(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        exchange.sent_ns = now_ns
        if exchange.unit_id == BROADCAST_UNIT_ID and self._link.is_serial:
            self._link.send_request(exchange.unit_id, pdu)
            self._link.abandon()
            self.counters.broadcasts += 1
            self._rest_until_ns = self.deadline_ns = now_ns + self._turnaround_ns
            return
        self._current = exchange
        patience_ns = self._response_timeout_ns
        if exchange.port is not None and exchange.added_read is None:
            patience_ns = max(patience_ns, int(exchange.port.plan.timeout_ms * NS_PER_MS))
        self.deadline_ns = exchange.deadline_ns = now_ns + patience_ns
        self._link.send_request(exchange.unit_id, pdu)

    def _broadcast_hits(self, address: int, quantity: int) -> bool:
        return any(
            not hit.place.axis.passes_unchanged
            for unit in self._units.values()
            for hit in unit.hits(address, quantity).fields
        )

    def _learn(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        read = exchange.added_read
        assert read is not None
        exchange.known = exchange.known or Known()
        is_referenced = learn(read, pdu, exchange.known, now_ns)
        if is_referenced is not None:
            self._reference_changed(read.axis, is_referenced=is_referenced)
        self.counters.added_reads += 1
        self._current = None
        exchange.added_read = None
        if exchange.port is None:
            self._next(now_ns)
        elif exchange.is_orphan or self._is_stopping:
            self._withdrawn(exchange, "its controller gave up before it was sent")
            self._next(now_ns)
        else:
            self._start(exchange, now_ns)
            self._next(now_ns)

    # --- endings ---------------------------------------------------------------------------------------

    def _time_out(self, exchange: Exchange, now_ns: int) -> None:
        self._link.abandon()
        self._current = None
        self.counters.timeouts += 1
        self._note_silence(exchange, is_silent=True)
        if exchange.rewriting is not None:
            for axis in written_axes(exchange.rewriting):
                axis.forget()
        if self._link.is_serial:
            self._rest_until_ns = self.deadline_ns = now_ns + self._drain_ns
            self._is_draining = True
        self._fail(exchange, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND)
        self._next(now_ns)

    def _send_reply(self, exchange: Exchange, pdu: bytes) -> None:
        if exchange.port is not None and not exchange.is_orphan:
            exchange.port.send_reply(exchange.transaction_id, exchange.unit_id, pdu)

    def _fail(self, exchange: Exchange, code: ExceptionCode) -> None:
        """Say that a drive cannot be had: an exception on TCP, silence on a serial line (W7)."""
        if exchange.port is not None and not exchange.port.plan.serial:
            self._answer_exception(exchange, code)

    def _refuse(self, exchange: Exchange, code: ExceptionCode) -> None:
        self.counters.refused += 1
        self._answer_exception(exchange, code)

    def _note_refusal(self, reason: str, axis: str | None = None) -> None:
        self.counters.refused += 1
        self._on_event(Event(EventKind.REFUSED_VALUE, axis, reason))

    def _answer_exception(self, exchange: Exchange, code: ExceptionCode) -> None:
        self._send_reply(exchange, exception_pdu(exchange.pdu[0], code))

    def _withdrawn(self, exchange: Exchange, reason: str) -> None:
        self.counters.withdrawn += 1
        if exchange.port is not None:
            name = exchange.port.plan.name
            self._on_event(Event(EventKind.WITHDRAWN, None, f"a request of {name} was not sent: {reason}"))

    def _note_silence(self, exchange: Exchange, *, is_silent: bool) -> None:
        if is_silent is self._is_silent:
            return
        self._is_silent = is_silent
        kind = EventKind.DRIVE_SILENT if is_silent else EventKind.DRIVE_ANSWERS
        self._on_event(Event(kind, None, f"unit id {exchange.unit_id}"))

    def _reference_changed(self, axis: AxisExchange, *, is_referenced: bool) -> None:
        kind = EventKind.AXIS_REFERENCED if is_referenced else EventKind.REFERENCE_LOST
        self._on_event(Event(kind, axis.plan.name))
