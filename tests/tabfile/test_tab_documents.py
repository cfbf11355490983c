"""Where Centroid TB058 and the CNC Services Northwest page contradict themselves or each other."""

from pathlib import Path
from typing import Any

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import (
    FileContext,
    LintSeverity,
    LoadedTable,
    TableState,
    V1Layout,
    WriteOptions,
    dialect_named,
    explain,
    find_table,
    read_table,
)
from tests.tabfile.texts import Texts

TABLES = Path(__file__).parents[2] / "tables"
TB058_V2 = (TABLES / "centroid-v2-tb058" / "cnc10z.tab").read_text()
CNC_V1 = (TABLES / "centroid-v1" / "CNC7X.TAB").read_text()
CNC_V2 = (TABLES / "centroid-v2" / "cnc10z.tab").read_text()
CNC_V3 = (TABLES / "centroid-v3" / "cnc10z.tab").read_text()
TB058_AS_PRINTED = TB058_V2.replace("-1.0000", "-0.0001")
FILE = Texts("cnc10z.tab")
parse, refused = FILE.parse, FILE.refused


def codes(loaded: LoadedTable) -> set[str]:
    return {lint.code for lint in loaded.lints}


def test_c1_inch_among_the_tenths_is_read_literally_and_remarked_on() -> None:
    loaded = parse(TB058_AS_PRINTED, file_start=-2.5)
    # -0.0001 tenths are -1e-8 inch: nothing
    assert explain(loaded, -0.5).backward.correction == pytest.approx(-1e-8, abs=1e-18)
    (lint,) = (lint for lint in loaded.lints if lint.code == "L4")
    assert lint.line == 13
    # our sample carries the value of TB058's own working table, -0.0001 inch
    corrected = parse(TB058_V2, file_start=-2.5)
    assert explain(corrected, -0.5).backward.correction == -0.0001
    assert "L4" not in codes(corrected)


def test_c2_range_in_the_comment_is_not_parsed() -> None:
    assert "-5.0 to 0.0" in TB058_V2.splitlines()[0]
    assert parse(TB058_V2, travel=(-2.6, 0.0)).table.first == -2.5


def test_c3_step_of_the_header_wins() -> None:
    # the heading of the example says 1.0, the header 0.5000
    assert parse(TB058_V2, file_start=-2.5).table.even_step == 0.5


def test_c5_a_tenth_is_not_a_count() -> None:
    # DRO 1.5, measured 1.4999: 1 tenth (TB058 prints 4, the value in counts at 40000 per inch)
    correction = 1.5 - 1.4999
    table = make_table([0.0, 1.5, 3.0], [0.0, correction, 0.0], [0.0, correction, 0.0], Units.INCH)
    as_v2 = dialect_named("centroid-2").write(table, WriteOptions()).text
    as_v1 = dialect_named("centroid-1").write(table, WriteOptions(file_counts_per_unit=40000.0)).text
    assert as_v2.splitlines()[2].strip() == "1.0000"
    assert as_v1.splitlines()[1] == "4"


def test_c6_both_lists_of_version_2_begin_at_the_most_negative_position() -> None:
    rows = parse(TB058_V2, file_start=-2.5).source.rows
    assert (rows[0].position, rows[0].forward_value, rows[0].backward_value) == (-2.5, 2.0, 3.0)


def test_c7_granularity_of_5_revolutions_and_8000_counts_is_a_quarter_of_a_tenth() -> None:
    lines = ["2 2 0.5 20 1 0", "0.0", "{0}", "0.0", ";", "0.0", "{0}", "0.0"]
    below = "\n".join(lines).format(0.2499)
    at = "\n".join(lines).format(0.25)
    assert "L7" in codes(parse(below, file_start=0.0, counts_per_unit=5 * 8000.0))
    assert "L7" not in codes(parse(at, file_start=0.0, counts_per_unit=5 * 8000.0))


def test_c8_a_tenth_is_2_54_microns() -> None:
    table = parse("2 2 0.5 20 1 0\n1\n10\n1\n;\n1\n10\n1", file_start=0.0).table.in_units(Units.MM)
    assert list(table.forward) == pytest.approx([0.00254, 0.0254, 0.00254], abs=1e-15)
    metric = dialect_named("centroid-2").write(table, WriteOptions()).text.splitlines()
    assert [line.strip() for line in metric[1:4]] == ["2.5400", "25.4000", "2.5400"]


def test_c9_even_multiple_means_whole_multiple() -> None:
    # -32.5 is 65 steps of 0.5
    text = "\n".join(["2 65 0.5 20 1 0", *["0"] * 66, ";", *["0"] * 66])
    assert parse(text, travel=(-32.6, 0.0)).table.first == -32.5


def test_c10_correction_at_home_is_a_remark_never_an_error() -> None:
    loaded = parse(CNC_V2)
    assert "L5" in codes(loaded)
    assert loaded.errors == ()
    # TB058's own example begins with +2 forward and is right: its home is at the other end
    assert "L5" not in codes(parse(TB058_V2, file_start=-2.5))


def test_c11_what_the_table_does_not_cover_is_named_and_hold_is_shown() -> None:
    loaded = parse(TB058_V2, travel=(-2.6, 0.0))
    (lint,) = (lint for lint in loaded.lints if lint.code == "L8")
    assert "travel -2.6 to -2.5 inch is not covered" in lint.message
    assert explain(loaded, -2.6).forward.correction == 0.0002


def test_c12_constants_1_0_are_not_a_start() -> None:
    refused(TB058_V2, "does not state the first position")


