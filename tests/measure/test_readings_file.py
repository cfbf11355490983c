"""The file of a measuring run: what was written comes back, and what was changed is refused."""

import resource
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.commissioning.measure.errors import FileError
from gateway.commissioning.measure.readings_file import (
    MeasuringPlan,
    ReadingsFile,
    check_order,
    facts_of,
    read_earlier,
)
from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.cycle import bidirectional_cycle
from gateway.metrology.formats.load import read_survey
from gateway.metrology.readings import Reading

PLAN = MeasuringPlan((0.0, 10.0, 20.0), 2, 1.5)
STOPS = list(bidirectional_cycle(PLAN.targets, PLAN.overrun, PLAN.runs))
MEASURED = [stop for stop in STOPS if stop.measure]
TEXT = """# axis: x
# units: mm
# compensation: off
# targets: 0.0 10.0 20.0
# runs: 2
# overrun: 1.5
target_mm,direction,run,measured_mm
0.0,forward,1,0.001
10.0,forward,1,9.998
"""


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(
    errors=st.lists(st.integers(-(10**6), 10**6), max_size=len(MEASURED)),
    units=st.sampled_from([Units.MM, Units.INCH]),
)
def test_readings_come_back_as_they_were(tmp_path: Path, errors: list[int], units: Units) -> None:
    path = tmp_path / "r.csv"
    path.unlink(missing_ok=True)
    readings = [
        Reading(stop.nominal, stop.direction, round(stop.nominal + error / 1e7, 7), stop.run)
        for stop, error in zip(MEASURED, errors, strict=False)
    ]
    file = ReadingsFile(path, units)
    file.create(facts_of(PLAN, "x", "off", units))
    for reading in readings:
        file.append(reading)
    file.close()
    earlier = read_earlier(path, units)
    assert (earlier.plan, list(earlier.readings)) == (PLAN, readings)
    check_order(path, STOPS, earlier.readings)
    if len(readings) == len(MEASURED):
        survey = read_survey(path)
        assert (list(survey.readings), survey.units, survey.axis) == (readings, units, "x")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "10.0,forward,1,9.998\n",
            "10.0,forward,1,9.9",
            "line 9: '10.0,forward,1,9.9' is not a complete row",
        ),
        ("10.0,forward", "10.0;forward", "line 9: .* as in 50.0,forward,1,50.0123"),
        ("forward,1,9.998", "up,1,9.998", "line 9"),
        ("1,9.998", "1,nan", "numbers must be finite"),
        ("10.0,forward,1", "20.0,forward,1", "reading 2: at 20 forward, run 1, but the plan has 10 forward"),
        ("0.0,forward,1,0.001\n", "", "reading 1: at 10 forward"),
        ("# runs: 2\n", "", "# targets, # runs and # overrun"),
        ("# targets: 0.0 10.0 20.0", "# targets: 0.0 x", "# targets, # runs and # overrun"),
        ("target_mm", "target_inch", "it must be target_mm,direction,run,measured_mm"),
    ],
)
def test_a_changed_file_is_not_gone_on_with(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "r.csv"
    assert old in TEXT
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(FileError, match=told):
        check_order(path, STOPS, read_earlier(path, Units.MM).readings)


def test_a_file_that_is_there_is_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(TEXT)
    with pytest.raises(FileError, match="exists already"):
        ReadingsFile(path, Units.MM).create({})
    assert path.read_text() == TEXT
    file = ReadingsFile(path, Units.MM)
    file.go_on()
    file.append(Reading(20.0, Direction.FORWARD, 20.0015, 1))
    file.close()
    assert path.read_text() == TEXT + "20.0,forward,1,20.0015\n"


def test_a_disk_that_is_full_is_said_and_keeps_what_was_read(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(TEXT)
    file = ReadingsFile(path, Units.MM)
    file.go_on()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(TEXT), hard))
    try:
        with pytest.raises(FileError, match=r"r\.csv: File too large"):
            file.append(Reading(20.0, Direction.FORWARD, 20.0015, 1))
        file.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == TEXT


def test_a_heading_that_does_not_fit_on_the_disk_leaves_nothing_in_the_way(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20, hard))
    try:
        with pytest.raises(FileError, match=r"r\.csv: File too large"):
            ReadingsFile(path, Units.MM).create(facts_of(PLAN, "x", "off", Units.MM))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not path.exists()
