"""Python's garbage collection of cycles, postponed while exchanges run.

The reference count frees most objects immediately. Only objects that refer to each other in a cycle wait for
a collection. Python starts it in the middle of any allocation; it takes 0.1 ms, and sometimes tens of
milliseconds. Here all loaded objects are excluded for good (``gc.freeze``), the automatic start is off
(``gc.disable``), and a timer collects while no exchange is on any wire.
"""

import asyncio
import gc
from collections.abc import Callable
from typing import Final

from gateway.clock import boot_ns
from gateway.relay.activity import Activity
from gateway.status.model import Garbage
from gateway.times import NS_PER_MS, NS_PER_S

CHECK_EVERY_S: Final = 0.25
BUSY_CHECK_S: Final = 0.02
"""Check interval while a due collection waits for an exchange to end: exchanges take milliseconds."""
WORTHWHILE: Final = 700
"""Growth of the container objects since the last collection: Python's own threshold. Without garbage in
cycles a relay stays near 0 and never collects."""
INTERVAL_NS: Final = 2 * NS_PER_S
FULL_AFTER: Final = 10
"""Young collections before a full one; a young collection that finds garbage makes the full one due
immediately."""
LONG_FULL_NS: Final = 2 * NS_PER_MS
"""If the last full collection took longer, the next one waits for ``QUIET_CHECKS`` without exchanges."""
QUIET_CHECKS: Final = 20
"""Five seconds, at ``CHECK_EVERY_S``."""
HARD_LIMIT: Final = 50_000
"""With this many new objects (about 10 MB) a young collection runs even during an exchange, for about 3 ms.
Without it memory would grow without limit on a line that is never idle."""
HARD_FULL_AFTER: Final = 100
"""After this many young collections a full one runs even during an exchange."""


class Collecting:
    """Collects while ``is_idle`` returns True. Times are ns of ``clock.boot_ns``."""

    def __init__(self, is_idle: Callable[[], bool], activity: Activity | None = None) -> None:
        self._is_idle = is_idle
        self._activity = activity or Activity()
        self._timer: asyncio.TimerHandle | None = None
        self._last_ns = 0
        self._young_since_full = 0
        self._found_garbage = False
        self._quiet_checks = 0
        self._last_full_ns = 0
        self._longest_ns = 0
        self._collections = 0
        self._full = 0
        self._forced = 0
        self._collected = 0

    def start(self) -> None:
        """Exclude all loaded objects, switch off the automatic collection, and start the timer."""
        gc.collect()
        gc.freeze()
        gc.disable()
        self._last_ns = boot_ns()
        self._timer = asyncio.get_running_loop().call_later(CHECK_EVERY_S, self._on_timer)

    def stop(self) -> None:
        """Return the collection to Python."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            gc.unfreeze()
            gc.enable()

    def status(self) -> Garbage:
        """Return its counters: all collections, and how many of them were full or forced."""
        return Garbage(
            collections=self._collections,
            full=self._full,
            forced=self._forced,
            collected=self._collected,
            longest_us=self._longest_ns // 1000,
        )

    def check(self, now_ns: int) -> float:
        """Collect if it is due and no exchange runs; return the seconds until the next check."""
        is_idle = self._is_idle()
        self._quiet_checks = self._quiet_checks + 1 if is_idle else 0
        young = gc.get_count()[0]
        if young >= HARD_LIMIT:
            self._forced += not is_idle
            if self._young_since_full >= HARD_FULL_AFTER:
                self._collect_full(now_ns)
            else:
                self._collect_young(now_ns)
        elif now_ns - self._last_ns < INTERVAL_NS or not self._is_due(young):
            return CHECK_EVERY_S
        elif not is_idle:
            return BUSY_CHECK_S
        elif self._is_full_due:
            self._collect_full(now_ns)
        else:
            self._collect_young(now_ns)
        return CHECK_EVERY_S

    @property
    def _is_full_due(self) -> bool:
        is_needed = self._found_garbage or self._young_since_full >= FULL_AFTER
        return is_needed and (self._last_full_ns <= LONG_FULL_NS or self._quiet_checks >= QUIET_CHECKS)

    def _is_due(self, young: int) -> bool:
        return young >= WORTHWHILE or self._is_full_due

    def _collect_young(self, now_ns: int) -> None:
        self._young_since_full += 1
        if self._collect(0, now_ns)[0]:
            self._found_garbage = True

    def _collect_full(self, now_ns: int) -> None:
        _, self._last_full_ns = self._collect(2, now_ns)
        self._full += 1
        self._young_since_full = 0
        self._found_garbage = False

    def _collect(self, generation: int, now_ns: int) -> tuple[int, int]:
        """Collect; return the number of garbage objects, and the ns that it took."""
        start_ns = boot_ns()
        with self._activity.of("garbage collection"):
            found = gc.collect(generation)
        took_ns = boot_ns() - start_ns
        self._last_ns = now_ns
        self._longest_ns = max(self._longest_ns, took_ns)
        self._collections += 1
        self._collected += found
        return found, took_ns

    def _on_timer(self) -> None:
        seconds = self.check(boot_ns())
        self._timer = asyncio.get_running_loop().call_later(seconds, self._on_timer)
