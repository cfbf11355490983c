"""Siemens _EEC_INI files: the manual's example, sign, gaps, several tables, turns, what is written."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import FileContext, WriteOptions, dialect_named, explain
from tests.tabfile.drawn import assert_same, means_of, there_and_back
from tests.tabfile.texts import Texts

SAMPLE = (Path(__file__).parents[2] / "tables" / "siemens" / "_N_AX_EEC_INI.ini").read_text()
FILE = Texts("eec.ini", {"file_units": Units.MM})
parse, refused = FILE.parse, FILE.refused


def program(values: list[float], axis: str = "C1", encoder: int = 0, modulo: int = 0) -> str:
    lines = [f"$AA_ENC_COMP[{encoder},{n},{axis}]={value}" for n, value in enumerate(values)]
    inside = f"[{encoder},{axis}]"
    last = 90 * (len(values) - 1)
    return "\n".join(
        [
            *lines,
            f"$AA_ENC_COMP_STEP{inside}=90",
            f"$AA_ENC_COMP_MIN{inside}=0",
            f"$AA_ENC_COMP_MAX{inside}={last}",
            f"$AA_ENC_COMP_IS_MODULO{inside}={modulo}",
        ]
    )


def test_value_is_subtracted_in_both_directions() -> None:
    loaded = parse(SAMPLE)
    explained = explain(loaded, -199.0, counts_per_unit=1000.0)
    # a positive value of 0.01 moves the axis by 0.01 in the negative direction
    assert explained.forward.correction == explained.backward.correction == -0.01
    assert (explained.forward.nominal_counts, explained.forward.counts) == (-199000, -199010)
    # halfway between 0.01 and 0.012
    assert explain(loaded, -198.5).forward.correction == pytest.approx(-0.011, abs=1e-15)
    assert explain(loaded, -198.5).forward.file_value == pytest.approx(0.011, abs=1e-15)
    assert "subtracted" in explained.forward.rule
    assert explained.forward.low.forward_line == 4


def test_all_801_points_of_the_manual() -> None:
    # the manual prints 0.003, 0.01, 0.012 at -200, -199, -198 and 0 at 600
    values = [0.003, 0.01, 0.012, *(0.012 * (1 - n / 798) for n in range(1, 798)), -0.0]
    text = (
        "%_N_AX_EEC_INI\nCHANDATA(1)\n"
        + "\n".join(f"$AA_ENC_COMP[0,{n},X1]={value:.6f}" for n, value in enumerate(values))
        + "\n$AA_ENC_COMP_STEP[0,X1]=1.0\n$AA_ENC_COMP_MIN[0,X1]=-200.0\n$AA_ENC_COMP_MAX[0,X1]=600.0"
        + "\n$AA_ENC_COMP_IS_MODULO[0,X1]=0\nM17\n"
    )
    loaded = parse(text)
    assert len(loaded.table.positions) == 801
    assert (loaded.table.first, loaded.table.last, loaded.table.even_step) == (-200.0, 600.0, 1.0)
    assert explain(loaded, -200.0).backward.correction == -0.003
    assert explain(loaded, 600.0).forward.correction == 0.0


def test_control_holds_outside() -> None:
    loaded = parse(SAMPLE)
    assert loaded.source.behaves_as == ('outside = "hold"',)
    assert explain(loaded, -300.0).forward.correction == -0.003


def test_units_must_be_told() -> None:
    refused(SAMPLE, "states no units", file_units=None)


@pytest.mark.parametrize(
    "text",
    [
        SAMPLE.replace("%_N_AX_EEC_INI", "%_N_AX1_EEC_INI\n;$PATH=/_N_NC_ACT"),
        SAMPLE.replace("%_N_AX_EEC_INI\nCHANDATA(1)\n", ""),
        SAMPLE.replace("=", " = ").replace(",", " , "),
        SAMPLE.lower(),
        SAMPLE.replace("0.01 ;", "1EX-2;").replace("0.003", "+.3EX-02"),
        SAMPLE.replace("M17", "M30 ; end\n\n; text\n"),
        SAMPLE.replace("\n", "\r\n"),
        SAMPLE.replace("\n", "\r"),
        "﻿" + SAMPLE.replace("\n", " \t\n"),
        "\n".join([*SAMPLE.splitlines()[:2], *SAMPLE.splitlines()[2:11][::-1], "M17"]),
    ],
)
def test_ways_to_write_the_same(text: str) -> None:
    loaded = parse(text)
    assert list(loaded.table.positions) == [-200.0, -199.0, -198.0, -197.0, -196.0]
    assert list(loaded.table.forward) == [-0.003, -0.01, -0.012, -0.006, 0.0]


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ("[0,2,X1]", "[0,5,X1]", 10, "1 of 5 points of [0,X1] missing: 2"),
        ("[0,2,X1]", "[0,1,X1]", 5, "a second value (the first is on line 4)"),
        ("$AA_ENC_COMP[0,2,X1]=0.012", "", 10, "missing: 2"),
        ("_MAX[0,X1]=-196.0", "_MAX[0,X1]=-197.0", 7, "beyond MAX, which is point 3: 4"),
        ("_MAX[0,X1]=-196.0", "_MAX[0,X1]=-195.0", 10, "missing: 5"),
        (
            "_MAX[0,X1]=-196.0",
            "_MAX[0,X1]=-180.0",
            10,
            "16 of 21 points of [0,X1] missing: 5, 6, 7, 8, 9, 10",
        ),
        ("_MAX[0,X1]=-196.0", "_MAX[0,X1]=-195.5", 8, "4.5 steps"),
        ("_MAX[0,X1]=-196.0", "_MAX[0,X1]=-200.0", 10, "MIN below MAX"),
        ("_STEP[0,X1]=1.0", "_STEP[0,X1]=0", 8, "a distance above 0"),
        ("_STEP[0,X1]=1.0", "_STEP[0,X1]=1e-9", 8, "steps of 1e-09"),
        ("_STEP[0,X1]=1.0", "_STEP[0,X1]=0.5", 10, "4 of 9 points"),
        ("_STEP[0,X1]=1.0", "_STEP[0,2,X1]=1.0", 8, "a wrong number of indices"),
        ("[0,2,X1]", "[0,X1]", 5, "a wrong number of indices"),
        ("0.012", "0,012", 5, "'0,012'"),
        ("0.012", "0.012 0.013", 5, "something else"),
        ("0.012", "R1", 5, "'R1'"),
        ("0.012", "", 5, "something else"),
        ("IS_MODULO[0,X1]=0", "IS_MODULO[0,X1]=2", 11, "0 or 1"),
        ("IS_MODULO[0,X1]=0", "IS_MODULO[0,X1]=1", 7, "0.003 at MIN and -0 at MAX"),
        ("$AA_ENC_COMP_MIN[0,X1]=-200.0\n", "", None, "no $AA_ENC_COMP_MIN[0,X1]"),
        ("$AA_ENC_COMP_IS_MODULO[0,X1]=0", "", None, "no $AA_ENC_COMP_IS_MODULO[0,X1]"),
        ("M17\n", "", 11, "without M17"),
        ("M17", "M17\n$AA_ENC_COMP[0,5,X1]=0", 13, "a line after the end"),
        ("M17", "M17\nM17", 13, "a line after the end"),
        ("M17", "N10 G0 X1\nM17", 12, "something else"),
        ("CHANDATA(1)\n", "%_N_AX_EEC_INI\n", 2, "something else"),
    ],
)
def test_what_is_not_of_the_grammar_is_refused_by_line(old: str, new: str, line: int, found: str) -> None:
    assert old in SAMPLE
    assert found in str(refused(SAMPLE.replace(old, new, 1), line=line))


def test_no_values_at_all() -> None:
    refused("%_N_AX_EEC_INI\nCHANDATA(1)\nM17\n", "no compensation values")


@pytest.mark.parametrize(
    "text",
    [
        "%_N_NC_CEC_INI\nCHANDATA(1)\n$AN_CEC[0,0]=0\nM17\n",
        SAMPLE.replace("M17", "$AN_CEC_DIRECTION[0]=1\nM17"),
        "$AN_CEC_STEP[0]=1\nM17\n",
    ],
)
def test_sag_compensation_is_refused_by_name(text: str) -> None:
    refused(text, r"sag compensation \(CEC\)")


def test_several_tables_need_a_name() -> None:
    text = "\n".join(
        [
            program([0.01, 0.02, 0.01]),
            program([0.03, 0.01], encoder=1),
            program([0.04, 0.0], axis="Y1"),
            "M17",
        ]
    )
    refused(text, "tables of 0,C1, Y1, 1,C1")
    assert list(parse(text, file_axis="0,c1").table.forward) == [-0.01, -0.02, -0.01]
    assert list(parse(text, file_axis="1, C1").table.forward) == [-0.03, -0.01]
    assert list(parse(text, file_axis="Y1").table.forward) == [-0.04, 0.0]
    assert list(parse(text, file_axis="0,Y1").table.forward) == [-0.04, 0.0]
    refused(text, "but file_axis = 'C1'", file_axis="C1")
    parse(SAMPLE, file_axis="x1")
    refused(SAMPLE, "file_axis = X1", file_axis="Y1")


def test_letter_of_the_axis_is_compared() -> None:
    assert "L10" in {lint.code for lint in parse(SAMPLE, axis="y").lints}
    assert "L10" not in {lint.code for lint in parse(SAMPLE, axis="x").lints}
    assert "L10" not in {lint.code for lint in parse(SAMPLE.replace("X1", "AX2"), axis="y").lints}


def test_turn_that_closes_becomes_a_setting_of_the_axis() -> None:
    text = program([0.001, -0.002, 0.0, 0.002, 0.001], modulo=1) + "\nM17"
    loaded = parse(text, file_units=Units.DEGREE)
    assert loaded.source.behaves_as == ("modulo = 360",)
    assert explain(loaded, 90.0).forward.correction == 0.002
    refused(
        text.replace("=-0.002", "=0").replace("4,C1]=0.001", "4,C1]=0.002"),
        "would jump",
        file_units=Units.DEGREE,
    )


def test_start_and_travel_are_checked() -> None:
    parse(SAMPLE, file_start=-200.0)
    refused(SAMPLE, "file_start is 0", file_start=0.0)
    refused(SAMPLE, "mirror", travel=(0.0, 200.0))


@given(
    st.lists(st.tuples(st.integers(-99_999, 99_999), st.integers(-99_999, 99_999)), min_size=2, max_size=50),
    st.sampled_from([0.1, 1.0, 25.4, 30.0, 1 / 3]),
    st.integers(-50, 50),
    st.sampled_from(list(Units)),
)
def test_what_is_written_is_read_back(
    points: list[tuple[int, int]], step: float, first: int, units: Units
) -> None:
    positions = [(first + index) * step for index in range(len(points))]
    forward, backward = ([point[column] * 2e-8 for point in points] for column in (0, 1))
    table = make_table(positions, forward, backward, units)
    written, again = there_and_back("siemens-eec", table, axis="x")
    assert_same(again.table, means_of(table), 6e-9)
    assert list(again.table.forward) == list(again.table.backward)
    assert any("lost motion" in loss for loss in written.losses) == (forward != backward)


def test_written_file_is_the_grammar() -> None:
    table = make_table([0, 5], [0.0, 0.00125], [0.0, 0.00125], Units.MM)
    written = dialect_named("siemens-eec").write(table, WriteOptions(file_axis="1,Z2"))
    assert written.text.splitlines() == [
        "%_N_Z2_EEC_INI",
        "CHANDATA(1)",
        "$AA_ENC_COMP[1,0,Z2]=0.00000000",
        "$AA_ENC_COMP[1,1,Z2]=-0.00125000",
        "$AA_ENC_COMP_STEP[1,Z2]=5.0",
        "$AA_ENC_COMP_MIN[1,Z2]=0.0",
        "$AA_ENC_COMP_MAX[1,Z2]=5.0",
        "$AA_ENC_COMP_IS_MODULO[1,Z2]=0",
        "M17",
    ]
    assert written.context == FileContext(file_units=Units.MM, file_axis="Z2")


@pytest.mark.parametrize(
    "end", ["m0\nM17", "M0\nm17", "m30\nM17", "M30\nM17", "M00 ; stop\nM17", "m0\nm30\nM17"]
)
def test_a_file_that_is_run_as_a_program_stops_before_its_end(end: str) -> None:
    whole = program([0.001, 0.002, 0.003])
    loaded = parse(f"{whole}\n{end}\n")
    assert [-c for c in loaded.table.forward] == [0.001, 0.002, 0.003]


@pytest.mark.parametrize(
    ("end", "words"),
    [
        ("M17\nM30", "a line after the end in 'M30'"),
        ("m0", "something else in 'm0'"),
        ("M0\nM0\nM17", "something else in 'M0'"),
        ("M30\nM0\nM17", "a line after the end in 'M0'"),
        ("m0\nm30\nm30\nM17", "a line after the end in 'm30'"),
        ("M30\n$AA_ENC_COMP[0,3,C1]=0\nM17", "a line after the end"),
    ],
)
def test_stops_elsewhere_are_no_end(end: str, words: str) -> None:
    assert words in str(refused(f"{program([0.001, 0.002, 0.003])}\n{end}\n"))


def test_hexadecimal_numbers_are_read_as_the_control_saves_them() -> None:
    whole = program([0.001, 0.002, 0.001]) + "\nM17\n"
    assert "IS_MODULO[0,C1]=0" in whole
    hexadecimal = whole.replace("IS_MODULO[0,C1]=0", "IS_MODULO[0,C1]='H0'")
    assert list(parse(hexadecimal).table.forward) == list(parse(whole).table.forward)
    turning = parse(whole.replace("IS_MODULO[0,C1]=0", "IS_MODULO[0,C1]='H1'"))
    assert turning.source.modulo == 180.0
    assert "'HG'" in str(refused(whole.replace("IS_MODULO[0,C1]=0", "IS_MODULO[0,C1]='HG'")))
