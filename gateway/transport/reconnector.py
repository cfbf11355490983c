"""Keeps one channel open: opens it, waits until it is lost, opens it again."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from gateway.backoff import Backoff
from gateway.transport.errors import TransportError

FIRST_RETRY_S: Final = 0.01
"""A drive that was restarted, or a socket that the network closed, often responds again immediately."""
BACKOFF_START_S: Final = 0.1
BACKOFF_MAX_S: Final = 3.0
DEMAND_EVERY_S: Final = 0.1
"""A waiting caller starts at most one attempt in this time."""
BACKOFF_SPREAD: Final = (0.9, 1.1)
"""So that several gateways do not retry at the same time."""


class Reconnector:
    """Runs ``attempt`` repeatedly.

    ``attempt`` opens a channel and returns a future that ends when the channel is lost; it raises a
    ``TransportError`` on failure. ``was_of_use`` is called when the channel is lost: after a useful channel
    the next attempt follows immediately. ``on_failure`` gets every failure whose reason differs from the one
    before. With ``on_demand`` an attempt is made only when the channel is requested (:meth:`want`).
    """

    def __init__(
        self,
        attempt: Callable[[], Awaitable["asyncio.Future[None]"]],
        was_of_use: Callable[[], bool],
        on_failure: Callable[[str], None],
        *,
        on_demand: bool = False,
    ) -> None:
        self._attempt = attempt
        self._was_of_use = was_of_use
        self._on_failure = on_failure
        self._on_demand = on_demand
        self._task: asyncio.Task[None] | None = None
        self._backoff = Backoff(
            BACKOFF_START_S, BACKOFF_MAX_S, at_once_s=FIRST_RETRY_S, spread=BACKOFF_SPREAD
        )
        self._demanded = asyncio.Event()
        self._began_s = -DEMAND_EVERY_S
        self.failure = ""
        """Why the last attempt failed; empty while the channel is open."""
        self.opens = 0

    @property
    def is_running(self) -> bool:
        """Whether it keeps the channel open; from :meth:`start` to :meth:`stop`."""
        return self._task is not None and not self._task.done()

    def start(self, lost: "asyncio.Future[None] | None" = None) -> None:
        """Begin; ``lost`` belongs to a channel that is already open."""
        self._task = asyncio.create_task(self._run(lost))
        self._task.add_done_callback(_report_bug)

    async def stop(self) -> None:
        """End the attempts. An open channel is left to its owner."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
            self._task = None

    def failed(self, detail: str) -> None:
        """Record a failed attempt."""
        if detail != self.failure:
            self.failure = detail
            self._on_failure(detail)

    def want(self) -> None:
        """Make the next attempt without the rest of the pause: a caller waits for the channel."""
        self._demanded.set()

    async def _run(self, lost: "asyncio.Future[None] | None") -> None:
        while True:
            if lost is not None:
                self.failure = ""
                self.opens += 1
                self._demanded.clear()
                await asyncio.shield(lost)  # it belongs to the channel: stopping must not cancel it
                if self._was_of_use():
                    self._backoff.reset()
            lost = None
            await self._pause(self._backoff.next_s())
            self._began_s = asyncio.get_running_loop().time()
            try:
                lost = await self._attempt()
            except TransportError as error:
                self.failed(error.detail)

    async def _pause(self, pause_s: float) -> None:
        """Wait for ``pause_s``, or until the channel is requested and an attempt may begin."""
        loop = asyncio.get_running_loop()
        due_s = loop.time() + pause_s
        try:
            async with asyncio.timeout(None if self._on_demand else pause_s):
                await self._demanded.wait()
        except TimeoutError:
            return
        self._demanded.clear()
        await asyncio.sleep(max(min(self._began_s + DEMAND_EVERY_S, due_s) - loop.time(), 0.0))


def _report_bug(task: asyncio.Task[None]) -> None:
    """Report a bug of this program to the loop's handler: only a bug or a cancel ends a reconnector."""
    if not task.cancelled() and (error := task.exception()) is not None:
        handler = asyncio.get_running_loop().call_exception_handler
        handler({"message": "a connection is no longer kept up", "exception": error, "task": task})
