"""What is published: gathered, kept, and sent over each connection."""

import asyncio
import contextlib
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import aiomqtt
import msgspec

from gateway.backoff import Backoff
from gateway.broadcast import NewestQueue
from gateway.catalogue.publishing_events import (
    MQTT_COMMANDS_NOT_HEARD,
    MQTT_CONNECTED,
    MQTT_LOST,
    MQTT_TOPICS_NOT_NOTED,
)
from gateway.files import FileRefusedError, read_regular_file
from gateway.state.folder import write_whole
from gateway.supervisor.feeds import EVENTS_KEPT, Feed, News, Told
from gateway.supervisor.mqtt.commands import Commander, Hear, Orders, subscribe_sensors
from gateway.supervisor.mqtt.connection import apart, connected, end, is_cut, taken_over, why
from gateway.supervisor.mqtt.discovery import discovery_messages
from gateway.supervisor.mqtt.topics import (
    ONLINE,
    Payload,
    Settings,
    encode,
    is_known,
    moving_message,
    moving_topics,
    retained_messages,
    without_words,
)
from gateway.supervisor.saying import Say

# --- What waits to be published: the newest model and the newest events, whatever the broker does meanwhile


class Outbox:
    """Bounded: of the status only the newest waits, of events the newest :data:`EVENTS_KEPT`."""

    def __init__(self) -> None:
        self.model: Payload | None = None
        """The newest status model."""
        self.dropped = 0
        """Events that were not published, because the broker was away or slow for too long."""
        self._events: NewestQueue[Told] = NewestQueue(EVENTS_KEPT)
        self._is_there = asyncio.Event()

    def take(self, news: News) -> None:
        """Take over what has come."""
        if news.model is not None:
            self.model = news.model
        self._events.extend(news.events)
        self.dropped += news.dropped + self._events.take_dropped()
        self._is_there.set()

    async def collect(self, feed: Feed) -> None:
        """Take over whatever comes, until cancelled."""
        while True:
            self.take(await feed.next())

    @property
    def event(self) -> Told | None:
        """The oldest event that waits."""
        return self._events.items[0] if self._events.items else None

    def done_with(self, event: Told) -> None:
        """Note that an event has been published; it may have been dropped meanwhile."""
        if self._events.items and self._events.items[0] is event:
            self._events.items.popleft()
        else:
            self.dropped -= 1

    async def wait(self, timeout_s: float) -> None:
        """Wait until something has come since the last time, at most ``timeout_s``."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._is_there.wait()
        except TimeoutError:
            return
        self._is_there.clear()


# --- Which retained messages of ours a broker may hold: what is not wanted any more has to be taken away

RETAINED_NAME: Final = "mqtt-retained.json"
LARGEST: Final = 1_000_000
"""Bytes. 64 axes have some 20 000."""


class Ledger:
    """The topics that were published retained, on disk. It blocks; one thread at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.topics = self._read()
        """What the broker may hold, as far as it was noted."""

    def note(self, topics: Iterable[str]) -> None:
        """Note exactly these.

        Raises:
            OSError: it cannot be written; what was noted before is still there.
        """
        wanted = frozenset(topics)
        if wanted != self.topics:
            self.topics = wanted
            write_whole(self._path, msgspec.json.encode(sorted(wanted)))

    def _read(self) -> frozenset[str]:
        with contextlib.suppress(FileRefusedError, msgspec.MsgspecError, UnicodeDecodeError):
            content = read_regular_file(self._path, LARGEST, "a file")
            return frozenset(msgspec.json.decode(content, type=list[str]))
        return frozenset()


# --- What one connection has been told, and what it has still to be told

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
        client: aiomqtt.Client,
        settings: Settings,
        *,
        outbox: Outbox,
        ledger: Ledger,
        tally: Tally,
        say: Say,
    ) -> None:
        self._client = client
        self._settings = settings
        self._outbox = outbox
        self._ledger = ledger
        self._tally = tally
        self._say = say
        self._told: dict[str, Payload] = {}
        self._told_s: dict[str, float] = {}

    async def run(self) -> None:
        """Publish until the connection is lost, which raises MqttError."""
        await self._publish(self._settings.topics.availability, ONLINE, qos=1, retain=True)
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            await self._send_events()
            if self._outbox.model is not None:
                await self._send_retained(self._outbox.model)
                if loop.time() >= due_s:
                    await self._send_moving(self._outbox.model)
                    due_s = max(due_s + self._settings.interval_s, loop.time())
            await self._outbox.wait(max(0.0, due_s - loop.time()))

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
        await self._client.publish(topic, payload, qos=qos, retain=retain)
        self._tally.published += 1


# --- Publishing what the gateway does over MQTT; it outlives every broker and every network

