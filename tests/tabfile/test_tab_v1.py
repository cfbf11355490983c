"""Centroid version 1: vectors of both published files, layout decision, signed scale, strict grammar."""

from pathlib import Path

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import FileContext, LoadedTable, V1Layout, explain, read_table
from tests.tabfile.texts import Texts

CNC_SERVICES = Path(__file__).parents[2] / "tables" / "centroid-v1" / "CNC7X.TAB"
MM = 1 / 25.4
"""One millimetre in inches."""

TB058_VALUES = (20, 12, 4, -4, -12, -16, -3)
"""TB058 prints these seven of 66 values; the others are made up here (zeros)."""
TB058 = "\r\n".join(["66 1320000", *map(str, TB058_VALUES), *["0"] * 59])


FILE = Texts("CNC7X.TAB", {"units": Units.INCH, "file_counts_per_unit": 40000.0})
parse, refused = FILE.parse, FILE.refused


def correction(loaded: LoadedTable, at: float) -> float:
    explained = explain(loaded, at)
    assert explained.forward.correction == explained.backward.correction
    return explained.forward.correction


def test_cnc_services_points_lie_25_mm_apart_beginning_at_home() -> None:
    # 23 x 25 mm x 64000/25.4 counts = 1448818.9 counts
    loaded = read_table(CNC_SERVICES, FileContext(units=Units.INCH, file_counts_per_unit=64000.0))
    assert loaded.format == "centroid-1"
    assert [x / MM for x in loaded.table.positions] == pytest.approx(
        [-25.0 * i for i in range(23, -1, -1)], abs=1e-4
    )


def test_cnc_services_corrections() -> None:
    loaded = read_table(CNC_SERVICES, FileContext(units=Units.INCH, file_counts_per_unit=64000.0))
    # -32 counts / 64000 = -0.0005 inch = -0.0127 mm at the first point, half of it half way
    assert correction(loaded, -25 * MM) == pytest.approx(-0.0005, abs=1e-9)
    assert correction(loaded, -25 * MM) / MM == pytest.approx(-0.0127, abs=1e-7)
    assert correction(loaded, -12.5 * MM) / MM == pytest.approx(-0.00635, abs=1e-7)


def test_metric_axis_takes_the_scale_per_millimetre() -> None:
    loaded = read_table(CNC_SERVICES, FileContext(units=Units.MM, file_counts_per_unit=64000 / 25.4))
    assert loaded.table.units is Units.MM
    assert loaded.table.first == pytest.approx(-575.0, abs=1e-4)
    assert correction(loaded, -25.0) == pytest.approx(-0.0127, abs=1e-7)


def test_dir_rev_mirrors_positions_and_values_with_one_signed_scale() -> None:
    loaded = read_table(CNC_SERVICES, FileContext(units=Units.INCH, file_counts_per_unit=-64000.0))
    assert loaded.table.last / MM == pytest.approx(575.0, abs=1e-4)
    assert correction(loaded, 25 * MM) / MM == pytest.approx(0.0127, abs=1e-7)


def test_tb058_home_is_implicit_and_has_no_correction() -> None:
    loaded = parse(TB058)
    assert len(loaded.table.positions) == 67
    # 1320000 / 66 / 40000 = 0.5 inch; 20 / 40000 = 0.0005 inch at 0.5, half of it at 0.25
    assert list(loaded.table.positions[:3]) == [0.0, 0.5, 1.0]
    assert correction(loaded, 0.0) == 0.0
    assert correction(loaded, 0.25) == pytest.approx(0.00025, abs=1e-15)
    assert correction(loaded, 0.5) == 0.0005
    # between 2.0 (-4 counts) and 2.5 (-12 counts): -8 / 40000
    assert correction(loaded, 2.25) == pytest.approx(-0.0002, abs=1e-15)


def test_first_value_other_than_0_proves_an_implicit_home() -> None:
    assert any("implicit" in decision for decision in parse(TB058).source.decisions)


def test_first_value_against_a_round_interval_is_refused_with_both_readings() -> None:
    # 23 intervals are 25 mm each, 24 are 23.96: only home listed is round, and then home would be 0
    text = CNC_SERVICES.read_text().replace("\n0\n", "\n-1\n", 1)
    error = refused(text, "a first value of -1", line=2, file_counts_per_unit=64000.0)
    assert [reading.split(":")[0] for reading in error.readings] == ["v1_layout listed", "v1_layout implicit"]
    assert len(parse(text, file_counts_per_unit=64000.0, v1_layout=V1Layout.LISTED).table.positions) == 24


