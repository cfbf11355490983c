"""The reference and the example know every key; the plan takes some as they are, and a reload some."""

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import field as declared
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
import pytest
from pydantic import BaseModel

from gateway.compensation.settings import AxisSettings, ThermalSettings
from gateway.config.axis_model import AxisSection
from gateway.config.findings import marks_at, models_in
from gateway.config.line_model import ControllerSection, DrivesEndpoint, LineSection
from gateway.config.load import load
from gateway.config.relay_model import RelaySection
from gateway.config.sections import NAMED, SINGLE, is_live
from gateway.config.terms_model import ThermalSpec
from gateway.drives.registers import RegisterMap
from gateway.drives.strict import Mark, Planned, StrictModel, marks_of, planned
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming
from gateway.state.plan import LinePlan, RelayOptions
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.limits import ConnectionLimits

ROOT = Path(__file__).parents[2]
REFERENCE = (ROOT / "docs" / "configuration.md").read_text()
EXAMPLE = ROOT / "deploy" / "gateway.example.toml"
PROFILE_EXAMPLE = ROOT / "deploy" / "gateway.profile.example.toml"


def fields_of(model: type[BaseModel], path: str) -> Iterator[tuple[str, str, str]]:
    for name, field in model.model_fields.items():
        yield path, name, field.description or ""
        for inside in models_in(field.annotation):
            yield from fields_of(inside, f"{path}.{name}")


FIELDS = [field for name, model in {**SINGLE, **NAMED}.items() for field in fields_of(model, name)]


@pytest.mark.parametrize(("path", "name", "description"), FIELDS, ids=[f"{f[0]}.{f[1]}" for f in FIELDS])
def test_every_key_is_in_the_reference_and_the_example(path: str, name: str, description: str) -> None:
    assert re.search(rf"`{name}`|\b{name} = |[{{ ]{name}[ ,}}]", REFERENCE), (
        f"{path}.{name} is not in the reference"
    )
    assert re.search(rf"\b{name}\b", EXAMPLE.read_text()), f"{path}.{name} is not in the example"
    assert description, f"{path}.{name} says nothing about itself"


@pytest.mark.parametrize("name", [*SINGLE, *NAMED])
def test_every_section_has_a_heading_in_the_reference(name: str) -> None:
    assert re.search(rf"^## `\[{name}(\.NAME)?\]`$", REFERENCE, re.MULTILINE)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The examples, where a path is short enough for the sockets that belong to them."""
    return shutil.copytree(EXAMPLE.parent, tmp_path / "deploy")


def test_the_example_has_nothing_wrong_and_nothing_to_warn_of(folder: Path) -> None:
    result = load(folder / EXAMPLE.name)
    assert result.warnings == ()
    assert [axis.table_name for line in result.plan.lines for axis in line.axes] == ["cnc10x.tab"]


def test_the_example_of_known_drives_is_a_gantry_with_nothing_to_warn_of(folder: Path) -> None:
    result = load(folder / PROFILE_EXAMPLE.name)
    assert result.warnings == ()
    [line] = result.plan.lines
    assert line.groups == (("y1", "y2"),)
    assert [axis.drive for axis in line.axes] == ["oriental-az", "oriental-az"]
    assert [axis.table_name for axis in line.axes] == ["gantry-y1.tab", "gantry-y2.tab"]
    assert [link.plan.role.value for link in line.controllers] == ["motion", "operator"]


def test_the_example_as_it_stands_with_its_defaults_written_out(folder: Path) -> None:
    """A default that the example shows behind a # may be uncommented and changes nothing."""
    text = EXAMPLE.read_text()
    for key in (
        "zero_counts",
        "machine_offset",
        "gain",
        "hysteresis",
        "outside",
        "fresh_ms",
        "in_position",
        "unseen_ms",
        "repeat_within",
        "max_correction",
        "max_slope",
        "travel_margin",
        "added_frames",
        "unmapped",
        "stored_moves",
        "relative_unknown",
        "write",
        "exception",
        "safe_read",
        "checks_crc",
        "max_registers",
        "response_timeout_ms",
        "turnaround_ms",
        "quiet_ms",
        "monitor_max_wait_ms",
        "budget_us",
        "state",
    ):
        text, count = re.subn(rf"^# ({key} = )", r"\1", text, flags=re.MULTILINE)
        assert count == 1, f"{key} stands {count} times behind a #"
    path = folder / "gateway.toml"
    path.write_text(text)
    assert load(path).plan == load(folder / EXAMPLE.name).plan


