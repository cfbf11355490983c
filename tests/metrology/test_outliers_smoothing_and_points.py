from itertools import combinations
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.outliers import find_outliers, without_outliers
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.resample import fewest_points, on_grid, smoothed
from gateway.metrology.tables import correction_at, loss

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
UM = 1e-3
NOISE_UM = (0.0, 0.4, -0.5, 0.3, -0.2)


def survey(deviation_um: dict[tuple[float, int], float], runs: int, targets: int = 9) -> Survey:
    """A slightly curved screw with small noise; ``deviation_um`` adds slips at (target, run), forward."""
    return Survey(
        tuple(
            Reading(
                x * 10.0,
                way,
                x * 10.0
                + UM
                * (
                    0.1 * x * x
                    + NOISE_UM[(run + x) % 5]
                    + (deviation_um.get((x * 10.0, run), 0.0) if way is UP else 0.0)
                ),
                run,
            )
            for way in (UP, DOWN)
            for run in range(1, runs + 1)
            for x in range(targets)
        ),
        Units.MM,
    )


@pytest.mark.parametrize("runs", [1, 2, 3, 5])
def test_a_slip_is_named_and_nothing_else(runs: int) -> None:
    found = find_outliers(survey({(40.0, 1): 25.0}, runs))
    assert [(o.reading.target, o.reading.direction, o.reading.run) for o in found] == [(40.0, UP, 1)]
    assert found[0].against == ("runs" if runs >= 3 else "neighbours")
    assert "forward run 1 at 40: deviation" in found[0].describe("mm")


@pytest.mark.parametrize("runs", [1, 2, 3, 5])
def test_sound_readings_have_no_outliers(runs: int) -> None:
    assert find_outliers(survey({}, runs)) == ()


@pytest.mark.parametrize("runs", [1, 2, 3, 5, 10])
def test_normal_scatter_is_seldom_taken_for_an_outlier(runs: int) -> None:
    """Each survey has 42 to 420 readings; by the usual limits most of those of three runs would have one."""
    random = Random(runs)
    named = 0
    for _ in range(60):
        readings = [
            Reading(x * 25.0, way, x * 25.0 * 1.00006 + random.gauss(0, 2 * UM), run)
            for way in (UP, DOWN)
            for run in range(1, runs + 1)
            for x in range(21)
        ]
        named += bool(find_outliers(Survey(tuple(readings), Units.MM)))
    assert named <= 7


def test_a_micron_among_equal_readings_is_no_outlier() -> None:
    readings = [
        Reading(x, UP, x + (UM if (x, run) == (20, 2) else 0), run) for x in (0, 20) for run in (1, 2, 3)
    ]
    assert find_outliers(Survey(tuple(readings), Units.MM)) == ()


def test_two_slips_are_both_left_out() -> None:
    bad = survey({(40.0, 1): 25.0, (70.0, 3): -18.0}, 5)
    found = find_outliers(bad)
    assert [(o.reading.target, o.reading.run) for o in found] == [(40.0, 1), (70.0, 3)]
    assert without_outliers(bad, found)[1] == ()
    assert len(without_outliers(bad, found)[0]) == len(bad.readings) - 2


def table(forward_um: list[float], backward_um: list[float], step: float = 10.0) -> CorrectionTable:
    positions = [i * step for i in range(len(forward_um))]
    return make_table(positions, [f * UM for f in forward_um], [b * UM for b in backward_um], Units.MM)


def test_smoothing_by_hand() -> None:
    # Window 40: at 10 the points 0, 10, 20 count 1/2, 1, 1/2, so the mean of 0, 3, 0 is 1.5; the slope is 0.
    smooth, change = smoothed(table([0, 3, 0], [0, 0, 0]), 40.0)
    assert smooth.forward[1] == pytest.approx(1.5 * UM)
    assert list(smooth.backward) == [0, 0, 0]
    assert change.largest == pytest.approx(1.5 * UM)
    assert (change.position, change.direction) == (10.0, UP)
    assert change.rms == pytest.approx(1.5 * UM / 6**0.5)  # the ends have two points and stay


