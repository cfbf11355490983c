"""Mint programs: the published example, the exact inverse, what a program may and may not do."""

from pathlib import Path
from typing import Any

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import LoadedTable, TabFileError, explain
from tests.tabfile.texts import Texts

SAMPLE = (Path(__file__).parents[2] / "tables" / "mint" / "leadscrew.mnt").read_text()
SINGLE = "DIM fwd(3) = 10.02, 20.01, 30.00\nPRECISIONTABLE(0, fwd)\nPRECISIONINCREMENT.0 = 10\n"
FILE = Texts("program.mnt", {"file_units": Units.MM})
parse, refused = FILE.parse, FILE.refused


def single(more: str = "", **facts: Any) -> LoadedTable:
    return parse(SINGLE + more, **{"file_start": 0.0, **facts})


def test_checked_vector_of_the_exact_inverse() -> None:
    explained = explain(parse(SAMPLE), 10.0).forward
    # the motor is at 10 when the nut is at 10.02, so for the nut at 10 it is at 100 / 10.02
    assert explained.corrected == pytest.approx(9.980040, abs=5e-7)
    assert explained.correction == pytest.approx(100 / 10.02 - 10, abs=1e-12)
    assert "exact inverse" in explained.rule


def test_points_of_both_directions_are_all_points_of_the_table() -> None:
    loaded = parse(SAMPLE)
    assert list(loaded.table.positions) == [0, 10.01, 10.02, 20.01, 20.02, 29.99, 30.0, 40.0, 40.01, 50.01]
    lines = [(row.position, row.forward_line, row.backward_line) for row in loaded.source.rows]
    assert lines[:4] == [(0.0, None, None), (10.01, None, 2), (10.02, 1, None), (20.01, 1, None)]
    assert lines[-1] == (50.01, 1, 2)


@pytest.mark.parametrize(
    ("at", "forward", "backward"),
    [
        # points of each: i x 10 - entry
        (10.02, -0.02, -0.01 + 0.01 * (-0.02 + 0.01) / 10.01),
        (20.01, -0.01, -0.02 + 0.01 * 0.01 / 10.01),
        (30.0, 0.0, 0.01 - 0.01 * 0.01 / 10.01),
        (50.01, -0.01, -0.01),
        # halfway on the first stretch: half of -0.02, half of -0.01
        (5.01, -0.01, -0.01 * 5.01 / 10.01),
        # behind the last point it stays
        (60.0, -0.01, -0.01),
    ],
)
def test_corrections_by_hand(at: float, forward: float, backward: float) -> None:
    explained = explain(parse(SAMPLE), at)
    assert explained.forward.correction == pytest.approx(forward, abs=1e-12)
    assert explained.backward.correction == pytest.approx(backward, abs=1e-12)


def test_points_of_both_directions_that_nearly_coincide_are_one() -> None:
    loaded = parse(SAMPLE.replace("= 10.01,", "= 10.0200004,"))
    assert [row[5:] for row in loaded.source.rows][:2] == [(None, None), (1, 2)]
    assert loaded.table.positions[1] == 10.02
    assert loaded.table.backward[1] == pytest.approx(-0.0200004, abs=1e-9)


def test_mark_a_moves_the_table() -> None:
    program = SAMPLE.replace("PRECISIONOFFSET.0 = 0", "PRECISIONOFFSET.0 = -25.5")
    loaded = parse(program, file_start=-25.5)
    assert [loaded.table.first, loaded.table.last] == pytest.approx([-25.5, 24.51], abs=1e-12)
    assert explain(loaded, -15.48).forward.correction == pytest.approx(-0.02, abs=1e-12)
    assert "R9" not in {lint.code for lint in loaded.lints}


OFFSET_5 = SAMPLE.replace("PRECISIONOFFSET.0 = 0", "PRECISIONOFFSET.0 = 5")


def test_an_offset_is_refused_until_file_start_tells_where_mark_a_lies() -> None:
    """MN1270 3.4.2 adds the offset to a position (A at -5); its keyword page calls it A's place (at 5)."""
    error = refused(OFFSET_5)
    assert error.line == 5
    assert error.problems[0].code == "R9"
    # A at 5: 7 is 2 from A; the nut is there with the motor at 2 x 10 / 10.02 = 1.996008 from A.
    # A at -5: 7 is 12 from A; the motor is at 10 + (12 - 10.02) / (20.01 - 10.02) x 10 = 11.981982 from A.
    plus, minus = error.readings
    assert "A at 5 mm" in plus
    assert "7 is sent as 6.99601" in plus
    assert "A at -5 mm" in minus
    assert "7 is sent as 6.98198" in minus
    assert "file_start = 5 or file_start = -5" in error.allowed


