"""The system calls of a frame: waiting, reading, writing, the clock; of timers see ``transport.timerfd``.

Where the gateway is compiled they are those of ``_system.c``, which call the system and nothing else; where
it is not, those of Python, which do the same with more objects and with the interpreter's lock given back
and taken again for each. For bytes and open descriptors both have the same results and the same errors
(``tests/transport/test_system.py``).
"""

import os
import select
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Final

CLOCK: Final = time.CLOCK_BOOTTIME
Wait = Callable[[int, int], list[tuple[int, int]]]
"""Wait for ever (-1) or not at all (0) until descriptors can be worked on; return so many at most, each with
its events. An interrupted one may return early, and none."""


def _compiled() -> ModuleType | None:
    try:
        return import_module("gateway._system")
    except ImportError:
        return None


IN_C: Final = _compiled()
"""The calls in C, where the gateway is compiled."""

if IN_C is None:
    boot_ns: Callable[[], int] = partial(time.clock_gettime_ns, CLOCK)
    """Return the time since the machine was booted, in ns."""
    read: Callable[[int, int], bytes] = os.read
    """Read so many bytes at most, 4096, of a descriptor that does not block; b"": its end."""
    write: Callable[[int, bytes], int] = os.write
    """Write to a descriptor that does not block; return how much the system took."""
else:
    boot_ns, read, write = IN_C.boot_ns, IN_C.read, IN_C.write


def waiting(epoll: select.epoll) -> Wait:
    """Return what waits for the descriptors of an epoll, 64 at most at a time."""
    if IN_C is None:
        return epoll.poll
    wait: Wait = IN_C.waiting(epoll.fileno())
    return wait
