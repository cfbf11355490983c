"""The whole way: TB058's examples from readings to files, residue and refinement."""

from itertools import pairwise
from math import pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.build import HomeCase, HomeReference, build_table
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import evaluate
from gateway.metrology.formats import parse_survey
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.refine import Points, refine_table
from gateway.metrology.residue import predicted_residue
from gateway.metrology.tables import correction_at, loss
from gateway.tabfile import WriteOptions, dialect_named
from tests.metrology.samples import TB058_MANUAL, TB058_SIMULATED

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
AS_PRINTED = [
    *("2.0000", "3.0000", "4.0000", "5.0000", "6.0000", "7.0000"),
    ";",
    *("3.0000", "2.0000", "1.0000", "0.0000", "-0.0001", "0.0000"),
]
TYPO = 11
"""The fifth backward value: TB058 prints inches among tenths; its own working table says -0.0001 inch."""


def test_tb058_from_the_readings_to_the_file_digit_for_digit() -> None:
    survey = parse_survey(TB058_MANUAL.encode(), "z.csv")
    built = build_from(survey, Recipe(home=HomeCase.SWITCH_NEGATIVE))
    written = dialect_named("centroid-2").write(built.table, WriteOptions())
    lines = [line.partition(";")[0].strip() or ";" for line in written.text.splitlines()]
    assert lines[0].split() == ["2", "5", "0.5", "20", "1", "0"]
    right = [*AS_PRINTED[:TYPO], "-1.0000", *AS_PRINTED[TYPO + 1 :]]
    assert AS_PRINTED[TYPO] == "-0.0001"
    assert lines[1:] == right
    assert built.home == HomeReference(0.0, DOWN)
    assert any("backward at 0: not measured" in note and "-0.0002 inch" in note for note in built.notes)


def test_the_laser_may_have_any_zero() -> None:
    """The bulletin's laser was zeroed at -2.5, ours at home: home is subtracted at the end."""
    survey = parse_survey(TB058_MANUAL.encode(), "z.csv")
    moved = [Reading(r.target, r.direction, r.measured + 0.0123) for r in survey.readings]
    tables = [
        build_from(Survey(tuple(readings), Units.INCH), Recipe(home=HomeCase.SWITCH_NEGATIVE)).table
        for readings in (survey.readings, moved)
    ]
    assert list(tables[1].forward) == pytest.approx(list(tables[0].forward), abs=1e-12)
    assert list(tables[1].backward) == pytest.approx(list(tables[0].backward), abs=1e-12)


def simulated_table() -> CorrectionTable:
    """TB058's simulated recording, from home on; the instrument was zeroed there."""
    text = TB058_SIMULATED.replace("inches)\n", "inches)\n0\t0\t0\n")
    return build_from(
        parse_survey(text.encode(), "x.csv"), Recipe(HomeCase.SWITCH_POSITIVE, one_way=True)
    ).table


def test_the_simulated_recording_makes_the_tenths_of_the_version_2_example() -> None:
    tenths = [round(c * 1e4, 6) for c in simulated_table().forward]
    # Printed: 5 3 4 -1 -3 -4 -0.7; the 4 is a slip, for 1.5 - 1.4999 is one tenth.
    assert tenths == [0, 5, 3, 1, -1, -3, -4, -0.7]


def test_the_simulated_recording_makes_the_counts_of_the_7_17_example() -> None:
    written = dialect_named("centroid-1").write(
        simulated_table(), WriteOptions(axis="x", file_counts_per_unit=5 * 8000)
    )
    # 66 values over 33 inch are 1320000 counts; these are the first 7 of them, over 3.5 inch.
    assert written.text.split() == ["7", "140000", "20", "12", "4", "-4", "-12", "-16", "-3"]


def test_the_7_17_example_with_its_direction_reversed_is_negated() -> None:
    written = dialect_named("centroid-1").write(
        simulated_table(), WriteOptions(axis="x", file_counts_per_unit=-5 * 8000)
    )
    assert written.text.split() == ["7", "-140000", "-20", "-12", "-4", "4", "12", "16", "3"]


