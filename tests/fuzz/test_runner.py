"""What ``make fuzz`` makes of libFuzzer's words, and of those of whoever calls it."""

from pathlib import Path

import pytest

from tests.fuzz.__main__ import Outcome, chosen, table, taken_over
from tests.fuzz.targets import TARGETS


def test_the_figures_of_a_run_are_those_that_the_fuzzer_said_last() -> None:
    outcome = Outcome("mbap")
    for line in (
        "#21571\tREDUCE cov: 123 ft: 615 corp: 125/2880b lim: 65 exec/s: 1540 rss: 78Mb L: 15/59",
        "#23176\tDONE   cov: 124 ft: 616 corp: 126/2914b lim: 71 exec/s: 1448 rss: 78Mb",
        "stat::number_of_executed_units: 23180",
        "stat::average_exec_per_sec:     1440",
    ):
        outcome.hear(line)
    assert (outcome.executions, outcome.per_s, outcome.coverage) == (23180, 1440, 124)
    assert table([outcome]).split("\n") == [
        "target  executions  exec/s  coverage  broken",
        "mbap         23180    1440       124       0",
    ]


def test_what_was_raised_is_said() -> None:
    outcome = Outcome("mbap")
    for line in (
        " === Uncaught Python exception: ===",
        "AssertionError: a frame that never came",
        "Traceback",
    ):
        outcome.hear(line)
    assert outcome.why == "AssertionError: a frame that never came"


def test_a_name_means_a_target_or_all_that_begin_with_it() -> None:
    assert chosen([]) == list(TARGETS)
    assert chosen(["mbap", "rtu"]) == ["rtu-requests", "rtu-replies", "mbap"]
    assert chosen(["tables-centroid-3"]) == ["tables-centroid-3"]
    with pytest.raises(SystemExit, match="there is no target tab; there are rtu-requests, "):
        chosen(["tab"])


def test_inputs_that_broke_a_rule_are_kept_and_slow_ones_are_not(tmp_path: Path) -> None:
    artifacts, crashes = tmp_path / "artifacts", tmp_path / "crashes"
    artifacts.mkdir()
    for name in ("crash-1", "timeout-2", "slow-unit-3"):
        (artifacts / name).write_bytes(name.encode())
    assert [path.name for path in taken_over(artifacts, crashes)] == ["crash-1", "timeout-2"]
    assert (crashes / "crash-1").read_bytes() == b"crash-1"
    assert list(artifacts.iterdir()) == []