@pytest.mark.parametrize(("start", "out"), [(5.0, 6.996008), (-5.0, 6.981982)])
def test_file_start_takes_either_reading_of_an_offset(start: float, out: float) -> None:
    loaded = parse(OFFSET_5, file_start=start)
    assert loaded.table.first == start
    assert explain(loaded, 7.0).forward.corrected == pytest.approx(out, abs=5e-7)
    assert "R9" not in {lint.code for lint in loaded.lints}


@pytest.mark.parametrize(("start", "nut"), [(5.0, 7.004), (-5.0, 7.018)])
def test_what_r9_advises_to_prove_tells_the_readings_of_an_offset_apart(start: float, nut: float) -> None:
    """Compensation off, drive at 7: 2 from A the nut is at 2 x 10.02 / 10, 12 from A at 10.02 + 2 x 0.999."""
    corrected = explain(parse(OFFSET_5, file_start=start), 7.0).forward.corrected
    # as far to one side of 7 as the figure lies to the other, to first order
    assert nut - 7.0 == pytest.approx(7.0 - corrected, abs=5e-5)


def test_file_start_that_is_neither_reading_of_an_offset_is_refused() -> None:
    error = refused(OFFSET_5, file_start=4.0)
    assert "PRECISIONOFFSET 5, but file_start is 4" in error.found
    assert error.line == 5


def test_readings_of_an_offset_are_told_in_units_of_the_axis() -> None:
    error = refused(OFFSET_5, file_units=Units.INCH, units=Units.MM)
    assert "file_start = 127 or file_start = -127" in error.allowed


def test_a_place_beyond_the_table_of_one_reading_is_said_to_get_nothing() -> None:
    # 100 + 2 is 202 from A where A lies at -100: the table ends at 50.01
    error = refused(SAMPLE.replace("PRECISIONOFFSET.0 = 0", "PRECISIONOFFSET.0 = 100"))
    assert "102 is sent as 101.99601" in error.readings[0]
    assert "102 is sent unchanged" in error.readings[1]


def test_an_increment_that_stands_only_in_a_figure_is_told() -> None:
    text = SINGLE.replace("PRECISIONINCREMENT.0 = 10\n", "")
    assert list(parse(text, file_start=0.0, increment=10.0).table.positions) == [0, 10.02, 20.01, 30.0]
    error = refused(text, file_start=0.0)
    assert "--increment" in error.allowed
    # told in mm for a program in inches
    told = parse(text, file_start=0.0, increment=254.0, file_units=Units.INCH, units=Units.MM)
    assert told.table.positions[1] == 10.02
    assert "from increment" in str(told.source.decisions)


def test_an_increment_that_contradicts_the_program_is_refused() -> None:
    error = refused(SINGLE, file_start=0.0, increment=5.0)
    assert "PRECISIONINCREMENT 10, but increment = 5" in error.found
    assert error.line == 3
    assert single(increment=10.0).table.last == 30.0


def test_mark_a_must_be_known() -> None:
    with pytest.raises(TabFileError, match="the position of mark A"):
        single(file_start=None)
    assert single(file_start=-30.0).table.first == -30.0


def test_units_must_be_told() -> None:
    refused(SAMPLE, "states no units", file_units=None)


def test_single_table_serves_both_directions() -> None:
    loaded = single()
    assert loaded.table.is_unidirectional
    assert list(loaded.table.forward) == pytest.approx([0.0, -0.02, -0.01, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        SINGLE.replace("PRECISIONINCREMENT.0 = 10", "PRECISIONINCREMENT(0) = 10"),
        SINGLE.replace("PRECISIONINCREMENT.0 = 10", "precisionincrement[0, 1] = 10, 5"),
        SINGLE.replace("PRECISIONINCREMENT.0 = 10", "PRECISIONINCREMENT = +10.0"),
        SINGLE.replace("\n", " : "),
        SINGLE.replace("\n", " : REM Table\n"),
        SINGLE.replace("\n", "  ' the table\n"),
        SINGLE.replace("20.01,", "20.01, _\n"),
        SINGLE.replace("20.01,", "20.01, \\ ' goes on\n\t"),
        SINGLE.replace("DIM fwd(3) =", "Dim FWD (3) As Float ="),
        SINGLE + "PRECISIONMODE.0 = 0\nPRECISIONMODE.0 = 1\n",
        'AXES[0, 1, 2]\nPRINT "PRECISIONTABLE(0, fwd)"\nFOR i = 1 TO 3\nSPEED.0 = i\nNEXT\n' + SINGLE,
        "IF DRIVEENABLE.0 THEN\n BEEP\nEND IF\nIF x = 1 THEN BEEP\n" + SINGLE,
        SINGLE.replace("\n", "\r\n"),
        SINGLE.replace("\n", "\r"),
        "﻿" + SINGLE.replace("\n", "\t \n") + "\n\n",
    ],
)
def test_ways_to_write_the_same(text: str) -> None:
    loaded = parse(text, file_start=0.0)
    assert list(loaded.table.positions) == [0.0, 10.02, 20.01, 30.0]
    assert list(loaded.table.forward) == pytest.approx([0.0, -0.02, -0.01, 0.0], abs=1e-12)


