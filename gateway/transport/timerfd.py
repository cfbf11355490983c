"""The timers of the system: timerfd_create(2), which Python has from 3.13 on."""

import os
import sys
from typing import Final

from gateway import system
from gateway.clock import CLOCK

_TFD_FLAGS: Final = os.O_NONBLOCK | os.O_CLOEXEC
"""TFD_NONBLOCK and TFD_CLOEXEC are defined as these (timerfd_create(2))."""
_TFD_TIMER_ABSTIME: Final = 1

if sys.version_info >= (3, 13):

    def create() -> int:
        """Return the descriptor of a new timer; it can be read at its instant."""
        return os.timerfd_create(CLOCK, flags=_TFD_FLAGS)

    def set_at(timer_fd: int, deadline_ns: int) -> None:
        """Set a timer to an instant of :data:`CLOCK`, in ns; 0 disarms it."""
        os.timerfd_settime_ns(timer_fd, flags=_TFD_TIMER_ABSTIME, initial=deadline_ns)

else:
    import ctypes

    from gateway.times import NS_PER_S

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

    def create() -> int:
        """Return the descriptor of a new timer; it can be read at its instant."""
        return _checked(_libc.timerfd_create(CLOCK, _TFD_FLAGS))

    def set_at(timer_fd: int, deadline_ns: int) -> None:
        """Set a timer to an instant of :data:`CLOCK`, in ns; 0 disarms it."""
        spec = _Itimerspec(0, 0, deadline_ns // NS_PER_S, deadline_ns % NS_PER_S)
        _checked(_libc.timerfd_settime(timer_fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None))


if system.IN_C is not None:
    set_at = system.IN_C.set_at  # the same: through ctypes it takes as long as half a frame
