"""What looks wrong about readings as a whole is said, and nothing about sound ones."""

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.doubts import plausibility_warnings
from gateway.metrology.readings import Reading

TARGETS = (0.0, 100.0, 200.0, 300.0, 400.0)


def readings(*, scale: float = 1.0, end: float = 0.02, zero: float = 0.0) -> list[Reading]:
    """10 µm of error each 100 mm and 20 µm of lost motion; ``end``: the lost motion at the last target."""
    found = []
    for target in TARGETS:
        lost = end if target == TARGETS[-1] else 0.02
        for way, behind in ((Direction.FORWARD, 0.0), (Direction.BACKWARD, lost)):
            found.append(Reading(target, way, target + zero + scale * (target * 1e-4 + behind)))
    return found


@pytest.mark.parametrize("zero", [0.0, -250.0])
def test_sound_readings_raise_no_doubt_wherever_the_instrument_has_its_zero(zero: float) -> None:
    assert plausibility_warnings(readings(zero=zero), Units.MM) == []


def test_readings_in_another_unit_than_they_are_said_to_be_in() -> None:
    # 40 µm and 20 µm: 0.06 mm in all. Taken for µm they are 0.06 µm, µm taken for mm they are 60 mm.
    [small] = plausibility_warnings(readings(scale=1e-3), Units.MM)
    assert "all deviations together differ by 6e-05 mm" in small
    [large] = plausibility_warnings(readings(scale=1e3), Units.MM)
    assert "all deviations together differ by 60 mm" in large
    assert plausibility_warnings(readings(scale=1e-3), Units.DEGREE) == []


def test_an_end_without_overrun_is_named_with_what_is_lost_elsewhere() -> None:
    [warning] = plausibility_warnings(readings(end=0.001), Units.MM)
    assert "at 400 both directions differ by 0.001 mm, elsewhere by at least 0.02" in warning
    assert "overrun" in warning
    assert plausibility_warnings(readings(end=0.006), Units.MM) == []


def test_lost_motion_of_both_signs_proves_nothing_about_an_end() -> None:
    mixed = [
        Reading(each.target, each.direction, each.measured - (0.04 if each.target == 100.0 else 0.0))
        if each.direction is Direction.BACKWARD
        else each
        for each in readings(end=0.0)
    ]
    assert plausibility_warnings(mixed, Units.MM) == []
