"""Whether the truth lies in the band of 95 % that is stated around a table: simulated screws, four methods.

``python -m tests.metrology.coverage [SEEDS]`` measures ten kinds of screws with a laser, with a dial over
gauge blocks, with one block walked along the axis, and with a scale that stays on the machine, and prints a
row for each kind and method, of 100 screws each unless told. The truth is compared at 2001 places in each
direction: what the table adds there, less what the nut needs, both counted from home. Each screw is measured
by 50 instruments at 50 temperatures, within what is stated: a wrong length only tilts readings and table.
Names of methods run those alone. ``--into FILE`` keeps each screw as soon as it is measured, one JSON object
a line, and goes on where it was; 0 seeds print what was kept. ``--write`` puts the rows into
``bench/screws.md``.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from random import Random
from statistics import fmean
from typing import Any, Final

import numpy as np

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.band import Band, band_of
from gateway.metrology.build import Fit, HomeReference
from gateway.metrology.cycle import random_targets
from gateway.metrology.lead import periods_of
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Recipe, build_from, from_one_zero
from gateway.metrology.standard import Grade, limit_um
from gateway.metrology.uncertainty import UncertaintyInputs
from tests.metrology import screws, walks
from tests.metrology.screws import DOWN, UP, CurveKind, Screw

PLACES: Final = 2001
SEEDS: Final = 100
EXPANSION: Final = 11.5e-6
RANGE_K: Final = 0.2
"""The temperature of screw and instrument is known to within this."""
INSTRUMENTS: Final = 50


@dataclass(frozen=True)
class Method:
    """An instrument that shows the position everywhere; lengths in µm, uncertainties k = 2 over the axis."""

    name: str
    targets: int
    runs: int
    u_instrument: float
    scatter_um: float | None
    """Beside the last digit; None: that of the kind of screw."""
    digit_um: float
    grade: Grade | None = None
    """Each target is a gauge block of its own, of this grade: their errors differ, so the fit shows them."""


METHODS: Final = (
    Method("laser", 21, 5, 0.5, None, 0.01),
    Method("dial", 21, 3, 0.0, 0.7, 1.0, Grade.ONE),
    Method("block", 0, 0, 0.0, None, 1.0),
    Method("scale", 41, 3, 2.0, 0.5, 1.0),
)


@dataclass(frozen=True)
class Case:
    """What came of one screw; lengths in µm."""

    method: str
    kind: str
    seed: int
    covered: float
    """Share of the places at which the truth lies in the band."""
    u: float
    """Root of the mean square of U over the places."""
    missed: float
    """The same of what the table misses in truth."""
    e: float
    """E that is left in truth."""
    promised: float | None
    is_known: bool


def measured(screw: Screw, method: Method, random: Random, seed: int) -> Survey:
    """Return the readings of one axis by a method other than the block."""
    kind, length = screw.kind, walks.LENGTH
    spread = min(kind.lead or inf, length / method.targets / 2)
    targets = random_targets(0.0, length, method.targets, seed=seed, spread=spread)
    limit = {x: 0.0 if method.grade is None else limit_um(method.grade, x) / 1000 for x in targets}
    of_block = {x: random.uniform(-most, most) for x, most in limit.items()}
    scatter = (kind.noise_um if method.scatter_um is None else method.scatter_um) / 1000
    digit = method.digit_um / 1000

    def shown(x: float, way: Direction) -> float:
        dial = float(screw.deviation(x, way)) + of_block[x] + random.gauss(0, scatter)
        return x + round(dial / digit) * digit

    readings = [
        Reading(x, way, shown(x, way), run)
        for run in range(1, method.runs + 1)
        for way in (UP, DOWN)
        for x in targets
    ]
    return Survey(tuple(readings), Units.MM)


def case(kind: CurveKind, method: Method, seed: int) -> Case:
    screw, random = screws.screw_of(kind, seed)
    periods = periods_of(kind.lead, kind.turns)
    if method.name == "block":
        survey = walks.measured(screw, walks.SetUp(grade=Grade.ONE, per_side=2), random, seed)
        stated = UncertaintyInputs()
    else:
        survey = measured(screw, method, random, seed)
        stated = UncertaintyInputs(instrument=method.u_instrument / 1000, temperature_range=RANGE_K)
    survey, curves = from_one_zero(survey, periods)
    home = HomeReference(survey.targets[0], UP)
    built = build_from(survey, Recipe(home, fit=Fit.AUTO, periods=periods), curves)
    assert built.screw is not None
    band = band_of(built.screw, built.table, home, stated)
    assert band is not None, built.screw.unsettled
    left_out = built.screw.left_out(built.table)
    places = np.linspace(survey.targets[0], survey.targets[-1], PLACES)
    u = band_um(band, places)
    own = missed_um(screw, built.table, places, home.position)
    tilts = [0.0] if method.name == "block" else [tilt_um(method, random) for _ in range(INSTRUMENTS)]
    missed = np.array([own - tilt * (places - home.position) for tilt in tilts])
    return Case(
        method.name,
        kind.name,
        seed,
        float((np.abs(missed) <= u + 1e-9).mean()),
        float(np.sqrt(np.mean(u**2))),
        float(np.sqrt(np.mean(missed**2))),
        float(np.ptp(missed, axis=(1, 2)).mean()),
        None if left_out.e is None else left_out.e * 1000,
        not band.unknown,
    )


def tilt_um(method: Method, random: Random) -> float:
    """Return by how much an instrument and the temperature of the screw tilt the readings, in µm per mm."""
    wrong = random.gauss(0, method.u_instrument / 2) / walks.LENGTH
    return wrong + 1000 * EXPANSION * random.uniform(-RANGE_K / 2, RANGE_K / 2)


def missed_um(screw: Screw, table: CorrectionTable, places: Any, home: float) -> Any:
    """Return what a table adds less what the nut needs, from home forward; a row for each direction."""
    rows = []
    for way, curve in ((UP, table.forward), (DOWN, table.backward)):
        moved = np.interp(places, table.positions, curve)
        rows.append(moved + screw.deviation(places + moved, way))
    at_home = float(np.interp(home, table.positions, table.forward))
    return (np.array(rows) - (at_home + float(screw.deviation(home + at_home, UP)))) * 1000


def band_um(band: Band, places: Any) -> Any:
    """Return the uncertainty at places; a row a direction."""
    assert band.forward is not None
    assert band.backward is not None
    return (
        np.array([np.interp(places, band.positions, each) for each in (band.forward, band.backward)]) * 1000
    )


HEADING: Final = (
    "| method | screw | screws | covered | U | missed | E left | promised |\n"
    "|---|---|---|---|---|---|---|---|"
)


def row(method: str, name: str, found: Sequence[Case]) -> str:
    """Return a line of the table: means over the seeds."""
    told = [each.promised for each in found if each.promised is not None]
    return (
        f"| {method} | {name} | {len(found)} | {fmean(each.covered for each in found):.1%} | "
        f"{fmean(each.u for each in found):.2f} | {fmean(each.missed for each in found):.2f} | "
        f"{fmean(each.e for each in found):.2f} | {f'{fmean(told):.2f}' if told else '–'} |"
    )


def cases(
    methods: Sequence[Method], seeds: Sequence[int], kept: dict[tuple[str, str, int], Case], into: Path | None
) -> Iterator[Case]:
    """Measure the screws that were not measured before, each seed of all kinds first."""
    for seed in seeds:
        for method in methods:
            for kind in walks.kinds():
                key = (method.name, kind.name, seed)
                if key not in kept:
                    kept[key] = case(kind, method, seed)
                    if into is not None:
                        with into.open("a") as file:
                            file.write(json.dumps(asdict(kept[key])) + "\n")
                yield kept[key]


COMMAND: Final = "python -m tests.metrology.coverage"


def main(told: Sequence[str]) -> None:
    """Print the rows; see above."""
    words = list(told)
    into = Path(words.pop(words.index("--into") + 1)) if "--into" in words else None
    seeds = next((int(each) for each in words if each.isdecimal()), SEEDS)
    methods = [each for each in METHODS if each.name in words] or list(METHODS)
    kept: dict[tuple[str, str, int], Case] = {}
    if into is not None and into.exists():
        for line in into.read_text().splitlines():
            each = Case(**json.loads(line))
            kept[each.method, each.kind, each.seed] = each
    for _ in cases(methods, range(seeds), kept, into):
        pass
    rows = []
    for method in methods:
        mine = [each for each in kept.values() if each.method == method.name]
        of_kinds = {kind.name: [each for each in mine if each.kind == kind.name] for kind in walks.kinds()}
        rows += [
            row(method.name, name, found) for name, found in (of_kinds | {"**all**": mine}).items() if found
        ]
    sys.stdout.write("\n".join([HEADING, *rows, ""]))
    if "--write" in words:
        screws.into_page(COMMAND, lambda _: "\n".join([HEADING, *rows, ""]))


if __name__ == "__main__":
    main(sys.argv[1:])
