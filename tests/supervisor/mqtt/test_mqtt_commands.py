"""What may be commanded over MQTT, only where it is allowed, and the answer that each command gets."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from paho.mqtt.enums import MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from gateway.exchange.commands import Disable, Enable, SetGain
from gateway.ipc.client import NobodyListensError
from gateway.ipc.messages import Done, Request
from gateway.supervisor.mqtt.commands import carry_out
from gateway.supervisor.mqtt.interfaces import Orders
from gateway.supervisor.outcome import ReloadOutcome
from tests.soak import repeated
from tests.supervisor.mqtt.mqtt_bench import ROOT, Site, data_of, model, publishing, settings
from tests.support.mosquitto import ANYBODY, PATIENCE_S, Watcher, broker_in, payload_of, watching
from tests.support.status_models import model_of

VERSIONS = pytest.mark.parametrize("version", ["3.1.1", "5"])


async def nothing() -> ReloadOutcome:
    raise AssertionError("nobody asked for a reload")


async def answered(
    command: str, payload: bytes, reply: Done | None = None
) -> tuple[list[Request], dict[str, Any]]:
    asked: list[Request] = []

    def ask(request: Request) -> Done:
        asked.append(request)
        return reply or Done(changed=("x",))

    return asked, (await carry_out(command, payload, Orders(nothing, ask))).as_data()


@pytest.mark.parametrize(
    ("command", "payload", "request_"),
    [
        ("enable", {"axes": ["x", "y"]}, Enable(axes=("x", "y"))),
        ("enable", {"axes": "all"}, Enable(axes=())),
        ("disable", {"axes": ["x"], "id": 7}, Disable(axes=("x",))),
        ("switch", {"axes": ["x"], "on": True}, Enable(axes=("x",))),
        ("switch", {"axes": "all", "on": False}, Disable(axes=())),
        (
            "gain",
            {"axes": ["x"], "forward": 1, "backward": 0.5},
            SetGain(axes=("x",), forward=1.0, backward=0.5),
        ),
        ("gain", {"axes": "all", "forward": 0, "backward": 0}, SetGain(forward=0.0, backward=0.0)),
    ],
)
async def test_a_command_becomes_a_request(command: str, payload: dict[str, Any], request_: Request) -> None:
    asked, answer = await answered(command, json.dumps(payload).encode())
    assert asked == [request_]
    assert answer == {
        "command": command,
        "asked": payload,
        "id": payload.get("id"),
        "result": "done",
        "changed": ["x"],
        "comes": {},
        "keys": [],
        "problems": [],
    }


@pytest.mark.parametrize(
    ("command", "payload", "said"),
    [
        ("enable", b"", "missing required field `axes`"),
        ("enable", b"{}", "missing required field `axes`"),
        ("enable", b'{"axes": []}', 'allowed: {"axes": ["x"]}'),
        ("enable", b'{"axes": "x"}', 'allowed: {"axes": ["x"]}'),
        ("enable", b'{"axes": ["x"], "force": true}', "unknown field `force`"),
        ("disable", b'["x"]', "Expected `object`"),
        ("disable", b"off", "malformed"),
        ("disable", b"\xff\xfe", "malformed"),
        ("disable", b"[" * 4000, "allowed:"),
        ("switch", b'{"axes": ["x"]}', "missing required field `on`"),
        ("switch", b'{"axes": ["x"], "on": "false"}', 'allowed: {"axes": ["x"], "on": true or false}'),
        ("gain", b'{"axes": ["x"], "forward": 1.5, "backward": 1}', "forward"),
        ("gain", b'{"axes": ["x"], "forward": 1}', "backward"),
        ("gain", b'{"axes": ["x"], "forward": NaN, "backward": 1}', "malformed"),
        ("gain", b'{"axes": ["x"], "forward": true, "backward": 1}', "forward"),
        ("reload", b'{"now": true}', "unknown field `now`"),
        ("enable", b" " * 5000, "more than 4096 bytes"),
        ("move", b"{}", "there is no command move; there are reload, enable, disable, switch, gain"),
    ],
)
async def test_what_is_malformed_is_refused_with_what_is_allowed(
    command: str, payload: bytes, said: str
) -> None:
    asked, answer = await answered(command, payload)
    assert asked == []
    assert answer["result"] == "refused"
    [problem] = answer["problems"]
    assert said in problem
    assert len(str(answer["asked"])) <= 200


@pytest.mark.parametrize(
    ("command", "payload", "id_"),
    [
        ("gain", b'{"axes": ["x"], "forward": 1.5, "backward": 1, "id": 7}', 7),
        ("enable", b'{"axes": ["x"], "force": true, "id": "a"}', "a"),
        ("move", b'{"id": "a"}', "a"),
        ("enable", b'{"axes": ["x"], "id": [1]}', None),
        ("enable", b'{"id": "' + b"a" * 65 + b'"}', None),
        ("enable", b'[{"id": 7}]', None),
        ("enable", b'{"id": 7', None),
    ],
)
async def test_a_refusal_has_the_id_of_its_command(command: str, payload: bytes, id_: object) -> None:
    _, answer = await answered(command, payload)
    assert (answer["result"], answer["id"]) == ("refused", id_)


async def test_what_the_relay_refuses_is_answered_with_its_reason() -> None:
    _, answer = await answered("enable", b'{"axes": ["q"]}', Done(problems=("axis q: there is none",)))
    assert (answer["result"], answer["problems"]) == ("refused", ["axis q: there is none"])
    _, answer = await answered("enable", b'{"axes": ["x", "q"]}', Done(changed=("x",), problems=("no q",)))
    assert (answer["result"], answer["changed"]) == ("partly", ["x"])


async def test_without_a_relay_the_answer_says_so() -> None:
    def ask(request: Request) -> Done:
        raise NobodyListensError("no gateway runs")

    answer = await carry_out("disable", b'{"axes": "all"}', Orders(nothing, ask))
    assert (answer.result, answer.problems) == ("refused", ("no gateway runs",))


@contextlib.asynccontextmanager
async def commanding(folder: Path, config: str = ANYBODY, **keys: Any) -> AsyncIterator[tuple[Watcher, Site]]:
    """A gateway that takes commands, and somebody who hears what it says of them."""
    with broker_in(folder, config) as broker:
        given = settings(broker.port, folder, commands=True, **keys)
        async with watching(broker.port, f"{ROOT}/event") as watcher, publishing(given, folder) as site:
            await site.until_said("mqtt-connected")
            yield watcher, site


async def command(watcher: Watcher, name: str, payload: Any, **options: Any) -> None:
    await watcher.client.publish(f"{ROOT}/command/{name}", json.dumps(payload), qos=1, **options)


async def answer_to(watcher: Watcher, identity: Any) -> dict[str, Any]:
    message = await watcher.until(
        f"{ROOT}/event",
        lambda payload: data_of(payload)["event"] == "mqtt-command" and data_of(payload)["id"] == identity,
    )
    data: dict[str, Any] = data_of(payload_of(message))
    return data


@VERSIONS
async def test_each_command_is_answered_by_an_event(tmp_path: Path, version: str) -> None:
    async with commanding(tmp_path, version=version) as (watcher, site):
        await command(watcher, "disable", {"axes": ["x"], "id": "a"})
        assert (await answer_to(watcher, "a"))["comes"] == {"x": "next-target"}
        await command(watcher, "reload", {"id": "b"})
        reloaded = await answer_to(watcher, "b")
        await command(watcher, "gain", {"axes": ["x"], "id": "c"})
        assert (await answer_to(watcher, "c"))["result"] == "refused"
    assert site.asked == [Disable(axes=("x",))]
    assert site.reloads == 1
    assert (reloaded["result"], reloaded["comes"], reloaded["keys"]) == (
        "done",
        {"x": "blended"},
        ["axis.x.gain"],
    )
    assert (reloaded["severity"], reloaded["command"]) == ("info", "reload")


async def test_without_commands_in_the_configuration_nobody_listens(tmp_path: Path) -> None:
    with broker_in(tmp_path, f"{ANYBODY}log_type all\n") as broker:
        async with publishing(settings(broker.port, tmp_path), tmp_path) as site:
            await site.until_said("mqtt-connected")
            async with watching(broker.port, f"{ROOT}/#", identifier="me") as watcher:
                await command(watcher, "disable", {"axes": "all"})
                site.broadcast.publish(model_of(model()))
                await watcher.until(f"{ROOT}/axis/x")
        assert "Received SUBSCRIBE from me" in broker.log
        assert "Received SUBSCRIBE from pitch-gateway" not in broker.log
    assert site.asked == []
    assert site.said("mqtt-command") == []


@VERSIONS
async def test_a_retained_command_is_not_obeyed_and_that_is_said_once(tmp_path: Path, version: str) -> None:
    with broker_in(tmp_path) as broker:
        async with watching(broker.port, f"{ROOT}/event") as watcher:
            await command(watcher, "disable", {"axes": "all"}, retain=True)
            given = settings(broker.port, tmp_path, version=version, commands=True)
            async with publishing(given, tmp_path) as site:
                said = await site.until_said("mqtt-command-ignored")
                await command(watcher, "enable", {"axes": "all", "id": 1})
                await answer_to(watcher, 1)
                broker.stop()
                broker.start()
                await site.until_said("mqtt-connected", times=2)
    assert site.asked == [Enable()]
    assert len(site.said("mqtt-command-ignored")) == 1
    assert said["command"] == "disable"
    assert said["detail"].endswith(f"mosquitto_pub -r -n -t {ROOT}/command/disable")


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("it's; reboot", f"""-t '{ROOT}/command/it'"'"'s; reboot'"""),
        ("n" * 300, "which cannot be typed ('pitch-gateway/mill-1/command/nnn"),
    ],
)
async def test_a_stranger_s_topic_can_be_typed_or_is_not_shown_as_a_command(
    tmp_path: Path, name: str, shown: str
) -> None:
    with broker_in(tmp_path) as broker:
        async with watching(broker.port, f"{ROOT}/event") as watcher:
            await command(watcher, name, {}, retain=True)
            async with publishing(settings(broker.port, tmp_path, commands=True), tmp_path) as site:
                said = await site.until_said("mqtt-command-ignored")
    assert shown in said["detail"]


async def test_with_version_5_the_answer_goes_where_the_asker_wants_it(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        given = settings(broker.port, tmp_path, version="5", commands=True)
        async with (
            publishing(given, tmp_path) as site,
            watching(broker.port, version=MQTTProtocolVersion.MQTTv5) as watcher,
        ):
            await site.until_said("mqtt-connected")
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.ResponseTopic = "me/answers"
            properties.CorrelationData = b"\x00\x01"
            await command(watcher, "enable", {"axes": "all"}, properties=properties)
            message = await watcher.until("me/answers")
            assert getattr(message.properties, "CorrelationData", None) == b"\x00\x01"
            assert data_of(payload_of(message))["result"] == "done"
            # An answer that would be a command again goes nowhere but into the event.
            properties.ResponseTopic = f"{ROOT}/command/enable"
            await command(watcher, "enable", {"axes": "all", "id": 5}, properties=properties)
            await answer_to(watcher, 5)
            await command(watcher, "enable", {"axes": "all", "id": 6})
            await answer_to(watcher, 6)
    assert site.asked == [Enable()] * 3
    assert len(site.said("mqtt-command")) == 3


async def test_a_flood_is_answered_once_and_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.supervisor.mqtt.commands.PER_S", 1e-6)
    async with commanding(tmp_path) as (watcher, site):
        for number in range(30):
            await command(watcher, "enable", {"axes": "all", "id": number})
        flooded = await answer_to(watcher, 10)
        commander = site.publisher._commander
        async with asyncio.timeout(PATIENCE_S):
            while commander._missed < 20:  # noqa: ASYNC110 - nothing is told of these
                await asyncio.sleep(0)
        await site.until_said("mqtt-commands-too-many")
        commander._rate.give_back()  # as if its time had gone by
        await command(watcher, "enable", {"axes": "all", "id": "after"})
        after = await answer_to(watcher, "after")
    assert len(site.asked) == 11
    assert flooded["problems"][0].startswith("too many commands: at most 10 at once")
    assert after["ignored_before"] == 20
    [told] = site.said("mqtt-commands-too-many")
    assert (told["count"], told["last"]) == (20, 'enable {"axes": "all", "id": 29}')
    assert len(site.said("mqtt-command")) == 12


FLOOD = repeated(6000)


@VERSIONS
@pytest.mark.parametrize(
    ("name", "off"), [("disable", {"axes": ["x"]}), ("switch", {"axes": ["x"], "on": False})]
)
async def test_behind_a_flood_a_disable_is_carried_out_and_everything_else_counted(
    tmp_path: Path, version: str, name: str, off: dict[str, Any]
) -> None:
    """Reloads that take long: all that comes meanwhile waits, or is counted and named."""
    async with commanding(tmp_path, ANYBODY + "max_queued_messages 0\n", version=version) as (watcher, site):
        go_on = site.hold_reloads()
        for number in range(FLOOD):
            await command(watcher, "reload", {"id": number})
        await command(watcher, name, {**off, "id": "off"})
        told = await site.until_said("mqtt-commands-too-many")
        go_on.set()
        answer = await answer_to(watcher, "off")
    assert site.asked == [Disable(axes=("x",))]
    assert (answer["result"], answer["changed"]) == ("done", ["x"])
    counted = sum(each["count"] for each in site.said("mqtt-commands-too-many"))
    assert site.reloads >= 10
    assert site.reloads + counted == FLOOD
    assert told["last"].startswith("reload {")


async def test_a_disable_waits_for_the_enable_before_it(tmp_path: Path) -> None:
    async with commanding(tmp_path) as (watcher, site):
        go_on = site.hold_reloads()
        await command(watcher, "reload", {})
        await command(watcher, "enable", {"axes": ["x"]})
        for number in range(200):  # more than are kept twice
            await command(watcher, "disable", {"axes": ["x"], "id": number})
        await command(watcher, "enable", {"axes": ["y"]})
        await command(watcher, "disable", {"axes": ["x"], "id": "last"})
        go_on.set()
        await answer_to(watcher, "last")
    assert site.asked[0] == Enable(axes=("x",))
    assert site.asked[-2:] == [Enable(axes=("y",)), Disable(axes=("x",))]
    answers = site.said("mqtt-command")
    disables = [each for each in answers if each["command"] == "disable"]
    assert {each["result"] for each in disables} == {"done"}
    # Each of the 201 was carried out, or stands in the answer of the one that stood for it.
    assert sum(1 + each.get("repeated", 0) for each in disables) == 201
    assert len(disables) <= 66


async def test_what_waits_when_the_gateway_ends_is_counted(tmp_path: Path) -> None:
    async with commanding(tmp_path) as (watcher, site):
        site.hold_reloads()
        await command(watcher, "reload", {"id": "held"})
        await command(watcher, "enable", {"axes": ["x"], "id": "waits"})
        await site.until_waiting(1)
    assert site.asked == []
    [told] = site.said("mqtt-commands-too-many")
    assert (told["count"], told["last"]) == (1, 'enable {"axes": ["x"], "id": "waits"}')
