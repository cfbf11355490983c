"""``pitch-gateway table``: published vectors, lint, convert, formats, the options that commands share."""

import json
import os
import resource
import signal
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
from tests.support.table_commands import good, refused, run

TABLES = Path(__file__).parents[2] / "tables"
V1 = str(TABLES / "centroid-v1" / "CNC7X.TAB")
V2 = str(TABLES / "centroid-v2" / "cnc10z.tab")
V2_TB058 = str(TABLES / "centroid-v2-tb058" / "cnc10z.tab")
V3 = str(TABLES / "centroid-v3" / "cnc10z.tab")
MM = 1 / 25.4


@pytest.fixture
def tb058_v1(tmp_path: Path) -> Path:
    """The seven values that TB058 prints; the other 59 are zeros made up here."""
    path = tmp_path / "CNC7X.TAB"
    path.write_text("\n".join(["66 1320000", "20", "12", "4", "-4", "-12", "-16", "-3", *["0"] * 59]))
    return path


@pytest.mark.parametrize(
    ("arguments", "units", "forward", "backward"),
    [
        ([V1, "--at", -25 * MM, "--file-counts-per-unit", 64000], "inch", -0.0005, -0.0005),
        ([V1, "--at", -12.5 * MM, "--file-counts-per-unit", 64000], "inch", -0.00025, -0.00025),
        ([V1, "--at", 25 * MM, "--file-counts-per-unit", -64000], "inch", 0.0005, 0.0005),
        ([V1, "--at", -25, "--file-counts-per-unit", 64000 * MM, "--units", "mm"], "mm", -0.0127, -0.0127),
        (
            [V1, "--at", -12.5, "--file-counts-per-unit", 64000 * MM, "--units", "mm"],
            "mm",
            -0.00635,
            -0.00635,
        ),
        ([V1, "--at", 25, "--file-counts-per-unit", -64000 * MM, "--units", "mm"], "mm", 0.0127, 0.0127),
        ([V2_TB058, "--at", -1.25, "--file-start", -2.5], "inch", 0.00045, 0.00005),
        ([V2_TB058, "--at", -1.25, "--travel", -2.6, 0], "inch", 0.00045, 0.00005),
        ([V2_TB058, "--at", -0.5, "--file-start", -2.5], "inch", 0.0006, -0.0001),
        ([V2, "--at", 0], "inch", 0.00004272, -0.00017938),
        ([V2, "--at", -4.5, "--file-start", -4.5, "--travel", -5, 0], "inch", 0.00004272, -0.00017938),
        ([V3, "--at", -1.25], "inch", 0.00012, -0.000185),
        ([V3, "--at=-0.25", "--file-home", "plus"], "inch", 0.000015, -0.00005),
    ],
)
def test_published_vectors(arguments: list[object], units: str, forward: float, backward: float) -> None:
    data = good("explain", *arguments)
    assert data["units"] == units
    assert data["forward"]["correction"] == pytest.approx(forward, abs=1e-9)
    assert data["backward"]["correction"] == pytest.approx(backward, abs=1e-9)


@pytest.mark.parametrize(("at", "correction"), [(0, 0.0), (0.25, 0.00025), (0.5, 0.0005), (2.25, -0.0002)])
def test_published_vectors_of_tb058_version_1(tb058_v1: Path, at: float, correction: float) -> None:
    data = good("explain", tb058_v1, "--at", at, "--file-counts-per-unit", 40000)
    assert data["forward"]["correction"] == pytest.approx(correction, abs=1e-12)
    assert data["backward"]["correction"] == pytest.approx(correction, abs=1e-12)


def test_tb058_typo_taken_literally_corrects_nothing(tmp_path: Path) -> None:
    path = tmp_path / "cnc10z.tab"
    path.write_text(Path(V2_TB058).read_text().replace("-1.0000", "-0.0001"))
    data = good("explain", path, "--at", -0.5, "--file-start", -2.5)
    assert data["backward"]["correction"] == pytest.approx(-1e-8, abs=1e-15)
    assert "L4" in {lint["code"] for lint in data["lints"]}
    assert "L4" in run("lint", path, "--file-start", -2.5).stderr
    assert run("lint", path, "--file-start", -2.5).exit_code == 1


