"""The turn of a request: it is sent, or first a frame that it needs, or it is withdrawn or refused.

``scheduler`` decides whose turn it is. No turn begins while the wire needs a silence (``Stamps.next_ns``).
"""

from typing import Final

from gateway.catalogue import exchange_events
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.registers import Loss
from gateway.exchange.cut_through.forward import Forwarding
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.effects import leave
from gateway.exchange.events import Event
from gateway.exchange.line_context import LineContext
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.transaction import Step, StopEvent, Stopping, Transaction
from gateway.limits import Reports, others_of_pairs, times
from gateway.modbus.lengths import MAX_ADU
from gateway.modbus.pdu import BROADCAST_UNIT_ID, ExceptionCode
from gateway.times import NEVER_NS, NS_PER_MS, NS_PER_S

FRAME: Final = Step.FRAME
ADDED_FRAME: Final = Step.ADDED_FRAME
DEMAND_EVERY_NS: Final = 100 * NS_PER_MS
"""Minimum time between demands for a connection while something waits for it."""
NOISE_NS: Final = 100 * NS_PER_MS
"""A wire that has not been silent for this time and two longest frames has noise on it."""
REFUSALS_REPORTED: Final = 10
"""Number of refusals of one kind and axis that are reported in a second; the others are only counted."""


