import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.errors import TableError
from gateway.compensation.units import Units
from gateway.metrology.build import HomeCase, HomeReference, build_table, referenced
from gateway.metrology.errors import ReadingsError
from gateway.metrology.readings import Reading
from gateway.metrology.tables import correction_at

UP, DOWN = Direction.FORWARD, Direction.BACKWARD

# The Z axis example of Centroid TB058: machine positions -2.5 to 0, laser zeroed at -2.5, inches.
TB058_FORWARD = {-2.5: 0.0, -2.0: 0.4999, -1.5: 0.9998, -1.0: 1.4997, -0.5: 1.9996, 0.0: 2.4995}
TB058_REVERSE = {-0.5: 2.0003, -1.0: 1.5002, -1.5: 1.0001, -2.0: 0.5000, -2.5: -0.0001}


def tb058_readings() -> list[Reading]:
    return [
        *(Reading(at, UP, laser - 2.5) for at, laser in TB058_FORWARD.items()),
        *(Reading(at, DOWN, laser - 2.5) for at, laser in TB058_REVERSE.items()),
    ]


def tenths(values: object) -> list[float]:
    return [round(v * 1e4, 6) for v in values]  # type: ignore[attr-defined]


def test_the_turn_around_point_of_tb058_is_estimated_as_printed_there() -> None:
    table = build_table(tb058_readings(), Units.INCH)
    assert tenths(table.forward) == [0, 1, 2, 3, 4, 5]
    assert tenths(table.backward) == [1, 0, -1, -2, -3, -2]  # the last is 0.0005 - (0.0004 + 0.0003)


def test_home_at_the_last_reverse_point_gives_the_table_that_tb058_prints() -> None:
    table = build_table(tb058_readings(), Units.INCH, home=HomeReference(0.0, DOWN))
    assert tenths(table.forward) == [2, 3, 4, 5, 6, 7]
    assert tenths(table.backward) == [3, 2, 1, 0, -1, 0]
    assert list(table.positions) == [-2.5, -2.0, -1.5, -1.0, -0.5, 0.0]


def test_a_reference_mark_between_two_targets_is_interpolated() -> None:
    table = build_table(tb058_readings(), Units.INCH, home=HomeReference(-1.75, UP))
    # Forward at -1.75 is 1.5 tenths: half way between 1 and 2.
    assert tenths(table.forward) == [-1.5, -0.5, 0.5, 1.5, 2.5, 3.5]


def test_repeated_readings_are_averaged_in_each_direction() -> None:
    readings = [Reading(0, UP, 0.0), Reading(0, DOWN, 0.0), Reading(10, DOWN, 10.03)]
    readings += [Reading(10, UP, 10.01), Reading(10, UP, 10.02), Reading(10, UP, 9.97)]
    table = build_table(readings, Units.MM)
    assert table.forward[1] == pytest.approx(0.0, abs=1e-12)
    assert table.backward[1] == pytest.approx(-0.03)


def test_the_first_forward_value_can_be_the_missing_one() -> None:
    readings = [Reading(0, DOWN, 0.02), Reading(10, UP, 10.0), Reading(10, DOWN, 10.03)]
    # forward(0) = backward(0) - (backward(10) - forward(10)) = -0.02 - (-0.03 - 0) = 0.01
    assert build_table(readings, Units.MM).forward[0] == pytest.approx(0.01)


def test_lost_motion_makes_forward_minus_backward_positive() -> None:
    readings = [Reading(x, UP, x) for x in (0.0, 5.0)] + [Reading(x, DOWN, x + 0.04) for x in (0.0, 5.0)]
    table = build_table(readings, Units.MM)
    assert [f - b for f, b in zip(table.forward, table.backward, strict=True)] == pytest.approx([0.04, 0.04])


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        ([], "no readings"),
        ([Reading(1.0, UP, 1.0), Reading(1.0, DOWN, 1.0)], "at least 2 targets"),
        ([Reading(1.0, UP, float("nan"))], "reading 1: target 1.0, measured nan"),
        ([Reading(1.0, Direction.UNKNOWN, 1.0)], "direction unknown"),
        (
            [Reading(x, UP, x) for x in (0.0, 5.0, 10.0)] + [Reading(x, DOWN, x) for x in (0.0, 10.0)],
            "no backward reading at 5:",
        ),
        ([Reading(x, UP, x) for x in (0.0, 5.0)], "no backward reading at 0, 5:"),
    ],
)
def test_readings_that_make_no_table_are_named(readings: list[Reading], words: str) -> None:
    with pytest.raises(ReadingsError, match=words):
        build_table(readings, Units.MM)


def test_without_estimation_a_missing_end_is_named() -> None:
    with pytest.raises(ReadingsError, match="no backward reading at 0:"):
        build_table(tb058_readings(), Units.INCH, estimate_ends=False)


def test_home_outside_the_targets_is_refused() -> None:
    with pytest.raises(ReadingsError, match=r"home at 1 is outside the targets -2.5 to 0"):
        build_table(tb058_readings(), Units.INCH, home=HomeReference(1.0, UP))


def test_targets_that_are_one_and_the_same_but_for_a_slip_make_no_table() -> None:
    readings = [Reading(x, way, m) for way in (UP, DOWN) for x, m in ((0.0, 0.0), (1e-6, 0.01), (5.0, 5.0))]
    with pytest.raises(TableError, match="slope"):
        build_table(readings, Units.MM)


def test_a_first_block_near_0_is_home() -> None:
    def near(first: float) -> list[Reading]:
        return [
            Reading(x, way, x - error)
            for x, error in ((first, 0.004), (25.0, 0.007), (50.0, 0.009))
            for way in (Direction.FORWARD, Direction.BACKWARD)
        ]

    for first in (0.0012, -0.0012):
        table = build_table(near(first), Units.MM)
        # A hundredth of the 25 mm to the next block is 0.25 mm.
        for case in (HomeCase.SWITCH_POSITIVE, HomeCase.MARK):
            home = case.reference(table)
            at = max(first, 0.0) if case is HomeCase.MARK else first
            assert home == HomeReference(at, Direction.FORWARD)
            left = correction_at(referenced(table, home), at, Direction.FORWARD)
            assert left == pytest.approx(0.0, abs=1e-12)
    for case in (HomeCase.SWITCH_POSITIVE, HomeCase.MARK):
        with pytest.raises(ReadingsError):
            case.reference(build_table(near(-0.3 if case is HomeCase.SWITCH_POSITIVE else 0.3), Units.MM))
