"""The clock of everything that waits, ages or is paced: it goes on while the machine is suspended.

A request that a controller gave up while the machine slept has to be old when it wakes. What is read here is
CLOCK_BOOTTIME; that of a paused virtual machine stands still with it (``docs/security.md``).
"""

from typing import Final

from gateway import system

CLOCK: Final = system.CLOCK
_boot_ns: Final = system.boot_ns


def boot_ns() -> int:
    """Return the time since the machine was booted, in ns."""
    return _boot_ns()
