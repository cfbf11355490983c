"""What Home Assistant is told: as its documentation has it, and of topics and values that are there."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from jinja2.sandbox import ImmutableSandboxedEnvironment

from gateway.compensation.units import Units
from gateway.exchange.commands import Disable, Enable
from gateway.exchange.status_words import COMPENSATION_STATES, DIRECTION_STATES, TERM_STATES
from gateway.supervisor.mqtt.discovery import TABLE, UNITS, discovery_messages
from gateway.supervisor.mqtt.interfaces import Payload
from gateway.supervisor.mqtt.sending import moving_message, moving_topics, retained_messages
from gateway.supervisor.mqtt.settings import Settings
from tests.supervisor.mqtt.mqtt_bench import ROOT, axis, data_of, model, publishing, settings, terms
from tests.support.mosquitto import broker_in, payload_of, watching
from tests.support.status_models import model_of

SCHEMA = json.loads((Path(__file__).parent / "homeassistant_device.schema.json").read_text())
DEVICES = "homeassistant/device/pitch-gateway_mill-1"
# Home Assistant listens to topics of this form only (its documentation, "Discovery topic").
TOPIC = re.compile(r"homeassistant/device/(?:[a-zA-Z0-9_-]+/)?[a-zA-Z0-9_-]+/config")
WARM = {"x": axis() | {"terms": terms()}}
THREE = {"x": axis(), "y": axis() | {"units": "inch"}, "c": axis() | {"units": "degree"}}


def given(folder: Path, **keys: Any) -> Settings:
    return settings(1883, folder, discovery="homeassistant", **keys)


def found(folder: Path, **keys: Any) -> dict[str, Payload]:
    return discovery_messages(given(folder, **keys), model_of(model(THREE)))


def test_without_a_prefix_nothing_is_told(tmp_path: Path) -> None:
    assert discovery_messages(settings(1883, tmp_path), model_of(model(THREE))) == {}


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("base", ["pitch-gateway", "plant/hall 2"])
def test_one_device_for_the_gateway_and_one_for_each_axis(tmp_path: Path, base: str) -> None:
    messages = found(tmp_path, base_topic=base)
    assert len(messages) == 4
    for topic, payload in messages.items():
        assert TOPIC.fullmatch(topic), topic
        jsonschema.validate(json.loads(json.dumps(payload)), SCHEMA)
    ids = [entity["unique_id"] for payload in messages.values() for entity in payload["cmps"].values()]
    assert len(ids) == len(set(ids)) == 5 + 3 * 11


def test_a_misspelt_key_would_be_found(tmp_path: Path) -> None:
    payload = json.loads(json.dumps(found(tmp_path)[f"{DEVICES}/axis_x/config"]))
    payload["cmps"]["correction"]["unit"] = "mm"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(payload, SCHEMA)


@pytest.mark.parametrize(("axes", "least"), [(THREE, 30), (WARM, 15)])
def test_every_topic_and_every_value_that_is_named_is_published(
    tmp_path: Path, axes: dict[str, Any], least: int
) -> None:
    now = model(axes)
    published: dict[str, Any] = dict(retained_messages(given(tmp_path), model_of(now)))
    for topic, place in moving_topics(given(tmp_path).topics, model_of(now)).items():
        published[topic] = moving_message(model_of(now), place)
    named = 0
    for payload in discovery_messages(given(tmp_path), model_of(now)).values():
        assert payload["availability"][0] == {"topic": f"{ROOT}/availability"}
        for entity in payload["cmps"].values():
            here = published[entity["state_topic"]]
            paths = re.findall(r"value_json((?:\.[a-z_0-9]+)+)", entity["value_template"])
            assert paths, entity
            for path in paths:
                value = here
                for key in path[1:].split("."):
                    value = value[key] if key in value else pytest.fail(f"{entity['state_topic']}: no {path}")
                named += 1
            if "options" in entity:
                assert value in entity["options"]
    assert named > least


def test_what_is_added_to_a_table_is_a_message_of_its_own_of_the_same_device(tmp_path: Path) -> None:
    told = discovery_messages(given(tmp_path), model_of(model(WARM)))
    assert sorted(told) == [f"{DEVICES}/{one}/config" for one in ("axis_x", "gateway", "terms_x")]
    of_terms, of_axis = told[f"{DEVICES}/terms_x/config"], told[f"{DEVICES}/axis_x/config"]
    jsonschema.validate(json.loads(json.dumps(of_terms)), SCHEMA)
    assert {**of_terms, "cmps": None} == {**of_axis, "cmps": None}
    assert of_axis == discovery_messages(given(tmp_path), model_of(model()))[f"{DEVICES}/axis_x/config"]
    ids = [one["unique_id"] for payload in told.values() for one in payload["cmps"].values()]
    assert len(ids) == len(set(ids)) == 5 + 11 + 5
    temperature = of_terms["cmps"]["temperature"]
    assert (temperature["unit_of_measurement"], temperature["device_class"]) == ("°C", "temperature")
    added = of_terms["cmps"]["thermal_added"]
    assert (added["unit_of_measurement"], added["device_class"]) == ("mm", "distance")


@pytest.mark.parametrize(
    ("left", "entities"),
    [
        ("thermal", {"temperature", "thermal_added", "thermal_state"}),
        ("cross", {"cross_added", "cross_state"}),
    ],
)
def test_only_the_term_that_is_there_is_described(tmp_path: Path, left: str, entities: set[str]) -> None:
    only = {key: value for key, value in terms().items() if key not in {"thermal", "cross"} or key == left}
    told = discovery_messages(given(tmp_path), model_of(model({"x": axis() | {"terms": only}})))
    assert set(told[f"{DEVICES}/terms_x/config"]["cmps"]) == entities


@pytest.mark.parametrize("without", [{}, {"terms": None}])
def test_an_axis_without_terms_has_no_such_message(tmp_path: Path, without: dict[str, Any]) -> None:
    told = discovery_messages(given(tmp_path), model_of(model({"x": axis() | without})))
    assert sorted(told) == [f"{DEVICES}/axis_x/config", f"{DEVICES}/gateway/config"]


def test_units_of_each_kind_of_axis(tmp_path: Path) -> None:
    messages = found(tmp_path)
    said = {
        name: (entity["unit_of_measurement"], entity.get("device_class"))
        for name in THREE
        for entity in [messages[f"{DEVICES}/axis_{name}/config"]["cmps"]["correction"]]
    }
    assert said == {"x": ("mm", "distance"), "y": ("in", "distance"), "c": ("°", None)}
    assert set(UNITS) == {units.value for units in Units}


def test_the_choices_are_those_that_the_status_can_show() -> None:
    """As docs/messages.md lists them."""
    document = (Path(__file__).parents[3] / "docs" / "messages.md").read_text()
    sections = re.findall(r"^`axes\.NAME\.([\w.]+)`:\n(.*?)(?=^`|^<)", document, re.DOTALL | re.MULTILINE)
    listed = {field: sorted(re.findall(r"^\| `([\w-]+)` \|", rows, re.MULTILINE)) for field, rows in sections}
    assert listed == {
        "compensation": sorted(COMPENSATION_STATES),
        "direction": sorted(DIRECTION_STATES),
        "table.status": sorted(TABLE),
        "terms.thermal.state": sorted(TERM_STATES),
        "terms.cross.state": sorted(TERM_STATES),
    }


def test_values_expire_after_some_intervals(tmp_path: Path) -> None:
    def expiry(interval_s: float) -> int:
        messages = found(tmp_path, interval_s=interval_s)
        return int(messages[f"{DEVICES}/axis_x/config"]["cmps"]["correction"]["expire_after"])

    assert (expiry(0.5), expiry(60.0)) == (15, 300)


async def test_descriptions_are_retained_and_go_with_their_axis(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        told = settings(broker.port, tmp_path, discovery="homeassistant")
        async with publishing(told, tmp_path) as site:
            site.broadcast.publish(model_of(model(THREE)))
            await site.until_said("mqtt-connected")
            async with watching(broker.port, f"{ROOT}/axis/x") as watcher:
                await watcher.until(f"{ROOT}/axis/x")
            async with watching(broker.port, "homeassistant/#") as watcher:
                for topic in sorted(discovery_messages(told, model_of(model(THREE)))):
                    if topic not in watcher.topics():  # the broker hands them out in an order of its own
                        await watcher.until(topic)
                site.broadcast.publish(model_of(model()))
                gone = [
                    await watcher.until(f"{DEVICES}/axis_{name}/config", lambda p: not p) for name in "cy"
                ]
    retained = {m.topic: data_of(payload_of(m)) for m in watcher.heard if m.retain}
    assert retained == json.loads(json.dumps(discovery_messages(told, model_of(model(THREE)))))
    assert [payload_of(message) for message in gone] == [b"", b""]


async def test_what_is_added_goes_from_the_broker_when_an_axis_has_it_no_more(tmp_path: Path) -> None:
    topic = f"{DEVICES}/terms_x/config"
    with broker_in(tmp_path) as broker:
        told = settings(broker.port, tmp_path, discovery="homeassistant")
        async with publishing(told, tmp_path) as site:
            site.broadcast.publish(model_of(model(WARM)))
            await site.until_said("mqtt-connected")
            async with watching(broker.port) as watcher:
                there = await watcher.until(topic)
                moving = await watcher.until(f"{ROOT}/axis/x")
                site.broadcast.publish(model_of(model()))  # as after a restart with another configuration
                await watcher.until(topic, lambda payload: not payload)
    assert data_of(payload_of(there))["cmps"]["temperature"]["p"] == "sensor"
    warm = terms()
    warm["thermal"]["age_s"] += 0.1  # the age of the report
    assert data_of(payload_of(moving))["terms"] == warm


COMMANDS_OF_X = {f"{DEVICES}/commands/config", f"{DEVICES}/commands_x/config"}


def test_buttons_and_switches_are_there_only_where_commands_are_allowed(tmp_path: Path) -> None:
    without = discovery_messages(given(tmp_path), model_of(model()))
    told = discovery_messages(given(tmp_path, commands=True), model_of(model()))
    assert set(told) - set(without) == COMMANDS_OF_X
    assert {topic: told[topic] for topic in without} == without
    for topic, payload in told.items():
        assert TOPIC.fullmatch(topic), topic
        jsonschema.validate(json.loads(json.dumps(payload)), SCHEMA)
    # Of the same devices, and with ids of their own.
    for commands, of in (("commands", "gateway"), ("commands_x", "axis_x")):
        assert {**told[f"{DEVICES}/{commands}/config"], "cmps": None} == {
            **told[f"{DEVICES}/{of}/config"],
            "cmps": None,
        }
    ids = [one["unique_id"] for payload in told.values() for one in payload["cmps"].values()]
    assert len(ids) == len(set(ids))


@pytest.mark.parametrize("state", COMPENSATION_STATES)
def test_the_switch_shows_whether_the_axis_is_off(tmp_path: Path, state: str) -> None:
    told = discovery_messages(given(tmp_path, commands=True), model_of(model()))
    switch = told[f"{DEVICES}/commands_x/config"]["cmps"]["switch"]
    for is_on in (True, False):
        shown = rendered(switch["value_template"], {"compensation": state, "is_enabled": is_on})
        assert shown == switch["state_on" if is_on else "state_off"]
    shown = rendered(switch["value_template"], {"compensation": state})  # from an older release
    assert shown == (switch["state_off"] if state == "off" else switch["state_on"])


async def test_what_a_button_and_a_switch_send_is_carried_out(tmp_path: Path) -> None:
    """As Home Assistant sends it: the payload of the description to its topic."""
    with broker_in(tmp_path) as broker:
        told = settings(broker.port, tmp_path, discovery="homeassistant", commands=True)
        async with watching(broker.port) as watcher, publishing(told, tmp_path) as site:
            site.broadcast.publish(model_of(model()))
            described = [
                data_of(payload_of(await watcher.until(topic)))["cmps"] for topic in sorted(COMMANDS_OF_X)
            ]
            await site.until_said("mqtt-connected")
            reload, switch = described[0]["reload"], described[1]["switch"]
            for number, (entity, payload) in enumerate(
                ((switch, "payload_off"), (switch, "payload_on"), (reload, "payload_press")), start=1
            ):
                await watcher.client.publish(entity["command_topic"], entity[payload], qos=1)
                answer = await site.until_said("mqtt-command", number)
                assert answer["result"] == "done"
    assert site.asked == [Disable(axes=("x",)), Enable(axes=("x",))]
    assert site.reloads == 1


async def test_buttons_and_switches_go_from_the_broker_when_commands_are_switched_off(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        told = settings(broker.port, tmp_path, discovery="homeassistant", commands=True)
        without = settings(broker.port, tmp_path, discovery="homeassistant")
        async with watching(broker.port, "homeassistant/#") as watcher, publishing(told, tmp_path) as site:
            site.broadcast.publish(model_of(model()))
            for topic in sorted(COMMANDS_OF_X):
                await watcher.until(topic, lambda payload: payload != b"")
            site.service.follow(without)  # as a reload does
            site.broadcast.publish(model_of(model()))
            for topic in sorted(COMMANDS_OF_X):
                await watcher.until(topic, lambda payload: payload == b"")
            async with watching(broker.port, "homeassistant/#") as later:
                for topic in sorted(discovery_messages(without, model_of(model()))):
                    if topic not in later.topics():
                        await later.until(topic)
    assert later.topics() == set(discovery_messages(without, model_of(model())))


def test_the_project_s_address_is_that_of_pyproject(tmp_path: Path) -> None:
    """Declared once: what was built says it."""
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    origins = [payload["o"] for payload in found(tmp_path).values()]
    assert {origin["support_url"] for origin in origins} == {project["urls"]["Source"]}


def rendered(template: str, value: Payload) -> str:
    """As Home Assistant renders it: in Jinja's sandbox."""
    return ImmutableSandboxedEnvironment().from_string(template).render(value_json=value)


@pytest.mark.parametrize(
    ("troubles", "of_gateway", "of_axis"),
    [
        ([], "OFF", "OFF"),
        ([{"axes": ["x"]}], "ON", "ON"),
        ([{"axes": ["y"]}], "ON", "OFF"),
        ([{"axes": []}], "ON", "OFF"),
        ([{"axes": []}, {"axes": ["y", "x"]}], "ON", "ON"),
    ],
)
def test_a_problem_is_one_of_the_gateway_and_of_the_axes_that_it_is_about(
    tmp_path: Path, troubles: list[Payload], of_gateway: str, of_axis: str
) -> None:
    messages = found(tmp_path)
    info = {"troubles": troubles}
    gateway = messages[f"{DEVICES}/gateway/config"]["cmps"]["problem"]["value_template"]
    axis_x = messages[f"{DEVICES}/axis_x/config"]["cmps"]["problem"]["value_template"]
    assert (rendered(gateway, info), rendered(axis_x, info)) == (of_gateway, of_axis)
