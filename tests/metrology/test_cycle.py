import re
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.cycle import (
    Cycle,
    bidirectional_cycle,
    check_targets,
    cycle_program,
    endless_steps,
    enough_targets,
    even_targets,
    random_targets,
    remaining,
)
from gateway.metrology.errors import ReadingsError

MM = Cycle("x", Units.MM, feed=500, dwell=5, overrun=2, runs=2)


def test_the_endless_program_is_that_of_tb058() -> None:
    assert endless_steps("X", 0.5, 5, 4) == "G91X.5\nG4P5\nM102\n"
    assert endless_steps("x", -0.5, 5, 4) == "G91X-.5\nG4P5\nM102\n"
    assert endless_steps("Z", 25, 2.5, 3) == "G91Z25\nG4P2.5\nM102\n"


def test_a_cycle_of_two_targets_by_hand() -> None:
    program = cycle_program([10, 0], Cycle("x", Units.MM, feed=500, dwell=5, overrun=2, runs=1))
    assert program.splitlines() == [
        "G21 G90 G94",
        "G1 X-2.000 F500",
        "G1 X0.000",
        "G4 P5",
        "G1 X10.000",
        "G4 P5",
        "G1 X12.000",
        "G1 X10.000",
        "G4 P5",
        "G1 X0.000",
        "G4 P5",
        "G1 X-2.000",
        "M30",
    ]


def test_a_cycle_that_leaves_the_travel_is_refused() -> None:
    assert cycle_program([0, 10], MM, (-2.0, 12.0)) == cycle_program([0, 10], MM)
    for travel in ((-1.9, 20.0), (-5.0, 11.0)):
        with pytest.raises(ReadingsError, match="the cycle goes from -2 to 12"):
            cycle_program([0, 10], MM, travel)


def test_nothing_is_rounded_away_that_the_measurement_needs() -> None:
    for feed, dwell, overrun in ((0.0004, 5.0, 2.0), (500.0, 0.0004, 2.0), (500.0, 5.0, 0.0004)):
        with pytest.raises(ReadingsError, match="it must be above 0, with 3 decimals"):
            replace(MM, feed=feed, dwell=dwell, overrun=overrun)
    with pytest.raises(ReadingsError, match=r"with 3 decimals 1.0001 and 1.0002 are the same"):
        cycle_program([0.0, 1.0001, 1.0002], MM)
    # 1/32 inch: 32 steps of .0312 would be .0016 short of an inch.
    with pytest.raises(ReadingsError, match=r"the rounding of step 0.03125 would add up"):
        endless_steps("X", 0.03125, 5, 4)
    assert "G1 X0.000 F500" in cycle_program([1.9999, 10.0], MM)


def test_a_list_that_leaves_the_travel_is_refused() -> None:
    check_targets([0.0, 10.0], Units.MM, (0.0, 10.0))
    for travel in ((0.1, 20.0), (-5.0, 9.9)):
        with pytest.raises(ReadingsError, match="the targets go from 0 to 10"):
            check_targets([10.0, 0.0], Units.MM, travel)


@pytest.mark.parametrize("letter", ["F", "G", "M", "N", "P", "R", "", "XY", "x1", "ß"])
def test_words_of_a_program_are_no_axes(letter: str) -> None:
    with pytest.raises(ReadingsError, match="a program needs the letter of an axis, X, Y, Z, A, B, C, U"):
        Cycle(letter, Units.MM, feed=500, dwell=5, overrun=2, runs=1)


@given(st.sets(st.integers(-500, 500), min_size=2, max_size=12), st.integers(1, 4), st.sampled_from(Units))
def test_every_stop_is_approached_from_the_side_it_counts_for(
    places: set[int], runs: int, units: Units
) -> None:
    cycle = Cycle("Z", units, feed=20, dwell=3, overrun=1.5, runs=runs)
    lines = cycle_program([float(place) for place in places], cycle).splitlines()
    moves = [float(found.group(1)) for line in lines if (found := re.match(r"G1 Z(-?[\d.]+)", line))]
    stops = [i for i, line in enumerate(lines) if line.startswith("G4")]
    assert len(stops) == 2 * runs * len(places)
    at: list[tuple[float, float]] = []
    before = None
    for line in lines:
        if found := re.match(r"G1 Z(-?[\d.]+)", line):
            before, here = (at[-1][1] if at else float(found.group(1))), float(found.group(1))
            at.append((before, here))
        elif line.startswith("G4"):
            came_from, here = at[-1]
            assert here in places
            assert came_from != here
    forward = [here for came, here in at if here > came and here in places]
    backward = [here for came, here in at if here < came and here in places]
    assert sorted(forward) == sorted(backward) == sorted([*places] * runs)
    assert min(moves) == min(places) - 1.5
    assert max(moves) == max(places) + 1.5
    assert lines[0].split()[0] == {Units.MM: "G21", Units.INCH: "G20", Units.DEGREE: "G90"}[units]