def test_c16_names_match_in_any_case(tmp_path: Path) -> None:
    (tmp_path / "CNC10Z.TAB").write_text(CNC_V3)
    assert find_table(tmp_path, "cnc10z.tab").path.name == "CNC10Z.TAB"


def test_c17_renaming_to_bak_is_off(tmp_path: Path) -> None:
    (tmp_path / "CNC7X.BAK").write_text(CNC_V1)
    assert find_table(tmp_path, "CNC7X.TAB").state is TableState.OFF


def test_c19_version_1_loses_what_is_below_a_count() -> None:
    # DRO 3.5, measured 3.50007: -0.7 tenths, or -2.8 counts at 40000 per inch, which makes -3
    table = make_table([0.0, 3.5, 7.0], [0.0, -0.00007, 0.0], [0.0, -0.00007, 0.0], Units.INCH)
    as_v2 = dialect_named("centroid-2").write(table, WriteOptions())
    as_v1 = dialect_named("centroid-1").write(table, WriteOptions(file_counts_per_unit=40000.0))
    assert as_v2.text.splitlines()[2].strip() == "-0.7000"
    assert as_v1.text.splitlines()[1] == "-3"
    assert any("whole counts" in loss for loss in as_v1.losses)


def test_c20_both_published_version_1_layouts_are_proven_by_their_arithmetic() -> None:
    listed = parse(CNC_V1, units=Units.INCH, file_counts_per_unit=64000.0)
    implicit = parse(
        "\n".join(["66 1320000", "20", *["0"] * 65]), units=Units.INCH, file_counts_per_unit=40000.0
    )
    assert len(listed.table.positions) == 24
    assert len(implicit.table.positions) == 67


def test_c21_counts_in_the_three_headers_mean_three_things() -> None:
    # v2: N intervals; v3: ENTRIES points; v1: points or intervals, by the layout
    assert len(parse(CNC_V2).table.positions) == 9 + 1
    assert len(parse(CNC_V3).table.positions) == 9
    facts: dict[str, Any] = {"units": Units.INCH, "file_counts_per_unit": 64000.0}
    assert len(parse(CNC_V1, v1_layout=V1Layout.LISTED, **facts).table.positions) == 24
    assert len(parse(CNC_V1, v1_layout=V1Layout.IMPLICIT, **facts).table.positions) == 25


def test_c22_z_axis_that_runs_upwards_against_its_travel_needs_a_told_start() -> None:
    refused(CNC_V2, "opposite signs", travel=(-4.6, 0.0))
    assert parse(CNC_V2, travel=(-4.6, 0.0), file_start=-4.5).table.first == -4.5


def test_c23_backward_list_is_read_upwards_and_a_turned_one_is_remarked_on() -> None:
    forward, backward = ["0", "2", "5", "9", "14"], ["13", "8", "4", "1", "-1"]
    text = "\n".join(["2 4 0.5 20 1 0", *forward, "; backward data", *backward])
    loaded = parse(text, file_start=0.0)
    assert loaded.table.backward[0] == 0.0013
    assert "L3" in codes(loaded)


def test_c24_version_1_has_no_lost_motion_in_it() -> None:
    loaded = parse(CNC_V1, units=Units.INCH, file_counts_per_unit=64000.0)
    assert loaded.table.is_unidirectional
    assert loaded.table.max_reversal() == 0.0


def test_c25_header_of_version_3_may_name_later_software() -> None:
    assert parse(CNC_V3.replace("CNC10", "CNC12")).format == "centroid-3"


def test_c26_forced_zeros_at_the_far_end_are_read_as_they_stand() -> None:
    explained = explain(parse(CNC_V3), -4.0)
    assert (explained.forward.correction, explained.backward.correction) == (0.0, 0.0)


def test_c42_amount_of_correction_and_error_data_are_the_same_number() -> None:
    assert explain(parse(CNC_V2), 0.0).forward.correction == pytest.approx(0.00004272, abs=1e-18)
    assert explain(parse(TB058_V2, file_start=-2.5), -2.5).forward.correction == 0.0002


def test_header_of_version_2_may_have_the_commas_that_tb058_prints() -> None:
    body = "0\n1\n2\n3\n4\n; backward data\n0\n1\n2\n3\n4\n"
    with_commas = parse("2, 4, 0.5, 20, 1, 0 ; c\n" + body, travel=(0.0, 2.0))
    assert with_commas.table == parse("2 4 0.5 20 1 0 ; c\n" + body, travel=(0.0, 2.0)).table
    assert list(with_commas.table.positions) == [0.0, 0.5, 1.0, 1.5, 2.0]
    # a decimal comma makes no other header
    refused("2 4 0,5 20 1 0 ; c\n" + body, travel=(0.0, 2.0))


def test_c10_ends_that_the_rule_of_home_does_not_explain_are_an_info() -> None:
    """CNC Services' sample begins forward with 0.4272 and ends backward with -2.6518, where TB058 wants 0."""
    sample = read_table(TABLES / "centroid-v2" / "cnc10z.tab", FileContext())
    [info] = [lint for lint in sample.lints if lint.code == "R12"]
    assert info.severity is LintSeverity.INFO
    assert "0.4272" in info.message
    assert "-2.6518" in info.message
    assert "impossible to acquire meaningful data" in info.message
    assert info not in sample.warnings
    # its own Z table has +2 and 0: the rule of home makes it so
    assert "R12" not in codes(parse(TB058_V2, file_start=-2.5))