def test_explain_tells_where_a_correction_comes_from() -> None:
    data = good("explain", V3, "--at", -1.25, "--counts-per-unit", 100000)
    assert data["at"] == -1.25
    assert data["forward"]["segment"][0] == {
        "position": -1.5,
        "correction": 0.00013,
        "file_value": 0.00013,
        "line": 9,
    }
    assert "column 3, towards home" in data["forward"]["sign_rule"]
    # -1.24988 x 100000 and -1.250185 x 100000 = -125018.5, rounded half to even
    assert data["forward"]["counts"] == -124988
    assert data["backward"]["counts"] in (-125018, -125019)
    assert data["forward"]["nominal_counts"] == -125000


def test_explain_outside_the_table_says_so_and_what_hold_gives() -> None:
    data = good("explain", V2_TB058, "--at", -2.6, "--travel", -2.6, 0)
    assert data["outside"] == "below"
    assert data["policy"] == "hold"
    assert data["forward"]["correction"] == 0.0002
    assert "outside the table" in run("explain", V2_TB058, "--at", 1, "--file-start", -2.5).stdout


def test_explain_prints_the_same_for_people() -> None:
    output = run("explain", V3, "--at", -1.25, "--counts-per-unit", 1000).stdout
    for text in ("+0.00012 inch", "-0.000185 inch", "-1.5 (line 9)", "towards home", "counts", "home plus"):
        assert text in output


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([V1, "--at", 0], "file_counts_per_unit"),
        ([V2_TB058, "--at", 0], "reading 2: file_start 0"),
        ([V2, "--at", 0, "--travel", -5, 0], "reading 2: file_start -4.5"),
        ([V3, "--at", 0, "--file-home", "minus"], "file_home"),
        ([V3, "--at", 0, "--file-start", 0], "file_start"),
        ([V3, "--at", 0, "--units", "mm"], "units inch, but the given units are mm"),
        ([V3, "--at", 0, "--axis", "x"], "AXIS Z"),
        (
            [V1, "--at", 0, "--file-counts-per-unit", 64000, "--file-home", "minus"],
            "so home is at the plus end",
        ),
        ([V2, "--at", 0, "--file-counts-per-unit", 20000], "counts per inch"),
        (["nowhere.tab", "--at", 0], "no such file"),
        ([TABLES, "--at", 0], "a folder"),
    ],
)
def test_what_is_not_proven_or_contradicted_is_one_line_on_stderr(arguments: list[object], text: str) -> None:
    assert text in refused("explain", *arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--at", "nan"],
        ["--at", "1e300"],
        ["--at", "x"],
        ["--at", 0, "--travel", 1, -1],
        ["--at", 0, "--units", "foot"],
        [],
    ],
)
def test_wrong_usage_ends_with_2(arguments: list[object]) -> None:
    assert run("explain", V3, *arguments).exit_code == 2


def test_show() -> None:
    data = good("show", V3)
    assert (data["format"], data["points"], data["range"]) == ("centroid-3", 9, [-4.0, 0.0])
    assert data["rows"][8]["position"] == 0.0
    output = run("show", V3, "--limit", 3).stdout
    assert "6 more points" in output


def test_lint_of_a_good_file() -> None:
    assert good("lint", V3) == {"file": V3, "format": "centroid-3", "ok": True, "lints": []}
    assert "0 error(s), 0 warning(s)" in run("lint", V3).stdout


def test_lint_fails_on_errors_and_with_strict_on_warnings() -> None:
    assert run("lint", V3, "--travel", -4.2, 0).exit_code == 0
    assert run("lint", V3, "--travel", -4.2, 0, "--strict").exit_code == 1
    result = run("lint", V3, "--max-slope", 0.0001, "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["lints"][0]["code"] == "L1"
    assert "max_slope 0.0001" in refused("lint", V3, "--max-slope", 0.0001)
    assert "L12" in refused("lint", V3, "--max-correction", 0.0001)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("ENTRIES 9", "ENTRIES 8", 14),
        ("-0.00014000", "-0.00014OOO", 8),
        ("-1.50000000", "-0.50000000", 9),
        ("VERSION 3", "VERSION 9", 1),
        ("+0.00014000", "+1.40000000", 10),
    ],
)
def test_lint_names_file_and_line_of_bad_input(tmp_path: Path, old: str, new: str, line: int) -> None:
    path = tmp_path / "cnc10z.tab"
    path.write_text(Path(V3).read_text().replace(old, new))
    result = run("lint", path, "--json")
    assert result.exit_code == 1
    assert f"{path}:{line}:" in result.stderr
    report = json.loads(result.stdout)
    assert (report["ok"], report["lints"][0]["line"]) == (False, line)


