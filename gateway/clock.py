"""The clock of everything that waits, ages or is paced: it goes on while the machine is suspended.

A request that a controller gave up while the machine slept has to be old when it wakes. What is read here is
CLOCK_BOOTTIME; that of a paused virtual machine stands still with it (``docs/security.md``).
"""

from collections.abc import Callable
from typing import Final

from gateway import system

CLOCK: Final = system.CLOCK
boot_ns: Final[Callable[[], int]] = system.boot_ns
"""Return the time since the machine was booted, in ns."""
