"""Which request is sent next: stops, the gateway's own frames, motion, then monitors in the gaps (M3).

``queue`` holds what waits, in this order. :meth:`Scheduler.next` decides which of it may be sent now:

- On a free line without silent units the first one is sent. A request of a monitor or an operator is sent
  only if it fits into a gap between two motion transactions (``arbitration``).
- While the line rests, only stops are sent, and only those that the rest does not hold back.
- While a unit id is silent, ``silent_units`` says how long each request waits.
- While a new connection holds requests back, those that it does not carry yet wait (``renewal``).
- A request whose prerequisite was answered is sent next, after stops, while what was read for it is fresh.

Requests of one controller keep their order; its stops wait for none of them.

A stop goes before everything else. Waiting requests that would move its axes afterwards are withdrawn. The
request on the wire is not interrupted: the stop is sent after its reply or its time-out. In the silence after
a time-out the stop is sent early. It is sent once more after the silence, unless its own echo came. A
repeated stop to a unit that does not answer does not block the line: other controllers get their turns in
between.
"""

from collections.abc import Sequence
from typing import Final

from gateway.exchange.added_frames import trial_read
from gateway.exchange.arbitration import Gaps
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis
from gateway.exchange.decode import AxisCommand, decode
from gateway.exchange.dispatch import UnitMaps, is_acting_on, moves_one_of, rewrites
from gateway.exchange.ownership import lets_go
from gateway.exchange.plan import LineTiming
from gateway.exchange.ports import DriveLink
from gateway.exchange.queue import WaitingQueue
from gateway.exchange.renewal import Held, Renewal
from gateway.exchange.rest import Rest
from gateway.exchange.silent_units import Reach, SilentUnits
from gateway.exchange.transaction import (
    NO_RESPONSE,
    Phase,
    StopEvent,
    Stopping,
    Transaction,
    Transactions,
)
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from gateway.times import NEVER_NS

FULL_ECHOES: Final = frozenset({0x05, 0x06, 0x16})
"""Function codes whose reply repeats the complete request: no other request has the same reply."""
OVERTAKEN: Final = "a stop of its axis came after it"


