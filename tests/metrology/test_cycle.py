"""Targets and the order in which an axis goes to them."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.direction import Direction
from gateway.metrology.cycle import bidirectional_cycle, even_targets, random_targets, remaining
from gateway.metrology.errors import ReadingsError


def test_even_targets_end_where_they_should() -> None:
    assert even_targets(0.0, 1.0, 0.1) == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]


@pytest.mark.parametrize(
    ("low", "high", "step", "told"),
    [
        (0.0, 10.0, 3.0, r"3\.33333 steps of 3: it must be a whole number; end at 9"),
        (0.0, 10.0, 20.0, "end at 20"),
        (10.0, 0.0, 1.0, "the first must be the lower one"),
        (0.0, 10.0, 0.0, "greater than 0"),
        (0.0, 10.0, float("nan"), "greater than 0"),
        (0.0, 1e9, 1e-3, "at most 10000 targets"),
        (float("-inf"), 1.0, 1.0, "the first must be the lower one"),
    ],
)
def test_a_grid_that_is_none_is_refused(low: float, high: float, step: float, told: str) -> None:
    with pytest.raises(ReadingsError, match=told):
        even_targets(low, high, step)


@given(
    low=st.floats(-1000, 1000),
    length=st.floats(50, 3000),
    count=st.integers(2, 40),
    seed=st.integers(0, 1000),
)
def test_random_targets_ascend_inside_the_range_each_in_its_own_interval(
    low: float, length: float, count: int, seed: int
) -> None:
    high = low + length
    targets = random_targets(low, high, count, seed)
    assert targets == random_targets(low, high, count, seed)
    assert len(targets) == count
    assert all(low <= target <= high for target in targets)
    # P(i) = (i - 1) p + r with 0 <= r <= 0.3 of the interval that n - 1 + 0.3 of them make of the range.
    interval = length / (count - 1 + 0.3)
    for index, target in enumerate(targets):
        offset = target - low - index * interval
        assert -0.0006 <= offset <= 0.3 * interval + 0.0006
    assert all(one < other for one, other in pairwise(targets))


def test_offsets_are_anywhere_in_one_turn_of_the_screw() -> None:
    """13 targets and a lead of 5 mm on 305 mm: 25 mm apart, and each up to 5 mm further."""
    offsets = [
        target - 25.0 * (index % 13)
        for seed in range(40)
        for index, target in enumerate(random_targets(0.0, 305.0, 13, seed, period=5.0))
    ]
    assert min(offsets) >= 0.0
    assert max(offsets) <= 5.0
    assert min(offsets) < 0.2
    assert max(offsets) > 4.8


@pytest.mark.parametrize(
    ("count", "period", "told"),
    [(1, 0.0, "allowed are 2 to 10000"), (20, 5.0, "change places"), (5, -1.0, "greater than 0")],
)
def test_random_targets_without_room_are_refused(count: int, period: float, told: str) -> None:
    with pytest.raises(ReadingsError, match=told):
        random_targets(0.0, 100.0, count, 1, period)


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