@given(st.floats(-0.005, 0.005), st.floats(-1, 1), st.integers(3, 20))
def test_a_straight_curve_stays(slope: float, offset: float, count: int) -> None:
    line = [offset + slope * i for i in range(count)]
    after, change = smoothed(make_table([i * 1.0 for i in range(count)], line, line, Units.MM), 5.0)
    assert list(after.forward) == pytest.approx(line, abs=1e-12)
    assert change.largest < 1e-12


@pytest.mark.parametrize("window", [0.0, -1.0, 19.0])
def test_a_window_that_smooths_nothing_is_refused(window: float) -> None:
    with pytest.raises(ReadingsError, match="smoothing window"):
        smoothed(table([0, 3, 0], [0, 0, 0]), window)


def test_an_even_grid_begins_at_a_multiple_of_the_step() -> None:
    # TB058: limits -32.6 to 0 and a step of 0.5 give -32.5 as the first point.
    after, lost = on_grid(make_table([-32.6, 0.0], [0.0326, 0.0], [0.0, 0.0], Units.INCH), 0.5)
    assert (after.first, after.last, len(after.positions)) == (-32.5, 0.0, 66)
    assert after.forward[0] == pytest.approx(0.0325)
    assert lost.size == pytest.approx(0.0001)
    assert lost.position == -32.6


def test_what_a_wide_grid_loses_is_said() -> None:
    after, lost = on_grid(table([0, 5, 0, -1, 0], [0] * 5), 20.0)
    assert list(after.positions) == [0.0, 20.0, 40.0]
    assert lost.size == pytest.approx(5 * UM)
    assert (lost.position, lost.direction) == (10.0, UP)


@pytest.mark.parametrize("step", [0.0, -5.0, 41.0, 1e-9])
def test_a_step_that_makes_no_grid_is_refused(step: float) -> None:
    with pytest.raises(ReadingsError, match="a step of"):
        on_grid(table([0, 1, 0, 1, 0], [0] * 5), step)


def test_points_on_a_line_are_left_out() -> None:
    after, lost = fewest_points(table([0, 1, 2, 3, 2, 1], [0, 0, 0, 0, 0, 0]), 0.0)
    assert list(after.positions) == [0.0, 30.0, 50.0]
    assert lost.size < 1e-15


def test_both_directions_count() -> None:
    after, _ = fewest_points(table([0, 1, 2, 3, 4], [0, 0, 4, 0, 0]), 0.5 * UM)
    assert list(after.positions) == [0.0, 10.0, 20.0, 30.0, 40.0]


def test_a_point_that_must_stay_stays() -> None:
    after, _ = fewest_points(table([0, 1, 2, 3, 4], [0] * 5), 0.0, keep=[20.0])
    assert list(after.positions) == [0.0, 20.0, 40.0]


@given(
    st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=3, max_size=9),
    st.integers(0, 8),
)
def test_no_smaller_choice_of_points_does(pairs: list[tuple[int, int]], tolerance_um: int) -> None:
    before = table([float(f) for f, _ in pairs], [float(b) for _, b in pairs])
    tolerance = tolerance_um * UM
    after, lost = fewest_points(before, tolerance)
    assert lost.size <= tolerance + 1e-12
    assert set(after.positions) <= set(before.positions)
    inner = list(before.positions)[1:-1]
    for fewer in range(len(after.positions) - 2):
        for chosen in combinations(inner, fewer):
            positions = [before.first, *chosen, before.last]
            other = make_table(
                positions,
                [correction_at(before, x, UP) for x in positions],
                [correction_at(before, x, DOWN) for x in positions],
                Units.MM,
            )
            assert loss(before, other).size > tolerance
