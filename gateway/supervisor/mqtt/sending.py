"""What is published and when: parts of the status model, each under its topic, as JSON.

Retained topics of a removed axis, or of discovery that was switched off, would stay at the broker for ever.
So the retained topics are recorded in the state folder: an axis is removed by a restart.
"""

import asyncio
import contextlib
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec
from msgspec import to_builtins

from gateway.catalogue.publishing_events import MQTT_TOPICS_NOT_NOTED
from gateway.files import FileRefusedError, read_regular_file
from gateway.state.folder import write_whole
from gateway.status.model import Model
from gateway.supervisor.active_alarms import is_fresh
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.mqtt.connection import ONLINE, BrokerConnection, encode
from gateway.supervisor.mqtt.discovery import discovery_messages
from gateway.supervisor.mqtt.interfaces import Payload, PublishQueue
from gateway.supervisor.mqtt.settings import Settings, Topics

WORDS_EVERY_S: Final = 10.0
"""Minimum interval between messages about an alarm of which only the words have changed."""
NOTHING: Final = b""
"""A retained message without content deletes the one at the broker (MQTT 5.0, 3.3.1.3)."""
RETAINED_NAME: Final = "mqtt-retained.json"
LARGEST: Final = 1_000_000
"""Bytes. 64 axes have some 20 000."""


def is_known(model: Model) -> bool:
    """Whether the relay has ever reported: before that its axes are unknown."""
    return model.gateway.snapshot_age_s is not None


def retained_messages(settings: Settings, model: Model) -> dict[str, Payload]:
    """Return the messages that a later subscriber needs, by topic; they change seldom."""
    topics, gateway = settings.topics, model.gateway
    info = {
        "name": topics.name,
        "version": gateway.version,
        "relay": gateway.relay,
        "lines": list(model.lines),
        "axes": {name: {"units": axis.units} for name, axis in model.axes.items()},
        "interval_s": settings.interval_s,
        "commands": settings.allows_commands,
        "verdict": to_builtins(model.verdict),
        "troubles": to_builtins(model.troubles),
    }
    tables = {topics.table(name): to_builtins(axis.table) for name, axis in model.axes.items()}
    own = model.supervisor
    journal = {} if own is None else {topics.journal: to_builtins(own.journal)}
    return {topics.info: info, **journal, **tables}


def without_words(payload: Payload) -> Payload:
    """Return a payload without the durations and counts of alarms, which change constantly."""
    if "troubles" not in payload:
        return payload
    lasting = [{key: it for key, it in each.items() if key != "what"} for each in payload["troubles"]]
    return {**payload, "troubles": lasting}


def moving_topics(topics: Topics, model: Model) -> dict[str, tuple[str, str]]:
    """Return the topics that are published in every interval, each with its path in the model."""
    lines = {topics.line(name): ("lines", name) for name in model.lines}
    return lines | {topics.axis(name): ("axes", name) for name in model.axes}


def moving_message(model: Model, part: tuple[str, str]) -> Payload | None:
    """Return the message of a line or an axis; None if there is no data now."""
    section, name = part
    parts = model.lines if section == "lines" else model.axes
    if not is_fresh(model) or name not in parts:
        return None
    return {key: each for key, each in to_builtins(parts[name]).items() if key != "table"}


class PublishedTopics:
    """The topics that were published retained, on disk. Its methods block; one thread at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.topics = self._read()
        """Topics that the broker may hold, as far as recorded."""

    def save(self, topics: Iterable[str]) -> None:
        """Record exactly these.

        Raises:
            OSError: the file cannot be written; the previous record stays.
        """
        new_topics = frozenset(topics)
        if new_topics != self.topics:
            self.topics = new_topics
            write_whole(self._path, msgspec.json.encode(sorted(new_topics)))

    def _read(self) -> frozenset[str]:
        with contextlib.suppress(FileRefusedError, msgspec.MsgspecError, UnicodeDecodeError):
            content = read_regular_file(self._path, LARGEST, "a file")
            return frozenset(msgspec.json.decode(content, type=list[str]))
        return frozenset()


class PublishCounter:
    """Counts of published messages since the start."""

    def __init__(self) -> None:
        self.published = 0


class Sender:
    """Publishes over one connection, one message after the other.

    A message is made only when the broker can take it.
    """

    def __init__(
        self,
        connection: BrokerConnection,
        settings: Settings,
        *,
        outbox: PublishQueue,
        ledger: PublishedTopics,
        counter: PublishCounter,
        log: LogEvent,
    ) -> None:
        self._connection = connection
        self._settings = settings
        self._outbox = outbox
        self._ledger = ledger
        self._counter = counter
        self._log = log
        self._sent: dict[str, Payload] = {}
        self._sent_s: dict[str, float] = {}

    async def run(self) -> None:
        """Publish until the connection is lost; then raise BrokerError."""
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

    async def _send_retained(self, model: Model) -> None:
        messages = {**retained_messages(self._settings, model), **discovery_messages(self._settings, model)}
        kept = {self._settings.topics.availability, *messages}
        # Until the relay has reported its axes, none of them counts as removed.
        gone = self._ledger.topics.union(self._sent) - kept if is_known(model) else frozenset()
        await self._save(self._ledger.topics.union(kept))
        for topic, payload in messages.items():
            if self._is_news(topic, payload):
                await self._publish(topic, encode(payload), qos=1, retain=True)
                self._sent[topic] = payload
                self._sent_s[topic] = time.monotonic()
        if gone:
            await self._take_away(gone)

    def _is_news(self, topic: str, payload: Payload) -> bool:
        """Whether a retained message is due: a change of durations only can wait."""
        sent = self._sent.get(topic)
        if sent is None or sent == payload:
            return sent is None
        is_only_words = without_words(sent) == without_words(payload)
        return not is_only_words or time.monotonic() - self._sent_s[topic] >= WORDS_EVERY_S

    async def _take_away(self, gone: frozenset[str]) -> None:
        # Recorded first: if the broker closes the connection over a topic that is not ours, it happens only
        # once.
        await self._save(self._ledger.topics - gone)
        for topic in sorted(gone):
            self._sent.pop(topic, None)
            await self._publish(topic, NOTHING, qos=1, retain=True)

    async def _save(self, topics: frozenset[str]) -> None:
        if topics == self._ledger.topics:
            return
        try:
            await asyncio.to_thread(self._ledger.save, topics)
        except OSError as error:
            detail = f"{error}; if you remove an axis, its retained messages stay at the broker"
            self._log(MQTT_TOPICS_NOT_NOTED, detail=detail)

    async def _send_moving(self, model: Model) -> None:
        for topic, part in moving_topics(self._settings.topics, model).items():
            # Read here, not before the loop: a slow broker gets the values of the moment of sending.
            newest = self._outbox.model
            if newest is not None and (payload := moving_message(newest, part)) is not None:
                await self._publish(topic, encode(payload))

    async def _publish(self, topic: str, payload: bytes, *, qos: int = 0, retain: bool = False) -> None:
        await self._connection.publish(topic, payload, qos=qos, retain=retain)
        self._counter.published += 1
