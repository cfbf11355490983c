"""Plain CSV: columns that say what they are, one decimal mark, sums that show damage."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import HomeSide, WriteOptions, dialect_named, explain
from tests.support.commands import typed
from tests.tabfile.drawn import there_and_back
from tests.tabfile.texts import Texts

TABLES = Path(__file__).parents[2] / "tables" / "csv"
OURS = (TABLES / "x.csv").read_text()
ERRORS = (TABLES / "laser-errors.csv").read_text()
SMALL = "position_mm,forward_mm,backward_mm\n0,0,-0.004\n10,0.002,-0.001\n30,0.003,0.0005\n"
FILE = Texts("table.csv")
parse, refused = FILE.parse, FILE.refused


def test_corrections_are_added_as_they_stand_on_a_free_grid() -> None:
    loaded = parse(SMALL)
    assert (loaded.format, loaded.table.units) == ("csv", Units.MM)
    explained = explain(loaded, 20.0)
    # half way between 10 and 30: (0.002 + 0.003) / 2 and (-0.001 + 0.0005) / 2
    assert explained.forward.correction == pytest.approx(0.0025, abs=1e-15)
    assert explained.backward.correction == pytest.approx(-0.00025, abs=1e-15)
    assert "forward_mm: value is added unchanged" in explained.forward.rule


def test_measured_errors_in_micrometres_with_decimal_commas_are_subtracted() -> None:
    explained = explain(parse(ERRORS), 150.0)
    # forward errors -2.5 and -4.0 um: the nut is 3.25 um short, so 0.00325 mm are added
    assert explained.forward.correction == pytest.approx(0.00325, abs=1e-15)
    # backward errors 2.0 and 1.0 um
    assert explained.backward.correction == pytest.approx(-0.0015, abs=1e-15)
    assert explained.forward.file_value == pytest.approx(-3.25)
    assert "actual - commanded: subtracted" in explained.forward.rule


def test_one_correction_column_holds_in_both_directions() -> None:
    loaded = parse("correction_um\tposition_inch\n25.4\t0\n50.8\t10\n")
    assert loaded.table.is_unidirectional
    # 25.4 um are 0.001 inch
    assert list(loaded.table.forward) == pytest.approx([0.001, 0.002], abs=1e-18)
    assert loaded.table.units is Units.INCH


def test_degrees_with_seconds_of_arc() -> None:
    loaded = parse("position_degree,correction_arcsec\n0,0\n180,36\n360,0\n")
    # 36 seconds are a hundredth of a degree
    assert list(loaded.table.forward) == pytest.approx([0.0, 0.01, 0.0])


def test_positions_may_descend() -> None:
    loaded = parse("position_mm,forward_mm,backward_mm\n30,3e-3,0\n10,2e-3,0\n0,0,0\n")
    assert list(loaded.table.positions) == [0.0, 10.0, 30.0]
    assert list(loaded.table.forward) == [0.0, 0.002, 0.003]
    assert loaded.source.rows[0].forward_line == 4


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_marks_and_blanks_change_nothing(end: str) -> None:
    text = "﻿" + OURS.replace("\n", " \t" + end).replace("position_mm", "  position_mm")
    assert parse(text).table == parse(OURS).table


def test_quotes_of_a_spreadsheet_around_whole_cells_change_nothing() -> None:
    quoted = "\n".join(
        ",".join(f'"{cell}"' for cell in line.split(",")) if line else "" for line in SMALL.split("\n")
    )
    assert parse(quoted).table == parse(SMALL).table
    assert parse(SMALL.replace("0.002", ' " 0.002" ')).table == parse(SMALL).table
    for half in ('"0.002', '0.002"', '"0.0"02"', '"'):
        assert f"table.csv:3: {half!r}" in str(refused(SMALL.replace("0.002", half)))


def test_axis_of_the_comment_is_checked() -> None:
    assert parse(OURS, axis="x").source.axis == "X"
    error = refused(OURS, axis="y")
    assert "axis X, read for axis Y" in error.found
    assert error.line == 3
    # words about an axis are provenance
    assert parse("# axis: second from the left\n" + SMALL, axis="y").source.axis is None


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("forward_mm", "forward_deg", 1, "a column 'forward_deg'"),
        ("forward_mm", "forward", 1, "a column 'forward'"),
        ("forward_mm", "", 1, "a column ''"),
        ("forward_mm", "backward_mm", 1, "second backward column"),
        (",backward_mm", "", 1, "position with correction (for both directions)"),
        ("backward_mm", "correction_mm", 1, "position with correction (for both directions)"),
        ("forward_mm", "forward_um", 1, "mixed columns"),
        ("backward_mm", "backward_error_mm", 1, "mixed columns"),
        ("position_mm", "position_inch", 1, "positions in inch with values in mm"),
        ("position_mm", "position_um", 1, "positions in um"),
        ("position_mm,", "position_mm;", 1, "with commas or semicolons or tabs between"),
        ("10,0.002,-0.001", "10,0.002", 3, "2 cells"),
        ("10,0.002,-0.001", "10,0,002,-0,001", 3, "decimal commas with semicolons"),
        ("10,0.002,-0.001", "10,0,002", 3, "'002'"),
        ("10,0.002,-0.001", "10,0.002,-0.00l", 3, "-0.00l"),
        ("10,0.002,-0.001", "10,,-0.001", 3, "''"),
        ("10,0.002,-0.001", "10,nan,-0.001", 3, "nan"),
        ("10,0.002,-0.001\n", "10,0.002,-0.001\n\n", 4, "a blank line among the rows"),
        ("10,0.002,-0.001\n", "# 10,0.002,-0.001\n", 3, "a comment among the rows"),
        ("10,0.002", "0,0.002", 3, "position 0 after 0"),
        ("10,0.002", "31,0.002", 4, "position 30 after 31"),
        ("10,0.002,-0.001\n30,0.003,0.0005\n", "", 2, "at least 2 points"),
    ],
)
def test_what_is_not_grammar_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    assert message in str(refused(SMALL.replace(old, new, 1), format="csv", line=line))


@pytest.mark.parametrize("row", ["0;1,234", "0;1,234,567"])
def test_comma_that_may_group_thousands_is_refused_with_both_meanings(row: str) -> None:
    error = refused(f"position_mm;correction_um\n{row}\n10;0\n")
    assert error.line == 2
    assert "1234" in error.found
    assert "1.234" in error.found
    # as soon as one comma can be nothing else, they are all decimal marks
    assert parse("position_mm;correction_um\n0;1,234\n10;0,5\n").table.forward[0] == pytest.approx(0.001234)


@pytest.mark.parametrize(
    ("rows", "line", "found"),
    [
        ("0;0,5\n10;0,6\n20;0.7\n", 4, "'0.7' among numbers with decimal commas"),
        ("0;0.5\n10;0,6\n20;0.7\n", 3, "'0,6' among numbers with decimal points"),
    ],
)
def test_two_decimal_marks_are_refused(rows: str, line: int, found: str) -> None:
    error = refused(f"position_mm;correction_um\n{rows}")
    assert (error.line, error.found) == (line, found)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("0.0107", "0.0108", 5, "changed after"),
        ("position_mm", "position_inch", 6, "positions in inch with values in mm"),
        ("-125.5,0.0107,0.0044\n", "", 10, "4 points"),
        ("0.0107", "0.0107x", 9, "0.0107x"),
        ("-125.5,0.0107,0.0044\n", "-125.5,0.0107,0.0044\n-100,0,0\n", 12, "6 points"),
        ("forward_mm,backward_mm", "backward_mm,forward_mm", 5, "changed after"),
        ("# sha256: ", "# sha256: 0", 5, "64 digits"),
        ("# points: 5", "# points: 6", 11, "5 points"),
        ("# points: 5", "# points: five", 11, "5 points"),
        ("# axis: X", "# points: 5", 4, "a second time"),
    ],
)
def test_our_own_files_show_every_damage(old: str, new: str, line: int, message: str) -> None:
    assert message in str(refused(OURS.replace(old, new, 1), line=line))


def test_points_alone_show_a_lost_row() -> None:
    assert len(parse("# points: 3\n" + SMALL).table.positions) == 3
    error = refused("# Points : 3\n" + SMALL.replace("30,0.003,0.0005\n", ""))
    assert "2 points" in error.found
    assert "line 1" in error.allowed


def test_unit_slips_are_remarked_on() -> None:
    # corrections of 2 and 3 um that were called mm are caught by the size; um that are mm by L4
    assert "L4" in {lint.code for lint in parse("position_mm,correction_um\n0,0\n10,0.02\n").lints}
    assert {"L4", "L12"} <= {lint.code for lint in parse("position_mm,correction_mm\n0,0\n100,0.9\n").lints}


def test_told_facts_that_contradict_the_file_are_refused() -> None:
    assert "lowest position of 0" in str(refused(SMALL, file_start=-30.0))
    assert "file_home is plus" in str(refused(SMALL, file_home=HomeSide.PLUS))
    assert "outside travel" in str(refused(SMALL, travel=(-40.0, 0.0), units=Units.MM))
    error = refused(SMALL, travel=(1000.0, 2000.0), units=Units.MM)
    assert error.allowed == "a table of this axis; the right travel"
    error = refused(SMALL, travel=(0.0, 1.0), units=Units.MM)
    assert error.allowed == "at most 20% beyond the travel; the right travel or units"
    assert "but file_units = inch" in str(refused(SMALL, file_units=Units.INCH))
    assert "axis in degree" in str(refused(SMALL, units=Units.DEGREE))


_NUMBERS = st.floats(-0.4, 0.4)


@st.composite
def _tables(draw: st.DrawFn) -> CorrectionTable:
    steps = draw(st.lists(st.floats(1.0, 500.0), min_size=1, max_size=30))
    positions = [draw(st.floats(-1e4, 1e4))]
    for step in steps:
        positions.append(positions[-1] + step)
    size = len(positions)
    forward = draw(st.lists(_NUMBERS, min_size=size, max_size=size))
    backward = forward if draw(st.booleans()) else draw(st.lists(_NUMBERS, min_size=size, max_size=size))
    return make_table(positions, forward, backward, draw(st.sampled_from(Units)))


@given(_tables())
def test_every_table_comes_back_to_the_last_digit(table: CorrectionTable) -> None:
    written, again = there_and_back("csv", table, axis="z")
    assert again.table == table
    assert written.losses == ()
    assert again.source.axis == "Z"


def test_text_of_the_writer() -> None:
    table = make_table([0.0, 0.1], [0.0, 1e-05], [0.0, 1e-05], Units.INCH)
    # the sum was made by sha256sum of the three rows
    assert dialect_named("csv").write(table, WriteOptions()).text.splitlines()[1:] == [
        "# points: 2",
        "# sha256: eec905865a9eba2f9bbdf0a732654c34ee9f6b7cf315f7e679f868272221e57f",
        "position_inch,correction_inch",
        "0.0,0.0",
        "0.1,1e-05",
    ]


def test_what_a_spreadsheet_adds_is_named_with_what_to_do() -> None:
    plain = "position_mm;forward_mm;backward_mm\n0;0;0\n10;0.01;0.02\n"
    assert "remove the empty columns" in str(refused(plain.replace("\n", ";;\n")))
    assert "remove this one" in str(refused(plain + ";;\n"))


@pytest.mark.parametrize(
    ("text", "shown", "header"),
    [
        ("0,0.0,0.01\n10,0.01,0.02\n", "'0,0.0,0.01'", "position_mm,forward_mm,backward_mm"),
        ("x,fwd,bwd\n0,0.0,0.01\n", "of 9 characters", "position_mm,forward_mm,backward_mm"),
        (
            "Position;Vor;Zurueck\n0;0,0;0,01\n",
            "of 20 characters",
            "position_mm;forward_mm;backward_mm, or position_mm;correction_mm",
        ),
    ],
)
def test_a_csv_without_our_header_is_told_the_header(text: str, shown: str, header: str) -> None:
    said = str(refused(text))
    assert f"table.csv:1: a CSV whose first line, {shown}, is not the header of a table" in said
    assert f"allowed: the first line {header}" in said
    assert "pitch-gateway table template prints such a file" in said


@pytest.mark.parametrize("options", [[], ["--semicolons"], ["--units", "inch"]])
def test_the_template_is_a_table_to_fill_in(options: list[str]) -> None:
    printed = typed("table", "template", *options)
    assert printed.returncode == 0
    assert set(parse(printed.stdout).table.forward) == {0.0}
    separator = ";" if "--semicolons" in options else ","
    filled = printed.stdout.replace(separator.join(("50", "0", "0")), separator.join(("50", "0.01", "0.02")))
    assert explain(parse(filled), 50.0).backward.correction == 0.02
