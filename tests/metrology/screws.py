"""Ten kinds of simulated screws: what a table leaves of them in truth, and what was predicted.

``python -m tests.metrology.screws [SEEDS]`` prints the figures of all of them: noise-free and noisy, with few
targets and with many. The truth is E after ISO 230-2 without scatter, of 8001 places in both directions, with
the drive where the table sends it. ``--drift`` prints a second table instead: the noisy screws with few
targets, on a scale that is wrong and on a machine that warms up while it is measured. Names of kinds run
those alone, ``--few`` only few targets; ``--write`` puts the rows into ``docs/metrology.md``, between the
comments that name the command, and sums up. Two kinds of measurement come beside the ten screws: one of them
again at irregular targets, another at even ones that hide its turn.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import exp, log, pi
from pathlib import Path
from random import Random
from statistics import fmean, median
from typing import Any, Final

import numpy as np

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.drift import drift_of, without_drift
from gateway.metrology.evaluation import evaluate
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.program import random_targets
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Built, Recipe, build_from
from gateway.metrology.scale import scale_of
from gateway.metrology.shapes import Fit, Shape

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
PLACES: Final = 8001
FACTOR: Final = 1.5
"""Within which a prediction has to lie of the truth."""
WITHIN_UM: Final = 0.2
"""Below this a difference of truth and prediction is nothing: no instrument shows it."""
WORSE: Final = 1.1
"""By so much more than the best of them the default may leave."""

Curve = Callable[[Any], Any]
"""Of one place, or of an array of places: a truth of thousands is worked out at once."""


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
    return lambda x: amplitude_um / 1000 * np.sin(2 * pi * x / period + phase)


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
        lambda x: 0.005 + 0.02 * np.exp(-(((x - 180) / 50) ** 2)),
    )


def long(phases: Sequence[float]) -> tuple[Curve, Curve]:
    return total(lambda x: 30e-6 * x, wave(10, 900, phases[0]), wave(3, 310, phases[1])), constant(12)


def jointed(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """Two screws in one: the slope changes at the joint."""
    return (lambda x: np.where(x < 260, 40e-6 * x, 0.0104 - 30e-6 * (x - 260))), constant(8)


def short(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A short axis that was measured finely, whose lead nobody told."""
    return total(wave(4, 5, phases[0]), wave(8, 100, phases[1])), constant(6)


