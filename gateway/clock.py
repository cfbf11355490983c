"""The clock of everything that waits, ages or is paced: it goes on while the machine is suspended.

A request that a controller gave up while the machine slept has to be old when it wakes. What is read here is
CLOCK_BOOTTIME; that of a paused virtual machine stands still with it (``docs/security.md``).
"""

import time
from typing import Final

CLOCK: Final = time.CLOCK_BOOTTIME
_clock_ns: Final = time.clock_gettime_ns


def boot_ns() -> int:
    """Return the time since the machine was booted, in ns."""
    return _clock_ns(CLOCK)
