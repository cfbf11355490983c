"""What the loop ran besides the exchanges; the event for an exceeded budget names it.

The loop does one thing at a time, and bytes that arrive meanwhile wait unread. So an exchange may have waited
for what ran just before the read, although its own time stamps begin later.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from gateway.clock import boot_ns
from gateway.status.model import Loop
from gateway.times import NS_PER_US

KEPT: Final = 16
JUST_BEFORE_NS: Final = 200 * NS_PER_US
"""What ended at most this long before an exchange began may have delayed it."""
WORTH_NAMING_NS: Final = 20 * NS_PER_US


class Activity:
    """The newest steps of the loop, and the longest of all."""

    def __init__(self) -> None:
        self._newest: deque[tuple[str, int, int]] = deque(maxlen=KEPT)
        self._longest_ns = 0
        self._longest = ""

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Record the time that the body takes."""
        began_ns = boot_ns()
        try:
            yield
        finally:
            self.add(name, began_ns, boot_ns())

    def add(self, name: str, began_ns: int, ended_ns: int) -> None:
        """Record a step."""
        self._newest.append((name, began_ns, ended_ns))
        if ended_ns - began_ns > self._longest_ns:
            self._longest_ns, self._longest = ended_ns - began_ns, name

    def between(self, since_ns: int, until_ns: int) -> str:
        """Return what ran between two instants, or just before, with its time; empty if nothing did."""
        return ", ".join(
            f"{name} {(ended_ns - began_ns) / NS_PER_US:.0f} µs"
            for name, began_ns, ended_ns in self._newest
            if ended_ns - began_ns >= WORTH_NAMING_NS
            and ended_ns >= since_ns - JUST_BEFORE_NS
            and began_ns <= until_ns
        )

    def status(self) -> Loop:
        """Return the longest step so far, for the status."""
        return Loop(longest_us=round(self._longest_ns / NS_PER_US, 1), longest=self._longest or None)
