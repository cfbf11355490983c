"""What one connection has been told, and what it has still to be told."""

import asyncio
import time
from typing import Final

from gateway.catalogue.publishing_events import MQTT_TOPICS_NOT_NOTED
from gateway.supervisor.mqtt.connection import ONLINE, Connection, encode
from gateway.supervisor.mqtt.discovery import discovery_messages
from gateway.supervisor.mqtt.interfaces import Outbox, Payload
from gateway.supervisor.mqtt.messages import (
    is_known,
    moving_message,
    moving_topics,
    retained_messages,
    without_words,
)
from gateway.supervisor.mqtt.retained import Ledger
from gateway.supervisor.mqtt.settings import Settings
from gateway.supervisor.saying import Say

WORDS_EVERY_S: Final = 10.0
"""So often at most a trouble is told anew of which only the words have changed."""
NOTHING: Final = b""
"""A retained message without content takes the one that the broker keeps away (MQTT 5.0, 3.3.1.3)."""


class Tally:
    """What has been published since the start."""

    def __init__(self) -> None:
        self.published = 0


class Sender:
    """Publishes over one connection, one message after the other: what the broker cannot take is not made."""

    def __init__(
        self,
        connection: Connection,
        settings: Settings,
        *,
        outbox: Outbox,
        ledger: Ledger,
        tally: Tally,
        say: Say,
    ) -> None:
        self._connection = connection
        self._settings = settings
        self._outbox = outbox
        self._ledger = ledger
        self._tally = tally
        self._say = say
        self._told: dict[str, Payload] = {}
        self._told_s: dict[str, float] = {}

    async def run(self) -> None:
        """Publish until the connection is lost, which raises BrokerError."""
        lost = self._connection.lost
        lost.add_done_callback(lambda _: self._outbox.wake())
        await self._publish(self._settings.topics.availability, ONLINE, qos=1, retain=True)
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while not lost.done():
            await self._send_events()
            if self._outbox.model is not None:
                await self._send_retained(self._outbox.model)
                if loop.time() >= due_s:
                    await self._send_moving(self._outbox.model)
                    due_s = max(due_s + self._settings.interval_s, loop.time())
            await self._outbox.wait(max(0.0, due_s - loop.time()))
        raise lost.result()

    async def _send_events(self) -> None:
        while (event := self._outbox.event) is not None:
            await self._publish(self._settings.topics.event, encode(event.as_data()), qos=1)
            self._outbox.done_with(event)

    async def _send_retained(self, model: Payload) -> None:
        wanted = {**retained_messages(self._settings, model), **discovery_messages(self._settings, model)}
        kept = {self._settings.topics.availability, *wanted}
        # As long as the relay has not said which axes there are, none of them is gone.
        gone = self._ledger.topics.union(self._told) - kept if is_known(model) else frozenset()
        await self._note(self._ledger.topics.union(kept))
        for topic, payload in wanted.items():
            if self._is_news(topic, payload):
                await self._publish(topic, encode(payload), qos=1, retain=True)
                self._told[topic] = payload
                self._told_s[topic] = time.monotonic()
        if gone:
            await self._take_away(gone)

    def _is_news(self, topic: str, payload: Payload) -> bool:
        """Whether a retained message is worth another: words that tell how long something lasts can wait."""
        told = self._told.get(topic)
        if told is None or told == payload:
            return told is None
        is_only_words = without_words(told) == without_words(payload)
        return not is_only_words or time.monotonic() - self._told_s[topic] >= WORDS_EVERY_S

    async def _take_away(self, gone: frozenset[str]) -> None:
        # Noted first: a broker that ends the connection over a topic that is not ours is asked once only.
        await self._note(self._ledger.topics - gone)
        for topic in sorted(gone):
            self._told.pop(topic, None)
            await self._publish(topic, NOTHING, qos=1, retain=True)

    async def _note(self, topics: frozenset[str]) -> None:
        if topics == self._ledger.topics:
            return
        try:
            await asyncio.to_thread(self._ledger.note, topics)
        except OSError as error:
            detail = f"{error}; should an axis be taken away, its retained messages stay at the broker"
            self._say(MQTT_TOPICS_NOT_NOTED, detail=detail)

    async def _send_moving(self, model: Payload) -> None:
        for topic, place in moving_topics(self._settings.topics, model).items():
            # Looked up here, not before the loop: a slow broker gets what is so when it is its turn.
            newest = self._outbox.model
            if newest is not None and (payload := moving_message(newest, place)) is not None:
                await self._publish(topic, encode(payload))

    async def _publish(self, topic: str, payload: bytes, *, qos: int = 0, retain: bool = False) -> None:
        await self._connection.publish(topic, payload, qos=qos, retain=retain)
        self._tally.published += 1
