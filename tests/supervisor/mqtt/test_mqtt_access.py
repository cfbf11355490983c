"""The broker configuration that comes with the gateway: who may write and read what."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.supervisor.mqtt.mqtt_bench import ROOT, model, publishing, settings
from tests.supervisor.mqtt.test_mqtt_connecting import password_file
from tests.support.mosquitto import Broker, BrokerLeftError, broker_in, payload_of, speaking, watching
from tests.support.status_models import model_of

DEPLOY = Path(__file__).parents[3] / "deploy" / "mosquitto"
PASSWORDS = {"mill-1": "one", "mill-2": "two", "viewer": "three", "operator": "four"}


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    """The files as they are, but for their folder, the port, and a block for a second gateway."""
    text = (DEPLOY / "mosquitto.conf").read_text()
    for old, new in (
        ("/etc/mosquitto/pitch-gateway.passwd", str(tmp_path / "passwd")),
        ("/etc/mosquitto/pitch-gateway.acl", str(tmp_path / "acl")),
        ("listener 1883 ", "listener {port} "),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    access = (DEPLOY / "pitch-gateway.acl").read_text()
    [block] = re.findall(r"^user mill-1\n(?:(?!user).*\n)*", access, re.MULTILINE)
    (tmp_path / "acl").write_text(access + block.replace("mill-1", "mill-2"))
    (tmp_path / "acl").chmod(0o600)
    password_file(tmp_path, **PASSWORDS)
    with broker_in(tmp_path, text) as broker:
        yield broker


def user(name: str) -> dict[str, Any]:
    return {"username": name, "password": PASSWORDS[name]}


async def heard_of(broker: Broker, writer: str, topics: list[str], reader: str = "viewer") -> list[str]:
    """Publish to topics as one user and return what another hears of it."""
    async with watching(broker.port, "#", **user(reader)) as watcher:
        for topic in topics:
            async with speaking(broker.port, **user(writer)) as client:
                await client.publish(topic, writer, qos=1)
        async with speaking(broker.port, **user("mill-2")) as client:
            await client.publish("pitch-gateway/mill-2/event", "end", qos=1)
        await watcher.until("pitch-gateway/mill-2/event")
    return [message.topic for message in watcher.heard if payload_of(message) != b"end"]


async def test_nobody_gets_in_without_a_password(broker: Broker) -> None:
    wrongs: list[dict[str, Any]] = [{}, {"username": "mill-1"}, {"username": "mill-1", "password": "two"}]
    for wrong in wrongs:
        with pytest.raises(BrokerLeftError, match="Not authorized"):
            async with speaking(broker.port, **wrong):
                pass


async def test_a_gateway_writes_its_own_topics_and_no_others(broker: Broker) -> None:
    own = [f"{ROOT}/axis/x", f"{ROOT}/event", "homeassistant/device/pitch-gateway_mill-1/axis_x/config"]
    others = [
        "pitch-gateway/mill-2/axis/x",
        "pitch-gateway/mill-2/command/disable",
        "pitch-gateway/mill-10/axis/x",
        "homeassistant/device/pitch-gateway_mill-2/axis_x/config",
        "homeassistant/switch/lamp/config",
        f"{ROOT}/command/disable",
        "anything",
    ]
    assert await heard_of(broker, "mill-1", [*own, *others]) == own


async def test_a_viewer_writes_nothing_and_an_operator_commands_only(broker: Broker) -> None:
    topics = [f"{ROOT}/command/disable", f"{ROOT}/axis/x", f"{ROOT}/event", "anything"]
    assert await heard_of(broker, "viewer", topics) == []
    assert await heard_of(broker, "operator", topics) == [f"{ROOT}/command/disable"]


async def test_a_gateway_hears_its_own_commands_and_nothing_else(broker: Broker) -> None:
    async with watching(broker.port, "#", **user("mill-1")) as watcher:
        for name, topic in (
            ("mill-1", f"{ROOT}/axis/x"),
            ("mill-2", "pitch-gateway/mill-2/axis/x"),
            ("operator", "pitch-gateway/mill-2/command/disable"),
            ("operator", f"{ROOT}/command/disable"),
        ):
            async with speaking(broker.port, **user(name)) as client:
                await client.publish(topic, "?", qos=1)
        await watcher.until(f"{ROOT}/command/disable")
    assert watcher.topics() == {f"{ROOT}/command/disable"}


@pytest.mark.parametrize("version", ["3.1.1", "5"])
async def test_the_gateway_has_everything_that_it_needs(tmp_path: Path, broker: Broker, version: str) -> None:
    (tmp_path / "password").write_text("one\n")
    (tmp_path / "password").chmod(0o600)
    given = settings(
        broker.port,
        tmp_path,
        version=version,
        username="mill-1",
        password_file="password",
        discovery="homeassistant",
        commands=True,
    )
    async with watching(broker.port, **user("viewer")) as watcher, publishing(given, tmp_path) as site:
        site.broadcast.publish(model_of(model()))
        await site.until_said("mqtt-connected")
        await watcher.until(f"{ROOT}/axis/x")
        async with speaking(broker.port, **user("operator")) as client:
            await client.publish(f"{ROOT}/command/enable", '{"axes": "all"}', qos=1)
        await watcher.until(f"{ROOT}/event", lambda payload: b'"mqtt-command"' in payload)
        assert len(site.asked) == 1
        assert site.status["problem"] is None
    await_all = {
        f"{ROOT}/availability",
        f"{ROOT}/info",
        f"{ROOT}/journal",
        f"{ROOT}/axis/x/table",
        f"{ROOT}/line/xyz",
        "homeassistant/device/pitch-gateway_mill-1/gateway/config",
        "homeassistant/device/pitch-gateway_mill-1/axis_x/config",
    }
    assert await_all <= watcher.topics()
