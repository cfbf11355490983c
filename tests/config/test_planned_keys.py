"""Keys that the plan takes as they are: marked in their model, and there under the same name and type."""

from typing import Any, get_type_hints

import pytest

from gateway.compensation.settings import AxisSettings, ThermalSettings
from gateway.config.axis_model import AxisSection
from gateway.config.line_model import ControllerSection, DrivesEndpoint, LineSection
from gateway.config.relay_model import RelaySection
from gateway.config.terms_model import ThermalSpec
from gateway.drives.registers import RegisterMap
from gateway.drives.strict import Mark, StrictModel
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming
from gateway.state.plan import LinePlan, RelayOptions
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.limits import ConnectionLimits

PLANS: dict[type[StrictModel], tuple[type[Any], ...]] = {
    AxisSection: (AxisPlan, AxisSettings),
    RegisterMap: (AxisPlan,),
    ThermalSpec: (ThermalSettings,),
    LineSection: (LinePlan, LineTiming),
    ControllerSection: (ControllerPlan, ConnectionLimits, SerialEndpoint),
    DrivesEndpoint: (SerialEndpoint,),
    RelaySection: (RelayOptions,),
}
WORKED_OUT = {
    "LineSection.gap_ms",  # the longest of the line's and its drives'
    "ControllerSection.role",  # with tls the one of its roles that may do most
}


def wanted(plans: tuple[type[Any], ...]) -> dict[str, list[Any]]:
    """Return the types of the fields of plans, by name."""
    hints = [get_type_hints(plan) for plan in plans]
    return {name: [each[name] for each in hints if name in each] for each in hints for name in each}


@pytest.mark.parametrize("model", PLANS)
def test_a_key_that_is_planned_is_in_one_plan_with_the_same_type(model: type[StrictModel]) -> None:
    types, fields = get_type_hints(model), wanted(PLANS[model])
    planned = [key for key, field in model.model_fields.items() if Mark.PLANNED in field.metadata]
    assert planned
    assert {key: fields.get(key) for key in planned} == {key: [types[key]] for key in planned}


@pytest.mark.parametrize("model", PLANS)
def test_no_key_is_forgotten_that_a_plan_has_with_the_same_type(model: type[StrictModel]) -> None:
    types, fields = get_type_hints(model), wanted(PLANS[model])
    forgotten = {
        f"{model.__name__}.{key}"
        for key, field in model.model_fields.items()
        if types[key] in fields.get(key, ()) and Mark.PLANNED not in field.metadata
    }
    assert forgotten <= WORKED_OUT
