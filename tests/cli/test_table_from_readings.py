"""``pitch-gateway table build, refine, evaluate, program, drift``."""

import re
from hashlib import sha256
from pathlib import Path
from typing import Final

import pytest
from typer.testing import CliRunner

from gateway.cli.table import app
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.metrology.readings import APPROACHES
from gateway.metrology.tables import correction_at
from gateway.tabfile import (
    DIALECTS,
    Dialect,
    ErrorSense,
    FileContext,
    TabFileError,
    V1Layout,
    WriteOptions,
    read_table,
)
from gateway.tabfile.conversion import WRITE_OPTIONS
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
    below = run("evaluate", oracle, "--limit", 9, "--u-instrument", -1)
    assert below.exit_code == 2
    assert "greater than or equal to 0" in below.output


# Readings with a table and without, and of two axes, never get into one table or one report.


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


# A refined table in the format it had: whoever read the old file reads the new one in the same way.


READ_UNDER_IT: Final = """target_mm,direction,run,measured_mm
0,forward,1,0
10,forward,1,10.001
20,forward,1,20.002
20,backward,1,20.002
10,backward,1,10.001
0,backward,1,0
"""
ISG_LIST: Final = """kw.ssfk.unit 1
kw.ssfk.interval 100000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 3
kw.ssfk.bilateral 0
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 100
kw.ssfk.table[2].pos 200
"""
SIEMENS: Final = """%_N_AX_EEC_INI
CHANDATA(1)
$AA_ENC_COMP[1,0,AX1]=0
$AA_ENC_COMP[1,1,AX1]=-0.010
$AA_ENC_COMP[1,2,AX1]=-0.020
$AA_ENC_COMP_STEP[1,AX1]=10
$AA_ENC_COMP_MIN[1,AX1]=0
$AA_ENC_COMP_MAX[1,AX1]=20
$AA_ENC_COMP_IS_MODULO[1,AX1]=0
M17
"""


@pytest.mark.parametrize(
    ("text", "told", "expected", "to_tell"),
    [
        # read as 10 and 20 µm to add; 1 and 2 µm too far under it leave 9 and 18, in the sense of the file
        (
            ISG_LIST,
            ("--isg-sense", "command_minus_actual"),
            "kw.ssfk.table[2].pos 180",
            "command_minus_actual",
        ),
        (
            ISG_LIST,
            ("--error-sense", "command_minus_actual"),
            "kw.ssfk.table[2].pos 180",
            "command_minus_actual",
        ),
        # read as -10 and -20 µm to add: 11 and 22 are too far
        (ISG_LIST, (), "kw.ssfk.table[2].pos 220", "actual_minus_command"),
        (SIEMENS, (), "$AA_ENC_COMP[1,2,AX1]=-0.01800000", "--file-axis AX1"),
    ],
)
def test_a_refined_file_is_read_as_the_one_before(
    tmp_path: Path, text: str, told: tuple[str, ...], expected: str, to_tell: str
) -> None:
    (tmp_path / "old").write_text(text)
    (tmp_path / "readings.csv").write_text(READ_UNDER_IT)
    old, readings, new = (str(tmp_path / name) for name in ("old", "readings.csv", "new"))
    result = CliRunner().invoke(app, ["refine", old, readings, new, "--units", "mm", *told])
    assert result.exit_code == 0, result.stderr
    lines = [" ".join(line.split()) for line in (tmp_path / "new").read_text().splitlines()]
    assert expected in lines
    assert "to read it, give:" in result.stdout
    assert to_tell in result.stdout


TURN: Final = """kw.ssfk.unit 1
kw.ssfk.interval 900000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 5
kw.ssfk.bilateral 0
kw.ssfk.modulo 1
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 20
kw.ssfk.table[2].pos 40
kw.ssfk.table[3].pos 20
kw.ssfk.table[4].pos 0
"""
AGAIN: Final = "not in the file: the table repeats every 360 degree"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("isg",), "kw.ssfk.modulo 1"),
        (("siemens-eec", "--to-axis", "c"), "$AA_ENC_COMP_IS_MODULO[0,C1]=1"),
        (("siemens-eec", "--to-axis", "c", "--resample", "45"), "$AA_ENC_COMP_IS_MODULO[0,C1]=1"),
        (("fagor-8055", "--to-axis", "c", "--to-sense", "actual_minus_command"), None),
        # 0.0001 degree to the pulse
        (("fanuc-csv", "--to-counts-per-unit", "10000"), None),
        (("mitsubishi-csv", "--to-counts-per-unit", "10000"), None),
    ],
)
def test_a_turn_stays_a_turn_where_the_format_knows_turns(
    tmp_path: Path, options: tuple[str, ...], expected: str | None
) -> None:
    (tmp_path / "old.lis").write_text(TURN)
    old, new = str(tmp_path / "old.lis"), str(tmp_path / "new")
    result = CliRunner().invoke(app, ["convert", old, new, "--units", "degree", "--to", *options])
    assert result.exit_code == 0, result.stderr
    assert "repeats every" not in result.stdout
    told = {"fagor-8055": ["--error-sense", "actual_minus_command"], "isg": [], "siemens-eec": []}
    facts = told.get(options[0], ["--file-counts-per-unit", "10000"])
    shown = CliRunner().invoke(app, ["show", new, "--units", "degree", *facts])
    assert "modulo = 360" in shown.stdout
    assert expected is None or expected in [
        " ".join(line.split()) for line in Path(new).read_text().split("\n")
    ]


