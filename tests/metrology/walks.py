"""One gauge block walked along simulated screws: what is left in truth, and what was promised.

``python -m tests.metrology.walks [SEEDS]`` prints a row for each kind of screw, of 100 each unless told: 50
placements of one block of 50 mm on 500 mm, with a dial of 1 µm. The truth is E of what the table leaves, of
8001 places in both directions (:mod:`tests.metrology.screws`). ``--grade 2`` has another block, ``--reach 0``
a dial that shows only the block itself, ``--placements N`` and ``--per-side N`` other walks. Names of kinds
run those alone, ``--jobs N`` that many at a time; ``--write`` puts the rows into ``bench/screws.md``, between
the comments that name the command.
"""

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from random import Random
from statistics import fmean, quantiles
from typing import Final

import numpy as np

from gateway.compensation.units import Units
from gateway.metrology.band import band_of
from gateway.metrology.build import Fit, HomeReference
from gateway.metrology.differences import joined
from gateway.metrology.lead import periods_of
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.standard import Grade, Standard, limit_um
from gateway.metrology.uncertainty import UncertaintyInputs
from gateway.metrology.walk import Walk
from tests.metrology import screws
from tests.metrology.screws import DOWN, UP, CurveKind, Screw

LENGTH: Final = 500.0
BLOCK: Final = 50.0
NAMES: Final = (
    "straight, 30 µm a metre",
    "slow waves, irregular targets",
    "drunken, lead 10 told",
    "of the issue, lead 5 told",
    "screw and motor, periods told",
    "worn in the middle",
    "2 m long",
    "jointed",
    "worn thread, a dip of 15 µm",
    "even targets, lead 40 told, motor not",
)
LEADS: Final = {"even targets, lead 40 told, motor not": (40.0, (10.0,))}
"""A person who has a reduction knows both turns."""
USUAL_LEAD: Final = 5.0


@dataclass(frozen=True)
class SetUp:
    """How a walk is measured; lengths in µm where the name says so."""

    placements: int = 50
    reach: float = 10.0
    grade: Grade = Grade.ONE
    scatter_um: float = 0.7
    """Of one reading of the dial, beside its last digit."""
    seat_um: float = 0.3
    """Of the block, each time that it is placed."""
    digit_um: float = 1.0
    dial_error_um: float = 2.0
    per_side: int = 1


@dataclass(frozen=True)
class Slipped:
    """What slips while one placement is measured, in mm, between the readings without and with the block."""

    number: int
    by: float


def kinds() -> list[CurveKind]:
    """Ten kinds of screws; of each a person knows the turns."""
    found = []
    for name in NAMES:
        [kind] = [each for each in screws.KINDS if each.name == name]
        lead, turns = LEADS.get(name, (kind.lead or USUAL_LEAD, kind.turns))
        found.append(replace(kind, length=LENGTH, lead=lead, turns=turns))
    return found


def measured(screw: Screw, made: SetUp, random: Random, seed: int, slipped: Slipped | None = None) -> Survey:
    """Return the readings of a walk."""
    known = made.grade is not Grade.UNKNOWN
    limit = limit_um(made.grade if known else Grade.TWO, BLOCK) / 1000
    deviation, gain = random.uniform(-limit, limit), random.uniform(-1, 1) * made.dial_error_um / 1000
    readings = []
    walk = Walk(0.0, LENGTH, BLOCK, made.placements, made.reach, seed, per_side=made.per_side)
    for placement in walk.placed(Units.MM):
        zero = placement.bare[0] + random.uniform(-0.2, 0.2)
        seat = random.gauss(0, made.seat_um / 1000)
        stops = [(x, 0.0) for x in placement.bare] + [(x, BLOCK) for x in placement.over_block]
        for way, order in ((UP, stops), (DOWN, stops[::-1])):
            for x, block in order:
                dial = x + float(screw.deviation(x, way)) - zero
                if block:
                    dial -= block + deviation + seat
                    if slipped is not None and placement.number == slipped.number:
                        dial += slipped.by
                dial += gain * dial / max(made.reach, 1.0) + random.gauss(0, made.scatter_um / 1000)
                dial = round(dial * 1000 / made.digit_um) * made.digit_um / 1000
                readings.append(Reading(x, way, block + dial, placement.number, block=block))
    standard = Standard(made.grade, dial_error_um=made.dial_error_um)
    return Survey(tuple(readings), Units.MM, standard=standard)


@dataclass(frozen=True)
class Case:
    """What came of one walk; lengths in µm."""

    name: str
    before: float
    true: float
    promised: float | None
    high: float | None
    covered: float
    """Share of the places at which the truth lies in the band of 95 %."""
    slips: tuple[int, ...]


