"""An open listener: the connections that came in by it, and who has to go."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Iterator

from starlette.types import ASGIApp
from uvicorn.server import ServerState

from gateway.supervisor.http.connection import Connection, silent_config
from gateway.supervisor.http.limits import Limits
from gateway.supervisor.http.refusals import Refused, tell_nobody


def silence_uvicorn() -> None:
    """Keep uvicorn's own words out of the log: what is wrong with requests is their senders' to know."""
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
        logger = logging.getLogger(name)
        logger.handlers = [logging.NullHandler()]
        logger.propagate = False


class Door:
    """Makes connections for a server of asyncio, and holds them to their limits.

    :meth:`watch` has to run while it is open, :meth:`close` ends it.
    """

    def __init__(self, limits: Limits, refused: Refused = tell_nobody) -> None:
        self.limits = limits
        self.refused = refused
        self.event_readers = 0
        self._state = ServerState()

    def serve(self, app: ASGIApp) -> None:
        """Answer with ``app`` from now on; before the first connection comes."""
        silence_uvicorn()
        self._config = silent_config(app, self.limits.keep_alive_s)

    def connection(self) -> Connection:
        """Return the protocol of a new connection."""
        return Connection(self._config, self._state, self.limits, self.make_room, self.refused)

    @property
    def _connections(self) -> list[Connection]:
        return [one for one in self._state.connections if isinstance(one, Connection)]

    def make_room(self) -> bool:
        """Whether one more connection may come; where there are too many another one goes for it.

        That is the one that has been idle for longest; where none is, the one that has taken nothing of its
        answer for longest. Else whoever asks much and reads nothing would keep everybody out.
        """
        connections = self._connections
        if len(connections) < self.limits.connections:
            return True
        idle = [one for one in connections if one.is_idle]
        stalled = [(since_s, one) for one in connections if (since_s := one.stalled_since_s) is not None]
        if idle:
            longest, which = min(idle, key=lambda one: one.quiet_since_s), "asked nothing"
        elif stalled:
            (_, longest), which = min(stalled, key=lambda pair: pair[0]), "took nothing of its answer"
        else:
            return False
        self.refused(longest.peer, f"too many connections at once: the one that {which} for longest")
        longest.give_way()
        return True

    @contextlib.contextmanager
    def event_reader(self) -> Iterator[bool]:
        """Count one reader of ``/events`` while it reads; yields whether there is room for it."""
        has_room = self.event_readers < self.limits.event_readers
        self.event_readers += has_room
        try:
            yield has_room
        finally:
            self.event_readers -= has_room

    async def watch(self) -> None:
        """Drop connections that are overdue, until cancelled."""
        while True:
            await asyncio.sleep(self.limits.sweep_s)
            now_s = time.monotonic()
            for one in self._connections:
                if one.is_overdue(now_s):
                    if one.is_slow:
                        self.refused(one.peer, "a request that never came whole")
                    one.drop()

    async def close(self) -> None:
        """Drop everybody; what was answered is on its way, what is being answered is not."""
        for one in self._connections:
            one.leave()
        tasks = list(self._state.tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