@pytest.mark.parametrize(
    "options",
    [
        ("csv",),
        ("linuxcnc-1",),
        # 0, 70 ... 420 is no turn any more
        ("siemens-eec", "--to-axis", "c", "--resample", "70"),
    ],
)
def test_a_turn_that_is_lost_is_said(tmp_path: Path, options: tuple[str, ...]) -> None:
    (tmp_path / "old.lis").write_text(TURN)
    old, new = str(tmp_path / "old.lis"), str(tmp_path / "new")
    result = CliRunner().invoke(app, ["convert", old, new, "--units", "degree", "--to", *options])
    assert result.exit_code == 0, result.stderr
    assert AGAIN in result.stdout


def test_a_refined_turn_stays_one_and_one_that_no_longer_closes_is_said(tmp_path: Path) -> None:
    (tmp_path / "old.lis").write_text(TURN)
    old, new = str(tmp_path / "old.lis"), str(tmp_path / "new")
    for last, is_turn in (("360", True), ("360.001", False)):
        rows = [
            f"{target},{way},1,{target}" for way in ("forward", "backward") for target in (0, 90, 180, 270)
        ]
        rows += [f"360,{way},1,{last}" for way in ("forward", "backward")]
        readings = tmp_path / "readings.csv"
        readings.write_text("\n".join(["target_degree,direction,run,measured_degree", *rows]))
        result = CliRunner().invoke(app, ["refine", old, str(readings), new, "--units", "degree", "--force"])
        assert result.exit_code == 0, result.stderr
        assert ("kw.ssfk.modulo" in Path(new).read_text()) is is_turn
        assert (AGAIN in result.stdout) is not is_turn


# ``pitch-gateway table drift``: a place that is read for hours.


# 0, 6, 12, 15, 16, 16 µm, half an hour apart; a kelvin makes 4 µm.
ROWS_DRIFT = ((0, 0, 20.0), (30, 6, 21.5), (60, 12, 23.0), (90, 15, 23.75), (120, 16, 24.0), (150, 16, 24.0))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "warm.csv"
    lines = [f"{minutes},{um},{warm}" for minutes, um, warm in ROWS_DRIFT]
    path.write_text("\n".join(["# machine: mill 7", "time_min,measured_um,temperature_c", *lines]))
    return path


def test_range_largest_hour_last_rate_and_what_a_kelvin_makes(file: Path) -> None:
    data = good("drift", file)
    assert data["minutes"] == 150
    assert data["range_um"] == pytest.approx(16)
    # From 0 to 60 min it moves by 12 µm; by 9 in the hour after the first half.
    assert data["largest_hour_um"] == pytest.approx(12)
    assert data["largest_hour_from_min"] == 0
    # The last hour has 15, 16, 16: the line through them rises by 0.5 in half an hour.
    assert data["last_hour_um_per_h"] == pytest.approx(1.0)
    assert data["um_per_kelvin"] == pytest.approx(4.0)
    assert data["explained"] == pytest.approx(1.0)
    said = run("drift", file).stdout
    assert "range over the test: 16.00 µm" in said
    assert "largest change within an hour: 12.00 µm, from minute 0 on" in said
    assert "rate in the last hour: +1.00 µm/h" in said
    assert "each kelvin changes it by +4.00 µm; this explains 100% of the drift" in said


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("time_min", "time_s", "time_min: minutes"),
        ("measured_um", "measured", "no unit in the heading"),
        ("time_min,", "clock,", "no time in the heading"),
        ("60,12", "20,12", "csv:5: time 20 after 30; allowed: times that ascend"),
        ("90,15", "90,x", "csv:6: measured"),
        ("\n30,6,21.5\n60,12,23.0\n90,15,23.75\n120,16,24.0", "", "2 reading(s); allowed: at least 3"),
    ],
)
def test_what_is_no_drift_test_is_refused_with_its_line(
    file: Path, before: str, after: str, words: str
) -> None:
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after))
    assert words in refused("drift", file)


# What is told about the file to write is used, or it is said that its format has no place for it.


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
