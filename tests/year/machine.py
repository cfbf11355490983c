"""The machine: its time, what is due, its descriptors, and the one process of the gateway on it.

Nothing here reads a real clock. Time passes only while the process waits: the machine then does what is due
next, until one of the awaited descriptors is ready. So the process computes in no time.
"""

import errno
import heapq
import os
import random
import select
import selectors
from collections.abc import Callable, Mapping
from typing import Any, Final, NoReturn

MS: Final = 1_000_000
S: Final = 1_000_000_000
FIRST_NUMBER: Final = 1 << 20
"""Of a simulated descriptor: no real one has it."""
HUNG_UP: Final = select.EPOLLRDHUP | select.EPOLLHUP | select.EPOLLERR
ALWAYS: Final = select.EPOLLHUP | select.EPOLLERR
"""What epoll reports although nobody asked for it."""
BEGINS_WALL_S: Final = 1_767_225_600
"""2026-01-01 00:00 UTC."""
MOST_WAITS: Final = 20_000
"""Waits at one instant: a process with more of them spins."""


class KilledError(SystemExit):
    """The process is killed here. A SystemExit, because asyncio lets nothing else through a callback."""


class SpinningError(SystemExit):
    """The process waits again and again, and nothing happens between."""


class Descriptor:
    """Something open that the process can wait for, read and write."""

    def __init__(self, machine: "Machine") -> None:
        self.machine = machine
        self.events = 0
        self.watched: list[tuple[Epoll, int]] = []
        self.number = machine.open(self)

    def show(self, events: int) -> None:
        """Change what can be done with it now (epoll_ctl(2))."""
        self.events = events
        for epoll, mask in self.watched:
            epoll.note(self.number, events & (mask | ALWAYS))

    def read(self, size: int) -> bytes:
        """As read(2)."""
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    def write(self, data: bytes) -> int:
        """As write(2)."""
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    def close(self) -> None:
        """As close(2)."""
        if self.machine.descriptors.pop(self.number, None) is not None:
            for epoll, _ in self.watched:
                epoll.forget(self.number)
            self.machine.release(self.number)

    def kill(self) -> None:
        """Its process was killed."""
        self.close()


class Timer(Descriptor):
    """As timerfd_create(2), with an absolute instant."""

    _set = 0

    def set_at(self, deadline_ns: int) -> None:
        """Set it; 0 disarms it. The instant counts from the boot."""
        if deadline_ns < 0:
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        self._set += 1
        if self.events:
            self.show(0)
        if deadline_ns:
            self.machine.at(deadline_ns + self.machine.booted_ns, self._due, self._set)

    def read(self, size: int) -> bytes:
        """As read(2): how often it was due."""
        if not self.events:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        self.show(0)
        return b"\x01\0\0\0\0\0\0\0"

    def _due(self, number: int) -> None:
        if number == self._set and self.number in self.machine.descriptors:
            self.show(select.EPOLLIN)


class Epoll(Descriptor):
    """As epoll(7), level-triggered. Real descriptors may be registered too: see ``Machine.look``."""

    def __init__(self, machine: "Machine") -> None:
        super().__init__(machine)
        self._masks: dict[int, int] = {}
        self.ready: dict[int, int] = {}
        """Events by descriptor, in the order in which they became ready."""

    def fileno(self) -> int:
        """Return its number."""
        return self.number

    def register(self, number: int, mask: int) -> None:
        """Wait for a descriptor too."""
        self._masks[number] = mask
        descriptor = self.machine.descriptors.get(number)
        if descriptor is not None:
            descriptor.watched.append((self, mask))
            self.note(number, descriptor.events & (mask | ALWAYS))
        else:
            self.machine.real[number] = self, mask

    def unregister(self, number: int) -> None:
        """Do not wait for it any more."""
        del self._masks[number]
        descriptor = self.machine.descriptors.get(number)
        if descriptor is not None:
            descriptor.watched = [each for each in descriptor.watched if each[0] is not self]
        self.machine.real.pop(number, None)
        self.note(number, 0)

    def forget(self, number: int) -> None:
        """It was closed."""
        self._masks.pop(number, None)
        self.note(number, 0)

    def note(self, number: int, events: int) -> None:
        """Take the events of a descriptor."""
        ready = self.ready
        if events:
            ready[number] = events
        else:
            ready.pop(number, None)
        if self.watched:
            self.show(select.EPOLLIN if ready else 0)

    def wait(self, how_long: int, most: int) -> list[tuple[int, int]]:
        """As epoll_wait(2): until something is ready (-1), or not at all (0)."""
        machine, ready = self.machine, self.ready
        machine.check()
        if machine.real_ends or machine.is_stirred:
            machine.look()
        if how_long:
            step = machine.step
            while not ready and not machine.is_interrupted:
                step()
        machine.stand_still()
        machine.is_interrupted = False
        found = list(ready.items())
        return found if len(found) <= most else found[:most]


