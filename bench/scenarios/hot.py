"""The rows that need no sockets: what ``bench.hot_path`` prints, from several runs of it."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Final

from bench.context import Bench
from bench.errors import BenchError
from bench.figures import Interval, Round, Series, over_rounds
from bench.places import ROOT
from bench.processes import environment
from bench.results import Goal, Section, Table

TITLE: Final = "Inside the process"
RUNS: Final = 7
LINE: Final = re.compile(r"^\s*(\S.*?)\s+([\d.]+)\s+([\d.]+)\s*$")
"""A line of its output: name, ratio to the first, microseconds."""
EVEN_SMALL, EVEN_LARGE = "correction, 1 000 points, even grid", "correction, 100 000 points, even grid"
FREE_SMALL, FREE_LARGE = "correction, 1 000 points, free grid", "correction, 100 000 points, free grid"
REWRITING: Final = "rewriting one FC16 request: bytes in to bytes out"
EXCHANGE: Final = "a whole corrected FC16 exchange, RTU bytes to bytes and back"
SETPOINT: Final = "one setpoint of a stream, there and back"
WITH_TERMS: Final = (
    "the same with thermal and one cross term, whose axis stands",
    "the same with both, whose axis gets setpoints too",
)
MEASURING: Final = "measuring"
"""What its name begins with, where it is measured."""


def run(bench: Bench) -> Section:
    """Run it several times: medians, and intervals over the runs."""
    section = Section.of(
        TITLE,
        "What `python -m bench.hot_path` measures: each call many times, all candidates interleaved, in one "
        "process. The median over several runs of it, with the interval over runs.",
    )
    plain: dict[str, list[Round]] = {}
    compiled: dict[str, list[Round]] = {}
    for _ in bench.rounds(TITLE, bench.effort.of(RUNS, 3)):
        for packages, series in ((ROOT, plain), (bench.compiled, compiled)):
            for name, us in parsed(_printed(packages)).items():
                series.setdefault(name, []).append(Round.same(us))
    rows = tuple((name, str(in_us(compiled, name)), str(in_us(plain, name))) for name in plain)
    section.tables.append(Table(("", "compiled µs", "not compiled µs"), rows))
    of_terms = tuple(
        (name, str(ratio(compiled, name, SETPOINT)), str(ratio(plain, name, SETPOINT))) for name in WITH_TERMS
    )
    section.tables.append(Table(("÷ one setpoint without terms", "compiled", "not compiled"), of_terms))
    section.goals += goals(compiled, "compiled") + goals(plain, "not compiled")
    return section


def _printed(packages: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "bench.hot_path"],
        capture_output=True, text=True, check=False, cwd=packages, env=environment(packages), timeout=300,
    )  # fmt: skip
    if done.returncode:
        raise BenchError(f"bench.hot_path failed:\n{done.stderr}")
    return done.stdout


def parsed(printed: str) -> dict[str, float]:
    """Return microseconds by name.

    >>> parsed("             ratio   µs\\nreading one   1.00    0.65\\n  of it 2   0.50   0.30\\n")
    {'reading one': 0.65, 'of it 2': 0.3}
    """
    found = (LINE.match(line) for line in printed.splitlines())
    return {match[1]: float(match[3]) for match in found if match}


def in_us(series: Series, name: str) -> Interval:
    """Return the microseconds of one line, or whatever else its rounds hold."""
    return over_rounds({name: series[name]}, lambda pick: pick(name, "p50"))


def ratio(series: Series, of: str, to: str) -> Interval:
    """Return how many times one line another one is: run by run, so that a slow run counts for both."""
    shares = [one.p50 / other.p50 for one, other in zip(series[of], series[to], strict=True)]
    return in_us({of: [Round.same(share) for share in shares]}, of)


def goals(series: Series, build: str) -> list[Goal]:
    """Compare with what the design asks for; ``build`` says of which gateway."""

    def times(of: str, to: str) -> Interval | None:
        if of not in series or to not in series:
            return None
        return over_rounds({of: series[of], to: series[to]}, lambda pick: pick(of, "p50") / pick(to, "p50"))

    def us(name: str) -> Interval | None:
        return in_us(series, name) if name in series else None

    measuring = next((name for name in series if name.startswith(MEASURING)), MEASURING)
    measured_ns = us(measuring)
    if measured_ns is not None:
        measured_ns = Interval(
            *(1000 * value for value in (measured_ns.estimate, measured_ns.low, measured_ns.high))
        )
    return [
        Goal(f"correction of one position, 1 000 points, µs, {build}", 1.0, us(EVEN_SMALL)),
        Goal("… 100 000 points, µs", 1.0, us(EVEN_LARGE)),
        Goal("… even grid, 100 000 ÷ 1 000 points", 1.2, times(EVEN_LARGE, EVEN_SMALL)),
        Goal("… free grid, 100 000 ÷ 1 000 points", 2.0, times(FREE_LARGE, FREE_SMALL)),
        Goal(f"rewriting one FC16 request, bytes in to bytes out, µs, {build}", 3.0, us(REWRITING)),
        *([Goal(f"{EXCHANGE}, µs, {build}", 1.5, us(EXCHANGE))] if build == "compiled" else []),
        Goal(f"measuring, ns per exchange, {build}", 600.0, measured_ns),
    ]
