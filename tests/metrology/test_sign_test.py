"""Two readings at one point, and what they say about a table."""

import math
from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gateway.compensation.curve import Curve
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.sign_test import (
    Measurement,
    Pair,
    SignVerdict,
    TableUse,
    most_telling_position,
    room,
    sign_test,
)

AT = Measurement(50.0, Pair(0.0, 0.0), uncertainty=0.002, largest=1.0, mirrored=(-50.0,))
FLAT = make_table([0, 100], [0.02, 0.02], [-0.01, -0.01], Units.MM)
"""20 µm added forward, 10 µm taken away backward, everywhere: so the exact inverse is plain subtraction."""


def judged(table: CorrectionTable, forward: float, backward: float, position: float = 50.0) -> SignVerdict:
    at = replace(AT, position=position, readings=Pair(forward, backward), mirrored=(-position,))
    return sign_test(Curve(table), at).verdict


@pytest.mark.parametrize(
    ("forward", "backward", "verdict"),
    [
        (49.98, 50.01, SignVerdict.RIGHT),  # 50 - 0.02, 50 + 0.01
        (50.02, 49.99, SignVerdict.SENSE_INVERTED),
        (50.01, 49.98, SignVerdict.COLUMNS_SWAPPED),
        (49.99, 50.02, SignVerdict.BOTH),
        (-50.02, -49.99, SignVerdict.DIRECTION_INVERTED),
        (49.981, 50.009, SignVerdict.RIGHT),  # a micrometre off, within the uncertainty
        (49.985, 50.007, SignVerdict.RIGHT),  # a screw that has changed a little
        (50.0, 50.0, SignVerdict.NOTHING_FITS),  # a screw without error: no way explains half of the table
        (49.6, 50.4, SignVerdict.NOTHING_FITS),
        (12.0, 12.0, SignVerdict.NOTHING_FITS),  # somewhere else altogether
    ],
)
def test_verdicts_worked_by_hand(forward: float, backward: float, verdict: SignVerdict) -> None:
    assert judged(FLAT, forward, backward) is verdict


def test_the_numbers_of_a_verdict_can_be_followed() -> None:
    result = sign_test(Curve(FLAT), replace(AT, readings=Pair(50.02, 49.99)))
    assert (result.table.forward, result.table.backward) == (0.02, -0.01)
    assert result.measured.forward == pytest.approx(-0.02)
    assert result.measured.backward == pytest.approx(0.01)
    # Right would be 49.98 and 50.01: off by 0.04 and 0.02.
    assert result.off_by[TableUse.RIGHT] == pytest.approx(0.04)
    assert result.off_by[TableUse.SENSE_INVERTED] == pytest.approx(0.0)
    assert result.share == pytest.approx(-1.0)
    assert result.candidates == (TableUse.SENSE_INVERTED,)


def test_a_steep_table_is_inverted_exactly() -> None:
    # Slope 0.5: corrected = 1.5 nominal on the way up, so with the drive at 60 the nut is at 40, not at 30.
    steep = make_table([0, 100], [0, 50], [0, -25], Units.MM)
    at = Measurement(60.0, Pair(40.0, 80.0), uncertainty=0.002, largest=100.0)
    # Backward: corrected = 0.75 nominal, 60 / 0.75 = 80.
    result = sign_test(Curve(steep), at)
    assert result.verdict is SignVerdict.RIGHT
    assert result.off_by[TableUse.RIGHT] == pytest.approx(0.0)


def test_where_a_table_is_flat_it_cannot_be_told_and_a_better_place_is_named() -> None:
    table = make_table([0, 50, 100, 150], [0, 0.0005, 0.03, 0], [0, -0.0005, -0.01, 0], Units.MM)
    result = sign_test(Curve(table), replace(AT, readings=Pair(49.9995, 50.0005)))
    assert result.verdict is SignVerdict.CANNOT_TELL
    assert set(result.candidates) == set(TableUse)
    # At 100: twice 0.03, 0.03 + 0.01 and 0.03 - 0.01; the smallest is 0.02.
    assert result.best.position == 100.0
    assert result.best.separation == pytest.approx(0.02)


