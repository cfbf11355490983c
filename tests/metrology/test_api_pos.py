"""Files of an API laser: what is in them, in both directions, and what is refused."""

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.drift import at_20_degrees
from gateway.metrology.errors import ReadingsError
from gateway.metrology.formats import ReadingsContext, Runs, parse_survey
from gateway.metrology.readings import Survey, mean_corrections, understood
from gateway.tabfile import TabFileError
from tests.metrology.samples import POS, POS_MEANS

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
ROW_5 = "  5.00000\t  -5.000100\t  0.000100\t 0"


def read(text: str, **told: object) -> Survey:
    return parse_survey(text.encode(), "x.pos", ReadingsContext(**told))  # type: ignore[arg-type]


def refused(text: str, **told: object) -> str:
    with pytest.raises(TabFileError) as caught:
        read(text, **told)
    return str(caught.value)


def test_unit_axis_and_direction_come_from_the_file() -> None:
    survey = read(POS)
    assert (survey.units, survey.axis) == (Units.INCH, "X")
    assert [(r.target, r.direction, r.run, round(r.deviation * 1e6)) for r in survey.readings] == [
        (0, UP, 1, 20),
        (5, UP, 1, 100),
        (10, UP, 1, 250),
        (15, UP, 1, 200),
        (15, DOWN, 1, -300),
        (10, DOWN, 1, -250),
        (5, DOWN, 1, -400),
        (0, DOWN, 1, -480),
    ]
    assert survey.facts["MachName"] == "old mill"
    # Corrections are target - measured, whichever way the laser counts.
    means = mean_corrections(survey.readings)
    assert [round(value, 6) for value in means.forward if value is not None] == [
        -0.00002,
        -0.0001,
        -0.00025,
        -0.0002,
    ]
    assert "axis X, inch, 4 targets from 0 to 15, runs 1 forward and 1 backward" in understood(survey)


def test_a_laser_that_counts_with_the_axis_means_the_same() -> None:
    with_the_axis = POS.replace("\t  -", "\t  ~").replace("\t  ~0.0", "\t  -0.0").replace("\t  ~", "\t  ")
    # The readings at 0 turn with it: 0.000020 and -0.000480.
    with_the_axis = with_the_axis.replace("\t  -0.000020\t", "\t  0.000020\t")
    with_the_axis = with_the_axis.replace("\t  0.000480\t", "\t  -0.000480\t")
    assert with_the_axis != POS
    assert read(with_the_axis).readings == read(POS).readings


def test_runs_that_fall_are_backward() -> None:
    lines = POS.split("\r\n")
    first = next(at for at, line in enumerate(lines) if line.startswith("  0.00000"))
    down_only = "\r\n".join(lines[:first] + lines[first + 4 :])
    down_only = down_only.replace("NumofPoints:\t8", "NumofPoints:\t4").replace("Bidirection", "Unidirection")
    survey = read(down_only)
    assert {r.direction for r in survey.readings} == {DOWN}
    assert any("no forward reading: measure" in remark for remark in survey.remarks)


def test_the_temperature_of_the_material_is_named_and_not_taken_off() -> None:
    # 77 °F are 25 °C; 6.5 µin per inch and °F are 11.7 µm a metre and kelvin.
    survey = read(POS)
    [remark] = survey.remarks
    assert "material at 25.0 °C, expansion 11.7 µm per metre and kelvin" in remark
    with pytest.raises(ReadingsError, match="no temperature at 0"):
        at_20_degrees(survey, 11.5)
    assert read(POS.replace("77.00", "68.00")).remarks == ()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Linear Data", "Angular Data", "other tables of this laser are not read"),
        ("NumofPoints:\t8", "NumofPoints:\t9", "x.pos:13: NumofPoints 9, but 8 rows"),
        ("NumofPos: 4", "NumofPos: 5", "x.pos:12: NumofPos 5, but 4 targets"),
        (ROW_5, ROW_5[:-1] + "2", "x.pos:19: status '2' (path error)"),
        (ROW_5, ROW_5.replace("0.000100\t", "0.000105\t"), "x.pos:19: position 5, laser -5.0001 and error"),
        (ROW_5, ROW_5.replace("5.00000\t", "6.00000\t", 1), "x.pos:19: position 6, laser -5.0001"),
        ("Unit:\tinch", "Unit:\tfoot", "x.pos:9: Unit 'foot 0'"),
        ("Unit:\tinch\t0\r\n", "", "no Unit"),
        ("TestType: Bidirection", "TestType: Unidirection", "but the positions go both ways"),
        ("TestType: Bidirection", "TestType: Pilgrim", "TestType 'Pilgrim'"),
        ("\t77.00\t-1.00\t-1.00\r\n  5", "\t77.00\t-1.00\r\n  5", "x.pos:18: 8 numbers"),
        ("Position\t", "Place\t", "no rows"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old: str, new: str, words: str) -> None:
    assert old in POS
    assert words in refused(POS.replace(old, new, 1))


def test_rows_that_were_moved_by_hand_are_refused() -> None:
    # As in a file in public, in which somebody wrote other positions beside the laser's readings.
    assert "do not agree" in refused(POS.replace("  10.00000\t", "  -5.00000\t"))


def test_the_means_by_themselves_need_unit_and_direction() -> None:
    assert "the file does not state which" in refused(POS_MEANS, units=Units.INCH)
    assert "the file does not state which" in refused(POS_MEANS, units=Units.INCH, runs=Runs.ALTERNATE)
    assert "no units" in refused(POS_MEANS, runs=Runs.FORWARD)
    survey = read(POS_MEANS, units=Units.INCH, runs=Runs.BACKWARD)
    assert [(r.target, r.direction, round(r.deviation * 1e6)) for r in survey.readings] == [
        (5, DOWN, 0),
        (0, DOWN, 33),
        (-5, DOWN, -178),
        (-10, DOWN, 0),
    ]


def test_means_of_both_directions_are_not_guessed() -> None:
    both = POS_MEANS.replace("Unidirectional", "Bidirectional")
    assert "its rows are read" in refused(both, units=Units.INCH, runs=Runs.FORWARD)
