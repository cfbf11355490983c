"""Readings with a table and without, and of two axes, never get into one table or one report."""

from hashlib import sha256
from pathlib import Path

import pytest

from tests.support.table_commands import good, refused, run

HEADING = "target_mm,direction,run,measured_mm"
ROWS = """\
0,forward,1,0
100,forward,1,100.02
200,forward,1,200.03
200,backward,1,200.05
100,backward,1,100.04
0,backward,1,0.02
"""
REST = ROWS.replace("100.02", "100.001").replace("200.03", "200.002").replace("200.05", "200.002")
REST = REST.replace("100.04", "100.001").replace(",0.02", ",0.0005")


def write(path: Path, rows: str, *facts: str) -> Path:
    path.write_text("".join(f"# {fact}\n" for fact in facts) + f"{HEADING}\n{rows}")
    return path


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "cnc10x.tab"
    good("build", write(tmp_path / "first.csv", ROWS), path, "--to", "centroid-3", "--axis", "x")
    return path


def test_readings_with_a_table_in_use_make_no_first_table(tmp_path: Path) -> None:
    after = write(tmp_path / "after.csv", REST, "compensation: on, the table of March")
    out = tmp_path / "new.csv"
    said = refused("build", after, out, "--to", "csv")
    assert "after.csv: measured with an active table (# compensation: on, the table of March)" in said
    assert "table refine adds it to that table" in said
    assert not out.exists()


def test_readings_without_a_table_refine_none(tmp_path: Path, table: Path) -> None:
    before = write(tmp_path / "before.csv", ROWS, "Compensation: off")
    out = tmp_path / "new.tab"
    said = refused("refine", table, before, out)
    assert "before.csv: measured without a table (# compensation: off)" in said
    assert "with cnc10x.tab the error would be corrected twice" in said
    assert "table build" in said
    assert not out.exists()


def test_readings_that_do_not_say_it_but_look_uncorrected_are_named(tmp_path: Path, table: Path) -> None:
    silent = write(tmp_path / "silent.csv", ROWS)
    notes = good("refine", table, silent, tmp_path / "twice.tab")["notes"]
    assert [note for note in notes if "WITHOUT the table" in note]
    rest = write(tmp_path / "rest.csv", REST)
    notes = good("refine", table, rest, tmp_path / "better.tab")["notes"]
    assert not [note for note in notes if "WITHOUT the table" in note]


def test_refine_takes_the_table_that_the_readings_name(tmp_path: Path, table: Path) -> None:
    digest = sha256(table.read_bytes()).hexdigest()
    named = write(tmp_path / "named.csv", REST, f"compensation: active {digest}")
    good("refine", table, named, tmp_path / "better.tab")
    other = write(tmp_path / "other.csv", REST, f"compensation: active {'0' * 64}")
    said = refused("refine", table, other, tmp_path / "worse.tab")
    assert f"with the table of SHA-256 {'0' * 12}…, but cnc10x.tab has {digest[:12]}…" in said


def test_files_with_a_table_and_without_make_no_mean(tmp_path: Path) -> None:
    before = write(tmp_path / "before.csv", ROWS, "compensation: off")
    after = write(tmp_path / "after.csv", REST, "compensation: on")
    said = refused("evaluate", before, after)
    assert "before.csv was measured with compensation off" in said
    assert "after.csv with on, so their readings have no common mean" in said


def test_two_statements_in_one_file_are_refused_with_their_line(tmp_path: Path) -> None:
    both = write(tmp_path / "both.csv", ROWS, "compensation: off", "axis: x", "compensation: on")
    said = refused("evaluate", both)
    assert "both.csv:3: compensation 'on', but 'off' in an earlier line" in said


def test_a_prediction_needs_readings_without_a_table(tmp_path: Path, table: Path) -> None:
    after = write(tmp_path / "after.csv", REST, "compensation: on")
    assert "measured with an active table" in refused("evaluate", after, "--table", table)
    picture = tmp_path / "x.svg"
    assert "measured with an active table" in refused("plot", table, picture, "--readings", after)
    assert not picture.exists()


def test_before_and_after_exchanged_or_one_file_twice_are_named(tmp_path: Path) -> None:
    before = write(tmp_path / "before.csv", ROWS, "compensation: off")
    after = write(tmp_path / "after.csv", REST, "compensation: on")
    (scale,) = good("evaluate", before, "--after", after)["notes"]
    assert scale == "linear part +150 µm/m: counts_per_unit times 0.99985002 would remove it"  # 1 / 1.00015
    [note] = good("evaluate", after, "--after", before)["notes"]
    assert "exchange " in note
    note, _ = good("evaluate", before, "--after", before)["notes"]
    assert "the same readings" in note


def test_readings_and_tables_of_two_axes_do_not_meet(tmp_path: Path, table: Path) -> None:
    other = write(tmp_path / "y.csv", REST, "Axis: y")
    mine = write(tmp_path / "x.csv", ROWS, "axis: X")
    for command in (
        ("refine", table, other, tmp_path / "new.tab"),
        ("evaluate", other, "--table", table),
        ("evaluate", mine, "--after", other),
        ("evaluate", mine, other),
        ("plot", table, tmp_path / "x.svg", "--readings", other),
    ):
        said = refused(*command)
        assert "of axis y" in said
        assert "of axis X" in said
    assert "or --axis y" in refused("build", other, tmp_path / "new.csv", "--to", "csv", "--axis", "x")


def test_one_axis_in_capitals_and_not_is_one(tmp_path: Path) -> None:
    small = write(tmp_path / "small.csv", ROWS, "axis: x")
    capital = write(tmp_path / "capital.csv", REST, "axis: X")
    assert run("evaluate", small, capital).exit_code == 0
