"""Publishes over MQTT; survives every loss of broker and network."""

import asyncio
import time
from pathlib import Path
from typing import Final

from paho.mqtt.client import MQTTMessage

from gateway.backoff import Backoff
from gateway.catalogue.publishing_events import MQTT_COMMANDS_NOT_HEARD, MQTT_CONNECTED, MQTT_LOST
from gateway.status.model import MqttStatus
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.mqtt.commands import Commander
from gateway.supervisor.mqtt.connection import BrokerConnection, connected
from gateway.supervisor.mqtt.interfaces import OnMessage, Orders, PublishQueue
from gateway.supervisor.mqtt.reasons import may_be_taken_over, taken_over, why
from gateway.supervisor.mqtt.sending import RETAINED_NAME, PublishCounter, PublishedTopics, Sender
from gateway.supervisor.mqtt.settings import Settings

FIRST_WAIT_S: Final = 1.0
LONGEST_WAIT_S: Final = 60.0
SPREAD: Final = (0.5, 1.0)
"""Random share of the waiting time, so that the gateways of a plant do not all reconnect at the same time."""
STEADY_S: Final = 10.0
"""A connection that held for so long was good: the next attempt comes soon."""
SHORT_ONES: Final = 3
"""So many short connections in a row mean that two clients use one client id."""


class Publisher:
    """Publishes the content of ``outbox`` with these ``settings``; used by :class:`MqttService`."""

    def __init__(
        self,
        settings: Settings,
        outbox: PublishQueue,
        log: LogEvent,
        orders: Orders,
        *,
        state: Path,
        on_message: OnMessage,
    ) -> None:
        self._settings = settings
        self._outbox = outbox
        self._log = log
        self._state = state
        self._on_message = on_message
        self._commander = Commander(settings.topics, orders, log)
        self._counter = PublishCounter()
        self._connects = 0
        self._is_connected = False
        self._problem: str | None = None
        self._short = 0
        """Connections in a row that were made and did not hold."""

    def status(self) -> MqttStatus:
        """Return ``supervisor.mqtt`` of the status model."""
        return MqttStatus(
            problem=self._problem or (taken_over(self._settings) if self._is_taken_over else None),
            state="connected" if self._is_connected else "connecting",
            broker=self._settings.broker,
            connects=self._connects,
            published=self._counter.published,
            dropped_events=self._outbox.dropped,
        )

    async def run(self) -> None:
        """Publish until cancelled; then disconnect regularly, if the broker still reads."""
        ledger = await asyncio.to_thread(PublishedTopics, self._state / RETAINED_NAME)
        working = asyncio.create_task(self._commander.run())
        try:
            await self._run_connections(ledger)
        finally:
            working.cancel()
            await asyncio.wait((working,))

    async def finish_commands(self) -> None:
        """Wait until the commands received so far have been answered."""
        await self._commander.finish()

    async def _run_connections(self, ledger: PublishedTopics) -> None:
        backoff = Backoff(FIRST_WAIT_S, LONGEST_WAIT_S, spread=SPREAD)
        while True:
            began_s = time.monotonic()
            steady = asyncio.get_running_loop().call_later(STEADY_S, self._hold)
            try:
                await self._connection(ledger)
            except Exception as error:  # noqa: BLE001 - tables and page continue, whatever a library raises
                reason = why(error, self._settings)
                self._short += self._is_connected and may_be_taken_over(reason, self._settings)
                self._lose(taken_over(self._settings) if self._is_taken_over else reason)
            finally:
                steady.cancel()
            if time.monotonic() - began_s > STEADY_S:
                backoff.reset()
            await asyncio.sleep(backoff.next_s())

    @property
    def _is_taken_over(self) -> bool:
        """Whether another client seems to use the same client id; until a connection has held."""
        return self._short >= SHORT_ONES

    def _hold(self) -> None:
        if self._is_connected:
            self._short = 0

    async def _connection(self, ledger: PublishedTopics) -> None:
        """Connect and publish. Ends with an exception when the connection ends."""
        async with connected(self._settings, self._take) as connection:
            self._reach(await self._subscribe(connection))
            await Sender(
                connection,
                self._settings,
                outbox=self._outbox,
                ledger=ledger,
                counter=self._counter,
                log=self._log,
            ).run()

    async def _subscribe(self, connection: BrokerConnection) -> str | None:
        """Subscribe to commands and temperatures; return what the broker does not grant."""
        problem = None
        commands = [(self._settings.topics.commands, 1)] if self._settings.allows_commands else []
        for topics in commands, [(topic, 0) for topic in self._settings.sensors]:
            if topics and (denied := await connection.subscribe(topics)):
                problem = (
                    f"the broker does not allow the gateway to read {', '.join(denied)}: allow it in its ACL"
                )
        return problem

    def _take(self, connection: BrokerConnection, message: MQTTMessage) -> None:
        """Take a command or a temperature as it arrives."""
        if message.topic in self._settings.sensors:
            self._on_message(message.topic, bytes(message.payload), is_retained=message.retain)
        else:
            self._commander.take(connection, message)

    def _reach(self, problem: str | None) -> None:
        self._connects += 1
        self._is_connected = True
        self._problem = problem
        self._log(MQTT_CONNECTED, broker=self._settings.broker, version=self._settings.version.value)
        if problem is not None:
            self._log(MQTT_COMMANDS_NOT_HEARD, detail=problem)

    def _lose(self, reason: str) -> None:
        """Report the loss once for each reason, not with every attempt."""
        was_connected, self._is_connected = self._is_connected, False
        is_news, self._problem = was_connected or reason != self._problem, reason
        if is_news:  # the status already shows it
            self._log(MQTT_LOST, broker=self._settings.broker, detail=reason)
