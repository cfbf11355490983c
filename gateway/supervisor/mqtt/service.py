"""MQTT for the supervisor's lifetime: follows the configuration, which may change or have no broker."""

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.status.model import MqttStatus
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.mqtt.interfaces import OnMessage, Orders, PublishQueue, ignore_message
from gateway.supervisor.mqtt.settings import Settings

if TYPE_CHECKING:
    from gateway.supervisor.mqtt.publisher import Publisher


class MqttService:
    """Publishes the content of ``broadcast``.

    ``orders`` execute commands, where these are allowed. ``state`` is the folder for the recorded topics.
    ``on_message`` gets the messages of sensors.
    """

    def __init__(
        self,
        broadcast: Broadcast,
        log: LogEvent,
        orders: Orders,
        state: Path,
        *,
        on_message: OnMessage = ignore_message,
    ) -> None:
        self.publisher: Publisher | None = None
        """The present publisher, if there is one."""
        self._broadcast = broadcast
        self._log = log
        self._orders = orders
        self._state = state
        self._on_message = on_message
        self._settings: Settings | None = None
        self._is_changed = asyncio.Event()

    def follow(self, settings: Settings | None) -> None:
        """Use these settings from now on; None: publish nothing. Unchanged settings change nothing."""
        if settings != self._settings:
            self._settings = settings
            self._is_changed.set()

    def status(self) -> MqttStatus:
        """Return ``supervisor.mqtt`` of the status model."""
        return MqttStatus() if self.publisher is None else self.publisher.status()

    async def run(self) -> None:
        """Run until cancelled; then disconnect regularly, if the broker still reads."""
        while True:
            if self._settings is None:
                await self._is_changed.wait()
            else:
                await self._publish_until_none()
            self._is_changed.clear()

    async def _publish_until_none(self) -> None:
        # It outlives a change of settings: it holds the answer to the reload that made the change.
        outbox = PublishQueue()
        with self._broadcast.open() as feed:
            collecting = asyncio.create_task(outbox.collect(feed))
            try:
                while self._settings is not None:
                    self._is_changed.clear()
                    await self._publish(self._settings, outbox)
            finally:
                self.publisher = None
                collecting.cancel()

    async def _publish(self, settings: Settings, outbox: PublishQueue) -> None:
        """Publish until the settings change."""
        # This loads the MQTT library, which a gateway without a broker does not need. If the library cannot
        # be loaded, the supervisor ends here, as soon as a configuration names a broker.
        from gateway.supervisor.mqtt.publisher import Publisher

        self.publisher = Publisher(
            settings, outbox, self._log, self._orders, state=self._state, on_message=self._on_message
        )
        publishing = asyncio.create_task(self.publisher.run())
        changing = asyncio.create_task(self._is_changed.wait())
        try:
            with self._broadcast.wanting(settings.interval_s):
                await asyncio.wait((publishing, changing), return_when=asyncio.FIRST_COMPLETED)
            if publishing.done():
                publishing.result()  # a bug: it ends only when cancelled
            await self.publisher.finish_commands()
        finally:
            changing.cancel()
            publishing.cancel()
            await asyncio.wait((publishing,))