class Selector:
    """As ``selectors``, for the descriptors of asyncio."""

    def __init__(self, machine: "Machine") -> None:
        self._epoll = Epoll(machine)
        self._keys: dict[int, selectors.SelectorKey] = {}

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """See ``selectors``."""
        number = fileobj if isinstance(fileobj, int) else fileobj.fileno()
        key = self._keys[number] = selectors.SelectorKey(fileobj, number, events, data)
        is_read, is_write = events & selectors.EVENT_READ, events & selectors.EVENT_WRITE
        self._epoll.register(
            number, (select.EPOLLIN if is_read else 0) | (select.EPOLLOUT if is_write else 0)
        )
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """See ``selectors``."""
        number = fileobj if isinstance(fileobj, int) else fileobj.fileno()
        key = self._keys.pop(number)
        self._epoll.unregister(number)
        return key

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """See ``selectors``."""
        self.unregister(fileobj)
        return self.register(fileobj, events, data)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """See ``selectors``; it does not wait."""
        found = []
        for number, events in self._epoll.wait(0, 1 << 16):
            key = self._keys[number]
            told = selectors.EVENT_READ if events & ~select.EPOLLOUT else 0
            told |= selectors.EVENT_WRITE if events & ~select.EPOLLIN else 0
            found.append((key, told & key.events))
        return found

    def fileno(self) -> int:
        """Return the number of its epoll."""
        return self._epoll.number

    def get_key(self, fileobj: Any) -> selectors.SelectorKey:
        """See ``selectors``."""
        return self._keys[fileobj if isinstance(fileobj, int) else fileobj.fileno()]

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        """See ``selectors``."""
        return self._keys

    def close(self) -> None:
        """See ``selectors``."""
        self._epoll.close()


