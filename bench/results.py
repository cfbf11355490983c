"""What a scenario hands over: tables to read, rows of the contract with their verdicts, bars to draw."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Self

from bench.figures import Interval, Judged, Series, Verdict, verdict


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the report: cells are text already."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Goal:
    """One number to reach, and what was found. ``found`` None: not measured, ``remark`` says why."""

    what: str
    limit: float
    found: Interval | None
    judged: Judged = Judged.ESTIMATE
    remark: str = ""

    @property
    def verdict(self) -> Verdict:
        """Whether it was reached."""
        return verdict(self.found, self.limit, self.judged)


@dataclass(frozen=True, slots=True)
class Bar:
    """What a candidate adds to the median round trip, in microseconds."""

    name: str
    added_us: Interval


@dataclass
class Section:
    """What one scenario found."""

    title: str
    text: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    goals: list[Goal] = field(default_factory=list)
    bars: list[Bar] = field(default_factory=list)
    is_measured: bool = True

    @classmethod
    def of(cls, title: str, *paragraphs: str) -> Self:
        """Return a section that begins with these paragraphs."""
        return cls(title, [*paragraphs])


def in_us(ns: float) -> str:
    """Nanoseconds as microseconds, with as many digits as mean something."""
    us = ns / 1000
    return f"{us:.0f}" if us >= 1000 else f"{us:.1f}"


def latency_table(
    series: Series, extra: "Sequence[tuple[str, Sequence[str]]]" = (), caption: str = ""
) -> Table:
    """Medians over rounds of each round's quantiles, and the worst of all, in µs.

    ``extra`` columns: head, and one cell a candidate.
    """
    rows: list[tuple[str, ...]] = []
    for index, (name, rounds) in enumerate(series.items()):
        cells = [in_us(median([getattr(one, share) for one in rounds])) for share in ("p50", "p99", "p999")]
        worst = in_us(max(one.worst for one in rounds))
        rows.append((name, *cells, worst, *(column[index] for _, column in extra)))
    heads = (head for head, _ in extra)
    return Table(("", "p50 µs", "p99 µs", "p99.9 µs", "worst µs", *heads), tuple(rows), caption)
