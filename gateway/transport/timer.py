"""One-shot timer with microsecond resolution on an absolute CLOCK_BOOTTIME deadline.

The timers of asyncio round up to a millisecond (epoll_wait takes milliseconds). A timerfd is a descriptor
that becomes readable at the very instant, so it serves for 3.5-character silences (1.75 ms).
"""

import asyncio
import os
from collections.abc import Callable

from gateway import system
from gateway.clock import boot_ns
from gateway.transport.timerfd import create, set_at


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
        self._fd = create()
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

    def put_off(self, deadline_ns: int) -> None:
        """Set the deadline, and the descriptor with it: to wake once in vain costs more than a system call.

        For a deadline that is put off again and again, and seldom met.
        """
        self._deadline_ns = deadline_ns
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
            set_at(self._fd, self._set_ns)

    def _woke(self) -> None:
        try:
            system.read(self._fd, 8)
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
