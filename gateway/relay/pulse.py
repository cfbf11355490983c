"""Notices that the process stood still: stopped, swapped out, suspended with its machine.

What waited meanwhile looks as if it had just come. A beat that is late tells how long nobody looked.
"""

from collections.abc import Callable
from typing import Final

from gateway.clock import boot_ns
from gateway.times import NS_PER_MS
from gateway.transport.timer import Timer

EVERY_NS: Final = 20 * NS_PER_MS
"""A standstill may be longer than it is taken for by as much."""
NEVER_NS: Final = 2**63 - 1
FRESH_NS: Final = 5 * NS_PER_MS
"""By so much a beat may be late without the other end of a connection being looked at anew: then what the
system said of it with its bytes is 25 ms old at most, as if they had been under way for longer."""
AFTERWARDS_NS: Final = EVERY_NS + 2 * FRESH_NS
"""So long after the first beat that comes late, what is read may still be what had waited: until the next
one is late itself."""
SEEN_EVERY_NS: Final = EVERY_NS // 2
"""Traffic that is read so long after the last beat stands for the next one."""
WORTH_TELLING_NS: Final = 500 * NS_PER_MS


class Beats:
    """When the last beats came, and what their lateness says. Nothing here waits or looks at a clock."""

    __slots__ = ("_due_ns", "_gap_ns", "_gap_since_ns", "_until_ns")

    def __init__(self) -> None:
        self._gap_ns = 0
        self._gap_since_ns = 0
        self._until_ns = 0
        self._due_ns = NEVER_NS
        """When the next beat is due: later than that, it is late. Not before the first one has come."""

    def stood_still(self, now_ns: int, longer_than_ns: int) -> bool:
        """Whether what is read now may have waited while the process stood still for longer than that.

        The beat may come before what had waited is read, or after it: both are of one turn of the loop.
        """
        return now_ns - self._due_ns > longer_than_ns or (
            now_ns < self._until_ns and self._gap_ns > longer_than_ns
        )

    def beat(self, now_ns: int) -> int:
        """Take note of a beat; return how late it was, in ns, where that is worth telling: else 0."""
        late_ns = 0 if self._due_ns == NEVER_NS else max(0, now_ns - self._due_ns)
        self._due_ns = now_ns + EVERY_NS
        # Beats that traffic stands for come sooner: the gap before them counts as long as it would without.
        if late_ns > self._gap_ns or now_ns >= self._gap_since_ns + EVERY_NS:
            self._gap_ns, self._gap_since_ns, self._until_ns = late_ns, now_ns, now_ns + AFTERWARDS_NS
        return late_ns if late_ns >= WORTH_TELLING_NS else 0

    def traffic(self, now_ns: int) -> None:
        """Bytes were read, and are dealt with: the process runs."""


class Pulse(Beats):
    """Beats on the loop, and calls everything in ``on_beat`` with each beat.

    ``on_standstill`` is told, in ns, how long a beat was late that was worth it. A relay has one pulse.
    Traffic counts as a beat and resets the timer, for a wake-up with empty caches costs more than the beat.
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
        """Beat no more."""
        self._timer.close()

    def _beat(self, now_ns: int) -> None:
        late_ns = self.beat(now_ns)
        self._timer.put_off(now_ns + EVERY_NS)
        if late_ns:
            self._on_standstill(late_ns)
        for each in self.on_beat:
            each()
