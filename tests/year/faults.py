"""Faults, each kind from a random sequence of its own: without one kind the others stay as they were."""

import random
from collections import Counter
from collections.abc import Callable, Collection
from typing import Final

from tests.year.machine import Machine, S

LEVELS: Final = {"none": 0.0, "calm": 1.0, "rough": 20.0, "absurd": 200.0}
"""How often, compared with a calm machine."""
EXCHANGES: Final = {
    "request-lost": 1.0,
    "request-garbled": 1.0,
    "reply-lost": 1.0,
    "reply-garbled": 1.0,
    "reply-late": 0.5,
    "reply-doubled": 0.5,
    "refused": 0.5,
}
"""Of one exchange with a drive: of 10 000, in a calm machine."""
TIMES: Final = {
    "reset": 1.0,
    "stall": 1.0,
    "unplug": 0.5,
    "swap-adapters": 0.5,
    "other-drives": 0.5,
    "drive-off": 0.5,
    "reboot": 1.0,
    "zero-shift": 0.5,
    "halt": 1.0,
    "kill": 0.5,
    "kill-at-write": 0.5,
    "kill-at-store": 0.5,
    "power-cut-at-store": 0.1,
    "restart": 0.2,
    "power-cut": 0.1,
    "clock-step": 0.5,
    "slow-store": 1.0,
    "disk-full": 0.5,
}
"""Of the whole machine: how many in an hour, in a calm machine."""
KINDS: Final = (*EXCHANGES, *TIMES)


class Faults:
    """All faults of a run. ``without`` leaves kinds out: so a failing seed is made simpler."""

    def __init__(self, seed: int, level: str, without: Collection[str] = ()) -> None:
        self.seen: Counter[str] = Counter()
        self._seed, self._factor = seed, LEVELS[level]
        self._without = frozenset(without)

    def rng(self, kind: str) -> random.Random:
        """Return the random sequence of a kind."""
        return random.Random(f"{self._seed} {kind}")

    def share(self, line: str) -> "Share":
        """Return what goes wrong with the exchanges of a line."""
        chances = {kind: 0.0 if kind in self._without else each for kind, each in EXCHANGES.items()}
        return Share(self, self.rng(f"exchanges of {line}"), chances, min(1.0, 1e-4 * self._factor))

    def arrange(self, machine: Machine, does: dict[str, Callable[[random.Random], bool]]) -> None:
        """Have the other kinds happen; each returns whether it could."""
        for kind, what in does.items():
            per_hour = TIMES[kind] * self._factor
            if per_hour and kind not in self._without:
                self._later(machine, kind, what, self.rng(kind), 3600.0 / per_hour)

    def _later(
        self,
        machine: Machine,
        kind: str,
        what: Callable[[random.Random], bool],
        rng: random.Random,
        mean_s: float,
    ) -> None:
        machine.after(int(rng.expovariate(1.0 / mean_s) * S), self._happen, machine, kind, what, rng, mean_s)

    def _happen(
        self,
        machine: Machine,
        kind: str,
        what: Callable[[random.Random], bool],
        rng: random.Random,
        mean_s: float,
    ) -> None:
        self._later(machine, kind, what, rng, mean_s)
        self.seen[kind] += 1
        if not what(rng):
            self.seen[kind] -= 1


class Share:
    """What goes wrong with the exchanges of one line."""

    def __init__(self, faults: Faults, rng: random.Random, chances: dict[str, float], share: float) -> None:
        self._faults, self._rng, self._share = faults, rng, share
        self._kinds, self._chances = tuple(chances), tuple(chances.values())
        self._is_any = bool(share) and any(self._chances)
        self._most = sum(EXCHANGES.values())

    def choose(self) -> str:
        """Return what goes wrong with the next exchange, mostly "": nothing."""
        if not self._is_any or self._rng.random() >= self._share * self._most:
            return ""
        at = self._rng.random() * self._most
        for kind, chance in EXCHANGES.items():
            at -= chance
            if at < 0.0:
                if not self._chances[self._kinds.index(kind)]:
                    return ""
                self._faults.seen[kind] += 1
                return kind
        return ""