@pytest.mark.parametrize(
    ("key", "said"),
    [("state", ["`relay.sock`"]), ("hysteresis", ["`stream`:", "`targets`:", "measured position"])],
)
def test_the_reference_says_what_a_key_does(key: str, said: list[str]) -> None:
    (row,) = re.findall(rf"^\| `{key}` \|.*$", REFERENCE, re.MULTILINE)
    assert all(words in row for words in said)


# Keys that the plan takes as they are: marked in their model, and there under the same name and type.


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
    size: int = declared(default=0, kw_only=True)


class PlanOfStruct(msgspec.Struct, kw_only=True):
    size: int = 0


@pytest.mark.parametrize("plan", [Plan, PlanOfStruct])
def test_a_field_that_a_plan_takes_by_its_name_only_is_not_left_at_its_default(plan: type[Any]) -> None:
    assert planned(plan, Section(size=7)) == {"size": 7}


# Keys that a reload takes over while the gateway runs (docs/operations.md).


@pytest.mark.parametrize(
    "key",
    [
        "axis.x.table",
        "axis.x.table_options.file_start",
        "axis.x.compensation",
        "axis.x.gain",
        "axis.x.gain.backward",
        "axis.x.max_correction",
        "axis.x.max_slope",
        "axis.x.travel_margin",
        "axis.x.budget_us",
        "axis.x.thermal.source.mqtt",
        "line.xyz.controllers[1].silent_after_s",
        "gateway.tables",
        "http",
        "http.tokens[2].file",
        "mqtt.tls.ca",
        "capture.on[1]",
        "capture.keep",
    ],
)
def test_a_reload_takes_over_what_the_relay_can_be_given_and_what_only_the_supervisor_needs(key: str) -> None:
    assert is_live(key)


@pytest.mark.parametrize(
    "key",
    [
        "axis.x",
        "axis.x.unit_id",
        "axis.x.travel[1]",
        "axis.x.unseen_ms",
        "axis.x.thermal.alpha",
        "axis.table",
        "line.xyz.controllers[1].timeout_ms",
        "line.xyz.cut_through",
        "gateway.state",
        "relay.fifo",
        "capture.size_mb",
        "status_unit.id",
        "tables",
    ],
)
def test_everything_else_needs_a_restart(key: str) -> None:
    assert not is_live(key)


def test_of_the_keys_that_name_a_file_those_of_secrets_are_marked() -> None:
    is_secret = {
        f"{path}.{key}": Mark.SECRET in marks_at(model, (*path.split(".")[1:], key))
        for kind, model in {**SINGLE, **NAMED}.items()
        for path, key, about in fields_of(model, kind)
        if about.startswith("file ")
    }
    assert {key for key, secret in is_secret.items() if secret} == {
        *("http.tokens.file", "http.tls.key", "line.controllers.tls.key"),
        *("mqtt.password_file", "mqtt.tls.key"),
    }
    assert {key for key, secret in is_secret.items() if not secret} == {
        "gateway.allowed_signers",
        *("http.tls.certificate", "http.tls.clients", "http.tls.revoked", "mqtt.tls.ca", "mqtt.tls.cert"),
        *(f"line.controllers.tls.{key}" for key in ("certificate", "clients", "revoked")),
    }
