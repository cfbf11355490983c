"""What the line does after a reply, a frame that answers nothing, a time-out, and the end of the link."""

from typing import Final

from gateway.catalogue import exchange_events
from gateway.exchange.added_frames import (
    AddedFrame,
    Purpose,
    acknowledge_rewritten,
    is_asked_again,
    is_open,
    learn,
    next_poll,
    once_more,
)
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.events import Event
from gateway.exchange.line_context import LineContext
from gateway.exchange.ports import ControllerPort
from gateway.exchange.request import Prefetched
from gateway.exchange.transaction import (
    NO_RESPONSE,
    Answer,
    Phase,
    Step,
    Stopping,
    Transaction,
    outcome_of_reply,
)
from gateway.exchange.turn import Turn
from gateway.modbus.pdu import EXCEPTION_BIT, MAX_PDU, ExceptionCode, is_absence, is_exception

ACKNOWLEDGED: Final = Outcome.ACKNOWLEDGED
EXCEPTION: Final = Outcome.EXCEPTION
NO_UNIT_ID: Final = -1
"""Unit id of bytes that belong to no unit."""


class DriveSide:
    """The drives' side of one line."""

    def __init__(self, context: LineContext, turn: Turn) -> None:
        self._context = context
        self._turn = turn
        self._axes = context.axes
        self._counters = context.counters
        self._units = context.units
        self._link = context.link
        self._on_event = context.on_event
        self._ownership = context.ownership
        self._transactions = context.transactions
        self._rest = context.rest
        self._waiting = context.waiting
        self._renewal = context.renewal
        self._silent_units = context.silent_units
        self._link_state = context.link_state
        self._scheduler = context.scheduler
        self._meter = context.meter
        self._tap = context.tap
        self._response_timeout_ns = context.response_timeout_ns
        self._broken_off: ControllerPort | None = None
        """The connection of the request on the wire, if it broke meanwhile."""

    def break_off(self, port: ControllerPort) -> None:
        """Record that the connection of a controller broke; its request may be on the wire."""
        if self._transactions.current is not None and self._transactions.current.port is port:
            self._broken_off = port

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply to the transaction on the wire, and start what waits."""
        transaction = self._transactions.current
        if transaction is None or unit_id != transaction.wire_unit_id or not len(pdu):
            self.stray(now_ns, NO_UNIT_ID)
            return
        if len(pdu) > MAX_PDU:
            self._drop_oversized(transaction, now_ns)
            return
        if transaction.stopping is Stopping.EARLY and not self._scheduler.is_answer(transaction, pdu):
            self._send_stop_again(transaction, now_ns)
            return
        if self._link_state.closes_soon:
            self._link_state.see_whether_it_closes(transaction, now_ns)
        is_absent = is_absence(pdu)
        if is_absent:
            self._fall_silent(transaction, now_ns)
        else:
            self._silent_units.answered_ns[unit_id] = now_ns
        if self._silent_units.silences:
            self._end_silence(transaction, now_ns, is_absent=is_absent)
        path, forwarding = transaction.path, self._turn.forwarding
        if path is None:
            nominal_reply = None
        elif forwarding is None:
            nominal_reply = path.answered(transaction, pdu, now_ns)
        else:
            nominal_reply = forwarding.answered(path, transaction, pdu, now_ns)
        if path is None or nominal_reply is None:
            axes = self._take_reply(transaction, pdu, now_ns, is_absent=is_absent)
        else:
            axes = path.axes
            self._counters.exchanges += 1
            self._counters.exceptions += pdu[0] >= EXCEPTION_BIT
            outcome = ACKNOWLEDGED if pdu[0] < EXCEPTION_BIT else EXCEPTION
            self._transactions.go_on(transaction, outcome)
            self._transactions.reply(transaction, nominal_reply, now_ns)
            path.settle(transaction, now_ns)
            self._transactions.free_wire()
            assert transaction.port is not None
            self._meter.add(transaction, transaction.port, pdu, now_ns)
        if forwarding is not None:
            forwarding.add(transaction, pdu, nominal_reply, now_ns)
        if self._scheduler.gaps.is_watching:
            self._turn.end(transaction, now_ns)
        if is_absent:
            self._take_absence(transaction, pdu, now_ns)
        self._context.report(self._axes if transaction.is_by_alias else axes)
        if self._waiting.total or self._renewal.holds:
            self._turn.next(now_ns)

    def _drop_oversized(self, transaction: Transaction, now_ns: int) -> None:
        """End an exchange whose reply is too long for a PDU, and so cannot be passed on."""
        self._transactions.free_wire()
        self._renewal.mark_alive()
        self._counters.oversized += 1
        self._end_unanswered(transaction, now_ns)
        self._turn.end(transaction, now_ns)
        self._turn.next(now_ns)

    def _send_stop_again(self, transaction: Transaction, now_ns: int) -> None:
        """Send an early stop again: the reply to it was the late answer to another request (W6)."""
        unit_id = transaction.wire_unit_id
        self._renewal.mark_alive()
        self._silent_units.disturb(unit_id, now_ns)
        self._silent_units.expect_late_reply(unit_id, transaction.sent_ns + self._response_timeout_ns)
        self._transactions.free_wire()
        self._scheduler.go_again(transaction, now_ns)
        self._context.report(self._units.axes_of(unit_id))
        self._turn.next(now_ns)

    def _end_silence(self, transaction: Transaction, now_ns: int, *, is_absent: bool) -> None:
        """Take a reply while a unit of the line is silent; ``is_absent``: it is from its converter."""
        unit_id = transaction.wire_unit_id
        if transaction.stopping is Stopping.AGAIN and self._silent_units.awaits_late_reply_of(unit_id):
            # The same stop was sent twice and answered once; it is unknown which of them was answered.
            self._silent_units.expect_late_reply(unit_id, transaction.sent_ns + self._response_timeout_ns)
        self._renewal.mark_answered(unit_id)
        self._renewal.mark_alive()
        if not is_absent:
            self._silent_units.mark_alive(unit_id, now_ns)

    def _take_absence(self, transaction: Transaction, pdu: bytes, now_ns: int) -> None:
        """Count a drive as silent: its converter answered in its place, and the drive may be off (W7)."""
        unit_id = transaction.wire_unit_id
        if transaction.phase is not Phase.ENDED:
            return  # the read is repeated first
        is_new, has_died = self._silent_units.miss_behind_converter(unit_id, transaction.sent_ns, now_ns)
        why = f"unit id {unit_id}: its converter answers {pdu[-1]:#04x} in its place"
        if is_new:
            self._on_event(Event(exchange_events.DRIVE_SILENT, None, why))
        self._thin_out_stops(transaction, now_ns)
        if has_died:
            self._back_off(why, now_ns)

    def _take_reply(
        self, transaction: Transaction, pdu: bytes, now_ns: int, *, is_absent: bool
    ) -> tuple[Axis, ...]:
        """Take a reply on the slow path; return the axes whose state it may have changed."""
        axes = self._units.axes_of(transaction.wire_unit_id)
        for axis in axes:
            if axis.reach.silent_since_ns is not None and not is_absent:
                axis.end_silence(is_answer=True)
        if transaction.added is not None:
            self._transactions.free_wire()
            self._take_added(transaction, pdu, now_ns)
            return axes
        if self._renewal.holds and not transaction.is_stop:
            self._renewal.answered(now_ns)
        outcome, code = outcome_of_reply(transaction, pdu)
        self._transactions.finish(transaction, outcome, now_ns, code=code, reply=pdu)
        self._transactions.free_wire()
        if self._broken_off is not None:
            self._forget_parts_of(transaction)
        if transaction.port is not None:
            self._meter.add(transaction, transaction.port, pdu, now_ns)
        return axes

    def _take_added(self, transaction: Transaction, pdu: bytes, now_ns: int) -> None:
        """Process the reply to a frame of the gateway, and continue with the request that needed it."""
        frame = transaction.added
        assert frame is not None
        if self._renewal.holds and frame.rendering is None:
            self._renewal.answered(now_ns)
        if transaction.port is None:
            self._counters.added_reads += 1
            prefetched = Prefetched()
            is_again = is_asked_again(frame, pdu, prefetched)
            if not (is_again or is_open(frame, pdu)):
                learn(frame, pdu, prefetched, transaction.sent_ns)
            outcome = Outcome.EXCEPTION if is_exception(pdu) else Outcome.ACKNOWLEDGED
            self._transactions.finish(transaction, outcome, now_ns)
            following = None if is_exception(pdu) else next_poll(frame, transaction.sent_ns)
            self._waiting.add_own(once_more(frame) if is_again else following, now_ns)
            return
        self._transactions.go_on(transaction, Step.ANSWERED)
        code = self._learn(transaction, frame, pdu, now_ns)
        if code is not None:
            self._transactions.refuse(transaction, code, now_ns)
        elif self._scheduler.has_due_stop(now_ns) and not transaction.overtaken_by:
            transaction.begin_anew()
            self._waiting.put_back(transaction)
        elif self._rest.is_closing or self._renewal.holds:  # send nothing on a connection that closes
            self._waiting.put_back(transaction)
        elif self._turn.is_paced(now_ns):
            self._scheduler.put_next(transaction)
        else:
            self._turn.start(transaction, now_ns)

    def _learn(self, transaction: Transaction, frame: AddedFrame, pdu: bytes, now_ns: int) -> int | None:
        """Process the reply to a prerequisite.

        Returns:
            The exception code with which its request is refused; None: the request can continue.
        """
        prefetched = transaction.knowledge()
        rendering = frame.rendering
        if rendering is None:
            self._counters.added_reads += 1
            if frame.purpose is Purpose.POLL:
                transaction.excuse(now_ns - transaction.sent_ns)
            if is_asked_again(frame, pdu, prefetched) and now_ns <= transaction.leave_by_ns:
                return None  # it is read again, unless something else is sent first
            if is_open(frame, pdu):
                if is_absence(pdu) or not transaction.only_reads:
                    return pdu[-1]
                prefetched.references.add(frame.axis.plan.name)  # a read does no harm
                return None
            learn(frame, pdu, prefetched, transaction.sent_ns)
            return None
        if frame.is_acknowledged(pdu):
            self._counters.restaged += 1
            acknowledge_rewritten(frame)
            frame.axis.reports.report_rewritten(self._counters.restaged, now_ns)
            return None
        code = pdu[1] if len(pdu) == 2 and is_exception(pdu) else ExceptionCode.SERVER_DEVICE_FAILURE
        why = "the drive refused the staged target when it was rewritten"
        frame.axis.lose_rewritten(rendering, code, why)
        return code

    def stray(self, now_ns: int, unit_id: int) -> None:
        """Record bytes that answer nothing; see ``LineExchange.stray``."""
        self._counters.late += 1
        self._renewal.mark_alive()
        if self._transactions.current is not None and self._transactions.current.phase is Phase.LEAVING:
            self._turn.abort(self._transactions.current, ForwardEvent.MET, now_ns)
        is_awaited = self._silent_units.disturb(unit_id, now_ns)
        if self._rest.is_draining:
            self._rest.disturb(now_ns)
        elif unit_id >= 0 and self._link.is_serial and self._transactions.current is None and not is_awaited:
            self._rest.drain(now_ns)
            detail = f"a frame that answers nothing: waiting for {self._rest.drain_ms:g} ms of silence"
            self._on_event(Event(exchange_events.LATE_REPLY, None, detail))
        if unit_id >= 0 and self._silent_units.silences:
            self._silent_units.mark_alive(unit_id, now_ns)
        if is_awaited and self._transactions.current is None:
            self._turn.next(now_ns)

    def link_down(self, now_ns: int, reason: str, *, is_orderly: bool) -> None:
        """End the transaction on the wire; see ``LineExchange.link_down``."""
        current = self._transactions.free_wire()
        self._link_state.end(current, reason, now_ns, is_orderly=is_orderly)
        if current is not None and current.phase is Phase.LEAVING:
            self._turn.abort(current, ForwardEvent.LOST, now_ns)
            self._transactions.never_left(current, now_ns)
        elif current is not None and self._may_begin_anew(current):
            self._transactions.go_on(current, Step.ANSWERED)
            current.begin_anew()
            self._waiting.put_back(current)
        elif current is not None:
            self.end_reply(ForwardEvent.GONE, now_ns)
            self._end_unanswered(current, now_ns)
        self._scheduler.forget_next()
        self._turn.hold_up_waiting(now_ns)
        self._context.report(self._axes)

    def _may_begin_anew(self, transaction: Transaction) -> bool:
        """Whether only a read of the gateway was on the wire, for a request that continues to wait."""
        frame = transaction.added
        is_read = transaction.phase is Phase.PREREQUISITE and frame is not None and frame.rendering is None
        return is_read and self._link.connects and not self._link_state.is_stopping

    def end_reply(self, why: ForwardEvent, now_ns: int) -> None:
        """Send no more of the reply that is being forwarded."""
        if self._turn.forwarding is not None:
            self._turn.forwarding.end_reply(why, now_ns)

    def _end_unanswered(self, transaction: Transaction, now_ns: int) -> None:
        """End the request on the wire, which will not be answered any more."""
        outcome, frame = Outcome.NO_REPLY, transaction.added
        if transaction.phase is Phase.PREREQUISITE:
            outcome = Outcome.NEVER_SENT
            if frame is not None and frame.rendering is not None:
                why = "the staged target may or may not have been rewritten"
                frame.axis.lose_rewritten(frame.rendering, NO_RESPONSE, why)
        self._transactions.finish(transaction, outcome, now_ns, code=NO_RESPONSE, answer=Answer.ABSENCE)
        if self._broken_off is not None:
            self._forget_parts_of(transaction)

    def _forget_parts_of(self, transaction: Transaction) -> None:
        """Drop a part that was on the wire when its connection broke: no other part completes it (M1)."""
        port, self._broken_off = self._broken_off, None
        if port is not None and transaction.port is port:
            self._ownership.forget_parts(port)

    def _unanswered_by(self, unit_id: int) -> str:
        """Name a unit id that did not answer, and what came instead, if known."""
        return f"unit id {unit_id} {self._link.came_instead(unit_id)}".rstrip()

    def time_out(self, transaction: Transaction, now_ns: int) -> None:
        """The transaction on the wire was not answered in time."""
        if self._tap is not None:
            self._tap.abandoned()
        self._link.abandon()
        self.end_reply(ForwardEvent.STALLED, now_ns)
        self._transactions.free_wire()
        self._counters.timeouts += 1
        unit_id = transaction.wire_unit_id
        if transaction.port is not None:
            self._silent_units.askers.add((transaction.port.plan.name, unit_id))
        if self._link.connects:
            frame = transaction.added
            is_read = transaction.only_reads if frame is None else frame.rendering is None
            self._renewal.miss(unit_id, transaction.sent_ns, is_read=is_read)
        silence, has_died = self._silent_units.miss(unit_id, transaction.sent_ns, now_ns)
        if silence.timeouts == 1:
            self._on_event(Event(exchange_events.DRIVE_SILENT, None, self._unanswered_by(unit_id)))
        self._thin_out_stops(transaction, now_ns)
        if transaction.stopping is Stopping.EARLY:
            self._scheduler.go_again(transaction, now_ns)
        else:
            self._end_unanswered(transaction, now_ns)
        self._fall_silent(transaction, now_ns)
        self._context.report(self._axes if transaction.is_by_alias else self._units.axes_of(unit_id))
        if has_died:
            self._back_off(self._unanswered_by(unit_id), now_ns)
        self._turn.end(transaction, now_ns, silence.quiet_ns or None)

    def _thin_out_stops(self, transaction: Transaction, now_ns: int) -> None:
        """Let others in between if a stop, which waits for nothing, was not answered by its drive (W11)."""
        if self._units.have_rules and self._units.stops_of(self._units.frames_of(transaction)):
            others = {id(each.port) for each in self._waiting if each.port not in (None, transaction.port)}
            self._silent_units.miss_stop(transaction.wire_unit_id, transaction.pdu, others, now_ns)
            self._silent_units.thin_out(transaction, now_ns)

    def _fall_silent(self, transaction: Transaction, now_ns: int) -> None:
        """The drive of the transaction on the wire did not answer."""
        for axis in self._units.axes_of(transaction.wire_unit_id):
            axis.fall_silent(transaction.sent_ns, now_ns)

    def _back_off(self, why: str, now_ns: int) -> None:
        """A drive is dead from now on: answer in its place (W11)."""
        if self._silent_units.backs_off:
            self._on_event(Event(exchange_events.DRIVE_BACKED_OFF, None, why))
            self._silent_units.answer_waiting(now_ns)
