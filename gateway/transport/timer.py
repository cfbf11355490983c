"""One-shot timer with microsecond resolution on an absolute CLOCK_BOOTTIME deadline.

The timers of asyncio round up to a millisecond (epoll_wait takes milliseconds). A timerfd is a descriptor
that becomes readable at the very instant, so it serves for 3.5-character silences (1.75 ms).
"""

import asyncio
import ctypes
import os
import sys
from collections.abc import Callable
from typing import Final

from gateway.clock import CLOCK, boot_ns
from gateway.times import NS_PER_S

_TFD_FLAGS: Final = os.O_NONBLOCK | os.O_CLOEXEC
"""TFD_NONBLOCK and TFD_CLOEXEC are defined as these (timerfd_create(2))."""
_TFD_TIMER_ABSTIME: Final = 1

if sys.version_info >= (3, 13):

    def _create() -> int:
        return os.timerfd_create(CLOCK, flags=_TFD_FLAGS)

    def _set(timer_fd: int, deadline_ns: int) -> None:
        os.timerfd_settime_ns(timer_fd, flags=_TFD_TIMER_ABSTIME, initial=deadline_ns)

else:

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

    def _create() -> int:
        return _checked(_libc.timerfd_create(CLOCK, _TFD_FLAGS))

    def _set(timer_fd: int, deadline_ns: int) -> None:
        spec = _Itimerspec(0, 0, deadline_ns // NS_PER_S, deadline_ns % NS_PER_S)
        _checked(_libc.timerfd_settime(timer_fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None))


class Timer:
    """Calls back once, with the time in ns, as soon as ``clock.boot_ns()`` has reached the deadline.

    Arming is made for deadlines that are set with every frame and hardly ever met: one that moves later, or
    is taken away, costs no system call. The descriptor then wakes once in vain and is set anew.
    """

    def __init__(self, callback: Callable[[int], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._callback = callback
        self._deadline_ns: int | None = None
        self._set_ns = 0
        self._fd = _create()
        self._loop.add_reader(self._fd, self._woke)

    @property
    def deadline_ns(self) -> int | None:
        """The deadline in force."""
        return self._deadline_ns

    def arm(self, deadline_ns: int | None) -> None:
        """Set the deadline, replacing any other; None takes it away. One in the past fires at once."""
        self._deadline_ns = deadline_ns
        if deadline_ns is not None and not 0 < self._set_ns <= deadline_ns:
            self._program(deadline_ns)

    def close(self) -> None:
        """Give the descriptor back; no callback comes after this. Closing twice is harmless."""
        self._deadline_ns = None
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1

    def _program(self, deadline_ns: int) -> None:
        if self._fd >= 0:
            self._set_ns = max(1, deadline_ns)  # 0 would disarm it
            _set(self._fd, self._set_ns)

    def _woke(self) -> None:
        try:
            os.read(self._fd, 8)
        except BlockingIOError:
            return  # set anew between the wake-up and this call
        self._set_ns = 0
        deadline_ns = self._deadline_ns
        if deadline_ns is None:
            return
        now_ns = boot_ns()
        if now_ns < deadline_ns:
            self._program(deadline_ns)
            return
        self._deadline_ns = None
        self._callback(now_ns)
