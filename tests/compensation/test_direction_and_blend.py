"""Direction with hysteresis, and the state-based blend."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.blend import shape, towards
from gateway.compensation.direction import Direction, Travel, follow

START = Travel(Direction.FORWARD, 100.0)


def test_direction_changes_only_after_the_hysteresis() -> None:
    assert follow(START, 99.9991, 0.001) == START
    assert follow(START, 99.999, 0.001) == Travel(Direction.BACKWARD, 99.999)


def test_hysteresis_counts_from_the_furthest_point_not_from_the_last() -> None:
    travel = START
    for setpoint in (99.9996, 99.9993, 99.9991):
        travel = follow(travel, setpoint, 0.001)
    assert travel == START
    assert follow(travel, 99.9989, 0.001).direction is Direction.BACKWARD


def test_an_equal_setpoint_changes_nothing_even_without_hysteresis() -> None:
    assert follow(START, 100.0, 0.0) == START
    assert follow(Travel(Direction.BACKWARD, 5.0), 5.0, 0.0) == Travel(Direction.BACKWARD, 5.0)


def test_unknown_direction_is_decided_by_the_first_real_distance() -> None:
    unknown = Travel(Direction.UNKNOWN, 10.0)
    assert follow(unknown, 10.0005, 0.001) == unknown
    assert follow(unknown, 10.0011, 0.001).direction is Direction.FORWARD
    assert follow(unknown, 9.99, 0.001).direction is Direction.BACKWARD


@given(st.lists(st.floats(-0.00049, 0.00049), max_size=50))
def test_dither_below_the_hysteresis_never_changes_the_branch(noise: list[float]) -> None:
    travel = Travel(Direction.FORWARD, 0.0)
    for offset in noise:
        travel = follow(travel, offset, 0.001)
        assert travel.direction is Direction.FORWARD


def test_shape_is_exact_at_both_ends() -> None:
    assert (shape(-1.0), shape(0.0), shape(1.0), shape(2.0)) == (0.0, 0.0, 1.0, 1.0)


@given(st.lists(st.tuples(st.sampled_from([0.0, 1.0]), st.floats(0, 0.4)), max_size=60))
def test_interrupted_progress_ends_without_residue(steps: list[tuple[float, float]]) -> None:
    progress = 0.0
    for goal, share in steps:
        progress = towards(progress, goal, share)
        assert 0.0 <= progress <= 1.0
    for _ in range(4):
        progress = towards(progress, 1.0, 0.3)
    assert progress == 1.0