KINDS: Final = (
    Kind("straight, 30 µm a metre", 400, straight, 9, 41, 0.4),
    Kind("slow waves, even targets", 500, slow, 13, 51, 0.5, is_even=True),
    Kind("slow waves, irregular targets", 500, slow, 13, 51, 0.5),
    Kind("drunken, lead 10 told", 500, drunken, 17, 41, 0.4, lead=10.0, spread=10.0),
    Kind("of the issue, lead 5 told", 400, of_the_issue, 21, 81, 0.4, lead=5.0, spread=4.5),
    Kind("of the issue, lead not told", 400, of_the_issue, 21, 81, 0.4, spread=4.5),
    Kind("of the issue, even targets, lead 5 told", 400, of_the_issue, 21, 81, 0.4, lead=5.0, is_even=True),
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

    def deviation(self, place: Any, way: Direction) -> Any:
        """Where the nut stands, less where the drive does."""
        return self.error(place) - way.value * self.lost(place) / 2

    def of_run(self, place: Any, way: Direction, run: int) -> Any:
        """The same while a run is measured."""
        return self.deviation(place, way)

    def survey(self, targets: Sequence[float], noise_um: float, random: Random) -> Survey:
        readings = [
            Reading(x, way, x + float(self.of_run(x, way, run)) + random.gauss(0, noise_um / 1000), run)
            for run in range(1, self.kind.runs + 1)
            for way in (UP, DOWN)
            for x in targets
        ]
        return Survey(tuple(readings), Units.MM)

    def leaves_um(self, table: CorrectionTable, low: float, high: float) -> float:
        """Return E of what is left in truth, from the first target to the last."""
        places = np.linspace(low, high, PLACES)
        left = []
        for way, curve in ((UP, table.forward), (DOWN, table.backward)):
            moved = np.interp(places, table.positions, curve)  # held outside, as a table is
            left.append(moved + self.deviation(places + moved, way))
        return float(np.ptp(left)) * 1000


@dataclass(frozen=True)
class Case:
    """What came of one measurement, in µm."""

    kind: Kind
    targets: int
    noise_um: float
    true: float
    predicted: float | None
    """None: not known from these readings."""
    low: float
    high: float | None
    of_shapes: dict[Shape, float]
    follows: Shape

    @property
    def best(self) -> float:
        return min(self.of_shapes.values())

    @property
    def is_near(self) -> bool:
        """Whether the prediction lies near the truth; False where there is none."""
        return self.predicted is not None and (
            abs(self.true - self.predicted) <= WITHIN_UM or 1 / FACTOR <= self.predicted / self.true <= FACTOR
        )

    @property
    def is_within(self) -> bool:
        """Whether the truth lies between the bounds that were predicted."""
        least = WITHIN_UM / 4
        return self.low - least <= self.true and (self.high is None or self.true <= self.high + least)

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
    left_out = chosen.screw.left_out(chosen.table)
    return Case(
        kind,
        count,
        noise_um,
        true=screw.leaves_um(chosen.table, low, high),
        predicted=None if left_out.e is None else left_out.e * 1000,
        low=left_out.low * 1000,
        high=None if left_out.high is None else left_out.high * 1000,
        of_shapes=of_shapes,
        follows=chosen.evidence.chosen.shape,
    )


def cases(
    seeds: Sequence[int], kinds: Sequence[Kind] = KINDS, *, only_few: bool = False
) -> Iterator[list[Case]]:
    """Yield every kind with few targets and many, noise-free and noisy; each of these with all seeds."""
    for kind in kinds:
        for count in (kind.few,) if only_few else (kind.few, kind.many):
            for noise in (0.0, kind.noise_um):
                yield [case(kind, count, noise, seed) for seed in seeds]


def row(found: Sequence[Case]) -> str:
    """Return a line of the table: means over the seeds."""
    one = found[0]
    shapes = [
        f"{fmean(each.of_shapes[shape] for each in found):.2f}" if shape in one.of_shapes else "–"
        for shape in Shape
    ]
    true = fmean(each.true for each in found)
    within, good = (
        f"{sum(whether)}/{len(found)}"
        for whether in zip(*((each.is_within, each.is_good) for each in found), strict=True)
    )
    near = f"{sum(each.is_near for each in found)}/{sum(each.predicted is not None for each in found)}"
    told = [(each.predicted, each.true) for each in found if each.predicted is not None]
    if told:
        predicted = f"{fmean(predicted for predicted, _ in told):.2f}"
        ratio = f"{exp(median(log(predicted / true) for predicted, true in told)):.2f}"
    else:
        predicted, ratio, near = f"≥ {fmean(each.low for each in found):.2f}", "–", "–"
    return (
        f"| {one.kind.name} | {one.targets} | {one.noise_um:g} | {' | '.join(shapes)} | {true:.2f} | "
        f"{predicted} | {ratio} | {near} | {within} | {good} |"
    )


def summary(rows: Sequence[str]) -> str:
    """Return what all rows together say, from their last columns: near, within and good."""
    counts = [0, 0, 0]
    told = total = 0
    for each in rows:
        for column, cell in enumerate(each.split(" | ")[-3:]):
            part, _, of = cell.strip(" |").partition("/")
            if of:
                counts[column] += int(part)
                told += int(of) * (column == 0)
                total += int(of) * (column == 1)
    return (
        f"In {told} of {total} measurements the targets tell what is left between them; there {counts[0]} "
        f"predictions lie within a factor {FACTOR:g} of the truth (or {WITHIN_UM:g} µm). In {counts[1]} of "
        f"{total} the truth lies between the bounds, or above the least where no figure is given. "
        f"{counts[2]} of {total} tables leave at most a tenth more than the best curve does."
    )


HEADING: Final = (
    "| screw | targets | noise | lines | smooth | harmonics | **taken** | predicted | ratio | near | within "
    "| good |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
)

SCALE: Final = 200e-6
"""So much longer than they should be are all ways on the second table."""
GROWTH: Final = 28e-6
"""So much longer is the screw in the last run than in the first: 2.4 K of steel."""


@dataclass(frozen=True)
class Drifting(Screw):
    """A screw on a wrong scale, in a machine that warms up; what is corrected is its mean over the runs."""

    is_growing: bool = True

    def deviation(self, place: Any, way: Direction) -> Any:
        return sum(self.of_run(place, way, run) for run in range(1, self.kind.runs + 1)) / self.kind.runs

    def of_run(self, place: Any, way: Direction, run: int) -> Any:
        late = 0.5 if way is DOWN else 0.0
        share = (run - 1 + late) / (self.kind.runs - 1) if self.is_growing else 0.0
        return super().deviation(place, way) + place * (SCALE + GROWTH * share)


def drifting_row(kind: Kind, seeds: Sequence[int]) -> str:
    """Return a line of the second table: means over the seeds, each as it is and as it was found."""
    columns: list[list[float]] = []
    predicted: list[float] = []
    for seed in seeds:
        screw, random = screw_of(kind, seed)
        warming = Drifting(kind, screw.error, screw.lost)
        targets = targets_of(kind, kind.few, seed)
        survey = warming.survey(targets, kind.noise_um, random)
        still = Drifting(kind, screw.error, screw.lost, is_growing=False).survey(targets, 0.0, random)
        sound = warming.survey(targets, 0.0, random)
        drift, found, true = drift_of(survey), scale_of(survey.readings), scale_of(sound.readings)
        chosen = built(survey, kind, Fit.AUTO)
        assert drift is not None
        assert found is not None
        assert true is not None
        assert chosen.screw is not None
        left_out = chosen.screw.left_out(chosen.table)
        e_read, e_found, e_true = (
            evaluate(each).systematic for each in (survey, without_drift(survey, drift), still)
        )
        assert e_read is not None
        assert e_found is not None
        assert e_true is not None
        columns.append(
            [
                GROWTH * 1e6,
                drift.growth * 1e6,
                true.share * 1e6,
                found.share * 1e6,
                e_read * 1e3,
                e_true * 1e3,
                e_found * 1e3,
                warming.leaves_um(chosen.table, targets[0], targets[-1]),
                left_out.low * 1e3,
            ]
        )
        if left_out.e is not None:
            predicted.append(left_out.e * 1e3)
    means = [fmean(values) for values in zip(*columns, strict=True)]
    cells = [f"{mean:.1f}" for mean in means[:7]] + [f"{means[7]:.2f}"]
    cells.append(f"{fmean(predicted):.2f}" if predicted else f"≥ {means[8]:.2f}")
    return f"| {kind.name} | {' | '.join(cells)} |"


DRIFTING_HEADING: Final = (
    "| screw | drift, µm/m | found | scale, µm/m | found | E as read | E without drift | found | left | "
    "predicted |\n|---|---|---|---|---|---|---|---|---|---|"
)


PAGE: Final = Path(__file__).parents[2] / "docs" / "metrology.md"
COMMAND: Final = "python -m tests.metrology.screws"


def of_page(page: str, command: str) -> tuple[str, str, str]:
    """Return what stands before, between and behind the comments that name a command."""
    first, last = f"<!-- {command} -->\n", f"<!-- end of {command} -->\n"
    before, rest = page.split(first)
    between, behind = rest.split(last)
    return before + first, between, last + behind


def key(row: str) -> tuple[str, ...]:
    """Return what a row is of: screw, targets, noise."""
    return tuple(cell.strip() for cell in row.split("|")[1:4])


def updated(text: str, rows: Sequence[str]) -> str:
    """Return the first table with these rows in the places of old ones, and what all of it says."""
    fresh = {key(each): each for each in rows}
    kept = {key(each): each for each in text.splitlines() if each.startswith("| ") and "/8" in each}
    order = [
        (kind.name, str(n), f"{e:g}")
        for kind in KINDS
        for n in (kind.few, kind.many)
        for e in (0.0, kind.noise_um)
    ]
    whole = [each for place in order if (each := (kept | fresh).get(place))]
    return "\n".join([HEADING, *whole, "", summary(whole)]) + "\n"


def main(told: Sequence[str]) -> None:
    """Print the rows of one of the tables, of all kinds or of those that are named; see above."""
    numbers = [int(each) for each in told if each.isdecimal()]
    names = [each for each in told if not each.isdecimal() and not each.startswith("--")]
    kinds = [kind for kind in KINDS if not names or kind.name in names]
    seeds = range(*numbers) if numbers else range(8)
    is_drifting = "--drift" in told
    rows = []
    few = "--few" in told
    made = map(row, cases(seeds, kinds, only_few=few))
    found = (drifting_row(kind, seeds) for kind in kinds) if is_drifting else made
    for each in found:
        sys.stdout.write(f"{each}\n")
        sys.stdout.flush()
        rows.append(each)
    if "--write" in told:
        before, old, behind = of_page(PAGE.read_text(), COMMAND + " --drift" * is_drifting)
        new = "\n".join([DRIFTING_HEADING, *rows, ""]) if is_drifting else updated(old, rows)
        PAGE.write_text(before + new + behind)


if __name__ == "__main__":
    main(sys.argv[1:])