class Scheduler:
    """Decides which request of one line is sent next.

    Args:
        axes: of the line.
        timing: of the line.
        units: the register maps of the line.
        waiting: the queue of the line.
        transactions: of the line.
        silent_units: the units that do not answer.
        rest: the pauses of the line.
        renewal: what a new connection holds back.
        link: the link to the drives.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        timing: LineTiming,
        units: UnitMaps,
        waiting: WaitingQueue,
        *,
        transactions: Transactions,
        silent_units: SilentUnits,
        rest: Rest,
        renewal: Renewal,
        link: DriveLink,
    ) -> None:
        self._unit_ids = tuple(dict.fromkeys(axis.plan.unit_id for axis in axes))
        self._units = units
        self._waiting = waiting
        self._transactions = transactions
        self._silent_units = silent_units
        self._rest = rest
        self._renewal = renewal
        self._is_serial = link.is_serial
        self.gaps = Gaps(timing, link.stamps)
        self._goes_next: Transaction | None = None
        """The request whose prerequisite was answered: it waits only for the silence before its own frame."""
        self.waits_until_ns: int | None = None
        """When a waiting request may be sent: of a monitor, or one that waits for late frames."""
        self._early_stops: list[Transaction] = []
        """Stops that were sent while writes were held. Their targets may be executed after them, so they are
        sent once more."""

    @property
    def is_moving(self) -> bool:
        """Whether a motion transaction is on the wire or waits."""
        current = self._transactions.current
        return (current is not None and current.is_motion) or not self._waiting.only_others

    def motion_came(self, now_ns: int) -> None:
        """Record a motion request that arrives now."""
        if not self.is_moving:
            self.gaps.motion_came(now_ns)

    # --- which request is next -------------------------------------------------------------------------

    def next(self, now_ns: int) -> Transaction | None:
        """Remove and return what may be started now on a line that is not busy; None: nothing may."""
        if self._goes_next is not None:
            chosen = self._take_next(now_ns)
            if chosen is not None:
                return chosen
        if self._rest.until_ns is not None or self._silent_units.silences or self._renewal.holds:
            if self._silent_units.awaits_late_reply:
                self._silent_units.answer_waiting(now_ns)
            chosen = self._choose(now_ns)
        elif not self._waiting.only_others:
            return self._waiting.pop()
        else:
            chosen, self.waits_until_ns = self.gaps.choose(self._waiting.first_of_others(), now_ns)
        if chosen is not None:
            self._waiting.take(chosen)
        return chosen

    def put_next(self, transaction: Transaction) -> None:
        """Queue a request whose prerequisite was answered: it goes next."""
        self._waiting.put_back(transaction)
        self._goes_next = transaction

    def forget_next(self) -> None:
        """The link was lost: what was read for the request that goes next is read again at its turn."""
        if self._goes_next is not None:
            self._goes_next.begin_anew()
            self._goes_next = None

    def _take_next(self, now_ns: int) -> Transaction | None:
        """Remove and return the request that goes next.

        None: something else goes first, so what was read for it is read again at its turn.
        """
        transaction, self._goes_next = self._goes_next, None
        assert transaction is not None
        is_held_back = self._rest.until_ns is not None or self._renewal.holds
        # If another unit is silent, the request is held back only while a late frame may come.
        is_held_back = is_held_back or self._from_ns(transaction, now_ns) > now_ns
        if is_held_back or self.has_due_stop(now_ns) or not self._waiting.holds(transaction):
            transaction.begin_anew()
            return None
        self._waiting.take(transaction)
        return transaction

    def has_due_stop(self, now_ns: int) -> bool:
        """Whether a waiting stop goes next; one that is to be repeated may wait for longer."""
        if not self._waiting.has_stops:
            return False
        rests = self._rest.until_ns is not None
        return any(rests or self._from_ns(stop, now_ns) <= now_ns for stop in self._waiting.stops)

    def due_stop(self, now_ns: int) -> Transaction | None:
        """Return the first waiting stop that nothing but the silence of the wire holds back."""
        return next((stop for stop in self._waiting.stops if self._from_ns(stop, now_ns) <= now_ns), None)

    def wake_at(self, due_ns: int) -> None:
        """Make the line check the waiting requests at this time, or earlier."""
        due_ns = min(due_ns, self.waits_until_ns or NEVER_NS)
        self.waits_until_ns = None if due_ns == NEVER_NS else due_ns

    def _choose(self, now_ns: int) -> Transaction | None:
        """Return what may be sent although the line rests or a unit is silent; None: nothing may.

        Requests of one controller keep their order; its stops wait for none of them.
        """
        until_ns = NEVER_NS
        held: set[int] = set()
        others: list[Transaction] = []
        rests = self._rest.until_ns is not None
        for transaction in self._waiting.stops if rests else self._waiting:
            port = transaction.port
            is_in_order = port is not None and not transaction.is_stop
            if is_in_order and id(port) in held:
                continue
            if self._renewal.holds and self._is_held(transaction, now_ns):
                held.add(id(port))
                if transaction.unit_id not in self._units and self._renewal.devices_until_ns > now_ns:
                    until_ns = min(until_ns, self._renewal.devices_until_ns)
                continue
            from_ns = self._from_ns(transaction, now_ns)
            if from_ns <= now_ns and (port is None or port.is_motion or transaction.is_stop):
                return transaction
            if from_ns <= now_ns:
                others.append(transaction)
            else:
                until_ns = min(until_ns, from_ns)
            if is_in_order:
                held.add(id(port))
        chosen: Transaction | None = None
        if others:
            chosen, monitor_due_ns = self.gaps.choose(others, now_ns)
            if monitor_due_ns is not None:
                until_ns = min(until_ns, monitor_due_ns)
        self.wake_at(until_ns)
        return chosen

    def _from_ns(self, transaction: Transaction, now_ns: int) -> int:
        """Return from when a waiting request may be started, even if only to end immediately."""
        unit_id = transaction.unit_id
        if transaction.is_stop:
            rests_until_ns = self._rest.until_ns
            from_ns = self._stop_from_ns(transaction)
            is_late = transaction.waits_for_silence
            from_ns = max(from_ns, self._rest.aborted_until_ns, self._rest.opened_until_ns)
            if rests_until_ns is not None and (is_late or self._rest.keeps_stops):
                from_ns = max(from_ns, rests_until_ns, now_ns + 1)
            if is_late:
                free_ns = self._silent_units.free_ns(unit_id, now_ns, is_read=False, is_stop=True)
                from_ns = max(from_ns, free_ns)
            return from_ns
        if transaction.is_denied or transaction.why_given_up(now_ns):
            return now_ns
        if self._silent_units.is_answered_for(transaction, now_ns):
            return now_ns
        if transaction.is_odd:
            dead = self._silent_units.dead(unit_id)
            if dead is not None and dead.odd_due_ns > now_ns:
                return dead.odd_due_ns
        free_ns = self._silent_units.free_ns(unit_id, now_ns, is_read=transaction.only_reads)
        # After that it is withdrawn, so that it does not hold back what waits behind it.
        return min(free_ns, transaction.given_up_ns + 1)

    def _stop_from_ns(self, stop: Transaction) -> int:
        """Return from when a stop may be sent: repeats to a silent unit must not block other controllers."""
        silence = self._silent_units.silences.get(stop.unit_id)
        if silence is None:
            return 0
        if silence.unserved_ports and any(
            id(each.port) in silence.unserved_ports for each in self._waiting if not each.is_stop
        ):
            return NEVER_NS if stop.pdu in silence.stops else 0
        return 0 if stop.stopping is Stopping.AGAIN else silence.stops.get(stop.pdu, 0)

    def _is_held(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether the connection does not carry a request yet, because an older one may be executed."""
        held, unit_id = self._renewal.held, transaction.unit_id
        if held is Held.NOTHING or transaction.port is None or transaction.is_stop:
            return False
        if not self.is_held_unit(unit_id):
            return False
        if unit_id in self._units or self._may_reach_axes(unit_id):
            return held is Held.ALL or not transaction.only_reads
        # Nothing is read of a device without an axis, and its controller may only write.
        return not transaction.only_reads and now_ns < self._renewal.devices_until_ns

    def is_held_unit(self, unit_id: int) -> bool:
        """Whether an unanswered write of the old connection may still be executed by a unit id."""
        held_unit_ids = self._renewal.held_unit_ids
        has_axis = unit_id in self._units or self._may_reach_axes(unit_id)
        if has_axis and any(self._may_reach_axes(each) for each in held_unit_ids):
            return True
        return self._may_reach_axes(unit_id) or not held_unit_ids.isdisjoint(self._units.partners(unit_id))

    def _may_reach_axes(self, unit_id: int) -> bool:
        """Whether a request to a unit id without an axis may reach one, or all."""
        if unit_id in self._units:
            return False
        return unit_id == BROADCAST_UNIT_ID or self._units.aliases.may_reach_axis(unit_id)

    def held_read(self, now_ns: int) -> Transaction | None:
        """Return a read that checks if a drive answers, while nothing else may be sent; None: not now."""
        if self._renewal.held is not Held.ALL:
            return None
        until_ns, own = NEVER_NS, None
        for unit_id in self._unit_ids:
            read = trial_read(self._units.axes_of(unit_id))
            if read is None:
                continue
            silence = self._silent_units.silences.get(unit_id)
            dead = silence if silence is not None and silence.reach is Reach.DEAD else None
            due_ns = self._silent_units.free_ns(unit_id, now_ns, is_read=True)
            if dead is not None and self._silent_units.backs_off:
                due_ns = max(due_ns, dead.due_ns)
            if due_ns > now_ns:
                until_ns = min(until_ns, due_ns)
                continue
            if dead is not None:
                dead.try_again(now_ns)
            own = Transaction(None, 0, unit_id, read.pdu, now_ns)
            own.added = read
            break
        self.wake_at(until_ns)
        return own

    # --- stops -----------------------------------------------------------------------------------------

    def overtake(self, stop: Transaction, stops: list[AxisCommand], now_ns: int) -> None:
        """Withdraw what would move the axes of a stop afterwards (M3).

        The same holds for axes whose targets the frame writes: waiting triggers were meant for earlier
        targets. It also holds for axes whose targets the frame runs: it runs those from before the waiting
        requests. And it holds for a request that writes a register or coil of the frame: the older value
        would undo the stop.
        """
        frames = self._units.frames_of(stop)
        axes = [command.axis for command in stops]
        axes += self._units.given_targets(frames)

        def is_overtaken(each: Transaction) -> bool:
            return is_acting_on(self._units, each, axes) or self._undoes(each, stop, axes)

        for transaction in self._waiting.withdraw(lambda each: not each.is_denied and is_overtaken(each)):
            self._transactions.overtaken(transaction, OVERTAKEN, now_ns)
        current = self._transactions.current
        if current and current.phase is Phase.PREREQUISITE and is_overtaken(current):
            current.overtaken_by = OVERTAKEN
        only_stops = self._units.only_stops(frames)
        event = StopEvent.FOUND if only_stops else StopEvent.FOUND_WITH_MORE
        self._transactions.stop_goes_on(stop, event)

    def _undoes(self, transaction: Transaction, stop: Transaction, axes: Sequence[Axis]) -> bool:
        """Whether an older request would undo a stop. The release of a jog of another axis still goes out."""
        if transaction.is_stop or transaction.port is None or transaction.unit_id == BROADCAST_UNIT_ID:
            return False  # a broadcast has no reply: its controller would not learn that it was withdrawn
        if not rewrites(self._units, transaction, self._units.frames_of(stop)):
            return False
        writer = transaction.port.writer
        return not any(
            command.axis not in axes and lets_go(command, writer)
            for frame in self._units.frames_of(transaction)
            for command in decode(frame)
        )

    def add_stop(self, stop: Transaction, now_ns: int) -> bool:
        """Put a stop at the head of the queue; return whether it was queued (``WaitingQueue.add_stop``).

        It replaces equal stops whose controllers have given up.
        """
        for before in self._waiting.withdraw(lambda each: each.is_same_stop(stop) and each.is_orphan):
            self._transactions.replace(before, stop)
        if not self._waiting.add_stop(stop):
            return False
        if self._stop_from_ns(stop) > now_ns:
            self._silent_units.thin_out(stop, now_ns)
        return True

    def is_early(self, stop: Transaction, now_ns: int) -> bool:
        """Whether a late frame may come instead of the reply to a stop, or collide with the stop."""
        if stop.waits_for_silence or not self._is_serial:
            return False
        return self._rest.is_draining or self._silent_units.free_ns(stop.unit_id, now_ns, is_read=False) > 0

    def is_answer(self, stop: Transaction, reply: bytes) -> bool:
        """Whether a reply to an early stop ends it: a late reply may come instead.

        A request that waited for the silence may still move its axis. And an older stop that is sent once
        more may write another value to the same register. The stop is sent once more behind them then.
        """
        unit_id, pdu, frames = stop.unit_id, stop.pdu, self._units.frames_of(stop)
        axes = [command.axis for command in self._units.stops_of(frames)]
        for each in self._waiting.stops:
            if each.stopping is Stopping.ONCE and moves_one_of(self._units, each, axes):
                return False
            is_other = each.stopping is Stopping.AGAIN and not each.is_same_stop(stop)
            if is_other and rewrites(self._units, each, frames):
                return False
        if pdu[0] in FULL_ECHOES:
            return reply == pdu
        # With several registers the reply has only their addresses, as for any other write there.
        return reply == pdu[:5] and not (
            self._rest.is_draining or self._silent_units.awaits_late_reply_of(unit_id)
        )

    def go_again(self, stop: Transaction, now_ns: int) -> None:
        """End an early stop that was not answered; its controller waits for the answer to the next one.

        If that controller has given up and an equal stop waits already, that one is the next.
        """
        if not (stop.is_orphan and any(each.is_same_stop(stop) for each in self._waiting)):
            self.wait_again(stop)
        self._transactions.finish(stop, Outcome.NO_REPLY, now_ns, code=NO_RESPONSE)

    def wait_again(self, stop: Transaction) -> None:
        """Queue a sent stop again, to be sent once more."""
        again = self._transactions.once_more(stop)
        if again is not None:
            self._waiting.add_again(again)

    def add_early_stop(self, stop: Transaction) -> None:
        """Record a stop that is sent while writes are held, unless it does more than stop."""
        is_known = any(each.is_same_stop(stop) for each in self._early_stops)
        if stop.stopping is not Stopping.ONCE and not is_known:
            self._early_stops.append(stop)

    def release_stops(self) -> None:
        """Send the stops again that were sent while writes were held, before any write is sent."""
        stops, self._early_stops = self._early_stops, []
        for stop in stops:
            again = self._transactions.once_more(stop)
            if again is not None:
                again.give_up()  # its controller was answered
                self._waiting.add_again(again)
