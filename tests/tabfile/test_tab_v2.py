"""Centroid version 2: vectors of both published files, the start decision, strict grammar."""

from pathlib import Path

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import HomeSide, explain
from tests.tabfile.texts import Texts

TABLES = Path(__file__).parents[2] / "tables"
TB058 = (TABLES / "centroid-v2-tb058" / "cnc10z.tab").read_text()
CNC_SERVICES = (TABLES / "centroid-v2" / "cnc10z.tab").read_text()
FILE = Texts("cnc10z.tab")
parse, refused = FILE.parse, FILE.refused


def small(header: str, values: int = 6) -> str:
    """Three points, two directions, in tenths."""
    return "\n".join([header, *["1.0"] * (values // 2), "; backward data", *["0.5"] * (values - values // 2)])


def test_tb058_corrections_between_points() -> None:
    loaded = parse(TB058, file_start=-2.5)
    explained = explain(loaded, -1.25)
    # forward between 4 and 5 tenths, backward between 1 and 0
    assert explained.forward.correction == pytest.approx(0.00045, abs=1e-15)
    assert explained.forward.corrected == pytest.approx(-1.24955, abs=1e-12)
    assert explained.backward.correction == pytest.approx(0.00005, abs=1e-15)
    assert explained.backward.corrected == pytest.approx(-1.24995, abs=1e-12)
    assert explain(loaded, -0.5).backward.correction == -0.0001


def test_cnc_services_first_value_is_tenths_of_an_inch_thousandth() -> None:
    loaded = parse(CNC_SERVICES)
    assert loaded.table.units is Units.INCH
    assert (loaded.table.first, loaded.table.last) == (0.0, 4.5)
    assert explain(loaded, 0.0).forward.correction == pytest.approx(0.00004272, abs=1e-18)
    assert explain(loaded, 4.5).backward.correction == pytest.approx(-0.00026518, abs=1e-18)


def test_metric_values_are_microns() -> None:
    loaded = parse("2 2 25.0 21 1 0\n1\n2\n3\n; backward data\n0\n0\n0", file_start=0.0)
    assert loaded.table.units is Units.MM
    assert list(loaded.table.forward) == [0.001, 0.002, 0.003]
    assert loaded.source.value_unit == "µm"


def test_told_start_is_obeyed_even_against_field_6() -> None:
    loaded = parse(CNC_SERVICES, file_start=-4.5, travel=(-5.0, 0.0))
    assert (loaded.table.first, loaded.table.last) == (-4.5, 0.0)


def test_encoder_counts_in_field_5_make_field_6_the_start() -> None:
    loaded = parse(small("2 2 0.5 20 25400 -7.25"))
    assert list(loaded.table.positions) == [-7.25, -6.75, -6.25]


def test_encoder_counts_must_agree_with_the_told_scale() -> None:
    # 114300 / (9 x 0.5 inch) = 25400 counts per inch = 1000 per mm
    parse(CNC_SERVICES, file_counts_per_unit=25400.0)
    parse(CNC_SERVICES, file_counts_per_unit=-25402.0)
    parse(CNC_SERVICES, file_counts_per_unit=1000.0, units=Units.MM)
    refused(CNC_SERVICES, "25400 counts per inch", file_counts_per_unit=25403.0)


def test_field_5_too_small_for_counts_proves_nothing() -> None:
    # 0.9 counts over 1 inch
    refused(small("2 2 0.5 20 0.9 0"), "too small")
    parse(small("2 2 0.5 20 0.9 0"), file_start=0.0)


def test_field_6_is_not_trusted_where_field_5_is_1() -> None:
    error = refused(small("2 2 0.5 20 1 -3"), travel=(-3.0, 0.0))
    assert len(error.readings) == 2


def test_start_follows_from_negative_travel_as_the_multiple_just_inside() -> None:
    # -2.6 / 0.5: five intervals fit, the first point is -2.5
    assert parse(TB058, travel=(-2.6, 0.0)).table.first == -2.5
    assert parse(TB058, travel=(-2.5, 0.0)).table.first == -2.5


@pytest.mark.parametrize("lowest", [-2.4, -3.0, -12.0])
def test_number_of_intervals_that_does_not_fit_the_travel_is_refused(lowest: float) -> None:
    error = refused(TB058, "5 intervals", travel=(lowest, 0.0))
    assert len(error.readings) == 2


def test_start_of_positive_travel_is_0() -> None:
    assert parse(TB058, travel=(0.0, 2.6)).table.first == 0.0


def test_travel_on_both_sides_begins_at_its_lower_end_with_a_warning() -> None:
    loaded = parse(TB058, travel=(-1.5, 1.0))
    assert loaded.table.first == -1.5
    assert "R2" in {lint.code for lint in loaded.warnings}


def test_travel_on_both_sides_must_be_spanned_but_for_one_step() -> None:
    parse(TB058, travel=(-1.5, 1.5))
    refused(TB058, "too few for", travel=(-1.5, 1.6))


def test_without_travel_the_start_is_asked_for_with_both_readings() -> None:
    error = refused(TB058)
    assert "-2.5, -2, -1.5, -1, -0.5, 0 inch" in error.readings[0]
    assert "0, 0.5, 1, 1.5, 2, 2.5 inch" in error.readings[1]
    assert "file_start" in error.allowed


def test_range_that_misses_travel_while_its_mirror_meets_it_is_refused() -> None:
    error = refused(CNC_SERVICES, travel=(-5.0, 0.0))
    assert "file_start 0" in error.readings[0]
    assert "file_start -4.5" in error.readings[1]
    assert "differ by at most" in error.readings[1]


def test_range_that_exceeds_travel_by_more_than_a_fifth_is_refused() -> None:
    # 4.5 inch on 3.75: exactly 20 % more
    parse(CNC_SERVICES, travel=(0.0, 3.75))
    refused(CNC_SERVICES, "beyond travel", travel=(0.0, 3.7))


def test_travel_in_millimetres_is_converted_for_an_inch_file() -> None:
    loaded = parse(TB058, units=Units.MM, travel=(-66.04, 0.0))
    assert loaded.table.units is Units.INCH
    assert loaded.table.first == -2.5


def test_told_home_side_that_the_positions_contradict_is_an_error() -> None:
    parse(TB058, file_start=-2.5, file_home=HomeSide.PLUS)
    refused(TB058, "so home is at the plus end", file_start=-2.5, file_home=HomeSide.MINUS)


def test_missing_separator_is_accepted_with_a_warning_if_the_count_fits() -> None:
    loaded = parse(TB058.replace("; backward data\n", ""), file_start=-2.5)
    assert "R1" in {lint.code for lint in loaded.warnings}
    assert list(loaded.table.forward) == list(parse(TB058, file_start=-2.5).table.forward)


def test_text_after_a_semicolon_is_ignored() -> None:
    text = TB058.replace("2.0000\n3.0000", "; values\n2.0000 ; first\n3.0000;second", 1)
    assert list(parse(text, file_start=-2.5).table.forward[:2]) == [0.0002, 0.0003]


def test_unused_options_are_remarked_on() -> None:
    remarks = parse(TB058, file_start=-2.5, file_counts_per_unit=25400.0).warnings
    assert [lint.message.split()[0] for lint in remarks if lint.code == "R3"] == ["file_counts_per_unit"]


@pytest.mark.parametrize(
    ("old", "new", "line", "allowed"),
    [
        ("7.0000\n", "", 7, "6 values in each list"),
        ("-1.0000\n", "", 13, "12: N + 1 = 6"),
        ("; backward data", "8.0000\n; backward data", 9, "6 values in each list"),
        ("7.0000\n; backward data", "; backward data\n7.0000", 7, "6 values in each list"),
        ("7.0000\n; backward data", "7.0000\n\n; backward data", 8, "a value on every line"),
        ("4.0000", "4,0000", 4, "decimal number"),
        ("4.0000", "4.0 5.0", 4, "decimal number"),
        ("4.0000", "nan", 4, "decimal number"),
        ("4.0000", "1000.0", 4, "-999.9999 to 999.9999"),
        ("4.0000", "-999.99991", 4, "-999.9999 to 999.9999"),
        ("2 5 0.5000 20 1 0", "2 1 0.5000 20 1 0", 1, "at least 2"),
        ("2 5 0.5000 20 1 0", "2 5 0 20 1 0", 1, "above 0"),
        ("2 5 0.5000 20 1 0", "2 5 0.5000 22 1 0", 1, "20 (inch) or 21 (mm)"),
        ("2 5 0.5000 20 1 0", "2 5 0.5000 20 1 0 9", 1, "6:"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, allowed: str) -> None:
    error = refused(TB058.replace(old, new, 1), line=line, file_start=-2.5)
    assert allowed in error.allowed


def test_largest_values_are_allowed() -> None:
    table = parse(TB058.replace("7.0000", "999.9999"), file_start=-2.5).table
    assert table.forward[-1] == pytest.approx(0.09999999)  # 999.9999 tenths of a thousandth of an inch
