"""One line: what it does with each request, each reply and each deadline. Sans-IO; time is an argument.

States of the line:

- *down*: there is no link to the drives. If one can be made, requests wait for it for a limited time.
  Otherwise they are answered 0x0A (serial controllers: silence).
- *free*: the next request is sent in the same call in which it arrives.
- *busy*: one transaction is on the wire (W6). Others wait, with stops before all others (M3).
- *resting*: only stops are sent until a certain time. It is the silence after an unexpected frame (W6), or
  the turnaround after a broadcast, in which stops wait too.
- *paced*: nothing is sent until the wire has been silent long enough for a frame (``Stamps.next_ns``).

The other decisions have files of their own (``line_context`` joins them):

- ``scheduler``: which request is next;
- ``turn``: what becomes of a request whose turn it is;
- ``transaction``: whether a frame is sent, and how its request ends;
- ``drive_side``: what a reply, an unexpected frame or no reply means;
- ``silent_units``: which units are silent, and what the gateway answers for them;
- ``link_state``: what the end of the link means.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from gateway.catalogue import exchange_events
from gateway.compensation.table import CorrectionTable
from gateway.compiled import mypyc_attr
from gateway.exchange.admission import NO_ROOM, judge, role_denial
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.commands import Command, EndDryRun, SetLimits
from gateway.exchange.control import ControlError, carry_out
from gateway.exchange.cut_through.forward import Forwarding, SerialTiming
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.cut_through.line import ForwardingLine
from gateway.exchange.decode import AxisCommand
from gateway.exchange.dispatch import REMEMBERED_PATHS
from gateway.exchange.drive_side import NO_UNIT_ID, DriveSide
from gateway.exchange.events import Event
from gateway.exchange.gate import Denial
from gateway.exchange.group import settle_group
from gateway.exchange.line_context import LineContext
from gateway.exchange.plan import NO_OTHER_UNITS, AxisPlan, LineTiming, OtherUnits
from gateway.exchange.ports import Alarm, ControllerPort, DriveLink, OwnUnit
from gateway.exchange.tap import Tap
from gateway.exchange.transaction import Phase, Transaction
from gateway.exchange.turn import Turn
from gateway.modbus.lengths import is_odd_request
from gateway.modbus.pdu import BROADCAST_UNIT_ID, ExceptionCode
from gateway.status.axis import WriterConflictStatus
from gateway.status.line import UnitIds
from gateway.times import NEVER_NS, NS_PER_MS, NS_PER_S

ON_THE_WIRE: Final = "a request that may move it is on the wire; let it arrive at a target, and reload again"


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
        context = LineContext(
            axes,
            timing,
            link,
            on_event,
            groups,
            remembered_paths=remembered_paths,
            other_units=other_units,
            what_ran=what_ran,
            tap=tap,
        )
        self._tap = tap
        self.alarm: Alarm | None = None
        """Set to the deadline after each call; None: the owner of the line polls :attr:`deadline_ns`."""
        self.axes = context.axes
        self.counters = context.counters
        self.rest = context.rest
        self.silent_units = context.silent_units
        self.link_state = context.link_state
        self.meter = context.meter
        self._units = context.units
        self._link = link
        self._odd_units = other_units.odd
        self._own_unit = own_unit
        self._own_unit_id = NO_UNIT_ID if own_unit is None else own_unit.unit_id
        self._on_event = on_event
        self._ownership = context.ownership
        self._transactions = context.transactions
        self._admission = context.admission
        self._waiting = context.waiting
        self._renewal = context.renewal
        self._scheduler = context.scheduler
        self._context = context
        self._turn = Turn(context)
        self._drives = DriveSide(context, self._turn)
        self.forwarding: Forwarding | None = None
        """Only on a line with cut-through; ``cut_through`` is the wire of its drives."""
        if cut_through is not None:
            self.forwarding = self._turn.forwarding = Forwarding(
                ForwardingLine(context, go_on=self._turn.next),
                link,
                self._units,
                cut_through,
                gap_ns=int(timing.gap_ms * NS_PER_MS),
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
            if due_ns < NEVER_NS and (waits_until_ns is None or due_ns < waits_until_ns):
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
        stop; anything else never reaches the drive (W5, M3).
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
        transaction = self._transactions.come(port, transaction_id, unit_id, pdu, now_ns)
        if self.link_state.is_stopping and not self._stops(transaction):
            return
        if self._odd_units and unit_id in self._odd_units and is_odd_request(pdu):
            transaction.is_odd = True
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
            # What waits for the silence before a frame is sent first, even if its timer has not expired yet.
            and self._waiting.only_others
        )
        is_reachable = self.link_state.is_up or self._link.connects
        if why_given_up and not (is_reachable and self._stops(transaction)):
            self._transactions.withdraw(transaction, why_given_up, now_ns)
        elif is_free and is_motion and self.link_state.is_up:
            self._turn.start_request(transaction, now_ns)
        else:
            self._judge(transaction, now_ns, is_free=is_free and self.link_state.is_up)

    def _stops(self, transaction: Transaction) -> bool:
        """Whether a request stops an axis: a stop is sent also after a give-up, or while the gateway ends."""
        return bool(self._units.stops_of(self._units.frames_of(transaction)))

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
        elif is_free and stops and not self.link_state.is_stopping:
            self._turn.start(transaction, now_ns)
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
                transaction.is_held_up = True
            is_behind = self._waiting.has(port)
            self._waiting.add(transaction)
            # A request behind another one of its controller changes nothing for those that wait. But a stop
            # that waits for a silence holds up nothing behind it.
            if not is_behind or self._waiting.has_stops:
                self._turn.next(now_ns)

    def _is_answered_at_once(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether the gateway answers a request itself; not if the next link polls dead drives again."""
        return not self.link_state.asks_again and self.silent_units.is_answered_for(transaction, now_ns)

    def _is_behind(self, port: ControllerPort) -> bool:
        """Whether a controller must get another answer first."""
        return (
            self._transactions.current is not None and self._transactions.current.port is port
        ) or self._waiting.has(port)

    def _deny(self, transaction: Transaction, denial: Denial, now_ns: int) -> None:
        """Refuse a request after the answers to earlier ones, to keep their order; in a flood immediately."""
        port = transaction.port
        assert port is not None
        self._admission.report(transaction, denial, now_ns)
        if self._is_behind(port) and not port.is_serial and not self._waiting.is_full(port, 2):
            transaction.is_denied = True
            self._waiting.add(transaction)
        else:
            self._admission.refuse(transaction, denial, now_ns)

    def _overtake(self, stop: Transaction, stops: list[AxisCommand], now_ns: int) -> None:
        """Put a stop at the head of the queue, before everything that it overtakes (M3)."""
        current = self._transactions.current
        if current is not None and current.phase is Phase.LEAVING:
            self._turn.abort(current, ForwardEvent.OVERTAKEN, now_ns)
        self._scheduler.overtake(stop, stops, now_ns)
        if not self.link_state.is_up or self.rest.is_opening:
            stop.is_held_up = True
        if not self._scheduler.add_stop(stop, now_ns):
            self._transactions.refuse(stop, ExceptionCode.SERVER_DEVICE_BUSY, now_ns, loss=None)
        self._turn.next(now_ns)

    def controller_gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool = False) -> None:
        """Withdraw the waiting requests of a closed connection (W5).

        ``is_broken``: its controller did not close it; ``Ownership.gone`` says what that costs (M1).
        """
        if self._tap is not None:
            self._tap.gone(port, now_ns, is_broken=is_broken)
        if self.forwarding is not None:
            self.forwarding.gone(port, now_ns)
            if self._transactions.current is not None and self._transactions.current.port is port:
                self._drives.end_reply(ForwardEvent.LOST, now_ns)
        self._give_up(port, "its connection closed", now_ns, is_gone=True)
        self._admission.gone(port, now_ns, is_broken=is_broken)
        if is_broken:
            self._drives.break_off(port)
        self._settle()

    def _give_up(self, port: ControllerPort, reason: str, now_ns: int, *, is_gone: bool) -> None:
        """Withdraw what a controller has given up; it gets no reply to its request on the wire (W5)."""
        for transaction in self._waiting.give_up(port, is_gone=is_gone):
            self._transactions.withdraw(transaction, reason, now_ns)
        current = self._transactions.current
        if current is not None and current.port is port:
            self._drives.end_reply(ForwardEvent.ANEW, now_ns)
            if is_gone or not current.is_broadcast:  # it may still need a frame first
                current.give_up()

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
        self._context.report(self.axes)
        self._settle()
        return changed

    # --- from the drives -------------------------------------------------------------------------------

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that the link framed for the transaction on the wire."""
        if self._tap is not None:
            self._tap.reply(unit_id, pdu, now_ns)
        self._drives.reply(unit_id, pdu, now_ns)
        self._settle()

    def stray(self, now_ns: int, *, unit_id: int = NO_UNIT_ID) -> None:
        """Record bytes from the drives that answer nothing; a resting line must fall silent first (W6).

        A complete unexpected frame means that a drive answers late or twice. The next reply may then belong
        to another request: a serial line is left alone until it is silent.
        """
        if self._tap is not None:
            self._tap.stray(now_ns, unit_id)
        self._drives.stray(now_ns, unit_id)
        self._settle()

    def unframed(self, now_ns: int) -> None:
        """Record bytes of the drives that form no frame yet: the connection is alive."""
        if self._tap is not None:
            self._tap.unframed(now_ns)
        self._renewal.mark_alive()

    def link_up(self, now_ns: int) -> None:
        """The drives can be reached."""
        if self._tap is not None:
            self._tap.link_up(now_ns)
        if not self.link_state.is_up:
            self.link_state.come_up(now_ns)
            self._turn.next(now_ns)
        self._settle()

    def link_down(self, now_ns: int, reason: str = "", *, is_orderly: bool = False) -> None:
        """The drives cannot be reached: requests wait only for a connection, not for a serial port.

        ``reason``: why, if known. ``is_orderly``: the other end closed it, and nothing broke.
        """
        if self._tap is not None:
            self._tap.link_down(now_ns, reason, is_orderly=is_orderly)
        if self.link_state.is_up:
            self._drives.link_down(now_ns, reason, is_orderly=is_orderly)
        self._settle()

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
            self._drives.time_out(self._transactions.current, now_ns)
        # A request that arrives when a silence ends must still see that silence.
        if self.link_state.is_up and self.silent_units.awaits_late_reply:
            self.silent_units.answer_waiting(now_ns)
        # Rests end only here: a caller that is late has read before what had come in (W6).
        rests_until_ns = self.rest.until_ns
        if self.rest.is_closing and rests_until_ns is not None and now_ns >= rests_until_ns:
            self.link_state.stayed()
        self.rest.settle(now_ns)
        self.silent_units.settle(now_ns)
        if self._renewal.holds and self.link_state.is_up and self._renewal.settle(now_ns):
            self._scheduler.release_stops()
        self.link_state.watch(now_ns)
        if is_timed_out and self.link_state.is_up and self._link.connects and self.link_state.renews(now_ns):
            self._turn.hold_up_waiting(now_ns)
        self._turn.next(now_ns)

    def stop(self, now_ns: int) -> None:
        """Send nothing new but waiting stops; the transaction on the wire ends as usual (:attr:`is_idle`)."""
        if self._tap is not None:
            self._tap.stop(now_ns)
        self.link_state.stop()
        for transaction in self._waiting.withdraw(lambda each: not each.is_stop):
            self._transactions.withdraw(transaction, "the gateway stops", now_ns)
