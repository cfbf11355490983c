"""A line on top of a table, as a warm screw and another axis make it: exact both ways, and bumpless."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.axis import AxisCompensation
from gateway.compensation.correction_map import CorrectionMap, Term
from gateway.compensation.correction_spec import (
    NOTHING,
    CorrectionSpec,
    changeover_distance,
    spec_of_table,
    with_line,
)
from gateway.compensation.curve import Curve
from gateway.compensation.direction import Direction, Travel
from gateway.compensation.errors import SettingsError
from gateway.compensation.moves import Accepted, EstimateKind, PositionEstimate, State
from gateway.compensation.settings import Outside, OutsideKind, Setpoints
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from tests.compensation.compensation_strategies import plain_settings, tables

RAMP = make_table([0, 1000], [0.0, 0.1], [0.0, 0.1], Units.MM)
"""100 µm/m in both directions."""
LOST_MOTION = make_table([0, 1000], [0.01, 0.01], [-0.01, -0.01], Units.MM)
FLAT = make_table([0, 1000], [0.0, 0.0], [0.0, 0.0], Units.MM)
TRAVEL = (0.0, 1000.0)


def axis_with(table: CorrectionTable, **more: Any) -> AxisCompensation:
    axis = AxisCompensation(plain_settings(1000.0, **{"travel": TRAVEL, "travel_margin": 1e6, **more}))
    axis.find_reference(spec_of_table(table, axis.settings))
    return axis


def want_line(axis: AxisCompensation, offset: float, tilt: float) -> None:
    axis.want(with_line(axis._requested, offset, tilt))


def send(axis: AxisCompensation, counts: int, place: PositionEstimate | None = None) -> int:
    move = axis.plan(counts, place, 0)
    corrected = counts + round(move.correction_counts)
    axis.commit(move, corrected)
    return corrected


def read(axis: AxisCompensation, corrected_counts: int) -> int:
    return corrected_counts - round(axis.readback.correction_counts(corrected_counts))


def at(counts: int) -> PositionEstimate:
    return PositionEstimate(counts, EstimateKind.REACHED)


@given(
    tables(0.7), st.floats(-0.2, 0.2), st.floats(-1.0, 1.0), st.floats(0.0, 1.0), st.floats(-1500.0, 1500.0)
)
def test_the_inverse_is_exact_with_a_line_on_any_blend(
    table: CorrectionTable, tilt: float, offset: float, share: float, nominal: float
) -> None:
    found = CorrectionMap((Term(Curve(table), share, 1.0 - share),), offset, tilt)
    corrected = nominal + found.correction(nominal)
    solved = found.solve(corrected, corrected)
    assert solved.nominal == pytest.approx(nominal, rel=1e-11, abs=1e-10)  # the map may be ten times flatter
    assert solved.nominal + solved.correction == pytest.approx(corrected, rel=1e-12, abs=1e-12)
    assert solved.correction == pytest.approx(found.correction(solved.nominal), rel=1e-11, abs=1e-11)


@given(tables(0.01), st.floats(-0.005, 0.005), st.floats(-1.0, 1.0), st.floats(-1500.0, 1500.0))
def test_the_inverse_of_what_a_machine_has_holds_to_a_millionth_of_a_millionth(
    table: CorrectionTable, tilt: float, offset: float, nominal: float
) -> None:
    found = CorrectionMap((Term(Curve(table), 1.0, 0.0),), offset, tilt)
    assert found.nominal(nominal + found.correction(nominal)) == pytest.approx(nominal, rel=1e-12, abs=1e-12)


@given(st.floats(-0.9, 0.9), st.floats(-1.0, 1.0), st.floats(-1500.0, 1500.0))
def test_a_line_alone_is_inverted_too(tilt: float, offset: float, nominal: float) -> None:
    found = CorrectionMap((), offset, tilt)
    assert found.correction(nominal) == offset + tilt * nominal
    corrected = nominal + offset + tilt * nominal
    assert found.nominal(corrected) == pytest.approx(nominal, rel=1e-11, abs=1e-11)


def test_a_far_wrong_guess_finds_the_piece_of_a_tilted_map() -> None:
    zigzag = make_table(list(range(100)), [0.3 * (i % 2) for i in range(100)], [0.0] * 100, Units.MM)
    found = CorrectionMap((Term(Curve(zigzag), 1.0, 0.0),), 0.25, 0.5)
    for tenth in range(990):
        nominal = tenth / 10
        corrected = nominal + found.correction(nominal)
        assert found.solve(corrected, -1e6).nominal == pytest.approx(nominal, rel=1e-12, abs=1e-12)
        # Where no guess helps, the interval that is searched reaches as far as the line does: 50 mm here.
        assert found._search(corrected).nominal == pytest.approx(nominal, rel=1e-12, abs=1e-12)


def test_a_line_that_could_not_be_inverted_is_refused() -> None:
    spec = spec_of_table(make_table([0, 1], [0.0, 0.6], [0.0, 0.6], Units.MM), plain_settings())
    assert with_line(spec, 0.0, -0.39).tilt == -0.39
    with pytest.raises(SettingsError, match="together they must stay below 1"):
        with_line(spec, 0.0, -0.4)
    fade = Outside(OutsideKind.FADE, 0.7)
    spec = spec_of_table(make_table([0, 9], [0.0, 0.6], [0.0, 0.6], Units.MM), plain_settings(outside=fade))
    with pytest.raises(SettingsError, match=r"one of 0\.8571"):
        with_line(spec, 0.0, -0.15)
    with pytest.raises(SettingsError):
        with_line(NOTHING, 0.0, float("nan"))


def test_a_line_comes_into_force_with_the_next_different_target_and_never_alone() -> None:
    axis = axis_with(RAMP)
    assert send(axis, 500_000, at(0)) == 500_050
    want_line(axis, 0.0, -115e-6)  # 10 K on a steel screw that is held at 0
    assert axis.again().correction_counts == 50
    assert read(axis, 500_050) == 500_000
    assert not axis.is_steady
    assert axis.plan_steady(500_000, 0, True) is None
    # 800 mm: 80 µm of the table less 92 µm of the screw.
    assert send(axis, 800_000, at(500_000)) == 799_988
    assert read(axis, 799_988) == 800_000
    assert axis.plan_steady(900_000, 0, True) is not None


def test_the_short_way_and_the_long_way_agree_under_a_line() -> None:
    axis = axis_with(LOST_MOTION)
    want_line(axis, 0.0123, -115e-6)
    send(axis, 100_000, at(0))
    send(axis, 200_000, at(100_000))
    steady = axis.plan_steady(345_678, 7, True)
    assert steady is not None
    assert axis.move_of(steady) == axis.plan(345_678, at(200_000), 7)


@given(tables(0.3), st.lists(st.tuples(st.integers(-500_000, 500_000), st.floats(-0.01, 0.01)), min_size=1))
@settings(max_examples=60)
def test_a_standing_axis_reads_the_same_whatever_is_asked_for(
    table: CorrectionTable, moves: list[tuple[int, float]]
) -> None:
    axis = axis_with(table)
    for target, tilt in moves:
        want_line(axis, 10 * tilt, tilt)
        corrected = send(axis, target, at(target - 1))
        assert read(axis, corrected) == target
        want_line(axis, -tilt, -tilt)
        assert read(axis, corrected) == target


def test_the_reading_is_kept_where_a_target_changes_the_line_and_ends_exact() -> None:
    axis = axis_with(FLAT)
    send(axis, 100_000, at(0))
    axis.observe(100_000)
    want_line(axis, 0.0, -1e-3)
    assert send(axis, 900_000, at(100_000)) == 899_100
    assert read(axis, 100_000) == 100_000  # it still stands where it stood
    readings = [read(axis, counts) for counts in range(100_000, 899_101, 799)]
    assert all(one < other for one, other in pairwise(readings))
    assert read(axis, 899_100) == 900_000


def stream_axis(table: CorrectionTable = FLAT, **more: Any) -> AxisCompensation:
    axis = axis_with(table, setpoints=Setpoints.STREAM, **more)
    axis.assume_offset(0, 0, [], 0.0)
    send(axis, 0)
    for counts in range(100, 3000, 100):  # the blend to the table is over
        send(axis, counts)
    assert axis.is_steady
    return axis


def test_a_stream_takes_a_line_over_with_its_setpoints_as_steep_as_a_table_may_be() -> None:
    axis = stream_axis(max_slope=0.01)
    want_line(axis, 0.05, 0.0)
    told = [send(axis, counts) - counts for counts in range(3000, 9100, 100)]
    assert told[0] == 1  # 1 % of 0.1 mm is one count
    assert [other - one for one, other in pairwise(told)][:49] == [1] * 49
    assert told[49:] == [50] * 12
    assert axis.is_steady


def test_a_stream_that_stands_gets_nothing() -> None:
    axis = stream_axis()
    want_line(axis, 0.05, 0.0)
    assert [send(axis, 2900) for _ in range(5)] == [2900] * 5


@given(
    tables(0.01),
    st.lists(st.tuples(st.integers(-3000, 3000), st.floats(-0.3, 0.3), st.floats(-1e-3, 1e-3)), min_size=2),
)
@settings(max_examples=60)
def test_no_setpoint_of_a_stream_makes_a_step_larger_than_its_travel_allows(
    table: CorrectionTable, moves: list[tuple[int, float, float]]
) -> None:
    table = make_table(table.positions, table.forward, table.forward, Units.MM)  # no reversals here
    axis = axis_with(table, setpoints=Setpoints.STREAM, max_slope=0.01, max_correction=1e3)
    start = table.forward[0] if table.first > 0 else CorrectionMap((Term(Curve(table), 1, 0),)).correction(0)
    axis.assume_offset(start * 1000, 0, [spec_of_table(table, axis.settings)], 0.0)
    send(axis, 0)
    counts = 0
    while not axis.is_steady:
        counts += 2000
        send(axis, counts)
    last, last_correction = counts, axis.plan(counts, None, 0).correction_counts
    for distance, offset, tilt in moves:
        want_line(axis, offset, tilt)
        move = axis.plan(last + distance, None, 0)
        # The table, the line in force and the change of the line: at most 1 %, 0.1 % and 1 % of the travel.
        assert abs(move.correction_counts - last_correction) <= 0.0212 * abs(distance) + 1e-6
        axis.commit(move, move.nominal_counts + round(move.correction_counts))
        last, last_correction = last + distance, move.correction_counts


@given(st.lists(st.tuples(st.integers(-400_000, 400_000), st.floats(-0.3, 0.3), st.floats(-1e-3, 1e-3))))
@settings(max_examples=60)
def test_nothing_is_left_when_lines_have_come_and_gone(moves: list[tuple[int, float, float]]) -> None:
    axis = stream_axis(LOST_MOTION)
    for target, offset, tilt in moves:
        want_line(axis, offset, tilt)
        send(axis, target)
    want_line(axis, 0.0, 0.0)
    for counts in (0, 900_000, 1_800_000):
        send(axis, counts)
    assert axis.plan(1_900_000, None, 0).correction_counts == 10.0


def test_the_way_over_to_another_table_is_long_enough_for_the_line_too() -> None:
    settings_ = plain_settings(travel=(-200.0, 1000.0), reload_distance=1.0)
    line = with_line(spec_of_table(FLAT, settings_), 0.1, 1e-3)
    assert changeover_distance(line, NOTHING, settings_) == pytest.approx(4 * (0.1 + 1.0))


def test_a_line_is_kin_only_on_its_own_curve() -> None:
    one = spec_of_table(FLAT, plain_settings())
    assert with_line(one, 1.0, 0.0).is_kin_of(one)
    assert not spec_of_table(FLAT, plain_settings()).is_kin_of(one)
    assert not CorrectionSpec(offset=0.1).is_kin_of(CorrectionSpec())


@pytest.mark.parametrize("towards", [1, -1])
def test_a_stream_on_a_steep_table_is_never_turned_round_by_its_line(towards: int) -> None:
    """A table of −0.6 and a line that may change by 0.6 would come to −1.2: backwards."""
    steep = make_table([-1000, 1000], [600.0, -600.0], [600.0, -600.0], Units.MM)
    axis = axis_with(
        steep, setpoints=Setpoints.STREAM, max_slope=0.6, max_correction=1e4, travel=(-1000.0, 1000.0)
    )
    way = Direction(towards)
    axis.resume(
        State(0.0, Travel(way, 0.0), way.goal, spec=axis._requested), Accepted(0, 0), 0.0, None, (0.0, 0.0)
    )
    want_line(axis, -towards * 2.0, 0.0)
    told = [send(axis, towards * 1000 * step) for step in range(21)]
    assert all((other - one) * towards > 0 for one, other in pairwise(told))
    assert told[-1] == towards * (0.4 * 20_000 - 2000)  # all of it has come
