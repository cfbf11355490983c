"""The table of an axis: found, read, in the right units, and in accord with the other keys."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gateway.compensation.correction_spec import spec_of_table
from gateway.config.load import load
from gateway.config.problems import ConfigErrors
from gateway.config.summary import BacklashSummary, summary, summary_lines
from gateway.tabfile import DIALECTS
from tests.config.config_bench import (
    GOOD,
    ONE_WAY,
    TWO_WAYS,
    edited,
    line_of,
    loaded,
    only,
    refusal,
    refused,
    warning_of,
    written,
)

STREAM = edited(("max_speed = 200.0", 'setpoints = "stream"\nmax_speed = 200.0'))
TURN = """\
CNC10 TAB FILE VERSION 3
AXIS X
UNITS MILLIMETER
INTERVAL 100.0
ENTRIES 4
  0.0  0.000 0.010
100.0 -0.005 0.005
200.0 -0.010 0.000
300.0  0.000 0.010
"""


def test_a_table_is_found_in_any_case_of_letters(tmp_path: Path) -> None:
    axis = loaded(tmp_path, tables={"CNC10X.TAB": TWO_WAYS}).plan.lines[0].axes[0]
    assert (axis.table_name, axis.table_format) == ("CNC10X.TAB", "centroid-3")


def test_a_missing_table_gets_a_suggestion(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited(("cnc10x.tab", "cnc10v.tab")), "axis.x.table", at="cnc10v.tab")
    assert problem.found == f"there is no cnc10v.tab in {tmp_path / 'tables'}"
    assert problem.remedy == "did you mean cnc10x.tab?"


def test_a_missing_table_that_is_like_none_gets_the_tables_of_every_format(tmp_path: Path) -> None:
    names = {dialect.suffix for dialect in DIALECTS} | {".txt"}
    tables = {f"{number}{suffix.upper()}": TWO_WAYS for number, suffix in enumerate(sorted(names))}
    problem = refusal(tmp_path, edited(("cnc10x.tab", "xyz")), "axis.x.table", tables=tables)
    held = [name for name in sorted(tables) if not name.endswith(".TXT")]
    assert problem.remedy == f"it holds {', '.join(held[:10])}"


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited(('name = "mill-1"', 'tables = "tabs"')), "axis.x.table")
    assert str(tmp_path / "tabs") in problem.found
    assert "[gateway] tables" in problem.remedy


@pytest.mark.parametrize("name", ["../cnc10x.tab", "/etc/passwd", "", "a/b.tab", "..", "."])
def test_a_table_is_a_name_without_a_path(tmp_path: Path, name: str) -> None:
    problem = refusal(tmp_path, edited(("cnc10x.tab", name)), "axis.x.table")
    assert "without a path" in problem.remedy or "there is no" in problem.found


def test_names_that_differ_by_case_only_are_refused(tmp_path: Path) -> None:
    tables = {"cnc10x.tab": TWO_WAYS, "CNC10x.tab": TWO_WAYS}
    problem = refusal(tmp_path, GOOD, "axis.x.table", tables=tables)
    assert "CNC10x.tab, cnc10x.tab, which differ only in upper and lower case" in problem.found
    assert problem.remedy == "allowed: one of them; remove or rename the others"


def test_a_table_renamed_to_bak_is_off_and_that_is_said(tmp_path: Path) -> None:
    found = loaded(tmp_path, tables={"cnc10x.bak": TWO_WAYS})
    [warning] = [w for w in found.warnings if w.key == "axis.x.table"]
    assert warning.found == "cnc10x.tab was renamed to cnc10x.bak: the axis is not corrected"
    assert warning.remedy == "rename it back to correct it again"
    (axis,) = found.plan.lines[0].axes
    assert (axis.table, axis.table_name) == (None, "cnc10x.tab")


def test_a_fault_inside_a_table_names_the_table_its_line_and_the_key(tmp_path: Path) -> None:
    table = TWO_WAYS.replace("-0.0030", "-0.0O30")
    [problem] = refused(tmp_path, GOOD, {"cnc10x.tab": table})
    assert problem.file == str(tmp_path / "tables" / "cnc10x.tab")
    assert (problem.key, problem.line) == ("axis.x.table", line_of(table, "-0.0O30"))
    assert "-0.0O30" in problem.found


def test_a_folder_in_the_place_of_a_table_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, tables={})
    (tmp_path / "tables" / "cnc10x.tab").mkdir()
    with pytest.raises(ConfigErrors, match=r"axis\.x\.table: a folder"):
        load(path)


@contextmanager
def unprivileged() -> Iterator[Path]:
    """A folder that anybody may enter; whoever is root stops being it where permissions are tried."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        yield folder


