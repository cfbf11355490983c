"""The clock of everything that waits, ages or is paced: it goes on while the machine is suspended.

A request that a controller gave up while the machine slept has to be old when it wakes. What is read here is
CLOCK_BOOTTIME; that of a paused virtual machine stands still with it (``docs/security.md``).
"""

import time
from functools import partial
from typing import Final

CLOCK: Final = time.CLOCK_BOOTTIME
boot_ns: Final = partial(time.clock_gettime_ns, CLOCK)
"""Return the time since the machine was booted, in ns."""
