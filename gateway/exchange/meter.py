"""The gateway's own time: each transaction is measured and compared with the budget of its axes.

Times are those of ``read()`` and ``write()``. A transaction has these parts:

- *queue*: from its last byte until the line was free for it, and the wire had been silent long enough;
- *request leg*: from then until its frame was written to the drive; without the frames of the gateway that
  went first (*added*);
- *drive*: from then to the last byte of the reply, without the transmission time of the bytes (under
  cut-through, only of the bytes still to be sent then);
- *reply leg*: from then until the reply was written to the controller.

Gateway time is both legs together.
"""

from collections.abc import Callable, Iterable
from typing import Final

from librt.vecs import vec
from mypy_extensions import i64

from gateway.catalogue import exchange_events
from gateway.exchange.axis.axis import Axis
from gateway.exchange.events import Event
from gateway.exchange.latency import BUCKETS, OCTAVE, SUB_BITS, HighMark, bucket_of
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.transaction import Transaction
from gateway.times import NEVER_NS, NS_PER_S, NS_PER_US

WITHIN_TO_END: Final = 100
"""This many transactions in a row within the budget end an overrun, if ``CALM_NS`` have passed too."""
CALM_NS: Final = 10 * NS_PER_S
"""An overrun ends at the earliest this long after the last transaction over the budget. A busy machine
exceeds a budget every second, and a report each time would displace all other events."""
RTU_OVERHEAD: Final = 3
"""Bytes of an RTU frame besides its PDU: unit id and CRC."""
MOST_PAIRS: Final = 128
"""Pairs of controller and unit id that are measured separately on one line; all others together."""
OTHERS: Final = ("others", -1)

Key = tuple[str, int]
"""A controller's name and a unit id."""


def _none_yet() -> vec[i64]:
    """Return counts of all buckets, as machine integers: counting creates no objects."""
    return vec[i64]([0] * BUCKETS)


class Measured:
    """Durations of the transactions of one controller with one unit id: counts by ``latency.bucket_of``."""

    __slots__ = ("budget_ns", "drive", "gateway", "high", "queue", "reply", "request")

    def __init__(self, budget_ns: int) -> None:
        self.gateway = _none_yet()
        self.request = _none_yet()
        self.reply = _none_yet()
        self.drive = _none_yet()
        self.queue: vec[i64] | None = None
        """Of those that had to wait for the line; created with the first one."""
        self.high = HighMark()
        self.budget_ns = budget_ns
        """The smallest budget of the unit id's axes."""


class AxisBudget:
    """The budget of one axis, and how well it is met."""

    __slots__ = ("axis", "budget_ns", "exceeded_ns", "is_over", "overruns", "unit_id", "within")

    def __init__(self, axis: Axis) -> None:
        self.axis = axis.plan.name
        self.unit_id = axis.plan.unit_id
        self.budget_ns = 0
        self.take_limits(axis)
        self.overruns = 0
        self.is_over = False
        self.within = 0
        """Transactions within the budget since the last one over it; counted while an overrun lasts."""
        self.exceeded_ns = 0
        """When a transaction last exceeded the budget."""

    def take_limits(self, axis: Axis) -> None:
        """Use the budget in the axis's present plan."""
        self.budget_ns = int(axis.plan.budget_us * NS_PER_US)

    def exceed(self, now_ns: int) -> bool:
        """Record an overrun; return whether it is the first one of several."""
        was_over = self.is_over
        self.overruns += 1
        self.within = 0
        self.exceeded_ns = now_ns
        self.is_over = True
        return not was_over

    def count_within(self, now_ns: int) -> int:
        """Count a transaction within the budget; return their number if they end an overrun, else 0."""
        self.within += 1
        if self.within < WITHIN_TO_END or now_ns - self.exceeded_ns < CALM_NS:
            return 0
        self.is_over = False
        return self.within