@contextmanager
def as_nobody() -> Iterator[None]:
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


def test_a_table_that_may_not_be_read_is_named() -> None:
    with unprivileged() as folder:
        path = written(folder)
        (folder / "tables" / "cnc10x.tab").chmod(0)
        with as_nobody(), pytest.raises(ConfigErrors) as caught:
            load(path)
    problem = only(caught.value.problems, "axis.x.table")
    assert problem.found == "may not be read; give this user read permission to the file and its folders"


def test_a_configuration_that_may_not_be_read_is_named() -> None:
    with unprivileged() as folder:
        path = written(folder)
        path.chmod(0)
        with (
            as_nobody(),
            pytest.raises(ConfigErrors, match=r"gateway\.toml: may not be read; give this user"),
        ):
            load(path)


def test_an_inch_table_on_a_mm_axis_is_converted_exactly(tmp_path: Path) -> None:
    text = edited(("travel = [-300.0, 0.0]", "travel = [-304.8, 0.0]"))
    inch = (
        "CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS INCH\nINTERVAL 6.0\nENTRIES 3\n"
        "0 0 0.0005\n-6 -0.0005 0\n-12 -0.001 -0.0005\n"
    )
    table = loaded(tmp_path, text, {"cnc10x.tab": inch}).plan.lines[0].axes[0].table
    assert table is not None
    # 12 in × 25.4 = 304.8 mm; away from home (backward): 0.001 in × 25.4 = 0.0254 mm
    assert list(table.positions) == pytest.approx([-304.8, -152.4, 0.0], abs=1e-12)
    assert list(table.backward) == pytest.approx([-0.0254, -0.0127, 0.0], abs=1e-15)
    assert list(table.forward) == pytest.approx([-0.0127, 0.0, 0.0127], abs=1e-15)


def test_a_table_of_lengths_on_an_axis_of_degrees_is_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited(('units = "mm"', 'units = "degree"')), "axis.x.table")
    assert "a table in mm for an axis in degree" in problem.found


def test_a_correction_above_the_limit_is_refused_with_its_place(tmp_path: Path) -> None:
    table = TWO_WAYS.replace("-0.0200", "-0.6")
    problems = refused(tmp_path, GOOD, {"cnc10x.tab": table})
    assert {problem.key for problem in problems} == {"axis.x.table"}
    [size] = [problem for problem in problems if "max_correction" in problem.found]
    assert size.line == line_of(table, "-0.6")


def test_a_slope_above_the_limit_is_refused_with_its_segment(tmp_path: Path) -> None:
    # Forward, from -150 to 0: (0.0100 + 0.0030) / 150 = 8.67e-5.
    problem = refusal(tmp_path, edited(("max_speed = 200.0", "max_slope = 5e-5")), "axis.x.table")
    assert "between -150 and 0 mm" in problem.found
    assert "max_slope 5e-05" in problem.found
    assert problem.file.endswith("cnc10x.tab")


def test_a_table_beside_the_travel_is_refused(tmp_path: Path) -> None:
    text = edited(("travel = [-300.0, 0.0]", "travel = [400.0, 700.0]"))
    assert "outside travel 400 to 700 mm" in refusal(tmp_path, text, "axis.x.table").found


def test_travel_that_the_table_does_not_cover_is_warned_of_with_its_policy(tmp_path: Path) -> None:
    text = edited(("travel = [-300.0, 0.0]", "travel = [-320.5, 1.0]"))
    warning = warning_of(tmp_path, text, "axis.x.table", at="cnc10x.tab")
    assert warning.found == "L8 the table does not cover travel from -320.5 to -300 and from 0 to 1 mm"
    assert warning.remedy == 'outside = "hold": the correction of the end holds there'