def case(
    kind: CurveKind, made: SetUp, seed: int, slipped: Slipped | None = None, *, drop: bool = False
) -> Case:
    screw, random = screws.screw_of(kind, seed)
    survey = measured(screw, made, random, seed, slipped)
    found = joined(survey, periods_of(kind.lead, kind.turns), drop=drop)
    recipe = Recipe(fit=Fit.AUTO, periods=periods_of(kind.lead, kind.turns))
    built = build_from(found.survey, recipe, found.screw)
    left_out = found.screw.left_out(built.table)
    is_known = made.grade is not Grade.UNKNOWN
    places = np.linspace(0.0, LENGTH, screws.PLACES)
    left, before = [], []
    for way, curve in ((UP, built.table.forward), (DOWN, built.table.backward)):
        moved = np.interp(places, built.table.positions, curve)
        left.append(moved + screw.deviation(places + moved, way))
        before.append(screw.deviation(places, way) + 0 * places)
    after = np.concatenate(left)
    if not is_known:
        x = np.tile(places - places.mean(), 2)
        after = after - x * (x @ after) / (x @ x)
    band = band_of(found.screw, built.table, HomeReference(0.0, UP), UncertaintyInputs())
    assert band is not None
    positions, forward = np.array(band.positions), np.array(band.forward)
    truth = -(np.interp(positions, places, before[0]) - before[0][0])
    corrections = np.interp(positions, built.table.positions, built.table.forward)
    missed = corrections - corrections[0] - truth
    if not is_known:
        x = positions - positions.mean()
        missed = missed - x * (x @ missed) / (x @ x)
        missed = missed - missed[0]
    inside = np.abs(missed) <= forward + 1e-12
    return Case(
        kind.name,
        float(np.ptp(before)) * 1000,
        float(np.ptp(after)) * 1000,
        None if left_out.e is None else left_out.e * 1000,
        None if left_out.high is None else left_out.high * 1000,
        float(inside.mean()),
        tuple(each.placement for each in found.slips),
    )


def _case(of: tuple[str, SetUp, int]) -> Case:
    name, made, seed = of
    return case(next(kind for kind in kinds() if kind.name == name), made, seed)


HEADING: Final = (
    "| screw | before | **left** | nine of ten under | E ≤ 5 µm | promised | below the bound | covered |\n"
    "|---|---|---|---|---|---|---|---|"
)


def row(name: str, found: Sequence[Case]) -> str:
    """Return a line of the table: means over the seeds."""
    true = [each.true for each in found]
    told = [each.promised for each in found if each.promised is not None]
    below = [each.true <= each.high for each in found if each.high is not None]
    ninth = quantiles(true, n=10)[-1] if len(true) > 1 else true[0]
    return (
        f"| {name} | {fmean(each.before for each in found):.1f} | {fmean(true):.2f} | {ninth:.2f} | "
        f"{sum(each <= 5.0 for each in true)}/{len(true)} | "
        f"{f'{fmean(told):.2f}' if told else '–'} | {f'{sum(below)}/{len(below)}' if below else '–'} | "
        f"{fmean(each.covered for each in found):.1%} |"
    )


COMMAND: Final = "python -m tests.metrology.walks"


def main(told: Sequence[str]) -> None:
    """Print the rows; see above."""
    words = list(told)

    def given(name: str, default: str) -> str:
        return words.pop(words.index(name) + 1) if name in words else default

    jobs = int(given("--jobs", "1"))
    made = SetUp(
        placements=int(given("--placements", "50")),
        reach=float(given("--reach", "10")),
        grade=Grade(given("--grade", "0").lower()),
        per_side=int(given("--per-side", "2")),
    )
    seeds = next((int(each) for each in words if each.isdecimal()), screws.SEEDS)
    names = [each for each in words if not each.isdecimal() and not each.startswith("--")]
    rows: list[str] = []
    everything: list[Case] = []
    with ProcessPoolExecutor(jobs) as pool:
        for kind in kinds():
            if names and kind.name not in names:
                continue
            found = list(pool.map(_case, [(kind.name, made, seed) for seed in range(seeds)]))
            everything += found
            rows.append(row(kind.name, found))
            sys.stdout.write(f"{rows[-1]}\n")
            sys.stdout.flush()
    rows.append(row("all", everything))
    sys.stdout.write(f"{rows[-1]}\n")
    if "--write" in words:
        screws.into_page(COMMAND, lambda _: "\n".join([HEADING, *rows, ""]))


if __name__ == "__main__":
    main(sys.argv[1:])
