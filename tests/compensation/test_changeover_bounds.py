"""What going from one correction to another can change, without a walk over the points of a table."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.backlash import with_backlash
from gateway.compensation.correction_spec import (
    NOTHING,
    CorrectionSpec,
    changeover_distance,
    largest_difference,
    reversal_in_force,
    spec_of_table,
)
from gateway.compensation.settings import (
    AxisSettings,
    Backlash,
    BacklashKind,
    Gain,
    Outside,
    OutsideKind,
    Setpoints,
)
from gateway.compensation.table import CorrectionTable, Range, make_table
from gateway.compensation.units import Units

SETTINGS = AxisSettings(units=Units.MM, counts_per_unit=1000.0, setpoints=Setpoints.STREAM)
POSITIONS = [0.0, 10.0, 20.0, 30.0]
FORWARD = [0.01, 0.05, -0.02, 0.0]
BACKWARD = [0.02, 0.01, -0.04, 0.0]
LENGTHS = st.lists(st.floats(-0.1, 0.1), min_size=4, max_size=4)
SHARES = st.sampled_from([0.0, 1.0])
Drawn = tuple[list[float], list[float], Gain]
GAINS = st.builds(Gain, st.floats(0.0, 1.0), st.floats(0.0, 1.0))


def table_of(forward: list[float], backward: list[float]) -> CorrectionTable:
    return make_table(POSITIONS, forward, backward, Units.MM)


def spec_of(table: CorrectionTable, gain: Gain | None = None) -> CorrectionSpec:
    return spec_of_table(table, SETTINGS, gain)


def test_a_table_knows_what_holds_for_all_of_its_points() -> None:
    facts = table_of(FORWARD, BACKWARD).facts
    assert facts.forward == Range(-0.02, 0.05)
    assert facts.backward == Range(-0.04, 0.02)
    # forward - backward at each point: -0.01, 0.04, 0.02, 0.
    assert facts.difference == pytest.approx((-0.01, 0.04))
    # The steepest stretch: forward from 0.05 to -0.02 over 10 mm.
    assert facts.max_slope == pytest.approx(0.007)
    assert not facts.is_unidirectional


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (NOTHING, spec_of(table_of(FORWARD, BACKWARD)), 0.05),
        # At half the gain the largest is 0.025 forward and 0.02 backward.
        (NOTHING, spec_of(table_of(FORWARD, BACKWARD), Gain(0.5, 0.5)), 0.025),
        # From a constant 0.03: to -0.04 on the backward branch it is 0.07.
        (CorrectionSpec(offset=0.03), spec_of(table_of(FORWARD, BACKWARD)), 0.07),
        # Two tables: forward up to 0.05 against down to -0.05.
        (
            spec_of(table_of(FORWARD, FORWARD)),
            spec_of(table_of([-c for c in FORWARD], [-c for c in FORWARD])),
            0.1,
        ),
    ],
)
def test_the_largest_change_by_hand(one: CorrectionSpec, other: CorrectionSpec, expected: float) -> None:
    assert largest_difference(one, other) == pytest.approx(expected)
    assert largest_difference(other, one) == pytest.approx(expected)


def test_another_gain_of_one_table_changes_its_share_only() -> None:
    table = table_of(FORWARD, BACKWARD)
    # A tenth of 0.05 forward, a fifth of 0.04 backward.
    change = largest_difference(spec_of(table), spec_of(table, Gain(0.9, 0.8)))
    assert change == pytest.approx(0.008)


def test_a_change_over_is_four_differences_long_at_least() -> None:
    wide = spec_of(table_of([0.0, 0.4, 0.3, 0.0], [0.0, 0.4, 0.3, 0.0]))
    assert changeover_distance(NOTHING, wide, SETTINGS) == pytest.approx(1.6)
    assert changeover_distance(NOTHING, spec_of(table_of(FORWARD, BACKWARD)), SETTINGS) == 1.0


@given(st.tuples(LENGTHS, LENGTHS, GAINS), st.tuples(LENGTHS, LENGTHS, GAINS), st.floats(-50.0, 80.0), SHARES)
def test_no_place_changes_more_than_the_bound(
    one_of: Drawn, other_of: Drawn, position: float, share: float
) -> None:
    fading = AxisSettings(
        units=Units.MM, counts_per_unit=1000.0, outside=Outside(OutsideKind.FADE, fade_length=20.0)
    )
    one = spec_of_table(table_of(one_of[0], one_of[1]), fading, one_of[2])
    other = spec_of_table(table_of(other_of[0], other_of[1]), fading, other_of[2])
    change = abs(one.map_at(share).correction(position) - other.map_at(share).correction(position))
    assert change <= largest_difference(one, other) + 1e-12


@given(LENGTHS, LENGTHS, GAINS)
def test_a_reversal_is_long_enough_for_any_gain(
    forward: list[float], backward: list[float], gain: Gain
) -> None:
    in_force = reversal_in_force(table_of(forward, backward), SETTINGS, gain)
    largest = max(abs(gain.forward * f - gain.backward * b) for f, b in zip(forward, backward, strict=True))
    assert in_force.amount >= 5.0 * largest - 1e-12
    if gain.is_even:
        assert in_force.amount == pytest.approx(max(5.0 * largest, 20.0 * SETTINGS.hysteresis))


def test_lost_motion_is_put_into_a_table_once() -> None:
    backlash = Backlash(0.02, BacklashKind.TWO_SIDED)
    once = with_backlash(table_of(FORWARD, FORWARD), backlash)
    assert list(once.forward) == pytest.approx([0.02, 0.06, -0.01, 0.01])
    assert with_backlash(once, backlash) is once
