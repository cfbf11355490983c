"""One line: who may send next, what is sent, whose reply comes back. Sans-IO; time is an argument.

States of the line:

- *down*: no link to the drives; requests are answered 0x0A (serial controllers: silence).
- *free*: the next request is sent in the same call in which it arrives.
- *busy*: one transaction is on the wire (W6); others wait, stops at their head (M3).
- *resting*: nothing is sent until an instant passes: the turnaround after a broadcast, or the silence after a
  time-out, so that a late reply never answers the next request (W6).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from gateway.exchange.access import only_reads
from gateway.exchange.added_frames import AddedFrame, Purpose, learn, note_restaged, reads_at_start
from gateway.exchange.admission import Admission, judge
from gateway.exchange.answers import Answers
from gateway.exchange.arbitration import Gaps
from gateway.exchange.axis.events import Outcome
from gateway.exchange.axis.groups import join
from gateway.exchange.axis.transitions import Axis
from gateway.exchange.control import Control, ControlError, EndDryRun, SetLimits, carry_out
from gateway.exchange.counters import LineCounters
from gateway.exchange.deadlines import Deadlines
from gateway.exchange.dispatch import REMEMBERED_PATHS, Units, is_acting_on
from gateway.exchange.events import Event, EventKind
from gateway.exchange.meaning import Meaning
from gateway.exchange.meter import LineMeter
from gateway.exchange.ownership import Ownership
from gateway.exchange.plan import NO_OTHER_UNITS, AxisPlan, LineTiming, OtherUnits
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.queue import QUEUE_LIMIT, WaitingQueue
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.request import Known
from gateway.exchange.rest import Rest
from gateway.exchange.throttle import Throttle, times
from gateway.exchange.transaction import (
    LOST,
    NO_RESPONSE,
    Answer,
    Endings,
    Phase,
    Transaction,
    outcome_of_reply,
)
from gateway.modbus.pdu import BROADCAST_UNIT_ID, EXCEPTION_BIT, MAX_PDU, ExceptionCode, is_exception
from gateway.times import NS_PER_MS, NS_PER_S

ACKNOWLEDGED: Final = Outcome.ACKNOWLEDGED
EXCEPTION: Final = Outcome.EXCEPTION
ON_THE_WIRE: Final = "a request that may move it is on the wire; let it arrive at a target, and reload again"
REFUSALS_TOLD: Final = 10
"""So many refusals of a kind are told of an axis in a second; of more how many there were."""


class LineExchange:
    """The transactions of one line and the axes on it."""

    def __init__(
        self,
        axes: Sequence[AxisPlan],
        timing: LineTiming,
        link: DriveLink,
        on_event: Callable[[Event], None],
        groups: Iterable[Iterable[str]] = (),
        *,
        remembered_paths: int = REMEMBERED_PATHS,
        other_units: OtherUnits = NO_OTHER_UNITS,
        what_ran: Callable[[int, int], str] = lambda _since_ns, _until_ns: "",
    ) -> None:
        self.axes = tuple([Axis(plan) for plan in axes])
        join(self.axes, groups)
        self.counters = LineCounters()
        self._units = Units(
            self.axes, is_serial=link.is_serial, remembered_paths=remembered_paths, other_units=other_units
        )
        self._link = link
        self._on_event = on_event
        self._ownership = Ownership(self.axes, self._units, on_event)
        self._ends = Endings(self.counters, on_event, self._lose, self._units.get)
        self._admission = Admission(self._units, self._ends, self._ownership, on_event)
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self.rest = Rest(timing)
        self._waiting = WaitingQueue()
        self._current: Transaction | None = None
        self.is_up = False
        """Whether there is a link to the drives."""
        self._is_stopping = False
        self.answers = Answers()
        self._refusals = Throttle(NS_PER_S, REFUSALS_TOLD)
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

    def unit_ids_status(self, now_ns: int) -> dict[str, Any]:
        """Return whom controllers talk to, and how the drives of unit ids answer."""
        asked = {unit_id for unit_id in self._units.heard if unit_id != BROADCAST_UNIT_ID}
        shown = sorted(asked.union(axis.plan.unit_id for axis in self.axes))
        asked_by: dict[str, list[int]] = {}
        for controller, unit_id in sorted(self.answers.askers.union(self.meter.measured)):
            if unit_id >= 0:  # of others than the pairs that are measured apart
                asked_by.setdefault(controller, []).append(unit_id)
        return {
            "axes": {axis.plan.name: axis.plan.unit_id for axis in self.axes},
            **self.unit_ids,
            "asked_by": asked_by,
            "drives": {str(unit_id): self.answers.status(unit_id, now_ns) for unit_id in shown},
        }

    def rivals_status(self, axis: str, now_ns: int) -> dict[str, object] | None:
        """Return who moves an axis beside its writer, or tries to; None: nobody does."""
        return self._ownership.rivals.status(axis, now_ns)

    @property
    def is_idle(self) -> bool:
        """Whether no transaction is on the wire."""
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
        if port.is_serial and (self._current is not None or self._waiting.total):
            self._give_up(port, "its controller sent another request", now_ns)
        if self._is_stopping:
            return
        # Losses are told apart by it (M3): no two requests come at one instant.
        arrived_ns = self._arrived_ns = now_ns if now_ns > self._arrived_ns else self._arrived_ns + 1
        transaction = Transaction(port, transaction_id, unit_id, pdu, arrived_ns)
        if port.gate is not None and not self._admission.lets_in(transaction, arrived_ns):
            return
        is_motion = port.is_motion
        if is_motion and self._gaps.is_watching and not self._is_moving:
            self._gaps.motion_came(now_ns)
        is_free = self._current is None and self.rest.until_ns is None
        if why_given_up and not (self.is_up and self._units.stops_of(self._units.frames_of(transaction))):
            self._withdraw(transaction, why_given_up, now_ns)
        elif is_free and is_motion and self.is_up:
            self._start_request(transaction, now_ns)
        else:
            self._judge(transaction, now_ns, is_free=is_free)

    def _judge(self, transaction: Transaction, now_ns: int, *, is_free: bool) -> None:
        """Start, queue or refuse a request that cannot simply go out."""
        port = transaction.port
        assert port is not None
        is_allowed, stops = judge(self._units, transaction, is_free=is_free)
        if not is_allowed:
            self._admission.deny_role(transaction, now_ns)
        elif not self.is_up:
            self._refuse_absent(transaction, now_ns)
        elif is_free and stops:
            self._start(transaction, now_ns)
        elif stops:
            self._overtake(transaction, stops, now_ns)
        elif self._waiting.count(port) >= QUEUE_LIMIT:
            self._admission.deny_queue(transaction, now_ns)
        else:
            self._gaps.is_watching |= not transaction.is_motion
            self._waiting.add(transaction)
            self._next(now_ns)

    def _overtake(self, stop: Transaction, stops: list[Meaning], now_ns: int) -> None:
        """Put a stop at the head of the queue, and withdraw what would move its axes afterwards (M3)."""
        axes = [meaning.axis for meaning in stops]
        reason = "a stop of its axis came after it"
        for transaction in self._waiting.withdraw(lambda each: is_acting_on(self._units, each, axes)):
            self._overtaken(transaction, reason, now_ns)
        current = self._current
        if current and current.phase is Phase.PREREQUISITE and is_acting_on(self._units, current, axes):
            current.overtake(reason)
        stop.become_stop()
        if not self._waiting.add_stop(stop):  # the same stop waits already, many times
            busy = ExceptionCode.SERVER_DEVICE_BUSY
            self._refuse(stop, busy, now_ns, is_lost=False)

    def controller_gone(self, port: ControllerPort, now_ns: int) -> None:
        """Withdraw what a closed connection still has waiting (W5)."""
        self._give_up(port, "its connection closed", now_ns)
        self._admission.gone(port, now_ns)

    def _give_up(self, port: ControllerPort, reason: str, now_ns: int) -> None:
        """Withdraw what a controller has given up on; a reply to what is on the wire is not for it (W5)."""
        for transaction in self._waiting.give_up(port):
            self._withdraw(transaction, reason, now_ns)
        if self._current and self._current.port is port:
            self._current.give_up()

    def note_standstill(self, gap_ns: int) -> None:
        """Report that nobody looked for a while."""
        detail = f"the relay stood still for {gap_ns / NS_PER_S:.2f} s; what controllers gave up is not sent"
        self._on_event(Event(EventKind.STOOD_STILL, None, detail))

    def control(self, message: Control, now_ns: int) -> dict[str, str]:
        """Do what somebody outside asks for; see ``control.carry_out``. Raises ControlError."""
        current = self._current
        if isinstance(message, EndDryRun) and current is not None and not only_reads(current.pdu):
            raise ControlError(f"axis {message.axis} stays in shadow: {ON_THE_WIRE}")
        changed = carry_out(self.axes, message, now_ns)
        if isinstance(message, SetLimits):
            self.meter.set_budget(message.axis, message.limits.budget_us)
        elif isinstance(message, EndDryRun):
            self._units.forget_paths()
        self._report(self.axes)
        return changed

    # --- from the drives -------------------------------------------------------------------------------

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that the link framed for the transaction on the wire."""
        transaction = self._current
        if transaction is None or unit_id != transaction.wire_unit_id or not pdu:
            self.stray(now_ns)
            return
        if len(pdu) > MAX_PDU:  # it cannot be passed on
            self._current = None
            self.counters.oversized += 1
            self._end_unanswered(transaction, now_ns)
            self._gaps.ended(transaction, now_ns)
            self._next(now_ns)
            return
        self.answers.answered_ns[unit_id] = now_ns
        if unit_id in self.answers.silent:
            del self.answers.silent[unit_id]
            self._on_event(Event(EventKind.DRIVE_ANSWERS, None, f"unit id {unit_id}"))
        path = transaction.path
        turned = None if path is None else path.answered(transaction, pdu, now_ns)
        if path is None or turned is None:
            axes = self._take_reply(transaction, pdu, now_ns)
        else:
            axes = path.axes
            self.counters.exchanges += 1
            self.counters.exceptions += pdu[0] >= EXCEPTION_BIT
            transaction.end(ACKNOWLEDGED if pdu[0] < EXCEPTION_BIT else EXCEPTION)
            self._ends.reply(transaction, turned)
            path.settle(transaction, now_ns)
            self._current = None
            assert transaction.port is not None
            self.meter.note(transaction, transaction.port, pdu, now_ns)
        if self._gaps.is_watching:
            self._gaps.ended(transaction, now_ns)
        if axes:
            self._report(axes)
        if self._waiting.total:
            self._next(now_ns)

    def _take_reply(self, transaction: Transaction, pdu: bytes, now_ns: int) -> tuple[Axis, ...]:
        """Take a reply on the slow path; return the axes of which something may have been learned."""
        axes = self._units.axes_of(transaction.wire_unit_id)
        for axis in axes:
            axis.end_silence(is_answer=True)
        if transaction.added is not None:
            self._current = None
            self._take_added(transaction, pdu, now_ns)
            return axes
        outcome, code = outcome_of_reply(transaction, pdu)
        self._ends.finish(transaction, outcome, now_ns, code=code, reply=pdu)
        self._current = None
        if transaction.port is not None:
            self.meter.note(transaction, transaction.port, pdu, now_ns)
        return axes

    def _take_added(self, transaction: Transaction, pdu: bytes, now_ns: int) -> None:
        """Take note of the reply to a frame of the gateway's own, and go on with what it was for."""
        frame = transaction.added
        assert frame is not None
        if transaction.port is None:
            self.counters.added_reads += 1
            learn(frame, pdu, Known(), transaction.sent_ns)
            outcome = Outcome.EXCEPTION if is_exception(pdu) else Outcome.ACKNOWLEDGED
            self._ends.finish(transaction, outcome, now_ns)
            record = frame.axis.record
            if frame.purpose is Purpose.ACTUAL and record is not None and record.wants_look:
                self._waiting.add_own(frame, now_ns)
            return
        transaction.learn()
        code = self._learn(transaction, frame, pdu, now_ns)
        if code is not None:
            self._refuse(transaction, code, now_ns)
        elif self._waiting.has_stops and not transaction.overtaken_by:
            transaction.need(None)
            self._waiting.put_back(transaction)
        else:
            self._start(transaction, now_ns)

    def _learn(self, transaction: Transaction, frame: AddedFrame, pdu: bytes, now_ns: int) -> int | None:
        """Take note of the reply to a prerequisite.

        Returns:
            The exception code with which the request that it was for is refused; None when it can go on.
        """
        known = transaction.knowledge()
        rendering = frame.rendering
        if rendering is None:
            self.counters.added_reads += 1
            if frame.purpose is Purpose.LOOK:
                transaction.excuse(now_ns - transaction.sent_ns)
            learn(frame, pdu, known, transaction.sent_ns)
            return None
        if frame.is_acknowledged(pdu):
            self.counters.restaged += 1
            note_restaged(frame)
            frame.axis.tell_restaged(self.counters.restaged, now_ns)
            return None
        code = pdu[1] if len(pdu) == 2 and is_exception(pdu) else ExceptionCode.SERVER_DEVICE_FAILURE
        why = "the drive refused the staged target when it was written anew"
        frame.axis.lose_restaged(rendering, code, why)
        return code

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
            axis.end_silence(is_answer=True, until_ns=now_ns)
        for read in reads_at_start(self.axes):
            self._waiting.add_own(read, now_ns)
        self._report(self.axes)
        self._next(now_ns)

    def link_down(self, now_ns: int) -> None:
        """Note that the drives cannot be reached: nothing waits for them any longer."""
        if not self.is_up:
            return
        self.is_up = False
        if not self._is_stopping:  # closing it ourselves is no event
            self._on_event(Event(EventKind.LINE_DOWN))
        current, self._current = self._current, None
        is_busy = current is not None or self.rest.is_draining
        self.rest.break_off(owes_silence=self._link.is_serial and is_busy)
        for axis in self.axes:
            axis.lose_link(now_ns)
        if current is not None:
            self._end_unanswered(current, now_ns)
        for transaction in self._waiting.withdraw(lambda _: True):
            self._refuse_absent(transaction, now_ns)
        self._report(self.axes)

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
        """Send nothing new; the transaction on the wire ends as it would have (see :attr:`is_idle`)."""
        self._is_stopping = True
        for transaction in self._waiting.withdraw(lambda _: True):
            self._withdraw(transaction, "the gateway stops", now_ns)

    # --- sending ---------------------------------------------------------------------------------------

    @property
    def _is_moving(self) -> bool:
        """Whether a motion transaction is on the wire or waits."""
        current = self._current
        return (current is not None and current.is_motion) or not self._waiting.only_others

    def _next(self, now_ns: int) -> None:
        """Start what waits, as long as the line is free."""
        self._monitor_due_ns = None
        while self._waiting.total and self._current is None and self.rest.until_ns is None:
            if not self._waiting.only_others:
                self._start(self._waiting.pop(), now_ns)
                continue
            transaction, self._monitor_due_ns = self._gaps.choose(self._waiting.first_of_others(), now_ns)
            if transaction is None:
                return
            self._waiting.take(transaction)
            self._start(transaction, now_ns)

    def _start(self, transaction: Transaction, now_ns: int) -> None:
        """Send a transaction, or the frame that it needs first; or withdraw or refuse it."""
        transaction.start(now_ns)
        reason = "the gateway stops" if self._is_stopping else transaction.why_given_up(now_ns)
        if reason:
            self._withdraw(transaction, reason, now_ns)
        elif transaction.overtaken_by:
            self._overtaken(transaction, transaction.overtaken_by, now_ns)
        elif transaction.port is None:
            self._put_on_wire(transaction, transaction.pdu, transaction.unit_id, now_ns)
        else:
            self._start_request(transaction, now_ns)

    def _start_request(self, transaction: Transaction, now_ns: int) -> None:
        if transaction.known is None and not self._deadlines.may_be_late(transaction, now_ns):
            path = self._units.path_of(transaction.unit_id, transaction.pdu)
            sent_pdu = None if path is None else path.sent(transaction, now_ns)
            if path is not None and sent_pdu is not None:
                transaction.path = path
                self._put_on_wire(transaction, sent_pdu, transaction.unit_id, now_ns)
                if transaction.target is not None:
                    path.left(transaction)
                return
        if transaction.unit_id not in self._units and self._units.aliases.is_unknown(transaction.unit_id):
            self._note_unknown_unit(transaction.unit_id)
            if transaction.port is not None:
                self.answers.askers.add((transaction.port.plan.name, transaction.unit_id))
        if not self._ownership.may_move(transaction, now_ns):
            self._refuse(transaction, ExceptionCode.SERVER_DEVICE_BUSY, now_ns)
            return
        for axis in self._units.axes_of(transaction.unit_id):
            axis.end_silence(is_answer=False)
        try:
            self._deadlines.check(transaction, now_ns)
            added, pdu = self._units.next_to_send(transaction, now_ns)
        except RefusedRequestError as refusal:
            self._tell_refusal(refusal, now_ns)
            self._refuse(transaction, refusal.code, now_ns)
            return
        transaction.need(added)
        if added is not None:
            self._put_on_wire(transaction, added.pdu, added.axis.plan.unit_id, now_ns)
            return
        for rewriting in transaction.rewritings:
            for axis, written in rewriting.written:
                self.counters.unknown_modes += axis.send(written)
        self._put_on_wire(transaction, pdu, transaction.unit_id, now_ns)
        self._ownership.moved(transaction, now_ns)

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

    def _put_on_wire(self, transaction: Transaction, pdu: bytes, unit_id: int, now_ns: int) -> None:
        """Send a frame: the request itself, or one of the gateway's own. All frames leave here."""
        patience_ns = self._response_timeout_ns
        port = transaction.port
        if port is not None and port.patience_ns > patience_ns and transaction.added is None:
            patience_ns = port.patience_ns
        transaction.leave(now_ns, unit_id, patience_ns)
        if unit_id == BROADCAST_UNIT_ID and self._link.is_serial:
            self._link.send_request(unit_id, pdu)
            self._end_broadcast(transaction, now_ns)
            return
        self._current = transaction
        self._link.send_request(unit_id, pdu)

    def _end_broadcast(self, transaction: Transaction, now_ns: int) -> None:
        """Give the drives time to obey what all of them heard, and none of them answers."""
        self.counters.broadcasts += 1
        self.rest.turn_around(now_ns)
        self._gaps.ended(transaction, now_ns, self.rest.until_ns)
        self._ends.finish(transaction, Outcome.BROADCAST, now_ns)
        self._report(self.axes)

    def _report(self, axes: tuple[Axis, ...]) -> None:
        """Tell what is new about these axes; a group is referenced as a whole, or not at all."""
        for axis in axes:
            if axis.peers:
                axis.follow_group()
                for peer in axis.peers:
                    for event in peer.take_events():
                        self._on_event(event)
            for event in axis.take_events():
                self._on_event(event)

    # --- endings ---------------------------------------------------------------------------------------

    def _lose(self, transaction: Transaction, code: int) -> None:
        """Note that a request never reached its drive (M3)."""
        self._ownership.lose(transaction, code)
        self._report(self._units.axes_of(transaction.unit_id))

    def _refuse(self, transaction: Transaction, code: int, now_ns: int, *, is_lost: bool = True) -> None:
        """Refuse a request that might have moved something: it never reached the drive (M3)."""
        self._ends.finish(
            transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.REFUSAL, is_lost=is_lost
        )

    def _refuse_absent(self, transaction: Transaction, now_ns: int) -> None:
        """Say that there is no link to the drives (W7)."""
        code = ExceptionCode.GATEWAY_PATH_UNAVAILABLE
        self._ends.finish(transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.ABSENCE)

    def _withdraw(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """End a request that its controller does not wait for any more (W5)."""
        self._ends.finish(transaction, Outcome.NEVER_SENT, now_ns, code=LOST, withdrawn=why)

    def _overtaken(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """Withdraw what a stop has overtaken; its controller still waits, and is told (M3)."""
        code = ExceptionCode.SERVER_DEVICE_BUSY
        self._ends.finish(
            transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.REFUSAL, withdrawn=why
        )

    def _end_unanswered(self, transaction: Transaction, now_ns: int) -> None:
        """End what is on the wire, and will not be answered any more."""
        outcome, frame = Outcome.NO_REPLY, transaction.added
        if transaction.phase is Phase.PREREQUISITE:
            outcome = Outcome.NEVER_SENT
            if frame is not None and frame.rendering is not None:
                why = "nobody knows whether the staged target was written anew"
                frame.axis.lose_restaged(frame.rendering, NO_RESPONSE, why)
        self._ends.finish(transaction, outcome, now_ns, code=NO_RESPONSE, answer=Answer.ABSENCE)

    def _time_out(self, transaction: Transaction, now_ns: int) -> None:
        self._link.abandon()
        self._current = None
        self.counters.timeouts += 1
        unit_id = transaction.wire_unit_id
        if transaction.port is not None:
            self.answers.askers.add((transaction.port.plan.name, unit_id))
        if self.answers.miss(unit_id, transaction.sent_ns):
            self._on_event(Event(EventKind.DRIVE_SILENT, None, f"unit id {unit_id}"))
        self._end_unanswered(transaction, now_ns)
        axes = self._units.axes_of(unit_id)
        for axis in axes:
            axis.fall_silent(now_ns)
        self._report(axes)
        if self._link.is_serial:
            self.rest.drain(now_ns)
        self._gaps.ended(transaction, now_ns, self.rest.until_ns)
