"""Token buckets and reports: by hand, and what holds for whatever comes."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.limits import EVERY_NS, MOST_KEYS, Reports, TokenBucket, bucket_of, others_of_pairs, times
from gateway.times import NS_PER_S

START_NS = 1000 * NS_PER_S


def test_ten_at_once_and_then_one_a_second() -> None:
    bucket = bucket_of(1.0, 10)
    assert [bucket.takes(START_NS) for _ in range(12)] == [True] * 10 + [False] * 2
    assert not bucket.takes(START_NS + NS_PER_S // 2)
    assert bucket.takes(START_NS + NS_PER_S)
    assert not bucket.takes(START_NS + NS_PER_S)
    assert [bucket.takes(START_NS + 1000 * NS_PER_S) for _ in range(11)] == [True] * 10 + [False]


def test_a_bucket_is_full_again_after_a_pause() -> None:
    bucket = bucket_of(2.0, 3)
    assert bucket.is_full(START_NS)
    bucket.take(START_NS)
    assert not bucket.is_full(START_NS + NS_PER_S // 2 - 1)
    assert bucket.is_full(START_NS + NS_PER_S // 2)


def test_what_is_given_back_counts_no_more() -> None:
    bucket = bucket_of(1.0, 2)
    assert [bucket.takes(START_NS) for _ in range(3)] == [True, True, False]
    bucket.give_back()
    assert [bucket.takes(START_NS) for _ in range(2)] == [True, False]


@given(
    st.integers(1, 100),
    st.integers(1, 50),
    st.lists(st.integers(0, NS_PER_S), min_size=1, max_size=200),
)
def test_no_window_lets_more_through_than_its_rate_and_its_burst(
    per_s: int, at_once: int, pauses_ns: list[int]
) -> None:
    bucket, now_ns, taken_ns = bucket_of(per_s, at_once), START_NS, []
    for pause_ns in pauses_ns:
        now_ns += pause_ns
        if bucket.takes(now_ns):
            taken_ns.append(now_ns)
    interval_ns = int(NS_PER_S / per_s)
    for first, begins_ns in enumerate(taken_ns):
        for last in range(first, len(taken_ns)):
            assert last - first + 1 <= at_once + (taken_ns[last] - begins_ns) // interval_ns


def test_the_first_of_a_kind_and_then_one_a_minute_with_their_number() -> None:
    reports: Reports[str] = Reports()
    found = [reports.sentence("a", f"at {now_s}", now_s * NS_PER_S) for now_s in (0, 1, 59, 60, 61)]
    # At 60 s: those of 1, 59 and 60 s.
    assert found == ["at 0", "", "", "at 60, 3 times since the last note", ""]
    assert reports.sentence("b", "of another kind", 61 * NS_PER_S) == "of another kind"


def test_a_burst_is_reported_one_by_one() -> None:
    reports: Reports[str] = Reports(NS_PER_S, 3)
    assert [reports.due("a", START_NS) for _ in range(5)] == [1, 1, 1, 0, 0]
    assert reports.due("a", START_NS + NS_PER_S) == 3


def test_what_was_held_back_is_reported_later_and_who_is_quiet_is_forgotten() -> None:
    reports: Reports[str] = Reports()
    for key, often in (("loud", 3), ("quiet", 1)):
        for _ in range(often):
            reports.due(key, START_NS)
    assert reports.held_back(START_NS + EVERY_NS - 1) == []
    assert reports.held_back(START_NS + EVERY_NS) == [("loud", 2)]
    assert (reports.knows("loud"), reports.knows("quiet")) == (True, False)
    assert reports.due("loud", START_NS + EVERY_NS + 1) == 0


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 30)), max_size=300))
def test_each_one_is_counted_once(comings: list[tuple[int, int]]) -> None:
    """Whatever comes, the reports and what is held back at the end add up to what came."""
    reports: Reports[int] = Reports(most=5, others=lambda _: -1)
    now_ns, counted, kinds = START_NS, 0, set()
    for kind, pause_s in comings:
        now_ns += pause_s * NS_PER_S
        kinds.add(reports.counted_as(kind))
        counted += reports.due(kind, now_ns)
    counted += sum(count for _, count in reports.held_back(now_ns + EVERY_NS))
    assert counted == len(comings)
    assert len(kinds) <= 6


def test_how_often() -> None:
    assert (times(0), times(1), times(2)) == ("", "", ", 2 times since the last note")


def test_a_bucket_of_nanoseconds_lets_the_burst_through_and_one_more() -> None:
    bucket = TokenBucket(10, 30)
    assert [bucket.takes(100) for _ in range(5)] == [True] * 4 + [False]


def test_further_pairs_of_names_are_counted_together() -> None:
    reports: Reports[tuple[str, str]] = Reports(others=others_of_pairs)
    due = [reports.due(("line-down", f"reason {number}"), START_NS) for number in range(5000)]
    assert sum(due) == MOST_KEYS + 1
