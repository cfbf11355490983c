"""The queue of one subscriber; if it is full, the oldest event is dropped.

A subscriber that is slow, stopped or hung costs only this queue. It holds the rest of a partly sent message,
the newest events, and a mark that a snapshot is due. The snapshot is made when it can be sent.
"""

import asyncio
from typing import Final

import msgspec

from gateway.broadcast import NewestQueue
from gateway.ipc.handlers import ASKED_AGAIN_S, LONGEST_WAIT_S, RequestHandlers
from gateway.ipc.messages import DEFAULT_INTERVAL_S, Happened, Snapshot, encode
from gateway.ipc.outbox import Outbox

EVENTS_KEPT: Final = 256
SENT_PER_PASS: Final = 8
"""Messages in one cycle of the loop: frames must not wait for a burst of events."""


class Subscriber:
    """Events and snapshots for one connection; ``handlers`` returns the current model."""

    def __init__(self, outbox: Outbox, interval_s: float, handlers: RequestHandlers) -> None:
        self._outbox = outbox
        self._interval_s = interval_s
        self._handlers = handlers
        self._events: NewestQueue[Happened] = NewestQueue(EVENTS_KEPT)
        self._is_snapshot_due = True
        self._snapshots_dropped = 0
        self._loop = asyncio.get_running_loop()
        self._since_s = self._loop.time()
        """When a snapshot last became due."""
        self._next_s = self._since_s
        """When the next one is due."""
        self._timer: asyncio.Handle = self._loop.call_soon(self._tick)
        self._more = self._timer

    def publish_event(self, happened: Happened) -> None:
        """Take an event; :meth:`pump` sends it."""
        self._events.put(happened)
        soon_s = self._since_s + DEFAULT_INTERVAL_S
        if not self._is_snapshot_due and soon_s < self._next_s:  # an event brings the next snapshot forward
            self._be_due(soon_s)

    def follow(self, interval_s: float) -> None:
        """Set another interval, counted from the last snapshot."""
        self._interval_s = interval_s
        self._be_due(self._since_s + interval_s)

    def pump(self) -> None:
        """Send what can be sent now: first the events, which are older than a snapshot still to be made."""
        for _ in range(SENT_PER_PASS):
            if self._outbox.waiting_bytes or not (self._events.items or self._is_snapshot_due):
                return
            if not self._events.items and self._has_to_wait():
                self._more.cancel()
                self._more = self._loop.call_later(ASKED_AGAIN_S, self.pump)
                return
            dropped, self._snapshots_dropped = self._events.take_dropped() + self._snapshots_dropped, 0
            if self._events.items:
                happened = self._events.items.popleft()
                self._outbox.write(encode(msgspec.structs.replace(happened, dropped=dropped)))
            else:
                self._is_snapshot_due = False
                self._outbox.write(encode(Snapshot(status=self._handlers.status(), dropped=dropped)))
        self._more.cancel()
        self._more = self._loop.call_soon(self.pump)

    def close(self) -> None:
        """Send nothing any more."""
        self._timer.cancel()
        self._more.cancel()
        self._events.items.clear()
        self._is_snapshot_due = False

    def _has_to_wait(self) -> bool:
        return self._handlers.has_to_wait() and self._loop.time() < self._since_s + LONGEST_WAIT_S

    def _tick(self) -> None:
        self._since_s = self._loop.time()
        self._be_due(self._since_s + self._interval_s)
        self.pump()

    def _be_due(self, at_s: float) -> None:
        self._next_s = at_s
        self._timer.cancel()
        self._timer = self._loop.call_at(at_s, self._due)

    def _due(self) -> None:
        self._snapshots_dropped += self._is_snapshot_due
        self._is_snapshot_due = True
        self._tick()
