"""An axis that does not say ``compensation`` is corrected, and is warned of (decision 43)."""

from pathlib import Path

import pytest

from gateway.commissioning.first_configuration import Answers, AxisAnswers, configuration_text
from gateway.drives import library
from tests.config.config_bench import GOOD, edited, line_of, loaded

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
