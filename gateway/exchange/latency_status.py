"""Measured times as the status shows them: microseconds, since the start.

Percentiles take a walk through all buckets, and what belongs to a line, a controller or an axis may first
have to be added up over many pairs. The loop has other things to do, so each look takes a few steps of that,
in turn.
"""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import add
from typing import Final

from gateway.exchange.latency import below_bounds, percentiles_ns, running_totals
from gateway.exchange.meter import LineMeter, Measured
from gateway.times import NS_PER_S, NS_PER_US

SHARES: Final = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
BOUNDS_US: Final = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)
"""Of the histogram of gateway time that the status shows; the budget lies in the middle of them."""
STEPS: Final = 3
"""So many steps are taken each time: a walk through the buckets, or the adding of one pair; 60 µs at most."""
AT_FIRST: Final = 12
"""So many figures that nothing has to be added up for are worked out at once, the first time that they are
wanted; the others are null until it is their turn."""

BOUNDS_NS: Final = tuple(int(bound_us * NS_PER_US) for bound_us in BOUNDS_US)

Figures = Mapping[str, float | None]
UNKNOWN: Final[Figures] = dict.fromkeys(("p50", "p99", "p999"))
Pick = Callable[[Measured], Iterable[int] | None]

PARTS: Final[dict[str, Pick]] = {
    "gateway_us": lambda measured: measured.gateway,
    "request_us": lambda measured: measured.request,
    "reply_us": lambda measured: measured.reply,
    "drive_us": lambda measured: measured.drive,
    "queue_us": lambda measured: measured.queue,
}
"""By the name in the status; ``queue_us`` counts only what had to wait."""


Key = tuple[str, str, str]
"""Line, controller or axis; its name; a key of :data:`PARTS`."""


class LatencyStatus:
    """What the status shows of one line's meter."""

    def __init__(self, meter: LineMeter) -> None:
        self._meter = meter
        self._figures: dict[Key, Figures] = {}
        self._below: dict[Key, list[int]] = {}
        """Gateway times up to each of :data:`BOUNDS_US`, and all; by line or axis."""
        self._turn: deque[Key] = deque()
        self._at_first = AT_FIRST
        self._pairs: dict[tuple[str, str], list[Measured]] = {}
        self._pairs_seen = 0
        self._sum: Iterable[int] = []
        self._to_add: deque[Iterable[int]] = deque()

    def refresh(self, now_ns: int) -> None:
        """Take a few steps; to be called before the figures are shown."""
        self._meter.turn(now_ns)
        self._at_first = AT_FIRST
        for _ in range(STEPS if self._turn else 0):
            self._step()

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
        """Return an axis's part: of all transactions with its unit id."""
        budget = self._meter.axes[name]
        return {
            **self._shown("axis", name),
            "budget_us": budget.budget_ns / NS_PER_US,
            "budget_overruns": budget.overruns,
            "is_over_budget": budget.is_over,
        }

    def _shown(self, kind: str, name: str) -> dict[str, object]:
        shown: dict[str, object] = {part: self._of((kind, name, part)) for part in PARTS}
        marks = [measured.high for measured in self._pairs_of(kind, name)]
        key = (kind, name, "gateway_us")
        shown["gateway_us"] = {
            **self._of(key),
            "max": round(max((mark.ever_ns for mark in marks), default=0) / NS_PER_US, 1),
            "max_minute": round(max((mark.minute_ns for mark in marks), default=0) / NS_PER_US, 1),
            **({"below": self._below[key]} if key in self._below else {}),
        }
        return shown

    def _of(self, key: Key) -> Figures:
        if key in self._figures:
            return self._figures[key]
        columns = self._columns(key)
        if len(columns) > 1 or self._at_first:
            self._turn.append(key)
            self._figures[key] = UNKNOWN if len(columns) > 1 else self._worked_out(key, columns)
            self._at_first -= len(columns) <= 1
            return self._figures[key]
        return UNKNOWN

    def _step(self) -> None:
        """Begin with the next figures, or go on adding for those that are in hand."""
        key = self._turn[0]
        if not self._to_add:
            columns = self._columns(key)
            if len(columns) <= 1:
                self._figures[key] = self._worked_out(key, columns)
                self._turn.rotate(-1)
                return
            self._sum, self._to_add = columns[0], deque(columns[1:])
        self._sum = list(map(add, self._sum, self._to_add.popleft()))
        if not self._to_add:
            self._figures[key] = self._worked_out(key, [self._sum])
            self._turn.rotate(-1)

    def _worked_out(self, key: Key, columns: Sequence[Iterable[int]]) -> Figures:
        """Return the percentiles, 0 of none; of the gateway time of lines and axes keep the histogram too."""
        if not columns:
            return dict.fromkeys(SHARES, 0.0)
        totals = running_totals(columns[0])
        if key[0] != "controller" and key[2] == "gateway_us":
            self._below[key] = below_bounds(totals, BOUNDS_NS)
        found = percentiles_ns(totals, tuple(SHARES.values()))
        if key[2] == "gateway_us":  # the middle of a bucket may lie above the highest time in it
            highest_ns = max((pair.high.ever_ns for pair in self._pairs_of(key[0], key[1])), default=0)
            found = [min(ns, highest_ns) for ns in found]
        return {share: round(ns / NS_PER_US, 1) for share, ns in zip(SHARES, found, strict=True)}

    def _columns(self, key: Key) -> list[Iterable[int]]:
        kind, name, part = key
        pick = PARTS[part]
        return [counts for pair in self._pairs_of(kind, name) if (counts := pick(pair)) is not None]

    def _pairs_of(self, kind: str, name: str) -> list[Measured]:
        measured = self._meter.measured
        if len(measured) != self._pairs_seen:
            self._pairs_seen = len(measured)
            self._pairs.clear()
        if (kind, name) not in self._pairs:
            unit_id = self._meter.axes[name].unit_id if kind == "axis" else -1
            self._pairs[kind, name] = [
                pair
                for (controller, unit), pair in measured.items()
                if kind == "line" or (kind == "controller" and controller == name) or unit == unit_id
            ]
        return self._pairs[kind, name]
