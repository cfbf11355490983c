"""The selector of the relay's loop: it handles the bytes of descriptors without a cycle of the loop.

A cycle of asyncio's loop takes longer than the work on a frame: a handle for each descriptor, a queue, two
reads of the clock. Here the loop waits in ``select``. A *watched* descriptor is handled there as soon as
``epoll_wait`` reports it; only other work makes ``select`` return. The descriptors of asyncio itself are
behind one descriptor (epoll(7): one epoll may watch another), so both kinds are served in the order in which
the system reports them.

It uses public interfaces of the standard library only: asyncio takes any selector (``SelectorEventLoop``).
"""

import select
import selectors
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import ceil
from typing import Any, Final

from gateway import system
from gateway.clock import boot_ns
from gateway.system import create_timer, read, set_at, waiting
from gateway.times import NS_PER_S

READABLE: Final[int] = select.EPOLLIN
HUNG_UP: Final[int] = select.EPOLLRDHUP | select.EPOLLHUP | select.EPOLLERR
"""The other end has closed or reset the connection."""
Watcher = Callable[[], object]
"""Called when its descriptor can be read."""
MOST_AT_ONCE: Final = 64
"""Descriptors that one wait reports; the next wait reports the others, in their order."""


class RelaySelector:
    """A selector of asyncio that handles watched descriptors itself.

    ``on_error`` gets the exceptions of watchers: they must not end the loop.
    """

    def __init__(self) -> None:
        self._others = system.Selector()
        self._others_fd: int = self._others.fileno()
        self._epoll = system.Epoll()
        self._epoll.register(self._others_fd, READABLE)
        self._wait = waiting(self._epoll)
        self._alarm_fd = create_timer()
        self._epoll.register(self._alarm_fd, READABLE)
        self._wakes_ns = 0
        """When the timer wakes it; 0: it does not."""
        self._watchers: dict[int, Watcher] = {}
        self.has_work = False
        """Whether the loop has got new work since it began to wait."""
        self.events = 0
        """The system's events of the descriptor being handled: see epoll_ctl(2)."""
        self.on_error: Callable[[Exception], None] = _raise

    def watch(self, descriptor: int, watcher: Watcher) -> None:
        """Call ``watcher`` whenever a descriptor can be read, or was hung up; replaces an earlier watcher."""
        if descriptor not in self._watchers:
            self._epoll.register(descriptor, READABLE | select.EPOLLRDHUP)
        self._watchers[descriptor] = watcher

    def unwatch(self, descriptor: int) -> bool:
        """Stop watching a descriptor, before it is closed. Return whether it was watched."""
        if self._watchers.pop(descriptor, None) is None:
            return False
        self._epoll.unregister(descriptor)
        return True

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """See ``selectors``: wait until there is work for the loop, or for ``timeout`` seconds.

        It may return earlier, with an empty list, because of the time-out of an earlier call.
        """
        self.has_work = False
        how_long = -1
        if timeout is not None:
            if timeout > 0.0:
                self._wake_at(boot_ns() + ceil(timeout * NS_PER_S))
            else:
                how_long = 0
        others_fd, alarm_fd, watchers, wait = self._others_fd, self._alarm_fd, self._watchers, self._wait
        while True:
            found = wait(how_long, MOST_AT_ONCE)
            is_over = not found or not how_long
            is_others = False
            for descriptor, events in found:
                if descriptor == others_fd:
                    is_others = True
                    continue
                if descriptor == alarm_fd:
                    self._woke()
                    is_over = True
                    continue
                watcher = watchers.get(descriptor)
                if watcher is not None:  # else an earlier watcher has closed it
                    self.events = events
                    try:
                        watcher()
                    except Exception as error:  # noqa: BLE001, as asyncio does with its own callbacks
                        self.on_error(error)
            if is_others:
                return self._others.select(0)
            if is_over or self.has_work:
                return []

    def _wake_at(self, end_ns: int) -> None:
        """End the wait by a timer: a time-out of ``epoll_wait`` would be set again with each frame."""
        if not 0 < self._wakes_ns <= end_ns:
            self._wakes_ns = end_ns
            set_at(self._alarm_fd, end_ns)

    def _woke(self) -> None:
        self._wakes_ns = 0
        with suppress(BlockingIOError):  # set again between the wake-up and this call
            read(self._alarm_fd, 8)

    # --- asyncio's own descriptors ---------------------------------------------------------------------

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """See ``selectors``."""
        return self._others.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """See ``selectors``."""
        return self._others.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """See ``selectors``."""
        return self._others.modify(fileobj, events, data)

    def fileno(self) -> int:
        """Return the descriptor that can be read when there is work."""
        return self._epoll.fileno()

    def get_key(self, fileobj: Any) -> selectors.SelectorKey:
        """See ``selectors``."""
        return self._others.get_key(fileobj)

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        """See ``selectors``."""
        return self._others.get_map()

    def close(self) -> None:
        """See ``selectors``."""
        self._watchers.clear()
        self._epoll.close()
        system.close(self._alarm_fd)
        self._others.close()


def _raise(error: Exception) -> None:
    raise error
