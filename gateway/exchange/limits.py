"""Values that an axis can get while it runs. Comparing them needs no running axis.

Its limits are the fields of :class:`~gateway.exchange.commands.SetLimits`, each under its name in the plan or
in the settings of the axis; there is no other list of them.
"""

from dataclasses import replace
from typing import Any, Final

from gateway.compensation.settings import Gain
from gateway.exchange.commands import Message, SetLimits
from gateway.exchange.plan import AxisPlan, CompensationMode

_NOT_LIMITS: Final = ("axis",) + Message.__struct_fields__  # noqa: RUF005  mypyc does not compile a star here
_NAMES: Final = tuple([name for name in SetLimits.__struct_fields__ if name not in _NOT_LIMITS])


def values_of(limits: SetLimits) -> dict[str, float]:
    """Return limits by their names; lengths in the units of the axis."""
    return {name: getattr(limits, name) for name in _NAMES}


def limits_of(plan: AxisPlan) -> SetLimits:
    """Return the limits of an axis."""
    values = {name: getattr(plan if hasattr(plan, name) else plan.settings, name) for name in _NAMES}
    return SetLimits(axis=plan.name, **values)


def with_limits(plan: AxisPlan, values: dict[str, float]) -> AxisPlan:
    """Return a plan with other limits, by their names."""
    own: dict[str, Any] = {name: value for name, value in values.items() if hasattr(plan, name)}
    of_settings: dict[str, Any] = {name: value for name, value in values.items() if name not in own}
    return replace(plan, **own, settings=replace(plan.settings, **of_settings))


def without_live_values(plan: AxisPlan) -> AxisPlan:
    """Return a plan without its table and the other values that a running axis can get (``control``)."""
    is_off = plan.compensation is CompensationMode.OFF
    plan = with_limits(plan, dict.fromkeys(_NAMES, 0.0))
    return replace(
        plan,
        settings=replace(plan.settings, gain=Gain()),
        table=None,
        table_name="",
        table_format="",
        table_digest="",
        compensation=CompensationMode.OFF if is_off else CompensationMode.ON,  # a dry run may end
    )
