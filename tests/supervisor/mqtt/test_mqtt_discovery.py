"""What Home Assistant is told: as its documentation has it, and of topics and values that are there."""

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from gateway.compensation.units import Units
from gateway.exchange.status import COMPENSATION_STATES, DIRECTION_STATES
from gateway.supervisor.mqtt.discovery import TABLE, UNITS, discovery_messages
from gateway.supervisor.mqtt.messages import Payload, moving_message, moving_topics, retained_messages
from gateway.supervisor.mqtt.settings import Settings
from tests.mosquitto import broker_in, payload_of, watching
from tests.supervisor.mqtt.mqtt_bench import ROOT, axis, data_of, model, publishing, settings

SCHEMA = json.loads((Path(__file__).parent / "homeassistant_device.schema.json").read_text())
DEVICES = "homeassistant/device/pitch-gateway_mill-1"
# Home Assistant listens to topics of this form only (its documentation, "Discovery topic").
TOPIC = re.compile(r"homeassistant/device/(?:[a-zA-Z0-9_-]+/)?[a-zA-Z0-9_-]+/config")
THREE = {"x": axis(), "y": axis() | {"units": "inch"}, "c": axis() | {"units": "degree"}}


def given(folder: Path, **keys: Any) -> Settings:
    return settings(1883, folder, discovery="homeassistant", **keys)


def found(folder: Path, **keys: Any) -> dict[str, Payload]:
    return discovery_messages(given(folder, **keys), model(THREE))


def test_without_a_prefix_nothing_is_told(tmp_path: Path) -> None:
    assert discovery_messages(settings(1883, tmp_path), model(THREE)) == {}


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
    assert len(ids) == len(set(ids)) == 3 + 3 * 10


def test_a_misspelt_key_would_be_found(tmp_path: Path) -> None:
    payload = json.loads(json.dumps(found(tmp_path)[f"{DEVICES}/axis_x/config"]))
    payload["cmps"]["correction"]["unit"] = "mm"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(payload, SCHEMA)


def test_every_topic_and_every_value_that_is_named_is_published(tmp_path: Path) -> None:
    now = model(THREE)
    published: dict[str, Any] = dict(retained_messages(given(tmp_path), now))
    for topic, place in moving_topics(given(tmp_path).topics, now).items():
        published[topic] = moving_message(now, place)
    named = 0
    for payload in found(tmp_path).values():
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
    assert named > 30


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
    """DESIGN's words: as docs/mqtt.md lists them."""
    document = (Path(__file__).parents[3] / "docs" / "mqtt.md").read_text()
    for words in (COMPENSATION_STATES, DIRECTION_STATES, TABLE):
        assert ", ".join(f"`{word}`" for word in words) in document


def test_values_expire_after_some_intervals(tmp_path: Path) -> None:
    def expiry(interval_s: float) -> int:
        messages = found(tmp_path, interval_s=interval_s)
        return int(messages[f"{DEVICES}/axis_x/config"]["cmps"]["correction"]["expire_after"])

    assert (expiry(0.5), expiry(60.0)) == (15, 300)


async def test_descriptions_are_retained_and_go_with_their_axis(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        told = settings(broker.port, tmp_path, discovery="homeassistant")
        async with publishing(told, tmp_path) as site:
            site.feeds.publish(model(THREE))
            await site.until_said("mqtt-connected")
            async with watching(broker.port, f"{ROOT}/axis/x") as watcher:
                await watcher.until(f"{ROOT}/axis/x")
            async with watching(broker.port, "homeassistant/#") as watcher:
                for topic in sorted(discovery_messages(told, model(THREE))):
                    if topic not in watcher.topics():  # the broker hands them out in an order of its own
                        await watcher.until(topic)
                site.feeds.publish(model())
                gone = [
                    await watcher.until(f"{DEVICES}/axis_{name}/config", lambda p: not p) for name in "cy"
                ]
    retained = {m.topic.value: data_of(payload_of(m)) for m in watcher.heard if m.retain}
    assert retained == json.loads(json.dumps(discovery_messages(told, model(THREE))))
    assert [payload_of(message) for message in gone] == [b"", b""]
