"""Budgets, deadlines and waiting: what reaches the plan, and what is refused or warned of."""

from pathlib import Path

import pytest

from gateway.exchange.plan import AxisPlan, Late, LineTiming
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal

SPEED = "max_speed = 200.0"


def axis_with(folder: Path, *keys: str) -> AxisPlan:
    [line] = loaded(folder, edited((SPEED, "\n".join((SPEED, *keys))))).plan.lines
    return line.axes[0]


def timing_with(folder: Path, *keys: str) -> LineTiming:
    [line] = loaded(folder, edited(("[line.xyz]", "\n".join(("[line.xyz]", *keys))))).plan.lines
    return line.timing


def test_an_axis_that_says_nothing_has_a_budget_of_1_ms_and_no_deadline(tmp_path: Path) -> None:
    axis = axis_with(tmp_path)
    assert (axis.budget_us, axis.deadline_ms, axis.late) == (1000.0, 0.0, Late.FORWARD)


def test_the_numbers_that_an_axis_gives(tmp_path: Path) -> None:
    axis = axis_with(tmp_path, "budget_us = 250.5", "deadline_ms = 12.5", 'late = "reject"')
    assert (axis.budget_us, axis.deadline_ms, axis.late) == (250.5, 12.5, Late.REJECT)


@pytest.mark.parametrize(
    ("setpoints", "late"), [("targets", Late.FORWARD), ("stream", Late.REJECT)], ids=["targets", "stream"]
)
def test_what_happens_to_a_late_target_goes_by_the_setpoints(
    tmp_path: Path, setpoints: str, late: Late
) -> None:
    assert axis_with(tmp_path, f'setpoints = "{setpoints}"', "deadline_ms = 10").late is late
    other = {"targets": "reject", "stream": "forward"}[setpoints]
    said = axis_with(tmp_path, f'setpoints = "{setpoints}"', "deadline_ms = 10", f'late = "{other}"')
    assert said.late is Late(other)


@pytest.mark.parametrize(
    ("key", "allowed"),
    [
        ("budget_us = 0", "allowed: greater than 0, at most 3600000000"),
        ("budget_us = -1.0", "allowed: greater than 0, at most 3600000000"),
        ("budget_us = inf", "allowed: a finite number"),
        ('budget_us = "500"', "allowed: a number"),
        ("deadline_ms = 0", "allowed: greater than 0, at most 3600000"),
        ("deadline_ms = nan", "allowed: a finite number"),
        ("deadline_ms = 3600001", "allowed: greater than 0, at most 3600000"),
    ],
)
def test_times_of_an_axis_that_cannot_be(tmp_path: Path, key: str, allowed: str) -> None:
    problem = refusal(tmp_path, edited((SPEED, key)), f"axis.x.{key.split(maxsplit=1)[0]}", at=key)
    assert problem.remedy == allowed


def test_late_is_one_of_two_words(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited((SPEED, 'deadline_ms = 5\nlate = "drop"')), "axis.x.late")
    assert (problem.found, problem.remedy) == ('found "drop"', 'allowed: "forward" or "reject"')


def test_late_needs_a_deadline(tmp_path: Path) -> None:
    text = edited((SPEED, 'late = "reject"'))
    problem = refusal(tmp_path, text, "axis.x.late")
    assert (problem.line, problem.found) == (line_of(text, "late ="), 'late = "reject" without deadline_ms')
    assert "give deadline_ms" in problem.remedy


def test_a_deadline_that_is_wrong_is_one_problem(tmp_path: Path) -> None:
    refusal(tmp_path, edited((SPEED, 'late = "reject"\ndeadline_ms = -1')), "axis.x.deadline_ms")


def test_how_long_a_monitor_waits(tmp_path: Path) -> None:
    timing = timing_with(tmp_path)
    assert (timing.quiet_ms, timing.monitor_max_wait_ms) == (5.0, 200.0)
    timing = timing_with(tmp_path, "quiet_ms = 0", "monitor_max_wait_ms = 99.5")
    assert (timing.quiet_ms, timing.monitor_max_wait_ms) == (0.0, 99.5)


@pytest.mark.parametrize(
    ("key", "allowed"),
    [
        ("quiet_ms = -1", "allowed: at least 0, at most 3600000"),
        ("quiet_ms = inf", "allowed: a finite number"),
        ("monitor_max_wait_ms = 0", "allowed: greater than 0, at most 3600000"),
        ("monitor_max_wait_ms = true", "allowed: a number"),
    ],
)
def test_times_of_a_line_that_cannot_be(tmp_path: Path, key: str, allowed: str) -> None:
    text = edited(("[line.xyz]", f"[line.xyz]\n{key}"))
    assert refusal(tmp_path, text, f"line.xyz.{key.split(maxsplit=1)[0]}", at=key).remedy == allowed


@pytest.mark.parametrize(("timeout_ms", "warned"), [(199.0, True), (200.0, True), (201.0, False)])
def test_a_monitor_that_gives_up_while_it_waits_is_warned_of(
    tmp_path: Path, timeout_ms: float, warned: bool
) -> None:
    text = edited(('role = "monitor"', f'role = "monitor"\ntimeout_ms = {timeout_ms}'))
    found = [
        each for each in loaded(tmp_path, text).warnings if each.key.endswith("controllers[2].timeout_ms")
    ]
    assert len(found) == warned
    for warning in found:
        assert warning.line == line_of(text, "timeout_ms =")
        assert f"timeout_ms = {timeout_ms:g} of a monitor" in warning.found
        assert "monitor_max_wait_ms = 200" in warning.found


def test_monitors_among_themselves_wait_for_nobody(tmp_path: Path) -> None:
    text = edited(
        ("baudrate = 38400", 'baudrate = 38400\nrole = "operator"\ntimeout_ms = 100'),
        text=GOOD.split("[axis.x]", maxsplit=1)[0],
    )
    assert not [each for each in loaded(tmp_path, text).warnings if "monitor_max_wait_ms" in each.found]
