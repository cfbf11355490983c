"""Notices that the process stood still: stopped, swapped out, suspended with its machine.

What waited meanwhile looks as if it had just come. A beat that is late tells how long nobody looked.
"""

from collections.abc import Callable
from typing import Final

from gateway.clock import boot_ns
from gateway.times import NS_PER_MS
from gateway.transport.timer import Timer

EVERY_NS: Final = 100 * NS_PER_MS
NEVER_NS: Final = 2**63 - 1
AFTERWARDS_NS: Final = 20 * NS_PER_MS
"""So long after the first beat that comes late, what is read may still be what had waited."""
WORTH_TELLING_NS: Final = 500 * NS_PER_MS


class Pulse:
    """Beats on the loop; ``on_standstill`` is told, in ns, how long a beat was late that was worth it."""

    __slots__ = ("_gap_ns", "_on_standstill", "_timer", "_until_ns", "due_ns")

    def __init__(self, on_standstill: Callable[[int], None]) -> None:
        self._on_standstill = on_standstill
        self._gap_ns = 0
        self._until_ns = 0
        self._timer = Timer(self._beat)
        self.due_ns = NEVER_NS
        """When the next beat is due: later than that, it is late. Not before the loop has begun to turn."""
        self._timer.arm(boot_ns())

    def close(self) -> None:
        """Beat no more."""
        self._timer.close()

    def gap_ns(self, now_ns: int) -> int:
        """Return how long the process had stood still before what is read now; 0 or less: it had not."""
        late_ns = now_ns - self.due_ns
        return self._gap_ns if now_ns < self._until_ns and self._gap_ns > late_ns else late_ns

    def _beat(self, now_ns: int) -> None:
        late_ns = 0 if self.due_ns == NEVER_NS else now_ns - self.due_ns
        self.due_ns = now_ns + EVERY_NS
        self._timer.arm(self.due_ns)
        if late_ns >= WORTH_TELLING_NS:
            self._gap_ns, self._until_ns = late_ns, now_ns + AFTERWARDS_NS
            self._on_standstill(late_ns)
        elif now_ns >= self._until_ns:
            self._gap_ns = 0
