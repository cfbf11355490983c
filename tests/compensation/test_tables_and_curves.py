"""Correction tables and the piecewise linear curves made of them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.backlash import with_backlash
from gateway.compensation.correction_map import CorrectionMap, Term
from gateway.compensation.curve import Curve
from gateway.compensation.errors import SettingsError, TableError
from gateway.compensation.settings import Backlash, BacklashKind, Outside, OutsideKind
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from tests.compensation.compensation_strategies import tables

RAMP = make_table([0, 10, 20], [0.0, 0.02, -0.02], [-0.01, 0.01, -0.03], Units.MM)


def forward(curve: Curve) -> CorrectionMap:
    return CorrectionMap((Term(curve, 1.0, 0.0),))


def backward(curve: Curve) -> CorrectionMap:
    return CorrectionMap((Term(curve, 0.0, 1.0),))


@pytest.mark.parametrize(
    ("position", "expected_forward", "expected_backward"),
    [(0, 0.0, -0.01), (5, 0.01, 0.0), (10, 0.02, 0.01), (15, 0.0, -0.01), (20, -0.02, -0.03)],
)
def test_correction_is_the_row_at_a_row_and_linear_between(
    position: float, expected_forward: float, expected_backward: float
) -> None:
    curve = Curve(RAMP)
    assert expected_forward == pytest.approx(forward(curve).correction(position), abs=1e-15)
    assert expected_backward == pytest.approx(backward(curve).correction(position), abs=1e-15)


def test_hold_keeps_the_end_values_outside() -> None:
    curve = Curve(RAMP)
    assert forward(curve).correction(25) == -0.02
    assert backward(curve).correction(-3) == -0.01


def test_fade_lessens_linearly_to_nothing() -> None:
    curve = Curve(RAMP, Outside(OutsideKind.FADE, 4.0))
    assert forward(curve).correction(22) == pytest.approx(-0.01)
    assert forward(curve).correction(24) == pytest.approx(0.0)
    assert forward(curve).correction(30) == 0.0
    assert backward(curve).correction(-1) == pytest.approx(-0.0075)
    assert backward(curve).correction(-9) == 0.0


def test_zero_adds_nothing_outside() -> None:
    curve = Curve(RAMP, Outside(OutsideKind.ZERO))
    assert forward(curve).correction(20.000001) == 0.0
    assert forward(curve).correction(20) == -0.02


def test_fade_as_short_as_its_correction_is_refused() -> None:
    with pytest.raises(TableError, match=r"cannot fade out over 0\.03"):
        Curve(RAMP, Outside(OutsideKind.FADE, 0.03))


@pytest.mark.parametrize(
    ("positions", "curve", "message"),
    [
        ([0], [0], "at least 2"),
        ([0, 1], [0], "of one length"),
        ([0, 0], [0, 0], "does not lie above"),
        ([1, 0], [0, 0], "does not lie above"),
        ([0, 1], [0, math.nan], "not a finite number"),
        ([0, math.inf], [0, 0], "not a finite number"),
        ([0, 1], [0, 1.0], "a slope of 1, which must stay below 1"),
        ([0, 1], [0, -1.5], "a slope of -1.5"),
    ],
)
def test_a_bad_table_is_refused_whole(positions: list[float], curve: list[float], message: str) -> None:
    with pytest.raises(TableError, match=message):
        make_table(positions, curve, curve, Units.MM)


def test_inch_table_in_mm_is_exact() -> None:
    table = make_table([0, 1], [0.0, 0.001], [0.0, 0.001], Units.INCH).in_units(Units.MM)
    assert list(table.positions) == [0.0, 25.4]
    assert list(table.forward) == [0.0, 0.0254]


def test_rotary_table_wraps_in_both_senses() -> None:
    table = make_table([0, 90, 180, 270, 360], [0, 0.01, 0, -0.01, 0], [0, 0.02, 0, -0.02, 0], Units.DEGREE)
    turn = forward(Curve(table, modulo=360.0))
    for turns in (-3, 0, 1, 1000):
        assert turn.correction(45 + 360 * turns) == pytest.approx(0.005)
        assert turn.correction(360 * turns) == 0.0
        assert turn.nominal(45.005 + 360 * turns) == pytest.approx(45 + 360 * turns, abs=1e-9)


def test_rotary_table_that_does_not_close_is_refused() -> None:
    open_ended = make_table([0, 360], [0, 0.01], [0, 0], Units.DEGREE)
    with pytest.raises(TableError, match="both ends of a turn must carry the same correction"):
        Curve(open_ended, modulo=360.0)
    short = make_table([0, 350], [0, 0], [0, 0], Units.DEGREE)
    with pytest.raises(TableError, match="cover one turn of 360 exactly; this one covers 350"):
        Curve(short, modulo=360.0)


@given(tables(), st.floats(0, 1), st.floats(-2000, 4000))
def test_nominal_is_the_exact_inverse_of_every_blend(table: object, share: float, position: float) -> None:
    curve = Curve(table)  # type: ignore[arg-type]
    blend = CorrectionMap((Term(curve, share, 1.0 - share),))
    corrected = position + blend.correction(position)
    # A slope of -0.95 lets one unit in the last place of `corrected` weigh twenty times in the solution.
    assert blend.nominal(corrected) == pytest.approx(position, abs=1e-9)


@given(tables(0.45), tables(0.45), st.floats(0, 1), st.floats(-3000, 3000))
def test_a_blend_of_two_tables_inverts_exactly(
    one: object, other: object, share: float, position: float
) -> None:
    both = CorrectionMap(
        (Term(Curve(one), share, 0.0), Term(Curve(other), 0.0, 1.0 - share)),  # type: ignore[arg-type]
        offset=0.125,
    )
    assert both.nominal(position + both.correction(position)) == pytest.approx(position, abs=1e-9)


@given(tables(), st.floats(-3000, 3000), st.floats(0.001, 10))
def test_corrected_position_never_turns_round(table: object, position: float, further: float) -> None:
    one_branch = forward(Curve(table))  # type: ignore[arg-type]
    here = position + one_branch.correction(position)
    there = position + further + one_branch.correction(position + further)
    assert there > here


@given(tables(), st.floats(-3000, 3000))
def test_an_even_and_a_free_grid_of_the_same_points_agree(table: object, position: float) -> None:
    same = make_table(table.positions, table.forward, table.backward, Units.MM)  # type: ignore[attr-defined]
    odd_start = table.positions[0] - 0.3  # type: ignore[attr-defined]
    free = make_table(
        [odd_start, *same.positions],
        [same.forward[0], *same.forward],
        [same.backward[0], *same.backward],
        Units.MM,
    )
    even_value = forward(Curve(same)).correction(position)
    assert forward(Curve(free)).correction(position) == pytest.approx(even_value, abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "forward_value", "backward_value"),
    [
        (BacklashKind.TWO_SIDED, 0.015, -0.005),
        (BacklashKind.HOMED_FORWARD, 0.005, -0.015),
        (BacklashKind.HOMED_BACKWARD, 0.025, 0.005),
    ],
)
def test_backlash_opens_a_table_of_one_direction(
    kind: BacklashKind, forward_value: float, backward_value: float
) -> None:
    one = make_table([0, 1], [0.005, 0.005], [0.005, 0.005], Units.MM)
    two = with_backlash(one, Backlash(0.02, kind))
    assert two.forward[0] == pytest.approx(forward_value)
    assert two.backward[0] == pytest.approx(backward_value)
    assert two.forward[0] - two.backward[0] == pytest.approx(0.02)


def test_backlash_beside_a_table_of_two_directions_is_refused() -> None:
    with pytest.raises(SettingsError, match="contain it already"):
        with_backlash(RAMP, Backlash(0.02, BacklashKind.TWO_SIDED))
