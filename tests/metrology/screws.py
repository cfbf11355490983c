"""Simulated screws, racks and belts: what a table leaves of them in truth, and what was predicted.

``python -m tests.metrology.screws [SEEDS]`` prints the figures of all of them, of 100 each unless told:
noise-free and noisy, with few targets and with many. The truth is E after ISO 230-2 without scatter, of 8001
places in both directions, with the drive where the table sends it. ``--drift`` prints a second table instead:
the noisy screws with few targets, on a scale that is wrong and on a machine that warms up while it is
measured. Names of kinds run those alone, ``--few`` and ``--many`` only so many targets, ``--noisy`` only
readings that scatter, ``--jobs N`` that many at a time; ``--write`` puts each row as soon as it is there into
``bench/screws.md``, between the comments that name the command, and sums up.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import pi
from pathlib import Path
from random import Random
from statistics import fmean
from typing import Any, Final

import numpy as np

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.build import Fit, Shape
from gateway.metrology.cycle import random_targets
from gateway.metrology.drift import drift_of, without_drift
from gateway.metrology.evaluation import evaluate
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Built, Recipe, build_from
from gateway.metrology.scale import scale_of

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
PLACES: Final = 8001
SEEDS: Final = 100
"""Measurements of each row."""
FACTOR: Final = 1.5
"""Within which a prediction has to lie of the truth."""
WITHIN_UM: Final = 0.2
"""Below this a difference of truth and prediction is nothing: no instrument shows it."""
NOTHING_UM: Final = 0.005
"""What is shown as 0.00: no ratio of two such lengths means anything."""
WORSE: Final = 1.1
"""By so much more than the best of them the default may leave."""

Curve = Callable[[Any], Any]
"""Of one place, or of an array of places: a truth of thousands is worked out at once."""


@dataclass(frozen=True)
class CurveKind:
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
    units: Units = Units.MM

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


def rack(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A pinion of 20 teeth of module 2 on a rack: once a turn, and once a tooth."""
    return total(lambda x: 25e-6 * x, wave(15, 40 * pi, phases[0]), wave(3, 2 * pi, phases[1])), constant(20)


