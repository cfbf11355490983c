"""What the founding documents ask: the list names tests that there are, and the page names what differs."""

import re
from pathlib import Path

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import (
    ErrorSense,
    FileContext,
    TabFileError,
    WriteOptions,
    dialect_named,
    parse_table,
)

ROOT = Path(__file__).parents[2]
LIST = (ROOT / "tests" / "docs" / "founding_documents.md").read_text()
PAGE = (ROOT / "docs" / "founding-documents.md").read_text()
ROWS = re.findall(r"^\| ([CNIFM]\d+) \| (.+?) \| (.+?) \| (.+?) \|$", LIST, re.MULTILINE)
TESTS = {
    name
    for path in (ROOT / "tests").glob("**/test_*.py")
    for name in re.findall(r"^(?:async )?def (test_\w+)", path.read_text(), re.MULTILINE)
}
FAGOR = FileContext(error_sense=ErrorSense.ACTUAL_MINUS_COMMAND, file_units=Units.MM)


@pytest.mark.parametrize("number", [number for number, *_ in ROWS])
def test_a_row_has_a_verdict_and_names_tests_that_there_are(number: str) -> None:
    [(verdict, shown)] = [(verdict, shown) for row, _, verdict, shown in ROWS if row == number]
    assert verdict in {"holds", "differs", "not offered", "does not apply"}
    for name in re.findall(r"`(test_\w+)`", shown):
        assert name in TESTS, name
    assert shown.strip()


def test_rows_are_numbered_through_in_each_document() -> None:
    for letter, many in {"C": 48, "N": 16, "I": 17, "F": 14, "M": 22}.items():
        numbers = [int(number[1:]) for number, *_ in ROWS if number[0] == letter]
        assert numbers == list(range(1, many + 1))


def test_the_page_names_what_differs_and_how_many_were_checked() -> None:
    others = {number for number, _, verdict, _ in ROWS if verdict != "holds"}
    named = set(re.findall(r"\(([CNIFM]\d+)[);]", PAGE))
    assert others <= named
    assert f"{len(ROWS)} of their sentences were checked" in PAGE


def test_cnc_services_n3_a_version_1_file_gets_the_mean_of_both_directions() -> None:
    table = make_table([0.0, 10.0], [0.0, 0.002], [0.0, 0.004], Units.MM)
    written = dialect_named("centroid-1").write(table, WriteOptions(file_counts_per_unit=1000.0))
    # one entry over 10 mm at 1000 counts a mm; (2 + 4) / 2 counts
    assert written.text.split() == ["1", "10000", "3"]


def test_mint_m12_a_table_may_have_thousands_of_entries() -> None:
    entries = ", ".join(f"{number}.001" for number in range(1, 5001))
    program = f"DIM fwd(5000) = {entries}\nPRECISIONTABLE(0, fwd)\nPRECISIONINCREMENT.0 = 1\n"
    told = FileContext(file_units=Units.MM, file_start=0.0)
    assert parse_table(program.encode(), "x.mnt", told).table.last == 5000.001


def test_fagor_f4_numbers_beyond_the_range_of_the_control_are_refused() -> None:
    with pytest.raises(TabFileError, match=r"99999\.9999 mm"):
        parse_table(b"P001 X0 EX 0\nP002 X100000 EX 0\n", "x", FAGOR)
    inches = FileContext(error_sense=ErrorSense.ACTUAL_MINUS_COMMAND, file_units=Units.INCH)
    with pytest.raises(TabFileError, match=r"3937\.00787 inch"):
        parse_table(b"P001 X0 EX 0\nP002 X3937.1 EX 0\n", "x", inches)
    assert parse_table(b"P001 X0 EX 0\nP002 X3937 EX 0\n", "x", inches).table.last == 3937.0


def test_fagor_f9_a_rotary_table_that_does_not_close_is_not_repeated() -> None:
    degrees = FileContext(error_sense=ErrorSense.ACTUAL_MINUS_COMMAND, file_units=Units.DEGREE)
    closed = parse_table(b"P001 A0 EA 0.001\nP002 A360 EA 0.001\n", "x", degrees)
    open_end = parse_table(b"P001 A0 EA 0.001\nP002 A360 EA 0.002\n", "x", degrees)
    assert (closed.source.modulo, open_end.source.modulo) == (360.0, None)
    assert open_end.source.behaves_as == ('outside = "hold"',)


def test_fagor_f10_points_that_do_not_ascend_are_refused() -> None:
    with pytest.raises(TabFileError, match="position -20 after 0") as caught:
        parse_table(b"P001 X0 EX 0\nP002 X-20 EX 0\n", "x", FAGOR)
    assert caught.value.line == 2
