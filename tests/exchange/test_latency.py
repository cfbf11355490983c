"""Histograms with integer log-linear buckets, and high marks."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.exchange.latency import (
    BUCKETS,
    LONGEST_NS,
    HighMark,
    bucket_of,
    middle_ns,
    percentiles_ns,
    running_totals,
)

S = 1_000_000_000


@given(st.integers(1, LONGEST_NS))
def test_a_time_is_known_within_a_sixtieth(span_ns: int) -> None:
    assert abs(middle_ns(bucket_of(span_ns)) - span_ns) * 60 <= span_ns


@given(st.integers(0, LONGEST_NS - 1))
def test_buckets_ascend(span_ns: int) -> None:
    assert 0 <= bucket_of(span_ns) <= bucket_of(span_ns + 1) <= bucket_of(span_ns) + 1
    assert bucket_of(span_ns + 1) < BUCKETS


def test_what_is_too_long_or_negative_is_counted_at_the_ends() -> None:
    assert bucket_of(LONGEST_NS) == bucket_of(LONGEST_NS + 1) == bucket_of(10**18) == BUCKETS - 1
    assert bucket_of(-1) == bucket_of(-(10**18)) == 0


def test_percentiles_of_a_thousand_times() -> None:
    counts = [0] * BUCKETS
    for us in range(1, 1001):
        counts[bucket_of(us * 1000)] += 1
    for found, us in zip(
        percentiles_ns(running_totals(counts), (0.5, 0.99, 0.999, 1.0)), (500, 990, 999, 1000), strict=True
    ):
        assert abs(found - us * 1000) * 60 <= us * 1000
    assert percentiles_ns(running_totals([0] * BUCKETS), (0.5, 0.999)) == [0, 0]


def test_a_high_mark_is_kept_for_ever_and_for_a_minute() -> None:
    mark = HighMark()
    mark.tick(0)
    mark.raise_to(700)
    assert (mark.ever_ns, mark.minute_ns) == (700, 700)
    for second in range(10, 60, 10):  # slots of ten seconds: at 10, 20 … 50 it is still there
        mark.tick(second * S)
        assert mark.minute_ns == 700
    mark.raise_to(300)
    mark.tick(60 * S)
    assert mark.minute_ns == 700
    mark.tick(70 * S)
    assert (mark.ever_ns, mark.minute_ns) == (700, 300)
