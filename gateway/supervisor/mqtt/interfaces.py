"""What a publisher works with: its queue, the functions behind commands, and the handler of sensors."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from gateway.broadcast import NewestQueue
from gateway.exchange.commands import Command
from gateway.ipc.messages import Reply, Request
from gateway.status.model import Model
from gateway.supervisor.broadcast import EVENTS_KEPT, Feed, News, NumberedEvent
from gateway.supervisor.outcome import ReloadOutcome

Payload = Mapping[str, Any]
"""Content of one message."""


@dataclass(frozen=True, slots=True)
class Orders:
    """The functions that execute commands."""

    reload: Callable[[], Awaitable[ReloadOutcome]]
    """Read configuration and tables again."""
    ask: Callable[[Request], Reply]
    """Send a request to the relay; blocks. Raises NoGatewayError."""
    done: Callable[[Command, Sequence[str]], None] = lambda _command, _changed: None
    """Gets each command that the relay carried out, and the axes that it changed."""


class OnMessage(Protocol):
    """Takes a message of a sensor; does not block."""

    def __call__(self, topic: str, payload: bytes, *, is_retained: bool) -> None:
        """Take a message."""
        ...


def ignore_message(topic: str, payload: bytes, *, is_retained: bool) -> None:
    """Ignore a message."""


class PublishQueue:
    """Bounded: keeps only the newest status and the newest :data:`EVENTS_KEPT` events."""

    def __init__(self) -> None:
        self.model: Model | None = None
        """The newest status model."""
        self.dropped = 0
        """Number of events that were not published because the broker was away or slow for too long."""
        self._events: NewestQueue[NumberedEvent] = NewestQueue(EVENTS_KEPT)
        self._is_there = asyncio.Event()

    def take(self, news: News) -> None:
        """Add news to the queue."""
        if news.model is not None:
            self.model = news.model
        self._events.extend(news.events)
        self.dropped += news.dropped + self._events.take_dropped()
        self.wake()

    async def collect(self, feed: Feed) -> None:
        """Queue all news until cancelled."""
        while True:
            self.take(await feed.next())

    @property
    def event(self) -> NumberedEvent | None:
        """The oldest event that waits."""
        return self._events.items[0] if self._events.items else None

    def done_with(self, event: NumberedEvent) -> None:
        """Remove a published event; it may already have been dropped."""
        if self._events.items and self._events.items[0] is event:
            self._events.items.popleft()
        else:
            self.dropped -= 1

    def wake(self) -> None:
        """End :meth:`wait`."""
        self._is_there.set()

    async def wait(self, timeout_s: float) -> None:
        """Wait until something has come since the last call, at most ``timeout_s``."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._is_there.wait()
        except TimeoutError:
            return
        self._is_there.clear()
