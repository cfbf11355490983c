"""What is told about the file to write is used, or it is said that its format has no place for it."""

import re
from pathlib import Path
from typing import Final

import pytest
from typer.testing import CliRunner

from gateway.cli.table import app
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import DIALECTS, Dialect, ErrorSense, TabFileError, V1Layout, WriteOptions
from gateway.tabfile.conversion import WRITE_OPTIONS

TABLE: Final = make_table([-2.0, -1.0, 0.0], [0.001, 0.002, 0.0], [0.001, 0.002, 0.0], Units.MM)
FULL: Final = {
    "file_counts_per_unit": (1000.0, 2000.0),
    "v1_layout": (V1Layout.LISTED, V1Layout.IMPLICIT),
    "file_axis": ("3", "4"),
    "sense": tuple(ErrorSense),
}


def text_of(dialect: Dialect, facts: dict[str, object]) -> str | None:
    """Return what is written; None where these facts are refused."""
    try:
        return dialect.write(TABLE, WriteOptions(axis="X", **facts)).text  # type: ignore[arg-type]
    except TabFileError:
        return None


@pytest.mark.parametrize("dialect", [d for d in DIALECTS if d.is_writable], ids=lambda d: d.name)
@pytest.mark.parametrize("name", WRITE_OPTIONS)
def test_a_writer_uses_what_it_is_listed_with_and_nothing_else(dialect: Dialect, name: str) -> None:
    needed = {"sense": ErrorSense.ACTUAL_MINUS_COMMAND, "file_counts_per_unit": 1000.0}
    facts = {key: fact for key, fact in needed.items() if key in dialect.writes}
    letters = {"3": "Y", "4": "Z"} if dialect.name != "mint" else {}
    one, other = ({**facts, name: letters.get(str(fact), fact)} for fact in FULL[name])
    assert (text_of(dialect, one) != text_of(dialect, other)) is (name in dialect.writes)


def test_an_option_without_a_place_in_the_file_is_said(tmp_path: Path) -> None:
    old, new = tmp_path / "x.csv", tmp_path / "new"
    old.write_text("position_mm,correction_mm\n-2,0.001\n0,0\n")
    options = ["--to-sense", "actual_minus_command", "--to-counts-per-unit", "1000", "--to-file-axis", "5"]
    told = CliRunner().invoke(app, ["convert", str(old), str(new), "--to", "linuxcnc-1", *options])
    assert told.exit_code == 0, told.stderr
    for option in options[::2]:
        assert f"not in the file: {option}: linuxcnc-1 cannot hold it" in told.stdout
    used = ["--to", "isg", "--to-sense", "actual_minus_command", "--force"]
    assert "cannot hold" not in CliRunner().invoke(app, ["convert", str(old), str(new), *used]).stdout


def test_the_scale_of_a_version_1_file_goes_with_the_units(tmp_path: Path) -> None:
    old, new = tmp_path / "CNC7X.TAB", tmp_path / "new.tab"
    old.write_text("2 25400\n0\n10\n")  # one inch in two steps
    facts = ["--units", "inch", "--file-counts-per-unit", "25400", "--v1-layout", "implicit"]
    to = ["--to", "centroid-1", "--to-units", "mm"]
    result = CliRunner().invoke(app, ["convert", str(old), str(new), *facts, *to])
    assert result.exit_code == 0, result.stderr
    # the counts of the control are what they were
    assert new.read_text().split() == old.read_text().split()
    assert "--file-counts-per-unit 1000.0 --units mm" in result.stdout


READINGS: Final = "target_mm,direction,run,measured_mm\n" + "".join(
    f"{target},{way},1,{target + 0.001 * target / 20}\n"
    for way in ("forward", "backward")
    for target in (0, 5, 20)
)
"""Free targets."""


@pytest.mark.parametrize("target", [d.name for d in DIALECTS if d.is_writable])
@pytest.mark.parametrize("facts", [(), ("--axis", "x")])
def test_the_remedy_of_build_and_refine_names_options_that_they_have(
    tmp_path: Path, target: str, facts: tuple[str, ...]
) -> None:
    readings, table = tmp_path / "readings.csv", tmp_path / "old.csv"
    readings.write_text(READINGS)
    table.write_text("position_mm,correction_mm\n0,0\n5,0.001\n20,0.002\n")
    for command in (["build", str(readings)], ["refine", str(table), str(readings)]):
        helped = CliRunner().invoke(app, [command[0], "--help"], env={"COLUMNS": "200"}).stdout
        result = CliRunner().invoke(app, [*command, str(tmp_path / "new"), "--force", "--to", target, *facts])
        if result.exit_code == 0:
            continue
        assert result.exit_code == 1
        own = re.sub("table convert with --[a-z-]+", "", result.stderr)
        named = set(re.findall(r"--[a-z-]+", own))
        assert named
        assert not {option for option in named if not re.search(rf"{option}\b(?!-)", helped)}
