"""``pitch-gateway table plot``: what it writes, where, and what it refuses."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from typer.testing import CliRunner, Result

from gateway.cli.app import app

TABLES = Path(__file__).parents[2] / "tables"
SAMPLE = TABLES / "centroid-v3" / "cnc10z.tab"
SVG = "{http://www.w3.org/2000/svg}"


def plot(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["table", "plot", *map(str, arguments)], env={"COLUMNS": "200"})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    copy = tmp_path / "cnc10z.tab"
    copy.write_bytes(SAMPLE.read_bytes())
    return copy


def test_without_a_name_the_picture_lies_beside_the_file(file: Path) -> None:
    result = plot(file)
    picture = file.with_name("cnc10z.tab.png")
    assert result.exit_code == 0, result.stderr
    assert result.stdout == f"{picture}: {picture.stat().st_size} bytes\n"
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_report_of_a_file_says_where_it_comes_from(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "z.html"
    assert plot(file, out).exit_code == 0
    page = out.read_text()
    assert "5e114daa5ad2150775504055794ccdcc8ad9dfcc0d31e15991c2c1b91930bbc9" in page
    assert "<dd>−4 to 0 inch</dd>" in page
    assert "decided: home plus: the positions descend from 0" in page
    # moving backward at -2: -0.000250 inch = -6.35 µm; forward 0.000140 inch = 3.556 µm
    assert '<tr><th scope="row">−2</th><td>3.56</td><td>−6.35</td><td>9.91</td></tr>' in page


def test_a_dash_prints_svg_and_nothing_else(file: Path) -> None:
    result = plot(file, "-")
    assert result.exit_code == 0
    names = [group.get("id") for group in ET.fromstring(result.stdout.encode()).iter(f"{SVG}g")]
    assert "axis1-correction-forward" in names
    assert list(file.parent.iterdir()) == [file]


def test_svg_and_json_do_not_share_standard_output(file: Path) -> None:
    assert plot(file, "-", "--json").exit_code == 2


def test_json_tells_what_was_written(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "z.svg"
    told = json.loads(plot(file, out, "--json").stdout)
    assert told == {
        "file": str(file),
        "out": str(out),
        "kind": "svg",
        "bytes": out.stat().st_size,
        "axis": "Z",
        "units": "inch",
        "points": 9,
    }


def test_options_of_the_file_are_those_of_show(tmp_path: Path) -> None:
    out = tmp_path / "x.html"
    file = TABLES / "centroid-v1" / "CNC7X.TAB"
    result = plot(file, out, "--file-counts-per-unit", 64_000, "--axis", "x", "--file-home", "plus")
    assert result.exit_code == 0, result.stderr
    # the second of 24 values: -32 counts at -25 mm = -0.0005 inch = -12.7 µm, in both directions
    row = next(line for line in out.read_text().splitlines() if "<td>−12.70</td>" in line)
    assert row.startswith('<tr><th scope="row">−0.98425')
    assert row.endswith("<td>−12.70</td><td>−12.70</td><td>0.00</td></tr>")
    assert plot(file, tmp_path / "none.html").exit_code == 1
    assert not (tmp_path / "none.html").exists()


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("z.gif", "end the name with .html, .png, .svg, the formats of a report"),
        ("nowhere/z.png", "it does not exist"),
        ("cnc10z.tab", "the formats of a report"),
        ("there.png", "a file of this name exists; give a new name, or --force"),
    ],
)
def test_a_place_that_is_none_is_one_line_and_code_1(
    file: Path, tmp_path: Path, out: str, words: str
) -> None:
    (tmp_path / "there.png").write_text("mine")
    result = plot(file, tmp_path / out)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"error: {tmp_path / out}: ")
    assert words in result.stderr
    assert result.stderr.count("\n") == 1
    assert (tmp_path / "there.png").read_text() == "mine"
    assert plot(file, tmp_path / "there.png", "--force").exit_code == 0
    assert (tmp_path / "there.png").read_bytes().startswith(b"\x89PNG")


def test_a_bad_file_is_told_as_by_show(tmp_path: Path) -> None:
    bad = tmp_path / "cnc10z.tab"
    bad.write_text(SAMPLE.read_text().replace("ENTRIES 9", "ENTRIES 8"))
    result = plot(bad)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"error: {bad}:")
    assert list(tmp_path.iterdir()) == [bad]
    assert plot(tmp_path / "none.tab").exit_code == 1


CSV = """target_mm,direction,run,measured_mm
0,forward,1,0.001
0,forward,2,0.003
10,forward,1,9.996
10,forward,2,9.996
10,backward,1,10.006
10,backward,2,10.008
0,backward,1,0.010
0,backward,2,0.014
"""


def test_readings_stand_beside_what_the_table_would_leave_of_them(tmp_path: Path) -> None:
    pytest.importorskip("gateway.metrology.formats")
    readings, table, out = (tmp_path / name for name in ("laser.csv", "cnc10x.tab", "x.html"))
    readings.write_text(CSV)
    # adds -2 and +4 µm moving forward (away from home), -12 and -7 µm backward: the means less themselves
    table.write_text(
        "CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS MILLIMETER\nINTERVAL 10\nENTRIES 2\n"
        "0 -0.002 -0.012\n10 0.004 -0.007\n"
    )
    result = plot(table, out, "--readings", readings)
    assert result.exit_code == 0, result.stderr
    page = out.read_text()
    # A before: 12 + 4 sqrt 2 - -4; predicted: all means 0, the widest band is 2 x 4 sqrt 2
    row = '<tr class="total"><th scope="row"><b>A</b> accuracy</th><td>21.66</td><td>11.31</td>'
    assert row in page
    assert 'after, <span class="predicted">predicted</span>' in page
    assert "is predicted to be accurate to" in page
    assert plot(table, tmp_path / "y.html", "--readings", readings, "--runs", "sideways").exit_code == 2
    readings.write_text(CSV.replace("9.996", "9,996"))
    bad = plot(table, tmp_path / "y.html", "--readings", readings)
    assert bad.exit_code == 1
    assert bad.stderr.startswith(f"error: {readings}:")
    assert not (tmp_path / "y.html").exists()
