"""What the relay needs of the system, in one place: clocks, waiting, bytes, timers.

In a compiled gateway the calls of a frame are those of ``_system.c``, which only call the system. Otherwise
they are Python's, which do the same with more objects, and release the interpreter lock for each call. For
bytes and open descriptors both have the same results and the same errors
(``tests/transport/test_system.py``).

Serial devices are in ``transport.devices``; sockets come from the loop. A simulated system takes the place of
this module and of that one (``tests/year``).
"""

import os
import select
import selectors
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final, NoReturn

CLOCK: Final = time.CLOCK_BOOTTIME
Wait = Callable[[int, int], list[tuple[int, int]]]
"""Wait without limit (-1) or not at all (0) until descriptors are ready. Return at most the given number of
them, each with its events. An interrupted wait may return early, with none."""
_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
_NS_PER_S: Final = 1_000_000_000


def _compiled() -> ModuleType | None:
    try:
        return import_module("gateway._system")
    except ImportError:
        return None


IN_C: Final = _compiled()
"""The calls in C, if the gateway is compiled."""

# --- Clocks

wall_s: Callable[[], float] = time.time
"""Return the time of day, in seconds since 1970."""
wall_ns: Callable[[], int] = time.time_ns
"""Return the same in ns."""
monotonic_ns: Callable[[], int] = time.monotonic_ns
"""Return a time in ns that stops while the machine is suspended."""
random_bytes: Callable[[int], bytes] = os.urandom
"""Return so many random bytes."""

end_now: Callable[[int], NoReturn] = os._exit
"""End the process with this code, and do nothing before."""


def boot_id() -> bytes:
    """Return the id of this boot of the machine; zeros if the system gives none."""
    try:
        return bytes.fromhex(_BOOT_ID.read_text().strip().replace("-", ""))
    except (OSError, ValueError):
        return bytes(16)


# --- Descriptors

close: Callable[[int], None] = os.close
"""Close a descriptor."""
Epoll: Final = select.epoll
"""Descriptors that are waited for together."""
Selector: Final = selectors.DefaultSelector
"""The same for a loop of asyncio."""

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


PTY_MAJORS: Final = range(136, 144)
"""Device numbers of UNIX98 pseudo terminals (Linux admin-guide/devices.txt)."""


def is_pty(descriptor: int) -> bool:
    """Whether a descriptor is the end of a pseudo terminal."""
    return os.major(os.fstat(descriptor).st_rdev) in PTY_MAJORS


def hang_ups(descriptor: int) -> Callable[[int], list[tuple[int, int]]]:
    """Return what tells whether the other end has closed or reset a connection: not empty if it has.

    It is called with 0, and does not wait.
    """
    asked = select.poll()
    asked.register(descriptor, select.POLLRDHUP)
    return asked.poll


# --- Timers: timerfd_create(2), which Python has from 3.13 on

_TFD_FLAGS: Final = os.O_NONBLOCK | os.O_CLOEXEC
"""TFD_NONBLOCK and TFD_CLOEXEC are defined as these (timerfd_create(2))."""
_TFD_TIMER_ABSTIME: Final = 1

if sys.version_info >= (3, 13):

    def create_timer() -> int:
        """Return the descriptor of a new timer; it can be read at its instant."""
        return os.timerfd_create(CLOCK, flags=_TFD_FLAGS)

    def set_at(timer_fd: int, deadline_ns: int) -> None:
        """Set a timer to an instant of :data:`CLOCK`, in ns; 0 disarms it."""
        os.timerfd_settime_ns(timer_fd, flags=_TFD_TIMER_ABSTIME, initial=deadline_ns)

else:
    import ctypes

    class _Itimerspec(ctypes.Structure):
        """Struct itimerspec; ``time_t`` of the symbols used here is a long on every Linux."""

        _fields_ = (
            ("interval_s", ctypes.c_long),
            ("interval_ns", ctypes.c_long),
            ("value_s", ctypes.c_long),
            ("value_ns", ctypes.c_long),
        )

    _libc = ctypes.CDLL(None, use_errno=True)

    def _checked(result: int) -> int:
        if result < 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code))
        return result

    def create_timer() -> int:
        """Return the descriptor of a new timer; it can be read at its instant."""
        return _checked(_libc.timerfd_create(CLOCK, _TFD_FLAGS))

    def set_at(timer_fd: int, deadline_ns: int) -> None:
        """Set a timer to an instant of :data:`CLOCK`, in ns; 0 disarms it."""
        spec = _Itimerspec(0, 0, deadline_ns // _NS_PER_S, deadline_ns % _NS_PER_S)
        _checked(_libc.timerfd_settime(timer_fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None))


set_in_python: Final = set_at
if IN_C is not None:
    set_at = IN_C.set_at  # the same: through ctypes it takes as long as half a frame
