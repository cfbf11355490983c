"""The clock of all waiting, ages and pacing: it continues while the machine is suspended.

If a controller gave up a request while the machine slept, that request must be old when it wakes. The clock
is CLOCK_BOOTTIME; on a paused virtual machine it stops (``docs/security.md``).
"""

from collections.abc import Callable
from typing import Final

from gateway import system

CLOCK: Final = system.CLOCK
boot_ns: Final[Callable[[], int]] = system.boot_ns
"""Return the time since the boot of the machine, in ns."""