def test_the_three_cases_of_home() -> None:
    up = make_table([0, 10], [0.003, 0.01], [0.0, 0.02], Units.MM)
    down = make_table([-10, 0], [0.003, 0.01], [0.0, 0.02], Units.MM)
    both = make_table([-10, 10], [0.003, 0.01], [0.0, 0.02], Units.MM)
    assert HomeCase.SWITCH_POSITIVE.reference(up) == HomeReference(0, UP)
    assert HomeCase.SWITCH_NEGATIVE.reference(down) == HomeReference(0, DOWN)
    assert HomeCase.MARK.reference(both) == HomeReference(0.0, UP)
    for case, table in (
        (HomeCase.SWITCH_POSITIVE, both),
        (HomeCase.SWITCH_NEGATIVE, both),
        (HomeCase.SWITCH_NEGATIVE, up),
        (HomeCase.MARK, make_table([1, 10], [0, 0], [0, 0], Units.MM)),
    ):
        with pytest.raises(ReadingsError, match="choose"):
            case.reference(table)


def noisy(runs: int = 3) -> Survey:
    """A progressive and periodic screw with 20 µm lost motion, from 0 to 300 mm."""
    readings = []
    for way, side in ((UP, -1), (DOWN, 1)):
        for run in range(1, runs + 1):
            for i in range(31):
                x = i * 10.0
                e = 40e-6 * x + 0.004 * sin(2 * pi * x / 70) + side * 0.01 + 0.0003 * ((run + i) % 3 - 1)
                readings.append(Reading(x, way, x + e, run))
    return Survey(tuple(readings), Units.MM)


@pytest.mark.parametrize(
    "recipe",
    [
        Recipe(HomeCase.SWITCH_POSITIVE),
        Recipe(HomeCase.SWITCH_POSITIVE, step=20.0),
        Recipe(HomeCase.SWITCH_POSITIVE, tolerance=0.001),
        Recipe(HomeCase.SWITCH_POSITIVE, smooth=50.0),
        Recipe(HomeCase.SWITCH_POSITIVE, smooth=50.0, step=25.0),
    ],
)
def test_the_reference_is_zero_whatever_was_done_before(recipe: Recipe) -> None:
    built = build_from(noisy(), recipe)
    assert built.table.forward[0] == 0.0
    assert any(note.startswith("home: the forward correction at 0") for note in built.notes)


def test_a_tolerance_leaves_out_points_and_says_what_it_lost() -> None:
    built = build_from(noisy(), Recipe(HomeCase.SWITCH_POSITIVE, tolerance=0.002))
    assert len(built.table.positions) < 31
    assert built.loss is not None
    assert built.loss.size <= 0.002
    assert any("points instead of 31: the largest loss is" in note for note in built.notes)


def test_a_home_between_targets_does_not_cost_the_tolerance_twice() -> None:
    # The curve is at 3 µm at the mark. The line from -10 to 10 is off by 1 µm at most, but passes the mark
    # at 2 µm: subtracted, that 1 µm would be lost once more, and 2 at the ends.
    corrections_um = {-10.0: 0.0, -5.0: 2.0, 5.0: 4.0, 10.0: 4.0}
    readings = tuple(
        Reading(target, way, target - correction / 1000)
        for target, correction in corrections_um.items()
        for way in (UP, DOWN)
    )
    survey = Survey(readings, Units.MM)
    whole = build_from(survey, Recipe(HomeCase.MARK)).table
    few = build_from(survey, Recipe(HomeCase.MARK, tolerance=0.001))
    assert list(few.table.positions) == [-10.0, 0.0, 10.0]
    # 3 µm are subtracted: at 5 the line from 0 to 1 µm stands at 0.5, the curve at 1 µm.
    assert list(few.table.forward) == pytest.approx([-0.003, 0.0, 0.001])
    assert loss(whole, few.table).size == pytest.approx(0.0005)
    assert few.loss is not None
    assert few.loss.size == pytest.approx(0.0005)


def test_an_outlier_that_was_the_only_reading_takes_its_target_with_it() -> None:
    readings = [Reading(float(x), way, float(x)) for x in range(0, 90, 10) for way in (UP, DOWN)]
    at = readings.index(Reading(40.0, UP, 40.0))
    readings[at] = Reading(40.0, UP, 40.05)
    built = build_from(Survey(tuple(readings), Units.MM), Recipe(drop_outliers=True))
    assert list(built.table.positions) == [0.0, 10.0, 20.0, 30.0, 50.0, 60.0, 70.0, 80.0]
    assert built.table.max_correction() == 0.0
    words = "40: left out in both directions, because the outlier was the only reading in one of them"
    assert words in built.notes