class Turn:
    """Begins the turns of the requests of one line."""

    def __init__(self, context: LineContext) -> None:
        self._context = context
        self._axes = context.axes
        self._counters = context.counters
        self._units = context.units
        self._link = context.link
        self._on_event = context.on_event
        self._ownership = context.ownership
        self._transactions = context.transactions
        self._admission = context.admission
        self._rest = context.rest
        self._waiting = context.waiting
        self._renewal = context.renewal
        self._silent_units = context.silent_units
        self._link_state = context.link_state
        self._scheduler = context.scheduler
        self._deadlines = context.deadlines
        self._tap = context.tap
        self._response_timeout_ns = context.response_timeout_ns
        self._noise_ns = max(NOISE_NS, int(3.0 * context.gap_ms * NS_PER_MS))
        self._paced_since_ns = 0
        """Since when something waits for a silence of the wire; 0: nothing does."""
        self._paced_at_ns = 0
        """When that was checked last."""
        self.forwarding: Forwarding | None = None
        """Only on a line with cut-through, and set by it."""
        self._refusals: Reports[tuple[str, str]] = Reports(
            NS_PER_S, REFUSALS_REPORTED, others=others_of_pairs
        )

    def next(self, now_ns: int) -> None:
        """Start what waits, as long as the line is free."""
        scheduler = self._scheduler
        scheduler.waits_until_ns = None
        if self._link_state.holds_up:
            scheduler.wake_at(self._wait_for_link(now_ns))
            if not self._link_state.is_up:
                return
        while self._waiting.total and self._transactions.current is None:
            if self.is_paced(now_ns):
                scheduler.gaps.wait_for_silence()
                has_noise = self._has_noise(now_ns)
                self._withdraw_given_up(now_ns, has_noise=has_noise)
                stop = scheduler.due_stop(now_ns) if has_noise else None
                if stop is None:
                    return
                self._waiting.take(stop)
                self.start(stop, now_ns)
                continue
            self._paced_since_ns = 0
            chosen = scheduler.next(now_ns)
            if chosen is None:
                break
            self.start(chosen, now_ns)
        if not self._renewal.holds or self._transactions.current is not None or self.is_paced(now_ns):
            return
        if self._rest.until_ns is None:
            read = scheduler.held_read(now_ns)
            if read is not None:
                self.put_on_wire(read, read.pdu, read.unit_id, now_ns)

    def is_paced(self, now_ns: int) -> bool:
        """Whether nothing may be sent yet, because the wire needs a silence; the line wakes when it is over.

        Until then waiting requests can still be withdrawn, and bytes that come answer nothing (W5, W6).
        """
        until_ns = self._link.stamps.next_ns
        if now_ns >= until_ns:
            return False
        if self._tap is not None:
            self._tap.paced(until_ns)
        self._scheduler.wake_at(until_ns)
        return True

    def _has_noise(self, now_ns: int) -> bool:
        """Whether the wire was not silent for so long that no frames can be the reason.

        A stop still reaches its drive: while the gateway sends, its driver overrides the noise of an idle
        pair.
        """
        if not self._paced_since_ns or now_ns - self._paced_at_ns > self._noise_ns:
            self._paced_since_ns = now_ns
        self._paced_at_ns = now_ns
        # Behind a serial server the speed of the wire is unknown.
        frames_ns = 2 * MAX_ADU * self._link.stamps.wire_ns_per_byte or int(self._rest.drain_ms * NS_PER_MS)
        return now_ns - self._paced_since_ns > self._noise_ns + frames_ns

    def _withdraw_given_up(self, now_ns: int, *, has_noise: bool) -> None:
        """Withdraw what its controller has given up: a wire with noise on it may never be silent (W5)."""
        for transaction in tuple(self._waiting):
            reason = transaction.why_given_up(now_ns)
            if reason and has_noise:
                reason += ", and the drives' wire was never silent: noise? Check bias and termination"
            if reason:
                self._waiting.take(transaction)
                self._transactions.withdraw(transaction, reason, now_ns)

    def end(self, transaction: Transaction, now_ns: int, rests_until_ns: int | None = None) -> None:
        """Tell the gaps that a transaction has ended; a gap begins when the wire is free."""
        if self._tap is not None and rests_until_ns is None and self._link.stamps.next_ns > now_ns:
            self._tap.paced(self._link.stamps.next_ns)
        self._scheduler.gaps.ended(transaction, now_ns, rests_until_ns)

    def start(self, transaction: Transaction, now_ns: int) -> None:
        """Send a transaction or its prerequisite; or withdraw or refuse it."""
        transaction.start(now_ns)
        is_stopping = self._link_state.is_stopping and not transaction.is_stop
        reason = "the gateway stops" if is_stopping else transaction.why_given_up(now_ns)
        if reason:
            self._transactions.withdraw(transaction, reason, now_ns)
        elif transaction.is_denied:
            self._admission.refuse(transaction, self._admission.denial_of_waiting(transaction), now_ns)
        elif transaction.overtaken_by:
            self._transactions.overtaken(transaction, transaction.overtaken_by, now_ns)
        elif transaction.is_held_up and self._has_waited_too_long(transaction, now_ns):
            self._transactions.refuse_absent(transaction, now_ns)
        elif transaction.port is None and self._silent_units.is_answered_for(transaction, now_ns):
            self._transactions.finish(transaction, Outcome.NEVER_SENT, now_ns)
        elif transaction.port is None:
            self.put_on_wire(transaction, transaction.pdu, transaction.unit_id, now_ns)
        else:
            self.start_request(transaction, now_ns)

    def start_request(self, transaction: Transaction, now_ns: int) -> None:
        """Send a request of a controller or its prerequisite; or refuse it."""
        if self._silent_units.silences and not transaction.is_stop:
            dead = self._silent_units.dead(transaction.unit_id)
            if dead is not None:
                if not self._silent_units.tries(transaction, dead, now_ns):
                    return
                if transaction.added is not None:
                    self.put_on_wire(transaction, transaction.added.pdu, dead.unit_id, now_ns)
                    return
        may_be_late = self._deadlines.may_be_late(transaction, now_ns)
        if transaction.prefetched is None and not may_be_late:
            path = self._units.path_of(transaction.unit_id, transaction.pdu)
            sent_pdu = None if path is None else path.sent(transaction, now_ns)
            if path is not None and sent_pdu is not None:
                transaction.path = path
                self.put_on_wire(transaction, sent_pdu, transaction.unit_id, now_ns)
                if transaction.target is not None:
                    path.left(transaction)
                return
        axes = self._units.axes_of(transaction.unit_id)
        if not axes and self._units.aliases.is_unknown(transaction.unit_id):
            self._count_unknown_unit(transaction.unit_id)
            assert transaction.port is not None
            self._silent_units.askers.add((transaction.port.plan.name, transaction.unit_id))
        if not self._ownership.may_move(transaction, axes, now_ns):
            self._transactions.refuse(transaction, ExceptionCode.SERVER_DEVICE_BUSY, now_ns)
            return
        for axis in axes:
            if axis.reach.silent_since_ns is not None:
                axis.end_silence(is_answer=False)
        try:
            if may_be_late:
                self._deadlines.check(transaction, now_ns)
            added, pdu = self._units.next_to_send(transaction, now_ns)
        except RefusedRequestError as refusal:
            self._report_refusal(refusal, now_ns)
            loss = Loss.TOO_EARLY if refusal.is_too_early else Loss.DENIED
            self._transactions.refuse(transaction, refusal.code, now_ns, loss=loss)
            return
        transaction.added = added
        if added is not None:
            self.put_on_wire(transaction, added.pdu, added.axis.plan.unit_id, now_ns)
            return
        self._leave(transaction, now_ns)
        self.put_on_wire(transaction, pdu, transaction.unit_id, now_ns)
        self._ownership.moved(transaction, now_ns)

    def _leave(self, transaction: Transaction, now_ns: int) -> None:
        """Record what its requests may change, and tell which of their reads the gateway refuses."""
        port = transaction.port
        for request in transaction.requests:
            self._counters.unknown_modes += leave(request, now_ns)
            if request.read_refusal is not None:
                self._report_refusal(request.read_refusal, now_ns)
                self._counters.count_refusal(None if port is None else port.plan.name)

    def _report_refusal(self, refusal: RefusedRequestError, now_ns: int) -> None:
        """Report why a request was refused, and the number of similar ones."""
        count = self._refusals.due((refusal.kind.name, refusal.axis), now_ns)
        if count:
            self._on_event(Event(refusal.kind, refusal.axis or None, refusal.reason + times(count)))

    def _count_unknown_unit(self, unit_id: int) -> None:
        """Count a request to an unknown unit id, and report the first one."""
        if self._units.aliases.count_request(unit_id):
            mapped = ", ".join(f"{axis.plan.name} (unit id {axis.plan.unit_id})" for axis in self._axes)
            detail = f"a controller addresses unit id {unit_id}, which has no axis; the axes are {mapped}"
            self._on_event(Event(exchange_events.UNKNOWN_UNIT, None, detail))

    def put_on_wire(self, transaction: Transaction, pdu: bytes, unit_id: int, now_ns: int) -> None:
        """Send a frame: the request itself, or one of the gateway."""
        self._paced_since_ns = 0
        patience_ns = self._response_timeout_ns
        port = transaction.port
        if self._silent_units.silences:
            patience_ns = self._silent_units.patience_ns(transaction, unit_id, now_ns, patience_ns)
        elif port is not None and port.patience_ns > patience_ns and transaction.added is None:
            patience_ns = port.patience_ns
        if port is not None and self._silent_units.silences and not transaction.is_stop:
            self._silent_units.note_served(id(port))
        if transaction.is_stop and self._scheduler.is_early(transaction, now_ns):
            self._transactions.stop_goes_on(transaction, StopEvent.LEAVES_EARLY)
        if self._renewal.holds and transaction.is_stop and self._scheduler.is_held_unit(unit_id):
            self._scheduler.add_early_stop(transaction)
        is_broadcast = unit_id == BROADCAST_UNIT_ID and self._link.is_serial
        if self.forwarding is not None and not is_broadcast:
            self.forwarding.expect(transaction)
        step = FRAME if port is None or transaction.added is None else ADDED_FRAME
        has_left = self._transactions.send(transaction, step, unit_id, pdu, now_ns, patience_ns=patience_ns)
        if is_broadcast and has_left:
            self._end_broadcast(transaction, now_ns)

    def _end_broadcast(self, transaction: Transaction, now_ns: int) -> None:
        """Give the drives time to execute a broadcast, which none of them answers."""
        self._counters.broadcasts += 1
        self._rest.begin_turnaround(now_ns)
        self.end(transaction, now_ns, self._rest.until_ns)
        if transaction.stopping is Stopping.EARLY:
            self._scheduler.wait_again(transaction)
        self._transactions.finish(transaction, Outcome.BROADCAST, now_ns)
        self._context.report(self._axes)

    def abort(self, transaction: Transaction, why: ForwardEvent, now_ns: int) -> None:
        """Send no more of the request that is being forwarded."""
        assert self.forwarding is not None
        self.forwarding.end_request(transaction, why, now_ns)

    def hold_up_waiting(self, now_ns: int) -> None:
        """Let waiting requests wait for the next connection; if there will be none, refuse them."""
        for transaction in self._waiting.withdraw(lambda each: each.port is None or not self._link.connects):
            self._transactions.refuse_absent(transaction, now_ns)
        is_lost = bool(self._link_state.lost)
        for transaction in self._waiting:
            transaction.is_held_up = True
            if is_lost and transaction.prefetched is not None:
                transaction.begin_anew()
        self.next(now_ns)

    def _wait_for_link(self, now_ns: int) -> int:
        """Answer what has waited too long for the link; return the next such time."""
        until_ns = NEVER_NS
        for transaction in tuple(self._waiting):
            if transaction.port is None or (self._link_state.is_up and not transaction.is_held_up):
                continue
            due_ns = transaction.waits_until_ns
            if due_ns > now_ns:
                until_ns = min(until_ns, due_ns)
                continue
            self._waiting.take(transaction)
            if transaction.is_denied or transaction.overtaken_by:
                self.start(transaction, now_ns)
            else:
                self._transactions.refuse_absent(transaction, now_ns)
        if not self._link_state.is_up and self._waiting.total:
            self._link.want()
            until_ns = min(until_ns, now_ns + DEMAND_EVERY_NS)
        return until_ns

    def _has_waited_too_long(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether a held-up write or stop would be sent too late."""
        is_late = transaction.is_held_up and now_ns >= transaction.waits_until_ns
        return is_late and not transaction.only_reads
