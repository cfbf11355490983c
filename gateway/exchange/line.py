"""One line: who may send next, what is sent, whose reply comes back. Sans-IO; time is an argument.

States of the line:

- *down*: no way to the drives; requests are answered 0x0A (serial controllers: silence).
- *free*: the next request is sent in the same call in which it arrives.
- *busy*: one exchange is on the wire (W6); others wait, stops at their head (M3).
- *resting*: nothing is sent until an instant passes: the turnaround after a broadcast, or the silence after a
  time-out, so that a late reply never answers the next request (W6).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from gateway.exchange.added_frames import Purpose, reads_at_start
from gateway.exchange.admission import Admission, judge
from gateway.exchange.answering import note_broadcast
from gateway.exchange.arbitration import Gaps
from gateway.exchange.axis import AxisExchange
from gateway.exchange.control import Control, SetLimits, carry_out
from gateway.exchange.counters import LineCounters
from gateway.exchange.deadlines import Deadlines
from gateway.exchange.dispatch import REMEMBERED_WAYS, Units, is_acting_on
from gateway.exchange.endings import NO_RESPONSE, Endings
from gateway.exchange.events import Event, EventKind
from gateway.exchange.groups import join
from gateway.exchange.life import QUEUE_LIMIT, Exchange, WaitingExchanges
from gateway.exchange.losses import note_learned
from gateway.exchange.meaning import Meaning
from gateway.exchange.meter import LineMeter
from gateway.exchange.news import AxisNews
from gateway.exchange.plan import NO_OTHER_UNITS, AxisPlan, LineTiming, OtherUnits, Role
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.remembering import note_leaving
from gateway.exchange.rest import Rest
from gateway.exchange.seldom import Seldom, times
from gateway.exchange.silence import SilentUnits
from gateway.exchange.writers import Writers
from gateway.modbus.pdu import BROADCAST_UNIT_ID, MAX_PDU, ExceptionCode, is_exception
from gateway.times import NS_PER_MS, NS_PER_S

REFUSALS_TOLD: Final = 10
"""So many refusals of a kind are told of an axis in a second; of more how many there were."""


class LineExchange:
    """The exchanges of one line and the axes on it."""

    def __init__(
        self,
        axes: Sequence[AxisPlan],
        timing: LineTiming,
        link: DriveLink,
        on_event: Callable[[Event], None],
        groups: Iterable[Iterable[str]] = (),
        *,
        remembered_ways: int = REMEMBERED_WAYS,
        other_units: OtherUnits = NO_OTHER_UNITS,
        what_ran: Callable[[int, int], str] = lambda _since_ns, _until_ns: "",
    ) -> None:
        self.axes = [AxisExchange(plan) for plan in axes]
        join(self.axes, groups)
        self.counters = LineCounters()
        self._units = Units(
            self.axes, is_serial=link.is_serial, remembered_ways=remembered_ways, other_units=other_units
        )
        self._link = link
        self._on_event = on_event
        self._news = AxisNews(self.axes, on_event)
        self._writers = Writers(self.axes, self._units, on_event)
        self._ends = Endings(self._units, self._writers, self.counters, self._news, on_event)
        self._admission = Admission(self._units, self._ends, self._writers, on_event)
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self.rest = Rest(timing)
        self._waiting = WaitingExchanges()
        self._current: Exchange | None = None
        self.is_up = False
        """Whether there is a way to the drives."""
        self._is_stopping = False
        self._silent = SilentUnits(self._units, self._news, on_event)
        self._refusals = Seldom(NS_PER_S, REFUSALS_TOLD)
        self._arrived_ns = 0
        self._gaps = Gaps(timing)
        self._monitor_due_ns: int | None = None
        self.meter = LineMeter(self.axes, link, on_event, what_ran)
        self._deadlines = Deadlines(self.axes, self._units, self.counters, on_event)

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` wants to be called; a few milliseconds late does no harm."""
        if self._current is not None:
            return self._current.deadline_ns
        return self._monitor_due_ns if self.rest.until_ns is None else self.rest.until_ns

    @property
    def unit_ids(self) -> dict[str, Any]:
        """Unit ids that controllers have talked to, and the requests to those that nobody knows."""
        aliases = self._units.aliases
        strangers = sorted(self._units.heard.difference(aliases.known))
        return {
            "heard": sorted(self._units.heard),
            "strangers": strangers,
            "requests": aliases.requests_by_name,
        }

    @property
    def is_idle(self) -> bool:
        """Whether no exchange is on the wire."""
        return self._current is None

    # --- from controllers ------------------------------------------------------------------------------

    def request(
        self,
        port: ControllerPort,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        why_given_up: str = "",
    ) -> None:
        """Take a whole request; it goes out in this very call when the line is free.

        ``why_given_up``: its controller gave up on it before it could be sent. Then it goes out only if it is
        a stop; anything else never reaches the drive (W5, M3).
        """
        if not pdu:
            self.counters.malformed += 1
            return
        if port.plan.serial and (self._current is not None or self._waiting.total):
            self._give_up(port, "its controller sent another request", now_ns)
        if self._is_stopping:
            return
        # Losses are told apart by it (M3): no two requests come at one instant.
        arrived_ns = self._arrived_ns = now_ns if now_ns > self._arrived_ns else self._arrived_ns + 1
        gate = port.gate
        if gate is not None and not self._admission.lets_in(port, transaction_id, unit_id, pdu, arrived_ns):
            return
        is_motion = port.plan.role is Role.MOTION
        if is_motion and self._gaps.is_watching and not self._is_moving:
            self._gaps.motion_came(now_ns)
        exchange = Exchange(port, transaction_id, unit_id, pdu, arrived_ns)
        is_free = self._current is None and self.rest.until_ns is None
        if why_given_up and not (self.is_up and self._units.stops_of(unit_id, pdu)):
            self._ends.withdrawn(exchange, why_given_up)
        elif is_free and is_motion and self.is_up:
            self._start_request(exchange, now_ns)
        else:
            self._judge(exchange, now_ns, is_free=is_free)

    def _judge(self, exchange: Exchange, now_ns: int, *, is_free: bool) -> None:
        """Start, queue or refuse a request that cannot simply go out."""
        port = exchange.port
        assert port is not None
        is_allowed, stops = judge(self._units, exchange, is_free=is_free)
        if not is_allowed:
            self._admission.deny_role(exchange, now_ns)
        elif not self.is_up:
            self._ends.fail_unsent(exchange)
        elif is_free and stops:
            self._start(exchange, now_ns)
        elif stops:
            self._overtake(exchange, stops, now_ns)
        elif self._waiting.count(port) >= QUEUE_LIMIT:
            self._admission.deny_queue(exchange, now_ns)
        else:
            self._gaps.is_watching |= not exchange.is_motion
            self._waiting.add(exchange)
            self._next(now_ns)

    def _overtake(self, stop: Exchange, stops: list[Meaning], now_ns: int) -> None:
        """Put a stop at the head of the queue, and withdraw what would move its axes afterwards (M3)."""
        axes = [meaning.axis for meaning in stops]
        reason = "a stop of its axis came after it"
        for exchange in self._waiting.withdraw(lambda each: is_acting_on(self._units, each, axes)):
            self._ends.overtaken(exchange, reason)
        current = self._current
        if current and current.added and is_acting_on(self._units, current, axes):
            current.overtaken_by = reason
        stop.is_stop = True
        if not self._waiting.add_stop(stop):  # the same stop waits already, many times
            self._ends.refuse(stop, ExceptionCode.SERVER_DEVICE_BUSY)

    def controller_gone(self, port: ControllerPort, now_ns: int) -> None:
        """Withdraw what a closed connection still has waiting (W5)."""
        self._give_up(port, "its connection closed", now_ns)
        self._admission.gone(port, now_ns)

    def _give_up(self, port: ControllerPort, reason: str, now_ns: int) -> None:
        """Withdraw what a controller has given up on; a reply to what is on the wire is not for it (W5)."""
        for exchange in self._waiting.give_up(port):
            self._ends.withdrawn(exchange, reason)
        if self._current and self._current.port is port:
            self._current.is_orphan = True

    def note_standstill(self, gap_ns: int) -> None:
        """Report that nobody looked for a while."""
        detail = f"the relay stood still for {gap_ns / NS_PER_S:.2f} s; what controllers gave up is not sent"
        self._on_event(Event(EventKind.STOOD_STILL, None, detail))

    def control(self, message: Control, now_ns: int) -> dict[str, str]:
        """Do what somebody outside asks for; see ``control.carry_out``. Raises ControlError."""
        changed = carry_out(self.axes, message, now_ns)
        if isinstance(message, SetLimits):
            self.meter.set_budget(message.axis, message.limits.budget_us)
        self._news.look(self.axes)
        return changed

    # --- from the drives -------------------------------------------------------------------------------

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that the link framed for the exchange on the wire."""
        exchange = self._current
        if exchange is None or unit_id != exchange.wire_unit_id or not pdu:
            self.stray(now_ns)
            return
        if len(pdu) > MAX_PDU:
            self._end_unanswered(exchange, now_ns)
            return
        if unit_id in self._silent.ids:
            self._silent.answered(unit_id)
        way = exchange.way
        turned = None if way is None else way.answered(exchange, pdu, now_ns)
        if way is None or turned is None:
            axes = self._take_reply(exchange, pdu, now_ns)
        else:
            axes = way.axes
            self.counters.exchanges += 1
            self.counters.exceptions += is_exception(pdu)
            self._ends.reply(exchange, turned)
            way.settle(exchange, now_ns)
            self._current = None
            assert exchange.port is not None
            self.meter.note(exchange, exchange.port, pdu, now_ns)
        if self._gaps.is_watching:
            self._gaps.ended(exchange, now_ns)
        if axes:
            self._news.look(axes)
        if self._waiting.total:
            self._next(now_ns)

    def _end_unanswered(self, exchange: Exchange, now_ns: int) -> None:
        """End an exchange whose reply is longer than a frame may be: it cannot be passed on."""
        self._current = None
        self.counters.oversized += 1
        self._ends.lost(exchange, now_ns)
        self._gaps.ended(exchange, now_ns)
        self._ends.fail(exchange, NO_RESPONSE)
        self._next(now_ns)

    def _take_reply(self, exchange: Exchange, pdu: bytes, now_ns: int) -> tuple[AxisExchange, ...]:
        """Take a reply the long way; return the axes of which something may have been learned."""
        axes = self._units.axes_of(exchange.wire_unit_id)
        for axis in axes:
            axis.end_silence(is_answer=True)
        if exchange.added is not None:
            self._current = None
            self._learn(exchange, pdu, now_ns)
        else:
            self._ends.answer(exchange, pdu, now_ns)
            self._current = None
            if exchange.port is not None:
                self.meter.note(exchange, exchange.port, pdu, now_ns)
        return axes

    def _learn(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        """Take note of the reply to a frame of the gateway's own, and go on with what it was for."""
        code = note_learned(exchange, pdu, self.counters, now_ns)
        if exchange.port is None:
            self._look_again(exchange, now_ns)
            return
        if code is not None:
            self._ends.refuse_unsent(exchange, code)
        elif self._waiting.has_stops and not exchange.overtaken_by:
            exchange.added = None
            self._waiting.put_back(exchange)
        else:
            self._start(exchange, now_ns)

    def _look_again(self, exchange: Exchange, now_ns: int) -> None:
        """Read once more where an axis is whose record is not decided by its first position."""
        read = exchange.added
        assert read is not None
        if read.purpose is Purpose.ACTUAL and read.axis.memory is not None and read.axis.memory.wants_look:
            self._waiting.add_own(read, now_ns)

    def stray(self, now_ns: int, *, is_frame: bool = False) -> None:
        """Note bytes from the drives that answer nothing; a resting line must fall silent first (W6).

        A whole frame that nobody asked for means that a drive answers late or twice, and that the next reply
        may be that of another request: a serial line is left alone until it is silent.
        """
        self.counters.late += 1
        if self.rest.is_draining:
            self.rest.disturb(now_ns)
        elif is_frame and self._link.is_serial and self._current is None:
            self.rest.drain(now_ns)
            detail = f"a frame that answers nothing: waiting for {self.rest.drain_ms:g} ms of silence"
            self._on_event(Event(EventKind.LATE_REPLY, None, detail))

    def link_up(self, now_ns: int) -> None:
        """Note that the drives can be reached."""
        if self.is_up:
            return
        self.is_up = True
        self._on_event(Event(EventKind.LINE_UP))
        self.rest.resume(now_ns)
        for axis in self.axes:
            axis.silent_until_ns = now_ns
            axis.end_silence(is_answer=True)
        for read in reads_at_start(self.axes):
            self._waiting.add_own(read, now_ns)
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
        is_busy = current is not None or self.rest.is_draining
        self.rest.break_off(owes_silence=self._link.is_serial and is_busy)
        for axis in self.axes:
            axis.link_lost(now_ns)
        if current is not None:
            self._ends.lost(current, now_ns)
            self._ends.fail(current, NO_RESPONSE)
        for exchange in self._waiting.withdraw(lambda _: True):
            self._ends.fail_unsent(exchange)
        self._news.look(self.axes)

    # --- time ------------------------------------------------------------------------------------------

    def tick(self, now_ns: int) -> None:
        """Do what has fallen due."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return
        if self._current is not None:
            self._time_out(self._current, now_ns)
        elif self.rest.until_ns is not None:  # else it is a monitor's turn
            self.rest.end()
        self._next(now_ns)

    def stop(self, now_ns: int) -> None:
        """Send nothing new; the exchange on the wire ends as it would have (see :attr:`is_idle`)."""
        self._is_stopping = True
        for exchange in self._waiting.withdraw(lambda _: True):
            self._ends.withdrawn(exchange, "the gateway stops")

    # --- sending ---------------------------------------------------------------------------------------

    @property
    def _is_moving(self) -> bool:
        """Whether a motion exchange is on the wire or waits."""
        current = self._current
        return (current is not None and current.is_motion) or not self._waiting.only_others

    def _next(self, now_ns: int) -> None:
        """Start what waits, as long as the line is free."""
        self._monitor_due_ns = None
        while self._waiting.total and self._current is None and self.rest.until_ns is None:
            if not self._waiting.only_others:
                self._start(self._waiting.pop(), now_ns)
                continue
            exchange, self._monitor_due_ns = self._gaps.choose(self._waiting.first_of_others(), now_ns)
            if exchange is None:
                return
            self._waiting.take(exchange)
            self._start(exchange, now_ns)

    def _start(self, exchange: Exchange, now_ns: int) -> None:
        """Send an exchange, or the frame that it needs first; or withdraw or refuse it."""
        exchange.start(now_ns)
        reason = "the gateway stops" if self._is_stopping else exchange.why_given_up(now_ns)
        if reason:
            self._ends.withdrawn(exchange, reason)
        elif exchange.overtaken_by:
            self._ends.overtaken(exchange, exchange.overtaken_by)
        elif exchange.port is None:
            self._send(exchange, exchange.pdu, exchange.unit_id, now_ns)
        else:
            self._start_request(exchange, now_ns)

    def _start_request(self, exchange: Exchange, now_ns: int) -> None:
        if exchange.known is None and not self._deadlines.may_be_late(exchange, now_ns):
            way = self._units.way_of(exchange.unit_id, exchange.pdu)
            sent_pdu = None if way is None else way.sent(exchange, now_ns)
            if way is not None and sent_pdu is not None:
                exchange.way = way
                self._put_on_wire(exchange, sent_pdu, exchange.unit_id, now_ns)
                if exchange.draft is not None:
                    way.left(exchange)
                return
        if exchange.unit_id not in self._units and self._units.aliases.is_unknown(exchange.unit_id):
            self._note_unknown_unit(exchange.unit_id)
        if not self._writers.may_move(exchange, now_ns):
            self._ends.refuse(exchange, ExceptionCode.SERVER_DEVICE_BUSY)
            return
        for axis in self._units.axes_of(exchange.unit_id):
            axis.end_silence(is_answer=False)
        try:
            self._deadlines.check(exchange, now_ns)
            added, pdu = self._units.next_to_send(exchange, now_ns)
        except RefusedRequestError as refusal:
            self._tell_refusal(refusal, now_ns)
            self._ends.refuse_unsent(exchange, refusal.code)
            return
        exchange.added = added
        if added is not None:
            self._send(exchange, added.pdu, added.axis.plan.unit_id, now_ns)
            return
        self.counters.unknown_modes += sum(map(note_leaving, exchange.rewritings))
        self._send(exchange, pdu, exchange.unit_id, now_ns)
        self._writers.moved(exchange, now_ns)

    def _tell_refusal(self, refusal: RefusedRequestError, now_ns: int) -> None:
        """Tell why a request was refused, and of many like it how many there were."""
        count = self._refusals.due((refusal.kind.value, refusal.axis), now_ns)
        if count:
            self._on_event(Event(refusal.kind, refusal.axis or None, refusal.reason + times(count)))

    def _note_unknown_unit(self, unit_id: int) -> None:
        """Count a request to a unit id of which nobody knows anything, and tell of the first one."""
        if self._units.aliases.note(unit_id):
            mapped = ", ".join(f"{axis.plan.name} (unit id {axis.plan.unit_id})" for axis in self.axes)
            detail = f"a controller talks to unit id {unit_id}, which has no axis; there are {mapped}"
            self._on_event(Event(EventKind.UNKNOWN_UNIT, None, detail))

    def _send(self, exchange: Exchange, pdu: bytes, unit_id: int, now_ns: int) -> None:
        exchange.wire_unit_id = unit_id
        if unit_id == BROADCAST_UNIT_ID and self._link.is_serial:
            exchange.sent_ns = now_ns
            self._link.send_request(unit_id, pdu)
            self.counters.broadcasts += 1
            self.rest.turn_around(now_ns)
            self._gaps.ended(exchange, now_ns, self.rest.until_ns)
            for rewriting in exchange.rewritings:
                note_broadcast(rewriting, now_ns)
            self._news.look(self.axes)
            return
        self._put_on_wire(exchange, pdu, unit_id, now_ns)

    def _put_on_wire(self, exchange: Exchange, pdu: bytes, unit_id: int, now_ns: int) -> None:
        exchange.sent_ns = now_ns
        self._current = exchange
        patience_ns = self._response_timeout_ns
        if exchange.port is not None and exchange.added is None:
            timeout_ns = int(exchange.port.plan.timeout_ms * NS_PER_MS)
            if timeout_ns > patience_ns:
                patience_ns = timeout_ns
        exchange.deadline_ns = now_ns + patience_ns
        self._link.send_request(unit_id, pdu)

    # --- endings ---------------------------------------------------------------------------------------

    def _time_out(self, exchange: Exchange, now_ns: int) -> None:
        self._link.abandon()
        self._current = None
        self.counters.timeouts += 1
        unit_id = exchange.wire_unit_id
        self._silent.timed_out(unit_id)
        self._ends.lost(exchange, now_ns)
        self._silent.doubt(unit_id, now_ns)
        if self._link.is_serial:
            self.rest.drain(now_ns)
        self._gaps.ended(exchange, now_ns, self.rest.until_ns)
        self._ends.fail(exchange, NO_RESPONSE)
