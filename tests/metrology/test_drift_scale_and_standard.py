"""What readings say as a whole: drift over the runs, scale, temperature, and what ISO 230-2 asks for."""

import json
from math import pi, sin
from random import Random

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.doubts import json_of, notes_of
from gateway.metrology.drift import at_20_degrees, drift_line, drift_of, without_drift
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import evaluate, missing_line, missing_of, title_of
from gateway.metrology.formats import parse_survey
from gateway.metrology.readings import Reading, Survey, merged, small_unit
from gateway.metrology.scale import ScaleError, check_scale, scale_of

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
TARGETS = [0.0, 97.0, 203.0, 301.0, 400.0]


def warming(per_run: float = 7e-6, noise: float = 0.0) -> Survey:
    """Five runs; each is longer by 7 µm a metre than the one before, the way back by half of that."""
    random = Random(5)
    readings = [
        Reading(x, way, x + per_run * (run - 1 + late) * x + random.gauss(0, noise), run)
        for run in range(1, 6)
        for way, late in ((UP, 0.0), (DOWN, 0.5))
        for x in TARGETS
    ]
    return Survey(tuple(readings), Units.MM)


def said_by(source: str, readings: list[Reading]) -> Survey:
    return Survey(tuple(readings), Units.MM, source=source)


def test_a_screw_that_warms_up_is_named_with_e_with_and_without() -> None:
    found = drift_of(warming())
    assert found is not None
    # Four steps of 7 µm a metre; steel grows by 11.5 µm a metre and kelvin.
    assert found.growth == pytest.approx(28e-6)
    assert found.kelvin_of_steel == pytest.approx(28 / 11.5)
    assert found.is_growing
    assert not found.is_shifting
    # At 400 mm the mean of the runs back is 2.5 × 7 µm/m × 0.4 m = 7 µm; at 0 it is 0.
    said = drift_line(warming(), found)
    assert "+28 µm/m over the runs, as steel grows in +2.4 K" in said
    assert "E is 7.00 µm with the drift, 0.00 µm without." in said
    drift = json_of(warming())["drift"]
    assert isinstance(drift, dict)
    assert (drift["e_um"], drift["e_without_um"]) == (pytest.approx(7.0), pytest.approx(0.0, abs=1e-6))
    assert evaluate(without_drift(warming(), found)).systematic == pytest.approx(0.0, abs=1e-9)


def test_a_rotary_axis_has_no_scale_to_put_right() -> None:
    """A turn is a turn: counts_per_unit of 360 degrees is no measured number, and has no µm/m."""
    readings = tuple(Reading(x, way, x * 1.0001, 1) for way in (UP, DOWN) for x in (0.0, 90.0, 180.0))
    assert json.loads(json.dumps(json_of(Survey(readings, Units.MM))))["scale"] == {
        "um_per_m": pytest.approx(100.0),
        "counts_per_unit_factor": pytest.approx(1 / 1.0001),
    }
    assert json_of(Survey(readings, Units.DEGREE))["scale"] is None


def test_a_shift_of_the_whole_axis_is_named_too() -> None:
    moved = [
        Reading(x, way, x + 0.002 * (run - 1 + late), run)
        for run in range(1, 6)
        for way, late in ((UP, 0.0), (DOWN, 0.5))
        for x in TARGETS
    ]
    found = drift_of(Survey(tuple(moved), Units.MM))
    assert found is not None
    assert found.offset == pytest.approx(0.008)
    assert found.describe(small_unit(Units.MM)) == "+8 µm over the runs at 0"


@pytest.mark.parametrize("seed", range(20))
def test_scatter_is_no_drift(seed: int) -> None:
    random = Random(seed)
    noisy = [
        Reading(x, way, x + random.gauss(0, 0.001), run)
        for run in range(1, 6)
        for way in (UP, DOWN)
        for x in TARGETS
    ]
    assert drift_of(Survey(tuple(noisy), Units.MM)) is None


def test_two_runs_tell_no_drift() -> None:
    two = tuple(each for each in warming().readings if each.run <= 2)
    assert drift_of(Survey(two, Units.MM)) is None