def test_a_step_and_a_tolerance_exclude_each_other() -> None:
    with pytest.raises(ReadingsError, match="not both"):
        build_from(noisy(), Recipe(step=10.0, tolerance=0.001))


def test_an_outlier_is_kept_and_named_or_dropped_when_told() -> None:
    survey = noisy(5)
    readings = list(survey.readings)
    slip = readings[40]
    readings[40] = Reading(slip.target, slip.direction, slip.measured + 0.05, slip.run)
    bad = Survey(tuple(readings), Units.MM)
    kept = build_from(bad, Recipe())
    dropped = build_from(bad, Recipe(drop_outliers=True))
    clean = build_from(survey, Recipe())
    index = list(clean.table.positions).index(slip.target)
    assert any("outlier, kept" in note for note in kept.notes)
    assert any("outlier, left out" in note for note in dropped.notes)
    assert abs(kept.table.forward[index] - clean.table.forward[index]) == pytest.approx(0.01)
    assert abs(dropped.table.forward[index] - clean.table.forward[index]) < 0.0002


def test_the_predicted_residue_is_the_deviation_plus_the_correction() -> None:
    table = make_table([0, 10], [0.0, 0.01], [0.0, -0.02], Units.MM)
    before = Survey((Reading(5, UP, 5.001), Reading(5, DOWN, 5.03), Reading(12, UP, 12.0)), Units.MM)
    after = predicted_residue(before, table)
    # 1 + 5 µm, 30 - 10 µm, and outside the table its end: 0 + 10 µm.
    assert [r.deviation for r in after.readings] == pytest.approx([0.006, 0.02, 0.01])
    inches = predicted_residue(before, table.in_units(Units.INCH))
    assert [r.measured for r in inches.readings] == pytest.approx([r.measured for r in after.readings])


def test_a_prediction_outside_the_table_is_named() -> None:
    table = make_table([10.0, 20.0], [0.001, 0.001], [0.0, 0.0], Units.MM)
    survey = Survey(tuple(Reading(x, UP, x) for x in (9.0, 10.0, 20.0, 22.0)), Units.MM)
    found = predicted_residue(survey, table)
    assert found.remarks == (
        "targets from 9 to 22 are outside the table, 10 to 20 mm: predicted with its end values held",
    )
    inside = Survey(survey.readings[1:3], Units.MM)
    assert predicted_residue(inside, table.in_units(Units.INCH)).remarks == ()


def test_a_table_of_all_targets_leaves_only_scatter() -> None:
    survey = noisy()
    before = evaluate(survey)
    after = evaluate(predicted_residue(survey, build_from(survey, Recipe()).table))
    assert before.accuracy is not None
    assert after.accuracy is not None
    assert after.systematic == pytest.approx(0, abs=1e-12)
    assert after.accuracy < 0.15 * before.accuracy
    assert after.repeatability_forward == pytest.approx(before.repeatability_forward or 0, abs=1e-12)


def test_refining_adds_nominal_minus_measured() -> None:
    old = make_table([0, 10, 20], [0.0, 0.01, 0.02], [0.0, 0.0, 0.0], Units.MM)
    readings = [Reading(x, way, x + 0.002) for way in (UP, DOWN) for x in (0.0, 10.0, 20.0)]
    new = refine_table(old, Survey(tuple(readings), Units.MM))
    assert list(new.table.forward) == pytest.approx([-0.002, 0.008, 0.018])
    assert list(new.table.backward) == pytest.approx([-0.002] * 3)
    kept = refine_table(old, Survey(tuple(readings), Units.MM), home=HomeReference(0.0, UP))
    assert list(kept.table.forward) == pytest.approx([0.0, 0.01, 0.02])


