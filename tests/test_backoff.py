"""The pauses between attempts."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.backoff import Backoff


def test_pauses_double_up_to_the_longest() -> None:
    backoff = Backoff(1.0, 60.0)
    assert [backoff.next_s() for _ in range(8)] == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0]
    assert backoff.failures == 8
    backoff.reset()
    assert backoff.next_s() == 1.0


def test_one_short_pause_comes_first_and_is_not_spread() -> None:
    backoff = Backoff(0.1, 3.0, at_once_s=0.01, spread=(0.9, 1.1), share=lambda: 1.0)
    found = [backoff.next_s() for _ in range(7)]
    assert found == pytest.approx([0.01, 0.11, 0.22, 0.44, 0.88, 1.76, 3.3])


@pytest.mark.parametrize(("share", "first_s", "last_s"), [(0.0, 0.5, 30.0), (1.0, 1.0, 60.0)])
def test_pauses_are_spread(share: float, first_s: float, last_s: float) -> None:
    backoff = Backoff(1.0, 60.0, spread=(0.5, 1.0), share=lambda: share)
    pauses_s = [backoff.next_s() for _ in range(10)]
    assert (pauses_s[0], pauses_s[-1]) == (first_s, last_s)


@given(st.integers(0, 10**6))
def test_however_often_it_fails_the_pause_is_no_longer_than_the_longest(failures: int) -> None:
    backoff = Backoff(0.5, 30.0)
    backoff.failures = failures
    assert 0.5 <= backoff.pause_s <= 30.0
