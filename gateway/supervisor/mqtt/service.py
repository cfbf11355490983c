"""MQTT for as long as the supervisor lives: it follows the configuration, which may change or have none."""

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.status.model import MqttStatus
from gateway.supervisor.feeds import Feeds
from gateway.supervisor.mqtt.interfaces import Hear, Orders, Outbox, hear_nothing
from gateway.supervisor.mqtt.settings import Settings
from gateway.supervisor.saying import Say

if TYPE_CHECKING:
    from gateway.supervisor.mqtt.publisher import Publisher


class MqttService:
    """Publishes what ``feeds`` has.

    ``orders`` carry out what is commanded, where that is allowed; ``state`` is the folder to note topics in;
    ``hear`` gets what comes from sensors.
    """

    def __init__(
        self, feeds: Feeds, say: Say, orders: Orders, state: Path, *, hear: Hear = hear_nothing
    ) -> None:
        self.publisher: Publisher | None = None
        """Who publishes now, if anybody does."""
        self._feeds = feeds
        self._say = say
        self._orders = orders
        self._state = state
        self._hear = hear
        self._wanted: Settings | None = None
        self._is_changed = asyncio.Event()

    def follow(self, settings: Settings | None) -> None:
        """Publish as these say from now on; None: not at all. What has not changed changes nothing."""
        if settings != self._wanted:
            self._wanted = settings
            self._is_changed.set()

    def status(self) -> MqttStatus:
        """Return ``supervisor.mqtt`` of the status model."""
        return MqttStatus() if self.publisher is None else self.publisher.status()

    async def run(self) -> None:
        """Run until cancelled; a broker that listens is told of the end."""
        while True:
            if self._wanted is None:
                await self._is_changed.wait()
            else:
                await self._publish_until_none()
            self._is_changed.clear()

    async def _publish_until_none(self) -> None:
        # It outlives a change of settings: the answer to the reload that made it waits in there.
        outbox = Outbox()
        with self._feeds.open() as feed:
            collecting = asyncio.create_task(outbox.collect(feed))
            try:
                while self._wanted is not None:
                    self._is_changed.clear()
                    await self._publish(self._wanted, outbox)
            finally:
                self.publisher = None
                collecting.cancel()

    async def _publish(self, settings: Settings, outbox: Outbox) -> None:
        """Publish until there are other settings."""
        # It loads the library, which a gateway without a broker does without. Where that cannot be loaded the
        # supervisor ends here, as soon as a configuration asks for it.
        from gateway.supervisor.mqtt.publisher import Publisher

        self.publisher = Publisher(
            settings, outbox, self._say, self._orders, state=self._state, hear=self._hear
        )
        publishing = asyncio.create_task(self.publisher.run())
        changing = asyncio.create_task(self._is_changed.wait())
        try:
            with self._feeds.wanting(settings.interval_s):
                await asyncio.wait((publishing, changing), return_when=asyncio.FIRST_COMPLETED)
            if publishing.done():
                publishing.result()  # a bug: it ends only when it is told to
            await self.publisher.finish_commands()
        finally:
            changing.cancel()
            publishing.cancel()
            await asyncio.wait((publishing,))
