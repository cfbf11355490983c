"""The relay's loop: asyncio's, with a selector that handles the frames itself (``transport.selector``)."""

import asyncio
from collections.abc import Callable
from contextvars import Context
from functools import partial
from typing import Any, TypeVarTuple, Unpack, cast

from gateway.transport.selector import RelaySelector, Watcher

_Ts = TypeVarTuple("_Ts")


class RelayLoop(asyncio.SelectorEventLoop):
    """A loop whose ``add_reader`` calls back without a cycle of the loop.

    Such a callback runs inside ``select``, without a current task: it must not block, as in any loop.
    """

    def __init__(self) -> None:
        self.selector = RelaySelector()
        self.selector.on_error = self._failed
        super().__init__(self.selector)  # type: ignore[arg-type]

    def add_reader(self, fd: Any, callback: Callable[[Unpack[_Ts]], object], *args: *_Ts) -> None:
        """See ``asyncio``; also for a descriptor whose transport has paused reading."""
        watcher = partial(callback, *args) if args else callback
        self.selector.watch(fd if isinstance(fd, int) else fd.fileno(), cast("Watcher", watcher))

    def remove_reader(self, fd: Any) -> bool:
        """See ``asyncio``."""
        is_watched = self.selector.unwatch(fd if isinstance(fd, int) else fd.fileno())
        return is_watched or super().remove_reader(fd)

    def call_soon(
        self,
        callback: Callable[[Unpack[_Ts]], object],
        *args: *_Ts,
        context: Context | None = None,
    ) -> asyncio.Handle:
        """See ``asyncio``."""
        self.selector.has_work = True
        return super().call_soon(callback, *args, context=context)

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[_Ts]], object],
        *args: *_Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """See ``asyncio``."""
        self.selector.has_work = True
        return super().call_at(when, callback, *args, context=context)

    def stop(self) -> None:
        """See ``asyncio``."""
        self.selector.has_work = True
        super().stop()

    def _failed(self, error: Exception) -> None:
        self.call_exception_handler({"message": "a frame could not be worked on", "exception": error})