def test_backlash_counts_towards_the_largest_correction(tmp_path: Path) -> None:
    # 0.02 mm of the table and half of 1 mm: 0.52 mm is more than the default of 0.5 mm.
    text = edited(("max_speed = 200.0", 'backlash = { width = 1.0, kind = "two-sided" }'))
    problem = refusal(tmp_path, text, "axis.x.backlash.width", tables={"cnc10x.tab": ONE_WAY})
    assert "0.52 mm, more than max_correction = 0.5" in problem.found


def test_zero_outside_needs_ends_within_a_count_of_zero(tmp_path: Path) -> None:
    text = edited(("max_speed = 200.0", 'outside = "zero"'))
    problem = refusal(tmp_path, text, "axis.x.outside", at="outside")
    assert "correction of 0.02 mm" in problem.found
    assert "one count (0.001 mm)" in problem.remedy
    # 0.02 mm at max_slope 0.01
    assert "{ fade = 2 } or longer" in problem.remedy
    flat = TWO_WAYS.replace("+0.0100", "+0.0010").replace("-0.0200", "-0.0010").replace("-0.0120", "+0.0000")
    assert loaded(tmp_path, text, {"cnc10x.tab": flat}).warnings == ()


def test_where_a_count_is_a_millimetre_zero_outside_needs_ends_within_a_step_of_the_registers(
    tmp_path: Path,
) -> None:
    in_mm = (
        ("counts_per_unit = 1000.0", "counts_per_unit = 1.0"),
        ('address = 0x0606, type = "int32"', 'address = 0x0606, type = "int32", scale = 0.01'),
        ('address = 0x0520, type = "int32"', 'address = 0x0520, type = "float32"'),
    )
    text = edited(("max_speed = 200.0", 'outside = "zero"'), *in_mm)
    # A hundredth of a count is coarser than a float32 in the travel; half a count at the end would be a step.
    problem = refusal(tmp_path, text, "axis.x.outside")
    assert "correction of 0.02 mm" in problem.found
    assert "one step of the registers (0.01 mm)" in problem.remedy
    flat = TWO_WAYS.replace("+0.0100", "+0.0010").replace("-0.0200", "-0.0100").replace("-0.0120", "+0.0000")
    result = loaded(tmp_path, text, {"cnc10x.tab": flat})
    assert result.warnings == ()  # L7 neither: it is of less than a step, not of less than a millimetre
    [axis] = [axis for line in result.plan.lines for axis in line.axes]
    low, high = axis.settings.travel or (0.0, 0.0)
    assert axis.settings.corrected_bounds == pytest.approx((low - 0.505, high + 0.505), abs=1e-12)


def test_a_fade_steeper_than_the_slope_allowed_is_refused(tmp_path: Path) -> None:
    # 0.02 mm at the end, max_slope 0.01: at least 2 mm.
    problem = refusal(tmp_path, edited(("max_speed = 200.0", "outside = { fade = 1.9 }")), "axis.x.outside")
    assert "2 mm or more" in problem.remedy
    assert loaded(tmp_path, edited(("max_speed = 200.0", "outside = { fade = 2.0 }"))).warnings == ()


def test_hysteresis_is_shorter_than_the_table(tmp_path: Path) -> None:
    text = edited(
        ("max_speed = 200.0", "hysteresis = 300.0"), ("travel = [-300.0, 0.0]", "travel = [-301.0, 0.0]")
    )
    assert "longer than the whole table (300 mm)" in refusal(tmp_path, text, "axis.x.hysteresis").found


@pytest.mark.parametrize(
    ("setpoints", "said"),
    [("stream", "a shorter reversal"), ("targets", "measured positions within this distance")],
)
def test_hysteresis_longer_than_an_interval_is_warned_of(tmp_path: Path, setpoints: str, said: str) -> None:
    changed = f'hysteresis = 151.0\nsetpoints = "{setpoints}"'
    warnings = loaded(tmp_path, edited(("max_speed = 200.0", changed))).warnings
    [warning] = [warning for warning in warnings if warning.key == "axis.x.hysteresis"]
    assert warning.remedy.startswith(said)


def turning(modulo: float) -> str:
    return edited(("travel = [-300.0, 0.0]", f"modulo = {modulo}"))


