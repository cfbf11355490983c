"""ISG and TwinCAT CNC lists: the published examples by hand, strict grammar, units, sense, writing."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, HomeSide, WriteOptions, dialect_named, explain, parse_table
from tests.tabfile.drawn import assert_same, there_and_back, uneven
from tests.tabfile.texts import Texts

SAMPLE = (Path(__file__).parents[2] / "tables" / "isg" / "achskw2.lis").read_text()
EVEN = """kw.ssfk.unit 0
kw.ssfk.interval 20000
kw.ssfk.kw_startpos -909000
kw.ssfk.kw_nr_max 100
kw.ssfk.bilateral 1
""" + "".join(
    f"kw.ssfk.table[{i}].pos {i - 40}  # {-909000 + 20000 * i}\nkw.ssfk.table[{i}].neg {i - 30}\n"
    for i in range(100)
)
"""The settings of a list that is in use; its values are not public, these are a straight line."""
ONE_WAY = """kw.ssfk.unit 1
kw.ssfk.interval 100000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 3
kw.ssfk.bilateral 0
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 50.5
kw.ssfk.table[2].pos -30
"""
REVOLUTION = ONE_WAY.replace("100000", "1800000").replace("[2].pos -30", "[2].pos 0") + "kw.ssfk.modulo 1\n"
FILE = Texts("achskw1.lis")
parse, refused = FILE.parse, FILE.refused


def test_the_published_example_by_hand() -> None:
    loaded = parse(SAMPLE)
    assert loaded.format == "isg"
    assert loaded.table.units is Units.MM
    assert list(loaded.table.positions) == pytest.approx([-20.0, -19.9306, -19.8667, 33.5591], abs=1e-12)
    third = explain(loaded, -19.8667)
    # 10.2 µm less than commanded in the positive direction: 10.2 µm are added; 8 µm more: taken off
    assert third.forward.correction == pytest.approx(0.0102, abs=1e-15)
    assert third.backward.correction == pytest.approx(-0.0080, abs=1e-15)
    assert (third.forward.file_value, third.forward.low.forward_line) == (-102, 18)
    # half way from point 0 to 1: 12 and 33.5 tenths of a micron, subtracted
    half = explain(loaded, -19.9653)
    assert half.forward.correction == pytest.approx(-0.0012, abs=1e-12)
    assert half.backward.correction == pytest.approx(-0.00335, abs=1e-12)


def test_the_published_example_says_how_it_was_read() -> None:
    source = parse(SAMPLE).source
    assert source.value_unit == "0.1 µm"
    assert source.comment_axis == "Y"
    assert source.forward_rule == "error = actual - commanded: subtracted; pos"
    assert source.behaves_as == ('outside = "hold"',)
    assert "error_sense changes it" in source.decisions[0]
    assert source.decisions[3] == "not part of the table, by section and number of lines: kopf (2)"


def test_increments_with_an_interval_by_hand() -> None:
    loaded = parse(EVEN, units=Units.MM, file_counts_per_unit=1000.0)
    assert (loaded.table.first, loaded.table.last) == (-909.0, 1071.0)
    assert loaded.table.even_step == 20.0
    # point 1: pos -39 and neg -29 increments of 1 µm
    explained = explain(loaded, -889.0)
    assert explained.forward.correction == pytest.approx(0.039, abs=1e-15)
    assert explained.backward.correction == pytest.approx(0.029, abs=1e-15)
    assert explained.forward.file_value == -39


def test_scale_of_increments_is_per_unit_of_the_axis() -> None:
    loaded = parse(EVEN, units=Units.INCH, file_counts_per_unit=25400.0)
    assert loaded.table.units is Units.INCH
    assert loaded.table.first == pytest.approx(-909 / 25.4, abs=1e-12)
    told = parse(EVEN, units=Units.INCH, file_units=Units.MM, file_counts_per_unit=25400.0)
    assert told.table.units is Units.MM
    assert told.table.first == pytest.approx(-909.0, abs=1e-9)


def test_increments_need_a_scale_and_units() -> None:
    refused(EVEN, "file_counts_per_unit is missing", units=Units.MM)
    refused(EVEN, "file_counts_per_unit = -1000", units=Units.MM, file_counts_per_unit=-1000.0)
    refused(EVEN, "axis of unknown units", file_counts_per_unit=1000.0)


def test_one_value_holds_in_both_directions() -> None:
    loaded = parse(ONE_WAY)
    assert loaded.table.is_unidirectional
    # half way from 0 to 10 mm: 25.25 tenths of a micron
    assert explain(loaded, 5.0).backward.correction == pytest.approx(-0.002525, abs=1e-15)
    assert "one value for both directions" in loaded.source.backward_rule


@pytest.mark.parametrize("key", ["isg_sense", "error_sense"])
def test_sense_can_be_turned_round(key: str) -> None:
    loaded = parse(ONE_WAY, **{key: ErrorSense.COMMAND_MINUS_ACTUAL})
    assert explain(loaded, 10.0).forward.correction == pytest.approx(0.00505, abs=1e-15)
    assert loaded.source.decisions[0] == "sense command_minus_actual: as given"
    same = parse(ONE_WAY, **{key: ErrorSense.ACTUAL_MINUS_COMMAND})
    assert list(same.table.forward) == list(parse(ONE_WAY).table.forward)


def test_the_old_name_of_another_format_turns_no_sign() -> None:
    told = parse(ONE_WAY, fagor_sense=ErrorSense.COMMAND_MINUS_ACTUAL)
    assert list(told.table.forward) == list(parse(ONE_WAY).table.forward)
    assert [lint.code for lint in told.source.remarks if lint.code in {"R3", "R14"}] == ["R3"]


def test_both_keys_of_the_sense_must_agree() -> None:
    refused(
        ONE_WAY,
        "isg_sense actual_minus_command and error_sense command_minus",
        isg_sense=ErrorSense.ACTUAL_MINUS_COMMAND,
        error_sense=ErrorSense.COMMAND_MINUS_ACTUAL,
    )


def test_modulo_list_needs_its_units() -> None:
    refused(REVOLUTION, r"0\.0001 degree on a rotary axis")
    loaded = parse(REVOLUTION, file_units=Units.DEGREE)
    assert loaded.table.units is Units.DEGREE
    assert (loaded.table.first, loaded.table.last) == (0.0, 360.0)
    assert loaded.source.behaves_as == ("modulo = 360",)
    assert loaded.source.value_unit == "0.0001 degree"
    assert parse(REVOLUTION, file_units=Units.MM).table.units is Units.MM


def test_modulo_list_must_close() -> None:
    refused(
        REVOLUTION.replace("[2].pos 0", "[2].pos 1"),
        "different first and last pos values",
        line=8,
        file_units=Units.DEGREE,
    )
    two = REVOLUTION.replace("bilateral 0", "bilateral 1") + "".join(
        f"kw.ssfk.table[{i}].neg {value}\n" for i, value in enumerate([3, 5, 4])
    )
    refused(two, "different first and last neg values", line=12, file_units=Units.DEGREE)
    closed = parse(two.replace("neg 4", "neg 3"), file_units=Units.DEGREE)
    assert closed.table.backward[0] == closed.table.backward[2] == pytest.approx(-0.0003, abs=1e-15)


def test_rotary_list_and_wrong_units() -> None:
    assert parse(ONE_WAY, units=Units.DEGREE, file_units=Units.DEGREE).table.units is Units.DEGREE
    refused(ONE_WAY, "a list in unit 1 for an axis in degree", units=Units.DEGREE)
    refused(ONE_WAY, "but file_units = inch", file_units=Units.INCH)


@pytest.mark.parametrize(
    ("cycles", "line"),
    [("0", 'reversal = "step"'), ("1", 'reversal = "step"'), ("5", "reversal = { cycles = 5 }")],
)
def test_cycles_of_a_reversal(cycles: str, line: str) -> None:
    text = SAMPLE + f"lr_param.n_backlash_cyc {cycles}\n"
    assert parse(text).source.behaves_as == ('outside = "hold"', line)


def test_cycles_mean_nothing_to_a_table_of_one_direction() -> None:
    assert parse(ONE_WAY + "lr_param.n_backlash_cyc 5\n").source.behaves_as == ('outside = "hold"',)


@pytest.mark.parametrize("cycles", ["20", "-1", "2.5", "many"])
def test_cycles_out_of_range_are_refused(cycles: str) -> None:
    refused(ONE_WAY + f"lr_param.n_backlash_cyc {cycles}\n", "n_backlash_cyc", line=9)


def test_other_parameters_of_an_axis_list_are_named() -> None:
    text = "kopf.achs_nr 1\ngetriebe[0].weg_z 10\ngetriebe[0].weg_n 1 # gear\nlr_param.ssfk 1\n" + ONE_WAY
    source = parse(text).source
    assert source.decisions[-1] == (
        "not part of the table, by section and number of lines: kopf (1), getriebe (2), lr_param (1)"
    )


def test_other_compensations_in_the_list_are_a_remark() -> None:
    loaded = parse(ONE_WAY + "kw.crosscomp.interval 5\nkw.ssfj.modulo 1\n")
    remarks = [(lint.code, lint.line) for lint in loaded.source.remarks]
    assert remarks == [("R4", 9), ("R4", 10)]


def test_list_of_a_cross_compensation_is_refused_by_name() -> None:
    error = refused(
        "kopf.achs_nr 1\nkw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 1\n",
        r"a list of kw\.crosscomp, which",
    )
    assert (error.line, "'cross' key" in error.allowed) == (2, True)


def test_comments_and_reserved_keys_anywhere_between_entries() -> None:
    text = "/* a\n b # c\n */ kw.ssfk.unit /* d */ 1 # e\nkw.ssfk.res1 0\n" + ONE_WAY.partition("\n")[2]
    assert list(parse(text).table.forward) == list(parse(ONE_WAY).table.forward)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_byte_order_mark_blanks_and_case(end: str) -> None:
    text = "\ufeff\n" + SAMPLE.upper().replace("\n", f"  \t{end}") + end
    assert list(parse(text).table.backward) == list(parse(SAMPLE).table.backward)


def test_setpoints_beside_an_interval_must_agree() -> None:
    parse(ONE_WAY + "kw.ssfk.table[1].setpoint 100000\n")
    refused(ONE_WAY + "kw.ssfk.table[1].setpoint 100001\n", r"setpoint 100001", line=9)


def test_number_of_points_has_a_limit() -> None:
    many = ONE_WAY.replace("nr_max 3", "nr_max 1501") + "".join(
        f"kw.ssfk.table[{i}].pos 0\n" for i in range(3, 1501)
    )
    refused(many, "kw_nr_max 1501")
    assert len(parse(many + "kw.ssfk.max_points 1501").table.positions) == 1501


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ("kw.ssfk.unit 1\n", "", 7, "no kw.ssfk.unit"),
        ("kw.ssfk.interval 100000\n", "", 7, "no kw.ssfk.interval"),
        ("kw.ssfk.kw_startpos 0\n", "", 7, "no kw.ssfk.kw_startpos"),
        ("kw.ssfk.kw_nr_max 3\n", "", 7, "no kw.ssfk.kw_nr_max"),
        ("kw.ssfk.bilateral 0\n", "", 7, "no kw.ssfk.bilateral"),
        ("unit 1", "unit 2", 1, "unit '2'"),
        ("interval 100000", "interval -1", 2, "interval -1"),
        ("interval 100000", "interval 100,5", 2, "'100,5'"),
        ("nr_max 3", "nr_max 2", 8, "table[2].pos"),
        ("nr_max 3", "nr_max 4", 4, "1 of 4 points: i = 3"),
        ("nr_max 3", "nr_max 3.0", 4, "'3.0'"),
        ("bilateral 0", "bilateral 1", 4, "no table[i].neg for 3 of 3"),
        ("[1].pos 50.5", "[1].pos", 7, "without a value"),
        ("[1].pos 50.5", "[1].pos 5#", 7, "'5#'"),
        ("[1].pos 50.5", "[1].pos 50 5", 7, "'50 5'"),
        ("[1].pos 50.5", "[01].pos 50.5", 7, "unknown key"),
        ("[1].pos 50.5", "[0].pos 50.5", 7, "again, after line 6"),
        ("[1].pos 50.5", "[1].poss 50.5", 7, "unknown key"),
        ("kw.ssfk.table[1]", "kw.ssfk,table[1]", 7, "kw.ssfk,table[1]"),
        ("kw.ssfk.table[1]", "/* kw.ssfk.table[1]", 7, "does not end"),
        ("[2].pos", "[2].neg", 4, "no table[i].pos"),
        ("bilateral 0\n", "bilateral 0\nkw.ssfk.res1 2\n", 6, "unknown key"),
        ("bilateral 0\n", "bilateral 0\nkw.ssfk.res1 0\nkw.ssfk.res1 0\n", 7, "again, after line 6"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, found: str) -> None:
    assert found in refused(ONE_WAY.replace(old, new, 1), line=line).found


def test_absurd_number_of_points_is_refused_at_once() -> None:
    text = ONE_WAY.replace("nr_max 3", "nr_max 999999999999999") + "kw.ssfk.max_points 999999999999999\n"
    refused(text, "999999999999996 of 999999999999999 points: i = 3, 4, 5, 6, 7, …")


def test_neg_values_need_a_list_of_two_directions() -> None:
    refused(ONE_WAY + "kw.ssfk.table[1].neg 3\n", r"table\[1\]\.neg with bilateral 0", line=9)


def test_setpoints_must_ascend() -> None:
    error = refused(SAMPLE.replace("-198667", "-199307"), "setpoint -199307 after -199306")
    assert (error.line, error.problems[0].code) == (14, "L11")


def test_comment_that_lost_its_end_swallows_nothing() -> None:
    text = ONE_WAY.replace("[0].pos 0\n", "[0].pos 0 /* home\n").replace("50.5\n", "50.5 /* middle */\n")
    error = refused(text, "inside a comment", line=7)
    assert "line 6" in error.allowed


def test_range_start_and_home() -> None:
    refused(ONE_WAY, "outside travel", travel=(-30.0, -1.0))
    refused(ONE_WAY, "lowest position of 0", file_start=5.0)
    told = parse(ONE_WAY, file_home=HomeSide.MINUS, file_counts_per_unit=5.0, file_axis="x")
    assert [lint.code for lint in told.source.remarks] == ["R3", "R3", "R3"]


WIDE: dict[str, Any] = {"steps": (10_000_000, 90_000_000), "largest": 20_000}
"""Numbers in hundredths of a unit of the format."""


@given(uneven({Units.MM: 1e-6, Units.DEGREE: 1e-6}, **WIDE), st.sampled_from([None, *ErrorSense]))
def test_what_is_written_is_read_back(table: CorrectionTable, sense: ErrorSense | None) -> None:
    _, again = there_and_back("isg", table, axis="y", sense=sense)
    assert_same(again.table, table, places=1e-9)
    assert again.source.comment_axis == "Y"


@given(uneven({Units.INCH: 1e-2 / 64_000}, **WIDE))
def test_increments_are_written_where_the_scale_is_told(table: CorrectionTable) -> None:
    _, again = there_and_back("isg", table, file_counts_per_unit=64_000.0)
    assert_same(again.table, table, places=1e-9)


def test_even_points_become_an_interval() -> None:
    table = make_table([-10, 0, 10], [0.00015, 0, -0.001], [0, 0, 0], Units.MM)
    text = dialect_named("isg").write(table, WriteOptions()).text
    assert [tuple(line.split()) for line in text.splitlines()] == [
        ("kw.ssfk.unit", "1"),
        ("kw.ssfk.interval", "100000"),
        ("kw.ssfk.kw_startpos", "-100000"),
        ("kw.ssfk.kw_nr_max", "3"),
        ("kw.ssfk.bilateral", "1"),
        ("kw.ssfk.table[0].pos", "-1.5"),
        ("kw.ssfk.table[1].pos", "0"),
        ("kw.ssfk.table[2].pos", "10"),
        ("kw.ssfk.table[0].neg", "0"),
        ("kw.ssfk.table[1].neg", "0"),
        ("kw.ssfk.table[2].neg", "0"),
    ]


def test_a_step_that_rounding_would_shift_becomes_setpoints() -> None:
    table = make_table([i / 3 for i in range(50)], [0.0] * 50, [0.0] * 50, Units.MM)
    text = dialect_named("isg").write(table, WriteOptions()).text
    assert "kw.ssfk.table[49].setpoint          163333.33" in text


def test_more_points_than_old_kernels_take() -> None:
    zeros = [0.0] * 1501
    table = make_table(list(range(1501)), zeros, zeros, Units.MM)
    written = dialect_named("isg").write(table, WriteOptions())
    assert "kw.ssfk.max_points                  1501" in written.text
    assert len(written.losses) == 2
    assert parse_table(written.text.encode(), "x.lis", written.context).table.last == 1500.0


def test_a_list_for_another_axis_is_a_lint() -> None:
    codes = [lint.code for lint in parse(SAMPLE, axis="x").lints]
    assert "L10" in codes
    assert "L10" not in [lint.code for lint in parse(SAMPLE, axis="y").lints]


def test_context_of_a_written_list_reads_it_for_the_same_axis() -> None:
    table = make_table([0, 10], [0, 0.001], [0, 0.001], Units.MM)
    written = dialect_named("isg").write(table, WriteOptions(axis="z"))
    again = parse_table(written.text.encode(), "x.lis", replace(written.context, units=Units.INCH))
    assert again.table.units is Units.MM
