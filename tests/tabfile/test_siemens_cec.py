"""Siemens CEC files of an axis by itself: both directions, by hand arithmetic, and refused when damaged."""

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, WriteOptions, dialect_named, explain, parse_table
from tests.tabfile.samples import SIEMENS_CEC
from tests.tabfile.texts import Texts

CMA, AMC = ErrorSense.COMMAND_MINUS_ACTUAL, ErrorSense.ACTUAL_MINUS_COMMAND
FILE = Texts("cec.ini", {"file_units": Units.MM, "error_sense": CMA})
parse, refused = FILE.parse, FILE.said
TEXT = SIEMENS_CEC.decode()


def test_each_direction_has_its_table() -> None:
    loaded = parse(TEXT)
    assert loaded.format == "siemens-cec"
    assert list(loaded.table.forward) == [0.0, 0.003, 0.005, 0.004]
    assert list(loaded.table.backward) == [-0.015, -0.012, -0.007, -0.009]
    found = explain(loaded, 150.0, counts_per_unit=1000.0)
    # Half way from 3 to 5 µm forward, from -12 to -7 µm backward.
    assert found.forward.correction == pytest.approx(0.004)
    assert found.backward.correction == pytest.approx(-0.0095)
    assert loaded.source.behaves_as == ('outside = "hold"',)


def test_the_sense_is_told_for_no_manual_at_hand_says_it() -> None:
    other = parse(TEXT, error_sense=AMC).table
    assert list(other.forward) == [0.0, -0.003, -0.005, -0.004]
    assert "no manual states the sign" in refused(TEXT, error_sense=None)
    assert "states no units" in refused(TEXT, file_units=None)


def test_a_table_of_direction_0_holds_both_ways() -> None:
    first, _, _ = TEXT.partition("$AN_CEC[1,0]")
    loaded = parse(first.replace("DIRECTION[0]=1", "DIRECTION[0]=0") + "M17\n")
    assert loaded.table.is_unidirectional
    assert list(loaded.table.backward) == [0.0, 0.003, 0.005, 0.004]


def test_several_axes_need_a_name() -> None:
    second = TEXT.replace("X1", "Y1").replace("[0", "[2").replace("[1", "[3")
    body = second.partition("CHANDATA(1)\n")[2]
    both = TEXT.replace("M0\nM17\n", "") + body
    assert "file_axis = 'X1'" in refused(both)
    assert list(parse(both, file_axis="y1").table.forward) == [0.0, 0.003, 0.005, 0.004]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("OUTPUT_AXIS[1]=(X1)", "OUTPUT_AXIS[1]=(Z1)", "Z1 corrected over the position of X1"),
        ("DIRECTION[1]=-1", "DIRECTION[1]=1", "DIRECTION +1 (table 0), +1 (table 1)"),
        ("DIRECTION[1]=-1", "DIRECTION[1]=2", "DIRECTION 2; allowed: 0, 1 or -1"),
        ("$AN_CEC_DIRECTION[1]=-1\n", "", "sag compensation (CEC) table 1: no $AN_CEC_DIRECTION[1]"),
        ("$AN_CEC[1,2]=-0.007\n", "", "1 of 4 points of sag compensation (CEC) table 1 missing: 2"),
        ("$AN_CEC[1,2]", "$AN_CEC[1,4]", "1 of 4 points of sag compensation (CEC) table 1 missing: 2"),
        ("$AN_CEC[1,2]", "$AN_CEC[1,1]", "a second value (the first is on line 15)"),
        ("MAX[1]=300", "MAX[1]=350", "3.5 steps of 100"),
        (
            "$AN_CEC_MIN[1]=0\n$AN_CEC_MAX[1]=300",
            "$AN_CEC_MIN[1]=10\n$AN_CEC_MAX[1]=310",
            "with different points",
        ),
        ("-0.012", "-0,012", "cec.ini:15"),
        ("M17\n", "", "cec.ini:25"),
        ("M0\nM17\n", "", "M17 at the end: check that the file is complete"),
        ("IS_MODULO[1]='H0'", "IS_MODULO[1]='H2'", "IS_MODULO 2"),
        ("(X1)", "X1", "not an axis in brackets"),
        ("$AN_CEC_STEP[1]", "$AN_CEC_STOP[1]", "an unknown parameter"),
        ("$AN_CEC_STEP[1]=100", "$AN_CEC_STEP[1]=100\n$AN_CEC_MULT_BY_TABLE[1]=2", "a product of two tables"),
    ],
)
def test_what_is_damaged_or_means_something_else_is_refused(before: str, after: str, words: str) -> None:
    assert before in TEXT
    assert words in refused(TEXT.replace(before, after, 1))


def test_what_is_written_reads_back_in_both_senses() -> None:
    table = make_table([0, 50, 100], [0.001, 0.002, 0.003], [-0.01, -0.011, -0.012], Units.MM)
    for sense, first in ((CMA, "0.00100000"), (AMC, "-0.00100000")):
        written = dialect_named("siemens-cec").write(table, WriteOptions(axis="x", sense=sense))
        assert f"$AN_CEC[0,0]={first}\n" in written.text
        assert "$AN_CEC_INPUT_AXIS[1]=(X1)\n" in written.text
        assert "$AN_CEC_DIRECTION[1]=-1\n" in written.text
        again = parse_table(written.text.encode(), "again.ini", written.context).table
        assert list(again.forward) == pytest.approx(list(table.forward))
        assert list(again.backward) == pytest.approx(list(table.backward))
    one = make_table([0, 50, 100], [0.001, 0.002, 0.003], [0.001, 0.002, 0.003], Units.MM)
    text = dialect_named("siemens-cec").write(one, WriteOptions(axis="x", sense=CMA)).text
    assert "$AN_CEC_DIRECTION[0]=0" in text
    assert "[1" not in text
