"""The bench's statistics: quantiles, ratios over rounds, verdicts."""

import doctest

import pytest

from bench import figures, machine, report, serial_times
from bench.figures import Interval, Judged, Round, Verdict, added, added_ratio, quantile, ratio, verdict
from bench.scenarios import hot


def rounds(*medians: float) -> list[Round]:
    return [Round(p50, 2 * p50, 3 * p50, 4 * p50) for p50 in medians]


def test_quantiles_are_values_that_occurred() -> None:
    thousand = list(range(1, 1001))
    assert [quantile(thousand, share) for share in (0.5, 0.99, 0.999, 1.0)] == [500, 990, 999, 1000]
    assert quantile([5], 0.001) == 5


def test_a_quantile_of_nothing_is_an_error() -> None:
    with pytest.raises(ValueError, match="nothing"):
        quantile([], 0.5)


def test_a_round_sums_up_latencies_in_any_order() -> None:
    assert Round.of([*range(2000, 0, -1)]) == Round(1000, 1980, 1998, 2000)


def test_rounds_that_are_alike_leave_no_doubt() -> None:
    series = {"direct": rounds(10, 10, 10), "a": rounds(30, 30, 30), "b": rounds(50, 50, 50)}
    assert ratio(series, "a", "b") == Interval(0.6, 0.6, 0.6)
    # a adds 20 and b adds 40
    assert added_ratio(series, "a", "b") == Interval(0.5, 0.5, 0.5)
    assert added(series, "a") == Interval(20, 20, 20)


def test_the_estimate_is_a_ratio_of_medians_over_rounds() -> None:
    series = {"a": rounds(10, 20, 90), "b": rounds(10, 40, 50)}
    assert ratio(series, "a", "b").estimate == 20 / 40
    assert ratio(series, "a", "b", "p99").estimate == 40 / 80


def test_what_slows_a_whole_round_down_does_not_widen_the_interval() -> None:
    """Rounds are resampled together: a is half of b in every one of them, however slow the machine was."""
    series = {"a": rounds(10, 1000, 20, 500, 40), "b": rounds(20, 2000, 40, 1000, 80)}
    assert ratio(series, "a", "b") == Interval(0.5, 0.5, 0.5)


def test_rounds_that_differ_widen_the_interval() -> None:
    found = ratio({"a": rounds(10, 12, 14, 16, 18), "b": rounds(10, 10, 10, 10, 10)}, "a", "b")
    assert found.estimate == 1.4
    assert found.low < 1.4 < found.high
    assert found.low >= 1.0
    assert found.high <= 1.8


def test_the_same_rounds_give_the_same_interval() -> None:
    series = {"a": rounds(10, 12, 14, 16, 18), "b": rounds(11, 10, 13, 10, 12)}
    assert ratio(series, "a", "b") == ratio(series, "a", "b")


def test_adding_nothing_is_infinitely_less_than_adding_something() -> None:
    series = {"direct": rounds(10, 10), "a": rounds(30, 30), "b": rounds(10, 10)}
    assert added_ratio(series, "a", "b").estimate == float("inf")


@pytest.mark.parametrize(
    ("found", "by", "expected"),
    [
        (Interval(0.8, 0.7, 0.9), Judged.ESTIMATE, Verdict.REACHED),
        (Interval(0.9, 0.8, 1.0), Judged.ESTIMATE, Verdict.REACHED),
        (Interval(0.9, 0.8, 1.1), Judged.ESTIMATE, Verdict.WITHIN_NOISE),
        (Interval(1.1, 0.9, 1.2), Judged.ESTIMATE, Verdict.MISSED),
        (Interval(1.1, 0.9, 1.2), Judged.LOW, Verdict.WITHIN_NOISE),
        (Interval(1.2, 1.01, 1.3), Judged.LOW, Verdict.MISSED),
        (None, Judged.LOW, Verdict.NOT_MEASURED),
    ],
)
def test_verdicts_at_a_limit_of_1(found: Interval | None, by: Judged, expected: Verdict) -> None:
    assert verdict(found, 1.0, by) is expected


def test_wire_times_are_characters_by_bits_by_baud() -> None:
    # 21 characters of 10 bits: 210 bits; at 115200 baud 1.822917 ms, on two wires twice that
    assert serial_times.round_trip_ns(115200, 1) == pytest.approx(1_822_916.7, abs=0.1)
    assert serial_times.round_trip_ns(115200, 2) == pytest.approx(3_645_833.3, abs=0.1)


@pytest.mark.parametrize("module", [figures, machine, report, serial_times, hot])
def test_examples_in_docstrings(module: object) -> None:
    found = doctest.testmod(module)  # type: ignore[arg-type]
    assert (found.failed, found.attempted > 0) == (0, True)
