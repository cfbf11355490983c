"""How it is known where an axis is: a way that its registers cannot show is refused, and others are named."""

from pathlib import Path

import pytest

from gateway.exchange.plan import Reference
from tests.config.config_bench import GOOD, edited, loaded, refusal, refused

HOME = "trigger = [{ address = 2, start = [1], home = [2], stop = [3] }]\n"
ZERO = "trigger = [{ address = 2, start = [1], set_position = [2], stop = [3] }]\n"


def referenced(way: str, *changes: tuple[str, str]) -> str:
    return edited(('referenced = "drive-bit"', f'referenced = "{way}"'), *changes)


WITHOUT_BITS = (
    ("bits.homed = { address = 0x0140, bit = 6 }\n", ""),
    ("bits.done = { address = 0x0140, bit = 1 }\n", ""),
)


@pytest.mark.parametrize(
    "text",
    [
        referenced("homing") + HOME,
        referenced("homing", WITHOUT_BITS[0]) + HOME,
        referenced("homing", WITHOUT_BITS[1]) + HOME,
        referenced("homing") + 'mode = { source = "sticky", address = 2, absolute = [1], home = [6] }\n',
        referenced("homing") + 'trigger = [{ address = 2, stop = [3], otherwise = "home" }]\n',
    ],
)
def test_homing_needs_something_that_homes_and_a_bit_that_ends_it(tmp_path: Path, text: str) -> None:
    result = loaded(tmp_path, text)
    assert result.warnings == ()
    assert result.plan.lines[0].axes[0].referenced is Reference.HOMING


def test_homing_without_a_value_that_homes_is_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, referenced("homing"), "axis.x.referenced", at="referenced")
    assert problem.found == 'referenced = "homing" and no value of registers.mode or registers.trigger homes'
    assert problem.remedy == (
        "list the value that homes the axis under home; with these registers it may be "
        '"absolute" (an absolute encoder) or "drive-bit"'
    )


def test_homing_without_a_bit_that_ends_it_is_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, referenced("homing", *WITHOUT_BITS) + HOME, "axis.x.referenced")
    assert problem.found == 'referenced = "homing" without registers.bits.homed or registers.bits.done'
    assert "homing has ended" in problem.remedy


@pytest.mark.parametrize(
    "text",
    [
        referenced("set-position") + ZERO,
        referenced(
            "set-position", ('0x0520, type = "int32",', '0x0520, type = "int32", set_position = true,')
        ),
    ],
)
def test_a_position_is_set_by_a_trigger_or_by_writing_an_actual(tmp_path: Path, text: str) -> None:
    result = loaded(tmp_path, text)
    assert result.warnings == ()
    assert result.plan.lines[0].axes[0].referenced is Reference.SET_POSITION


def test_set_position_where_nothing_sets_one_is_refused(tmp_path: Path) -> None:
    text = referenced("set-position") + HOME
    problem = refusal(tmp_path, text, "axis.x.referenced", at="referenced")
    assert problem.found == 'referenced = "set-position" and nothing in registers sets a position'
    assert problem.remedy == (
        "list the value that does under set_position of a trigger, or mark an actual with set_position; "
        'with these registers it may be "absolute" (an absolute encoder) or "drive-bit" or "homing"'
    )


def test_a_profile_is_asked_the_same(tmp_path: Path) -> None:
    """This drive has no bits, and its homing values are not known."""
    (tmp_path / "plain.toml").write_text(
        'title = "A plain drive"\n[registers]\ncommand = [{ address = 100, type = "int32" }]\n'
    )
    text = edited(
        ("max_speed = 200.0", 'drive = "./plain.toml"'),
        ('"drive-bit"', '"homing"'),
        text=GOOD[: GOOD.index("[axis.x.registers]")],
    )
    problems = refused(tmp_path, text)
    assert {problem.key for problem in problems} == {"axis.x.referenced"}
    assert len(problems) == 2
    assert all(problem.remedy.endswith('it may be "absolute" (an absolute encoder)') for problem in problems)