def test_refining_keeps_the_reference_of_a_table_that_is_not_zero_at_home() -> None:
    old = make_table([0, 10], [0.005, 0.01], [0.0, 0.0], Units.MM)
    readings = [Reading(x, way, x - 0.003) for way in (UP, DOWN) for x in (0.0, 10.0)]
    new = refine_table(old, Survey(tuple(readings), Units.MM), home=HomeReference(0.0, UP))
    assert list(new.table.forward) == pytest.approx([0.005, 0.01])
    assert list(new.table.backward) == pytest.approx([0.0, 0.0])


def test_refining_on_the_union_keeps_every_target() -> None:
    old = make_table([0, 20], [0.0, 0.02], [0.0, 0.0], Units.MM)
    readings = [Reading(x, way, x - 0.001 * x) for way in (UP, DOWN) for x in (0.0, 5.0, 15.0)]
    union = refine_table(old, Survey(tuple(readings), Units.MM), points=Points.UNION)
    assert list(union.table.positions) == [0, 5, 15, 20]
    assert list(union.table.forward) == pytest.approx([0.0, 0.01, 0.03, 0.035])
    assert any("no reading from 15 to 20 mm" in note for note in union.notes)
    same = refine_table(old, Survey(tuple(readings), Units.MM))
    assert list(same.table.positions) == [0, 20]


def test_targets_in_another_unit_are_the_points_they_mean() -> None:
    inches = [index / 2 for index in range(21)]
    old = make_table(inches, [0.0] * 21, [0.0] * 21, Units.INCH).in_units(Units.MM)
    targets = [round(inch * 25.4, 4) for inch in inches]
    assert list(old.positions) != targets
    readings = tuple(Reading(x, way, x + 0.001) for x in (*targets, 3.0) for way in (UP, DOWN))
    new = refine_table(old, Survey(readings, Units.MM), points=Points.UNION).table
    assert list(new.positions) == sorted((*old.positions, 3.0))


def machine(table: CorrectionTable, positions: list[float], bend: float, lost: float) -> Survey:
    """Measure a simulated axis with a table in use: the nut of a drive at m stands at m + e(m)."""
    readings = []
    for way, side in ((UP, -1), (DOWN, 1)):
        for x in positions:
            m = x + correction_at(table, x, way)
            readings.append(Reading(x, way, m + bend * m + 0.02 * sin(m / 9) + side * lost / 2))
    return Survey(tuple(readings), Units.MM)


@settings(max_examples=30)
@given(st.floats(-5e-4, 5e-4), st.floats(0.0, 0.05))
def test_again_and_again_never_makes_it_worse(bend: float, lost: float) -> None:
    positions = [i * 10.0 for i in range(21)]
    nothing = make_table([0, 200], [0, 0], [0, 0], Units.MM)
    table = build_table(machine(nothing, positions, bend, lost).readings, Units.MM)
    worst = [max(abs(r.deviation) for r in machine(table, positions, bend, lost).readings)]
    for _ in range(3):
        table = refine_table(table, machine(table, positions, bend, lost)).table
        worst.append(max(abs(r.deviation) for r in machine(table, positions, bend, lost).readings))
    # Each time what is left shrinks by the slope of the error, here below 0.003, down to rounding.
    for before, after in pairwise(worst):
        assert after <= max(0.004 * before, 1e-12)


def test_a_grid_over_the_travel_holds_what_was_not_measured() -> None:
    readings = [Reading(x, way, x - 0.001 * x) for way in (UP, DOWN) for x in (3.0, 18.0)]
    built = build_from(Survey(tuple(readings), Units.MM), Recipe(step=10.0, travel=(0.0, 25.0)))
    assert list(built.table.positions) == [0, 10, 20]
    assert list(built.table.forward) == pytest.approx([0.003, 0.010, 0.018])
    assert any("no reading from 0 to 3 mm" in note for note in built.notes)
    assert any("no reading from 18 to 20 mm" in note for note in built.notes)
    with pytest.raises(ReadingsError, match=r"travel without step: .* --step as well, or remove --travel"):
        build_from(Survey(tuple(readings), Units.MM), Recipe(travel=(0.0, 25.0)))
    with pytest.raises(ReadingsError, match="a travel from 25 to 0: the lower end first"):
        build_from(Survey(tuple(readings), Units.MM), Recipe(step=10.0, travel=(25.0, 0.0)))