def butted(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """Two racks, 12 µm apart where they meet."""
    return total(wave(6, 500, phases[0]), lambda x: np.where(x < 310, 0.0, 0.012)), constant(15)


def belt(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A pulley of 20 teeth, 5 mm apart, on a belt that is too long: once a turn, and once a tooth."""
    return total(lambda x: 100e-6 * x, wave(30, 100, phases[0]), wave(15, 5, phases[1])), constant(40)


def worm(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A worm that turns 90 times with the table: once a turn of the table, once and twice a turn of it."""
    return total(wave(8, 360, phases[0]), wave(4, 4, phases[1]), wave(1, 2, phases[2])), constant(10)


def dipped(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A thread that is worn where most of the work was done."""
    error = total(lambda x: -0.015 * np.exp(-(((x - 180) / 35) ** 2)), wave(5, 500, phases[0]))
    return error, constant(8)


def reduced(phases: Sequence[float]) -> tuple[Curve, Curve]:
    """A long lead behind a reduction, whose motor turns once in 10 mm."""
    return total(wave(4, 40, phases[0]), wave(8, 10, phases[1]), wave(10, 450, phases[2])), constant(10)


KINDS: Final = (
    CurveKind("straight, 30 µm a metre", 400, straight, 9, 41, 0.4),
    CurveKind("slow waves, even targets", 500, slow, 13, 51, 0.5, is_even=True),
    CurveKind("slow waves, irregular targets", 500, slow, 13, 51, 0.5),
    CurveKind("drunken, lead 10 told", 500, drunken, 17, 41, 0.4, lead=10.0, spread=10.0),
    CurveKind("of the issue, lead 5 told", 400, of_the_issue, 21, 81, 0.4, lead=5.0, spread=4.5),
    CurveKind("of the issue, lead not told", 400, of_the_issue, 21, 81, 0.4, spread=4.5),
    CurveKind(
        "of the issue, even targets, lead 5 told", 400, of_the_issue, 21, 81, 0.4, lead=5.0, is_even=True
    ),
    CurveKind("screw and motor, periods told", 300, geared, 25, 61, 0.4, lead=6.0, turns=(2.0,), spread=4.5),
    CurveKind("worn in the middle", 400, worn, 17, 41, 0.5),
    CurveKind("2 m long", 2000, long, 21, 81, 1.0),
    CurveKind("jointed", 600, jointed, 16, 51, 0.6),
    CurveKind("short and fine, lead not told", 120, short, 97, 161, 0.4, is_even=True, runs=3),
    CurveKind("rack, turn and tooth told", 1000, rack, 41, 121, 1.0, 40 * pi, (2 * pi,), spread=2 * pi),
    CurveKind("rack with a butt joint of 12 µm", 600, butted, 21, 61, 0.6),
    CurveKind("belt, turn and tooth told", 600, belt, 33, 91, 1.5, 100.0, (5.0,), spread=5.0),
    CurveKind(
        "worm of 4°, told, in 0.001°", 360, worm, 37, 81, 0.3, lead=4.0, spread=4.0, units=Units.DEGREE
    ),
    CurveKind("worn thread, a dip of 15 µm", 400, dipped, 17, 41, 0.5),
    CurveKind("even targets, lead 40 told, motor not", 400, reduced, 21, 41, 0.4, lead=40.0, is_even=True),
)


@dataclass(frozen=True)
class Screw:
    """One screw of a kind."""

    kind: CurveKind
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
        return Survey(tuple(readings), self.kind.units)

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

    kind: CurveKind
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
    def is_below(self) -> bool:
        """Whether no more is left than the upper bound, where there is one."""
        return self.high is None or self.true <= self.high + WITHIN_UM / 4

    @property
    def is_near(self) -> bool:
        """Whether the prediction lies near the truth; False where there is none."""
        return self.predicted is not None and (
            abs(self.true - self.predicted) <= WITHIN_UM or 1 / FACTOR <= self.predicted / self.true <= FACTOR
        )

    @property
    def is_within(self) -> bool:
        """Whether the truth lies between the bounds that were predicted."""
        return self.low - WITHIN_UM / 4 <= self.true and self.is_below

    @property
    def is_good(self) -> bool:
        """Whether nothing that was to be had leaves clearly less."""
        return self.true <= max(self.best * WORSE, self.best + WITHIN_UM / 2)


def screw_of(kind: CurveKind, seed: int) -> tuple[Screw, Random]:
    random = Random(f"{kind.name} {seed}")
    return Screw(kind, *kind.make([random.uniform(0, 2 * pi) for _ in range(5)])), random


def targets_of(kind: CurveKind, count: int, seed: int) -> list[float]:
    if kind.is_even:
        return [kind.length * index / (count - 1) for index in range(count)]
    return random_targets(0.0, kind.length, count, seed=seed, spread=kind.spread)


def built(survey: Survey, kind: CurveKind, fit: Fit) -> Built:
    return build_from(survey, Recipe(fit=fit, periods=kind.periods))


def case(kind: CurveKind, count: int, noise_um: float, seed: int) -> Case:
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


@dataclass(frozen=True)
class Wanted:
    """Which rows of the table."""

    seeds: Sequence[int]
    kinds: Sequence[CurveKind] = KINDS
    few: bool = True
    many: bool = True
    noise_free: bool = True

    def __iter__(self) -> Iterator[tuple[CurveKind, int, float]]:
        """Yield those with few targets and noise first: they are what is measured most."""
        for is_few, wish in ((True, self.few), (False, self.many)):
            for is_noisy in (True, False):
                for kind in self.kinds:
                    if wish and (is_noisy or self.noise_free):
                        yield kind, kind.few if is_few else kind.many, kind.noise_um if is_noisy else 0.0


def _case(of: tuple[str, int, float, int]) -> Case:
    """Do the same in another process, which finds the kind by its name."""
    name, count, noise_um, seed = of
    return case(next(kind for kind in KINDS if kind.name == name), count, noise_um, seed)


def cases(wanted: Wanted, jobs: int = 1) -> Iterator[list[Case]]:
    """Yield all rows, each of them with all seeds."""
    with ProcessPoolExecutor(jobs) as pool:
        for kind, count, noise_um in wanted:
            yield list(pool.map(_case, [(kind.name, count, noise_um, seed) for seed in wanted.seeds]))


def row(found: Sequence[Case]) -> str:
    """Return a line of the table: means over the seeds."""
    one = found[0]
    shapes = [
        f"{fmean(each.of_shapes[shape] for each in found):.2f}" if shape in one.of_shapes else "–"
        for shape in Shape
    ]
    true = fmean(each.true for each in found)
    told = [each for each in found if each.predicted is not None and each.high is not None]
    promised, bounds = f"≥ {fmean(each.low for each in found):.2f}", "–"
    if told:
        promised = f"{fmean(each.predicted or 0.0 for each in told):.2f}"
        bounds = f"{fmean(each.low for each in told):.2f} to {fmean(each.high or 0.0 for each in told):.2f}"
    counts = (
        _share(told, lambda each: each.is_near),
        _share(told, lambda each: each.is_below),
        _share(found, lambda each: each.is_within),
        _share(found, lambda each: each.is_good),
    )
    best = fmean(each.best for each in found)
    ratio = "–" if max(true, best) < NOTHING_UM else f"{true / best:.2f}"
    return (
        f"| {one.kind.name} | {one.targets} | {one.noise_um:g} | {' | '.join(shapes)} | {true:.2f} | "
        f"{ratio} | {promised} | {bounds} | "
        f"{' | '.join(counts)} |"
    )


def _share(found: Sequence[Case], holds: Callable[[Case], bool]) -> str:
    return f"{sum(map(holds, found))}/{len(found)}" if found else "–"


def summary(rows: Sequence[str]) -> str:
    """Return what all rows together say, from their last columns: near, below, within and good."""
    counts, totals = [0, 0, 0, 0], [0, 0, 0, 0]
    for each in rows:
        for column, cell in enumerate(each.split(" | ")[-4:]):
            part, _, of = cell.strip(" |").partition("/")
            if of:
                counts[column] += int(part)
                totals[column] += int(of)
    near, below, within, good = counts
    told, _, total, _ = totals
    return (
        f"In {told} of {total} measurements the targets tell what is left between them; there {near} "
        f"predictions lie within a factor {FACTOR:g} of the truth (or {WITHIN_UM:g} µm), and in {below} no "
        f"more is left than the upper bound. In {within} of {total} the truth lies between the bounds, or "
        f"above the least where no figure is given. {good} of {total} tables leave at most a tenth more than "
        "the best curve does."
    )


HEADING: Final = (
    "| screw | targets | noise | lines | smooth | harmonics | **left** | to the best | promised | bounds "
    "| near | below | within | good |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
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


def drifting_row(kind: CurveKind, seeds: Sequence[int]) -> str:
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


PAGE: Final = Path(__file__).parents[2] / "bench" / "screws.md"
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
    kept = {
        key(each): each for each in text.splitlines() if each.count("|") == HEADING.split("\n")[0].count("|")
    }
    order = [
        (kind.name, str(n), f"{e:g}")
        for kind in KINDS
        for n in (kind.few, kind.many)
        for e in (0.0, kind.noise_um)
    ]
    whole = [each for place in order if (each := (kept | fresh).get(place))]
    return "\n".join([HEADING, *whole, "", summary(whole)]) + "\n"


def into_page(command: str, change: Callable[[str], str]) -> None:
    """Change what stands between the comments that name a command."""
    before, old, behind = of_page(PAGE.read_text(), command)
    PAGE.write_text(before + change(old) + behind)


def main(told: Sequence[str]) -> None:
    """Print the rows of one of the tables, of all kinds or of those that are named; see above."""
    words = list(told)
    jobs = int(words.pop(words.index("--jobs") + 1)) if "--jobs" in words else 1
    numbers = [int(each) for each in words if each.isdecimal()]
    names = [each for each in words if not each.isdecimal() and not each.startswith("--")]
    kinds = [kind for kind in KINDS if not names or kind.name in names]
    seeds = range(*numbers) if numbers else range(SEEDS)
    is_drifting, is_written = "--drift" in words, "--write" in words
    rows: list[str] = []
    found: Iterator[str]
    if is_drifting:
        found = (drifting_row(kind, seeds) for kind in kinds)
    else:
        few, many = "--many" not in words, "--few" not in words
        wanted = Wanted(seeds, kinds, few=few, many=many, noise_free="--noisy" not in words)
        found = map(row, cases(wanted, jobs))
    for each in found:
        sys.stdout.write(f"{each}\n")
        sys.stdout.flush()
        rows.append(each)
        if is_written and not is_drifting:
            into_page(COMMAND, lambda old: updated(old, rows))
    if is_written and is_drifting:
        into_page(f"{COMMAND} --drift", lambda _: "\n".join([DRIFTING_HEADING, *rows, ""]))


if __name__ == "__main__":
    main(sys.argv[1:])
