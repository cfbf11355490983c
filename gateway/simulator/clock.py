"""The only place where the simulator reads a clock: everything else gets the time as an argument."""

import asyncio
from collections.abc import Callable
from typing import Final

from gateway.options import Option
from gateway.times import NS_PER_S

SimulationClock = Callable[[], float]
"""Returns the seconds that have passed in the simulated world."""
SPEED_UP: Final = Option("Machine time per real time; wire times do not change.", min=0.001)


def scaled_clock(speed_up: float = 1.0) -> SimulationClock:
    """Return the clock of a world that runs at ``speed_up`` times real time; it starts at 0.

    Needs a running loop.

    Raises:
        OptionError: it is below 0.001, or not a finite number.
    """
    SPEED_UP.check("speed_up", speed_up)
    loop = asyncio.get_running_loop()
    started_s = loop.time()
    return lambda: (loop.time() - started_s) * speed_up


def loop_now_ns() -> int:
    """Time of the running loop, for framing and wire times: these are never sped up."""
    return int(asyncio.get_running_loop().time() * NS_PER_S)


class DeadlineTimer:
    """One timer that follows a moving deadline."""

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._handle: asyncio.TimerHandle | None = None
        self._due_ns: int | None = None

    def set(self, due_ns: int | None) -> None:
        """Fire at ``due_ns`` of the loop's time; None: not at all."""
        if due_ns == self._due_ns:
            return
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        self._due_ns = due_ns
        if due_ns is not None:
            self._handle = asyncio.get_running_loop().call_at(due_ns / NS_PER_S, self._go_off)

    def _go_off(self) -> None:
        self._handle, self._due_ns = None, None
        self._ring()