@given(
    st.floats(-1000, 1000),
    st.floats(10, 2000),
    st.integers(2, 60),
    st.integers(),
    st.floats(0, 0.4),
)
def test_random_targets_rise_inside_the_range_and_move_by_less_than_the_spread(
    low: float, length: float, count: int, seed: int, share: float
) -> None:
    high, spread = low + length, share * length / count
    interval = (length - spread) / (count - 1)
    assume(spread < interval)
    targets = random_targets(low, high, count, seed=seed, spread=spread, decimals=9)
    assert targets == random_targets(low, high, count, seed=seed, spread=spread, decimals=9)
    assert all(low <= target <= high for target in targets)
    for i, target in enumerate(targets):
        assert -1e-8 <= target - (low + i * interval) <= spread + 1e-8
    assert targets == sorted(targets)


def test_another_seed_gives_other_targets() -> None:
    assert random_targets(0, 500, 11, seed=1) != random_targets(0, 500, 11, seed=2)


def test_targets_break_the_period_of_the_screw() -> None:
    """With a lead of 5 mm an even grid of 50 mm always stops at one angle; these do not."""
    angles = {round(target % 5.0) for target in random_targets(0, 500, 11, seed=1, spread=5)}
    assert len(angles) >= 4
    assert {target % 5.0 for target in even_targets(0, 500, 50)} == {0.0}


def test_even_targets_reach_the_end() -> None:
    assert even_targets(0, 1, 0.1)[-1] == pytest.approx(1.0)
    assert even_targets(-32.6, 0, 0.5)[:2] == [-32.6, -32.1]
    assert (enough_targets(300), enough_targets(1000), enough_targets(1500)) == (5, 5, 8)


@pytest.mark.parametrize(
    "make",
    [
        lambda: even_targets(0, 10, 0),
        lambda: even_targets(0, 10, 11),
        lambda: even_targets(10, 0, 1),
        lambda: even_targets(0, 1e9, 1e-3),
        lambda: random_targets(0, 10, 1, seed=1),
        lambda: random_targets(0, 10, 5, seed=1, spread=3),
        lambda: random_targets(0, 10, 5, seed=1, spread=-1),
        lambda: random_targets(0, float("nan"), 5, seed=1),
        lambda: endless_steps("X", 0, 5, 3),
        lambda: Cycle("xy", Units.MM, feed=500, dwell=5, overrun=2, runs=1),
        lambda: Cycle("x", Units.MM, feed=0, dwell=5, overrun=2, runs=1),
        lambda: Cycle("x", Units.MM, feed=500, dwell=5, overrun=0, runs=1),
        lambda: Cycle("x", Units.MM, feed=500, dwell=5, overrun=2, runs=0),
    ],
)
def test_what_no_machine_would_run_is_refused(make: object) -> None:
    with pytest.raises(ReadingsError):
        make()  # type: ignore[operator]


@given(done=st.integers(0, 12), overrun=st.floats(0.5, 2.0))
def test_what_is_left_begins_at_the_turn_before_the_next_reading(done: int, overrun: float) -> None:
    """Three targets, two cycles: twelve readings."""
    stops = list(bidirectional_cycle([0.0, 10.0, 20.0], overrun, 2))
    measured = [stop for stop in stops if stop.measure]
    left = remaining(stops, done)
    assert [stop for stop in left if stop.measure] == measured[done:]
    if left:
        assert not left[0].measure
        for before, after in pairwise(left):
            way = Direction.FORWARD if after.nominal > before.nominal else Direction.BACKWARD
            assert after.direction is way