def test_a_turn_needs_a_table_of_exactly_one_turn_with_equal_ends(tmp_path: Path) -> None:
    assert (
        loaded(tmp_path, turning(300.0), {"cnc10x.tab": TURN}).plan.lines[0].axes[0].settings.modulo == 300.0
    )
    text = turning(360.0)
    problem = refusal(tmp_path, text, "axis.x.modulo", at="modulo", tables={"cnc10x.tab": TURN})
    assert "covers 300" in problem.found
    open_turn = TURN.replace("300.0  0.000 0.010", "300.0  0.000 0.011")
    problem = refusal(tmp_path, turning(300.0), "axis.x.modulo", tables={"cnc10x.tab": open_turn})
    assert "both ends of a turn must carry the same correction" in problem.found


def test_two_directions_without_a_measured_position_are_warned_of(tmp_path: Path) -> None:
    blind = edited(
        ('actual = [{ address = 0x0520, type = "int32", words = "low-first" }]\n', ""),
        ("bits.done", "bits.alarm"),
    )
    warning = warning_of(tmp_path, blind, "axis.x.registers", at="[axis.x.registers]")
    assert "unsure" in warning.found
    assert loaded(tmp_path, blind, {"cnc10x.tab": ONE_WAY}).warnings == ()


def test_a_blend_that_would_turn_the_axis_round_is_warned_of(tmp_path: Path) -> None:
    swapped = TWO_WAYS.replace("+0.0000  +0.0100", "+0.0200  +0.0000")
    text = edited(("max_speed = 200.0", "max_speed = 200.0\nreversal = { distance = 0.05 }"), text=STREAM)
    warnings = [
        w for w in loaded(tmp_path, text, {"cnc10x.tab": swapped}).warnings if w.key == "axis.x.reversal"
    ]
    # Backward lies 0.02 mm above forward at home: 4 × 0.02 = 0.08 mm.
    assert [warning.remedy for warning in warnings] == ["the gateway uses a blend of 0.08 mm"]


FAGOR = "P001 X-300 EX 0.012\nP002 X-150 EX 0.002\nP003 X0 EX 0\n"


@pytest.mark.parametrize("key", ["fagor_sense", "error_sense"])
def test_what_a_table_of_another_control_cannot_prove_is_told(tmp_path: Path, key: str) -> None:
    told = edited(("cnc10x.tab", "ML1")) + f'[axis.x.table_options]\nfile_units = "mm"\n{key} = '
    actual = loaded(tmp_path, told + '"actual_minus_command"\n', {"ML1": FAGOR}).plan.lines[0].axes[0]
    assert actual.table_format == "fagor-8055"
    assert actual.table is not None
    assert list(actual.table.forward) == [-0.012, -0.002, 0.0]
    other = loaded(tmp_path, told + '"command_minus_actual"\n', {"ML1": FAGOR}).plan.lines[0].axes[0]
    assert other.table is not None
    assert list(other.table.forward) == [0.012, 0.002, 0.0]


def test_check_warns_of_the_old_name_of_an_option(tmp_path: Path) -> None:
    told = edited(("cnc10x.tab", "ML1")) + '[axis.x.table_options]\nfile_units = "mm"\n'
    sense = ' = "actual_minus_command"\n'
    now = loaded(tmp_path, f"{told}error_sense{sense}", {"ML1": FAGOR}).warnings
    old = loaded(tmp_path, f"{told}fagor_sense{sense}", {"ML1": FAGOR}).warnings
    [warning] = [each for each in old if each not in now]
    assert warning.key == "axis.x.table"
    assert warning.found.startswith("R14 write error_sense =")


def test_a_sense_that_nobody_told_is_asked_for_with_both_readings(tmp_path: Path) -> None:
    text = edited(("cnc10x.tab", "ML1")) + '[axis.x.table_options]\nfile_units = "mm"\n'
    problem = refusal(tmp_path, text, "axis.x.table", tables={"ML1": FAGOR})
    assert "reading 1: actual_minus_command" in problem.found
    assert "reading 2: command_minus_actual" in problem.found
    assert "error_sense = 'actual_minus_command'" in problem.remedy


MINT = """DIM fwd(2) = 149.99, 299.98
PRECISIONTABLE(0, fwd)
PRECISIONINCREMENT.0 = 150
PRECISIONOFFSET.0 = -300
BACKLASH.0 = -0.02
"""


