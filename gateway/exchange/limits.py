"""Limits of an axis that it can be given while it runs; who compares them needs none of what runs."""

from dataclasses import dataclass

from gateway.exchange.plan import AxisPlan


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one axis that it can be given while it runs; lengths in its units."""

    max_correction: float
    max_slope: float
    travel_margin: float
    budget_us: float


def limits_of(plan: AxisPlan) -> Limits:
    """Return the limits of an axis."""
    settings = plan.settings
    return Limits(settings.max_correction, settings.max_slope, settings.travel_margin, plan.budget_us)
