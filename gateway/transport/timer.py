"""One-shot timer with microsecond resolution on an absolute CLOCK_BOOTTIME deadline.

The timers of asyncio round up to a millisecond (epoll_wait takes milliseconds). A timerfd becomes readable at
the exact instant: so it is precise enough for silences of 3.5 characters (1.75 ms).
"""

import asyncio
from collections.abc import Callable

from gateway import system
from gateway.clock import boot_ns
from gateway.system import create_timer, set_at


class Timer:
    """Calls back once, with the time in ns, as soon as ``clock.boot_ns()`` has reached the deadline.

    It is made for deadlines that are set with every frame and rarely reached. Postponing or clearing one
    costs no system call; the descriptor then wakes once without effect and is set again.
    """

    def __init__(self, callback: Callable[[int], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._callback = callback
        self._deadline_ns: int | None = None
        self._set_ns = 0
        self._fd = create_timer()
        self._loop.add_reader(self._fd, self._woke)

    @property
    def deadline_ns(self) -> int | None:
        """The deadline in force."""
        return self._deadline_ns

    def arm(self, deadline_ns: int | None) -> None:
        """Set the deadline, replacing any other; None clears it. A deadline in the past fires immediately."""
        self._deadline_ns = deadline_ns
        if deadline_ns is not None and not 0 < self._set_ns <= deadline_ns:
            self._program(deadline_ns)

    def put_off(self, deadline_ns: int) -> None:
        """Set the deadline and the descriptor: a wake-up without effect costs more than a system call.

        For a deadline that is often postponed and rarely reached.
        """
        self._deadline_ns = deadline_ns
        self._program(deadline_ns)

    def close(self) -> None:
        """Release the descriptor; no callback comes after this. Closing twice is harmless."""
        self._deadline_ns = None
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            system.close(self._fd)
            self._fd = -1

    def _program(self, deadline_ns: int) -> None:
        if self._fd >= 0:
            self._set_ns = max(1, deadline_ns)  # 0 would disarm it
            set_at(self._fd, self._set_ns)

    def _woke(self) -> None:
        try:
            system.read(self._fd, 8)
        except BlockingIOError:
            return  # set again between the wake-up and this call
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
