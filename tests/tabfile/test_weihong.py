"""Weihong's axeserr.dat: what its examples mean in either sense, and what is refused."""

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, WriteOptions, dialect_named
from tests.tabfile.samples import WEIHONG
from tests.tabfile.texts import Texts

AMC, CMA = ErrorSense.ACTUAL_MINUS_COMMAND, ErrorSense.COMMAND_MINUS_ACTUAL
TWO_AXES = (
    WEIHONG.decode()
    + """[y]
; only a backlash, as the manual shows it
0.000, 0.000, 0.030
1000.00, 0.000, 0.030
"""
)
FILE = Texts("axeserr.dat", {"error_sense": AMC})
refused = FILE.said


def read(text: str, **told: object) -> list[tuple[float, float, float]]:
    rows = FILE.parse(text, **told).source.rows
    return [(row.position, row.forward, row.backward) for row in rows]


def test_each_sense_is_the_other_with_its_sign_changed() -> None:
    text = WEIHONG.decode()
    assert read(text)[0] == (-300.025, -0.027, -0.083)
    assert read(text, error_sense=CMA)[0] == (-300.025, 0.027, 0.083)
    # Going back at 0, 57 µm are lost: in the sense of the manual's example the nut hangs behind, and the
    # command goes further back.
    assert read(text)[-1] == (0.0, 0.0, -0.057)


def test_the_sense_must_be_told_and_both_readings_are_shown() -> None:
    said = refused(WEIHONG.decode(), error_sense=None)
    assert "formula and its example of a backlash disagree" in said
    assert "error_sense = 'actual_minus_command' or 'command_minus_actual'" in said


def test_an_axis_of_several_is_told_in_any_case() -> None:
    assert "tables of X, Y" in refused(TWO_AXES)
    assert "but file_axis = 'Z'" in refused(TWO_AXES, file_axis="Z")
    assert read(TWO_AXES, file_axis="y") == [(0.0, 0.0, -0.03), (1000.0, 0.0, -0.03)]


@pytest.mark.parametrize("unit", ["unit = mm", "unit=MM", "; unit = mm"])
def test_the_unit_stands_with_and_without_the_semicolon_of_the_examples(unit: str) -> None:
    assert read(WEIHONG.decode().replace(";unit=mm", unit)) == read(WEIHONG.decode())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (";unit=mm", ";unit=inch", "axeserr.dat:1: unit 'inch'"),
        (";unit=mm\n", "[Y]\n1,0,0\n", "no unit"),
        ("[X]", "[X", "axeserr.dat"),
        ("-200.020", "-310.020", "axeserr.dat:5: L11 position -310.02 after -300.025"),
        ("-200.020, 0.0250, 0.0770", "-200.020, 0.0250", "axeserr.dat:5: '-200.020, 0.0250'"),
        ("0.0250", "0,0250", "axeserr.dat:5: "),
        ("; measured with a laser", "measured with a laser", "axeserr.dat:2: 'measured with a laser'"),
        (
            "0.000, 0.0000, 0.0570\n",
            "0.000, 0.0000, 0.0570\n[x]\n",
            "axeserr.dat:8: a second table of axis X",
        ),
    ],
)
def test_what_is_damaged_is_refused_with_its_line(old: str, new: str, words: str) -> None:
    text = WEIHONG.decode()
    assert old in text
    assert words in refused(text.replace(old, new, 1))


@pytest.mark.parametrize("line", ["", ";-100.015, 0.0150, 0.0680"])
def test_a_line_among_the_points_that_holds_none_is_named(line: str) -> None:
    lines = WEIHONG.decode().split("\n")
    assert remarks("\n".join([*lines[:5], line, *lines[6:]])) == [("R10", 6)]
    between = "\n".join([*lines[:2], "", *lines[2:], "", TWO_AXES[len(WEIHONG) :]])
    assert remarks(between, file_axis="X") == []


def remarks(text: str, **told: object) -> list[tuple[str, int | None]]:
    return [(lint.code, lint.line) for lint in FILE.parse(text, **told).lints if lint.code == "R10"]


def test_what_is_written_says_axis_and_unit_and_comes_back_in_its_sense() -> None:
    table = FILE.parse(WEIHONG).table
    written = dialect_named("weihong").write(table, WriteOptions(axis="X", sense=CMA))
    assert written.text.startswith("unit = mm\n[X]\n-300.025000, -0.027000, -0.083000\n")
    assert read(written.text, error_sense=CMA) == read(WEIHONG.decode())


def test_an_axis_in_inches_gets_its_table_in_inches() -> None:
    found = FILE.parse(WEIHONG, units=Units.INCH)
    assert found.table.in_units(Units.INCH).forward[0] == pytest.approx(-0.027 / 25.4)
