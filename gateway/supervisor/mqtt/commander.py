"""Taking commands off one connection, and answering each of them."""

import asyncio
import shlex
from typing import Final

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from gateway.catalogue.entry import Severity
from gateway.catalogue.publishing_events import MQTT_COMMAND, MQTT_COMMAND_IGNORED, MQTT_COMMANDS_TOO_MANY
from gateway.supervisor.mqtt.commands import (
    BURST,
    PER_S,
    Allowance,
    Answer,
    Orders,
    carry_out,
    shown_payload,
)
from gateway.supervisor.mqtt.messages import encode
from gateway.supervisor.mqtt.topics import COMMANDS, Topics
from gateway.supervisor.saying import Say

LONGEST_SHOWN: Final = 256
"""Of a topic that a stranger chose."""
FAILURE: Final = 0x80
"""From here on a reason code says no (MQTT 5.0, 2.4; MQTT 3.1.1, 3.9.3)."""

TELL_AFTER_S: Final = 2.0
"""So long after a command that came too soon is told what became of it and of those after it."""


class Commander:
    """Listens for commands; outlives connections."""

    def __init__(self, topics: Topics, orders: Orders, say: Say) -> None:
        self.is_idle = asyncio.Event()
        """Set unless a command is being carried out."""
        self.is_idle.set()
        self._topics = topics
        self._orders = orders
        self._say = say
        self._allowance = Allowance()
        self._too_many = 0
        """Commands that were not carried out, and are not told of yet."""
        self._last_of_them = ""
        self._retained_seen: set[str] = set()

    async def subscribe(self, client: aiomqtt.Client) -> str | None:
        """Ask for commands; returns why the broker does not let us, None when it does."""
        granted = await client.subscribe(self._topics.commands, qos=1)
        if all((code.value if isinstance(code, ReasonCode) else code) < FAILURE for code in granted):
            return None
        return f"the broker does not let the gateway read {self._topics.commands}: allow it in its ACL"

    async def take(self, client: aiomqtt.Client, message: aiomqtt.Message) -> None:
        """Carry out what a message asks for, and answer it."""
        self.is_idle.clear()
        try:
            await self._take(client, message)
        finally:
            self.is_idle.set()

    async def _take(self, client: aiomqtt.Client, message: aiomqtt.Message) -> None:
        command = self._topics.command_in(message.topic.value)
        if message.retain:
            self._ignore_retained(command, message.topic.value)
            return
        missed = self._allowance.ignored
        if not self._allowance.takes(asyncio.get_running_loop().time()):
            self._note_too_many(f"{command[:64]} {shown_payload(message.payload)}".strip())
            if not missed:  # one answer for all that follow
                text = f"more than {BURST} at once and {PER_S:g} a second: this and what follows is ignored"
                await self._answer(client, message, Answer(command[:64], None, problems=(text,)))
            return
        await self._answer(client, message, await carry_out(command, message.payload, self._orders), missed)

    def _note_too_many(self, last: str) -> None:
        """Tell of commands that nobody carries out, and which was the last: it is not what holds."""
        self._too_many += 1
        self._last_of_them = last
        if self._too_many == 1:
            asyncio.get_running_loop().call_later(TELL_AFTER_S, self._tell_of_too_many)

    def _tell_of_too_many(self) -> None:
        count, self._too_many = self._too_many, 0
        self._say(MQTT_COMMANDS_TOO_MANY, count=count, last=self._last_of_them)

    async def _answer(
        self, client: aiomqtt.Client, message: aiomqtt.Message, answer: Answer, ignored: int = 0
    ) -> None:
        severity = Severity.INFO if answer.result == "done" else Severity.WARNING
        data = answer.as_data()
        if ignored:
            data["ignored_before"] = ignored
        self._say(MQTT_COMMAND, severity, **data)
        topic = getattr(message.properties, "ResponseTopic", None)
        if topic is None or not self._may_answer(topic):
            return
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        if (correlation := getattr(message.properties, "CorrelationData", None)) is not None:
            properties.CorrelationData = correlation
        await client.publish(topic, encode(data), qos=1, properties=properties)

    def _may_answer(self, topic: str) -> bool:
        """Not under our own topics: answers would be status, or commands that are answered again."""
        is_own = topic == self._topics.root or topic.startswith(f"{self._topics.root}/")
        return bool(topic) and not is_own and not any(sign in topic for sign in "+#\0")

    def _ignore_retained(self, command: str, topic: str) -> None:
        known = command if command in COMMANDS else "other"
        if known not in self._retained_seen:
            self._retained_seen.add(known)
            self._say(
                MQTT_COMMAND_IGNORED,
                command=command[:64],
                detail="it was published as retained: it would be obeyed again at every start. Take it away "
                f"{_how_to_clear(topic)}, and publish commands without retain",
            )


def _how_to_clear(topic: str) -> str:
    """Return how to clear a retained topic, which a stranger may have chosen, in a shell."""
    if topic.isprintable() and len(topic) <= LONGEST_SHOWN:
        return f"with: mosquitto_pub -r -n -t {shlex.quote(topic)}"
    return f"with an empty retained message to its topic, which is no name to type ({topic[:64]!a})"
