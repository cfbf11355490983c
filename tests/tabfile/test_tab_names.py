"""Names of table files in any case; ``.bak`` means off."""

from pathlib import Path

import pytest

from gateway.tabfile import TabFileError, TableState, axis_of_name, find_axis_tables, find_table


@pytest.mark.parametrize(
    ("name", "axis"),
    [
        ("CNC7X.TAB", "X"),
        ("cnc7x.tab", "X"),
        ("cnc10z.tab", "Z"),
        ("CNC10Z.Tab", "Z"),
        ("cnc-b.tab", "B"),
        ("cnc10z.bak", "Z"),
        ("cnc10.tab", None),
        ("cnc8x.tab", None),
        ("cnc10zz.tab", None),
        ("mill.tab", None),
    ],
)
def test_axis_letter_of_a_name(name: str, axis: str | None) -> None:
    assert axis_of_name(name) == axis


def test_table_is_found_in_any_case(tmp_path: Path) -> None:
    (tmp_path / "CNC10X.TAB").touch()
    found = find_table(tmp_path, "cnc10x.tab")
    assert (found.state, found.path.name) == (TableState.PRESENT, "CNC10X.TAB")


def test_table_renamed_to_bak_is_off(tmp_path: Path) -> None:
    (tmp_path / "CNC7X.BAK").touch()
    found = find_table(tmp_path, "cnc7x.tab")
    assert (found.state, found.path.name) == (TableState.OFF, "CNC7X.BAK")


@pytest.mark.parametrize("backup", ["axis1.bak", "AXIS1.BAK", "axis1.lis.bak", "Axis1.LIS.Bak"])
def test_table_of_any_suffix_is_off_with_bak_in_place_of_it_or_behind_it(tmp_path: Path, backup: str) -> None:
    (tmp_path / backup).touch()
    found = find_table(tmp_path, "Axis1.lis")
    assert (found.state, found.path.name) == (TableState.OFF, backup)
    (tmp_path / "axis1.lis").touch()
    assert find_table(tmp_path, "Axis1.lis").state is TableState.PRESENT


def test_bak_behind_the_suffix_goes_before_one_that_may_be_of_another_file(tmp_path: Path) -> None:
    (tmp_path / "x.bak").touch()
    (tmp_path / "x.csv.bak").touch()
    assert find_table(tmp_path, "x.csv").path.name == "x.csv.bak"
    assert find_table(tmp_path, "x.cal").path.name == "x.bak"


def test_table_beside_its_old_bak_is_on(tmp_path: Path) -> None:
    (tmp_path / "cnc7x.bak").touch()
    (tmp_path / "cnc7x.tab").touch()
    assert find_table(tmp_path, "CNC7X.TAB").state is TableState.PRESENT


def test_missing_table_is_reported_where_it_was_looked_for(tmp_path: Path) -> None:
    found = find_table(tmp_path, "cnc10x.tab")
    assert (found.state, found.path) == (TableState.MISSING, tmp_path / "cnc10x.tab")


def test_names_that_differ_by_case_only_are_refused(tmp_path: Path) -> None:
    (tmp_path / "cnc10x.tab").touch()
    (tmp_path / "CNC10X.TAB").touch()
    if len(list(tmp_path.iterdir())) == 1:
        pytest.skip("the file system does not tell cases apart")
    with pytest.raises(TabFileError, match="differ only in upper and lower case"):
        find_table(tmp_path, "cnc10x.tab")


def test_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(TabFileError, match="nowhere"):
        find_table(tmp_path / "nowhere", "cnc10x.tab")


def test_tables_of_an_axis_by_the_convention(tmp_path: Path) -> None:
    for name in ("CNC7X.TAB", "cnc10x.tab", "cnc-y.tab", "cnc10x.bak", "other.tab"):
        (tmp_path / name).touch()
    assert [path.name for path in find_axis_tables(tmp_path, "x")] == ["CNC7X.TAB", "cnc10x.tab"]
