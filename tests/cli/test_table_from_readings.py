"""``pitch-gateway table build, refine, evaluate, program``."""

from pathlib import Path

import pytest

from gateway.compensation.units import Units
from gateway.metrology.readings import APPROACHES
from gateway.metrology.tables import correction_at
from gateway.tabfile import FileContext, read_table
from tests.metrology.iso230_readings import REPORTS
from tests.metrology.samples import RTL, TB058_MANUAL
from tests.support.table_commands import good, refused, run

ORACLE = "bifrost slits 11358 axis 1 (2021-11-03)"


@pytest.fixture
def manual(tmp_path: Path) -> Path:
    path = tmp_path / "z.csv"
    path.write_text(TB058_MANUAL)
    return path


@pytest.fixture
def rtl(tmp_path: Path) -> Path:
    path = tmp_path / "x.rtl"
    path.write_bytes(RTL.encode())
    return path


@pytest.fixture
def oracle(tmp_path: Path) -> Path:
    lines = ["target_mm,direction,run,measured_mm"]
    lines += [
        f"{target},{way},{number},{measured}"
        for way in ("forward", "backward")
        for target, runs in REPORTS[ORACLE][way].items()
        for number, measured in enumerate(runs, start=1)
    ]
    path = tmp_path / "slits.csv"
    path.write_text("\n".join(lines))
    return path


def test_a_csv_of_readings_has_no_digits_that_no_instrument_shows(oracle: Path, tmp_path: Path) -> None:
    good("build", oracle, tmp_path / "x.csv", "--to", "csv")
    rows = [line for line in (tmp_path / "x.csv").read_text().splitlines() if line[:1] in "-0123456789"]
    numbers = [number for row in rows for number in row.split(",")]
    assert len(numbers) >= 3 * len(REPORTS[ORACLE]["forward"])
    assert max(len(number.partition(".")[2]) for number in numbers) <= 7


AS_PRINTED = """DRO position\tMeasured position\tCalculated encoder count value
0.5\t0.4995\t20 = 5 * 8000 * (0.5 - 0.4995)
1\t0.9997\t12
1.5\t1.4999\t4
2\t2.0001\t-4
2.5\t2.5003\t-12
3\t3.0004\t-16
3.5\t3.50007\t-3
"""
"""TB058, version 7.17: no row at home, where the instrument was set to 0."""


def test_build_takes_the_recording_of_version_7_17_as_it_is_printed(tmp_path: Path) -> None:
    sheet = tmp_path / "x.csv"
    sheet.write_text(AS_PRINTED)
    out = tmp_path / "CNC7X.TAB"
    told = ("--to", "centroid-1", "--one-way", "--units", "inch", "--to-counts-per-unit", "40000")
    data = good("build", sheet, out, "--home", "switch-positive", *told)
    # 7 entries over 7 x 0.5 inch at 40000 counts an inch; 40000 x (DRO - measured), the last -2.8 is -3
    assert out.read_text().split() == ["7", "140000", "20", "12", "4", "-4", "-12", "-16", "-3"]
    assert any("Its correction is 0 by definition" in note for note in data["notes"])
    # without --home nothing is added: 0.5 is the first point
    data = good("build", sheet, tmp_path / "x.tab", "--to", "csv", *told[2:5])
    assert data["points"] == 7


def test_build_writes_the_table_of_tb058_and_says_what_it_estimated(manual: Path, tmp_path: Path) -> None:
    out = tmp_path / "cnc10z.tab"
    data = good("build", manual, out, "--home", "switch-negative")
    assert [line.split(";")[0].strip() for line in out.read_text().splitlines()] == [
        "2 5 0.5 20 1 0",
        *("2.0000", "3.0000", "4.0000", "5.0000", "6.0000", "7.0000"),
        "",
        *("3.0000", "2.0000", "1.0000", "0.0000", "-1.0000", "0.0000"),
    ]
    assert data["read_with"] == {"file_start": -2.5}
    assert any("estimated from the reversal of its neighbour" in note for note in data["notes"])
    # One approach is missing at 0: what is left is said of each direction, not of both.
    assert data["predicted"]["both"]["E"] is None
    assert data["predicted"]["forward"]["E"] == pytest.approx(0.0, abs=1e-12)
    assert "1 of 6 targets approached from one side only" in data["predicted"]["missing"]


