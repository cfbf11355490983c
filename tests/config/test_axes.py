"""Keys of one axis: its mode, its times, its turn."""

from pathlib import Path

import pytest

from gateway.commissioning.first_configuration import Answers, AxisAnswers, configuration_text
from gateway.drives import library
from gateway.exchange.plan import AxisPlan, Late, LineTiming
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal

WITHOUT = GOOD.replace('compensation = "on"\n', "")


def test_an_axis_with_a_table_that_leaves_it_out_is_corrected_and_both_lines_are_named(
    tmp_path: Path,
) -> None:
    found = loaded(tmp_path, WITHOUT)
    assert found.plan.lines[0].axes[0].compensation.value == "on"
    [warning] = found.warnings
    assert (warning.key, warning.line) == ("axis.x.compensation", line_of(WITHOUT, "[axis.x]"))
    assert warning.file == str(tmp_path / "gateway.toml")
    assert warning.found == 'missing: the axis is corrected with its table, as with compensation = "on"'
    assert 'write compensation = "on" below [axis.x]' in warning.remedy
    assert 'compensation = "shadow" to see the corrections first' in warning.remedy


@pytest.mark.parametrize("said", ["on", "shadow", "off"])
def test_an_axis_that_says_it_is_not_warned_of(tmp_path: Path, said: str) -> None:
    found = loaded(tmp_path, edited(('compensation = "on"', f'compensation = "{said}"')))
    assert (found.plan.lines[0].axes[0].compensation.value, found.warnings) == (said, ())


def test_an_axis_with_a_backlash_alone_is_corrected_too(tmp_path: Path) -> None:
    alone = 'backlash = { width = 0.02, kind = "homed-forward" }\nhome_approach = "forward"\n'
    found = loaded(tmp_path, WITHOUT.replace('table = "cnc10x.tab"\n', alone))
    assert ["corrected with its backlash" in warning.found for warning in found.warnings] == [True]


def test_an_axis_with_nothing_to_correct_with_is_not_warned_of(tmp_path: Path) -> None:
    assert loaded(tmp_path, WITHOUT.replace('table = "cnc10x.tab"\n', "")).warnings == ()


def test_a_first_configuration_says_shadow(tmp_path: Path) -> None:
    axis = AxisAnswers(
        name="x",
        drive="oriental-az",
        profile=library.shipped("oriental-az"),
        unit_id=1,
        units="mm",
        counts_per_unit=1000.0,
        travel=(-300.0, 0.0),
        referenced="drive-bit",
        table="cnc10x.tab",
    )
    answers = Answers(drives_at="127.0.0.1:1501", controller_at="127.0.0.1:1502", axes=(axis,))
    found = loaded(tmp_path, configuration_text(answers))
    assert found.plan.lines[0].axes[0].compensation.value == "shadow"
    assert [warning for warning in found.warnings if warning.key.endswith("compensation")] == []


# Budgets, deadlines and waiting: what reaches the plan, and what is refused or warned of.


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


# Tables of rotary axes from controls that say that they repeat.


LIST = """\
kw.ssfk.unit 1
kw.ssfk.interval 900000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 5
kw.ssfk.bilateral 0
kw.ssfk.modulo 1
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 20
kw.ssfk.table[2].pos 35
kw.ssfk.table[3].pos 20
kw.ssfk.table[4].pos 0
"""
TOLD = 'table_options = { file_units = "degree" }'


def rotary(travel: str, options: str = TOLD) -> str:
    return edited(
        ('units = "mm"', 'units = "degree"'),
        ('"cnc10x.tab"', f'"c.lis"\n{options}'),
        ("travel = [-300.0, 0.0]", travel),
    )


@pytest.mark.parametrize("travel", ["travel = [-720.0, 720.0]", ""])
def test_a_table_that_repeats_on_an_axis_that_does_not_is_warned_of(tmp_path: Path, travel: str) -> None:
    warnings = loaded(tmp_path, rotary(travel), {"c.lis": LIST}).warnings
    [warning] = [warning for warning in warnings if "repeats after" in warning.found]
    assert warning.key == "axis.x.table"
    assert "after 360 degree" in warning.found
    assert "the correction of the end holds" in warning.found
    assert warning.remedy == "add to the axis: modulo = 360"


@pytest.mark.parametrize("travel", ["travel = [0.0, 360.0]", "modulo = 360.0"])
def test_an_axis_that_stays_in_one_turn_or_repeats_is_not_warned(tmp_path: Path, travel: str) -> None:
    warnings = loaded(tmp_path, rotary(travel), {"c.lis": LIST}).warnings
    assert not [warning for warning in warnings if "repeats after" in warning.found]


def test_a_list_for_an_axis_in_degree_says_what_to_tell(tmp_path: Path) -> None:
    plain = LIST.replace("kw.ssfk.modulo 1\n", "")
    problem = refusal(tmp_path, rotary("", ""), "axis.x.table", tables={"c.lis": plain})
    assert problem.remedy == "allowed: file_units = 'degree'"
