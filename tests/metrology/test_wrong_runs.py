"""Runs that are wrong as a whole are named, and nothing is promised before that is settled."""

from collections.abc import Callable
from math import sin
from random import Random

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.build import Fit
from gateway.metrology.doubts import notes_of
from gateway.metrology.errors import ReadingsError
from gateway.metrology.outliers import find_outliers
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.wrong_runs import wrong_runs

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
TARGETS = [20.0 * index + 3.7 * sin(index) for index in range(21)]

Change = Callable[[Reading], Reading]


def other_way(each: Reading) -> Reading:
    return Reading(each.target, DOWN if each.direction is UP else UP, each.measured, each.run)


def inverted(each: Reading) -> Reading:
    return Reading(each.target, each.direction, each.target - each.deviation, each.run)


def counted_down(each: Reading) -> Reading:
    return Reading(each.target, each.direction, -each.measured, each.run)


def aside(each: Reading) -> Reading:
    return Reading(each.target, each.direction, each.measured + 0.005, each.run)


def survey(
    wrong: dict[int, Change], *, runs: int = 5, noise_um: float = 0.4, per_run_um: float = 0.0, seed: int = 1
) -> Survey:
    """A screw with waves of 8 µm, 10 µm of lost motion, and runs of which some are changed."""
    random = Random(seed)

    def noise() -> float:
        return random.gauss(0, noise_um)

    readings = [
        Reading(x, way, x + (8 * sin(x / 60) - way.value * 5 + noise() + per_run_um * run) / 1e3, run)
        for run in range(1, runs + 1)
        for way in (UP, DOWN)
        for x in TARGETS
    ]
    changed = (wrong[each.run](each) if each.run in wrong else each for each in readings)
    return Survey(tuple(changed), Units.MM, source="x.csv")


@pytest.mark.parametrize("runs", [3, 5])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (other_way, "run 3: directions swapped"),
        (inverted, "run 3: sign turned"),
        (counted_down, "run 3: sign turned"),
    ],
)
def test_a_run_that_was_read_wrongly_is_named_and_makes_no_table(
    change: Change, words: str, runs: int
) -> None:
    bad = survey({3: change}, runs=runs)
    assert find_outliers(bad) == ()
    with pytest.raises(ReadingsError, match=f"x.csv: {words}.*--drop-outliers"):
        build_from(bad, Recipe())
    left = build_from(bad, Recipe(drop_outliers=True))
    assert any(note.startswith(f"left out: {words}") for note in left.notes)
    sound = survey({}, runs=runs)
    as_without = build_from(
        Survey(tuple(each for each in sound.readings if each.run != 3), Units.MM), Recipe()
    )
    assert left.table == as_without.table


@pytest.mark.parametrize(("run", "per_run_um"), [(1, 0.0), (3, 2.0)])
def test_a_run_that_lies_aside_is_named_and_nothing_is_promised(run: int, per_run_um: float) -> None:
    bad = survey({run: aside}, per_run_um=per_run_um)
    [found] = wrong_runs(bad)
    assert found.away == pytest.approx(0.005, abs=0.0008)
    assert any(
        note.startswith(f"run {run}: ") and " µm beside the other runs" in note for note in notes_of(bad)
    )
    assert find_outliers(bad) == ()
    made = build_from(bad, Recipe(fit=Fit.AUTO))
    assert made.screw is not None
    left_out = made.screw.left_out(made.table)
    assert (left_out.e, left_out.high) == (None, None)
    assert f"run {run}: " in left_out.unknown
    settled = build_from(bad, Recipe(fit=Fit.AUTO, drop_outliers=True))
    assert settled.screw is not None
    assert settled.screw.left_out(settled.table).e is not None


def test_with_two_runs_nobody_can_say_which_is_wrong() -> None:
    with pytest.raises(ReadingsError, match="run 1 or run 2: directions swapped"):
        build_from(survey({2: other_way}, runs=2), Recipe(drop_outliers=True))


@pytest.mark.parametrize("runs", [2, 3, 5])
@pytest.mark.parametrize("per_run_um", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("noise_um", [0.0, 0.4, 3.0])
def test_sound_runs_are_never_called_wrong(runs: int, per_run_um: float, noise_um: float) -> None:
    for seed in range(20):
        assert wrong_runs(survey({}, runs=runs, noise_um=noise_um, per_run_um=per_run_um, seed=seed)) == ()


def test_a_warm_up_that_levels_off_is_no_run_aside() -> None:
    late = {run: 0.004 * (1 - 0.5**run) for run in range(6)}
    moved = [
        Reading(each.target, each.direction, each.measured + late[each.run], each.run)
        for each in survey({}).readings
    ]
    assert wrong_runs(Survey(tuple(moved), Units.MM)) == ()
