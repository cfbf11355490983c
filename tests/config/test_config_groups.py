"""Axes that carry one beam: what must be alike, and what reaches the plan and the summary."""

from pathlib import Path

import pytest

from gateway.config.summary import summary, summary_lines
from tests.config.config_bench import GOOD, ONE_WAY, TWO_WAYS, edited, line_of, loaded, refusal, refused

SECOND = """
[axis.y]
line = "xyz"
unit_id = 2
units = "mm"
counts_per_unit = 1000
travel = [-300, 0]
table = "y.tab"
referenced = "absolute"
compensation = "on"
registers.command = [{ address = 0x0700, type = "int32" }]
registers.actual = [{ address = 0x0800, type = "int32" }]
"""
GROUP = '\n[group.gantry]\naxes = ["x", "y"]\n'
PATIENT = edited(  # one silent drive does not keep the line longer than the controller waits
    ("[line.xyz]", "[line.xyz]\nresponse_timeout_ms = 300\ndrain_ms = 300"),
    ('role = "monitor"', 'role = "monitor"\ntimeout_ms = 300'),
)
BOTH = PATIENT + SECOND + GROUP
TABLES = {"cnc10x.tab": TWO_WAYS, "y.tab": ONE_WAY.replace("AXIS X", "AXIS Y")}
ANOTHER_LINE = """
[line.b]
drives = { tcp = "192.168.0.20:502" }

[[line.b.controllers]]
name = "plc"
tcp = "127.0.0.1:1503"
"""


def test_a_group_reaches_the_plan_of_its_line_and_the_summary(tmp_path: Path) -> None:
    """The two axes know in different ways where they are: that is allowed."""
    result = loaded(tmp_path, BOTH + ANOTHER_LINE, TABLES)
    assert result.warnings == ()
    assert [line.groups for line in result.plan.lines] == [(("x", "y"),), ()]
    assert summary(result.plan, {}).lines["xyz"].groups == [["x", "y"]]
    assert "  group of x, y: corrected together" in summary_lines(result.plan, {})


def test_without_groups_there_are_none(tmp_path: Path) -> None:
    assert loaded(tmp_path).plan.lines[0].groups == ()


def test_axes_without_tables_may_form_a_group(tmp_path: Path) -> None:
    text = edited(('table = "cnc10x.tab"\n', ""), ('table = "y.tab"\n', ""), text=BOTH)
    assert loaded(tmp_path, text).plan.lines[0].groups == (("x", "y"),)


def test_an_axis_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    text = edited(('["x", "y"]', '["x", "yy"]'), text=BOTH)
    problem = refusal(tmp_path, text, "group.gantry.axes[2]", at="axes =", tables=TABLES)
    assert (problem.found, problem.remedy) == ("there is no [axis.yy]", "did you mean y?")


def test_a_group_of_a_file_without_axes_is_refused(tmp_path: Path) -> None:
    problems = refused(tmp_path, GOOD[: GOOD.index("[axis.x]")] + GROUP)
    assert [problem.key for problem in problems] == ["group.gantry.axes[1]", "group.gantry.axes[2]"]
    assert problems[0].remedy == "allowed: [axis.NAME]"


def test_an_axis_that_is_wrong_elsewhere_is_no_problem_of_its_group(tmp_path: Path) -> None:
    text = edited(("counts_per_unit = 1000\n", ""), text=BOTH)
    refusal(tmp_path, text, "axis.y.counts_per_unit", tables=TABLES)


def test_an_axis_is_in_one_group_only(tmp_path: Path) -> None:
    text = BOTH + '\n[group.other]\naxes = ["y", "x"]\n'
    problems = refused(tmp_path, text, TABLES)
    assert [problem.key for problem in problems] == ["group.other.axes[1]", "group.other.axes[2]"]
    assert problems[0].found == "y is in [group.gantry] already"
    assert problems[0].line == line_of(text, '["y", "x"]')


def test_an_axis_is_named_once(tmp_path: Path) -> None:
    text = edited(('["x", "y"]', '["x", "y", "x"]'), text=BOTH)
    problem = refusal(tmp_path, text, "group.gantry.axes[3]", tables=TABLES)
    assert (problem.found, problem.remedy) == ("x is listed twice", "name each axis once")


def test_a_group_has_two_axes(tmp_path: Path) -> None:
    problem = refusal(
        tmp_path, edited(('["x", "y"]', '["x"]'), text=BOTH), "group.gantry.axes", tables=TABLES
    )
    assert problem.remedy == "allowed: at least 2 of them"


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ('line = "xyz"\nunit_id = 2', 'line = "b"\nunit_id = 2', 'x has line = "xyz", y has line = "b"'),
        (
            'compensation = "on"\nregisters.command = [{ address = 0x0700',
            'compensation = "shadow"\nregisters.command = [{ address = 0x0700',
            'x has compensation = "on", y has compensation = "shadow"',
        ),
        ('table = "y.tab"\n', "", "x has a table, y has no table"),
    ],
)
def test_axes_of_a_group_are_alike(tmp_path: Path, old: str, new: str, found: str) -> None:
    text = edited((old, new), text=BOTH + ANOTHER_LINE)
    problem = refusal(tmp_path, text, "group.gantry.axes", at="axes =", tables=TABLES)
    assert problem.found == found
    assert problem.remedy.endswith("they are corrected together or not at all")