FIRST_WAIT_S: Final = 1.0
LONGEST_WAIT_S: Final = 60.0
SPREAD: Final = (0.5, 1.0)
"""So that the gateways of a plant do not come back to their broker all at once."""
STEADY_S: Final = 10.0
"""A connection that held for as long was a good one: the next attempt comes soon again."""
SHORT_ONES: Final = 3
"""So many connections in a row that did not hold are those of a client id that two clients have."""


class Publisher:
    """Publishes what is in ``outbox``, as ``settings`` say; for :class:`MqttService`."""

    def __init__(
        self, settings: Settings, outbox: Outbox, say: Say, orders: Orders, *, state: Path, hear: Hear
    ) -> None:
        self._settings = settings
        self._outbox = outbox
        self._say = say
        self._state = state
        self._hear = hear
        self._commander = Commander(settings.topics, orders, say)
        self._tally = Tally()
        self._client: aiomqtt.Client | None = None
        """The newest; commands come over it."""
        self._connects = 0
        self._is_connected = False
        self._problem: str | None = None
        self._short = 0
        """Connections in a row that were made and did not hold."""

    def status(self) -> dict[str, Any]:
        """Return ``supervisor.mqtt`` of the status model."""
        return {
            "problem": self._problem or (taken_over(self._settings) if self._is_taken_over else None),
            "state": "connected" if self._is_connected else "connecting",
            "broker": self._settings.broker,
            "connects": self._connects,
            "published": self._tally.published,
            "dropped_events": self._outbox.dropped,
        }

    async def run(self) -> None:
        """Publish until cancelled; the broker is told that this is the end, if it listens."""
        ledger = await asyncio.to_thread(Ledger, self._state / RETAINED_NAME)
        working = asyncio.create_task(self._commander.run())
        try:
            await self._keep_connected(ledger)
        finally:
            await end((working,))

    async def finish_commands(self) -> None:
        """Wait until the commands that have come so far have been answered."""
        await self._commander.finish()

    async def _keep_connected(self, ledger: Ledger) -> None:
        backoff = Backoff(FIRST_WAIT_S, LONGEST_WAIT_S, spread=SPREAD)
        while True:
            began_s = time.monotonic()
            steady = asyncio.get_running_loop().call_later(STEADY_S, self._hold)
            try:
                await self._connection(ledger)
            except Exception as error:  # noqa: BLE001 - tables and page go on, whatever a library comes up with
                reason = why(error, self._settings)
                self._short += self._is_connected and is_cut(reason, self._settings)
                self._lose(taken_over(self._settings) if self._is_taken_over else reason)
            finally:
                steady.cancel()
            if time.monotonic() - began_s > STEADY_S:
                backoff.reset()
            await asyncio.sleep(backoff.next_s())

    @property
    def _is_taken_over(self) -> bool:
        """Whether another client seems to connect under the same name; until a connection has held."""
        return self._short >= SHORT_ONES

    def _hold(self) -> None:
        if self._is_connected:
            self._short = 0

    async def _connection(self, ledger: Ledger) -> None:
        """Connect and publish; it ends with an exception, because connections do."""
        async with connected(self._settings, self._take) as client:
            self._client = client
            refused = None
            if self._settings.allows_commands:
                refused = await apart(self._commander.subscribe(client))
            if self._settings.sensors:
                refused = await apart(subscribe_sensors(client, self._settings.sensors)) or refused
            self._reach(refused)
            sender = Sender(
                client, self._settings, outbox=self._outbox, ledger=ledger, tally=self._tally, say=self._say
            )
            tasks = [asyncio.create_task(self._listen(client)), asyncio.create_task(sender.run())]
            try:
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                await end(tasks)
            # The listener knows best why it is over.
            for error in [task.exception() for task in tasks if not task.cancelled()]:
                if error is not None:
                    raise error

    async def _listen(self, client: aiomqtt.Client) -> None:
        """Wait until the connection is gone, which raises MqttError."""
        async for _ in client.messages:
            pass

    def _take(self, message: aiomqtt.Message) -> None:
        """Take a command or a temperature, as it comes."""
        if message.topic.value in self._settings.sensors:
            self._hear(message.topic.value, bytes(message.payload), is_retained=message.retain)
        elif self._client is not None:
            self._commander.take(self._client, message)

    def _reach(self, problem: str | None) -> None:
        self._connects += 1
        self._is_connected = True
        self._problem = problem
        self._say(MQTT_CONNECTED, broker=self._settings.broker, version=self._settings.version.value)
        if problem is not None:
            self._say(MQTT_COMMANDS_NOT_HEARD, detail=problem)

    def _lose(self, reason: str) -> None:
        """Say it once for each reason, not with every attempt."""
        was_connected, self._is_connected = self._is_connected, False
        is_news, self._problem = was_connected or reason != self._problem, reason
        if is_news:  # and the status says it already
            self._say(MQTT_LOST, broker=self._settings.broker, detail=reason)
