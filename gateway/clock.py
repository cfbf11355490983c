"""The clock of all waiting, ages and pacing: it continues while the machine is suspended.

If a controller gave up a request while the machine slept, that request must be old when it wakes. The clock
is CLOCK_BOOTTIME; on a paused virtual machine it stops (``docs/security.md``). Beside it is the time of day.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final

from gateway import system

boot_ns: Final[Callable[[], int]] = system.boot_ns
"""Return the time since the boot of the machine, in ns."""
wall_s: Final[Callable[[], float]] = system.wall_s
"""Return the time of day, in seconds since 1970."""
monotonic_ns: Final[Callable[[], int]] = system.monotonic_ns
"""Return a time in ns that stops while the machine is suspended: for reports that are limited by time."""


def now_utc() -> datetime:
    """Return the time of day as a date."""
    return datetime.fromtimestamp(wall_s(), UTC)
