"""Simulated machines in ``make test``: a few minutes of each kind; ``make year`` plays hours."""

from collections import Counter

import pytest

from tests.year.many import play_seed

SEEDS = (3, 4)
HAPPENS = (
    "certain moves",
    "exact readings",
    "event restored",
    "event table-activated",
    "event gain-changed",
    "statuses with a target",
    "statuses with a reading",
    "restaged",
    "fault kill-at-write",
    "process was killed at a store",
    "fault power-cut",
    "fault unplug",
    "setpoints on one branch",
    "event axis-referenced",
    "event reference-lost",
    "event group-skewed",
    "fault reboot",
    "fault other-drives",
    "fault swap-adapters",
    "fault slow-store",
    "plans for which the disk was full",
)


@pytest.mark.parametrize(("seed", "is_cut"), [(9, True), (5, False)])
def test_a_calm_machine_moves_right_and_answers_everything(seed: int, is_cut: bool) -> None:
    result = play_seed(seed, 40.0, "none")
    assert result.finding == ""
    assert result.seen["processes"] == 1
    assert "unanswered" not in result.seen
    assert result.seen["exchanges"] > 10 * 40 * 0.8
    # All moves but the first of each of the four axes, repeats of a target, and turns on the way; a setpoint
    # of a stream is no move of its own.
    moves = result.seen["moves"] - result.seen.get("setpoints", 0)
    assert result.seen["certain moves"] > 0.9 * moves
    assert (result.seen.get("requests cut through", 0) > 10) is is_cut


def test_the_same_seed_gives_the_same_bytes_events_and_files() -> None:
    first, second = (play_seed(2, 80.0, "absurd") for _ in range(2))
    assert first.digest == second.digest
    assert first.seen == second.seen


def test_no_fault_makes_an_axis_go_wrong() -> None:
    results = [play_seed(seed, 120.0, "absurd") for seed in SEEDS]
    assert [result.finding for result in results] == ["", ""]
    seen = sum((Counter(result.seen) for result in results), Counter[str]())
    assert [what for what in HAPPENS if not seen[what]] == []
