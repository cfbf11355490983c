"""Fagor 8055 tables: the manual's example and lines of real files by hand, strict grammar, sense, writing."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, HomeSide, LintSeverity, WriteOptions, dialect_named, explain
from tests.tabfile.drawn import assert_same_but_for_zeros, there_and_back, uneven
from tests.tabfile.texts import Texts

FOLDER = Path(__file__).parents[2] / "tables" / "fagor-8055"
PRINTED = (FOLDER / "manual.txt").read_text()
TRANSFER = (FOLDER / "ML1").read_bytes().decode()
REAL = (
    "           P001              Z-  24.00000           EZ-   0.01600\r\n"
    "           P002              Z-  20.00000           EZ-   0.02200\r\n"
)
"""The first lines of a file of a machine in use, in inches."""
CROSS = (
    "           P001              Y-  60.00000           EZ    0.01500\r\n"
    "           P002              Y-  50.00000           EZ    0.01600\r\n"
)
TWO_WAY = "P001 X- 20.000 EX 0.001 EX- 0.002\nP002 X 0.000 EX 0 EX 0\nP003 X 20.000 EX- .004 EX- 0.005\n"
ACTUAL, COMMAND = ErrorSense.ACTUAL_MINUS_COMMAND, ErrorSense.COMMAND_MINUS_ACTUAL
FILE = Texts("ML1", {"file_units": Units.MM, "error_sense": ACTUAL})
parse, refused = FILE.parse, FILE.refused


@pytest.mark.parametrize("text", [PRINTED, TRANSFER])
def test_the_example_of_the_manual_by_hand(text: str) -> None:
    loaded = parse(text)
    assert loaded.format == "fagor-8055"
    assert list(loaded.table.positions) == [-20.0, 0.0, 30.0, 60.0, 90.0, 130.0, 160.0]
    # at X-20 the error is +0.001: taken off; it is 0 half way to X0, where it is -0.001
    assert explain(loaded, -20.0).forward.correction == -0.001
    assert explain(loaded, -10.0).forward.correction == pytest.approx(0.0, abs=1e-15)
    # half way from X30 (0) to X60 (0.002)
    assert explain(loaded, 45.0).forward.correction == pytest.approx(-0.001, abs=1e-15)
    # a quarter of the way from X90 (0.001) to X130 (-0.002): 0.00025
    assert explain(loaded, 100.0).backward.correction == pytest.approx(-0.00025, abs=1e-15)
    assert explain(loaded, 160.0).forward.correction == 0.003


def test_sense_turns_every_value_round() -> None:
    loaded = parse(PRINTED, error_sense=COMMAND)
    assert explain(loaded, -20.0).forward.correction == 0.001
    assert loaded.source.forward_rule == "error = commanded - actual: added unchanged; second field"
    assert explain(parse(PRINTED, error_sense=COMMAND), 160.0).forward.correction == -0.003


def test_sense_is_never_guessed() -> None:
    error = refused(PRINTED, "no manual states the sign", error_sense=None)
    assert len(error.readings) == 2
    assert error.allowed.startswith("error_sense = 'actual_minus_command' or 'command_minus_actual'")
    refused(PRINTED, "fagor_sense command_minus_actual and error_sense actual", fagor_sense=COMMAND)


def test_the_old_name_of_the_sense_is_taken_and_remarked() -> None:
    old = parse(PRINTED, error_sense=None, fagor_sense=COMMAND)
    assert old.table == parse(PRINTED, error_sense=COMMAND).table
    [remark] = old.source.remarks
    assert (remark.code, remark.severity) == ("R14", LintSeverity.INFO)
    assert "error_sense = 'command_minus_actual'" in remark.message


def test_units_are_never_guessed() -> None:
    refused(PRINTED, "a Fagor 8055 table, which states no units", file_units=None, units=Units.MM)
    loaded = parse(PRINTED, file_units=Units.MM, units=Units.INCH, travel=(-1.0, 7.0))
    assert loaded.table.units is Units.MM


def test_lines_of_a_real_file_by_hand() -> None:
    loaded = parse(REAL, file_units=Units.INCH, units=Units.INCH)
    assert (loaded.table.first, loaded.table.last) == (-24.0, -20.0)
    # a quarter of the way from -0.016 to -0.022: -0.0175
    assert explain(loaded, -23.0).forward.correction == pytest.approx(0.0175, abs=1e-15)
    assert loaded.source.axis == "Z"
    assert loaded.source.behaves_as == ('outside = "hold"',)


def test_third_field_is_for_the_negative_direction() -> None:
    loaded = parse(TWO_WAY)
    assert list(loaded.table.forward) == [-0.001, 0.0, 0.004]
    assert list(loaded.table.backward) == [0.002, 0.0, 0.005]
    assert loaded.source.backward_rule.endswith("third field")


def test_negative_errors_that_are_all_zero_mean_as_the_positive_ones() -> None:
    text = "P001 X-20 EX 0.001 EX 0\nP002 X0 EX -0.001 EX- 0.000\n"
    loaded = parse(text)
    assert list(loaded.table.backward) == list(loaded.table.forward) == [-0.001, 0.001]
    assert loaded.table.is_unidirectional
    assert "the negative errors are all 0" in loaded.source.decisions[2]
    assert "L9" not in [lint.code for lint in loaded.lints]
    one_more = parse(text.replace("EX- 0.000", "EX 0.0001"))
    assert list(one_more.table.backward) == [0.0, -0.0001]


def test_positive_errors_that_are_all_zero_mean_none() -> None:
    loaded = parse("P001 X-20 EX 0 EX 0.001\nP002 X0 EX 0 EX 0.002\n")
    assert list(loaded.table.forward) == [0.0, 0.0]
    lint = next(lint for lint in loaded.lints if lint.code == "L9")
    assert "Fagor" not in lint.message


def test_cross_compensation_is_refused_by_name() -> None:
    error = refused(CROSS, "errors of Z by the position of Y")
    assert "'cross' key of axis Z" in error.allowed
    assert error.line == 1


def test_axis_must_be_the_one_it_is_read_for() -> None:
    parse(PRINTED, axis="x")
    error = refused(PRINTED, "a table of axis X, read for axis Y", axis="y")
    assert "file_axis = 'X'" in error.allowed
    meant = parse(PRINTED, axis="y", file_axis="x")
    assert "L10" not in [lint.code for lint in meant.lints]
    assert list(meant.table.forward) == list(parse(PRINTED).table.forward)


def test_rotary_table_of_a_whole_turn_repeats() -> None:
    revolution = "P001 C0 EC 0.01\nP002 C180 EC 0.02\nP003 C360 EC 0.01\n"
    assert parse(revolution, file_units=Units.DEGREE).source.behaves_as == ("modulo = 360",)
    assert parse(revolution).source.behaves_as == ('outside = "hold"',)
    half_open = "P001 C0 EC 0.01 EC 0.1\nP002 C180 EC 0.02 EC 0\nP003 C360 EC 0.01 EC 0.2\n"
    assert parse(half_open, file_units=Units.DEGREE).source.behaves_as == ('outside = "hold"',)
    open_turn = revolution.replace("C360 EC 0.01", "C360 EC 0.011")
    assert parse(open_turn, file_units=Units.DEGREE).source.behaves_as == ('outside = "hold"',)


@pytest.mark.parametrize("text", [TRANSFER.replace("\r\n", "\r"), "\ufeff\n" + PRINTED.lower() + " \n\x1a"])
def test_line_ends_blanks_and_case(text: str) -> None:
    assert list(parse(text).table.forward) == list(parse(PRINTED).table.forward)


def test_a_heading_is_the_only_line_that_is_named() -> None:
    error = refused("; X axis\n" + PRINTED)
    assert [(problem.line, problem.found) for problem in error.problems] == [(1, "'; X axis'")]


@pytest.mark.parametrize(
    "row", ["P002 X0 EX -0.001", "P002 X 0 EX- 0.001", "P002\tX\t0\tEX-\t.001", "P002   X  0.  EX-0.0010"]
)
def test_spellings_of_one_line(row: str) -> None:
    assert parse(PRINTED.replace("P002 X0 EX -0.001", row)).table.forward[1] == 0.001


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ("P002", "P003", 2, "point P003"),
        ("P002", "P02", 2, "'P02 X0"),
        ("P002", "P0002", 2, "point P0002"),
        ("P002 X0 EX -0.001\n", "", 2, "point P003"),
        ("P002 X0 EX -0.001\n", "\n", 2, "a blank line"),
        ("P002 X0 EX -0.001\n", "P001 X-20 EX 0.001\n", 2, "point P001"),
        ("P002 X0 EX -0.001\n", "; a comment\n", 2, "'; a comment'"),
        ("X0 EX -0.001", "X0 EX - 0.001", 2, "'P002 X0 EX - 0.001'"),
        ("X0 EX -0.001", "X0 EX -0,001", 2, "'P002 X0 EX -0,001'"),
        ("X0 EX -0.001", "X0 EX +0.001", 2, "'P002 X0 EX +0.001'"),
        ("X0 EX -0.001", "X0 EX --0.001", 2, "'P002 X0 EX --0.001'"),
        ("X0 EX -0.001", "X0 EX- -0.001", 2, "'P002 X0 EX- -0.001'"),
        ("X0 EX -0.001", "X0 EX 0 .001", 2, "'P002 X0 EX 0 .001'"),
        ("X0 EX -0.001", "X0EX -0.001", 2, "'P002 X0EX -0.001'"),
        ("X0 EX -0.001", "X0 EX 1e-3", 2, "'P002 X0 EX 1e-3'"),
        ("X0 EX -0.001", "X0 EX " + "1" * 41, 2, "'P002 X0"),
        ("X0 EX -0.001", "X0", 2, "'P002 X0'"),
        ("X0 EX -0.001", "X0 EX -0.001 EX 0", 2, "3 fields after lines of 2"),
        ("X0 EX -0.001", "X0 EX -0.001 EX 0 EX 0", 2, "'P002 X0 EX -0.001 EX 0 EX 0'"),
        ("X0 EX -0.001", "Y0 EY -0.001", 2, "axis Y after axis X"),
        ("X0 EX -0.001", "X0 EY -0.001", 2, "errors of Y by the position of X"),
        ("X0 EX -0.001", "X-20 EX -0.001", 2, "position -20 after -20"),
        ("X0 EX -0.001", "X31 EX -0.001", 3, "position 30 after 31"),
        ("X160", "X100000", 7, "100000"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, found: str) -> None:
    assert found in refused(PRINTED.replace(old, new, 1), line=line).found


def test_a_line_without_its_third_field_is_named() -> None:
    refused(TWO_WAY.replace(" EX 0 EX 0", " EX 0"), "2 fields after lines of 3", line=2)


def test_number_of_points_has_limits() -> None:
    rows = [f"P{i:03d} X{i} EX 0.001\n" for i in range(1, 1002)]
    assert len(parse("".join(rows[:1000])).table.positions) == 1000
    refused("".join(rows), "1001 point")
    refused(rows[0], "1 point")


def test_slope_must_stay_below_the_hundred_percent_of_the_control() -> None:
    refused("P001 X0 EX 0\nP002 X1 EX 1\n", "slope")


def test_range_start_and_what_has_no_meaning() -> None:
    refused(PRINTED, "outside travel", units=Units.MM, travel=(-300.0, -100.0))
    refused(PRINTED, "lowest position of -20", file_start=0.0)
    told = parse(PRINTED, file_home=HomeSide.MINUS, file_counts_per_unit=5.0, isg_sense=ACTUAL)
    assert [lint.code for lint in told.source.remarks] == ["R3", "R3", "R3"]


LAST_PLACE = {Units.MM: 1e-4, Units.DEGREE: 1e-4, Units.INCH: 1e-5}


@given(uneven(LAST_PLACE, (10_000, 900_000), 10**7), st.sampled_from(ErrorSense))
def test_what_is_written_is_read_back(table: CorrectionTable, sense: ErrorSense) -> None:
    written, again = there_and_back("fagor-8055", table, axis="z", sense=sense)
    assert again.source.axis == "Z"
    assert_same_but_for_zeros(written, again.table, table, LAST_PLACE[table.units], 1e-9)


def test_layout_is_that_of_the_control() -> None:
    table = make_table([-24, -20], [0.016, 0.022], [0.016, 0.022], Units.INCH)
    written = dialect_named("fagor-8055").write(table, WriteOptions(axis="z", sense=ACTUAL))
    assert written.text == REAL
    two = make_table([-24, -20], [0.016, 0.022], [0.015, -0.022], Units.INCH)
    written = dialect_named("fagor-8055").write(two, WriteOptions(axis="z", sense=ACTUAL))
    assert written.text == REAL.replace("600\r", "600           EZ-   0.01500\r").replace(
        "200\r", "200           EZ    0.02200\r"
    )


def test_four_digits_are_read_as_three_are() -> None:
    four = TWO_WAY.replace("P00", "P000")
    assert "P0003" in four
    one, other = parse(four).table, parse(TWO_WAY).table
    assert (list(one.positions), list(one.forward), list(one.backward)) == (
        list(other.positions),
        list(other.forward),
        list(other.backward),
    )


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("P0001 X-20 EX 0.001\nP002 X0 EX -0.001\n", 2, "P0002: points are numbered from P0001 without gaps"),
        ("P0001 X-20 EX 0.001\nP0003 X0 EX -0.001\n", 2, "P0002"),
        ("P0002 X-20 EX 0.001\nP0003 X0 EX -0.001\n", 1, "P0001"),
    ],
)
def test_four_digits_are_four_in_all_lines_without_holes(text: str, line: int, words: str) -> None:
    error = refused(text)
    assert error.problems[0].line == line
    assert words in str(error)
