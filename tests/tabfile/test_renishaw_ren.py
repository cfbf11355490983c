"""Renishaw .ren: an even grid that must be as the head says, unit and sign that must be told."""

from pathlib import Path
from typing import Any

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import dialect_named, explain
from tests.tabfile.texts import Texts

SAMPLE = (Path(__file__).parents[2] / "tables" / "renishaw" / "x.ren").read_text()
TOLD: dict[str, Any] = {"file_units": Units.MM, "file_counts_per_unit": 1000.0}
COMBINED = """Compensation start: 10
Compensation end = 30
Compensation spacing 10
No. Axis position Combined
1 10 0
2 20 -2
3 30 4
"""
FILE = Texts("table.ren")
parse, refused = FILE.parse, FILE.refused


def test_micrometres_that_are_corrections_are_added() -> None:
    loaded = parse(SAMPLE, **TOLD)
    assert loaded.format == "renishaw-ren"
    assert (loaded.table.first, loaded.table.last, len(loaded.table.positions)) == (-400.0, 0.0, 9)
    explained = explain(loaded, -75.0)
    # half way between 6.7 and 7.1 forward, 1.4 and 1.9 in reverse
    assert explained.forward.correction == pytest.approx(0.0069, abs=1e-15)
    assert explained.backward.correction == pytest.approx(0.00165, abs=1e-15)
    assert explained.forward.rule == "column Forward: value / 1000 is added"
    assert explained.backward.rule == "column Reverse: value / 1000 is added"
    assert loaded.source.rows[0].forward_line == 14


def test_combined_values_that_are_errors_are_subtracted() -> None:
    loaded = parse(COMBINED, file_units=Units.INCH, file_counts_per_unit=-10_000.0)
    assert loaded.table.is_unidirectional
    # errors of 0, -2 and 4 tenths of a thousandth of an inch
    assert list(loaded.table.forward) == pytest.approx([0.0, 0.0002, -0.0004], abs=1e-18)
    assert "subtracted" in loaded.source.forward_rule


def test_unit_and_sign_must_be_told() -> None:
    assert "states no units" in str(refused(SAMPLE, file_counts_per_unit=1000.0))
    error = refused(SAMPLE, file_units=Units.MM)
    assert "neither the unit nor the sign" in error.found
    assert "1000 or -1000" in error.allowed


def test_told_facts_must_fit() -> None:
    # 10 to 30 mm has no point in common with -60 to -40, neither as it is nor mirrored
    error = refused(COMBINED, travel=(-60.0, -40.0), units=Units.MM, **TOLD)
    assert "outside travel" in error.found
    assert error.allowed == "a table of this axis; the right file_units and travel"
    assert "outside travel" in str(refused(COMBINED, travel=(-30.0, 0.0), units=Units.MM, **TOLD))
    assert "lowest position of -400" in str(refused(SAMPLE, file_start=0.0, **TOLD))


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("Compensation start", "Compensation begin", 1, "Compensation start, end or spacing"),
        ("Compensation end       -400.0\n", "", 4, "no Compensation end"),
        ("Compensation end", "Compensation start", 2, "a second Compensation start"),
        ("-400.0\n", "-4OO.0\n", 2, "decimal number"),
        ("-400.0\n", "\n", 2, "decimal number"),
        ("spacing   50.0", "spacing   -50.0", 3, "a distance above 0"),
        ("spacing   50.0", "spacing   40.5", 3, "a whole number of steps"),
        ("spacing   50.0", "spacing   500.0", 3, "a whole number of steps"),
        ("spacing   50.0", "spacing   0.001", 3, "a whole number of steps"),
        ("spacing   50.0", "spacing   25.0", 14, "17: 0 to -400 in steps of 25"),
        ("Compensation end       -400.0", "Compensation end       -350.0", 14, "8: 0 to -350"),
        ("Compensation start     0.0", "Compensation start     -400.0", 3, "a whole number of steps"),
        ("No.  ", "Sign convention: error\nNo.  ", 5, "'Sign convention: error'"),
        ("No.  Axis position  Forward  Reverse", "No.  Axis position  Forward", 5, "Combined"),
        ("Forward  Reverse", "Combined", 6, "1 value(s)"),
        ("2    -50.0", "3    -50.0", 7, "number 2"),
        ("2    -50.0          6.7      1.4\n", "", 7, "number 2"),
        ("2    -50.0          6.7      1.4", "", 7, "number 2"),
        ("2    -50.0 ", "2    -50.1 ", 7, "-50, as start, end and spacing say"),
        ("2    -50.0 ", "2    50.0 ", 7, "-50, as start, end and spacing say"),
        ("6.7", "6,7", 7, "decimal number"),
        ("6.7", "6.7 6.7", 7, "2 value(s)"),
        ("9    -400.0         6.0      0.2\n", "", 13, "8 rows"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    assert message in str(refused(SAMPLE.replace(old, new, 1), **TOLD, line=line))


def test_head_without_columns() -> None:
    assert refused("Compensation start 0\nCompensation end 1\n", **TOLD).found == "the end of the file"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_blanks_and_case_change_nothing(end: str) -> None:
    text = "﻿\n" + SAMPLE.upper().replace("  ", " \t").replace("\n", " " + end)
    assert parse(text, **TOLD).table == parse(SAMPLE, **TOLD).table


def test_no_such_files_are_written() -> None:
    assert not dialect_named("renishaw-ren").is_writable