def test_the_scale_says_what_counts_per_unit_should_be() -> None:
    readings = [Reading(x, UP, x * 1.00025 + 0.01) for x in TARGETS]
    found = scale_of(readings)
    assert found is not None
    assert found.share == pytest.approx(250e-6)
    # The nut goes 1.00025 times as far: 1000 / 1.00025 counts take it to where it should be.
    assert 1000 * found.counts_factor == pytest.approx(1000 / 1.00025)
    assert not found.is_large
    check_scale(said_by("x.csv", readings))


def test_a_wrong_scale_is_asked_for_before_a_table() -> None:
    readings = [Reading(x, UP, x * 0.9996) for x in TARGETS]
    with pytest.raises(ReadingsError, match=r"x.csv: linear part -400 µm/m: counts_per_unit 1000.4.*first"):
        check_scale(said_by("x.csv", readings), 1000.0)
    assert ScaleError(-400e-6).is_large
    assert not ScaleError(300e-6).is_large


def test_a_run_of_a_few_turns_tells_no_scale() -> None:
    """3 µm once in 2 mm on a screw that is 60 µm/m too long: a fine run of 2 mm alone has -2.3 mm/m."""

    def measured(targets: list[float]) -> Survey:
        return said_by("x.csv", [Reading(x, UP, x * 1.00006 + 0.003 * sin(pi * x)) for x in targets])

    fine = measured([200 + 0.125 * index for index in range(17)])
    steep = scale_of(fine.readings)
    assert steep is not None
    assert steep.share < -2e-3
    check_scale(fine)
    assert json_of(fine)["scale"] is None
    [said] = notes_of(fine)
    assert said == (
        "to find the scale, measure over 10 turns or more, or give the lead (--lead) if the range is that "
        "long. These readings cover 2 mm, only a few turns of the screw"
    )
    # With the grid that it completes they tell it, and where the lead is told ten turns of it do.
    scale = json_of(merged([measured([20.0 * index for index in range(21)]), fine]))["scale"]
    assert isinstance(scale, dict)
    assert scale["um_per_m"] == pytest.approx(60, abs=1)
    turns = measured([0.0, 5.0, 10.0, 15.0, 20.0])
    assert json_of(turns)["scale"] is None
    assert json_of(turns, lead=2.0)["scale"] is not None
    assert json_of(turns, lead=2.1)["scale"] is None


def test_a_scale_that_no_turn_explains_is_refused_however_short_the_run() -> None:
    """A gear of 1:2 makes 1 mm over 2 mm."""
    with pytest.raises(ReadingsError, match="is a wrong scale"):
        check_scale(said_by("x.csv", [Reading(x, UP, 1.5 * x) for x in (0.0, 1.0, 2.0)]))


HEADING = "target_mm,direction,run,measured_mm,temperature_c"


def test_a_slip_is_not_taken_for_a_wrong_scale() -> None:
    """Seven readings of 141 µm/m typed by hand, the last as 0.4210 for 0.0421."""
    heights = (0.0, 0.0071, 0.0148, 0.0216, 0.0289, 0.0357, 0.4210)
    slipped = [Reading(50.0 * index, UP, 50 * index + height) for index, height in enumerate(heights)]
    with pytest.raises(ReadingsError) as caught:
        check_scale(said_by("hand.csv", slipped))
    said = str(caught.value)
    # The slopes between two of the others are 137 to 154 µm/m.
    assert said.startswith("hand.csv: check 300.421 at target 300, forward, for a wrong digit")
    assert "it is +0.421 away, but the others lead to +0.04" in said
    assert "All readings together rise by more than 0.3 mm/m, but most of them by +14" in said
    check_scale(said_by("hand.csv", [*slipped[:6], Reading(300.0, UP, 300.0421)]))
    steep = [Reading(50.0 * index, UP, 50.02 * index) for index in range(7)]
    with pytest.raises(ReadingsError, match="is a wrong scale"):
        check_scale(said_by("hand.csv", steep))


