"""The order in which an axis goes to its targets."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.direction import Direction
from gateway.metrology.cycle import bidirectional_cycle, remaining


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