def test_values_know_their_own_lines() -> None:
    loaded = parse(SINGLE.replace("20.01,", "20.01, _\n"), file_start=0.0)
    assert [row.forward_line for row in loaded.source.rows] == [None, 1, 1, 2]


CALL = "PRECISIONTABLE(0, fwd)"
STEP = "PRECISIONINCREMENT.0 = 10"


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ("fwd(3)", "fwd(4)", 1, "3 values in FWD(4)"),
        ("10.02, 20.01", "10.02", 1, "2 values in FWD(3)"),
        ("10.02", "10,02", 1, "4 values in FWD(3)"),
        ("20.01", "10.02", 1, "L11 forward position 10.02 of entry 2 after 10.02"),
        ("10.02", "-10.02", 1, "L11 forward position -10.02 of entry 1 after 0"),
        ("20.01", "a + 1", 1, "no expression"),
        ("20.01", "20 + .01", 1, "no expression"),
        ("20.01", "20.0.1", 1, "'20.0.1'"),
        ("30.00", "30:00", 1, "a statement that begins with '00'"),
        ("20.01", "", 1, "decimal number"),
        ("DIM fwd(3) =", "DIM fwd(3)", 1, "allowed: ="),
        ("DIM fwd", "DIM rev", 2, "an array FWD without values"),
        (CALL, "PRECISIONTABLE(x, fwd)", 2, "the number of an axis"),
        (CALL, "PRECISIONTABLE(0, fwd", 2, "allowed: , or )"),
        (CALL, "PRECISIONTABLE(0, fwd) 1", 2, "end of the statement"),
        (CALL, "PRECISIONTABL(0, fwd)", None, "without a statement that begins with PRECISIONTABLE"),
        (CALL, "PRECISIONTABLE(1, fwd)", 2, "axis 1 without PRECISIONINCREMENT"),
        (STEP, "", 2, "without PRECISIONINCREMENT"),
        (STEP, "PRECISIONINCREMENT.0 = -10", 3, "a distance above 0"),
        (STEP, "PRECISIONINCREMENT.0 = inc", 3, "decimal number"),
        (STEP, "PRECISIONINCREMENT.0.5 = 10", 3, "PRECISIONINCREMENT.axis = value"),
        (STEP, "PRECISIONINCREMENT[0,1] = 10", 3, "1 values for 2 axes"),
        (STEP, f"{STEP}\nPRECISIONINCREMENT.0 = 9", 4, "10 on line 3"),
        (STEP, "IF a THEN\nPRECISIONINCREMENT.0 = 10\nENDIF", 4, "an IF, a loop"),
        (STEP, "IF a THEN b = 1 : PRECISIONINCREMENT.0 = 10", 3, "an IF, a loop"),
        (STEP, "IF a THEN PRECISIONINCREMENT.0 = 10", 3, "a statement with"),
        (STEP, f"{STEP}\nfwd(2) = 20.02", 4, "a statement with FWD"),
        (STEP, f"{STEP}\nGOTO start", 1, "with GOTO"),
        (STEP, f"{STEP}\nPCI.0 = 9", 4, "the short form"),
        (STEP, f"{STEP}\nPRECISIONNODE.0 = 1", 4, "nearly PRECISIONMODE"),
        (STEP, f"{STEP}\nBACKLAS.0 = 0.01", 4, "nearly BACKLASH"),
        (STEP, f"{STEP}\nPRECISIONTABLE(0, fwd)", 4, "a second"),
        (STEP, f"{STEP}\nDIM fwd(1) = 3", 4, "a second DIM"),
        (STEP, f"{STEP}\nPRECISIONMODE.0 = _lsDUAL_TABLE", 4, "DUAL"),
        (STEP, f"{STEP}\nBACKLASHINTERVAL.0 = 2.5", 4, "a whole number"),
        (STEP, f"{STEP}\nBACKLASH.0 = 1\nBLM.0 = 7", 5, "_blON"),
    ],
)
def test_what_is_not_of_the_grammar_is_refused_by_line(old: str, new: str, line: int, found: str) -> None:
    assert old in SINGLE
    assert found in str(refused(SINGLE.replace(old, new), file_start=0.0, line=line))


def test_tables_of_different_length_are_refused() -> None:
    text = SAMPLE.replace("revTable (5)", "revTable (4)").replace(", 40.00, 50.01", ", 40.00")
    refused(text, "5 forward and 4 reverse")


