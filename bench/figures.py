"""The statistics of the bench: quantiles of a round, ratios over rounds with their intervals, verdicts.

Latencies of neighbouring exchanges depend on each other, so an interval comes from resampling whole rounds,
and the same rounds for both sides of a ratio: they were measured next to each other.
"""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import Final

RESAMPLES: Final = 4000
CONFIDENCE: Final = 0.95


def quantile(ascending: Sequence[float], share: float) -> float:
    """Return the smallest value that at least ``share`` of the values do not exceed.

    >>> quantile([10, 20, 30, 40], 0.5), quantile([10, 20, 30, 40], 0.51), quantile([7], 0.999)
    (20, 30, 7)

    Raises:
        ValueError: there is no value.
    """
    if not ascending:
        raise ValueError("a quantile of nothing")
    # Numbers such as 0.999 × 1000 are a hair above the whole number that they mean.
    rank = -int(-(len(ascending) * share - 1e-9) // 1)
    return ascending[min(max(rank, 1), len(ascending)) - 1]


@dataclass(frozen=True, slots=True)
class Round:
    """One round of one candidate, in nanoseconds."""

    p50: float
    p99: float
    p999: float
    worst: float

    @classmethod
    def of(cls, latencies: Sequence[int]) -> "Round":
        """Sum a round up."""
        ascending = sorted(latencies)
        p50, p99, p999 = (quantile(ascending, share) for share in (0.5, 0.99, 0.999))
        return cls(p50, p99, p999, ascending[-1])

    @classmethod
    def same(cls, value: float) -> "Round":
        """Return a round of which one number is known: a sum, or a mean."""
        return cls(value, value, value, value)


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and between which bounds it lies."""

    estimate: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.estimate:.2f} [{self.low:.2f}, {self.high:.2f}]"


Series = Mapping[str, Sequence[Round]]
"""Rounds by candidate; the rounds of one number were measured next to each other."""
Picked = Callable[[str, str], float]
"""Candidate and name of a quantile -> its median over the rounds that were picked."""


def over_rounds(series: Series, statistic: Callable[[Picked], float], seed: int = 1) -> Interval:
    """Compute a statistic, and its percentile bootstrap interval over rounds."""
    rounds = min(len(values) for values in series.values())
    columns = {
        (name, share): [getattr(one, share) for one in values[:rounds]]
        for name, values in series.items()
        for share in Round.__slots__
    }

    def with_rounds(picked: Sequence[int]) -> float:
        return statistic(lambda name, share: median([columns[name, share][i] for i in picked]))

    rng = random.Random(seed)
    resampled = sorted(with_rounds(rng.choices(range(rounds), k=rounds)) for _ in range(RESAMPLES))
    tail = (1 - CONFIDENCE) / 2
    return Interval(with_rounds(range(rounds)), quantile(resampled, tail), quantile(resampled, 1 - tail))


def ratio(series: Series, of: str, to: str, share: str = "p50") -> Interval:
    """Return how many times a quantile of ``of`` is that of ``to``."""
    chosen = {name: series[name] for name in (of, to)}
    return over_rounds(chosen, lambda pick: pick(of, share) / pick(to, share))


def added_ratio(series: Series, of: str, to: str, direct: str = "direct") -> Interval:
    """Return how many times what ``of`` adds to the median is what ``to`` adds to it."""
    chosen = {name: series[name] for name in (of, to, direct)}

    def added(pick: Picked) -> float:
        without = pick(direct, "p50")
        under = pick(to, "p50") - without
        return (pick(of, "p50") - without) / under if under > 0 else float("inf")

    return over_rounds(chosen, added)


def added(series: Series, of: str, direct: str = "direct") -> Interval:
    """Return what a candidate adds to the median, in nanoseconds."""
    chosen = {name: series[name] for name in (of, direct)}
    return over_rounds(chosen, lambda pick: pick(of, "p50") - pick(direct, "p50"))


class Judged(Enum):
    """Which number of an interval must keep the limit."""

    ESTIMATE = "estimate"
    LOW = "lower end"


class Verdict(Enum):
    """What became of a number to reach."""

    REACHED = "reached"
    WITHIN_NOISE = "reached within noise"
    MISSED = "**not reached**"
    NOT_MEASURED = "not measured"


def verdict(found: Interval | None, limit: float, judged: Judged = Judged.ESTIMATE) -> Verdict:
    """Compare with a limit that must not be exceeded.

    Within noise: it is kept by the number that counts, but not by the whole interval.
    """
    if found is None:
        return Verdict.NOT_MEASURED
    if found.high <= limit:
        return Verdict.REACHED
    kept = found.low if judged is Judged.LOW else found.estimate
    return Verdict.WITHIN_NOISE if kept <= limit else Verdict.MISSED
