"""What a publisher works with: what waits to be published, who carries out commands, who hears sensors."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from gateway.broadcast import NewestQueue
from gateway.ipc.messages import Reply, Request
from gateway.status.model import Model
from gateway.supervisor.broadcast import EVENTS_KEPT, Feed, News, NumberedEvent
from gateway.supervisor.outcome import ReloadOutcome

Payload = Mapping[str, Any]
"""What becomes one message."""


@dataclass(frozen=True, slots=True)
class Orders:
    """What commands are carried out with."""

    reload: Callable[[], Awaitable[ReloadOutcome]]
    """Read configuration and tables anew."""
    ask: Callable[[Request], Reply]
    """Ask the relay; blocks. Raises NoGatewayError."""


class OnMessage(Protocol):
    """Takes a message of a sensor; does not block."""

    def __call__(self, topic: str, payload: bytes, *, is_retained: bool) -> None:
        """Take it."""
        ...


def ignore_message(topic: str, payload: bytes, *, is_retained: bool) -> None:
    """Take a message and forget it."""


class PublishQueue:
    """Bounded: of the status only the newest waits, of events the newest :data:`EVENTS_KEPT`."""

    def __init__(self) -> None:
        self.model: Model | None = None
        """The newest status model."""
        self.dropped = 0
        """Events that were not published, because the broker was away or slow for too long."""
        self._events: NewestQueue[NumberedEvent] = NewestQueue(EVENTS_KEPT)
        self._is_there = asyncio.Event()

    def take(self, news: News) -> None:
        """Take over what has come."""
        if news.model is not None:
            self.model = news.model
        self._events.extend(news.events)
        self.dropped += news.dropped + self._events.take_dropped()
        self.wake()

    async def collect(self, feed: Feed) -> None:
        """Take over whatever comes, until cancelled."""
        while True:
            self.take(await feed.next())

    @property
    def event(self) -> NumberedEvent | None:
        """The oldest event that waits."""
        return self._events.items[0] if self._events.items else None

    def done_with(self, event: NumberedEvent) -> None:
        """Note that an event has been published; it may have been dropped meanwhile."""
        if self._events.items and self._events.items[0] is event:
            self._events.items.popleft()
        else:
            self.dropped -= 1

    def wake(self) -> None:
        """End the wait of whoever waits for more."""
        self._is_there.set()

    async def wait(self, timeout_s: float) -> None:
        """Wait until something has come since the last time, at most ``timeout_s``."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._is_there.wait()
        except TimeoutError:
            return
        self._is_there.clear()