def test_build_for_a_person_names_the_notes_on_stderr(manual: Path, tmp_path: Path) -> None:
    result = run("build", manual, tmp_path / "cnc10z.tab", "--home", "switch-negative")
    assert result.exit_code == 0
    assert "note: home: the backward correction at 0 is 0" in result.stderr
    assert "E  systematic error" in result.stdout
    assert "6 points from -2.5 to 0 inch" in result.stdout


def test_the_other_meaning_of_a_home_case_is_named(manual: Path, tmp_path: Path) -> None:
    """The targets go from -2.5 to 0 inch, so that the switch of this machine is at the positive end."""
    result = run("build", manual, tmp_path / "cnc10z.tab", "--home", "switch-positive")
    assert result.exit_code == 1
    assert (
        "home switch-positive means positive positions, with the switch at the negative end of travel, but "
        "the targets are -2.5 to 0; choose switch-negative if the switch is at the positive end, or mark"
    ) in result.stderr


def test_build_reads_several_files_as_runs_and_converts_units(rtl: Path, tmp_path: Path) -> None:
    twice = tmp_path / "again.rtl"
    twice.write_bytes(rtl.read_bytes())
    out = tmp_path / "x.tab"
    data = good(
        "build", rtl, twice, out, "--to", "centroid-3", "--to-units", "inch", "--home", "switch-positive"
    )
    assert data["units"] == "inch"
    assert data["before"]["targets"][0]["runs"] == [2, 2]
    table = read_table(out, FileContext()).table
    assert table.units is Units.INCH
    assert table.last == pytest.approx(100 / 25.4, abs=1e-6)
    # Deviation forward at 40 mm is 3 µm, at home 0: 3 µm less are told there.
    assert correction_at(table, 40 / 25.4, APPROACHES[0]) == pytest.approx(-0.003 / 25.4, abs=1e-6)


def test_build_never_writes_over_readings(manual: Path, rtl: Path) -> None:
    assert "a file of readings; allowed: another name for OUT" in refused("build", rtl, manual, "--force")
    assert manual.read_text() == TB058_MANUAL