@pytest.mark.parametrize("scale", [64000.0, 20000.0, 40000.0, 50000.0, 80000.0])
def test_cnc_services_file_reads_listed_with_any_plausible_scale(scale: float) -> None:
    loaded = read_table(CNC_SERVICES, FileContext(units=Units.INCH, file_counts_per_unit=scale))
    assert len(loaded.table.positions) == 24


def test_round_interval_of_the_implicit_layout_proves_it() -> None:
    # 7 inch, 7 values: 1 inch with home implicit, 1.1667 inch with home listed
    loaded = parse("7 280000\n0\n1\n2\n3\n4\n5\n6")
    assert len(loaded.table.positions) == 8


def test_two_round_layouts_are_refused_with_both_readings() -> None:
    # 1.0 inch with 5 intervals, 1.25 inch with 4: both are multiples of 0.05
    error = refused("5 200000\n0\n400\n800\n1200\n1600")
    assert len(error.readings) == 2
    assert "0, 1.25, 2.5, 3.75, 5 inch" in error.readings[0]
    assert "0, 1, 2, 3, 4, 5 inch" in error.readings[1]
    # listed: 0.01 inch at 1.25, 0.04 at 5.0; implicit: home 0, the first value (0) at 1, 0.04 at 5.
    # At 1.0: 0.008 against 0. At 1.25: 0.01 against 0.0025. At 2.5: 0.02 against 0.015.
    assert "at most 0.008 inch (at 1)" in error.readings[1]
    assert "v1_layout" in error.allowed


def test_two_crooked_layouts_are_refused_too() -> None:
    # 5.0123 / 4 = 1.25308 and / 5 = 1.00246 inch
    refused("5 200492\n0\n1\n2\n3\n4", "neither")


@pytest.mark.parametrize(("layout", "points"), [(V1Layout.LISTED, 5), (V1Layout.IMPLICIT, 6)])
def test_told_layout_is_obeyed(layout: V1Layout, points: int) -> None:
    assert len(parse("5 200000\n0\n1\n2\n3\n4", v1_layout=layout).table.positions) == points


def test_told_layout_is_obeyed_against_the_first_value_and_still_linted() -> None:
    loaded = parse(TB058, v1_layout=V1Layout.LISTED)
    assert len(loaded.table.positions) == 66
    assert "L5" in {lint.code for lint in loaded.lints}


def test_one_value_needs_home_beside_it() -> None:
    assert list(parse("1 40000\n0").table.positions) == [0.0, 1.0]
    refused("1 40000\n0", "at least 2 values", v1_layout=V1Layout.LISTED)


def test_degrees_are_round_by_whole_degrees() -> None:
    # 360 degrees with 1000 counts each; 37 values: 10 degrees listed, 9.73 implicit
    loaded = parse("\n".join(["37 360000", *["0"] * 37]), units=Units.DEGREE, file_counts_per_unit=1000.0)
    assert loaded.table.units is Units.DEGREE
    assert loaded.table.positions[1] == pytest.approx(10.0)


def test_without_scale_or_units_the_file_is_refused() -> None:
    refused(TB058, "file_counts_per_unit", file_counts_per_unit=None)
    refused(TB058, "units of the axis", units=None)


def test_range_that_misses_travel_while_its_mirror_meets_it_is_refused_with_both_readings() -> None:
    error = refused(TB058, travel=(-33.0, 0.0))
    assert "file_counts_per_unit 40000" in error.readings[0]
    assert "file_counts_per_unit -40000" in error.readings[1]


def test_range_that_exceeds_travel_by_more_than_a_fifth_is_refused() -> None:
    # 33 inch on 27.5 inch of travel: exactly 20 % more; on 27.4 inch: 20.4 %
    parse(TB058, travel=(0.0, 27.5))
    refused(TB058, "beyond travel", travel=(0.0, 27.4))


def test_range_far_from_travel_on_either_side_is_refused() -> None:
    refused(TB058, "outside travel", travel=(40.0, 60.0))


@pytest.mark.parametrize(
    ("text", "line", "allowed"),
    [
        ("3 120000\n0\n1", 3, "3, as the header"),
        ("2 120000\n0\n1\n2", 4, "2, as the header"),
        ("3 120000\n0\n1.5\n2", 3, "whole number"),
        ("3 120000\n0\n\n1\n2", 3, "whole number"),
        ("3 120000\n0\n1 ; x\n2", 3, "whole number"),
        ("3 120000\n0\nabc\n2", 3, "whole number"),
        ("0 120000", 1, "number of values (1 or more)"),
        ("3 0\n1\n2\n3", 1, "(not 0)"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(text: str, line: int, allowed: str) -> None:
    error = refused(text, line=line)
    assert allowed in error.allowed


def test_every_bad_line_is_named_at_once() -> None:
    error = refused("3 120000\nx\n1\ny")
    assert [problem.line for problem in error.problems] == [2, 4]
