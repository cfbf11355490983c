"""Calculated times of a line, for the status; the measured times are next to them."""

from gateway.budget.line import line_budget
from gateway.state.plan import LinePlan
from gateway.status.line import Computed
from gateway.times import NS_PER_MS


def computed(plan: LinePlan) -> dict[str, Computed]:
    """Return the longest exchange of each controller and its whole round over all axes, in milliseconds.

    Calculated once at the start; `pitch-gateway budget` shows all of it.
    """
    return {
        controller.name: Computed(
            exchange_ms=_ms(max((each.legs.waited_ns for each in controller.exchanges), default=0)),
            round_ms=_ms(controller.round.total_ns),
            timeout_ms=_ms(controller.timeout_ns),
        )
        for controller in line_budget(plan).controllers
    }


def _ms(span_ns: int) -> float:
    return round(span_ns / NS_PER_MS, 3)
