"""``pitch-gateway table``: every published vector through ``explain --json``; lint, convert, errors."""

import json
import os
import resource
import signal
from pathlib import Path

import pytest

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
    assert data["read_with"] == {
        "file_counts_per_unit": 254000.0,
        "v1_layout": "implicit",
        "units": "inch",
    }


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
