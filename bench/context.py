"""What every scenario works with: the effort of this run, the tools, and a way to say how far it is."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from bench.building import Programs
from bench.candidates import Tools
from bench.measuring import Meter

T = TypeVar("T")
ON_ONE: Final = "all on one processor"
ANYWHERE: Final = "wherever the system puts them"


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is measured."""

    rounds: int = 7
    count: int = 20_000
    is_quick: bool = False

    @classmethod
    def quick(cls) -> "Effort":
        """Enough to see that all works; the intervals are wide."""
        return cls(rounds=3, count=2_000, is_quick=True)

    def of(self, full: int, quick: int) -> int:
        """Return the number that belongs to this effort."""
        return quick if self.is_quick else full


Cpus = tuple[int, ...] | None
"""Processors that something may run on; None: wherever the system puts it."""


@dataclass(frozen=True, slots=True)
class Processors:
    """Where things run: ``one`` has what is measured, ``other`` what must not disturb it."""

    one: Cpus
    other: Cpus

    @property
    def placements(self) -> dict[str, Cpus]:
        """How the ends and what stands between them are placed.

        All on one processor, nobody waits for another processor to wake up: a round trip is the work that it
        takes, and the figures hardly scatter. The other way is what a machine does by itself.
        """
        return {ON_ONE: self.one, ANYWHERE: None}

    @classmethod
    def of_this_machine(cls) -> "Processors":
        """The first processor for the relay, the second for what must not disturb it."""
        allowed = sorted(os.sched_getaffinity(0))
        if len(allowed) < 2:
            return cls(None, None)
        return cls((allowed[0],), (allowed[1],))


@dataclass(frozen=True)
class Bench:
    """One run of the bench."""

    programs: Programs
    compared_python: Path
    compiled: Path
    """Where the gateway with its hot path compiled is imported from."""
    meter: Meter
    effort: Effort
    processors: Processors
    say: Callable[[str], None]

    def tools(self, cpus: Cpus) -> Tools:
        """Return what candidates are started with, to run on these processors."""
        return Tools(self.programs, self.compared_python, self.compiled, cpus)

    def rounds(self, what: str, count: int | None = None) -> Iterator[int]:
        """Count rounds, and say so."""
        total = self.effort.rounds if count is None else count
        for number in range(total):
            self.say(f"{what}: round {number + 1} of {total}")
            yield number

    def interleaved(
        self, what: str, candidates: Mapping[str, Callable[[], T]], count: int | None = None
    ) -> dict[str, Sequence[T]]:
        """Measure all candidates in turn, A B C A B C, one round each time."""
        found: dict[str, list[T]] = {name: [] for name in candidates}
        for _ in self.rounds(what, count):
            for name, measure in candidates.items():
                found[name].append(measure())
        return {**found}


class Progress:
    """Says on stderr what is being done: on a terminal in one line, elsewhere a line each."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()
        self._is_terminal = sys.stderr.isatty()

    def __call__(self, text: str) -> None:
        """Say it, with the time since the start."""
        seconds = int(time.monotonic() - self._start_s)
        line = f"[{seconds // 60:02}:{seconds % 60:02}] {text}"
        sys.stderr.write(f"\r\033[K{line}" if self._is_terminal else f"{line}\n")
        sys.stderr.flush()

    def end(self) -> None:
        """Leave the line."""
        if self._is_terminal:
            sys.stderr.write("\r\033[K")
