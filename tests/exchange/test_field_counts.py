"""Rounding a correction to whole steps: to the nearest, and halves to the even one, as ``round`` does."""

from math import inf, ldexp, nextafter

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.exchange.field_counts import nearest
from tests.soak import repeated


@settings(max_examples=repeated(6000))
@given(st.floats(-(2.0**60), 2.0**60))
def test_the_nearest_whole_number_is_what_round_says(value: float) -> None:
    assert nearest(value) == round(value)


@settings(max_examples=repeated(6000))
@given(st.integers(-(2**40), 2**40), st.integers(-3, 3))
def test_next_to_a_half_too(whole: int, steps: int) -> None:
    value = whole + 0.5
    for _ in range(abs(steps)):
        value = nextafter(value, inf if steps > 0 else -inf)
    assert nearest(value) == round(value)


def test_the_smallest_numbers_are_nearest_to_0() -> None:
    assert [nearest(sign * ldexp(1.0, e)) for sign in (1, -1) for e in (-1074, -60, -54, -2)] == [0] * 8
