"""The growth of a few counters within the last minute, from regular samples."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

from gateway.times import NS_PER_S

MINUTE_NS: Final = 60 * NS_PER_S
KEPT: Final = 16
"""Number of samples: one comes every few seconds, and the oldest within the minute counts."""


class LastMinute:
    """Counters of the last minute, or of the whole time if that is shorter. ``read`` returns their totals."""

    def __init__(self, read: Callable[[], Mapping[str, int]]) -> None:
        self._read = read
        self._samples: deque[tuple[int, Mapping[str, int]]] = deque(maxlen=KEPT)

    def tick(self, now_ns: int) -> None:
        """Take a sample; to be called at least every ten seconds."""
        self._samples.append((now_ns, dict(self._read())))

    def grown(self, now_ns: int) -> dict[str, int]:
        """Return the growth of each counter."""
        before: Mapping[str, int] = {}
        for taken_ns, sample in self._samples:
            if now_ns - taken_ns < MINUTE_NS:
                break
            before = sample
        return {name: total - before.get(name, 0) for name, total in self._read().items()}
