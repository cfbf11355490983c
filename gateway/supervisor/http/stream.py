"""The event stream, and responses that are sent in parts."""

import asyncio
import contextlib
import time
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing
from dataclasses import dataclass
from typing import Final

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from gateway.status.model import Model
from gateway.supervisor.broadcast import Broadcast, NumberedEvent
from gateway.supervisor.http.answers import Limits, json_bytes

# --- A response without an end


class EndlessResponse(Response):
    """Sends parts until the client has gone, ``is_over`` returns, or the sending task is cancelled.

    Starlette's own response cancels through anyio. That does not interrupt a task that has something to send
    in every iteration of the loop.
    """

    def __init__(
        self,
        parts: AsyncGenerator[bytes, None],
        headers: dict[str, str],
        media_type: str,
        is_over: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        super().__init__(headers=headers, media_type=media_type)
        self._is_over = is_over
        del self.headers["content-length"]
        self._parts = parts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        start = {"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers}
        await send(start)
        tasks = [asyncio.create_task(self._send(send)), asyncio.create_task(_until_gone(receive))]
        if self._is_over is not None:
            tasks.append(asyncio.ensure_future(self._is_over()))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            ended, *_ = await asyncio.gather(*tasks, return_exceptions=True)
        if isinstance(ended, Exception):
            raise ended
        if isinstance(ended, asyncio.CancelledError):  # not its own cancellation
            await send({"type": "http.response.body"})

    async def _send(self, send: Send) -> None:
        async with aclosing(self._parts) as parts:
            async for part in parts:
                await send({"type": "http.response.body", "body": part, "more_body": True})
        await send({"type": "http.response.body"})


async def _until_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


# --- ``/events``: the newest status and every event, as server-sent events (HTML standard, section 9.2)

MEDIA_TYPE: Final = "text/event-stream"
HEARTBEAT: Final = b": nothing new\n\n"
RETRY_MS: Final = 2000
"""A browser reconnects so long after it lost the connection."""


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """What a reader requests."""

    wants_events: bool
    wants_status: bool
    last_id: str = ""
    """Id of the event that the reader received last. It sends this id when it reconnects."""


class Models:
    """The newest model as JSON, encoded once for all readers."""

    def __init__(self) -> None:
        self._model: Model | None = None
        self._encoded = b""

    def encoded(self, model: Model) -> bytes:
        """Return a model as JSON."""
        if model is not self._model:
            self._model, self._encoded = model, json_bytes(model)
        return self._encoded


class EventStream:
    """Makes the stream of each reader.

    An event's id consists of an id of this process and the event's number. Numbers restart with each process.
    """

    def __init__(self, broadcast: Broadcast, models: Models, limits: Limits) -> None:
        self._broadcast = broadcast
        self._models = models
        self._limits = limits
        self._process_id = f"{time.time_ns():x}"

    async def read(self, options: StreamOptions) -> AsyncGenerator[bytes, None]:
        """Yield the stream of one reader, starting with recent events, until closed."""
        status_due_s = time.monotonic()
        heartbeat_due_s = status_due_s + self._limits.heartbeat_s
        model: Model | None = None
        pace_s = self._limits.status_every_s if options.wants_status else self._limits.heartbeat_s
        with self._broadcast.wanting(pace_s), self._broadcast.open() as feed:
            yield b"retry: %d\n\n" % RETRY_MS + self._recent(options)
            while True:
                due_s = heartbeat_due_s if model is None else min(status_due_s, heartbeat_due_s)
                parts: list[bytes] = []
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout_at(due_s):
                        news = await feed.next()
                        parts += self._missed(news.dropped, options) + self._events(news.events, options)
                        model = news.model if news.model is not None and options.wants_status else model
                now_s = time.monotonic()
                if model is not None and now_s >= status_due_s:
                    parts.append(b"event: status\ndata: %s\n\n" % self._models.encoded(model))
                    status_due_s, model = now_s + self._limits.status_every_s, None
                if not parts and now_s >= heartbeat_due_s:
                    parts.append(HEARTBEAT)
                if parts:
                    heartbeat_due_s = now_s + self._limits.heartbeat_s
                    yield b"".join(parts)

    def _recent(self, options: StreamOptions) -> bytes:
        """Return the events before the reader's arrival, or after the last one that it received."""
        recent = self._broadcast.recent
        process_id, _, number = options.last_id.partition("-")
        if process_id == self._process_id and number.isascii() and number.isdigit() and len(number) < 20:
            last = int(number)
            missed = recent[0].number - last - 1 if recent and last < recent[0].number else 0
            newer = tuple(event for event in recent if event.number > last)
            return b"".join((*self._missed(missed, options), *self._events(newer, options)))
        return b"".join(self._events(recent, options))

    def _events(self, events: tuple[NumberedEvent, ...], options: StreamOptions) -> list[bytes]:
        if not options.wants_events:
            return []
        process_id = self._process_id.encode("ascii")
        return [
            b"event: event\nid: %s-%d\ndata: %s\n\n" % (process_id, event.number, json_bytes(event.as_data()))
            for event in events
        ]

    def _missed(self, count: int, options: StreamOptions) -> list[bytes]:
        return [b'event: missed\ndata: {"events":%d}\n\n' % count] if count and options.wants_events else []
