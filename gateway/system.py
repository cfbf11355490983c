"""The system calls of a frame: wait, read, write, clock; for timers see ``transport.timerfd``.

In a compiled gateway they are those of ``_system.c``, which only call the system. Otherwise they are
Python's, which do the same with more objects, and release the interpreter lock for each call. For bytes and
open descriptors both have the same results and the same errors (``tests/transport/test_system.py``).
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
"""Wait without limit (-1) or not at all (0) until descriptors are ready. Return at most the given number of
them, each with its events. An interrupted wait may return early, with none."""


def _compiled() -> ModuleType | None:
    try:
        return import_module("gateway._system")
    except ImportError:
        return None


IN_C: Final = _compiled()
"""The calls in C, if the gateway is compiled."""

if IN_C is None:
    boot_ns: Callable[[], int] = partial(time.clock_gettime_ns, CLOCK)
    """Return the time since the boot of the machine, in ns."""
    read: Callable[[int, int], bytes] = os.read
    """Read at most this many bytes, 4096, from a non-blocking descriptor; b"": end of file."""
    write: Callable[[int, bytes], int] = os.write
    """Write to a non-blocking descriptor; return how many bytes the system took."""
else:
    boot_ns, read, write = IN_C.boot_ns, IN_C.read, IN_C.write


def waiting(epoll: select.epoll) -> Wait:
    """Return the function that waits for the descriptors of an epoll, at most 64 at a time."""
    if IN_C is None:
        return epoll.poll
    wait: Wait = IN_C.waiting(epoll.fileno())
    return wait
