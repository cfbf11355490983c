"""Simulated machines in ``make test``: a few minutes of each kind; ``make year`` plays hours."""

from collections import Counter

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
)


def test_a_calm_machine_moves_right_and_answers_everything() -> None:
    result = play_seed(1, 120.0, "none")
    assert result.finding == ""
    assert result.seen["processes"] == 1
    assert "unanswered" not in result.seen
    assert result.seen["exchanges"] > 10 * 120 * 0.8
    # All moves but the first of each of the four axes, repeats of a target, and turns on the way.
    assert result.seen["certain moves"] > 0.9 * result.seen["moves"]


def test_the_same_seed_gives_the_same_bytes_events_and_files() -> None:
    first, second = (play_seed(2, 150.0, "absurd") for _ in range(2))
    assert first.digest == second.digest
    assert first.seen == second.seen


def test_no_fault_makes_an_axis_go_wrong() -> None:
    results = [play_seed(seed, 220.0, "absurd") for seed in SEEDS]
    assert [result.finding for result in results] == ["", ""]
    seen = sum((Counter(result.seen) for result in results), Counter[str]())
    assert [what for what in HAPPENS if not seen[what]] == []
