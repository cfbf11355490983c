"""Where ``measure`` writes: checked before anything moves, and never over readings."""

import json
from math import sin
from pathlib import Path

import pytest

from gateway.commissioning.measure.errors import FileError
from gateway.commissioning.measure.outcome import (
    check_outputs,
    outcome_of,
    survey_before,
    write_report,
    write_table,
)
from gateway.compensation.direction import Direction
from gateway.metrology.readings import Reading, Survey
from tests.measure.test_new_tables import READINGS, configured

READINGS_FILE = "target_mm,direction,run,measured_mm\n0,forward,1,0\n100,forward,1,100.02\n"


def test_a_table_never_takes_the_place_of_readings(tmp_path: Path) -> None:
    out = tmp_path / "x.readings.csv"
    out.write_text(READINGS_FILE)
    with pytest.raises(FileError, match="give another name for --out: this is a file of readings"):
        check_outputs(out, None, force=True)
    loaded, axis = configured(tmp_path, "")
    found = outcome_of(READINGS, axis, is_active=False)
    section = loaded.sections.axes["x"]
    with pytest.raises(FileError, match="a file of readings"):
        write_table(found, out, "csv", axis, section, force=True)
    assert out.read_text() == READINGS_FILE


def test_a_folder_that_takes_no_file_is_named_before_anything_moves() -> None:
    # the files of the kernel: nobody may make one there, root neither
    with pytest.raises(FileError, match="the folder /proc cannot be written"):
        check_outputs(Path("/proc/x.csv"), None, force=False)


def test_a_first_table_says_its_home_and_names_outliers(tmp_path: Path) -> None:
    _, axis = configured(tmp_path, "")
    slip = [
        Reading(target, way, target + (0.2 if (target, run) == (50.0, 3) else 0.0), run)
        for run in range(1, 6)
        for way in (Direction.FORWARD, Direction.BACKWARD)
        for target in (0.0, 50.0, 100.0)
    ]
    survey = Survey(tuple(slip), READINGS.units, "x", remarks=("a remark",))
    notes = outcome_of(survey, axis, is_active=False).notes
    assert notes[0] == "a remark"
    assert [note for note in notes if note.startswith("outlier, kept; table build --drop-outliers")]
    assert [note for note in notes if note.startswith("no home reference")]
    # each is said once, also where a table is refined
    notes = outcome_of(survey, axis, is_active=True).notes
    assert notes.count("a remark") == 1


def test_before_is_what_was_measured_without_a_table(tmp_path: Path) -> None:
    _, axis = configured(tmp_path, "")
    path = tmp_path / "before.csv"
    path.write_text(f"# compensation: active {'0' * 64}\n{READINGS_FILE}")
    with pytest.raises(FileError, match="--before readings that were measured without a table"):
        survey_before(path, axis)
    path.write_text(f"# compensation: off\n{READINGS_FILE}")
    assert len(survey_before(path, axis).readings) == 2


def test_a_report_shows_the_table_that_was_in_use_and_not_the_next_one(tmp_path: Path) -> None:
    _, axis = configured(tmp_path, "")
    assert axis.table is not None
    found = outcome_of(READINGS, axis, is_active=True)
    assert found.active == axis.table
    report = tmp_path / "x.html"
    write_report(found, report, "x", None, force=False)
    # 0.01 mm at 100 are in the table; the readings there, 20 and 25 µm off, make it -10 and -15 µm
    assert "The largest correction is 10.0 µm" in report.read_text().replace("\u202f", " ").replace(
        "\xa0", " "
    )
    assert found.table.backward[-1] == pytest.approx(-0.015)
    assert outcome_of(READINGS, axis, is_active=False).active is None


@pytest.mark.parametrize(
    ("is_active", "said"),
    [
        (False, "With the table it is predicted to leave a systematic deviation E of"),
        (True, "the next table, made from these readings, will leave between its points E = "),
    ],
)
def test_text_json_and_report_say_what_the_new_table_leaves(
    tmp_path: Path, said: str, *, is_active: bool
) -> None:
    _, axis = configured(tmp_path, "")
    readings = [
        Reading(target, way, target + 0.003 * sin(target / 9) + (run - 2) * 0.0003, run)
        for run in (1, 2, 3)
        for way in (Direction.FORWARD, Direction.BACKWARD)
        for target in (0.0, 9.0, 22.0, 30.0, 41.0, 49.0, 60.0, 73.0, 80.0, 91.0, 100.0)
    ]
    found = outcome_of(Survey(tuple(readings), READINGS.units, "x"), axis, is_active=is_active)
    predicted = json.loads(json.dumps(found.as_data()))["predicted"]
    assert predicted["left_out_e_low_um"] < predicted["left_out_e_um"] < predicted["left_out_e_high_um"]
    lines = "\n".join(found.lines())
    assert f"will leave E = {predicted['left_out_e_um']:.2f} µm (predicted" in lines
    report = tmp_path / "x.html"
    write_report(found, report, "x", None, force=False)
    assert said in report.read_text()
