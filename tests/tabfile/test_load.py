"""Files by sight, what is told of them in other units, and lines as long as a file may be."""

import re
from typing import Any

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, FileContext, TabFileError, parse_table
from tests.tabfile.texts import Texts


@pytest.mark.parametrize(
    ("text", "line", "found", "allowed"),
    [
        ("#1\nDEFINE BLCOMP 4,4000\n16 16 16 16\n", 2, "PMAC backlash", "negative direction only"),
        ("#1 def tcomp 4,4000\n16 16 16 16\n", 1, "PMAC torque", "not positions"),
        ("#\r\nND-280      MM    \r\nAXIS X1  = 0\r\n", 2, "Heidenhain display unit", "power of two"),
        ("*\nCOMP. NO. 001 = +0.0000\n", 2, "Heidenhain display unit", "position_mm,error_um"),
        ("%\nN3620P40\nN3621P33\n", 2, "Fanuc", "fanuc-csv"),
        ("%\nN10033Q1P-2\n", 2, "Fanuc", "3620 to 3624"),
        ("# encoder\nPREC=5\n-10 -10.1\n0 0.1\n", 2, "ecmc", "correction_mm"),
        ("STARTW\n0.0=0.0\n10.0=10.002\nEND\n", 1, "COMP.ERR", "right number minus the left"),
        ("[ScrewMap0]\nPoints=3\n", 1, "Mach3 or Mach4", "one test move"),
    ],
)
def test_a_file_of_a_system_that_is_not_read_is_named_with_what_to_do(
    text: str, line: int, found: str, allowed: str
) -> None:
    for told in (None, "csv"):
        with pytest.raises(TabFileError) as caught:
            parse_table(text.encode(), "x.tab", FileContext(format=told))
        assert found in caught.value.found
        assert caught.value.found.endswith("which is not read")
        assert allowed in caught.value.allowed
        assert caught.value.line == line


def test_a_siemens_table_without_its_equals_signs_is_told_what_is_missing() -> None:
    text = "%_N_AX_EEC_INI\n$AA_ENC_COMP[0,0,X1] 0.003\n$AA_ENC_COMP[0,1,X1] 0.01\nM17\n"
    with pytest.raises(TabFileError) as caught:
        parse_table(text.encode(), "x.ini", FileContext(file_units=Units.MM))
    assert "$AA_ENC_COMP[e,N,axis]=value" in caught.value.allowed
    assert caught.value.line == 2


# What an option is told in, where the file has other units than the axis: a remedy taken literally helps.


FANUC = "3620,1\n3621,1\n3622,2\n3623,1\n3624,1\npoint,value\n1,2\n2,5\n"
REN = (
    "Compensation start 0\nCompensation end 2\nCompensation spacing 1\nNo. Axis position Combined\n"
    "1 0 0\n2 1 5\n3 2 3\n"
)
CSV = "position_inch,correction_inch\n-2,0\n-1,0.0005\n0,0\n"
V2 = "2 2 1.0 20 50000 -2.0\n0\n5\n0\n; backward\n0\n5\n0\n"
V2_INFERRED = "2 4 1.0 20 1 0\n0\n5\n0\n5\n0\n; backward\n0\n5\n0\n5\n0\n"
V2_OTHER_SIDE = V2.replace("-2.0", "0.0")
MINT = "DIM f(2) = 1.001, 2\nPRECISIONTABLE(0, f)\nPRECISIONINCREMENT = 1\nPRECISIONOFFSET = -2\n"
FILE = Texts("x", {"units": Units.MM})
parse, refused = FILE.parse, FILE.refused


@pytest.mark.parametrize("text", [FANUC, REN])
def test_a_scale_is_asked_for_per_unit_of_the_axis(text: str) -> None:
    error = refused(text, file_units=Units.INCH)
    assert re.search(r"\bper mm\b|\bin one mm\b", error.allowed)
    # 10 000 to the inch; the largest number is 5, in a sum of Fanuc's and as it stands in the other
    loaded = parse(text, file_units=Units.INCH, file_counts_per_unit=10_000 / 25.4)
    assert max(loaded.table.forward) == pytest.approx(0.0005, rel=1e-12)


def test_what_a_scale_per_unit_of_the_axis_makes_is_said() -> None:
    loaded = parse(FANUC, file_units=Units.INCH, file_counts_per_unit=1000.0)
    assert (
        "25400 counts per inch: file_counts_per_unit is given per mm, the unit of the axis"
        in loaded.source.decisions
    )
    same = parse(FANUC, file_units=Units.MM, file_counts_per_unit=1000.0)
    assert not any("counts per" in decision for decision in same.source.decisions)


@pytest.mark.parametrize(
    ("text", "facts"),
    [(CSV, {}), (MINT, {"file_units": Units.INCH}), (V2_OTHER_SIDE, {"travel": (-50.8, 0.0)})],
)
def test_a_start_that_a_message_names_is_one_that_is_taken(text: str, facts: dict[str, Any]) -> None:
    wrong: dict[str, Any] = {} if "travel" in facts else {"file_start": 10.0}
    error = refused(text, **facts, **wrong)
    named = re.search(r"file_start = (-?[0-9.]+)", error.allowed)
    assert named is not None
    # -2 inch
    assert float(named[1]) == pytest.approx(-50.8, rel=1e-9)
    assert parse(text, **facts, file_start=float(named[1])).table.first == pytest.approx(-2.0, rel=1e-9)


def test_an_inferred_start_is_confirmed_in_units_of_the_axis() -> None:
    (remark,) = (lint for lint in parse(V2_INFERRED, travel=(-50.8, 50.8)).lints if lint.code == "R2")
    assert "file_start = -50.8" in remark.message
    confirmed = parse(V2_INFERRED, travel=(-50.8, 50.8), file_start=-50.8)
    assert confirmed.table.first == pytest.approx(-2.0)
    assert "R2" not in {lint.code for lint in confirmed.lints}


# Lines as long as a file may be are gone through once: with every place tried against every other one,
# these would take hours, in which the gateway that reloads a table could not answer.


LONG = 1_000_000
FAGOR = f"P001 X-20 EX 0.1\nP002 X{'1' * LONG} Q\nP003 X1 EX 1\n"
COMMENTS = f"kw.ssfk.unit 1{' /**/' * LONG}\n"
COLUMNS = f"BEGIN X .COM MM\nNR AXISPOS {'X ' * LONG}\n[END]\n"
AXES = "".join(f"$AA_ENC_COMP[0,0,A{index}]=1\n" for index in range(100_000)) + "M17\n"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (FAGOR, "P002 X111"),
        (COMMENTS, "no kw.ssfk.interval"),
        (COLUMNS, "column 'X'"),
        (AXES, "tables of A0"),
    ],
    ids=["digits", "comments", "columns", "axes"],
)
def test_a_very_long_line_is_an_error_like_a_short_one(text: str, found: str) -> None:
    context = FileContext(units=Units.MM, file_units=Units.MM, error_sense=ErrorSense.ACTUAL_MINUS_COMMAND)
    with pytest.raises(TabFileError, match=found) as caught:
        parse_table(text.encode(), "x", context)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("position", ["1e9", "-1e300", "1.7e308"])
def test_a_position_that_no_machine_has_is_refused(position: str) -> None:
    ends = sorted(("0", position), key=float)
    text = "position_mm,correction_mm\n" + "".join(f"{end},0\n" for end in ends)
    with pytest.raises(TabFileError, match="a position of "):
        parse_table(text.encode(), "x.csv", FileContext(units=Units.MM))
