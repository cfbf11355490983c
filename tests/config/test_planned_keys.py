"""Keys that the plan takes as they are: marked in their model, and there under the same name and type."""

from dataclasses import dataclass, field
from typing import Any, get_type_hints

import msgspec
import pytest

from gateway.compensation.settings import AxisSettings, ThermalSettings
from gateway.config.axis_model import AxisSection
from gateway.config.line_model import ControllerSection, DrivesEndpoint, LineSection
from gateway.config.relay_model import RelaySection
from gateway.config.terms_model import ThermalSpec
from gateway.drives.registers import RegisterMap
from gateway.drives.strict import Mark, Planned, StrictModel, marks_of, planned
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
    marked = [key for key, marks in marks_of(model).items() if Mark.PLANNED in marks]
    assert marked
    assert {key: fields.get(key) for key in marked} == {key: [types[key]] for key in marked}


@pytest.mark.parametrize("model", PLANS)
def test_no_key_is_forgotten_that_a_plan_has_with_the_same_type(model: type[StrictModel]) -> None:
    types, fields = get_type_hints(model), wanted(PLANS[model])
    forgotten = {
        f"{model.__name__}.{key}"
        for key in model.model_fields
        if types[key] in fields.get(key, ()) and Mark.PLANNED not in marks_of(model)[key]
    }
    assert forgotten <= WORKED_OUT


class Section(StrictModel):
    size: Planned[int] = 1


@dataclass
class Plan:
    size: int = field(default=0, kw_only=True)


class PlanOfStruct(msgspec.Struct, kw_only=True):
    size: int = 0


@pytest.mark.parametrize("plan", [Plan, PlanOfStruct])
def test_a_field_that_a_plan_takes_by_its_name_only_is_not_left_at_its_default(plan: type[Any]) -> None:
    assert planned(plan, Section(size=7)) == {"size": 7}
