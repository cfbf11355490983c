"""One axis: targets, streams, change-overs, and a readback that returns what was commanded."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.axis import AxisCompensation
from gateway.compensation.correction_spec import CorrectionSpec, spec_of_table
from gateway.compensation.errors import OutOfTableError, OutsideTravelError, SettingsError
from gateway.compensation.limits import motion_report
from gateway.compensation.moves import Accepted, EstimateKind, PositionEstimate
from gateway.compensation.readback import after_target
from gateway.compensation.settings import (
    AxisSettings,
    Gain,
    Outside,
    OutsideKind,
    Reversal,
    ReversalKind,
    Setpoints,
)
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from tests.compensation.compensation_strategies import COUNTS_PER_UNIT, plain_settings, tables

LOST_MOTION = make_table([0, 100], [0.01, 0.01], [-0.01, -0.01], Units.MM)
"""20 µm of backlash and nothing else."""
MS = 1_000_000


def axis_with(table: CorrectionTable, counts_per_unit: float = 1000.0, **more: Any) -> AxisCompensation:
    axis = AxisCompensation(plain_settings(counts_per_unit, **more))
    axis.find_reference(spec_of_table(table, axis.settings))
    return axis


def send(
    axis: AxisCompensation, counts: int, estimate: PositionEstimate | None = None, now_ns: int = 0
) -> int:
    """Command a target as the exchange does; return what the drive is told."""
    move = axis.plan(counts, estimate, now_ns)
    corrected = counts + round(move.correction_counts)
    axis.commit(move, corrected)
    return corrected


def read(axis: AxisCompensation, corrected_counts: int) -> int:
    """Read back as the exchange does."""
    nominal = corrected_counts - round(axis.readback.correction_counts(corrected_counts))
    axis.observe(corrected_counts)
    return nominal


def at(counts: float) -> PositionEstimate:
    return PositionEstimate(counts, EstimateKind.REACHED)


def test_targets_take_the_branch_of_their_own_move() -> None:
    axis = axis_with(LOST_MOTION)
    assert send(axis, 50_000, at(0)) == 50_010
    assert send(axis, 20_000, at(50_000)) == 19_990
    assert send(axis, 20_001, at(20_000)) == 20_011


def test_an_unknown_direction_is_half_way_between_the_branches_and_flagged() -> None:
    axis = axis_with(LOST_MOTION)
    assert send(axis, 50_000) == 50_000
    assert unsure(axis)


def unsure(axis: AxisCompensation) -> bool:
    return axis.state.is_unsure


def test_a_measured_place_decides_and_within_the_hysteresis_it_is_flagged() -> None:
    axis = axis_with(LOST_MOTION, hysteresis=0.002)
    send(axis, 50_000, at(0))
    assert send(axis, 49_999, PositionEstimate(50_000, EstimateKind.MEASURED)) == 49_989
    assert unsure(axis)
    assert send(axis, 49_997, PositionEstimate(49_999, EstimateKind.MEASURED)) == 49_987
    assert not unsure(axis)
    assert send(axis, 49_998, PositionEstimate(49_998, EstimateKind.MEASURED)) == 49_988
    assert unsure(axis)


def test_a_target_that_trembles_keeps_its_branch_where_that_is_allowed() -> None:
    axis = axis_with(LOST_MOTION, repeat_within_counts=3)
    send(axis, 50_000, at(0))
    estimate = PositionEstimate(50_000, EstimateKind.REACHED)
    assert [send(axis, 50_000 - counts, estimate) for counts in (3, 2, 5)] == [50_007, 50_008, 50_005]
    assert (
        send(axis, 49_991, PositionEstimate(49_995, EstimateKind.REACHED)) == 49_981
    )  # four counts from the last one


def test_home_approach_decides_the_branch_after_homing() -> None:
    axis = axis_with(LOST_MOTION, home_approach=-1)
    assert send(axis, 10) == 0


def test_gain_scales_each_direction_by_itself() -> None:
    axis = axis_with(LOST_MOTION, gain=Gain(forward=1.0, backward=0.5))
    assert send(axis, 50_000, at(0)) == 50_010
    assert send(axis, 20_000, at(50_000)) == 19_995


def test_refuse_outside_the_table() -> None:
    axis = axis_with(LOST_MOTION, outside=Outside(OutsideKind.REFUSE))
    with pytest.raises(OutOfTableError, match=r"100\.001 lies outside the table"):
        axis.plan(100_001, at(0), 0)
    assert send(axis, 100_000, at(0)) == 100_010


def test_travel_may_be_left_by_the_margin_and_no_further() -> None:
    axis = axis_with(LOST_MOTION, travel=(0.0, 100.0), travel_margin=0.02)
    assert send(axis, 100_010, at(0)) == 100_020
    with pytest.raises(OutsideTravelError, match="leaves the travel 0 to 100"):
        axis.plan(100_011, at(0), 0)


def test_a_refused_target_leaves_no_trace() -> None:
    axis = axis_with(LOST_MOTION, travel=(0.0, 100.0))
    send(axis, 50_000, at(0))
    before = (axis.state, axis.readback, axis.accepted)
    with pytest.raises(OutsideTravelError):
        axis.plan(200_000, at(50_000), 1)
    assert (axis.state, axis.readback, axis.accepted) == before


def test_reversal_other_than_step_is_refused_for_targets() -> None:
    with pytest.raises(SettingsError, match='only "step" ends where it should'):
        axis_with(LOST_MOTION, reversal=Reversal(ReversalKind.DISTANCE, 0.05))


def test_negative_counts_per_unit_keep_forward_in_the_machine_frame() -> None:
    axis = axis_with(LOST_MOTION, -1000.0)
    # 50 mm stands at -50 000 counts; forward adds 0.01 mm, which is -10 counts.
    assert send(axis, -50_000, at(0)) == -50_010
    assert read(axis, -50_010) == -50_000


def test_zero_counts_and_machine_position() -> None:
    ramp = make_table([0, 100], [0.0, 0.1], [0.0, 0.1], Units.MM)
    axis = axis_with(ramp, zero_counts=5000)
    # 25 000 counts is 20 mm: 0.02 mm = 20 counts.
    assert send(axis, 25_000, at(5000)) == 25_020


@settings(max_examples=300)
@given(
    tables(),
    COUNTS_PER_UNIT,
    st.lists(st.integers(-4_000_000, 4_000_000), min_size=1, max_size=8),
    st.lists(st.booleans(), min_size=8, max_size=8),
)
def test_a_settled_axis_reads_back_exactly_what_was_commanded(
    table: CorrectionTable, counts_per_unit: float, targets: list[int], polls: list[bool]
) -> None:
    axis = axis_with(table, counts_per_unit)
    previous = 0
    for target, is_polled in zip(targets, polls, strict=False):
        corrected = send(axis, target, at(previous))
        if is_polled:
            axis.observe((corrected + previous) // 2)
        assert read(axis, corrected) == target
        previous = target


def test_a_standing_axis_never_jumps_when_the_branch_changes() -> None:
    axis = axis_with(LOST_MOTION)
    standing = send(axis, 50_000, at(0))
    assert read(axis, standing) == 50_000
    send(axis, 20_000, at(50_000))
    assert read(axis, standing) == 50_000


@settings(max_examples=200)
@given(tables(0.3), st.lists(st.integers(-300_000, 300_000), min_size=2, max_size=6))
def test_a_moving_axis_reads_monotonically_and_ends_exact(table: CorrectionTable, targets: list[int]) -> None:
    axis = axis_with(table)
    standing, nominal = send(axis, targets[0], at(0)), targets[0]
    assert read(axis, standing) == nominal
    for target in targets[1:]:
        if target == nominal:
            continue
        goal = send(axis, target, at(nominal))
        way = goal - standing
        readings = [
            standing + way * share // 64 - axis.readback.correction_counts(standing + way * share // 64)
            for share in range(65)
        ]
        assert readings[0] == pytest.approx(nominal, abs=1e-6) or way == 0
        assert readings[-1] == pytest.approx(target, abs=1e-6)
        sense = 1 if target > nominal else -1
        # Beside rounding: the positions asked for above are whole counts, a tiny way repeats some of them.
        assert all((b - a) * sense >= -1e-6 for a, b in pairwise(readings))
        assert read(axis, goal) == target
        standing, nominal = goal, target


def take_offset(axis: AxisCompensation, actual_counts: int, nominal_counts: int) -> float:
    return axis.assume_offset(actual_counts, nominal_counts, [spec_of_table(LOST_MOTION, axis.settings)], 0.0)


def stream_axis(table: CorrectionTable = LOST_MOTION, **more: Any) -> AxisCompensation:
    return axis_with(table, setpoints=Setpoints.STREAM, **more)


def test_a_stream_starts_from_the_offset_that_the_drive_has_and_blends_to_the_table() -> None:
    axis = stream_axis(reload_distance=1.0, home_approach=1)
    assert take_offset(axis, 4, 0) == 0  # the drive stands 4 counts beyond the first setpoint
    assert send(axis, 0) == 4
    # sin²(π/2 · 0.5) = 0.5: half of the way from 4 to 10 counts after half a millimetre
    assert send(axis, 500) == 507
    assert send(axis, 1000) == 1010
    assert send(axis, 2000) == 2010


@pytest.mark.parametrize(("difference", "taken"), [(11, 10), (50_000, 10), (-11, -10), (-50_000, -10)])
def test_what_cannot_be_a_correction_is_motion(difference: int, taken: int) -> None:
    axis = stream_axis(home_approach=1)
    assert take_offset(axis, difference, 0) == pytest.approx((difference - taken) / 1000)
    assert send(axis, 0) == taken


@pytest.mark.parametrize("difference", [-10, -3, 0, 7, 10])
def test_a_difference_that_can_be_a_correction_moves_nothing(difference: int) -> None:
    axis = stream_axis(home_approach=1)
    assert take_offset(axis, difference, 0) == 0
    assert send(axis, 0) == difference


def test_a_reversal_of_a_stream_blends_over_distance_and_stands_still_with_the_setpoint() -> None:
    axis = stream_axis(reversal=Reversal(ReversalKind.DISTANCE, 0.4), hysteresis=0.002, home_approach=1)
    send(axis, 0)
    send(axis, 10_000)
    assert send(axis, 10_000) == 10_010
    # 0.2 of 0.4 mm back: half way, sin² = 0.5, no correction at all
    assert send(axis, 9_800) == 9_800
    for _ in range(5):
        assert send(axis, 9_800) == 9_800
    assert axis.is_blending
    assert send(axis, 9_600) == 9_590
    assert not axis.is_blending


def test_the_default_reversal_is_five_times_the_largest_difference() -> None:
    axis = stream_axis()
    assert axis.state.spec.curve is None
    wanted = spec_of_table(LOST_MOTION, axis.settings)
    assert wanted.reversal.kind is ReversalKind.DISTANCE
    assert wanted.reversal.amount == pytest.approx(0.1)


def test_a_reversal_that_would_turn_the_axis_round_is_lengthened() -> None:
    swapped = make_table([0, 100], [-0.01, -0.01], [0.01, 0.01], Units.MM)
    short = plain_settings(setpoints=Setpoints.STREAM, reversal=Reversal(ReversalKind.DISTANCE, 0.01))
    assert spec_of_table(swapped, short).reversal.amount == pytest.approx(0.08)


def test_time_and_cycle_blends_advance_only_with_different_setpoints() -> None:
    axis = stream_axis(reversal=Reversal(ReversalKind.TIME_MS, 10.0), home_approach=1, reload_distance=0.001)
    send(axis, 0, now_ns=0)
    send(axis, 10_000, now_ns=2 * MS)
    send(axis, 20_000, now_ns=4 * MS)
    assert send(axis, 20_000, now_ns=400 * MS) == 20_010
    assert send(axis, 19_990, now_ns=405 * MS) != 20_000 - 20
    cycles = stream_axis(reversal=Reversal(ReversalKind.CYCLES, 2), home_approach=1, reload_distance=0.001)
    send(cycles, 0)
    send(cycles, 10_000)
    send(cycles, 10_001)
    assert send(cycles, 9_000) == 9_000
    assert send(cycles, 8_999) == 8_989


@settings(max_examples=150)
@given(tables(0.2), st.lists(st.integers(-2000, 2000), min_size=1, max_size=60), st.integers(0, 59))
def test_blends_leave_no_residue_after_any_interruption(
    table: CorrectionTable, steps: list[int], changed_at: int
) -> None:
    axis = stream_axis(table)
    other = spec_of_table(make_table([0, 1], [0.02, 0.02], [0.0, 0.0], Units.MM), axis.settings)
    setpoint = 0
    for number, step in enumerate(steps):
        if number == changed_at:
            axis.want(other)
        setpoint += step
        assert read(axis, send(axis, setpoint)) == setpoint
    axis.want(other)
    for _ in range(40):
        setpoint += 100_000
        corrected = send(axis, setpoint)
    assert corrected == setpoint + 20
    assert not axis.is_blending


@settings(max_examples=100)
@given(tables(0.01), tables(0.01), st.integers(1, 40))
def test_a_changeover_never_turns_a_stream_round(
    one: CorrectionTable, other: CorrectionTable, step: int
) -> None:
    axis = stream_axis(one, reload_distance=0.05, home_approach=1)
    setpoint, previous = 0, -(10**9)
    for number in range(400):
        if number == 100:
            axis.want(spec_of_table(other, axis.settings))
        setpoint += step
        corrected = send(axis, setpoint)
        assert corrected >= previous
        previous = corrected


def test_losing_the_reference_passes_one_to_one() -> None:
    axis = axis_with(LOST_MOTION)
    send(axis, 50_000, at(0))
    axis.lose_reference()
    assert axis.is_passing
    assert send(axis, 60_000, at(50_000)) == 60_000
    assert read(axis, 123) == 123


def test_motion_report_bounds_what_the_table_adds() -> None:
    ramp = make_table([0, 100], [0.0, 0.1], [-0.02, 0.08], Units.MM)
    jump = motion_report(*_spec_and_settings(ramp, max_speed=200.0))
    assert jump.largest_step == pytest.approx(0.02)
    assert jump.added_speed == pytest.approx(0.2)
    blended = motion_report(
        *_spec_and_settings(
            ramp, setpoints=Setpoints.STREAM, reversal=Reversal(ReversalKind.TIME_MS, 20.0), max_speed=100.0
        )
    )
    # π/2 · 0.02 mm / 0.02 s = 1.5708 mm/s beside 0.1 mm/s of slope; π²/2 · 0.02 / 0.0004 = 246.74 mm/s²
    assert blended.added_speed == pytest.approx(1.6708, abs=1e-4)
    assert blended.added_acceleration == pytest.approx(246.74, abs=1e-2)
    assert blended.largest_step == 0.0


def _spec_and_settings(table: CorrectionTable, **more: Any) -> tuple[CorrectionSpec, AxisSettings]:
    chosen = plain_settings(**more)
    return spec_of_table(table, chosen), chosen


@given(tables(), COUNTS_PER_UNIT, st.lists(st.floats(-0.2, 1.2), min_size=2, max_size=8))
def test_the_place_of_the_target_before_need_not_be_worked_out_again(
    table: CorrectionTable, counts_per_unit: float, places: list[float]
) -> None:
    axis = axis_with(table, counts_per_unit, setpoints=Setpoints.STREAM, max_correction=1e6)
    for now_ns, estimate in enumerate(places):
        before, stood_at = axis.readback, axis.accepted
        nominal = round(counts_per_unit * (table.first + estimate * (table.last - table.first)))
        corrected = send(axis, nominal, now_ns=now_ns)
        if stood_at is None:
            continue
        solved = after_target(
            before,
            axis.readback.correction_map,
            Accepted(nominal, corrected),
            stood_at.corrected_counts,
            is_at_target=False,
        )
        for share in (0.0, 0.3, 0.7, 1.0):
            reading = stood_at.corrected_counts + share * (corrected - stood_at.corrected_counts)
            remembered = axis.readback.correction_counts(reading)
            assert remembered == pytest.approx(solved.correction_counts(reading), abs=1e-3)