def test_a_symmetric_table_is_wrong_but_nobody_can_say_how() -> None:
    # Backlash alone: turning the sense and swapping the columns come to the same.
    table = make_table([0, 100], [0.02, 0.02], [-0.02, -0.02], Units.MM)
    result = sign_test(Curve(table), replace(AT, readings=Pair(50.02, 49.98)))
    assert result.verdict is SignVerdict.CANNOT_TELL
    assert set(result.candidates) == {TableUse.SENSE_INVERTED, TableUse.COLUMNS_SWAPPED}
    assert most_telling_position(Curve(table)).separation == 0.0


def test_a_table_of_one_direction_has_no_columns_to_swap() -> None:
    table = make_table([0, 100], [0.02, 0.02], [0.02, 0.02], Units.MM)
    assert judged(table, 49.98, 49.98) is SignVerdict.RIGHT
    assert judged(table, 50.02, 50.02) is SignVerdict.SENSE_INVERTED
    assert most_telling_position(Curve(table)).separation == pytest.approx(0.04)


def test_at_zero_nobody_can_say_which_way_an_axis_goes() -> None:
    table = make_table([-100, 100], [0.02, 0.02], [-0.01, -0.01], Units.MM)
    at = replace(AT, position=0.0, readings=Pair(-0.02, 0.01), mirrored=(0.0,))
    result = sign_test(Curve(table), at)
    assert result.verdict is SignVerdict.RIGHT
    assert not result.tells_direction
    assert sign_test(Curve(FLAT), replace(AT, readings=Pair(49.98, 50.01))).tells_direction


@pytest.mark.parametrize(
    "wrong",
    [
        {"position": math.nan},
        {"readings": Pair(math.inf, 0.0)},
        {"readings": Pair(0.0, math.nan)},
        {"uncertainty": 0.0},
    ],
)
def test_numbers_that_are_none_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ReadingsError):
        replace(AT, **wrong)  # type: ignore[arg-type]


corrections = st.floats(-0.2, 0.2)
noise = st.floats(-1.0, 1.0)


@given(
    st.lists(st.tuples(corrections, corrections), min_size=2, max_size=8),
    st.sampled_from(list(TableUse)),
    noise,
    noise,
    st.floats(0, 1),
)
def test_a_way_that_the_readings_were_made_with_is_never_excluded(
    rows: list[tuple[float, float]], way: TableUse, forward_noise: float, backward_noise: float, share: float
) -> None:
    table = make_table(
        [10.0 * i for i in range(len(rows))], [f for f, _ in rows], [b for _, b in rows], Units.MM
    )
    assume(not table.is_unidirectional)
    position = share * table.last
    at = Measurement(position, Pair(position, position), uncertainty=0.002, largest=1.0)
    exact = sign_test(Curve(table), at).expected[way]
    readings = Pair(
        exact.forward + forward_noise * at.uncertainty, exact.backward + backward_noise * at.uncertainty
    )
    result = sign_test(Curve(table), replace(at, readings=readings))
    assert way in result.candidates
    assert result.verdict.value in (way.value, "cannot tell")


@given(st.lists(st.tuples(corrections, corrections), min_size=2, max_size=8))
def test_no_point_of_a_table_tells_more_than_the_best_one(rows: list[tuple[float, float]]) -> None:
    table = make_table(
        [1e5 * i for i in range(len(rows))], [f for f, _ in rows], [b for _, b in rows], Units.MM
    )
    best = most_telling_position(Curve(table))
    assert best.position in table.positions
    for position in table.positions:
        expected = sign_test(
            Curve(table), replace(AT, position=position, readings=Pair(position, position))
        ).expected
        pairs = list(expected.values())
        least = min(a.distance(b) for i, a in enumerate(pairs) for b in pairs[i + 1 :])
        # The exact inverse takes the slope into account: at most 0.4 mm in 100 m here.
        assert least <= best.separation + 1e-5


def test_a_place_is_proposed_where_there_is_room_to_come_from_both_sides() -> None:
    """It differs most at -300, which is the end of travel: 0.3 mm there, so 0.299 mm at -299."""
    table = make_table([-300, 0], [0.3, 0.0], [0.3, 0.0], Units.MM)
    inside = room(table, (-300.0, 0.0), 1.0)
    best = most_telling_position(Curve(table), inside)
    assert best.position == -299.0
    assert best.separation == pytest.approx(2 * 0.299)
    at = replace(AT, position=-1.0, readings=Pair(-1.0, -1.0), mirrored=())
    assert sign_test(Curve(table), at, inside).best == best
