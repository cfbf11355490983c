"""``table formats``, the options that all commands share, ``--resample``, what a control did besides."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import typer.main

from gateway.cli.table import app
from gateway.cli.table_output import TableShown, explained
from gateway.commissioning.table_options import format_names, writable_names
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import DIALECTS, OPTIONS, FileContext, TabFileError, explain, read_table
from gateway.tabfile.conversion import resample
from tests.support.table_commands import good, run

TABLES = Path(__file__).parents[2] / "tables"
V3 = TABLES / "centroid-v3" / "cnc10z.tab"
CSV = TABLES / "csv" / "x.csv"
FAGOR = TABLES / "fagor-8055" / "manual.txt"
HEIDENHAIN = TABLES / "heidenhain-com" / "Z_PITCH.COM"


def test_every_format_is_listed_with_what_must_be_told() -> None:
    listed = {form["name"]: form for form in good("formats")["formats"]}
    assert set(listed) == {dialect.name for dialect in DIALECTS}
    assert listed["centroid-1"] == {
        "name": "centroid-1",
        "title": "Centroid version 1 (CNC7 6.00 to 7.17), one direction, encoder counts",
        "directions": 1,
        "units": "axis",
        "options": ["--units", "--file-counts-per-unit", "--v1-layout", "--file-start", "--file-home"],
        "writable": True,
        "suffix": ".tab",
    }
    assert listed["linuxcnc-0"]["options"] == ["--format", "--units", "--file-start"]
    assert listed["renishaw-ren"]["writable"] is False
    text = run("formats").stdout
    for dialect in DIALECTS:
        assert f"{dialect.name}: {dialect.title}\n" in text


def test_what_a_reader_asks_for_is_declared() -> None:
    asked = {name for dialect in DIALECTS for name in dialect.uses}
    assert asked == set(OPTIONS)


def options_of(command: str) -> set[str]:
    found: Any = typer.main.get_command(app)
    return {option for parameter in found.commands[command].params for option in parameter.opts}


@pytest.mark.parametrize("command", ["show", "explain", "lint", "convert"])
def test_every_command_takes_all_that_can_be_told_about_a_file(command: str) -> None:
    told = {f"--{name.replace('_', '-')}" for name in OPTIONS} | {"--format", "--units", "--travel", "--axis"}
    assert told <= options_of(command)


@pytest.mark.parametrize(
    ("command", "option", "names"),
    [("show", "--format", format_names()), ("convert", "--to", writable_names())],
)
def test_names_of_formats_are_completed(command: str, option: str, names: list[str]) -> None:
    found: Any = typer.main.get_command(app)
    (parameter,) = (p for p in found.commands[command].params if option in p.opts)
    completed = [item.value for item in parameter.shell_complete(None, "centroid-")]
    assert completed == [name for name in names if name.startswith("centroid-")]
    assert len(completed) == 3
    assert parameter.shell_complete(None, "nothing") == []


def test_a_format_that_nobody_knows_is_wrong_usage() -> None:
    for arguments in (("show", V3, "--format", "centroid-4"), ("convert", V3, "x", "--to", "centroid-4")):
        result = run(*arguments)
        assert result.exit_code == 2
        assert "centroid-1" in result.stderr


def test_a_told_format_that_the_text_is_not_is_refused() -> None:
    result = run("show", V3, "--format", "centroid-2")
    assert result.exit_code == 1
    assert "a text of 'centroid-3', but format = 'centroid-2'" in result.stderr


def test_resampling_says_what_changes_most_and_where(tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.txt"
    data = good("convert", V3, out, "--to", "centroid-3", "--resample", 1)
    # backward at -1.5: -0.00023 lies 0.000035 below the line from -0.00014 to -0.00025
    assert data["resampled"]["points"] == 5
    assert data["resampled"]["largest_difference"] == pytest.approx(0.000035, abs=1e-12)
    assert data["resampled"]["at"] == -1.5
    assert data["largest_difference"] == pytest.approx(0.0, abs=1e-12)
    said = run("convert", V3, out, "--to", "centroid-3", "--resample", 1, "--force").stdout
    assert "on an even grid of 5 points: corrections change by at most 3.5e-05 inch (at -1.5)" in said
    assert "files of centroid-3 are usually called *.tab" in said


@pytest.mark.parametrize("step", ["0", "-1", "4.1", "1e-9", "nan"])
def test_a_step_that_makes_no_grid_is_refused(tmp_path: Path, step: str) -> None:
    result = run("convert", V3, tmp_path / "out.tab", "--to", "centroid-3", f"--resample={step}")
    assert result.exit_code == 1
    assert "--resample with a step from 4e-05 to 4 inch" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_free_grid_becomes_even_around_home_and_keeps_its_ends() -> None:
    table = make_table([-3.0, 0.0, 3.0, 10.0], [0.0, 0.0, 0.003, 0.003], [0.0] * 4, Units.MM)
    even = resample(table, 5.0, "x.csv")
    assert list(even.table.positions) == [-5.0, 0.0, 5.0, 10.0]
    assert list(even.table.forward) == pytest.approx([0.0, 0.0, 0.003, 0.003])
    # at 3 the new line from 0 at 0 to 0.003 at 5 passes 0.0018
    assert even.difference == pytest.approx(0.0012)
    assert even.at == 3.0
    with pytest.raises(TabFileError, match="a step of 14 for a table of 13 mm"):
        resample(table, 14.0, "x.csv")


def test_a_grid_that_does_not_reach_home_begins_where_the_table_does() -> None:
    table = make_table([1.5, 2.5, 4.0], [0.0, 0.001, 0.001], [0.0] * 3, Units.MM)
    assert list(resample(table, 1.0, "x").table.positions) == [1.5, 2.5, 3.5, 4.5]


def test_the_letter_in_the_file_can_be_told(tmp_path: Path) -> None:
    out = tmp_path / "out.tab"
    good("convert", V3, out, "--to", "centroid-3", "--to-axis", "w")
    assert out.read_text().splitlines()[1] == "AXIS W"
    assert run("convert", V3, tmp_path / "b.tab", "--to", "centroid-3", "--to-axis", "xx").exit_code == 2


def test_what_the_control_did_beside_the_table_is_shown() -> None:
    loaded = read_table(V3, FileContext())
    behaves_as = ('outside = "zero"', "reversal = { cycles = 5 }")
    loaded = replace(loaded, source=replace(loaded.source, behaves_as=behaves_as))
    shown, explanation = TableShown(loaded, 0), explain(loaded, -1.0)
    assert shown.as_data()["behaves_as"] == list(behaves_as)
    assert explanation.as_data()["behaves_as"] == list(behaves_as)
    for lines in (shown.lines(), explained(explanation)):
        assert list(lines).count('to behave like its control, set for the axis: outside = "zero"') == 1


def test_a_free_grid_goes_to_a_control_of_even_grids_only_with_a_step(tmp_path: Path) -> None:
    out = tmp_path / "x.tab"
    refused = run("convert", CSV, out, "--to", "centroid-3", "--axis", "x")
    assert refused.exit_code == 1
    assert (
        "points that are not evenly spaced (at -250); allowed: an even grid: --resample STEP"
        in refused.stderr
    )
    assert not out.exists()
    data = good("convert", CSV, out, "--to", "centroid-3", "--axis", "x", "--resample", 50)
    assert data["resampled"]["points"] == 9
    # -125.5 lies 24.5 above -150; the new line ends at -100, where the table has passed -125.5
    low = 0.009 + (0.0107 - 0.009) * 100 / 124.5
    high = 0.0107 + (0.0085 - 0.0107) * 25.5 / 75.5
    assert data["resampled"]["largest_difference"] == pytest.approx(
        0.0107 - (low + (high - low) * 24.5 / 50), abs=1e-12
    )
    assert data["resampled"]["at"] == -125.5
    assert good("explain", out, "--at", -250)["forward"]["correction"] == pytest.approx(0.009, abs=1e-12)


def test_what_a_manual_leaves_open_is_told_for_reading_and_for_writing(tmp_path: Path) -> None:
    told = ("--units", "mm", "--error-sense", "actual_minus_command")
    # X90 has an error of 0.001, X130 of -0.002: half way -0.0005
    assert good("explain", FAGOR, "--at", 110, *told)["forward"]["correction"] == pytest.approx(0.0005)
    turned = good("explain", FAGOR, "--at", 110, "--units", "mm", "--error-sense", "command_minus_actual")
    assert turned["forward"]["correction"] == pytest.approx(-0.0005)
    assert "error_sense" in run("explain", FAGOR, "--at", 110, "--units", "mm").stderr
    out = tmp_path / "z_pitch.com"
    assert "--to-sense" in run("convert", FAGOR, out, *told, "--to", "heidenhain-com").stderr
    data = good(
        "convert", FAGOR, out, *told, "--to", "heidenhain-com", "--to-sense", "command_minus_actual",
        "--to-file-axis", "x",
    )  # fmt: skip
    assert data["read_with"]["error_sense"] == "command_minus_actual"
    again = good("explain", out, "--at", 110, "--error-sense", "command_minus_actual")
    assert again["forward"]["correction"] == pytest.approx(0.0005)


def test_an_old_name_of_an_option_is_taken_and_no_longer_shown() -> None:
    sense = ("--units", "mm", "--fagor-sense", "actual_minus_command")
    linted = run("lint", FAGOR, *sense)
    assert linted.exit_code == 0
    assert "info R14 write error_sense =" in linted.stdout
    assert "--fagor-sense" not in run("lint", "--help").stdout


def test_the_column_of_an_axis_is_chosen_by_its_name(tmp_path: Path) -> None:
    text = HEIDENHAIN.read_text().replace("BACKLASH", "Y       ")
    path = tmp_path / "two.com"
    path.write_text(text)
    sense = ("--error-sense", "command_minus_actual")
    assert "file_axis" in run("explain", path, "--at", 100, *sense).stderr
    for name, error in (("Z", -0.0021), ("Y", 0.0012)):
        explained = good("explain", path, "--at", 100, *sense, "--file-axis", name)
        assert explained["forward"]["correction"] == pytest.approx(error)


@pytest.mark.parametrize("name", [dialect.name for dialect in DIALECTS if not dialect.is_writable])
def test_what_no_control_reads_is_no_target(tmp_path: Path, name: str) -> None:
    result = run("convert", V3, tmp_path / "out", "--to", name)
    assert result.exit_code == 2
    assert name not in result.stderr.split("allowed:")[1]