def test_build_refuses_in_one_line(manual: Path, rtl: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.tab"
    assert "choose switch-negative if the switch is at the positive end" in refused(
        "build", manual, out, "--home", "switch-positive"
    )
    assert "of units inch" in refused("build", manual, rtl, out)
    assert "not both" in refused("build", manual, out, "--step", 0.5, "--tolerance", 0.1)
    assert "no such file" in refused("build", tmp_path / "no.csv", out).lower()
    manual.write_text(TB058_MANUAL.replace("-1.0003", "-1,0003"))
    assert "perhaps because of a decimal comma" in refused("build", manual, out)
    assert not out.exists()
    assert run("build", manual, out, "--to", "centroid-9").exit_code == 2


def test_uneven_targets_need_a_step_for_an_even_format(tmp_path: Path) -> None:
    readings = tmp_path / "r.csv"
    stops = ((0, 0), (7, 7.001), (20, 20.002), (31, 31.004))
    rows = [f"{t},{way},1,{m}" for way in ("forward", "backward") for t, m in stops]
    readings.write_text("\n".join(["target_mm,direction,run,measured_mm", *rows]))
    told = refused("build", readings, tmp_path / "a.tab")
    assert "--step" in told
    assert "--resample" not in told
    data = good("build", readings, tmp_path / "a.tab", "--step", 10)
    assert data["points"] == 4
    assert any("from 30 to 31 mm" in note for note in data["notes"])


def test_evaluate_gives_the_published_results(oracle: Path) -> None:
    both = good("evaluate", oracle)["before"]["both"]
    assert {name: round(value, 5) for name, value in both.items()} == {
        "A": 0.01857,
        "R": 0.00835,
        "E": 0.01599,
        "M": 0.01495,
        "B": 0.00456,
        "Bm": 0.0007,
    }


def test_evaluate_predicts_what_a_table_leaves_and_compares_with_what_was_measured(
    oracle: Path, tmp_path: Path
) -> None:
    table = tmp_path / "slits.tab"
    good("build", oracle, table, "--step", 10.2)
    predicted = good("evaluate", oracle, "--table", table, "--file-start", 20.4)
    assert predicted["is_predicted"]
    assert predicted["after"]["both"]["R"] is not None
    measured = good("evaluate", oracle, "--after", oracle)
    assert measured["after"] == measured["before"]
    assert not measured["is_predicted"]
    shown = run("evaluate", oracle, "--after", oracle)
    assert "0.01857" in shown.stdout
    assert "100%" in shown.stdout
    assert run("evaluate", oracle, "--after", oracle, "--table", table).exit_code == 2


def test_a_part_of_the_axis_is_not_compared_with_the_whole(oracle: Path, tmp_path: Path) -> None:
    heading, *lines = oracle.read_text().splitlines()
    targets = sorted({float(line.split(",")[0]) for line in lines})
    part = tmp_path / "part.csv"
    part.write_text(
        "\n".join([heading, *(line for line in lines if float(line.split(",")[0]) in targets[:2])])
    )
    result = run("evaluate", oracle, "--after", part)
    assert result.exit_code == 0
    first, second, last = (f"{targets[index]:g}" for index in (0, 1, -1))
    assert f"note: measured over {first} to {second} mm instead of {first} to {last} mm" in result.stderr
    assert "%" not in result.stdout
    assert "100%" in run("evaluate", oracle, "--after", oracle).stdout


def test_refine_adds_what_is_left(tmp_path: Path) -> None:
    first = tmp_path / "before.csv"
    rows = [f"{x},{way},1,{x + 0.002 * x / 10}" for way in ("forward", "backward") for x in (0, 10, 20)]
    first.write_text("\n".join(["target_mm,direction,run,measured_mm", *rows]))
    old, new = tmp_path / "cnc10x.tab", tmp_path / "better.tab"
    good("build", first, old, "--home", "switch-positive", "--to", "centroid-3", "--axis", "x")
    after = tmp_path / "after.csv"
    left = [f"{x},{way},1,{x + 0.001}" for way in ("forward", "backward") for x in (0, 10, 20)]
    after.write_text("\n".join(["target_mm,direction,run,measured_mm", *left]))
    data = good("refine", old, after, new)
    assert data["largest_change"] == pytest.approx(0.001)
    assert list(read_table(new, FileContext()).table.forward) == pytest.approx([-0.001, -0.003, -0.005])
    kept = tmp_path / "kept.tab"
    good("refine", old, after, kept, "--home", "switch-positive")
    assert list(read_table(kept, FileContext()).table.forward) == pytest.approx(
        [0.0, -0.002, -0.004], abs=1e-9
    )
    assert "a file of this name" in refused("refine", old, after, new)


def test_program_writes_what_tb058_prints(tmp_path: Path) -> None:
    result = run("program", "--from", 0, "--to", 33, "--step", 0.5, "--write", "endless", "--units", "inch")
    assert result.stdout == "G91X.5\nG4P5\nM102\n"
    assert "until the software travel limit" in result.stderr
    out = tmp_path / "targets.txt"
    assert run("program", out, "--from", 0, "--to", 500, "--targets", 11, "--write", "list").exit_code == 0
    targets = [float(line) for line in out.read_text().splitlines()]
    assert len(targets) == 11
    assert targets == sorted(targets)
    few = run("program", "--from", 0, "--to", 500, "--targets", 3)
    assert "ISO 230-2 asks for 5" in few.stderr
    assert "the axis goes from" in few.stderr
    assert run("program", "--from", 0, "--to", 500).exit_code == 2
    assert run("program", "--from", 0, "--to", 500, "--step", 5, "--targets", 3).exit_code == 2


def test_a_program_says_in_which_coordinates_and_units_it_moves() -> None:
    span = ("--from", 0, "--to", 100, "--step", 50)
    cycle = run("program", *span)
    assert "cancel work and tool offsets" in cycle.stderr
    endless = run("program", *span, "--write", "endless")
    assert "G91 stays active after the program: command G90 first" in endless.stderr
    assert run("program", *span, "--write", "endless", "--travel", 0, 90).exit_code == 2
    listed = refused("program", *span, "--write", "list", "--travel", 0, 90)
    assert "the targets go from 0 to 100, but the travel is 0 to 90" in listed


def test_a_format_of_one_curve_wants_one_that_is_zero_at_home(rtl: Path, tmp_path: Path) -> None:
    out = tmp_path / "CNC7X.TAB"
    command = (
        "build",
        rtl,
        out,
        "--to",
        "centroid-1",
        "--home",
        "switch-positive",
        "--to-counts-per-unit",
        10000,
    )
    assert "--one-way makes one curve that is 0 at home" in refused(*command)
    good(*command, "--one-way")
    # Means of both directions in µm: 1 2.5 4 3 0 -3.5; negated and less the one at home: 0 -1.5 -3 -2 1 4.5.
    assert out.read_text().split() == ["5", "1000000", "-15", "-30", "-20", "10", "45"]


def test_what_a_first_table_is_warned_of_can_be_true_of_readings(tmp_path: Path, manual: Path) -> None:
    # TB058's own readings have a reversal that grows along the axis, as a list in the wrong order would show
    built = good("build", manual, tmp_path / "cnc10z.tab")
    assert "L3" not in [lint["code"] for lint in built["lints"]]
    assert "L3" in run("lint", tmp_path / "cnc10z.tab", "--file-start", "-2.5").output
    # with 0 at home, the last reverse value, the file itself shows that its list stands the right way
    good("build", manual, tmp_path / "home.tab", "--home", "switch-negative")
    assert "L3" not in run("lint", tmp_path / "home.tab", "--file-start", "-2.5").output


def test_a_table_that_cannot_be_used_names_no_line_of_a_file_that_is_not_there(tmp_path: Path) -> None:
    rows = [
        f"{target},{way},1,{target * 0.03 + lost}"
        for way, lost in (("forward", 0), ("backward", 20))
        for target in range(0, 1001, 200)
    ]
    wide = tmp_path / "um.csv"
    wide.write_text("\n".join(["target_mm,direction,run,deviation_mm", *rows, ""]))
    result = run("build", wide, tmp_path / "x.csv", "--to", "csv", "--keep-scale")
    assert result.exit_code == 1
    first, *others = result.stderr.splitlines()
    assert first == "note: check the unit of the numbers: all deviations together differ by 50 mm"
    assert all(line.startswith("error: the new table: L") for line in others)
    assert [line for line in others if "max_correction" in line]
    assert not (tmp_path / "x.csv").exists()


def test_evaluate_judges_a_limit_and_shows_vdi_3441(oracle: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    told = ("--vdi-3441", "--limit", 30, "--u-instrument", 1, "--report", page)
    data = good("evaluate", oracle, *told)
    assert data["conformity"]["a_um"] == pytest.approx(18.57, abs=0.01)
    # 1 µm of the instrument, and 2 s / sqrt(5) with 4 s = 7.50 µm, the largest of the published R.
    assert data["conformity"]["u_um"] == pytest.approx((1 + (3.75 / 5**0.5) ** 2) ** 0.5, abs=0.01)
    assert data["conformity"]["verdict"] == "kept"
    assert data["vdi_3441"]["pa_um"] == pytest.approx(14.95, abs=0.01)  # M of the report
    assert data["vdi_3441"]["u_um"] == pytest.approx(4.56, abs=0.01)  # B of the report
    said = run("evaluate", oracle, *told, "--force").stdout
    for line in ("VDI/DGQ 3441: P ", "the limit of 30 µm is kept"):
        assert line in said
        assert line in page.read_text()
    assert "--limit 0: it must be above 0" in refused("evaluate", oracle, "--limit", 0)
    assert "instrument -0.001" in refused("evaluate", oracle, "--limit", 9, "--u-instrument", -1)
