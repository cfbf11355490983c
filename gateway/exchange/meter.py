"""What the gateway itself costs: each exchange measured, held against the budget of its axes (DESIGN 8).

Times are those of ``read()`` and ``write()``. Of one exchange:

- *queue*: from its last byte until the line was free for it;
- *request leg*: from then until its frame was written to the drive, without the frames of the gateway's own
  that went first (*added*), and without the silence that a wire wants;
- *drive*: from then to the last byte of the reply, without the time that the bytes take on the wire;
- *reply leg*: from then until the reply was written to the controller.

Gateway time is both legs together.
"""

from collections.abc import Callable, Iterable
from typing import Final

from gateway.exchange.axis import AxisExchange
from gateway.exchange.events import Event, EventKind
from gateway.exchange.latency import HighMark, Histogram, bucket_of
from gateway.exchange.life import Exchange
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.times import NS_PER_US

WITHIN_TO_END: Final = 100
"""So many exchanges in a row within the budget end an overrun."""
RTU_OVERHEAD: Final = 3
"""Bytes of an RTU frame beside its PDU: unit id and check sum."""


class Measured:
    """Times of the exchanges of one controller, or of one axis."""

    __slots__ = ("drive", "exchange", "gateway", "high", "queue", "reply", "request")

    def __init__(self) -> None:
        self.gateway = Histogram()
        self.request = Histogram()
        self.reply = Histogram()
        self.queue = Histogram()
        self.drive = Histogram()
        self.exchange = Histogram()
        """From the last byte of a request to the reply, all together."""
        self.high = HighMark()


class AxisBudget:
    """The budget of one axis, and how it is kept."""

    __slots__ = ("axis", "budget_ns", "is_over", "measured", "overruns", "within")

    def __init__(self, axis: AxisExchange) -> None:
        self.axis = axis.plan.name
        self.measured = Measured()
        self.budget_ns = int(axis.plan.budget_us * NS_PER_US)
        self.overruns = 0
        self.is_over = False
        self.within = 0
        """Exchanges since the last overrun, while it lasts."""


class LineMeter:
    """Measures the exchanges of one line.

    ``what_ran`` says what else the loop ran between two instants; it is asked when a budget is exceeded.
    """

    def __init__(
        self,
        axes: Iterable[AxisExchange],
        link: DriveLink,
        on_event: Callable[[Event], None],
        what_ran: Callable[[int, int], str],
    ) -> None:
        self.controllers: dict[str, Measured] = {}
        self.axes: dict[str, AxisBudget] = {}
        self._of_unit: dict[int, list[AxisBudget]] = {}
        for axis in axes:
            budget = self.axes[axis.plan.name] = AxisBudget(axis)
            self._of_unit.setdefault(axis.plan.unit_id, []).append(budget)
        self._link = link
        self._on_event = on_event
        self._what_ran = what_ran
        self.gateway = Histogram()
        self.high = HighMark()
        self.wire_ns = 0
        """All the time that bytes of exchanges took on the drives' wire, as their number says."""
        self.added_ns = 0
        """All the time that the gateway's own frames held requests up."""

    @property
    def overruns(self) -> int:
        """Exchanges that took longer than the budget of their axis."""
        return sum(budget.overruns for budget in self.axes.values())

    def turn(self, now_ns: int) -> None:
        """Let high marks of the last minute grow old; to be called every few seconds."""
        self.high.turn(now_ns)
        for measured in (*self.controllers.values(), *(budget.measured for budget in self.axes.values())):
            measured.high.turn(now_ns)

    def note(self, exchange: Exchange, port: ControllerPort, reply: bytes, reply_ns: int) -> None:
        """Measure an exchange whose reply has been passed on."""
        link = self._link
        sent_ns = link.sent_ns
        if not sent_ns or exchange.is_orphan:
            return
        started_ns = exchange.started_ns or exchange.arrived_ns
        request_ns = sent_ns - started_ns - link.held_ns
        reply_leg_ns = port.sent_ns - reply_ns - port.held_ns
        gateway_ns = request_ns + reply_leg_ns
        drive_ns = reply_ns - sent_ns
        if link.wire_ns_per_byte:
            wire_ns = (len(exchange.pdu) + len(reply) + 2 * RTU_OVERHEAD) * link.wire_ns_per_byte
            drive_ns -= wire_ns
            self.wire_ns += wire_ns
        self.added_ns += exchange.added_ns
        measured = self.controllers.get(port.plan.name)
        if measured is None:
            measured = self.controllers[port.plan.name] = Measured()
        gateway, request, leg = bucket_of(gateway_ns), bucket_of(request_ns), bucket_of(reply_leg_ns)
        self.gateway.counts[gateway] += 1
        measured.gateway.counts[gateway] += 1
        measured.request.counts[request] += 1
        measured.reply.counts[leg] += 1
        measured.exchange.counts[bucket_of(port.sent_ns - exchange.arrived_ns)] += 1
        measured.drive.counts[bucket_of(drive_ns)] += 1
        measured.queue.counts[bucket_of(exchange.queue_ns) if exchange.queue_ns else 0] += 1
        if gateway_ns > measured.high.slot_ns:
            measured.high.raise_to(gateway_ns)
        if gateway_ns > self.high.slot_ns:
            self.high.raise_to(gateway_ns)
        for budget in self._of_unit.get(exchange.unit_id, ()):
            measured = budget.measured
            measured.gateway.counts[gateway] += 1
            measured.request.counts[request] += 1
            measured.reply.counts[leg] += 1
            if gateway_ns > measured.high.slot_ns:
                measured.high.raise_to(gateway_ns)
            if gateway_ns > budget.budget_ns:
                self._exceeded(budget, exchange, port, reply_ns)
            elif budget.is_over:
                self._kept(budget)

    def _exceeded(self, budget: AxisBudget, exchange: Exchange, port: ControllerPort, reply_ns: int) -> None:
        budget.overruns += 1
        budget.within = 0
        if budget.is_over:
            return
        budget.is_over = True
        link, started_ns = self._link, exchange.started_ns or exchange.arrived_ns
        steps = {
            "working out what is sent": link.ready_ns - started_ns,
            "writing it to the drive": link.sent_ns - link.ready_ns - link.held_ns,
            "turning the reply back": port.ready_ns - reply_ns,
            "writing it to the controller": port.sent_ns - port.ready_ns - port.held_ns,
        }
        slowest = max(steps, key=lambda step: steps[step])
        all_us = sum(steps.values()) / NS_PER_US
        ran = self._what_ran(started_ns, port.sent_ns)
        detail = (
            f"{all_us:.0f} µs of gateway time, budget_us = {budget.budget_ns / NS_PER_US:g}; "
            f"slowest: {slowest}, {steps[slowest] / NS_PER_US:.0f} µs{f'; meanwhile {ran}' if ran else ''}"
        )
        self._on_event(Event(EventKind.BUDGET_OVERRUN, budget.axis, detail))

    def _kept(self, budget: AxisBudget) -> None:
        budget.within += 1
        if budget.within >= WITHIN_TO_END:
            budget.is_over = False
            detail = f"{WITHIN_TO_END} exchanges in a row within budget_us; {budget.overruns} over it so far"
            self._on_event(Event(EventKind.BUDGET_KEPT, budget.axis, detail))
