"""What a broker hands on: commands, answered, and temperatures of sensors.

The first byte says what is around the message: retained or not, with or without a topic for the answer, with
or without a relay that listens. Then come the end of the topic, the topic for the answer, and the payload.
"""

import asyncio
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Final

from paho.mqtt.client import MQTTMessage
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from gateway.catalogue.entry import EventEntry, Severity
from gateway.exchange.commands import Disable, Enable, SetGain
from gateway.ipc.client import NobodyListensError
from gateway.ipc.messages import Done, Reply, Request
from gateway.supervisor.mqtt.commands import Commander
from gateway.supervisor.mqtt.connection import encode
from gateway.supervisor.mqtt.interfaces import Orders
from gateway.supervisor.mqtt.settings import COMMANDS, Topics
from gateway.supervisor.outcome import ReloadOutcome
from gateway.supervisor.temperatures import LARGEST, WrongTemperatureError, read_payload
from tests.fuzz.script import Script, said

TOPICS: Final = Topics("pitch-gateway", "mill-1")
RETAINED, ANSWERED, ALONE, SENSOR = 1, 2, 4, 8


@dataclass
class Broker:
    """Keeps what is published; a connection has a broker for it."""

    published: list[tuple[str, bytes]] = field(default_factory=list)

    async def publish(self, topic: str, payload: bytes, **_: object) -> None:
        """Take an answer."""
        self.published.append((topic, payload))


def messages(data: bytes) -> None:
    """A message asks the relay for one of four things, within their limits, or is answered with why not.

    What is retained does nothing; no answer goes to a topic of the gateway's own; a temperature is a number
    that a sensor can have.
    """
    script = Script(data)
    kind = script.byte()
    command, answers_to = (script.text().decode(errors="replace") for _ in range(2))
    payload = script.rest()
    if kind & SENSOR:
        try:
            celsius = read_payload(payload)
        except WrongTemperatureError as error:
            assert "\n" not in str(error)
        else:
            assert isfinite(celsius)
            assert abs(celsius) <= LARGEST
        return
    # no broker takes anything else, and the filter has one level
    command = "".join(sign for sign in command if sign not in "/+#\0")
    asyncio.run(_command(kind, command, answers_to, payload))


async def _command(kind: int, command: str, answers_to: str, payload: bytes) -> None:
    asked: list[Request | None] = []
    events: list[dict[str, object]] = []

    async def reload() -> ReloadOutcome:
        asked.append(None)
        return ReloadOutcome()

    def ask(request: Request) -> Reply:
        asked.append(request)
        if kind & ALONE:
            raise NobodyListensError("no gateway runs")
        return Done(changed=("x",))

    def say(event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        encode(fields)
        events.append(fields)

    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
    if kind & ANSWERED:
        properties.ResponseTopic = answers_to
        properties.CorrelationData = payload[:8]
    message = MQTTMessage(1, f"{TOPICS.root}/command/{command}".encode())
    message.payload, message.qos, message.retain = payload, 1, bool(kind & RETAINED)
    message.properties = properties
    broker = Broker()
    commander = Commander(TOPICS, Orders(reload, ask), say)
    commander.take(broker, message)  # type: ignore[arg-type]
    await commander.carry_out_waiting()
    assert len(events) == 1, "one event for each command"
    if kind & RETAINED:
        assert not asked, "a command that was retained"
        assert not broker.published
        return
    assert len(asked) <= 1
    for request in asked:
        _judge(request)
    assert command in COMMANDS or not asked
    assert len(broker.published) <= bool(kind & ANSWERED)
    for topic, answer in broker.published:
        assert topic == answers_to
        assert topic != TOPICS.root
        assert not topic.startswith(f"{TOPICS.root}/"), "an answer that is a command or a status"
        found: dict[str, Any] = json.loads(answer)
        assert found["result"] in ("done", "partly", "refused")
        assert (found["result"] == "done") == (not found["problems"])
        assert bool(asked) or found["result"] == "refused"


def _judge(request: Request | None) -> None:
    if isinstance(request, SetGain):
        assert 0 <= request.forward <= 1
        assert 0 <= request.backward <= 1
    else:
        assert request is None or isinstance(request, Enable | Disable)


def seeds() -> Iterator[bytes]:
    """Yield a good command of each kind, some that are not, and temperatures."""
    for command, payload in (
        ("enable", b'{"axes": ["x", "y"]}'),
        ("enable", b'{"axes": "all", "id": "a7"}'),
        ("disable", b'{"axes": ["x"], "id": 7}'),
        ("gain", b'{"axes": ["x"], "forward": 1, "backward": 0.5}'),
        ("reload", b"{}"),
        ("reload", b""),
        ("move", b"{}"),
        ("disable", b"[" * 50),
        ("gain", b'{"axes": ["x"], "forward": NaN, "backward": -1e999}'),
    ):
        for kind in (0, ANSWERED, RETAINED, ANSWERED | ALONE):
            for topic in (b"answers/1", b"pitch-gateway/mill-1/command/reload"):
                yield bytes((kind,)) + said(command.encode()) + said(topic) + payload
    for payload in (
        b"21.5",
        b'{"temperature": 21.5, "battery": 90}',
        b'{"value": "warm"}',
        b"true",
        b"1e400",
    ):
        yield bytes((SENSOR, 0, 0)) + payload


def words() -> Iterator[bytes]:
    """Yield what stands in commands."""
    for word in (*COMMANDS, "axes", "all", "forward", "backward", "id", "temperature", "celsius", "value"):
        yield word.encode()
