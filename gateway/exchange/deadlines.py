"""Targets and triggers that have waited too long: sent and counted, or refused.

With ``targets`` a move must not end short. With a ``stream`` an old setpoint is worse than none.
``late`` decides.
"""

from collections.abc import Callable, Sequence
from typing import Final

from gateway.catalogue import exchange_events, refusals
from gateway.exchange.axis.axis import Axis
from gateway.exchange.counters import LineCounters
from gateway.exchange.dispatch import UnitMaps, is_acting_on
from gateway.exchange.events import Event
from gateway.exchange.plan import Late
from gateway.exchange.refusal import refused
from gateway.exchange.transaction import Transaction
from gateway.times import NS_PER_MS, NS_PER_S

REPORT_EVERY_NS: Final = NS_PER_S
"""Minimum time between reports of late targets of one axis that are sent; all are counted."""


class Deadlines:
    """The deadlines of the axes of one line."""

    def __init__(
        self,
        axes: Sequence[Axis],
        units: UnitMaps,
        counters: LineCounters,
        on_event: Callable[[Event], None],
    ) -> None:
        self._axes = [axis for axis in axes if axis.plan.deadline_ms]
        self._least_ns = int(min((a.plan.deadline_ms for a in self._axes), default=0.0) * NS_PER_MS)
        self._units = units
        self._counters = counters
        self._on_event = on_event
        self._reported_ns: dict[str, int] = {}

    def may_be_late(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether a request has waited longer than some axis allows."""
        return bool(self._axes) and now_ns - transaction.arrived_ns - transaction.excused_ns > self._least_ns

    def check(self, transaction: Transaction, now_ns: int) -> None:
        """Check the age of a target or trigger that is about to be sent, and that may be late.

        Raises:
            RefusedRequestError: it is late, and its axis refuses late ones.
        """
        age_ms = (now_ns - transaction.arrived_ns - transaction.excused_ns) / NS_PER_MS
        late = [axis for axis in self._axes if age_ms > axis.plan.deadline_ms]
        late = [axis for axis in late if is_acting_on(self._units, transaction, [axis])]
        if not late:
            return
        self._counters.late_targets += 1
        for axis in late:
            name, deadline_ms = axis.plan.name, axis.plan.deadline_ms
            if axis.plan.late is Late.REJECT:
                raise refused(
                    refusals.LATE, name, exchange_events.LATE_TARGET, age_ms=age_ms, deadline_ms=deadline_ms
                )
            if now_ns - self._reported_ns.get(axis.plan.name, -REPORT_EVERY_NS) >= REPORT_EVERY_NS:
                self._reported_ns[axis.plan.name] = now_ns
                detail = (
                    f"it waited {age_ms:.1f} ms, deadline_ms = {deadline_ms:g}: sent all the same "
                    '(late = "forward")'
                )
                self._on_event(Event(exchange_events.LATE_TARGET, axis.plan.name, detail))