class Machine:
    """Time and descriptors. ``now_ns`` is the time of the world; a boot begins at ``booted_ns`` of it."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.booted_ns = -100 * S
        self.wall_ahead_ns = 0
        """What steps have added to the time of day."""
        self.boots = 1
        self.descriptors: dict[int, Descriptor] = {}
        self.real: dict[int, tuple[Epoll, int]] = {}
        """Real descriptors that the process waits for: the socket of the relay and its connections."""
        self.real_ends: dict[int, Callable[[], object]] = {}
        """Their other ends in the world, each with what is called when it can be read."""
        self.is_stirred = False
        """Whether a real descriptor was ready when they were looked at last."""
        self.is_dead = False
        """The process was killed: none of its calls does anything any more."""
        self.writes_left = 0
        """It is killed at this write from now on; 0: at none."""
        self.stores_left = 0
        """It is killed within or behind this store into a record from now on; 0: at none."""
        self.slow_store_ns = 0
        """The next store takes so long: the disk writes its page back."""
        self.at_slow_store: Callable[[], object] = _nothing
        """Called then."""
        self.slow_ns = 0
        """When one had ended."""
        self.is_disk_full = False
        self.at_store: Callable[[], object] = _nothing
        """Called then, before it is killed."""
        self.signals: dict[int, Callable[[], object]] = {}
        """What the process does at a signal."""
        self.is_interrupted = False
        """A signal has come: the wait ends early."""
        self.on_end: list[Callable[[], object]] = []
        """Called once when the process has ended."""
        self.random = random.Random(0)
        self._still_until_ns = 0
        self._waits = 0
        self._due: list[tuple[int, int, Callable[..., object], tuple[Any, ...]]] = []
        self._number = 0
        self._free: list[int] = []
        self._next = FIRST_NUMBER

    # --- time

    def at(self, instant_ns: int, call: Callable[..., object], *arguments: Any) -> None:
        """Call at an instant of the world; one that has passed already counts as now."""
        self._number += 1
        now_ns = self.now_ns
        due_ns = max(now_ns, instant_ns)
        heapq.heappush(self._due, (due_ns, self._number, call, arguments))

    def after(self, ns: int, call: Callable[..., object], *arguments: Any) -> None:
        """Call after a time."""
        self.at(self.now_ns + ns, call, *arguments)

    def step(self) -> None:
        """Do what is due next."""
        instant_ns, _, call, arguments = heapq.heappop(self._due)
        if instant_ns > self.now_ns:
            self.now_ns = instant_ns
            self._waits = 0
        call(*arguments)

    def run_until(self, instant_ns: int) -> None:
        """Let time pass while no process runs."""
        self.at(instant_ns, _nothing)
        while self.now_ns < instant_ns:
            self.step()

    def halt(self, ns: int) -> None:
        """Let the process stand still, from its next wait on."""
        self._still_until_ns = self.now_ns + ns
        self.at(self._still_until_ns, _nothing)  # it ends then, and not with what is due next

    def stand_still(self) -> None:
        """Do what is due while the process stands still."""
        while self.now_ns < self._still_until_ns:
            self.step()

    # --- descriptors

    def open(self, descriptor: Descriptor) -> int:
        """Return the number of a new descriptor: the lowest that is free."""
        if self._free:
            number = heapq.heappop(self._free)
        else:
            number, self._next = self._next, self._next + 1
        self.descriptors[number] = descriptor
        return number

    def look(self) -> None:
        """Learn which real descriptors are ready. They change only by the process and by the world itself."""
        poll = select.poll()
        for number, (_, mask) in self.real.items():
            poll.register(number, mask)
        for number in self.real_ends:
            poll.register(number, select.POLLIN)
        found = dict(poll.poll(0))
        self.is_stirred = bool(found)
        for number, (epoll, mask) in list(self.real.items()):
            epoll.note(number, found.get(number, 0) & (mask | ALWAYS))
        for number, call in list(self.real_ends.items()):
            if number in found and self.real_ends.get(number) is call:
                call()

    def release(self, number: int) -> None:
        """Give a number back."""
        heapq.heappush(self._free, number)

    def descriptor(self, number: int) -> Descriptor:
        """Return what has a number.

        Raises:
            OSError: nothing has it.
        """
        found = self.descriptors.get(number)
        if found is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        return found

    # --- the process

    def check(self) -> None:
        """Let nothing of a killed process go on, and notice one that spins.

        Raises:
            KilledError: it was killed.
            SpinningError: it waited too often at one instant.
        """
        if self.is_dead:
            raise KilledError
        self._waits += 1
        if self._waits > MOST_WAITS:
            raise SpinningError

    def kill(self) -> NoReturn:
        """Kill the process where it is: called by what is due, or in one of its own calls.

        Raises:
            KilledError: always.
        """
        self.is_dead = True
        raise KilledError

    def store(self, buffer: memoryview, at: int, data: bytes) -> None:
        """Store into memory that outlives the process; a kill leaves the first bytes of a store, or all.

        Raises:
            KilledError: it is killed here.
        """
        if self.is_dead:
            raise KilledError
        if self.slow_store_ns:
            slow_ns, self.slow_store_ns = self.slow_store_ns, 0
            self.at_slow_store()
            self.halt(slow_ns)
            self.stand_still()
            self.slow_ns = self.now_ns
        if self.stores_left:
            self.stores_left -= 1
            if not self.stores_left:
                data = data[: self.random.randrange(len(data) + 1)]
                buffer[at : at + len(data)] = data
                self.at_store()
                self.kill()
        buffer[at : at + len(data)] = data

    def signal(self, number: int) -> None:
        """Send a signal; a process that does not expect it is not there yet."""
        handler = self.signals.get(number)
        if handler is not None and not self.is_dead:
            handler()
            self.is_interrupted = True

    def begin_process(self) -> None:
        """Begin a process; the one before has ended."""
        self.is_dead, self.writes_left, self.stores_left, self.slow_store_ns = False, 0, 0, 0
        self._still_until_ns = self._waits = 0
        self.signals.clear()

    def end_process(self) -> None:
        """Close what the process left open."""
        self.is_dead = True
        self.signals.clear()
        self.real.clear()
        self.is_stirred = False
        for descriptor in list(self.descriptors.values()):
            descriptor.kill()
        on_end, self.on_end = self.on_end, []
        for call in on_end:
            call()

    def reboot(self) -> None:
        """Begin a new boot: its clock begins anew."""
        self.boots += 1
        self.booted_ns = self.now_ns


def _nothing() -> None:
    pass
