"""Measured durations for the status: in microseconds, since the start.

Percentiles need a pass through all buckets. The figures of a line, a controller or an axis may first have to
be summed over many pairs. The event loop has other work, so each poll of the status takes only a few of these
steps, in turn.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from operator import add
from typing import Final

from msgspec import UNSET

from gateway.exchange.latency import below_bounds, percentiles_ns, running_totals
from gateway.exchange.meter import LineMeter, Measured
from gateway.status.axis import AxisTimes
from gateway.status.line import ControllerStatus, LineStatus
from gateway.status.times import NOT_WORKED_OUT, Figures, GatewayTimes
from gateway.times import NS_PER_S, NS_PER_US

SHARES: Final[tuple[float, ...]] = (0.5, 0.99, 0.999)
BOUNDS_US: Final = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)
"""Bounds of the histogram of gateway time in the status; the budget is in the middle of them."""
STEPS: Final = 3
"""Steps for each poll: one pass through the buckets, or the sum of one pair; 60 µs at most."""
AT_FIRST: Final = 12
"""Number of figures without a sum that are computed immediately at their first request. The others are null
until their turn comes."""

BOUNDS_NS: Final = tuple(int(bound_us * NS_PER_US) for bound_us in BOUNDS_US)

Pick = Callable[[Measured], Iterable[int] | None]

PARTS: Final[dict[str, Pick]] = {
    "gateway_us": lambda measured: measured.gateway,
    "request_us": lambda measured: measured.request,
    "reply_us": lambda measured: measured.reply,
    "drive_us": lambda measured: measured.drive,
    "queue_us": lambda measured: measured.queue,
}
"""By the name in the status; ``queue_us`` counts only requests that had to wait."""


Key = tuple[str, str, str]
"""Line, controller or axis; its name; a key of :data:`PARTS`."""


class LatencyStatus:
    """The statistics of one line's meter for the status."""

    def __init__(self, meter: LineMeter) -> None:
        self._meter = meter
        self._figures: dict[Key, Figures] = {}
        self._below: dict[Key, list[int]] = {}
        """Gateway times up to each of :data:`BOUNDS_US`, and all; by line or axis."""
        self._round_robin: deque[Key] = deque()
        self._at_first = AT_FIRST
        self._pairs: dict[tuple[str, str], list[Measured]] = {}
        self._pairs_seen = 0
        self._sum: Iterable[int] = []
        self._to_add: deque[Iterable[int]] = deque()

    def refresh(self, now_ns: int) -> None:
        """Take a few steps; must be called before the figures are shown."""
        self._meter.tick(now_ns)
        self._at_first = AT_FIRST
        for _ in range(STEPS if self._round_robin else 0):
            self._step()

    def fill_line(self, status: LineStatus) -> None:
        """Fill in the line's part."""
        meter = self._meter
        self._fill(status, "line", "")
        status.budget_overruns = meter.overruns
        status.wire_s = round(meter.wire_ns / NS_PER_S, 6)
        status.added_frames_s = round(meter.added_ns / NS_PER_S, 6)

    def fill_controller(self, status: ControllerStatus) -> None:
        """Fill in a controller's part."""
        self._fill(status, "controller", status.name)

    def axis(self, name: str) -> AxisTimes:
        """Return an axis's part: of all transactions with its unit id."""
        budget = self._meter.axes[name]
        status = AxisTimes(
            budget_us=budget.budget_ns / NS_PER_US,
            budget_overruns=budget.overruns,
            is_over_budget=budget.is_over,
        )
        self._fill(status, "axis", name)
        return status

    def _fill(self, status: LineStatus | ControllerStatus | AxisTimes, kind: str, name: str) -> None:
        status.gateway_us = self._gateway_times(kind, name)
        status.request_us = self._of((kind, name, "request_us"))
        status.reply_us = self._of((kind, name, "reply_us"))
        status.drive_us = self._of((kind, name, "drive_us"))
        status.queue_us = self._of((kind, name, "queue_us"))

    def _gateway_times(self, kind: str, name: str) -> GatewayTimes:
        key = (kind, name, "gateway_us")
        figures = self._of(key)
        marks = [measured.high for measured in self._pairs_of(kind, name)]
        return GatewayTimes(
            p50=figures.p50,
            p99=figures.p99,
            p999=figures.p999,
            max=round(max((mark.ever_ns for mark in marks), default=0) / NS_PER_US, 1),
            max_minute=round(max((mark.minute_ns for mark in marks), default=0) / NS_PER_US, 1),
            below=self._below.get(key, UNSET),
        )

    def _of(self, key: Key) -> Figures:
        if key in self._figures:
            return self._figures[key]
        columns = self._columns(key)
        if len(columns) > 1 or self._at_first:
            self._round_robin.append(key)
            self._figures[key] = NOT_WORKED_OUT if len(columns) > 1 else self._worked_out(key, columns)
            self._at_first -= len(columns) <= 1
            return self._figures[key]
        return NOT_WORKED_OUT

    def _step(self) -> None:
        """Begin with the next figures, or continue the sum that has begun."""
        key = self._round_robin[0]
        if not self._to_add:
            columns = self._columns(key)
            if len(columns) <= 1:
                self._figures[key] = self._worked_out(key, columns)
                self._round_robin.rotate(-1)
                return
            self._sum, self._to_add = columns[0], deque(columns[1:])
        self._sum = list(map(add, self._sum, self._to_add.popleft()))
        if not self._to_add:
            self._figures[key] = self._worked_out(key, [self._sum])
            self._round_robin.rotate(-1)

    def _worked_out(self, key: Key, columns: Sequence[Iterable[int]]) -> Figures:
        """Return the percentiles, or zeros; keep the histogram of the gateway time of lines and axes."""
        if not columns:
            return Figures(p50=0.0, p99=0.0, p999=0.0)
        totals = running_totals(columns[0])
        if key[0] != "controller" and key[2] == "gateway_us":
            self._below[key] = below_bounds(totals, BOUNDS_NS)
        found = percentiles_ns(totals, SHARES)
        if key[2] == "gateway_us":  # the middle of a bucket may be above the highest value in it
            highest_ns = max((pair.high.ever_ns for pair in self._pairs_of(key[0], key[1])), default=0)
            found = [min(ns, highest_ns) for ns in found]
        p50, p99, p999 = [round(ns / NS_PER_US, 1) for ns in found]
        return Figures(p50=p50, p99=p99, p999=p999)

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
