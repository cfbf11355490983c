"""Aerotech .cal: words of the start lines, signs, what must be told, strict grammar."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import TabFileError, WriteOptions, dialect_named, explain, parse_table
from tests.tabfile.drawn import assert_same, there_and_back
from tests.tabfile.texts import Texts

COUNTED = (Path(__file__).parents[2] / "tables" / "aerotech" / "x.cal").read_text()
SAMPLE = COUNTED.replace("; points: 13\n", "")
TOLD: dict[str, Any] = {"file_units": Units.MM, "file_start": -100.0}
TWO = SAMPLE + SAMPLE.replace(":START X", ":START Y").replace("-1.2", "-9.9")
FILE = Texts("table.cal")
parse, refused = FILE.parse, FILE.refused


def test_values_are_added_in_thousandths_upwards_from_the_told_start() -> None:
    loaded = parse(SAMPLE, **TOLD)
    assert loaded.format == "aerotech-cal"
    # 13 values, 12 intervals of 25 mm
    assert (loaded.table.first, loaded.table.last, len(loaded.table.positions)) == (-100.0, 200.0, 13)
    assert loaded.table.is_unidirectional
    explained = explain(loaded, -62.5)
    # half way between -1.2 at -75 and -2.1 at -50: -1.65 thousandths of a mm
    assert explained.forward.correction == pytest.approx(-0.00165, abs=1e-15)
    assert explained.forward.file_value == pytest.approx(-1.65)
    assert explained.forward.rule == "value is added"
    assert loaded.source.value_unit == "mm/1000"
    assert loaded.source.axis == "X"
    assert loaded.source.behaves_as == ('outside = "hold"',)
    assert "HOMEDIRECTION=CCW, HOMEOFFSET=0" in loaded.source.decisions[1]


def test_negcor_subtracts() -> None:
    loaded = parse(SAMPLE.replace("HOMEOFFSET=0", "HOMEOFFSET=0 NEGCOR"), **TOLD)
    assert explain(loaded, -62.5).forward.correction == pytest.approx(0.00165, abs=1e-15)
    assert "subtracted" in loaded.source.forward_rule


@pytest.mark.parametrize(
    ("unit", "units", "correction"),
    [
        ("PRIMARY", Units.MM, -1.2),
        ("primary/1000", Units.INCH, -0.0012),
        ("PRIMARY/3600", Units.DEGREE, -1.2 / 3600),
    ],
)
def test_unit_of_the_values(unit: str, units: Units, correction: float) -> None:
    loaded = parse(SAMPLE.replace("PRIMARY/1000", unit), file_units=units, file_start=0.0)
    assert loaded.table.forward[1] == pytest.approx(correction)
    assert loaded.table.units is units


def test_seconds_of_arc_are_not_for_lengths() -> None:
    error = refused(SAMPLE.replace("/1000", "/3600"), **TOLD)
    assert (error.line, error.allowed) == (3, "file_units = 'degree'")


def test_what_the_file_does_not_prove_must_be_told() -> None:
    assert "states no units" in str(refused(SAMPLE, file_start=0.0))
    error = refused(SAMPLE, file_units=Units.MM)
    assert "13 values, 25 mm apart" in error.found
    assert "file_start" in error.allowed


def test_number_of_values_is_remarked_on_until_a_comment_states_it() -> None:
    assert [lint.code for lint in parse(SAMPLE, **TOLD).source.remarks] == ["R10"]
    assert parse(COUNTED, **TOLD).source.remarks == ()
    lost = COUNTED.replace("-4.6 -4.9 -5.8 -6.1 -6.9 -7.4\n", "")
    assert "7 points" in str(refused(lost, **TOLD))


def test_several_tables_need_a_told_axis() -> None:
    error = refused(TWO, **TOLD)
    assert (error.line, error.allowed) == (11, "file_axis = one of X, Y")
    assert parse(TWO, file_axis="y", **TOLD).table.forward[1] == pytest.approx(-0.0099)
    assert parse(TWO, file_axis="X", axis="Z", **TOLD).table.forward[1] == pytest.approx(-0.0012)
    assert "but file_axis = 3" in str(refused(TWO, file_axis="3", **TOLD))
    assert "would be added to those of the first" in str(refused(SAMPLE + SAMPLE, **TOLD))


def test_axis_must_be_the_one_it_is_read_for() -> None:
    assert parse(SAMPLE, axis="x", **TOLD).source.axis == "X"
    assert ":START X, read for axis Y" in str(refused(SAMPLE, axis="y", **TOLD))
    # a number names no letter
    assert parse(SAMPLE.replace(":START X", ":START 1"), axis="y", **TOLD).source.axis is None


def test_master_may_only_be_the_axis_itself() -> None:
    assert (
        parse(SAMPLE.replace("SAMPLEDIST", "MASTER=x SAMPLEDIST"), **TOLD).table
        == parse(SAMPLE, **TOLD).table
    )
    error = refused(SAMPLE.replace("SAMPLEDIST", "MASTER=Y SAMPLEDIST"), **TOLD)
    assert (error.line, error.found) == (
        3,
        "MASTER=Y: a correction of axis X over the position of another axis",
    )


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        (":START X", ":START2D 2 1 1 2 10 10 5", 3, "two dimensions"),
        ("HOMEOFFSET=0", "HOMEOFFSET=0 OFFSETROW=3", 4, "two dimensions"),
        (":START X", ":STARTX", 3, "':STARTX'"),
        (":START X", ":START", 3, ":START and the axis"),
        (":START X ", "", 3, "a comment (; or '), or :START"),
        ("SAMPLEDIST=25 ", "", 3, "no SAMPLEDIST"),
        ("SAMPLEDIST=25", "SAMPLEDIST=-25", 3, "a distance above 0"),
        ("SAMPLEDIST=25", "SAMPLEDIST=", 3, "'SAMPLEDIST=' after :START"),
        ("SAMPLEDIST=25", "SAMPLEDIST=25 SAMPLEDIST=25", 3, "a second SAMPLEDIST"),
        ("POSUNIT=PRIMARY", "POSUNIT=COUNTS", 3, "PRIMARY: positions"),
        ("CORUNIT=PRIMARY/1000", "CORUNIT=PRIMARY/100", 3, "PRIMARY, PRIMARY/1000, PRIMARY/3600"),
        ("HOMEDIRECTION=CCW", "HOMEDIRECTION=UP", 4, "CW or CCW"),
        ("HOMEOFFSET=0", "HOMEOFFSET=O", 4, "HOMEOFFSET=O"),
        ("HOMEOFFSET=0", "HOMEOFFSET=0 NEGCOR=1", 4, "'NEGCOR=1' after :START"),
        ("HOMEOFFSET=0", "HOMEOFFSET=0 WRAP", 4, "'WRAP' after :START"),
        ("HOMEDIRECTION=CCW HOMEOFFSET=0", "", 4, ":START and nothing else"),
        ("-2.4", "-2,4", 5, "decimal number with a point"),
        ("-8.2\n", "\n-8.2\n", 7, "a blank line inside a table"),
        ("-8.2\n", "; -8.2\n", 7, "inside a table"),
        (":END", ":END X", 8, ":END alone"),
        (":END", "", 7, ":END of the table of axis X"),
        (":END\n", ":END\n-8.2\n", 9, "a comment (; or '), or :START"),
        ("; serial", "serial", 2, "a comment (; or '), or :START"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    assert message in str(refused(SAMPLE.replace(old, new, 1), format="aerotech-cal", **TOLD, line=line))


def test_a_table_has_at_least_two_values() -> None:
    text = ":START X SAMPLEDIST=1 POSUNIT=PRIMARY CORUNIT=PRIMARY\n1\n:END"
    assert refused(text, format="aerotech-cal", **TOLD).allowed == "at least 2"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_comments_and_blanks_change_nothing(end: str) -> None:
    text = "﻿' another comment\n\n" + SAMPLE.replace("\n", " \t" + end).replace("-2.1 ", "-2.1\t  ")
    assert parse(text, **TOLD).table == parse(SAMPLE, **TOLD).table


def test_blanks_around_an_equals_sign_and_a_serial_number() -> None:
    loose = SAMPLE.replace("SAMPLEDIST=25", "SAMPLEDIST = 25").replace("HOMEOFFSET=0", "HOMEOFFSET =\t0")
    loose = loose.replace("HOMEDIRECTION", 'SERIALNUMBER="1-47" HOMEDIRECTION')
    assert loose.count(" = ") == 1
    loaded = parse(loose, **TOLD)
    assert loaded.table == parse(SAMPLE, **TOLD).table
    assert (
        loaded.source.decisions[-1]
        == 'check that this is the stage with SERIALNUMBER="1-47": the table was made for it'
    )
    # a value that is missing does not take the next word
    error = refused(SAMPLE.replace("SAMPLEDIST=25", "SAMPLEDIST ="), format="aerotech-cal", **TOLD)
    assert "'SAMPLEDIST' after :START" in str(error)


def test_travel_proves_a_wrong_start() -> None:
    assert "outside travel" in str(refused(SAMPLE, travel=(-500.0, -150.0), units=Units.MM, **TOLD))


TABLE = make_table([-5.0, 0.0, 5.0], [0.002, 0.0, -0.001], [0.001, 0.0, -0.003], Units.MM)


def test_text_of_the_writer() -> None:
    written = dialect_named("aerotech-cal").write(TABLE, WriteOptions(axis="x"))
    # means 1.5, 0 and -2 um
    assert written.text.splitlines()[3:] == [
        ":START x MASTER=x SAMPLEDIST=5 POSUNIT=PRIMARY CORUNIT=PRIMARY/1000",
        "1.500000 0.000000 -2.000000",
        ":END",
    ]
    assert any("lost motion of up to 0.002 mm" in loss for loss in written.losses)
    assert any("file_start -5" in loss for loss in written.losses)
    assert any("HOMEDIRECTION" in loss for loss in written.losses)
    for old, new in (("1.500000", "1.500001"), ("=5 ", "=6 "), (":END", ":end")):
        with pytest.raises(TabFileError, match="changed after"):
            parse_table(written.text.replace(old, new).encode(), "x.cal", written.context)


@st.composite
def _tables(draw: st.DrawFn) -> CorrectionTable:
    size = draw(st.integers(2, 40))
    step = draw(st.sampled_from([1.0, 0.3, 25.4, 10.0]))
    first = draw(st.integers(-50, 50)) * step
    values = draw(st.lists(st.floats(-0.1, 0.1), min_size=size, max_size=size))
    return make_table([first + i * step for i in range(size)], values, values, draw(st.sampled_from(Units)))


@given(_tables())
def test_a_table_of_one_direction_comes_back(table: CorrectionTable) -> None:
    _, again = there_and_back("aerotech-cal", table, axis="a", file_axis="1")
    assert_same(again.table, table, 0.51e-9)  # half of the sixth decimal of a thousandth
