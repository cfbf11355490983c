"""One line: which request is sent next, what is sent, whose reply comes back. Sans-IO; time is an argument.

States of the line:

- *down*: there is no link to the drives. If one can be made, requests wait for it for a limited time.
  Otherwise they are answered 0x0A (serial controllers: silence).
- *free*: the next request is sent in the same call in which it arrives.
- *busy*: one transaction is on the wire (W6). Others wait, stops at their head (M3).
- *resting*: only stops are sent until a certain time. It is the silence after an unexpected frame (W6), or
  the turnaround after a broadcast, in which stops wait too.
- *paced*: nothing is sent until the wire has been silent long enough for a frame (``Stamps.next_ns``).

The other decisions have files of their own:

- ``transaction``: whether a frame is sent, and how its request ends;
- ``scheduler``: which request is next;
- ``silent_units``: which units are silent, and what the gateway answers for them;
- ``link_state``: what the end of the link means.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from gateway.catalogue import exchange_events
from gateway.compensation.table import CorrectionTable
from gateway.compiled import mypyc_attr
from gateway.exchange.added_frames import (
    AddedFrame,
    Purpose,
    acknowledge_rewritten,
    is_asked_again,
    learn,
    next_poll,
    once_more,
)
from gateway.exchange.admission import NO_ROOM, Admission, judge, role_denial
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis, join_terms
from gateway.exchange.axis.registers import Loss
from gateway.exchange.commands import Command, EndDryRun, SetLimits
from gateway.exchange.control import ControlError, carry_out
from gateway.exchange.counters import LineCounters
from gateway.exchange.cut_through.forward import Forwarding, SerialTiming
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.cut_through.line import ForwardingLine
from gateway.exchange.deadlines import Deadlines
from gateway.exchange.decode import AxisCommand
from gateway.exchange.dispatch import REMEMBERED_PATHS, UnitMaps
from gateway.exchange.effects import leave
from gateway.exchange.events import Event
from gateway.exchange.gate import Denial
from gateway.exchange.group import join_groups, settle_group
from gateway.exchange.link_state import LinkState
from gateway.exchange.meter import LineMeter
from gateway.exchange.ownership import Ownership
from gateway.exchange.plan import NO_OTHER_UNITS, AxisPlan, LineTiming, OtherUnits
from gateway.exchange.ports import Alarm, ControllerPort, DriveLink, OwnUnit
from gateway.exchange.queue import WaitingQueue
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.renewal import Renewal, longest_lost_ns
from gateway.exchange.request import Prefetched
from gateway.exchange.rest import Rest
from gateway.exchange.scheduler import NO_DEADLINE_NS, Scheduler
from gateway.exchange.silent_units import SilentUnits
from gateway.exchange.tap import Tap
from gateway.exchange.transaction import (
    NO_RESPONSE,
    Answer,
    Phase,
    Step,
    StopEvent,
    Stopping,
    Transaction,
    Transactions,
    outcome_of_reply,
)
from gateway.limits import Reports, others_of_pairs, times
from gateway.modbus.lengths import is_odd_request
from gateway.modbus.pdu import BROADCAST_UNIT_ID, EXCEPTION_BIT, MAX_PDU, ExceptionCode, is_exception
from gateway.status.axis import WriterConflictStatus
from gateway.status.line import UnitIds
from gateway.times import NS_PER_MS, NS_PER_S

ACKNOWLEDGED: Final = Outcome.ACKNOWLEDGED
EXCEPTION: Final = Outcome.EXCEPTION
FRAME: Final = Step.FRAME
ADDED_FRAME: Final = Step.ADDED_FRAME
DEMAND_EVERY_NS: Final = 100 * NS_PER_MS
"""Minimum time between demands for a connection while something waits for it."""
NO_UNIT_ID: Final = -1
ON_THE_WIRE: Final = "a request that may move it is on the wire; let it arrive at a target, and reload again"
REFUSALS_REPORTED: Final = 10
"""Number of refusals of one kind and axis that are reported in a second; of more, only their count."""


@mypyc_attr(allow_interpreted_subclasses=True)
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
        own_unit: OwnUnit | None = None,
        cut_through: SerialTiming | None = None,
        tap: Tap | None = None,
    ) -> None:
        self._tap = tap
        self.alarm: Alarm | None = None
        """Set to the deadline after each call; None: the owner of the line polls :attr:`deadline_ns`."""
        self.axes = tuple([Axis(plan) for plan in axes])
        join_terms(self.axes)
        join_groups(self.axes, groups)
        self.counters = LineCounters()
        self._units = UnitMaps(
            self.axes, is_serial=link.is_serial, remembered_paths=remembered_paths, other_units=other_units
        )
        self._link = link
        self._odd_units = other_units.odd
        self._own_unit = own_unit
        self._own_unit_id = NO_UNIT_ID if own_unit is None else own_unit.unit_id
        self._on_event = on_event
        self._ownership = Ownership(self.axes, self._units, on_event)
        self._transactions = Transactions(self.counters, on_event, self._lose, self._units.get, link, tap=tap)
        self._admission = Admission(self._units, self._transactions, self._ownership, on_event)
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self.rest = Rest(timing)
        self._waiting = WaitingQueue()
        self._broken_off: ControllerPort | None = None
        """The connection of the request on the wire, if it broke meanwhile."""
        self._renewal = Renewal(
            self._response_timeout_ns, longest_lost_ns([axis.plan.lost_ms for axis in self.axes])
        )
        self.silent_units = SilentUnits(
            timing,
            self._units,
            self._waiting,
            self._transactions,
            on_event=on_event,
            report=self._report,
            is_serial=link.is_serial,
        )
        self.link_state = LinkState(
            self.axes,
            self._units,
            timing,
            link,
            self._waiting,
            transactions=self._transactions,
            silent_units=self.silent_units,
            rest=self.rest,
            renewal=self._renewal,
            on_event=on_event,
            report=self._report,
        )
        self._refusals: Reports[tuple[str, str]] = Reports(
            NS_PER_S, REFUSALS_REPORTED, others=others_of_pairs
        )
        self._scheduler = Scheduler(
            self.axes,
            timing,
            self._units,
            self._waiting,
            transactions=self._transactions,
            silent_units=self.silent_units,
            rest=self.rest,
            renewal=self._renewal,
            link=link,
        )
        self.meter = LineMeter(self.axes, link, on_event, what_ran)
        self._deadlines = Deadlines(self.axes, self._units, self.counters, on_event)
        self.forwarding: Forwarding | None = None
        """Only on a line with cut-through; ``cut_through`` is the wire of its drives."""
        if cut_through is not None:
            gap_ns = int(timing.gap_ms * NS_PER_MS)
            line = ForwardingLine(
                timing,
                link,
                self._waiting,
                transactions=self._transactions,
                scheduler=self._scheduler,
                silent_units=self.silent_units,
                link_state=self.link_state,
                rest=self.rest,
                go_on=self._next,
                tap=tap,
            )
            self.forwarding = Forwarding(
                line,
                link,
                self._units,
                cut_through,
                gap_ns=gap_ns,
                stored_units=other_units.unit_ids,
                on_change=self._settle,
                report_no_gain=lambda why: on_event(Event(exchange_events.CUT_THROUGH_OFF, None, why)),
                report_fault=self._transactions.report_fault,
                tap=tap,
            )

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` must be called; a few milliseconds late does no harm."""
        if self._transactions.current is not None:
            return self._transactions.current.deadline_ns
        rests_until_ns, waits_until_ns = self.rest.until_ns, self._scheduler.waits_until_ns
        if not self.link_state.is_up or self.link_state.closes_ns or self._renewal.holds:
            due_ns = self.link_state.deadline_ns
            if due_ns < NO_DEADLINE_NS and (waits_until_ns is None or due_ns < waits_until_ns):
                waits_until_ns = due_ns
        if self.silent_units.silences:
            quiet_ns = self.silent_units.quiet_ns
            if quiet_ns is not None and (waits_until_ns is None or quiet_ns < waits_until_ns):
                waits_until_ns = quiet_ns
        if rests_until_ns is None or waits_until_ns is None:
            return waits_until_ns if rests_until_ns is None else rests_until_ns
        return min(rests_until_ns, waits_until_ns)

    @property
    def is_up(self) -> bool:
        """Whether there is a link to the drives."""
        return self.link_state.is_up

    @property
    def is_still(self) -> bool:
        """Whether nothing is on the wire, waits or is due, except that the connection may be closed."""
        due_ns = self.deadline_ns
        return due_ns is None or (self.link_state.closes_ns > 0 and due_ns == self.link_state.closes_ns)

    @property
    def serves(self) -> bool:
        """Whether requests can be served: the link is up, blinks, or is not needed at the moment."""
        return (
            self.link_state.is_up
            or self.link_state.is_blinking
            or (self.link_state.is_on_demand and not self._waiting.total)
        )

    @property
    def needs_silence(self) -> bool:
        """Whether a reply may still come that is not for the next user of the line."""
        return self.rest.needs_silence or self.silent_units.awaits_late_reply

    @property
    def unit_ids(self) -> UnitIds:
        """Unit ids that controllers have addressed, and the number of requests to unknown ones."""
        aliases = self._units.aliases
        return UnitIds(
            heard=sorted(self._units.heard),
            strangers=sorted(self._units.heard.difference(aliases.expected_unit_ids)),
            requests=aliases.requests_by_name,
        )

    def unit_ids_status(self, now_ns: int) -> UnitIds:
        """Return which unit ids controllers address, and how the drives answer."""
        asked = {unit_id for unit_id in self._units.heard if unit_id != BROADCAST_UNIT_ID}
        shown = sorted(asked.union(axis.plan.unit_id for axis in self.axes))
        asked_by: dict[str, list[int]] = {}
        for controller, unit_id in sorted(self.silent_units.askers.union(self.meter.measured)):
            if unit_id >= 0:  # others are not measured as pairs
                asked_by.setdefault(controller, []).append(unit_id)
        found = self.unit_ids
        found.axes = {axis.plan.name: axis.plan.unit_id for axis in self.axes}
        found.asked_by = asked_by
        found.drives = {str(unit_id): self.silent_units.status(unit_id, now_ns) for unit_id in shown}
        return found

    def writer_conflict(self, axis: str, now_ns: int) -> WriterConflictStatus | None:
        """Return the conflict of another controller with the writer of an axis; None: there is none."""
        return self._ownership.writer_conflicts.status(axis, now_ns)

    @property
    def is_idle(self) -> bool:
        """Whether no transaction is on the wire, and no stop waits that can be sent."""
        waits = self._waiting.has_stops and self.link_state.is_up
        return self._transactions.current is None and not waits

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
        """Take a complete request; it is sent in this call if the line is free.

        ``why_given_up``: its controller gave up before it could be sent. Then it is sent only if it is a
            stop;
        anything else never reaches the drive (W5, M3).
        """
        if self._tap is not None:
            self._tap.request(port, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)
        self._request(port, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)
        self._settle()

    def _request(
        self,
        port: ControllerPort,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        why_given_up: str,
    ) -> None:
        if not len(pdu):
            return
        if port.is_serial and (self._transactions.current is not None or self._waiting.total):
            self._give_up(port, "its controller sent another request", now_ns, is_gone=False)
        if self.link_state.is_stopping:
            return
        transaction = self._transactions.come(port, transaction_id, unit_id, pdu, now_ns)
        if self._odd_units and unit_id in self._odd_units and is_odd_request(pdu):
            transaction.become_odd()
        if port.gate is not None:
            denial = self._admission.denial(transaction, transaction.arrived_ns)
            if denial is not None:
                self._deny(transaction, denial, now_ns)
                return
        if unit_id == self._own_unit_id:
            self._answer_as_own(transaction, why_given_up, now_ns)
            return
        is_motion = port.is_motion
        if is_motion and self._scheduler.gaps.is_watching:
            self._scheduler.motion_came(now_ns)
        is_free = (
            self._transactions.current is None
            and self.rest.until_ns is None
            and not self.silent_units.silences
            and not self._renewal.holds
            and now_ns >= self._link.stamps.next_ns
            # What waited for the silence before a frame goes first, also if its alarm has not come yet.
            and self._waiting.only_others
        )
        if why_given_up and not (
            self.link_state.is_up and self._units.stops_of(self._units.frames_of(transaction))
        ):
            self._transactions.withdraw(transaction, why_given_up, now_ns)
        elif is_free and is_motion and self.link_state.is_up:
            self._start_request(transaction, now_ns)
        else:
            self._judge(transaction, now_ns, is_free=is_free and self.link_state.is_up)

    def _answer_as_own(self, transaction: Transaction, why_given_up: str, now_ns: int) -> None:
        """Answer for the gateway's own unit id, in any state of the line."""
        assert self._own_unit is not None
        self._transactions.go_on(transaction, Outcome.NEVER_SENT)
        if not why_given_up:
            self._transactions.reply(transaction, self._own_unit.answer(transaction.pdu, now_ns), now_ns)

    def _judge(self, transaction: Transaction, now_ns: int, *, is_free: bool) -> None:
        """Start, queue or refuse a request that cannot simply be sent."""
        port = transaction.port
        assert port is not None
        is_allowed, stops = judge(self._units, transaction, is_free=is_free)
        if not is_allowed:
            self._deny(transaction, role_denial(port.plan.role), now_ns)
        elif not self.link_state.is_up and not self._link.connects:
            self._transactions.refuse_absent(transaction, now_ns)
        elif is_free and stops:
            self._start(transaction, now_ns)
        elif stops:
            self._overtake(transaction, stops, now_ns)
        elif self._waiting.is_full(port):
            self._deny(transaction, NO_ROOM, now_ns)
        elif self._is_answered_at_once(transaction, now_ns) and not self._is_behind(port):
            self.silent_units.answer_for(transaction, now_ns)
        elif self.silent_units.is_too_late(transaction, now_ns) and not self._is_behind(port):
            self.silent_units.answer_unasked(transaction, now_ns)
        else:
            self._scheduler.gaps.is_watching |= not transaction.is_motion
            if self.link_state.holds_up:
                transaction.hold_up()
            is_behind = self._waiting.has(port)
            self._waiting.add(transaction)
            # Otherwise nothing has changed for those before it. A stop that waits for a silence precedes
            # none.
            if not is_behind or self._waiting.has_stops:
                self._next(now_ns)

    def _deny(self, transaction: Transaction, denial: Denial, now_ns: int) -> None:
        """Refuse a request behind the answers before it, which keeps their order; in a flood immediately."""
        port = transaction.port
        assert port is not None
        self._admission.report(transaction, denial, now_ns)
        if self._is_behind(port) and not port.is_serial and not self._waiting.is_full(port, 2):
            transaction.deny()
            self._waiting.add(transaction)
        else:
            self._admission.refuse(transaction, denial, now_ns)

    def _overtake(self, stop: Transaction, stops: list[AxisCommand], now_ns: int) -> None:
        """Put a stop at the head of the queue, before everything that it overtakes (M3)."""
        current = self._transactions.current
        if current is not None and current.phase is Phase.LEAVING:
            self._abort(current, ForwardEvent.OVERTAKEN, now_ns)
        self._scheduler.overtake(stop, stops, now_ns)
        if not self.link_state.is_up or self.rest.is_opening:
            stop.hold_up()
        if not self._scheduler.add_stop(stop, now_ns):
            self._transactions.refuse(stop, ExceptionCode.SERVER_DEVICE_BUSY, now_ns, loss=None)
        self._next(now_ns)

    def controller_gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool = False) -> None:
        """Withdraw the waiting requests of a closed connection (W5).

        ``is_broken``: its controller did not close it; ``Ownership.gone`` says what that costs (M1).
        """
        if self._tap is not None:
            self._tap.gone(port, now_ns, is_broken=is_broken)
        if self.forwarding is not None:
            self.forwarding.gone(port, now_ns)
            if self._transactions.current is not None and self._transactions.current.port is port:
                self._end_reply(ForwardEvent.LOST, now_ns)
        self._give_up(port, "its connection closed", now_ns, is_gone=True)
        self._admission.gone(port, now_ns, is_broken=is_broken)
        if is_broken and self._transactions.current is not None and self._transactions.current.port is port:
            self._broken_off = port
        self._settle()

    def _give_up(self, port: ControllerPort, reason: str, now_ns: int, *, is_gone: bool) -> None:
        """Withdraw what a controller has given up on; it gets no reply to the request on the wire (W5)."""
        for transaction in self._waiting.give_up(port, is_gone=is_gone):
            self._transactions.withdraw(transaction, reason, now_ns)
        if self._transactions.current and self._transactions.current.port is port:
            self._end_reply(ForwardEvent.ANEW, now_ns)
            self._transactions.current.give_up()

    def report_standstill(self, gap_ns: int) -> None:
        """Report that the process did not run for a while."""
        detail = f"the relay stood still for {gap_ns / NS_PER_S:.2f} s; what controllers gave up is not sent"
        self._on_event(Event(exchange_events.STOOD_STILL, None, detail))

    def command(
        self, command: Command, now_ns: int, tables: Sequence[CorrectionTable] = ()
    ) -> dict[str, str]:
        """Carry out a command; see ``control.carry_out``. Raises ControlError."""
        if self._tap is not None:
            self._tap.command(command, tables, now_ns)
        current = self._transactions.current
        if isinstance(command, EndDryRun) and current is not None and not current.only_reads:
            raise ControlError(f"axis {command.axes[0]} stays in shadow: {ON_THE_WIRE}")
        for axis in self.axes:
            settle_group(axis, now_ns)
        changed = carry_out(self.axes, command, now_ns, tables)
        if isinstance(command, SetLimits):
            self.meter.take_limits(self.axes)
        elif isinstance(command, EndDryRun):
            self._units.forget_paths()
        self._report(self.axes)
        self._settle()
        return changed

    # --- from the drives -------------------------------------------------------------------------------

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that the link framed for the transaction on the wire."""
        if self._tap is not None:
            self._tap.reply(unit_id, pdu, now_ns)
        self._reply(unit_id, pdu, now_ns)
        self._settle()

    def _reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        transaction = self._transactions.current
        if transaction is None or unit_id != transaction.wire_unit_id or not len(pdu):
            self._stray(now_ns, NO_UNIT_ID)
            return
        if len(pdu) > MAX_PDU:  # it cannot be passed on
            self._transactions.free_wire()
            self._renewal.mark_alive()
            self.counters.oversized += 1
            self._end_unanswered(transaction, now_ns)
            self._end_turn(transaction, now_ns)
            self._next(now_ns)
            return
        if transaction.stopping is Stopping.EARLY and not self._scheduler.is_answer(transaction, pdu):
            self._renewal.mark_alive()
            self.silent_units.disturb(unit_id, now_ns)
            self.silent_units.expect_late_reply(unit_id, transaction.sent_ns + self._response_timeout_ns)
            self._transactions.free_wire()
            self._scheduler.go_again(transaction, now_ns)
            self._report(self._units.axes_of(unit_id))
            self._next(now_ns)
            return
        if self.link_state.closes_soon:
            self.link_state.see_whether_it_closes(transaction, now_ns)
        self.silent_units.answered_ns[unit_id] = now_ns
        if self.silent_units.silences:
            if transaction.stopping is Stopping.AGAIN and self.silent_units.awaits_late_reply_of(unit_id):
                # The same stop was sent twice, and one answer came; it is unknown for which.
                self.silent_units.expect_late_reply(unit_id, transaction.sent_ns + self._response_timeout_ns)
            self._renewal.mark_answered(unit_id)
            self._renewal.mark_alive()
            self.silent_units.mark_alive(unit_id, now_ns)
        path, forwarding = transaction.path, self.forwarding
        if path is None:
            nominal_reply = None
        elif forwarding is None:
            nominal_reply = path.answered(transaction, pdu, now_ns)
        else:
            nominal_reply = forwarding.answered(path, transaction, pdu, now_ns)
        if path is None or nominal_reply is None:
            axes = self._take_reply(transaction, pdu, now_ns)
        else:
            axes = path.axes
            self.counters.exchanges += 1
            self.counters.exceptions += pdu[0] >= EXCEPTION_BIT
            outcome = ACKNOWLEDGED if pdu[0] < EXCEPTION_BIT else EXCEPTION
            self._transactions.go_on(transaction, outcome)
            self._transactions.reply(transaction, nominal_reply, now_ns)
            path.settle(transaction, now_ns)
            self._transactions.free_wire()
            assert transaction.port is not None
            self.meter.add(transaction, transaction.port, pdu, now_ns)
        if forwarding is not None:
            forwarding.add(transaction, pdu, nominal_reply, now_ns)
        if self._scheduler.gaps.is_watching:
            self._end_turn(transaction, now_ns)
        if axes:
            self._report(axes)
        if self._waiting.total or self._renewal.holds:
            self._next(now_ns)

    def _take_reply(self, transaction: Transaction, pdu: bytes, now_ns: int) -> tuple[Axis, ...]:
        """Take a reply on the slow path; return the axes about which it may tell something."""
        axes = self._units.axes_of(transaction.wire_unit_id)
        for axis in axes:
            axis.end_silence(is_answer=True)
        if transaction.added is not None:
            self._transactions.free_wire()
            self._take_added(transaction, pdu, now_ns)
            return axes
        outcome, code = outcome_of_reply(transaction, pdu)
        self._transactions.finish(transaction, outcome, now_ns, code=code, reply=pdu)
        self._transactions.free_wire()
        if self._broken_off is not None:
            self._forget_parts_of(transaction)
        if transaction.port is not None:
            self.meter.add(transaction, transaction.port, pdu, now_ns)
        return axes

    def _take_added(self, transaction: Transaction, pdu: bytes, now_ns: int) -> None:
        """Process the reply to a frame of the gateway, and go on with the request that needed it."""
        frame = transaction.added
        assert frame is not None
        if self._renewal.holds and frame.rendering is None:
            self._renewal.answered(now_ns)
        if transaction.port is None:
            self.counters.added_reads += 1
            prefetched = Prefetched()
            is_again = is_asked_again(frame, pdu, prefetched)
            if not is_again:
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
        elif self.rest.is_closing or self._renewal.holds:  # do not send it into a connection that closes
            self._waiting.put_back(transaction)
        elif self._is_paced(now_ns):
            self._scheduler.put_next(transaction)
        else:
            self._start(transaction, now_ns)

    def _learn(self, transaction: Transaction, frame: AddedFrame, pdu: bytes, now_ns: int) -> int | None:
        """Process the reply to a prerequisite.

        Returns:
            The exception code with which its request is refused; None: the request can go on.
        """
        prefetched = transaction.knowledge()
        rendering = frame.rendering
        if rendering is None:
            self.counters.added_reads += 1
            if frame.purpose is Purpose.POLL:
                transaction.excuse(now_ns - transaction.sent_ns)
            if is_asked_again(frame, pdu, prefetched) and now_ns <= transaction.leave_by_ns:
                return None  # it is read again, if nothing else goes first
            learn(frame, pdu, prefetched, transaction.sent_ns)
            return None
        if frame.is_acknowledged(pdu):
            self.counters.restaged += 1
            acknowledge_rewritten(frame)
            frame.axis.reports.report_rewritten(self.counters.restaged, now_ns)
            return None
        code = pdu[1] if len(pdu) == 2 and is_exception(pdu) else ExceptionCode.SERVER_DEVICE_FAILURE
        why = "the drive refused the staged target when it was rewritten"
        frame.axis.lose_rewritten(rendering, code, why)
        return code

    def stray(self, now_ns: int, *, unit_id: int = -1) -> None:
        """Record bytes from the drives that answer nothing; a resting line must fall silent first (W6).

        A complete unexpected frame means that a drive answers late or twice. The next reply may then belong
        to another
        request: a serial line is left alone until it is silent.
        """
        if self._tap is not None:
            self._tap.stray(now_ns, unit_id)
        self._stray(now_ns, unit_id)
        self._settle()

    def _stray(self, now_ns: int, unit_id: int) -> None:
        self.counters.late += 1
        self._renewal.mark_alive()
        if self._transactions.current is not None and self._transactions.current.phase is Phase.LEAVING:
            self._abort(self._transactions.current, ForwardEvent.MET, now_ns)
        is_awaited = self.silent_units.disturb(unit_id, now_ns)
        if self.rest.is_draining:
            self.rest.disturb(now_ns)
        elif unit_id >= 0 and self._link.is_serial and self._transactions.current is None and not is_awaited:
            self.rest.drain(now_ns)
            detail = f"a frame that answers nothing: waiting for {self.rest.drain_ms:g} ms of silence"
            self._on_event(Event(exchange_events.LATE_REPLY, None, detail))
        if unit_id >= 0 and self.silent_units.silences:
            self.silent_units.mark_alive(unit_id, now_ns)
        if is_awaited and self._transactions.current is None:
            self._next(now_ns)

    def unframed(self, now_ns: int) -> None:
        """Record bytes of the drives that form no frame yet: the connection is alive."""
        if self._tap is not None:
            self._tap.unframed(now_ns)
        self._renewal.mark_alive()

    def link_up(self, now_ns: int) -> None:
        """The drives can be reached; :data:`~.link_loss.LINK_LOSS` says what that means."""
        if self._tap is not None:
            self._tap.link_up(now_ns)
        if not self.link_state.is_up:
            self.link_state.come_up(now_ns)
            self._next(now_ns)
        self._settle()

    def link_down(self, now_ns: int, reason: str = "", *, is_orderly: bool = False) -> None:
        """The drives cannot be reached: requests wait for nothing but a connection.

        ``reason``: why, if known. ``is_orderly``: the other end closed it, and nothing broke.
        """
        if self._tap is not None:
            self._tap.link_down(now_ns, reason, is_orderly=is_orderly)
        if self.link_state.is_up:
            self._link_down(now_ns, reason, is_orderly=is_orderly)
        self._settle()

    def _link_down(self, now_ns: int, reason: str, *, is_orderly: bool) -> None:
        current = self._transactions.free_wire()
        self.link_state.end(current, reason, now_ns, is_orderly=is_orderly)
        if current is not None and current.phase is Phase.LEAVING:
            self._abort(current, ForwardEvent.LOST, now_ns)
            self._transactions.never_left(current, now_ns)
        elif current is not None and self._may_begin_anew(current):
            self._transactions.go_on(current, Step.ANSWERED)
            current.begin_anew()
            self._waiting.put_back(current)
        elif current is not None:
            self._end_reply(ForwardEvent.GONE, now_ns)
            self._end_unanswered(current, now_ns)
        self._scheduler.forget_next()
        self._hold_up_waiting(now_ns)
        self._report(self.axes)

    # --- what waits for the next link ------------------------------------------------------------------

    def _may_begin_anew(self, transaction: Transaction) -> bool:
        """Whether only a read of the gateway was on the wire, for a request that continues to wait."""
        frame = transaction.added
        is_read = transaction.phase is Phase.PREREQUISITE and frame is not None and frame.rendering is None
        return is_read and self._link.connects and not self.link_state.is_stopping

    def _hold_up_waiting(self, now_ns: int) -> None:
        """Let waiting requests wait for the next connection; if there will be none, refuse them."""
        for transaction in self._waiting.withdraw(lambda each: each.port is None or not self._link.connects):
            self._transactions.refuse_absent(transaction, now_ns)
        is_lost = bool(self.link_state.lost)
        for transaction in self._waiting:
            transaction.hold_up()
            if is_lost and transaction.prefetched is not None:
                transaction.begin_anew()
        self._next(now_ns)

    def _wait_for_link(self, now_ns: int) -> int:
        """Answer what has waited too long for the link; return the next such time."""
        until_ns = NO_DEADLINE_NS
        for transaction in tuple(self._waiting):
            if transaction.port is None or (self.link_state.is_up and not transaction.is_held_up):
                continue
            due_ns = transaction.waits_until_ns
            if due_ns > now_ns:
                until_ns = min(until_ns, due_ns)
                continue
            self._waiting.take(transaction)
            if transaction.is_denied or transaction.overtaken_by:
                self._start(transaction, now_ns)
            else:
                self._transactions.refuse_absent(transaction, now_ns)
        if not self.link_state.is_up and self._waiting.total:
            self._link.want()
            until_ns = min(until_ns, now_ns + DEMAND_EVERY_NS)
        return until_ns

    def _has_waited_too_long(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether a held-up write or stop would be sent too late."""
        is_late = transaction.is_held_up and now_ns >= transaction.waits_until_ns
        return is_late and not transaction.only_reads

    # --- time ------------------------------------------------------------------------------------------

    def rest_first(self, now_ns: int) -> None:
        """Begin with a silence: the drives may still answer earlier requests (W6)."""
        if self._tap is not None:
            self._tap.rest_first(now_ns)
        self.rest.expect_late_reply()

    def _settle(self) -> None:
        """Set the alarm to the deadline of the line, which may have changed."""
        if self.alarm is not None:
            self.alarm.arm(self.deadline_ns)

    def tick(self, now_ns: int) -> None:
        """Do what is due."""
        deadline_ns = self.deadline_ns
        if deadline_ns is not None and now_ns >= deadline_ns:
            if self._tap is not None:
                self._tap.timer(now_ns)
            self._tick(now_ns)
        self._settle()

    def _tick(self, now_ns: int) -> None:
        is_timed_out = self._transactions.current is not None
        if self._transactions.current is not None:
            self._time_out(self._transactions.current, now_ns)
        # A request that comes when a silence ends must see that there was one.
        if self.link_state.is_up and self.silent_units.awaits_late_reply:
            self.silent_units.answer_waiting(now_ns)
        # Only here: a late caller has read by then what had come in (W6).
        rests_until_ns = self.rest.until_ns
        if self.rest.is_closing and rests_until_ns is not None and now_ns >= rests_until_ns:
            self.link_state.stayed()
        self.rest.settle(now_ns)
        self.silent_units.settle(now_ns)
        if self._renewal.holds and self.link_state.is_up and self._renewal.settle(now_ns):
            self._scheduler.release_stops()
        self.link_state.watch(now_ns)
        if is_timed_out and self.link_state.is_up and self._link.connects and self.link_state.renews(now_ns):
            self._hold_up_waiting(now_ns)
        self._next(now_ns)

    def stop(self, now_ns: int) -> None:
        """Send nothing new but waiting stops; the transaction on the wire ends as usual (:attr:`is_idle`)."""
        if self._tap is not None:
            self._tap.stop(now_ns)
        self.link_state.stop()
        for transaction in self._waiting.withdraw(lambda each: not each.is_stop):
            self._transactions.withdraw(transaction, "the gateway stops", now_ns)

    # --- sending ---------------------------------------------------------------------------------------

    def _next(self, now_ns: int) -> None:
        """Start what waits, as long as the line is free."""
        scheduler = self._scheduler
        scheduler.waits_until_ns = None
        if self.link_state.holds_up:
            scheduler.wake_at(self._wait_for_link(now_ns))
            if not self.link_state.is_up:
                return
        while self._waiting.total and self._transactions.current is None:
            if self._is_paced(now_ns):
                scheduler.gaps.wait_for_silence()
                self._withdraw_given_up(now_ns)
                return
            chosen = scheduler.next(now_ns)
            if chosen is None:
                break
            self._start(chosen, now_ns)
        if not self._renewal.holds or self._transactions.current is not None or self._is_paced(now_ns):
            return
        if self.rest.until_ns is None:
            read = scheduler.held_read(now_ns)
            if read is not None:
                self._put_on_wire(read, read.pdu, read.unit_id, now_ns)

    def _is_paced(self, now_ns: int) -> bool:
        """Whether nothing may be sent yet, because the wire needs a silence; then the line wakes behind it.

        What waits can still be withdrawn, and bytes that come meanwhile answer nothing (W5, W6).
        """
        until_ns = self._link.stamps.next_ns
        if now_ns >= until_ns:
            return False
        if self._tap is not None:
            self._tap.paced(until_ns)
        self._scheduler.wake_at(until_ns)
        return True

    def _withdraw_given_up(self, now_ns: int) -> None:
        """Withdraw what its controller has given up: a wire with noise on it may never be silent (W5)."""
        for transaction in tuple(self._waiting):
            reason = transaction.why_given_up(now_ns)
            if reason:
                self._waiting.take(transaction)
                self._transactions.withdraw(transaction, reason, now_ns)

    def _end_turn(self, transaction: Transaction, now_ns: int, rests_until_ns: int | None = None) -> None:
        """Tell the gaps that a transaction has ended; they begin when the wire is free."""
        if self._tap is not None and rests_until_ns is None and self._link.stamps.next_ns > now_ns:
            self._tap.paced(self._link.stamps.next_ns)
        self._scheduler.gaps.ended(transaction, now_ns, rests_until_ns)

    def _is_answered_at_once(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether the gateway answers an arriving request itself; not if the next link polls dead drives."""
        return not self.link_state.asks_again and self.silent_units.is_answered_for(transaction, now_ns)

    def _is_behind(self, port: ControllerPort) -> bool:
        """Whether a controller must get another answer first."""
        return (
            self._transactions.current is not None and self._transactions.current.port is port
        ) or self._waiting.has(port)

    def _start(self, transaction: Transaction, now_ns: int) -> None:
        """Send a transaction or its prerequisite; or withdraw or refuse it."""
        transaction.start(now_ns)
        is_stopping = self.link_state.is_stopping and not transaction.is_stop
        reason = "the gateway stops" if is_stopping else transaction.why_given_up(now_ns)
        if reason:
            self._transactions.withdraw(transaction, reason, now_ns)
        elif transaction.is_denied:
            self._admission.refuse(transaction, self._admission.denial_of_waiting(transaction), now_ns)
        elif transaction.overtaken_by:
            self._transactions.overtaken(transaction, transaction.overtaken_by, now_ns)
        elif transaction.is_held_up and self._has_waited_too_long(transaction, now_ns):
            self._transactions.refuse_absent(transaction, now_ns)
        elif transaction.port is None and self.silent_units.is_answered_for(transaction, now_ns):
            self._transactions.finish(transaction, Outcome.NEVER_SENT, now_ns)
        elif transaction.port is None:
            self._put_on_wire(transaction, transaction.pdu, transaction.unit_id, now_ns)
        else:
            self._start_request(transaction, now_ns)

    def _start_request(self, transaction: Transaction, now_ns: int) -> None:
        if self.silent_units.silences and not transaction.is_stop:
            dead = self.silent_units.dead(transaction.unit_id)
            if dead is not None:
                if not self.silent_units.tries(transaction, dead, now_ns):
                    return
                if transaction.added is not None:
                    self._put_on_wire(transaction, transaction.added.pdu, dead.unit_id, now_ns)
                    return
        if transaction.prefetched is None and not self._deadlines.may_be_late(transaction, now_ns):
            path = self._units.path_of(transaction.unit_id, transaction.pdu)
            sent_pdu = None if path is None else path.sent(transaction, now_ns)
            if path is not None and sent_pdu is not None:
                transaction.take(path)
                self._put_on_wire(transaction, sent_pdu, transaction.unit_id, now_ns)
                if transaction.target is not None:
                    path.left(transaction)
                return
        if transaction.unit_id not in self._units and self._units.aliases.is_unknown(transaction.unit_id):
            self._count_unknown_unit(transaction.unit_id)
            if transaction.port is not None:
                self.silent_units.askers.add((transaction.port.plan.name, transaction.unit_id))
        if not self._ownership.may_move(transaction, now_ns):
            self._transactions.refuse(transaction, ExceptionCode.SERVER_DEVICE_BUSY, now_ns)
            return
        for axis in self._units.axes_of(transaction.unit_id):
            axis.end_silence(is_answer=False)
        try:
            self._deadlines.check(transaction, now_ns)
            added, pdu = self._units.next_to_send(transaction, now_ns)
        except RefusedRequestError as refusal:
            self._report_refusal(refusal, now_ns)
            loss = Loss.TOO_EARLY if refusal.is_too_early else Loss.DENIED
            self._transactions.refuse(transaction, refusal.code, now_ns, loss=loss)
            return
        transaction.need(added)
        if added is not None:
            self._put_on_wire(transaction, added.pdu, added.axis.plan.unit_id, now_ns)
            return
        for request in transaction.requests:
            self.counters.unknown_modes += leave(request, now_ns)
        self._put_on_wire(transaction, pdu, transaction.unit_id, now_ns)
        self._ownership.moved(transaction, now_ns)

    def _report_refusal(self, refusal: RefusedRequestError, now_ns: int) -> None:
        """Report why a request was refused, and how many like it there were."""
        count = self._refusals.due((refusal.kind.name, refusal.axis), now_ns)
        if count:
            self._on_event(Event(refusal.kind, refusal.axis or None, refusal.reason + times(count)))

    def _count_unknown_unit(self, unit_id: int) -> None:
        """Count a request to an unknown unit id, and report the first one."""
        if self._units.aliases.count_request(unit_id):
            mapped = ", ".join(f"{axis.plan.name} (unit id {axis.plan.unit_id})" for axis in self.axes)
            detail = f"a controller addresses unit id {unit_id}, which has no axis; the axes are {mapped}"
            self._on_event(Event(exchange_events.UNKNOWN_UNIT, None, detail))

    def _put_on_wire(self, transaction: Transaction, pdu: bytes, unit_id: int, now_ns: int) -> None:
        """Send a frame: the request itself, or one of the gateway."""
        patience_ns = self._response_timeout_ns
        port = transaction.port
        if self.silent_units.silences:
            patience_ns = self.silent_units.patience_ns(transaction, unit_id, now_ns, patience_ns)
        elif port is not None and port.patience_ns > patience_ns and transaction.added is None:
            patience_ns = port.patience_ns
        if port is not None and self.silent_units.silences and not transaction.is_stop:
            self.silent_units.note_served(id(port))
        if transaction.is_stop and self._scheduler.is_early(transaction, now_ns):
            self._transactions.stop_goes_on(transaction, StopEvent.LEAVES_EARLY)
        if self._renewal.holds and transaction.is_stop:
            self._scheduler.add_early_stop(transaction)
        is_broadcast = unit_id == BROADCAST_UNIT_ID and self._link.is_serial
        if self.forwarding is not None and not is_broadcast:
            self.forwarding.expect(transaction)
        step = FRAME if port is None or transaction.added is None else ADDED_FRAME
        has_left = self._transactions.send(transaction, step, unit_id, pdu, now_ns, patience_ns=patience_ns)
        if is_broadcast and has_left:
            self._end_broadcast(transaction, now_ns)

    # --- requests under cut-through --------------------------------------------------------------------

    def _end_reply(self, why: ForwardEvent, now_ns: int) -> None:
        """Send no more of the reply that is being forwarded."""
        if self.forwarding is not None:
            self.forwarding.end_reply(why, now_ns)

    def _abort(self, transaction: Transaction, why: ForwardEvent, now_ns: int) -> None:
        """Send no more of the request that is being forwarded."""
        assert self.forwarding is not None
        self.forwarding.end_request(transaction, why, now_ns)

    def _end_broadcast(self, transaction: Transaction, now_ns: int) -> None:
        """Give the drives time to execute a broadcast, which none of them answers."""
        self.counters.broadcasts += 1
        self.rest.begin_turnaround(now_ns)
        self._end_turn(transaction, now_ns, self.rest.until_ns)
        if transaction.stopping is Stopping.EARLY:
            self._scheduler.wait_again(transaction)
        self._transactions.finish(transaction, Outcome.BROADCAST, now_ns)
        self._report(self.axes)

    def _report(self, axes: tuple[Axis, ...]) -> None:
        """Report what is new about these axes; a group is referenced as a whole, or not at all."""
        for axis in axes:
            if axis.peers:
                axis.follow_group()
                for peer in axis.peers:
                    self._report_one(peer)
            self._report_one(axis)

    def _report_one(self, axis: Axis) -> None:
        for event in axis.take_events():
            self.counters.internal_faults += event.kind is exchange_events.INTERNAL_FAULT
            self._on_event(event)

    # --- endings ---------------------------------------------------------------------------------------

    def _lose(self, transaction: Transaction, code: int, loss: Loss) -> None:
        """Record that a request never reached its drive (M3); a sender that may not write loses nothing."""
        if transaction.is_denied and not transaction.is_motion:
            return
        self._ownership.lose(transaction, code, loss)
        self._report(self._units.axes_of(transaction.unit_id))

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

    def _time_out(self, transaction: Transaction, now_ns: int) -> None:
        if self._tap is not None:
            self._tap.abandoned()
        self._link.abandon()
        self._end_reply(ForwardEvent.STALLED, now_ns)
        self._transactions.free_wire()
        self.counters.timeouts += 1
        unit_id = transaction.wire_unit_id
        if transaction.port is not None:
            self.silent_units.askers.add((transaction.port.plan.name, unit_id))
        if self._link.connects:
            frame = transaction.added
            is_read = transaction.only_reads if frame is None else frame.rendering is None
            self._renewal.miss(unit_id, transaction.sent_ns, is_read=is_read)
        silence, has_died = self.silent_units.miss(unit_id, transaction.sent_ns, now_ns)
        if silence.timeouts == 1:
            self._on_event(Event(exchange_events.DRIVE_SILENT, None, self._unanswered_by(unit_id)))
        if self._units.have_rules and self._units.stops_of(self._units.frames_of(transaction)):
            others = {id(each.port) for each in self._waiting if each.port not in (None, transaction.port)}
            self.silent_units.miss_stop(unit_id, transaction.pdu, others, now_ns)
            self.silent_units.thin_out(transaction, now_ns)
        if transaction.stopping is Stopping.EARLY:
            self._scheduler.go_again(transaction, now_ns)
        else:
            self._end_unanswered(transaction, now_ns)
        axes = self._units.axes_of(unit_id)
        for axis in axes:
            axis.fall_silent(transaction.sent_ns, now_ns)
        self._report(axes)
        if has_died and self.silent_units.backs_off:
            self._on_event(Event(exchange_events.DRIVE_BACKED_OFF, None, self._unanswered_by(unit_id)))
            self.silent_units.answer_waiting(now_ns)
        self._end_turn(transaction, now_ns, silence.quiet_ns or None)