def test_lost_motion_that_a_file_states_is_warned_of_unless_the_axis_has_a_backlash(tmp_path: Path) -> None:
    told = (
        edited(("cnc10x.tab", "x.mnt")) + '[axis.x.table_options]\nfile_units = "mm"\nfile_start = -300.0\n'
    )
    warnings = [w for w in loaded(tmp_path, told, {"x.mnt": MINT}).warnings if "R8" in w.found]
    assert [warning.line for warning in warnings] == [5]
    setting = 'backlash = { width = 0.02, kind = "homed-forward" }'
    assert warnings[0].remedy == f"if nothing else corrects it now, add to the axis: {setting}"
    settled = edited(("max_speed = 200.0", setting), text=told)
    assert not [w for w in loaded(tmp_path, settled, {"x.mnt": MINT}).warnings if "R8" in w.found]


def test_why_a_table_is_refused_has_the_code_that_explain_knows(tmp_path: Path) -> None:
    told = edited(("cnc10x.tab", "x.mnt")) + '[axis.x.table_options]\nfile_units = "mm"\n'
    problem = refusal(tmp_path, told, "axis.x.table", tables={"x.mnt": MINT})
    assert problem.found.startswith("R9 PRECISIONOFFSET -300, and Mint's guide gives it two meanings")


ALONE = ('table = "cnc10x.tab"', 'backlash = { width = 0.2, kind = "homed-forward" }')


def test_backlash_needs_no_table(tmp_path: Path) -> None:
    plan = loaded(tmp_path, edited(ALONE)).plan.lines[0].axes[0]
    assert plan.table is not None
    assert (plan.table_name, plan.table.first, plan.table.last) == ("", -300.0, 0.0)
    spec = spec_of_table(plan.table, plan.settings)
    # homed forward: nothing forward, 0.2 less backward, wherever the axis is
    for at in (-300.0, -90.0, 0.0):
        assert spec.map_at(1.0).correction(at) == 0.0
        assert spec.map_at(0.0).correction(at) == -0.2


def test_backlash_without_a_table_holds_where_no_travel_is_known(tmp_path: Path) -> None:
    found = loaded(tmp_path, edited(ALONE, ("travel = [-300.0, 0.0]\n", "")))
    plan = found.plan.lines[0].axes[0]
    assert plan.table is not None
    spec = spec_of_table(plan.table, plan.settings)
    assert spec.map_at(0.0).correction(1e6) == -0.2
    assert spec.map_at(0.0).nominal(89.8) == pytest.approx(90.0, abs=1e-12)


def test_backlash_without_a_table_covers_a_turn(tmp_path: Path) -> None:
    text = edited(
        ALONE, ('units = "mm"', 'units = "degree"\nmodulo = 360.0'), ("travel = [-300.0, 0.0]\n", "")
    )
    plan = loaded(tmp_path, text).plan.lines[0].axes[0]
    assert plan.table is not None
    assert spec_of_table(plan.table, plan.settings).map_at(0.0).correction(725.0) == -0.2


def test_backlash_without_a_table_has_no_outside(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited((ALONE[0], f'{ALONE[1]}\noutside = "zero"')), "axis.x.outside")
    assert problem.found == "outside = zero with a backlash and no table"


def test_a_group_may_have_a_backlash_without_tables(tmp_path: Path) -> None:
    second = GOOD[GOOD.index("[axis.x]") :].replace("axis.x", "axis.y").replace("unit_id = 1", "unit_id = 2")
    pair = f'{GOOD}\n{second}\n[group.beam]\naxes = ["x", "y"]\n'
    both = loaded(tmp_path, pair.replace(*ALONE)).plan.lines[0].axes
    assert [axis.table is None for axis in both] == [False, False]
    one = edited(ALONE) + f'\n{second.replace(ALONE[0], "")}\n[group.beam]\naxes = ["x", "y"]\n'
    assert "x has a backlash and no table, y has no table" in refusal(tmp_path, one, "group.beam.axes").found


def test_the_summary_says_that_there_is_only_a_backlash(tmp_path: Path) -> None:
    found = loaded(tmp_path, edited(ALONE))
    lines = summary_lines(found.plan, found.drives)
    assert "  no table: backlash of 0.2 mm, homed-forward" in lines
    axis = summary(found.plan, found.drives).axes["x"]
    assert (axis.table, axis.backlash) == (None, BacklashSummary(0.2, "homed-forward"))