def test_several_axes_need_a_name() -> None:
    text = SAMPLE + "DIM y(2) = 5.01, 10.02\nPRECISIONTABLE(1, y)\nPRECISIONINCREMENT.1 = 5\n"
    text = text.replace("PRECISIONOFFSET.0 = 0", "PRECISIONOFFSET[0, 1] = 0, 0")
    refused(text, "the axes 0, 1")
    assert list(parse(text, file_axis="1").table.forward) == pytest.approx([0, -0.01, -0.02], abs=1e-12)
    assert parse(text, file_axis="0").table.last == 50.01
    refused(text, "but file_axis = '2'", file_axis="2")
    refused(
        text.replace("PRECISIONINCREMENT.0", "PRECISIONINCREMENT"),
        "PRECISIONINCREMENT without an axis",
        file_axis="0",
    )


def test_mode_decides_whether_the_reverse_table_counts() -> None:
    loaded = parse(SAMPLE.replace("_lsDUAL_TABLE", "_lsSINGLE_TABLE"))
    assert loaded.table.is_unidirectional
    assert list(loaded.table.positions) == [0.0, 10.02, 20.01, 30.0, 40.01, 50.01]
    assert not parse(SAMPLE.replace("_lsDUAL_TABLE", "2")).table.is_unidirectional
    # 1 is the single table, but with two of them it is better spelled out
    refused(SAMPLE.replace("_lsDUAL_TABLE", "1"), r"PRECISIONMODE 1 with 2 table\(s\)")


def test_program_that_ends_with_compensation_off_is_remarked_on() -> None:
    loaded = parse(SAMPLE.replace("_lsDUAL_TABLE", "_lsOFF"))
    assert not loaded.table.is_unidirectional
    assert [lint.line for lint in loaded.warnings if lint.code == "R11"] == [7]
    assert "R11" not in {lint.code for lint in parse("PRECISIONMODE.0 = 0\n" + SAMPLE).lints}


def test_backlash_beside_one_table_becomes_settings_of_the_axis() -> None:
    on = "BACKLASH.0 = 0.02\nBACKLASHINTERVAL.0 = 200\nBACKLASHMODE.0 = 1\n"
    loaded = single(on)
    # positive: moving forward takes the whole size, moving back nothing
    assert loaded.source.behaves_as == (
        'outside = "zero"',
        'backlash = { width = 0.02, kind = "homed-backward" }',
        "reversal = { cycles = 200 }",
    )
    assert [lint.line for lint in loaded.warnings if lint.code == "R8"] == [4]
    assert loaded.table.is_unidirectional
    negative = single(on.replace("0.02", "-0.02")).source.behaves_as
    assert 'backlash = { width = 0.02, kind = "homed-forward" }' in negative
    # in units of the axis
    inches = single(on, file_units=Units.INCH, units=Units.MM, file_start=0.0)
    assert 'backlash = { width = 0.508, kind = "homed-backward" }' in inches.source.behaves_as
    off = single(on.replace("BACKLASHMODE.0 = 1", "BLM.0 = _blOFF")).source
    assert off.behaves_as == ('outside = "zero"', "reversal = { cycles = 200 }")
    assert any("does not count" in decision for decision in off.decisions)


def test_backlash_of_the_guide_names_several_axes() -> None:
    loaded = single("BACKLASH[0,1] = 0.01, -0.2\n")
    assert 'backlash = { width = 0.01, kind = "homed-backward" }' in loaded.source.behaves_as


def test_backlash_beside_two_tables_is_refused() -> None:
    refused(
        SAMPLE.replace("_blOFF", "_blON") + "BACKLASH.0 = 0.02\n", "already contain the lost motion", line=8
    )
    parse(SAMPLE + "BACKLASH.0 = 0.02\n")


def test_outside_is_zero_only_where_that_makes_no_step() -> None:
    assert single().source.behaves_as == ('outside = "zero"',)
    stepping = parse(SAMPLE).source
    assert not any("outside" in line for line in stepping.behaves_as)
    assert any("jump by 0.01 mm" in decision for decision in stepping.decisions)


def test_other_statements_are_counted() -> None:
    decisions = single("SPEED.0 = 10\nMOVEA.0 = 3 : GO.0\n").source.decisions
    assert any(decision.startswith("3 other statements") for decision in decisions)


def test_published_numbers_make_negative_backlash_and_are_remarked_on() -> None:
    # fwd 10.02 above rev 10.01: the guide's numbers are made up
    loaded = parse(SAMPLE)
    assert loaded.errors == ()
    assert loaded.table.forward[2] - loaded.table.backward[2] == pytest.approx(-0.01, abs=1e-4)


def test_travel_is_checked() -> None:
    refused(SAMPLE, "outside travel", travel=(-50.0, -1.0))
    assert parse(SAMPLE, travel=(0.0, 60.0), units=Units.MM).table.last == 50.01