class LineMeter:
    """Measures the transactions of one line.

    ``what_ran`` returns what else the loop ran between two times; it is called when a budget is exceeded.
    """

    def __init__(
        self,
        axes: Iterable[Axis],
        link: DriveLink,
        on_event: Callable[[Event], None],
        what_ran: Callable[[int, int], str],
    ) -> None:
        self.measured: dict[Key, Measured] = {}
        self.axes = {axis.plan.name: AxisBudget(axis) for axis in axes}
        self._link = link
        self._on_event = on_event
        self._what_ran = what_ran
        self._axes_over = 0
        self._last_port: ControllerPort | None = None
        self._last_unit_id = -1
        self._last: Measured | None = None
        """Where the last transaction was measured: the next one usually belongs there too."""
        self.wire_ns = 0
        """Total time of transactions' bytes on the drives' wire, computed from their number."""
        self.added_ns = 0
        """Total time for which frames of the gateway delayed requests."""

    @property
    def overruns(self) -> int:
        """Transactions that took longer than the budget of their axis."""
        return sum(budget.overruns for budget in self.axes.values())

    def take_limits(self, axes: Iterable[Axis]) -> None:
        """Use the budgets in the present plans of the line's axes."""
        for axis in axes:
            self.axes[axis.plan.name].take_limits(axis)
        for key, measured in self.measured.items():
            measured.budget_ns = self._smallest_ns(key)

    def tick(self, now_ns: int) -> None:
        """Age the high marks of the last minute; must be called every few seconds."""
        for measured in self.measured.values():
            measured.high.tick(now_ns)

    def add(self, transaction: Transaction, port: ControllerPort, reply: bytes, reply_ns: int) -> None:
        """Measure a transaction whose reply has been passed on."""
        sent, replied = self._link.stamps, port.stamps
        sent_ns, started_ns = sent.sent_ns, transaction.started_ns
        leg_ns = replied.sent_ns - reply_ns
        if not sent_ns or leg_ns < 0:
            return  # times are not recorded, or the controller is gone
        unit_id = transaction.unit_id
        measured = self._last
        if port is not self._last_port or unit_id != self._last_unit_id or measured is None:
            measured = self.measured.get((port.name, unit_id)) or self._measured(port.name, unit_id)
            self._last_port, self._last_unit_id, self._last = port, unit_id, measured
        request_ns = sent_ns - (started_ns or transaction.arrived_ns)
        gateway_ns = request_ns + leg_ns
        drive_ns = reply_ns - sent_ns
        if sent.wire_ns_per_byte:
            wire_ns = (len(transaction.pdu) + len(reply) + 2 * RTU_OVERHEAD) * sent.wire_ns_per_byte
            # A part may have been sent before (cut-through); adapters may buffer less than a character's
            # time.
            drive_ns = max(0, drive_ns + transaction.early_ns - wire_ns)
            self.wire_ns += wire_ns
        # ``bucket_of``, four times inline: its calls would cost as much as all the rest.
        shift = gateway_ns.bit_length() - OCTAVE
        measured.gateway[(shift << SUB_BITS) + (gateway_ns >> shift) if shift > 0 else gateway_ns] += 1
        shift = request_ns.bit_length() - OCTAVE
        measured.request[(shift << SUB_BITS) + (request_ns >> shift) if shift > 0 else request_ns] += 1
        shift = leg_ns.bit_length() - OCTAVE
        measured.reply[(shift << SUB_BITS) + (leg_ns >> shift) if shift > 0 else leg_ns] += 1
        shift = drive_ns.bit_length() - OCTAVE
        measured.drive[(shift << SUB_BITS) + (drive_ns >> shift) if shift > 0 else drive_ns] += 1
        if gateway_ns > measured.high.slot_ns:
            measured.high.raise_to(gateway_ns)
        if started_ns:
            self._add_waiting(transaction, measured)
        if gateway_ns > measured.budget_ns or self._axes_over:
            self._judge(transaction, port, gateway_ns, reply_ns)

    def _measured(self, controller: str, unit_id: int) -> Measured:
        """Return where a new pair is measured."""
        key = (controller, unit_id) if len(self.measured) < MOST_PAIRS else OTHERS
        if key not in self.measured:
            self.measured[key] = Measured(self._smallest_ns(key))
        return self.measured[key]

    def _smallest_ns(self, key: Key) -> int:
        """Return the smallest budget of the axes of a pair's unit id."""
        is_any, unit_id = key == OTHERS, key[1]
        budgets = [budget.budget_ns for budget in self.axes.values() if is_any or budget.unit_id == unit_id]
        return min(budgets, default=NEVER_NS)

    def _add_waiting(self, transaction: Transaction, measured: Measured) -> None:
        """Record the time between a request's arrival and its turn."""
        self.added_ns += transaction.added_ns
        if transaction.queue_ns:
            if measured.queue is None:
                measured.queue = _none_yet()
            measured.queue[bucket_of(transaction.queue_ns)] += 1

    def _judge(self, transaction: Transaction, port: ControllerPort, gateway_ns: int, reply_ns: int) -> None:
        """Compare a transaction with the budgets of its axes."""
        for budget in self.axes.values():
            if budget.unit_id != transaction.unit_id:
                continue
            if gateway_ns > budget.budget_ns:
                if budget.exceed(reply_ns):
                    self._exceeded(budget, transaction, port, reply_ns)
            elif budget.is_over:
                self._kept(budget, reply_ns)

    def _exceeded(
        self, budget: AxisBudget, transaction: Transaction, port: ControllerPort, reply_ns: int
    ) -> None:
        self._axes_over += 1
        sent, replied = self._link.stamps, port.stamps
        started_ns = transaction.started_ns or transaction.arrived_ns
        steps = {
            "working out what is sent": sent.ready_ns - started_ns,
            "writing it to the drive": sent.sent_ns - sent.ready_ns,
            "turning the reply back and writing it": replied.sent_ns - reply_ns,
        }
        slowest = max(steps, key=lambda step: steps[step])
        all_us = sum(steps.values()) / NS_PER_US
        ran = self._what_ran(started_ns, replied.sent_ns)
        detail = (
            f"{all_us:.0f} µs of gateway time, budget_us = {budget.budget_ns / NS_PER_US:g}; "
            f"slowest: {slowest}, {steps[slowest] / NS_PER_US:.0f} µs{f'; meanwhile {ran}' if ran else ''}"
        )
        self._on_event(Event(exchange_events.BUDGET_OVERRUN, budget.axis, detail))

    def _kept(self, budget: AxisBudget, now_ns: int) -> None:
        within = budget.count_within(now_ns)
        if within:
            self._axes_over -= 1
            detail = f"{within} exchanges in a row within budget_us; {budget.overruns} over it so far"
            self._on_event(Event(exchange_events.BUDGET_KEPT, budget.axis, detail))
