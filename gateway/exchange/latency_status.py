"""Measured times as the status shows them: microseconds, since the start.

Percentiles take a walk through a histogram each, and the loop has other things to do: a few of them are
worked out anew whenever somebody looks, in turn.
"""

from collections import deque
from typing import Final

from gateway.exchange.latency import HighMark, Histogram
from gateway.exchange.meter import LineMeter, Measured
from gateway.times import NS_PER_US

SHARES: Final = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
ANEW: Final = 3
"""So many histograms are walked through each time; each takes some 30 µs."""

Figures = dict[str, float]


class LatencyStatus:
    """What the status shows of one line's meter."""

    def __init__(self, meter: LineMeter) -> None:
        self._meter = meter
        self._figures: dict[int, tuple[Histogram, Figures]] = {}
        self._turn: deque[int] = deque()

    def refresh(self, now_ns: int, most: int = ANEW) -> None:
        """Work out some of the figures anew; to be called before they are shown."""
        self._meter.turn(now_ns)
        for _ in range(min(most, len(self._turn))):
            histogram, figures = self._figures[self._turn[0]]
            figures.update(_figures(histogram))
            self._turn.rotate(-1)

    def line(self) -> dict[str, object]:
        """Return the line's part."""
        meter = self._meter
        return {
            "gateway_us": {**self._of(meter.gateway), **_marks(meter.high)},
            "budget_overruns": meter.overruns,
            "wire_s": round(meter.wire_ns / 1e9, 6),
            "added_frames_s": round(meter.added_ns / 1e9, 6),
        }

    def controller(self, name: str) -> dict[str, object]:
        """Return a controller's part; nothing before its first exchange."""
        measured = self._meter.controllers.get(name)
        if measured is None:
            return {}
        more = {
            "queue_us": self._of(measured.queue),
            "drive_us": self._of(measured.drive),
            "exchange_us": self._of(measured.exchange),
        }
        return {**self._legs(measured), **more}

    def axis(self, name: str) -> dict[str, object]:
        """Return an axis's part."""
        budget = self._meter.axes[name]
        return {
            **self._legs(budget.measured),
            "budget_us": budget.budget_ns / NS_PER_US,
            "budget_overruns": budget.overruns,
            "is_over_budget": budget.is_over,
        }

    def _legs(self, measured: Measured) -> dict[str, object]:
        return {
            "gateway_us": {**self._of(measured.gateway), **_marks(measured.high)},
            "request_us": self._of(measured.request),
            "reply_us": self._of(measured.reply),
        }

    def _of(self, histogram: Histogram) -> Figures:
        key = id(histogram)
        if key not in self._figures:
            self._figures[key] = (histogram, _figures(histogram))
            self._turn.append(key)
        return self._figures[key][1]


def _figures(histogram: Histogram) -> Figures:
    found = histogram.percentiles_ns(*SHARES.values())
    return {name: round(ns / NS_PER_US, 1) for name, ns in zip(SHARES, found, strict=True)}


def _marks(high: HighMark) -> Figures:
    return {"max": round(high.ever_ns / NS_PER_US, 1), "max_minute": round(high.minute_ns / NS_PER_US, 1)}
