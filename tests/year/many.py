"""Many seeds, each in a program of its own; a seed with a finding is made simpler before it is printed."""

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil
from pathlib import Path

EACH_S = 3600.0
"""Simulated time of a seed."""


@dataclass(frozen=True)
class Result:
    """What a seed came to."""

    seed: int
    simulated_s: float
    took_s: float
    """Processor time."""
    digest: str
    finding: str
    """"": everything held."""
    seen: dict[str, int]
    is_compiled: bool = False


def play_seed(
    seed: int, until_s: float, faults: str, without: Sequence[str] = (), checkout: Path | None = None
) -> Result:
    """Play one seed in a program of its own, around the gateway of a checkout; None: the present folder."""
    command = [sys.executable, "-m", "tests.year", str(seed), "--json", "--until", repr(until_s)]
    command += ["--faults", faults, "--without", *without]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=checkout)
    if not done.stdout.startswith("{"):
        return Result(seed, 0.0, 0.0, "", f"the simulation broke: {done.stderr[-2000:]}", {})
    return Result(**json.loads(done.stdout))


def play_many(hours: float, first: int, faults: str, jobs: int) -> int:
    """Play seeds until so many hours have been simulated; print their sum; return 1 if one has a finding."""
    seeds = range(first, first + ceil(hours * 3600.0 / EACH_S))
    until_s = hours * 3600.0 / len(seeds)
    seen: Counter[str] = Counter()
    simulated_s = took_s = 0.0
    findings: list[Result] = []
    with ThreadPoolExecutor(jobs) as pool:
        for result in pool.map(lambda seed: play_seed(seed, until_s, faults), seeds):
            seen.update(result.seen)
            simulated_s, took_s = simulated_s + result.simulated_s, took_s + result.took_s
            _say(f"seed {result.seed}: {result.simulated_s:.0f} s, digest {result.digest} {result.finding}")
            if result.finding:
                findings.append(result)
    _say("\n".join(f"{count:10d}  {name}" for name, count in sorted(seen.items())))
    speed = simulated_s / took_s if took_s else 0.0
    _say(f"{len(seeds)} seeds, {simulated_s / 3600.0:.1f} h simulated, {speed:.0f} s in a second of a core")
    for result in findings:
        _say("\n".join(_shortest(result, faults)))
    return 1 if findings else 0


def _shortest(found: Result, faults: str) -> Iterator[str]:
    """Leave out one kind of fault after the other, as long as something is found; say how to see it again."""
    yield f"\nFOUND by seed {found.seed}: {found.finding}"
    without: list[str] = []
    for kind in [name.removeprefix("fault ") for name in found.seen if name.startswith("fault ")]:
        again = play_seed(found.seed, found.simulated_s + 1.0, faults, [*without, kind])
        if again.finding:
            without, found = [*without, kind], again
    until_s = ceil(found.simulated_s) + 1
    yield f"again: python -m tests.year {found.seed} --faults {faults} --until {until_s} --trace"
    if without:
        yield f"with --without {' '.join(without)} it is: {found.finding}"


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
