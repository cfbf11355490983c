"""Distributes the newest status model and the newest events to all readers.

A slow, stopped or hung reader costs a fixed amount of memory: one mark for a newer model, and the newest
events.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from gateway.broadcast import NewestQueue
from gateway.ipc.log import LogEntry
from gateway.ipc.messages import DEFAULT_INTERVAL_S, SELDOM_S
from gateway.status.model import Model

EVENTS_KEPT: Final = 256
"""Kept for each reader that is behind, and for readers that come later."""


@dataclass(frozen=True, slots=True)
class NumberedEvent:
    """An event with its number; numbers ascend while this process lives."""

    number: int
    entry: LogEntry

    def as_data(self) -> dict[str, Any]:
        """Return plain data: ``number``, ``time``, ``event``, ``severity`` and the event's own fields."""
        return {
            **self.entry.fields,
            "number": self.number,
            "time": datetime.fromtimestamp(self.entry.wall_s, UTC).isoformat(timespec="milliseconds"),
            "event": self.entry.event,
            "severity": self.entry.severity.value,
        }


@dataclass(frozen=True, slots=True)
class News:
    """What has come since the reader's last call."""

    events: tuple[NumberedEvent, ...]
    model: Model | None
    """The whole status model, if there is a newer one."""
    dropped: int
    """Events that were dropped because the reader was too slow."""


class Feed:
    """What waits for one reader."""

    def __init__(self, model: Model | None) -> None:
        self._events: NewestQueue[NumberedEvent] = NewestQueue(EVENTS_KEPT)
        self._model = model
        self._is_there = asyncio.Event()
        if model is not None:
            self._is_there.set()

    async def next(self) -> News:
        """Wait until there is news, and return all of it."""
        await self._is_there.wait()
        self._is_there.clear()
        news = News(self._events.take_all(), self._model, self._events.take_dropped())
        self._model = None
        return news

    def take_event(self, event: NumberedEvent) -> None:
        """Queue an event; called by :class:`Broadcast`."""
        self._events.put(event)
        self._is_there.set()

    def take_model(self, model: Model) -> None:
        """Mark that there is a newer model; called by :class:`Broadcast`."""
        self._model = model
        self._is_there.set()


def _ignore_pace(_interval_s: float) -> None:
    pass


class Broadcast:
    """All readers of one event loop.

    ``pace`` is called when the requested interval between models changes, with the interval in seconds.
    """

    def __init__(self, pace: Callable[[float], None] = _ignore_pace) -> None:
        self._pace = pace
        self._intervals_s: list[float] = []
        self.model: Model | None = None
        """The newest status model; it is replaced, never changed."""
        self._subscribers: set[Feed] = set()
        self._recent: deque[NumberedEvent] = deque(maxlen=EVENTS_KEPT)
        self._number = 0

    @property
    def recent(self) -> tuple[NumberedEvent, ...]:
        """The newest events, oldest first."""
        return tuple(self._recent)

    def publish_event(self, entry: LogEntry) -> None:
        """Pass an event on to all readers."""
        self._number += 1
        event = NumberedEvent(self._number, entry)
        self._recent.append(event)
        for feed in self._subscribers:
            feed.take_event(event)

    def publish(self, model: Model) -> None:
        """Pass a new model on to all readers. The caller must not change it afterwards."""
        self.model = model
        for feed in self._subscribers:
            feed.take_model(model)

    @contextmanager
    def wanting(self, interval_s: float) -> Iterator[None]:
        """Request models at this interval inside the ``with`` block. The limits are 0.2 s and 1 s."""
        self._intervals_s.append(interval_s)
        self._set_pace()
        try:
            yield
        finally:
            self._intervals_s.remove(interval_s)
            self._set_pace()

    def _set_pace(self) -> None:
        self._pace(max(DEFAULT_INTERVAL_S, min((SELDOM_S, *self._intervals_s))))

    @contextmanager
    def open(self) -> Iterator[Feed]:
        """Yield a feed. It starts with the current model; earlier events are in :attr:`recent`."""
        feed = Feed(self.model)
        self._subscribers.add(feed)
        try:
            yield feed
        finally:
            self._subscribers.discard(feed)
