"""Whether the branch changes all the time: a controller repeats one target with jitter."""

from collections import deque
from typing import Final

from gateway.times import NS_PER_S

MOST: Final = 5
WITHIN_NS: Final = 10 * NS_PER_S
"""More changes than that within so long are reported."""
REPORT_EVERY_NS: Final = 60 * NS_PER_S


class Hunting:
    """The newest branch changes of one axis. Time is monotonic, in ns."""

    __slots__ = ("_changes_ns", "_reported_ns")

    def __init__(self) -> None:
        self._changes_ns: deque[int] = deque(maxlen=MOST + 1)
        self._reported_ns: int | None = None

    def count_change(self, now_ns: int) -> bool:
        """Count a change; return whether to report it now."""
        self._changes_ns.append(now_ns)
        if len(self._changes_ns) <= MOST or now_ns - self._changes_ns[0] > WITHIN_NS:
            return False
        if self._reported_ns is not None and now_ns - self._reported_ns < REPORT_EVERY_NS:
            return False
        self._reported_ns = now_ns
        return True