def test_readings_carry_their_temperature_and_are_normalised_when_asked() -> None:
    text = f"{HEADING}\n0,forward,1,0,24\n500,forward,1,500.03,24\n500,backward,1,500.03,22\n"
    survey = parse_survey(text.encode(), "x.csv")
    assert [each.temperature_c for each in survey.readings] == [24.0, 24.0, 22.0]
    cold = at_20_degrees(survey, 11.5)
    # 11.5 µm/m × 4 K × 0.5 m = 23 µm, and half as much at 22 °C.
    assert [round(each.deviation, 9) for each in cold.readings] == [0.0, 0.007, 0.0185]
    assert cold.facts["normalised to 20 °C"] == "with 11.5 µm per metre and kelvin"


def test_one_temperature_may_hold_for_a_file() -> None:
    text = "# temperature: 23.0 °C\ntarget_mm,direction,run,measured_mm\n0,up,1,0\n1000,up,1,1000\n"
    cold = at_20_degrees(parse_survey(text.encode(), "x.csv"), 10.0)
    assert cold.readings[1].deviation == pytest.approx(-0.03)


@pytest.mark.parametrize(
    ("text", "coefficient", "words"),
    [
        ("target_mm,direction,run,measured_mm\n0,up,1,0\n9,up,1,9\n", 11.5, "no temperature at 0, run 1"),
        (
            "# temperature: 73 F\ntarget_mm,direction,run,measured_mm\n0,up,1,0\n9,up,1,9\n",
            11.5,
            "a number in °C",
        ),
        (f"{HEADING}\n0,up,1,0,20\n", 0.0, "--to-20c 0"),
        (f"{HEADING}\n0,up,1,0,20\n", 11500.0, "--to-20c 11500"),
    ],
)
def test_what_cannot_be_normalised_says_why(text: str, coefficient: float, words: str) -> None:
    with pytest.raises(ReadingsError, match=words):
        at_20_degrees(parse_survey(text.encode(), "x.csv"), coefficient)


def test_a_temperature_that_no_machine_has_is_refused() -> None:
    from gateway.tabfile import TabFileError

    with pytest.raises(TabFileError, match=r"x.csv:2: .*temperature 293"):
        parse_survey(f"{HEADING}\n0,up,1,0,293\n".encode(), "x.csv")


def whole(targets: list[float], runs: int = 5, ways: tuple[Direction, ...] = (UP, DOWN)) -> Survey:
    readings = [Reading(x, way, x, run) for run in range(1, runs + 1) for way in ways for x in targets]
    return Survey(tuple(readings), Units.MM)


@pytest.mark.parametrize(
    ("survey", "missing"),
    [
        (whole(TARGETS), ()),
        (whole(TARGETS, runs=3), ("3 runs in each direction, 5 are required",)),
        (whole(TARGETS, ways=(UP,)), ("one direction only, both are required",)),
        # 1.2 m: six targets; these four are at least uneven.
        (whole([0.0, 401.0, 777.0, 1200.0]), ("4 targets, 6 are required on this length",)),
        (
            whole([0.0, 100.0, 200.0, 300.0, 400.0]),
            ("even intervals of 100 mm, but irregular ones are required",),
        ),
        (
            whole([0.0, 301.0, 520.0, 760.0, 1000.0, 1240.0, 1480.0, 1720.0, 1960.0, 2100.0], runs=1),
            ("an interval of 301 mm, at most 250 is allowed",),
        ),
    ],
)
def test_what_the_standard_asks_for_is_held_against_the_readings(
    survey: Survey, missing: tuple[str, ...]
) -> None:
    found = evaluate(survey)
    assert missing_of(found) == missing
    assert title_of(found) == ("by the formulas of ISO 230-2" if missing else "ISO 230-2")
    assert missing_line(found) == (f"not a test after ISO 230-2: {'; '.join(missing)}" if missing else "")


def test_a_missing_approach_leaves_no_result_of_both_directions() -> None:
    readings = whole(TARGETS).readings
    without = tuple(each for each in readings if (each.target, each.direction) != (400.0, DOWN))
    found = evaluate(Survey(without, Units.MM))
    assert (found.accuracy, found.repeatability, found.systematic, found.mean_systematic) == (None,) * 4
    assert found.systematic_forward == 0.0
    assert missing_of(found) == ("1 of 5 targets approached from one side only",)