@pytest.mark.parametrize("content", [b"", b"\x00\x01\x02", b"hello\n"])
def test_lint_of_what_is_no_table(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "cnc10z.tab"
    path.write_bytes(content)
    assert str(path) in refused("lint", path)


def test_convert_says_what_the_target_cannot_hold(tmp_path: Path) -> None:
    out = tmp_path / "CNC7Z.TAB"
    data = good("convert", V3, out, "--to", "centroid-1", "--to-counts-per-unit", 254000)
    assert out.read_bytes().startswith(b"8 -1016000\r\n")
    assert any("one correction for both directions" in loss for loss in data["losses"])
    # the columns differ by 3.9 tenths at most, at -2: half of it is lost, and up to half a count
    assert data["largest_difference"] == pytest.approx(0.000195, abs=2.1e-6)
    assert data["read_with"] == {"file_counts_per_unit": 254000.0, "v1_layout": "implicit", "units": "inch"}


def test_convert_between_versions_keeps_the_corrections(tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.tab"
    data = good("convert", V2_TB058, out, "--to", "centroid-3", "--file-start", -2.5)
    assert data["largest_difference"] < 1e-8
    explained = good("explain", out, "--at", -1.25)
    assert explained["forward"]["correction"] == pytest.approx(0.00045, abs=1e-12)
    assert explained["backward"]["correction"] == pytest.approx(0.00005, abs=1e-12)


def test_convert_into_other_units(tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.tab"
    good("convert", V3, out, "--to", "centroid-2", "--to-units", "mm", "--to-counts-per-unit", 1000)
    explained = good("explain", out, "--at", -31.75, "--file-counts-per-unit", 1000)
    assert explained["units"] == "mm"
    assert explained["forward"]["correction"] == pytest.approx(0.00012 * 25.4, abs=1e-7)


def test_convert_overwrites_only_with_force(tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.tab"
    out.write_text("precious")
    assert "--force" in refused("convert", V3, out, "--to", "centroid-2")
    assert out.read_text() == "precious"
    assert run("convert", V3, out, "--to", "centroid-2", "--force").exit_code == 0
    assert out.read_text().startswith("2 8 0.5 20 1 0")
    assert [path.name for path in tmp_path.iterdir()] == ["cnc10z.tab"]


def test_convert_with_force_keeps_the_mode_of_the_file_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.tab"
    out.write_text("old")
    out.chmod(0o640)
    good("convert", V3, out, "--to", "centroid-2", "--force")
    assert out.stat().st_mode & 0o777 == 0o640
    assert [path.name for path in tmp_path.iterdir()] == ["cnc10z.tab"]


def test_convert_with_force_writes_the_file_that_a_link_names(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    real = tmp_path / "real" / "cnc10z.tab"
    real.write_text("old")
    link = tmp_path / "link.tab"
    link.symlink_to(real)
    good("convert", V3, link, "--to", "centroid-2", "--force")
    assert link.is_symlink()
    assert real.read_text().startswith("2 8 0.5 20 1 0")


def test_convert_with_force_refuses_what_is_no_regular_file(tmp_path: Path) -> None:
    folder, fifo, link = tmp_path / "folder", tmp_path / "fifo", tmp_path / "null"
    folder.mkdir()
    os.mkfifo(fifo)
    link.symlink_to("/dev/null")
    assert "a folder; allowed: a regular file" in refused(
        "convert", V3, folder, "--to", "centroid-2", "--force"
    )
    assert "a FIFO" in refused("convert", V3, fifo, "--to", "centroid-2", "--force")
    assert "/dev/null: a device" in refused("convert", V3, link, "--to", "centroid-2", "--force")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fifo", "folder", "null"]
    assert list(folder.iterdir()) == []


def test_convert_that_cannot_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.tab"
    out.write_text("old")
    # 16 bytes are the largest file that this process may write: the table does not fit.
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (16, limits[1]))
        forced = run("convert", V3, out, "--to", "centroid-2", "--force")
        new = run("convert", V3, tmp_path / "new.tab", "--to", "centroid-2")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert (forced.exit_code, new.exit_code) == (1, 1)
    assert "File too large" in forced.stderr
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("cnc10z.tab", "old")]


def test_convert_names_the_option_for_the_counts_per_unit(tmp_path: Path) -> None:
    out = tmp_path / "out.tab"
    assert "--to-counts-per-unit" in refused("convert", V3, out, "--to", "centroid-1")
    # 0.1 counts per inch x 4 inch of travel are 0.4 counts
    for target in ("centroid-1", "centroid-2"):
        line = refused("convert", V3, out, "--to", target, "--to-counts-per-unit", 0.1)
        assert "a larger scale: --to-counts-per-unit" in line
    for scale in ("nan", "0", "1e300"):
        result = run("convert", V3, out, "--to", "centroid-1", "--to-counts-per-unit", scale)
        assert result.exit_code == 2
        assert "--to-counts-per-unit" in result.stderr


def test_show_tells_corrections_from_the_numbers_of_the_file() -> None:
    output = run("show", V3).stdout
    for heading in ("forward correction", "backward correction", "forward file value", "backward file value"):
        assert output.count(heading) == 1


@pytest.mark.parametrize("slope", ["1", "1.5", "0", "nan"])
def test_a_limit_of_slope_that_could_not_be_read_back_is_wrong_usage(slope: str) -> None:
    result = run("lint", V3, "--max-slope", slope)
    assert result.exit_code == 2
    assert "above 0 and below 1" in " ".join(result.stderr.replace("│", " ").split())


@pytest.mark.parametrize("letter", ["", "xy", "1", "é"])
def test_an_axis_that_is_no_letter_is_wrong_usage(letter: str) -> None:
    result = run("lint", V3, "--axis", letter)
    assert result.exit_code == 2
    assert "one letter, A to Z" in " ".join(result.stderr.replace("│", " ").split())


def test_convert_refuses_what_it_cannot_write(tmp_path: Path) -> None:
    out = tmp_path / "out.tab"
    assert "counts per unit" in refused("convert", V3, out, "--to", "centroid-1")
    assert "written" in refused("convert", V3, tmp_path / "nowhere" / "out.tab", "--to", "centroid-2")
    assert run("convert", V3, out, "--to", "centroid-9").exit_code == 2
    assert not out.exists()


@pytest.mark.parametrize("command", ["show", "explain", "lint", "convert"])
def test_help_has_examples(command: str) -> None:
    assert "Examples:" in run(command, "--help").stdout


def test_position_far_outside_is_explained_too() -> None:
    assert good("explain", V3, "--at", -1e8)["outside"] == "below"


# ``table formats``, the options that all commands share, ``--resample``, what a control did besides.


V3_FORMATS = TABLES / "centroid-v3" / "cnc10z.tab"
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
    for arguments in (
        ("show", V3_FORMATS, "--format", "centroid-4"),
        ("convert", V3_FORMATS, "x", "--to", "centroid-4"),
    ):
        result = run(*arguments)
        assert result.exit_code == 2
        assert "centroid-1" in result.stderr


def test_a_told_format_that_the_text_is_not_is_refused() -> None:
    result = run("show", V3_FORMATS, "--format", "centroid-2")
    assert result.exit_code == 1
    assert "a text of 'centroid-3', but format = 'centroid-2'" in result.stderr


def test_resampling_says_what_changes_most_and_where(tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.txt"
    data = good("convert", V3_FORMATS, out, "--to", "centroid-3", "--resample", 1)
    # backward at -1.5: -0.00023 lies 0.000035 below the line from -0.00014 to -0.00025
    assert data["resampled"]["points"] == 5
    assert data["resampled"]["largest_difference"] == pytest.approx(0.000035, abs=1e-12)
    assert data["resampled"]["at"] == -1.5
    assert data["largest_difference"] == pytest.approx(0.0, abs=1e-12)
    said = run("convert", V3_FORMATS, out, "--to", "centroid-3", "--resample", 1, "--force").stdout
    assert "on an even grid of 5 points: corrections change by at most 3.5e-05 inch (at -1.5)" in said
    assert "files of centroid-3 are usually called *.tab" in said


@pytest.mark.parametrize("step", ["0", "-1", "4.1", "1e-9", "nan"])
def test_a_step_that_makes_no_grid_is_refused(tmp_path: Path, step: str) -> None:
    result = run("convert", V3_FORMATS, tmp_path / "out.tab", "--to", "centroid-3", f"--resample={step}")
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
    good("convert", V3_FORMATS, out, "--to", "centroid-3", "--to-axis", "w")
    assert out.read_text().splitlines()[1] == "AXIS W"
    assert (
        run("convert", V3_FORMATS, tmp_path / "b.tab", "--to", "centroid-3", "--to-axis", "xx").exit_code == 2
    )


def test_what_the_control_did_beside_the_table_is_shown() -> None:
    loaded = read_table(V3_FORMATS, FileContext())
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
    result = run("convert", V3_FORMATS, tmp_path / "out", "--to", name)
    assert result.exit_code == 2
    assert name not in result.stderr.split("allowed:")[1]
