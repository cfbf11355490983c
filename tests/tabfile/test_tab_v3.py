"""Centroid version 3: vectors of the published file, home direction, strict grammar."""

from pathlib import Path

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import HomeSide, explain
from tests.tabfile.texts import Texts

SAMPLE = (Path(__file__).parents[2] / "tables" / "centroid-v3" / "cnc10z.tab").read_text()
HEADER = "CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS MILLIMETER\nINTERVAL 10\nENTRIES 3\n"
FILE = Texts("table.tab")
parse, refused = FILE.parse, FILE.refused


def test_home_plus_axis_takes_away_for_motion_in_the_negative_direction() -> None:
    loaded = parse(SAMPLE)
    explained = explain(loaded, -1.25)
    # column 2 between -0.00014 and -0.00023, column 3 between +0.00011 and +0.00013
    assert explained.backward.correction == pytest.approx(-0.000185, abs=1e-15)
    assert explained.forward.correction == pytest.approx(0.00012, abs=1e-15)
    assert explain(loaded, -0.25).backward.correction == pytest.approx(-0.00005, abs=1e-15)


def test_entries_are_points() -> None:
    loaded = parse(SAMPLE)
    assert len(loaded.table.positions) == 9
    assert (loaded.table.first, loaded.table.last) == (-4.0, 0.0)
    assert loaded.table.even_step == 0.5


def test_home_minus_axis_takes_away_for_motion_in_the_positive_direction() -> None:
    loaded = parse(HEADER + "0 0 0\n10 0.003 -0.001\n20 0.004 -0.002")
    assert list(loaded.table.forward) == [0.0, 0.003, 0.004]
    assert list(loaded.table.backward) == [0.0, -0.001, -0.002]
    assert loaded.table.units is Units.MM


def test_told_home_side_must_agree_with_the_order_of_positions() -> None:
    parse(SAMPLE, file_home=HomeSide.PLUS)
    refused(SAMPLE, "so home is at the plus end", file_home=HomeSide.MINUS)
    refused(HEADER + "0 0 0\n10 0 0\n20 0 0", "so home is at the minus end", file_home=HomeSide.PLUS)


def test_told_start_must_agree_with_the_lowest_position() -> None:
    parse(SAMPLE, file_start=-4.0)
    refused(SAMPLE, "lowest position of -4", file_start=0.0)


@pytest.mark.parametrize("rows", ["-10 1 4\n0 2 5\n10 3 6", "10 1 4\n0 2 5\n-10 3 6"])
@pytest.mark.parametrize("home", [None, HomeSide.PLUS, HomeSide.MINUS])
def test_positions_on_both_sides_of_home_are_refused_with_both_readings(
    rows: str, home: HomeSide | None
) -> None:
    error = refused(HEADER + rows, "both sides of home", file_home=home)
    assert "change direction at home" in error.readings[0]
    assert "keep their direction" in error.readings[1]
    # the columns differ by 3 mm everywhere
    assert "at most 3 mm" in error.readings[1]


def test_axis_must_be_the_one_it_is_read_for() -> None:
    parse(SAMPLE, axis="z")
    refused(SAMPLE, "AXIS Z, read for axis X", line=2, axis="x")


def test_table_that_misses_travel_is_refused() -> None:
    error = refused(SAMPLE, "outside travel", travel=(0.0, 4.0))
    assert len(error.readings) == 2
    assert parse(SAMPLE, travel=(-110.0, 0.0), units=Units.MM).table.first == -4.0


def test_lengths_for_a_rotary_axis_are_refused() -> None:
    refused(SAMPLE, "axis in degree", units=Units.DEGREE)


def test_keywords_in_any_case_and_any_blanks() -> None:
    text = SAMPLE.lower().replace(" +", "\t +").replace("axis z", "  Axis\t z  ")
    assert list(parse(text).table.forward) == list(parse(SAMPLE).table.forward)


@pytest.mark.parametrize("first", ["CNC10", "CNC11", "CNC12", "CNC"])
def test_header_may_name_any_software(first: str) -> None:
    assert parse(SAMPLE.replace("CNC10", first)).format == "centroid-3"


def test_interval_may_be_off_by_a_ten_thousandth() -> None:
    parse(HEADER + "0 0 0\n10.001 0 0\n20 0 0")
    refused(HEADER + "0 0 0\n10.0011 0 0\n20 0 0", r"a step of 10\.0011")


@pytest.mark.parametrize(
    ("old", "new", "line", "allowed"),
    [
        ("VERSION 3", "VERSION 4", 1, "VERSION 3"),
        ("AXIS Z", "AXIS ZZ", 2, "one letter"),
        ("AXIS Z", "UNITS INCH", 2, "AXIS"),
        ("UNITS INCH", "UNITS FURLONG", 3, "INCH or MILLIMETER"),
        ("INTERVAL 0.5", "INTERVAL -0.5", 4, "above 0"),
        ("INTERVAL 0.5", "INTERVAL 0,5", 4, "a distance above 0: write 0.5"),
        ("-1.00000000", "-1,0", 8, "with a point, such as -0.0001: write -1.0"),
        ("INTERVAL 0.5", "INTERVAL 0.4", 7, "INTERVAL 0.4"),
        ("ENTRIES 9", "ENTRIES 1", 5, "at least 2"),
        ("ENTRIES 9", "ENTRIES 8", 14, "8, as ENTRIES on line 5"),
        ("ENTRIES 9", "ENTRIES 10", 14, "10, as ENTRIES on line 5"),
        ("-1.00000000", "-1.0000.0", 8, "decimal number"),
        ("-1.00000000", "-1.0 ; x", 8, "position, away, toward"),
        ("-1.00000000", "-0.50000000", 8, "descend"),
        ("-1.00000000", "-0.25000000", 8, "descend"),
        ("-1.00000000", "\n", 8, "position, away, toward"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, allowed: str) -> None:
    error = refused(SAMPLE.replace(old, new, 1), line=line)
    assert allowed in error.allowed


def test_positions_must_begin_at_home() -> None:
    refused(HEADER + "10 0 0\n20 0 0\n30 0 0", "first position of 10")


def test_header_that_ends_early_is_named() -> None:
    refused("CNC10 TAB FILE VERSION 3\nAXIS Z", "the end of the file", line=2)
