"""The parts of one line, each created once and connected with the others. Nothing is decided here."""

from collections.abc import Callable, Iterable, Sequence

from gateway.catalogue import exchange_events
from gateway.exchange.admission import Admission
from gateway.exchange.axis.axis import Axis, join_terms
from gateway.exchange.axis.registers import Loss
from gateway.exchange.counters import LineCounters
from gateway.exchange.deadlines import Deadlines
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.events import Event
from gateway.exchange.group import join_groups
from gateway.exchange.link_state import LinkState
from gateway.exchange.meter import LineMeter
from gateway.exchange.ownership import Ownership
from gateway.exchange.plan import AxisPlan, LineTiming, OtherUnits
from gateway.exchange.ports import DriveLink
from gateway.exchange.queue import WaitingQueue
from gateway.exchange.renewal import Renewal, longest_lost_ns
from gateway.exchange.rest import Rest
from gateway.exchange.scheduler import Scheduler
from gateway.exchange.silent_units import SilentUnits
from gateway.exchange.tap import Tap
from gateway.exchange.transaction import Transaction, Transactions
from gateway.times import NS_PER_MS


class LineContext:
    """What the parts of one line share. Arguments as for ``LineExchange``."""

    def __init__(
        self,
        axes: Sequence[AxisPlan],
        timing: LineTiming,
        link: DriveLink,
        on_event: Callable[[Event], None],
        groups: Iterable[Iterable[str]],
        *,
        remembered_paths: int,
        other_units: OtherUnits,
        what_ran: Callable[[int, int], str],
        tap: Tap | None,
    ) -> None:
        self.link = link
        self.on_event = on_event
        self.tap = tap
        self.response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self.gap_ms = timing.gap_ms
        self.axes = tuple([Axis(plan) for plan in axes])
        join_terms(self.axes)
        join_groups(self.axes, groups)
        self.counters = LineCounters()
        self.units = UnitMaps(
            self.axes, is_serial=link.is_serial, remembered_paths=remembered_paths, other_units=other_units
        )
        self.ownership = Ownership(self.axes, self.units, on_event)
        self.transactions = Transactions(self.counters, on_event, self._lose, self.units.get, link, tap=tap)
        self.admission = Admission(self.units, self.transactions, self.ownership, on_event)
        self.rest = Rest(timing)
        self.waiting = WaitingQueue()
        self.renewal = Renewal(
            self.response_timeout_ns, longest_lost_ns([axis.plan.lost_ms for axis in self.axes])
        )
        self.silent_units = SilentUnits(
            timing,
            self.units,
            self.waiting,
            self.transactions,
            on_event=on_event,
            report=self.report,
            is_serial=link.is_serial,
        )
        self.link_state = LinkState(
            self.axes,
            self.units,
            timing,
            link,
            self.waiting,
            transactions=self.transactions,
            silent_units=self.silent_units,
            rest=self.rest,
            renewal=self.renewal,
            on_event=on_event,
            report=self.report,
        )
        self.scheduler = Scheduler(
            self.axes,
            timing,
            self.units,
            self.waiting,
            transactions=self.transactions,
            silent_units=self.silent_units,
            rest=self.rest,
            renewal=self.renewal,
            link=link,
        )
        self.meter = LineMeter(self.axes, link, on_event, what_ran)
        self.deadlines = Deadlines(self.axes, self.units, self.counters, on_event)

    def report(self, axes: tuple[Axis, ...]) -> None:
        """Report what is new about these axes; a group is referenced as a whole, or not at all."""
        for axis in axes:
            if axis.peers:
                axis.follow_group()
            for member in (*axis.peers, axis):
                for event in member.take_events():
                    self.counters.internal_faults += event.kind is exchange_events.INTERNAL_FAULT
                    self.on_event(event)

    def _lose(self, transaction: Transaction, code: int, loss: Loss) -> None:
        """Record that a request never reached its drive (M3); a sender that may not write loses nothing."""
        if transaction.is_denied and not transaction.is_motion:
            return
        self.ownership.lose(transaction, code, loss)
        self.report(self.units.axes_of(transaction.unit_id))
