"""LinuxCNC compensation files: the shipped sample, the two types, what LinuxCNC would not have read."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import (
    FileContext,
    TabFileError,
    WriteOptions,
    dialect_named,
    explain,
    parse_table,
    read_table,
)
from tests.tabfile.drawn import assert_same, there_and_back
from tests.tabfile.texts import Texts

PATH = Path(__file__).parents[2] / "tables" / "linuxcnc" / "screwcompX.dat"
SAMPLE = PATH.read_text()
CORRECTED = SAMPLE.replace("-4.2 ", "-4.002 ")
"""With the row that its neighbours suggest instead of the published slip."""
TYPES = ("linuxcnc-0", "linuxcnc-1")
TRIMS: dict[str, Any] = {"format": "linuxcnc-1"}
FILE = Texts("comp.dat", {"format": "linuxcnc-0", "file_units": Units.MM})
parse, refused = FILE.parse, FILE.refused


def test_type_0_adds_nominal_minus_actual() -> None:
    loaded = parse(CORRECTED)
    # -10 - -10.001 = +0.001 forward, -10 - -9.999 = -0.001 back
    assert explain(loaded, -10.0).forward.correction == pytest.approx(0.001, abs=1e-12)
    assert explain(loaded, -10.0).backward.correction == pytest.approx(-0.001, abs=1e-12)
    # between 0 - -0.003 = 0.003 at 0 and 2 - 1.997 = 0.003 at 2
    assert explain(loaded, 1.0).forward.correction == pytest.approx(0.003, abs=1e-12)
    # between 0 - 0.002 at 0 and 2 - 2.003 at 2
    explained = explain(loaded, 1.0, counts_per_unit=2000.0).backward
    assert explained.correction == pytest.approx(-0.0025, abs=1e-12)
    assert (explained.nominal_counts, explained.counts) == (2000, 1995)
    assert "- value is added" in explained.rule


def test_shipped_typo_is_an_error_and_named_as_outlier() -> None:
    loaded = parse(SAMPLE)
    # -4 - -4.2 = 0.2 beside 0.002 at -6 and 0.003 at -2: a slope of -0.0985
    assert {lint.code: lint.line for lint in loaded.errors} == {"L1": 4}
    assert "slope of 0.099" in loaded.errors[0].message
    outlier = next(lint for lint in loaded.warnings if lint.code == "L6")
    assert outlier.line == 4
    with pytest.raises(TabFileError, match="L1"):
        read_table(PATH, FileContext(format="linuxcnc-0", file_units=Units.MM))
    assert "L1" not in {lint.code for lint in parse(CORRECTED).lints}


def test_position_near_zero_is_no_unit_slip() -> None:
    assert "L4" not in {lint.code for lint in parse("-10 -10 -10\n0 0.0005 -0.0003\n10 10 10\n").lints}
    # among trims it is one
    assert "L4" in {lint.code for lint in parse("-10 0.2 0.2\n0 0.0005 0.2\n10 0.2 0.2\n", **TRIMS).lints}


def test_documented_examples_of_both_types_do_not_mean_the_same() -> None:
    type_0 = parse("0 0.002 -0.003\n1 1.003 0.998\n")
    equal = parse("0 -0.002 0.003\n1 -0.003 0.002\n", **TRIMS)
    printed = parse("0 0.002 -0.003\n1 0.003 -0.004\n", **TRIMS)
    assert list(type_0.table.forward) == pytest.approx(list(equal.table.forward), abs=1e-12)
    assert list(type_0.table.backward) == pytest.approx(list(equal.table.backward), abs=1e-12)
    # what the documentation prints as the type 1 of it has the opposite sign
    assert list(printed.table.forward) == pytest.approx([0.002, 0.003], abs=1e-15)
    assert list(printed.table.backward) == pytest.approx([-0.003, -0.004], abs=1e-15)


def test_text_does_not_tell_its_type() -> None:
    refused(SAMPLE, "fits 'linuxcnc-0' or 'linuxcnc-1'", format=None)


def test_type_told_wrong_is_refused() -> None:
    refused(CORRECTED, r"so they are not trims.*linuxcnc-0", **TRIMS)
    refused("0 -0.002 0.003\n1 -0.003 0.002\n", r"so they are not positions.*linuxcnc-1")


def test_units_must_be_told() -> None:
    refused(CORRECTED, "states no units", file_units=None)
    assert parse(CORRECTED, file_units=Units.INCH).table.units is Units.INCH


def test_control_holds_outside() -> None:
    assert parse(CORRECTED).source.behaves_as == ('outside = "hold"',)


@pytest.mark.parametrize(
    ("text", "line", "used"),
    [
        ("# nominal forward reverse\n0 0 0\n5 0 0\n", 1, "0 of the 2"),
        ("\n0 0 0\n5 0 0\n", 1, "0 of the 2"),
        ("0 0 0\n5 0 0\n\n10 0 0\n", 3, "2 of the 3"),
        ("0 0 0\n; middle\n5 0 0\n10 0 0\n", 2, "1 of the 3"),
    ],
)
def test_points_that_linuxcnc_would_not_reach_count_with_a_remark(text: str, line: int, used: str) -> None:
    loaded = parse(text, **TRIMS)
    assert len(loaded.table.positions) == text.count(" 0 0")
    (remark,) = (lint for lint in loaded.warnings if lint.code == "R7")
    assert remark.line == line
    assert used in remark.message


@pytest.mark.parametrize("text", ["0 0 0 # home\n5 0 0\n", "0 0 0\n5 0 0\n\n\n", "0 0 0\n5 0 0\n# end\n"])
def test_what_does_not_stop_linuxcnc_gets_no_remark(text: str) -> None:
    assert "R7" not in {lint.code for lint in parse(text, **TRIMS).lints}


def test_points_beyond_its_256_count_with_a_remark() -> None:
    lines = [f"{x} 0.001 0" for x in range(257)]
    assert "R7" not in {lint.code for lint in parse("\n".join(lines[:256]), **TRIMS).lints}
    loaded = parse("\n".join(lines), **TRIMS)
    assert len(loaded.table.positions) == 257
    (remark,) = (lint for lint in loaded.warnings if lint.code == "R7")
    assert remark.line == 257
    assert "256 of the 257" in remark.message


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        (" -8  -8.001  -7.999", " -8  -8.001", 2, "'-8  -8.001'"),
        (" -8  -8.001  -7.999", " -8  -8.001  -7.999 0", 2, "-7.999 0"),
        (" -8  -8.001  -7.999", " -8, -8.001, -7.999", 2, "'-8, -8.001, -7.999'"),
        (" -8  -8.001  -7.999", " -8  -8,001  -7,999", 2, "-8,001"),
        (" -8  -8.001  -7.999", " -8  nan  -7.999", 2, "nan"),
        (" -8  -8.001", "-10  -8.001", 2, "L11 nominal position -10 after -10"),
        (" -8  -8.001", "-11  -8.001", 2, "L11 nominal position -11 after -10"),
        ("-10 -10.001", "-1O -10.001", 1, "-1O"),
    ],
)
def test_damaged_line_is_named(old: str, new: str, line: int, found: str) -> None:
    assert found in str(refused(CORRECTED.replace(old, new), line=line))


def test_every_damaged_line_is_named_at_once() -> None:
    error = refused("0 0 0\n1 x 0\n2 y 0\n3 0 0\n", **TRIMS)
    assert [problem.line for problem in error.problems] == [2, 3]


def test_one_point_is_no_table() -> None:
    refused("0 0 0\n", r"1 point\(s\)", **TRIMS)


def test_lost_line_is_seen_by_travel() -> None:
    shorter = "".join(CORRECTED.splitlines(keepends=True)[:-1])
    assert any(
        lint.code == "L8" and "8 to 10" in lint.message for lint in parse(shorter, travel=(-10.0, 10.0)).lints
    )


def test_start_and_travel_are_checked() -> None:
    parse(CORRECTED, file_start=-10.0)
    refused(CORRECTED, "file_start is 0", file_start=0.0)
    refused(CORRECTED, "outside travel", travel=(20.0, 40.0))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "﻿"])
def test_line_ends_and_byte_order_mark(end: str, mark: str) -> None:
    text = mark + CORRECTED.replace("\n", "\t " + end)
    assert list(parse(text).table.forward) == list(parse(CORRECTED).table.forward)


@pytest.mark.parametrize(
    "text", ["1 2 3 4\n", "66 1320000\n20\n30\n", "CNC10 TAB FILE VERSION 3\n1 2 3\n2 2 3\n"]
)
def test_other_formats_are_not_taken_for_it(text: str) -> None:
    with pytest.raises(TabFileError) as caught:
        parse_table(text.encode(), "x", FileContext())
    assert "linuxcnc" not in str(caught.value)


@given(
    st.lists(
        st.tuples(st.integers(1, 50_000), st.integers(-9999, 9999), st.integers(-9999, 9999)),
        min_size=2,
        max_size=60,
    ),
    st.sampled_from(list(Units)),
    st.sampled_from(TYPES),
    st.integers(-1000, 1000),
)
def test_what_is_written_is_read_back(
    points: list[tuple[int, int, int]], units: Units, name: str, start: int
) -> None:
    positions, at = [], float(start)
    for distance, _, _ in points:
        at += 0.06 + distance * 1e-3  # slopes below a third: at a half, it could be either type
        positions.append(round(at, 8))
    forward, backward = ([point[column] * 1e-6 for point in points] for column in (1, 2))
    table = make_table(positions, forward, backward, units)
    _, again = there_and_back(name, table)
    assert_same(again.table, table, 1e-11, 0.0)


def test_written_file() -> None:
    table = make_table([-10, 0.5], [0.001, 0.0], [-0.0025, 0.0], Units.MM)
    assert (
        dialect_named("linuxcnc-0").write(table, WriteOptions()).text == "-10 -10.001 -9.9975\n0.5 0.5 0.5\n"
    )
    assert dialect_named("linuxcnc-1").write(table, WriteOptions()).text == "-10 0.001 -0.0025\n0.5 0 0\n"


def test_what_the_digits_would_make_as_steep_as_the_positions_is_not_written() -> None:
    table = make_table([-1.0, 4.0, 9.0], [0.0, 5.0 - 1e-13, 5.0], [0.0, 0.0, 0.0], Units.MM)
    said = "a file of linuxcnc-1: a slope of 1 between -1 and 4, in its digits; allowed: a slope below 1"
    with pytest.raises(TabFileError, match=said):
        dialect_named("linuxcnc-1").write(table, WriteOptions())
