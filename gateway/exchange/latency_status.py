"""Measured times as the status shows them: microseconds, since the start.

Percentiles take a walk through all buckets, and the loop has other things to do: a few of them are worked out
anew whenever somebody looks, in turn.
"""

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from gateway.exchange.latency import percentiles_ns
from gateway.exchange.meter import LineMeter, Measured
from gateway.times import NS_PER_S, NS_PER_US

SHARES: Final = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
ANEW: Final = 2
"""So many of the figures are worked out anew each time; each takes some 30 µs for each pair behind it."""
AT_FIRST: Final = 12
"""So many are worked out for the first time each time; the others are null until it is their turn."""

Figures = Mapping[str, float | None]
UNKNOWN: Final[Figures] = dict.fromkeys(("p50", "p99", "p999"))
Pick = Callable[[Measured], list[int] | None]

PARTS: Final[dict[str, Pick]] = {
    "gateway_us": lambda measured: measured.gateway,
    "request_us": lambda measured: measured.request,
    "reply_us": lambda measured: measured.reply,
    "drive_us": lambda measured: measured.drive,
    "queue_us": lambda measured: measured.queue,
}
"""By the name in the status; ``queue_us`` counts only what had to wait."""


class LatencyStatus:
    """What the status shows of one line's meter."""

    def __init__(self, meter: LineMeter) -> None:
        self._meter = meter
        self._figures: dict[tuple[str, str, str], Figures] = {}
        self._turn: deque[tuple[str, str, str]] = deque()
        self._at_first = AT_FIRST

    def refresh(self, now_ns: int) -> None:
        """Work out some of the figures anew; to be called before they are shown."""
        self._meter.turn(now_ns)
        self._at_first = AT_FIRST
        for _ in range(min(ANEW, len(self._turn))):
            key = self._turn[0]
            self._figures[key] = self._work_out(*key)
            self._turn.rotate(-1)

    def line(self) -> dict[str, object]:
        """Return the line's part."""
        meter = self._meter
        return {
            **self._shown("line", ""),
            "budget_overruns": meter.overruns,
            "wire_s": round(meter.wire_ns / NS_PER_S, 6),
            "added_frames_s": round(meter.added_ns / NS_PER_S, 6),
        }

    def controller(self, name: str) -> dict[str, object]:
        """Return a controller's part."""
        return self._shown("controller", name)

    def axis(self, name: str) -> dict[str, object]:
        """Return an axis's part: of all exchanges with its unit id."""
        budget = self._meter.axes[name]
        return {
            **self._shown("axis", name),
            "budget_us": budget.budget_ns / NS_PER_US,
            "budget_overruns": budget.overruns,
            "is_over_budget": budget.is_over,
        }

    def _shown(self, kind: str, name: str) -> dict[str, object]:
        shown: dict[str, object] = {part: self._of((kind, name, part)) for part in PARTS}
        marks = [measured.high for measured in self._pairs(kind, name)]
        shown["gateway_us"] = {
            **self._of((kind, name, "gateway_us")),
            "max": round(max((mark.ever_ns for mark in marks), default=0) / NS_PER_US, 1),
            "max_minute": round(max((mark.minute_ns for mark in marks), default=0) / NS_PER_US, 1),
        }
        return shown

    def _pairs(self, kind: str, name: str) -> Iterable[Measured]:
        unit_id = self._meter.axes[name].unit_id if kind == "axis" else -1
        for (controller, unit), measured in self._meter.measured.items():
            if kind == "line" or (kind == "controller" and controller == name) or unit == unit_id:
                yield measured

    def _of(self, key: tuple[str, str, str]) -> Figures:
        if key not in self._figures:
            if not self._at_first:
                return UNKNOWN
            self._at_first -= 1
            self._figures[key] = self._work_out(*key)
            self._turn.append(key)
        return self._figures[key]

    def _work_out(self, kind: str, name: str, part: str) -> Figures:
        pick = PARTS[part]
        columns = [counts for measured in self._pairs(kind, name) if (counts := pick(measured)) is not None]
        found = [0] * len(SHARES)
        if columns:
            counts = columns[0] if len(columns) == 1 else list(map(sum, zip(*columns, strict=True)))
            found = percentiles_ns(counts, tuple(SHARES.values()))
        return {share: round(ns / NS_PER_US, 1) for share, ns in zip(SHARES, found, strict=True)}
