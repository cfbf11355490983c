"""Keeps one channel open for ever: opens it, waits until it is lost, opens it again."""

import asyncio
import os
from collections.abc import Awaitable, Callable
from typing import Final

from gateway.transport.errors import TransportError

FIRST_RETRY_S: Final = 0.01
"""A drive that was restarted, or a socket that the network cut, is often there again at once."""
BACKOFF_START_S: Final = 0.1
BACKOFF_MAX_S: Final = 3.0
BACKOFF_JITTER: Final = 0.1
"""± share, so that several gateways do not knock in step."""


class Backoff:
    """Pauses between attempts: one short one, then 100 ms doubling to 3 s, until somebody answered."""

    def __init__(self) -> None:
        self._attempt = 0

    def reset(self) -> None:
        """Begin anew: the other end has sent something."""
        self._attempt = 0

    def next_s(self) -> float:
        """Return the pause before the next attempt, in seconds."""
        attempt = self._attempt
        self._attempt += 1
        if attempt == 0:
            return FIRST_RETRY_S
        pause_s = min(BACKOFF_START_S * 2.0 ** min(attempt - 1, 16), BACKOFF_MAX_S)
        share = int.from_bytes(os.urandom(2)) / 0xFFFF
        return pause_s * (1.0 + BACKOFF_JITTER * (2.0 * share - 1.0))


class Keeper:
    """Runs ``attempt`` over and over.

    ``attempt`` opens a channel and returns a future that ends when that channel is lost; it raises a
    ``TransportError`` where it cannot. ``was_heard`` is asked once the channel is lost: a peer that had sent
    something is looked for anew at once. ``on_failure`` is told of every failed attempt whose reason differs
    from the one before.
    """

    def __init__(
        self,
        attempt: Callable[[], Awaitable["asyncio.Future[None]"]],
        was_heard: Callable[[], bool],
        on_failure: Callable[[str], None],
    ) -> None:
        self._attempt = attempt
        self._was_heard = was_heard
        self._on_failure = on_failure
        self._task: asyncio.Task[None] | None = None
        self._backoff = Backoff()
        self.failure = ""
        """Why the last attempt failed; empty while the channel is open."""
        self.opens = 0

    @property
    def is_running(self) -> bool:
        """Whether the channel is looked after; from :meth:`start` to :meth:`stop`."""
        return self._task is not None and not self._task.done()

    def start(self, lost: "asyncio.Future[None] | None" = None) -> None:
        """Begin; with ``lost``, of a channel that was opened already."""
        self._task = asyncio.create_task(self._run(lost))
        self._task.add_done_callback(_report_bug)

    async def stop(self) -> None:
        """End the attempts. A channel that is open is left to its owner."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
            self._task = None

    def failed(self, detail: str) -> None:
        """Note a failed attempt."""
        if detail != self.failure:
            self.failure = detail
            self._on_failure(detail)

    async def _run(self, lost: "asyncio.Future[None] | None") -> None:
        while True:
            if lost is not None:
                self.failure = ""
                self.opens += 1
                await asyncio.shield(lost)  # it belongs to the channel: stopping must not cancel it
                if self._was_heard():
                    self._backoff.reset()
            lost = None
            await asyncio.sleep(self._backoff.next_s())
            try:
                lost = await self._attempt()
            except TransportError as error:
                self.failed(error.detail)


def _report_bug(task: asyncio.Task[None]) -> None:
    """Nothing but a bug of ours ends a keeper other than by cancelling: let the loop's handler say so."""
    if not task.cancelled() and (error := task.exception()) is not None:
        handler = asyncio.get_running_loop().call_exception_handler
        handler({"message": "a connection is no longer kept up", "exception": error, "task": task})
