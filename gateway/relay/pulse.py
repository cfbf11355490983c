"""Detects that the process was halted: stopped, swapped out, or suspended with the machine.

Bytes that waited meanwhile look as if they had just come. A late beat shows how long the process was halted.
"""

from collections.abc import Callable
from typing import Final

from gateway.clock import boot_ns
from gateway.times import NS_PER_MS
from gateway.transport.timer import Timer

EVERY_NS: Final = 20 * NS_PER_MS
"""Between two beats. A standstill may be longer than measured by this much."""
NEVER_NS: Final = 2**63 - 1
FRESH_NS: Final = 5 * NS_PER_MS
"""If a beat is later than this, the gateway checks whether the other ends of connections are still there.
Otherwise the system's information about a connection is at most 25 ms older than the bytes, as if these had
been in transit for longer."""
AFTERWARDS_NS: Final = EVERY_NS + 2 * FRESH_NS
"""For this long after a late beat, the bytes read may still have waited. After that the next beat is late
itself."""
SEEN_EVERY_NS: Final = EVERY_NS // 2
"""Traffic that is read this long after the last beat counts as the next beat."""
WORTH_TELLING_NS: Final = 500 * NS_PER_MS


class Beats:
    """When the last beats came, and how late they were. Nothing here waits or reads a clock."""

    __slots__ = ("_due_ns", "_gap_ns", "_gap_since_ns", "_until_ns")

    def __init__(self) -> None:
        self._gap_ns = 0
        self._gap_since_ns = 0
        self._until_ns = 0
        self._due_ns = NEVER_NS
        """When the next beat is due; after that it is late. ``NEVER_NS`` until the first beat has come."""

    def stood_still(self, now_ns: int, longer_than_ns: int) -> bool:
        """Whether what is read now may have waited while the process was halted for longer than that.

        The beat may come before or after the waiting bytes are read: both happen in one cycle of the loop.
        """
        return now_ns - self._due_ns > longer_than_ns or (
            now_ns < self._until_ns and self._gap_ns > longer_than_ns
        )

    def beat(self, now_ns: int) -> int:
        """Record a beat; return how late it was, in ns, if that is worth a report, else 0."""
        late_ns = 0 if self._due_ns == NEVER_NS else max(0, now_ns - self._due_ns)
        self._due_ns = now_ns + EVERY_NS
        # Traffic that counts as a beat comes sooner: the gap before it stays valid as long as without
        # traffic.
        if late_ns > self._gap_ns or now_ns >= self._gap_since_ns + EVERY_NS:
            self._gap_ns, self._gap_since_ns, self._until_ns = late_ns, now_ns, now_ns + AFTERWARDS_NS
        return late_ns if late_ns >= WORTH_TELLING_NS else 0

    def traffic(self, now_ns: int) -> None:
        """Bytes were read and are being handled: the process runs."""


class Pulse(Beats):
    """Beats on the loop, and calls everything in ``on_beat`` with each beat.

    ``on_standstill`` gets the delay of a beat in ns, if it is worth a report. A relay has one pulse. Traffic
    counts as a beat and resets the timer: a wake-up with empty caches costs more than the beat.
    """

    __slots__ = ("_on_standstill", "_timer", "on_beat")

    def __init__(self, on_standstill: Callable[[int], None]) -> None:
        super().__init__()
        self.on_beat: list[Callable[[], None]] = []
        self._on_standstill = on_standstill
        self._timer = Timer(self._beat)
        self._timer.arm(boot_ns())

    def traffic(self, now_ns: int) -> None:
        """See ``Beats``."""
        if now_ns - self._due_ns > SEEN_EVERY_NS - EVERY_NS:
            self._beat(now_ns)

    def close(self) -> None:
        """Stop the beats."""
        self._timer.close()

    def _beat(self, now_ns: int) -> None:
        late_ns = self.beat(now_ns)
        self._timer.put_off(now_ns + EVERY_NS)
        if late_ns:
            self._on_standstill(late_ns)
        for each in self.on_beat:
            each()
