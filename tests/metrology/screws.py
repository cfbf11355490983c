"""Ten kinds of simulated screws: what a table leaves of them in truth, and what was predicted.

``python -m tests.metrology.screws [SEEDS]`` prints the figures of all of them: noise-free and noisy, with few
targets and with many. The truth is E after ISO 230-2 without scatter, of 8001 places in both directions, with
the drive where the table sends it.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import exp, log, pi, sin
from random import Random
from statistics import fmean, median
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.lookup import correction_at
from gateway.metrology.program import random_targets
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Built, Recipe, build_from
from gateway.metrology.shapes import Fit, Shape

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
PLACES: Final = 8001
FACTOR: Final = 1.5
"""Within which a prediction has to lie of the truth."""
WITHIN_UM: Final = 0.2
"""Below this a difference of truth and prediction is nothing: no instrument shows it."""
WORSE: Final = 1.1
"""By so much more than the best of them the default may leave."""

Curve = Callable[[float], float]


@dataclass(frozen=True)
class Kind:
    """One kind of screw; lengths in mm. ``make`` returns its error and its lost motion, by random phases."""

    name: str
    length: float
    make: Callable[[Sequence[float]], tuple[Curve, Curve]]
    few: int
    many: int
    noise_um: float
    lead: float | None = None
    turns: tuple[float, ...] = ()
    is_even: bool = False
    spread: float | None = None
    runs: int = 5

    @property
    def periods(self) -> tuple[Period, ...]:
        return periods_of(self.lead, self.turns)


def wave(amplitude_um: float, period: float, phase: float) -> Curve:
    return lambda x: amplitude_um / 1000 * sin(2 * pi * x / period + phase)


def constant(um: float) -> Curve:
    return lambda x: um / 1000


def total(*curves: Curve) -> Curve:
    return lambda x: sum(curve(x) for curve in curves)


def straight(phases: Sequence[float]) -> tuple[Curve, Curve]:
    return (lambda x: 30e-6 * x), constant(10)


def slow(phases: Sequence[float]) -> tuple[Curve, Curve]:
    return total(wave(20, 350, phases[0]), wave(4, 130, phases[1])), constant(10)


def drunken(phases: Sequence[float]) -> tuple[Curve, Curve]:
    return total(wave(5, 10, phases[0]), lambda x: 10e-6 * x), constant(10)


def of_the_issue(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """3 µm a turn of 5 mm, 1.5 µm more that come and go on a slow wave, backlash from 8 to 18 µm."""
    slowly, turn = wave(1000, 137, phases[3]), wave(1.5, 5, phases[2])
    error = total(wave(12, 310, phases[0]), wave(3, 5, phases[1]), lambda x: slowly(x) * turn(x))
    return error, total(constant(13), wave(5, 400, phases[4]))


def geared(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A motor that turns three times with each turn of a screw of 6 mm."""
    return total(wave(10, 220, phases[0]), wave(2, 6, phases[1]), wave(2, 2, phases[2])), constant(8)


def worn(phases: Sequence[float]) -> tuple[Curve, Curve]:
    return (
        total(lambda x: 20e-6 * x, wave(4, 400, phases[0])),
        lambda x: 0.005 + 0.02 * exp(-(((x - 180) / 50) ** 2)),
    )


def long(phases: Sequence[float]) -> tuple[Curve, Curve]:
    return total(lambda x: 30e-6 * x, wave(10, 900, phases[0]), wave(3, 310, phases[1])), constant(12)


