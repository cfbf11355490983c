"""Heidenhain .COM tables: values by hand, what nothing proves is refused, strict grammar, writing."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, HomeSide, explain
from tests.tabfile.drawn import assert_same_but_for_zeros, there_and_back, uneven
from tests.tabfile.texts import Texts

SAMPLE = (Path(__file__).parents[2] / "tables" / "heidenhain-com" / "Z_PITCH.COM").read_bytes().decode()
ONE = "BEGIN Y .COM MM\nNR AXISPOS Y\n0 -90 +0.01\n1 -85 -0.02\n2 -80 +0\n[END]\n"
SEVERAL = "BEGIN Y .COM MM\nNR AXISPOS Z Y\n0 -90 +0.5 +0.01\n1 -85 +0.5 -0.02\n[END]\n"
WIDE = """\
BEGIN AXIS_Z.COM MM
NR   AXISPOS       BACKLASH      X             Y             Z
0    -75.0000                                                +0.0040
1    -25.0000                                                -0.0010
2    +25.0000                                                +0.0030
[END]
"""
"""As a control with three axes has it: a column for each of them, and blanks in all but one."""
ACTUAL, COMMAND = ErrorSense.ACTUAL_MINUS_COMMAND, ErrorSense.COMMAND_MINUS_ACTUAL
FILE = Texts("Z_PITCH.COM", {"error_sense": ACTUAL})
parse, refused = FILE.parse, FILE.refused


def test_two_directions_by_hand() -> None:
    loaded = parse(SAMPLE)
    assert loaded.format == "heidenhain-com"
    assert loaded.table.units is Units.MM
    assert (loaded.table.first, loaded.table.last, len(loaded.table.positions)) == (-200.0, 600.0, 9)
    explained = explain(loaded, 150.0)
    # half way from -0.0021 to -0.0017, and from 0.0012 to 0.0014; subtracted
    assert explained.forward.correction == pytest.approx(0.0019, abs=1e-15)
    assert explained.backward.correction == pytest.approx(-0.0013, abs=1e-15)
    assert explained.forward.low.forward_line == 6
    assert loaded.source.forward_rule == "error = actual - commanded: subtracted; column Z"
    assert loaded.source.backward_rule == "error = actual - commanded: subtracted; column BACKLASH"
    assert loaded.source.axis == "Z"


def test_one_column_holds_in_both_directions() -> None:
    loaded = parse(ONE, error_sense=COMMAND)
    assert list(loaded.table.forward) == list(loaded.table.backward) == [0.01, -0.02, 0.0]
    assert loaded.source.backward_rule.endswith("one value for both directions")
    assert "only the .CMA file states this" in loaded.source.decisions[2]


def test_lost_motion_speaks_against_the_wrong_sense() -> None:
    assert "L2" not in [lint.code for lint in parse(SAMPLE).lints]
    assert "L2" in [lint.code for lint in parse(SAMPLE, error_sense=COMMAND).lints]


def test_sense_is_never_guessed() -> None:
    error = refused(SAMPLE, "no manual states the sign", error_sense=None)
    assert len(error.readings) == 2
    assert error.allowed.startswith("error_sense = 'actual_minus_command' or 'command_minus_actual'")


def test_one_of_several_axes_must_be_told() -> None:
    error = refused(SEVERAL, "2 axes", axis="y")
    assert (error.line, "file_axis = 'Z'" in error.allowed) == (2, True)
    loaded = parse(SEVERAL, file_axis="y")
    assert list(loaded.table.forward) == [-0.01, 0.02]
    assert loaded.source.decisions[3] == "not used: Z, a cross compensation over these positions"
    refused(SEVERAL, "columns Z, Y, but file_axis = X", file_axis="X")


def test_backlash_of_several_axes_is_refused() -> None:
    text = "BEGIN Y .COM MM\nNR AXISPOS Z Y BACKLASH\n0 -90 0 0 1\n1 -85 0 0 1\n[END]\n"
    error = refused(text, "BACKLASH beside the columns Z, Y", file_axis="Y")
    assert "only AXISPOS, Y and its BACKLASH" in error.allowed


def test_backlash_of_zeros_has_two_readings() -> None:
    text = "BEGIN Y .COM MM\nNR AXISPOS Y BACKLASH\n0 -90 0.01 0\n1 -85 0 +0.0\n[END]\n"
    error = refused(text, "a BACKLASH column of zeros")
    assert len(error.readings) == 2
    assert list(parse(text.replace("0.01", "0.00")).table.backward) == [0.0, 0.0]
    assert list(parse(text.replace("+0.0", "+0.1")).table.backward) == [0.0, -0.1]


def test_column_must_be_that_of_the_axis() -> None:
    parse(ONE, axis="y")
    error = refused(ONE, "a column of axis Y, read for axis X", axis="x")
    assert "file_axis = 'Y'" in error.allowed
    meant = parse(ONE, axis="x", file_axis="Y")
    assert "L10" not in [lint.code for lint in meant.lints]


def test_columns_in_any_order() -> None:
    loaded = parse("BEGIN Y .COM INCH\nNR BACKLASH Z2 AXISPOS\n0 1e-3 -.002 0.\n1 0 0 5\n[END]\n")
    assert loaded.table.units is Units.INCH
    assert (list(loaded.table.positions), list(loaded.table.forward)) == ([0.0, 5.0], [0.002, 0.0])
    assert list(loaded.table.backward) == [-0.001, 0.0]
    assert loaded.source.axis is None


def test_columns_that_are_blank_in_all_rows_are_not_there() -> None:
    loaded = parse(WIDE, axis="z")
    assert list(loaded.table.positions) == [-75.0, -25.0, 25.0]
    # half way between errors of 0.004 and -0.001, the same both ways
    explained = explain(loaded, -50.0)
    assert explained.forward.correction == pytest.approx(-0.0015, abs=1e-15)
    assert explained.backward.correction == pytest.approx(-0.0015, abs=1e-15)
    assert loaded.source.decisions[3] == "not filled in: BACKLASH, X, Y"
    refused(WIDE, "columns Z, but file_axis = X", file_axis="X")


def test_a_number_belongs_to_the_column_that_begins_where_it_does() -> None:
    in_y = WIDE.replace(" " * 14 + "+0.00", "+0.00").replace(" " * 14 + "-0.00", "-0.00")
    loaded = parse(in_y)
    assert loaded.source.decisions[2].startswith("positions: assumed to be those of Y")
    # backlash beside one axis that is filled in, the others blank
    both = in_y.replace(" " * 14 + " " * 14 + "+", "+0.0055       " + " " * 14 + "+")
    both = both.replace(" " * 14 + " " * 14 + "-0.0010", "+0.0005       " + " " * 14 + "-0.0010")
    loaded = parse(both)
    assert list(loaded.table.forward) == [-0.004, 0.001, -0.003]
    assert list(loaded.table.backward) == [-0.0055, -0.0005, -0.0055]


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ("   -0.0010", "  -0.0010", 4, "3 fields in"),
        ("-25.0000 ", "-25.00000 ", 4, "3 fields in"),
        ("BACKLASH ", "BACKLASH", 3, "3 fields in"),
        ("-25.0000 ", "-25.0000\t", 4, "3 fields in"),
        ("1    -25.0000      ", "1    -25.0000      +0.001", 4, "4 fields in"),
        ("-25.0000                                                -0.0010", "-25.0000", 4, "in column Z"),
        ("1    -25.0000", "1            ", 4, "in column AXISPOS"),
        ("1    -25.0000      ", "1    -25.0000      +0.001"[:14], 4, "3 fields in"),
    ],
)
def test_a_blank_cell_leaves_nothing_open(old: str, new: str, line: int, found: str) -> None:
    assert old in WIDE
    error = refused(WIDE.replace(old, new, 1), line=line)
    assert found in error.found


def test_the_older_layout_is_refused_with_a_way_out() -> None:
    text = "BEGIN AXIS-X.COM  DATUM:-75.0000 DISTANCE:+50.0000\nNR    1=F()\n0 -75.0000 +0.0040\n"
    error = refused(text, "of the older layout")
    assert "a line 'NR AXISPOS X' above the rows" in error.allowed


@pytest.mark.parametrize("key", ["units", "file_units"])
def test_numbers_of_a_rotary_axis_are_degrees(key: str) -> None:
    loaded = parse(ONE, **{key: Units.DEGREE})
    assert loaded.table.units is Units.DEGREE
    assert loaded.source.decisions[1] == "units degree: the axis is rotary, so MM does not count"


def test_told_units_must_agree() -> None:
    assert parse(ONE, units=Units.INCH).table.units is Units.MM
    refused(ONE, "units mm, but file_units = inch", file_units=Units.INCH)
    refused(ONE, "a table in mm for an axis in degree", file_units=Units.MM, units=Units.DEGREE)


@pytest.mark.parametrize("text", [SAMPLE.replace("\r\n", "\r"), "\ufeff\n" + SAMPLE.lower() + "\t\n\x1a"])
def test_line_ends_blanks_and_case(text: str) -> None:
    assert list(parse(text).table.backward) == list(parse(SAMPLE).table.backward)


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ("BEGIN Y", "BEGIN", 1, "'BEGIN .COM MM'"),
        (".COM MM", ".COM", 1, "'BEGIN Y .COM'"),
        (".COM MM", ".COM CM", 1, "'BEGIN Y .COM CM'"),
        (".COM MM", ".TAB MM", 1, "'BEGIN Y .TAB MM'"),
        (".COM MM", ".CMA MM", 1, "a .CMA file"),
        ("BEGIN Y .COM MM\n", "", 1, "'NR AXISPOS Y'"),
        ("NR AXISPOS Y", "AXISPOS Y", 2, "'AXISPOS Y'"),
        ("NR AXISPOS Y", "NR AXISPOS", 2, "'NR AXISPOS'"),
        ("NR AXISPOS Y", "NR AXISPO Y", 2, "column 'AXISPO' in"),
        ("NR AXISPOS Y", "NR AXISPOS Y Y", 2, "column 'Y' in"),
        ("NR AXISPOS Y", "NR AXISPOS Y BACKLASH", 3, "3 fields in '0 -90 +0.01'"),
        ("1 -85 -0.02", "1 -85", 4, "2 fields in '1 -85'"),
        ("1 -85 -0.02", "1 -85 -0.02 0", 4, "4 fields"),
        ("1 -85 -0.02", "1 -85 -0,02", 4, "'-0,02'"),
        ("1 -85 -0.02", "2 -85 -0.02", 4, "row '2'"),
        ("1 -85 -0.02", "01 -85 -0.02", 4, "row '01'"),
        ("1 -85 -0.02\n", "", 4, "row '2'"),
        ("1 -85 -0.02", "\u00a0  -85", 4, "no number in column NR"),
        ("1 -85 -0.02\n", "\n", 4, "a blank line"),
        ("1 -85 -0.02", "1 -90 -0.02", 4, "position -90 after -90"),
        ("1 -85 -0.02", "1 85 -0.02", 5, "position -80 after 85"),
        ("[END]", "", 5, "the last line '2 -80 +0'"),
        ("[END]", "[END]\nx", 7, "the last line 'x'"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, found: str) -> None:
    assert found in refused(ONE.replace(old, new, 1), line=line).found


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("BEGIN Y .COM MM\n", "the end of the file"),
        ("BEGIN Y .COM MM\nNR AXISPOS Y\n", "the last line"),
        ("BEGIN Y .COM MM\nNR AXISPOS Y\n[END]", "0 row"),
        ("BEGIN Y .COM MM\nNR AXISPOS Y\n0 1 2\n[END]", "1 row"),
    ],
)
def test_files_that_end_early_are_named(text: str, found: str) -> None:
    refused(text, found)


def test_range_start_and_what_has_no_meaning() -> None:
    refused(ONE, "outside travel", units=Units.MM, travel=(0.0, 100.0))
    refused(ONE, "lowest position of -90", file_start=0.0)
    told = parse(ONE, file_home=HomeSide.PLUS, fagor_sense=ACTUAL)
    assert [lint.code for lint in told.source.remarks] == ["R3", "R3"]


@given(uneven(dict.fromkeys(Units, 1e-6)), st.sampled_from(ErrorSense), st.sampled_from(["z", "Z2"]))
def test_what_is_written_is_read_back(table: CorrectionTable, sense: ErrorSense, name: str) -> None:
    told = None if len(name) == 1 else name
    written, again = there_and_back("heidenhain-com", table, axis="z", file_axis=told, sense=sense)
    assert_same_but_for_zeros(written, again.table, table, 1e-6, 1e-12)
    assert ("is written as 0.000001" in "".join(written.losses)) is (
        any(table.forward) and not any(table.backward)
    )
