"""One line: who may send next, what is sent, whose reply comes back. Sans-IO; time is an argument.

States of the line:

- *down*: no way to the drives; requests are answered 0x0A (serial controllers: silence).
- *free*: the next request is sent in the same call in which it arrives.
- *busy*: one exchange is on the wire (W6); others wait.
- *resting*: nothing is sent until an instant passes: the turnaround after a broadcast, or the silence after a
  time-out, so that a late reply never answers the next request (W6).
"""

from collections.abc import Callable, Sequence
from functools import partial

from gateway.exchange.access import ACCESS, Access, only_reads
from gateway.exchange.added_reads import homed_read, learn, next_read
from gateway.exchange.aliases import why_not_passed
from gateway.exchange.answering import answer, fail
from gateway.exchange.axis import AxisExchange
from gateway.exchange.counters import LineCounters
from gateway.exchange.events import Event, EventKind
from gateway.exchange.life import QUEUE_LIMIT, Exchange, WaitingExchanges
from gateway.exchange.parts import Known, note_unsent
from gateway.exchange.plan import AxisPlan, LineTiming, Role
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.rewriting import RefusedRequestError, prepare
from gateway.exchange.unit import UnitMap
from gateway.modbus.pdu import BROADCAST_UNIT_ID, ExceptionCode, exception_pdu, is_exception
from gateway.times import NS_PER_MS


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
        self._silent_units: set[int] = set()
        self._owes_silence = False
        """Something was outstanding when a serial link went down: its reply may still come (W6)."""

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` wants to be called; a few milliseconds late does no harm."""
        return self._rest_until_ns if self._current is None else self._current.deadline_ns

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
        if not pdu:
            self.counters.malformed += 1
            return
        exchange = Exchange(port, transaction_id, unit_id, pdu, now_ns)
        if port.plan.serial:
            self._give_up(port, "its controller sent another request", now_ns)
        if self._is_stopping:
            return
        if port.plan.role is Role.MONITOR and not only_reads(pdu):
            self._refuse(exchange, ExceptionCode.ILLEGAL_FUNCTION)
        elif not self._is_up:
            self._note_unsent(exchange, now_ns)
            self._fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
        elif self._current is None and self._rest_until_ns is None and not self._waiting:
            self._start(exchange, now_ns)
        elif self._waiting.count(port) >= QUEUE_LIMIT:
            self._note_unsent(exchange, now_ns)
            self._refuse(exchange, ExceptionCode.SERVER_DEVICE_BUSY)
        else:
            self._waiting.add(exchange)

    def controller_gone(self, port: ControllerPort, now_ns: int) -> None:
        """Withdraw what a closed connection still has waiting (W5)."""
        self._give_up(port, "its connection closed", now_ns)

    def _give_up(self, port: ControllerPort, reason: str, now_ns: int) -> None:
        """Withdraw what a controller has given up on; a reply to what is on the wire is not for it (W5)."""
        for exchange in self._waiting.withdraw(lambda waiting: waiting.port is port):
            self._withdrawn(exchange, reason, now_ns)
        if self._current is not None and self._current.port is port:
            self._current.is_orphan = True

    # --- from the drives -------------------------------------------------------------------------------

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that the link framed for the exchange on the wire."""
        exchange = self._current
        if exchange is None or unit_id != exchange.unit_id or not pdu:
            self.stray(now_ns)
            return
        if unit_id in self._silent_units:
            self._silent_units.discard(unit_id)
            self._on_event(Event(EventKind.DRIVE_ANSWERS, None, f"unit id {unit_id}"))
        if exchange.added_read is not None:
            self._current = None
            self._learn(exchange, pdu, now_ns)
        else:
            self._answer(exchange, pdu, now_ns)
            self._current = None
        self._next(now_ns)

    def _answer(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        self.counters.exchanges += 1
        if is_exception(pdu):
            self.counters.exceptions += 1
        if exchange.rewriting is None:
            self._send_reply(exchange, pdu)
            return
        changed = answer(exchange.rewriting, pdu, now_ns, partial(self._send_reply, exchange))
        self.counters.unmapped_reads += exchange.rewriting.reads_unmapped
        self._end_if_remapped(exchange)
        for axis, is_referenced in changed:
            self._reference_changed(axis, is_referenced=is_referenced)
        self._note_directions(exchange)

    def _learn(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        read = exchange.added_read
        assert read is not None
        self.counters.added_reads += 1
        exchange.known = exchange.known or Known()
        exchange.added_read = None
        is_referenced = learn(read, pdu, exchange.known, now_ns)
        if is_referenced is not None:
            self._reference_changed(read.axis, is_referenced=is_referenced)
        if exchange.port is not None:
            self._start(exchange, now_ns)

    def stray(self, now_ns: int, *, is_frame: bool = False) -> None:
        """Note bytes from the drives that answer nothing; a resting line must fall silent first (W6).

        A whole frame that nobody asked for means that a drive answers late or twice, and that the next reply
        may be that of another request: a serial line is left alone until it is silent.
        """
        self.counters.late += 1
        if self._is_draining:
            self._rest_until_ns = now_ns + self._drain_ns
        elif is_frame and self._link.is_serial and self._current is None:
            self._drain(now_ns)
            detail = f"a frame that answers nothing: waiting for {self._drain_ns / NS_PER_MS:g} ms of silence"
            self._on_event(Event(EventKind.LATE_REPLY, None, detail))

    def link_up(self, now_ns: int) -> None:
        """Note that the drives can be reached."""
        if self._is_up:
            return
        self._is_up = True
        self._on_event(Event(EventKind.LINE_UP))
        if self._owes_silence:
            self._drain(now_ns)
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
        self._owes_silence = self._link.is_serial and (current is not None or self._is_draining)
        self._rest_until_ns = None
        self._is_draining = False
        for axis in self.axes:
            if axis.link_lost(now_ns):
                self._reference_changed(axis, is_referenced=False)
        if current is not None:
            self._lose(current, now_ns)
            self._fail(current, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND)
        for exchange in self._waiting.withdraw(lambda _: True):
            self._note_unsent(exchange, now_ns)
            self._fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)

    # --- time ------------------------------------------------------------------------------------------

    def tick(self, now_ns: int) -> None:
        """Do what has fallen due."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return
        if self._current is not None:
            self._time_out(self._current, now_ns)
        else:
            self._rest_until_ns = None
            self._is_draining = self._owes_silence = False
        self._next(now_ns)

    def stop(self, now_ns: int) -> None:
        """Send nothing new; the exchange on the wire ends as it would have (see :attr:`is_idle`)."""
        self._is_stopping = True
        for exchange in self._waiting.withdraw(lambda _: True):
            self._withdrawn(exchange, "the gateway stops", now_ns)

    # --- sending ---------------------------------------------------------------------------------------

    def _next(self, now_ns: int) -> None:
        while self._waiting and self._current is None and self._rest_until_ns is None:
            self._start(self._waiting.pop(), now_ns)

    def _start(self, exchange: Exchange, now_ns: int) -> None:
        """Send an exchange, or the read that it needs first; or withdraw or refuse it."""
        reason = "the gateway stops" if self._is_stopping else exchange.why_given_up(now_ns)
        if reason:
            self._withdrawn(exchange, reason, now_ns)
            return
        if exchange.added_read is not None:
            self._send(exchange, exchange.pdu, now_ns)
            return
        try:
            pdu = self._pdu_to_send(exchange, now_ns)
        except RefusedRequestError as refusal:
            self._note_unsent(exchange, now_ns)
            self._on_event(Event(EventKind.REFUSED_VALUE, refusal.axis, refusal.reason))
            self._refuse(exchange, refusal.code)
            return
        if pdu is not None:
            self._send(exchange, pdu, now_ns)

    def _pdu_to_send(self, exchange: Exchange, now_ns: int) -> bytes | None:
        """Return what goes out for a request; None when it was answered instead.

        Raises:
            RefusedRequestError: it must not reach the drive.
        """
        pdu = exchange.pdu
        look = ACCESS.get(pdu[0])
        access = None if look is None else look(pdu)
        if access is None:
            return pdu
        unit = self._units.get(exchange.unit_id)
        if unit is None:
            return self._pdu_to_nobody(exchange, access)
        known = exchange.known = exchange.known or Known()
        exchange.added_read = next_read(unit, pdu, access, known, now_ns)
        if exchange.added_read is not None:
            return exchange.added_read.pdu
        exchange.rewriting = prepare(unit, pdu, access, known, now_ns)
        return exchange.rewriting.sent_pdu

    def _pdu_to_nobody(self, exchange: Exchange, access: Access) -> bytes | None:
        """Return a request to a unit id without axes, unless it would reach an axis all the same."""
        is_serial = self._link.is_serial
        reason = why_not_passed(self._units.values(), exchange.unit_id, access, is_serial=is_serial)
        if not reason:
            return exchange.pdu
        self._on_event(Event(EventKind.REFUSED_VALUE, None, reason))
        if is_serial:
            self.counters.refused += 1  # nobody answers a broadcast
        else:
            self._refuse(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
        return None

    def _send(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        exchange.sent_ns = now_ns
        if exchange.unit_id == BROADCAST_UNIT_ID and self._link.is_serial:
            self._link.send_request(exchange.unit_id, pdu)
            self.counters.broadcasts += 1
            self._rest_until_ns = now_ns + self._turnaround_ns
            return
        self._current = exchange
        patience_ns = self._response_timeout_ns
        if exchange.port is not None and exchange.added_read is None:
            patience_ns = max(patience_ns, int(exchange.port.plan.timeout_ms * NS_PER_MS))
        exchange.deadline_ns = now_ns + patience_ns
        self._link.send_request(exchange.unit_id, pdu)

    # --- endings ---------------------------------------------------------------------------------------

    def _time_out(self, exchange: Exchange, now_ns: int) -> None:
        self._link.abandon()
        self._current = None
        self.counters.timeouts += 1
        if exchange.unit_id not in self._silent_units:
            self._silent_units.add(exchange.unit_id)
            self._on_event(Event(EventKind.DRIVE_SILENT, None, f"unit id {exchange.unit_id}"))
        self._lose(exchange, now_ns)
        unit = self._units.get(exchange.unit_id)
        for axis in unit.axes if unit else ():
            if axis.doubt(now_ns):
                self._reference_changed(axis, is_referenced=False)
        if self._link.is_serial:
            self._drain(now_ns)
        self._fail(exchange, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND)

    def _drain(self, now_ns: int) -> None:
        self._rest_until_ns = now_ns + self._drain_ns
        self._is_draining = True

    def _lose(self, exchange: Exchange, now_ns: int) -> None:
        """Take note of an exchange whose reply never came."""
        if exchange.rewriting is not None:
            fail(exchange.rewriting, now_ns, is_refusal=False)
            self._end_if_remapped(exchange)
        elif exchange.added_read is not None:
            self._note_unsent(exchange, now_ns)

    def _note_unsent(self, exchange: Exchange, now_ns: int) -> None:
        """Take note of a request that never reached the drive: what it wrote is torn from the rest (M3)."""
        unit = self._units.get(exchange.unit_id)
        look = ACCESS.get(exchange.pdu[0])
        access = None if look is None or exchange.port is None else look(exchange.pdu)
        if unit is not None and access is not None and access.write_quantity:
            note_unsent(unit, exchange.pdu, access, now_ns)

    def _end_if_remapped(self, exchange: Exchange) -> None:
        """End the compensation of a unit whose registers may mean something else now, acknowledged or not."""
        if exchange.rewriting is None or not exchange.rewriting.remaps:
            return
        for axis in self._units[exchange.unit_id].axes:
            if not axis.is_ended:
                axis.end()
                detail = (
                    "its drive's registers were moved about; corrected again after a restart of the gateway"
                )
                self._on_event(Event(EventKind.COMPENSATION_ENDED, axis.plan.name, detail))

    def _note_directions(self, exchange: Exchange) -> None:
        for rendering in exchange.rewriting.renderings if exchange.rewriting else ():
            axis = rendering.axis
            if axis.is_unsure is not axis.was_unsure:
                axis.was_unsure = axis.is_unsure
                if axis.was_unsure:
                    detail = "where the axis is could not be told; it keeps its branch"
                    self._on_event(Event(EventKind.DIRECTION_UNSURE, axis.plan.name, detail))

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

    def _refuse(self, exchange: Exchange, code: ExceptionCode) -> None:
        """Answer what the gateway itself refuses, on serial lines too (W7)."""
        self.counters.refused += 1
        self._send_reply(exchange, exception_pdu(exchange.pdu[0], code))

    def _withdrawn(self, exchange: Exchange, reason: str, now_ns: int) -> None:
        self._note_unsent(exchange, now_ns)
        self.counters.withdrawn += 1
        if exchange.port is not None:
            name = exchange.port.plan.name
            self._on_event(Event(EventKind.WITHDRAWN, None, f"a request of {name} was not sent: {reason}"))

    def _reference_changed(self, axis: AxisExchange, *, is_referenced: bool) -> None:
        kind = EventKind.AXIS_REFERENCED if is_referenced else EventKind.REFERENCE_LOST
        detail = "" if is_referenced else "the drive does not say that it is homed: positions pass 1:1"
        self._on_event(Event(kind, axis.plan.name, detail))