def jointed(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """Two screws in one: the slope changes at the joint."""
    return (lambda x: 40e-6 * x if x < 260 else 0.0104 - 30e-6 * (x - 260)), constant(8)


def short(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A short axis that was measured finely, whose lead nobody told."""
    return total(wave(4, 5, phases[0]), wave(8, 100, phases[1])), constant(6)


KINDS: Final = (
    Kind("straight, 30 µm a metre", 400, straight, 9, 41, 0.4),
    Kind("slow waves, even targets", 500, slow, 13, 51, 0.5, is_even=True),
    Kind("drunken, lead 10 told", 500, drunken, 17, 41, 0.4, lead=10.0, spread=10.0),
    Kind("of the issue, lead 5 told", 400, of_the_issue, 21, 81, 0.4, lead=5.0, spread=4.5),
    Kind("of the issue, lead not told", 400, of_the_issue, 21, 81, 0.4, spread=4.5),
    Kind("screw and motor, periods told", 300, geared, 25, 61, 0.4, lead=6.0, turns=(2.0,), spread=4.5),
    Kind("worn in the middle", 400, worn, 17, 41, 0.5),
    Kind("2 m long", 2000, long, 21, 81, 1.0),
    Kind("jointed", 600, jointed, 16, 51, 0.6),
    Kind("short and fine, lead not told", 120, short, 97, 161, 0.4, is_even=True, runs=3),
)


@dataclass(frozen=True)
class Screw:
    """One screw of a kind."""

    kind: Kind
    error: Curve
    lost: Curve

    def deviation(self, place: float, way: Direction) -> float:
        """Where the nut stands, less where the drive does."""
        return self.error(place) - way.value * self.lost(place) / 2

    def survey(self, targets: Sequence[float], noise_um: float, random: Random) -> Survey:
        readings = [
            Reading(x, way, x + self.deviation(x, way) + random.gauss(0, noise_um / 1000), run)
            for run in range(1, self.kind.runs + 1)
            for way in (UP, DOWN)
            for x in targets
        ]
        return Survey(tuple(readings), Units.MM)

    def leaves_um(self, table: CorrectionTable, low: float, high: float) -> float:
        """Return E of what is left in truth, from the first target to the last."""
        left = []
        for index in range(PLACES):
            x = low + (high - low) * index / (PLACES - 1)
            for way in (UP, DOWN):
                moved = correction_at(table, x, way)
                left.append(moved + self.deviation(x + moved, way))
        return (max(left) - min(left)) * 1000


@dataclass(frozen=True)
class Case:
    """What came of one measurement, in µm."""

    kind: Kind
    targets: int
    noise_um: float
    true: float
    predicted: float
    of_shapes: dict[Shape, float]
    follows: Shape

    @property
    def best(self) -> float:
        return min(self.of_shapes.values())

    @property
    def is_near(self) -> bool:
        """Whether the prediction lies near the truth."""
        return (
            abs(self.true - self.predicted) <= WITHIN_UM or 1 / FACTOR <= self.predicted / self.true <= FACTOR
        )

    @property
    def is_good(self) -> bool:
        """Whether nothing that was to be had leaves clearly less."""
        return self.true <= max(self.best * WORSE, self.best + WITHIN_UM / 2)


def screw_of(kind: Kind, seed: int) -> tuple[Screw, Random]:
    random = Random(f"{kind.name} {seed}")
    return Screw(kind, *kind.make([random.uniform(0, 2 * pi) for _ in range(5)])), random


def targets_of(kind: Kind, count: int, seed: int) -> list[float]:
    if kind.is_even:
        return [kind.length * index / (count - 1) for index in range(count)]
    return random_targets(0.0, kind.length, count, seed=seed, spread=kind.spread)


def built(survey: Survey, kind: Kind, fit: Fit) -> Built:
    return build_from(survey, Recipe(fit=fit, periods=kind.periods))


def case(kind: Kind, count: int, noise_um: float, seed: int) -> Case:
    screw, random = screw_of(kind, seed)
    targets = targets_of(kind, count, seed)
    survey = screw.survey(targets, noise_um, random)
    low, high = targets[0], targets[-1]
    chosen = built(survey, kind, Fit.AUTO)
    assert chosen.screw is not None
    assert chosen.evidence is not None
    of_shapes = {each.shape: screw.leaves_um(each.table, low, high) for each in chosen.evidence.candidates}
    return Case(
        kind,
        count,
        noise_um,
        true=screw.leaves_um(chosen.table, low, high),
        predicted=chosen.screw.leaves(chosen.table) * 1000,
        of_shapes=of_shapes,
        follows=chosen.evidence.chosen.shape,
    )


def cases(seeds: Sequence[int], kinds: Sequence[Kind] = KINDS) -> Iterator[list[Case]]:
    """Yield every kind with few targets and many, noise-free and noisy; each of these with all seeds."""
    for kind in kinds:
        for count in (kind.few, kind.many):
            for noise in (0.0, kind.noise_um):
                yield [case(kind, count, noise, seed) for seed in seeds]


def row(found: Sequence[Case]) -> str:
    """Return a line of the table: means over the seeds."""
    one = found[0]
    shapes = [
        f"{fmean(each.of_shapes[shape] for each in found):.2f}" if shape in one.of_shapes else "–"
        for shape in Shape
    ]
    ratio = exp(median(log(each.predicted / each.true) for each in found))
    true, predicted = (fmean(values) for values in zip(*((c.true, c.predicted) for c in found), strict=True))
    near, good = sum(each.is_near for each in found), sum(each.is_good for each in found)
    return (
        f"| {one.kind.name} | {one.targets} | {one.noise_um:g} | {' | '.join(shapes)} | {true:.2f} | "
        f"{predicted:.2f} | {ratio:.2f} | {near}/{len(found)} | {good}/{len(found)} |"
    )


HEADING: Final = (
    "| screw | targets | noise | lines | smooth | harmonics | **taken** | predicted | ratio | near | good |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|"
)


def main(seeds: Sequence[int] = range(8)) -> None:
    """Print the table."""
    lines = [HEADING]
    for found in cases(seeds):
        lines.append(row(found))
        sys.stderr.write(f"{lines[-1]}\n")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(range(int(sys.argv[1])) if len(sys.argv) > 1 else range(8))
