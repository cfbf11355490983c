import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.simulator.errors import SimulatorError
from gateway.simulator.mechanics import Encoder, Flank, Mechanics, Play
from gateway.simulator.motion import Dynamics, plan_motion, standstill
from gateway.simulator.screw import PeriodicError, Screw, Wear, worn_screw
from gateway.simulator.world import MOST_UM_PER_M


def test_progressive_error_grows_with_the_distance_from_zero() -> None:
    screw = Screw(progressive_um_per_m=-80.0)
    assert screw.deviation_mm(250.0) == pytest.approx(-0.020)  # -80 µm/m x 0.25 m
    assert screw.deviation_mm(-250.0) == pytest.approx(0.020)


def test_bow_is_highest_in_the_middle_and_zero_at_both_ends() -> None:
    screw = Screw(start_mm=-300.0, length_mm=300.0, bow_um=12.0)
    deviations = [screw.deviation_mm(x) for x in (-300.0, -225.0, -150.0, 0.0)]
    assert deviations == pytest.approx([0.0, 0.009, 0.012, 0.0])  # 12 x 4 x 0.25 x 0.75 = 9 µm


def test_periodic_error_repeats_with_the_lead() -> None:
    screw = Screw(periodic=(PeriodicError(4.0, period_mm=5.0, phase_turns=0.25),))
    deviations = [screw.deviation_mm(x) for x in (0.0, 1.25, 2.5, 3.75, 5.0)]
    assert deviations == pytest.approx([0.004, 0.0, -0.004, 0.0, 0.004])


def test_wear_is_a_local_dip() -> None:
    screw = Screw(wear=(Wear(centre_mm=100.0, width_mm=40.0, depth_um=-20.0),))
    deviations = [screw.deviation_mm(x) for x in (80.0, 90.0, 100.0, 110.0, 120.0, 121.0)]
    assert deviations == pytest.approx([0.0, -0.010, -0.020, -0.010, 0.0, 0.0])


def test_a_screw_that_folds_back_is_refused() -> None:
    with pytest.raises(SimulatorError, match=r"may change by 0\.628"):
        Screw(periodic=(PeriodicError(amplitude_um=100.0, period_mm=1.0),))  # 2 pi x 0.1 mm / 1 mm


@given(st.integers(0, 2**32))
def test_a_worn_screw_is_the_same_for_the_same_seed_and_worse_than_50_um(seed: int) -> None:
    screw, again = (worn_screw(random.Random(seed), -300.0, 300.0, 5.0) for _ in range(2))
    assert screw == again
    deviations = [screw.deviation_mm(float(x)) for x in range(-300, 1, 10)]
    assert max(deviations) - min(deviations) >= 0.050


@given(st.integers(0, 2**32), st.sampled_from((300.0, 500.0, 1000.0)))
def test_the_screw_of_a_desk_is_never_taken_for_a_wrong_scale(seed: int, length_mm: float) -> None:
    """`table build` refuses more than 0.3 mm/m as a wrong scale."""
    screw = worn_screw(random.Random(seed), -length_mm, length_mm, 5.0, most_um_per_m=MOST_UM_PER_M)
    places = [-length_mm + length_mm * number / 100 for number in range(101)]
    middle = sum(places) / len(places)
    deviations = [screw.deviation_mm(place) for place in places]
    slope = sum((x - middle) * y for x, y in zip(places, deviations, strict=True))
    slope /= sum((x - middle) ** 2 for x in places)
    assert abs(slope) < 0.0003


def test_the_nut_follows_only_after_the_play_is_taken_up() -> None:
    play = Play(0.030, at_mm=10.0, flank=Flank.FORWARD)
    assert play.follow(10.500) == pytest.approx(10.500)  # carried forward
    assert play.follow(10.480) == pytest.approx(10.500)  # 20 µm of 30 taken up
    assert play.follow(10.470) == pytest.approx(10.500)  # all of it, just
    assert play.follow(10.400) == pytest.approx(10.430)  # carried backward, 30 µm behind
    assert play.follow(10.425) == pytest.approx(10.430)  # turning round again: 25 of 30
    assert play.follow(10.440) == pytest.approx(10.440)


def test_the_side_that_carries_the_nut_at_the_start_is_known() -> None:
    assert Play(0.030, at_mm=5.0, flank=Flank.BACKWARD).nut_mm == pytest.approx(5.030)


@given(st.lists(st.floats(-100, 100), min_size=1), st.floats(0, 1))
def test_the_nut_never_leaves_the_play(path: list[float], width: float) -> None:
    play = Play(width)
    for driven in path:
        assert driven <= play.follow(driven) <= driven + width


def test_a_trapezoid_by_hand() -> None:
    # 100 mm at 50 mm/s and 100 mm/s²: 0.5 s over 12.5 mm up, 75 mm in 1.5 s, 0.5 s down.
    motion = plan_motion(0.0, 0.0, 100.0, 10.0, Dynamics(50.0, 100.0))
    assert motion.end_s == pytest.approx(12.5)
    positions = [motion.position_mm(t) for t in (10.0, 10.5, 11.0, 12.0, 12.25, 12.5, 99.0)]
    assert positions == pytest.approx([0.0, 12.5, 37.5, 87.5, 96.875, 100.0, 100.0])
    assert motion.speed_mm_s(12.25) == pytest.approx(25.0)


def test_a_short_move_never_reaches_full_speed() -> None:
    # Peak speed sqrt(100 x 1) = 10 mm/s, 0.1 s each way.
    motion = plan_motion(0.0, 0.0, -1.0, 0.0, Dynamics(50.0, 100.0))
    assert motion.end_s == pytest.approx(0.2)
    assert motion.speed_mm_s(0.1) == pytest.approx(-10.0)


def test_a_new_target_behind_brakes_first_and_turns_round() -> None:
    # At 20 mm/s with 100 mm/s² the axis needs 2 mm and 0.2 s to stop, then turns round at 12 mm.
    motion = plan_motion(10.0, 20.0, 5.0, 0.0, Dynamics(50.0, 100.0))
    assert motion.position_mm(0.2) == pytest.approx(12.0)
    assert motion.turning_points_mm(0.0, 1.0) == pytest.approx([12.0])
    assert motion.position_mm(motion.end_s) == 5.0


@given(st.floats(-500, 500), st.floats(-50, 50), st.floats(-500, 500), st.floats(1, 50), st.floats(10, 5000))
def test_a_move_is_continuous_and_ends_at_its_target(
    start: float, speed: float, target: float, limit: float, acceleration: float
) -> None:
    motion = plan_motion(start, speed, target, 0.0, Dynamics(limit, acceleration))
    fastest = max(limit, abs(speed))
    assert motion.position_mm(motion.end_s) == target
    steps = [motion.position_mm(motion.end_s * i / 200) for i in range(201)]
    longest = max(abs(b - a) for a, b in pairwise(steps))
    assert longest <= fastest * motion.end_s / 200 + 1e-6


def test_an_axis_at_rest_stays() -> None:
    assert plan_motion(3.0, 0.0, 3.0, 1.0, Dynamics(10.0, 10.0)) == standstill(3.0, 1.0)


def machine(backlash_mm: float = 0.040) -> Mechanics:
    return Mechanics(
        Screw(progressive_um_per_m=100.0),
        Encoder(counts_per_mm=-1000.0, zero_counts=500.0),
        backlash_mm=backlash_mm,
        dynamics=Dynamics(50.0, 100.0),
    )


def test_a_commanded_axis_arrives_with_its_pitch_error_and_exact_counts() -> None:
    axis = machine()
    axis.command(500.0 - 100_000.0, 0.0)  # 100 mm, counted backwards
    assert axis.is_moving
    axis.advance(2.5)
    assert axis.is_done
    assert axis.actual_counts == -99_500.0
    assert axis.nut_mm == pytest.approx(100.010)  # 100 mm x 100 µm/m


def test_lost_motion_shows_after_a_reversal() -> None:
    axis = machine()
    axis.command(500.0 - 100_000.0, 0.0)
    axis.command(500.0 - 90_000.0, 5.0)
    axis.advance(10.0)
    assert axis.nut_mm == pytest.approx(90.009 + 0.040)


def test_the_play_sees_a_turning_point_between_two_looks() -> None:
    axis = machine()
    axis.command(500.0 - 100_000.0, 0.0)
    axis.advance(1.0)  # 37.5 mm, full speed of 50 mm/s: it stops 12.5 mm further, at 50 mm
    axis.command(500.0 - 50_000.0 + 30.0, 1.0)  # 49.970 mm: 30 µm back from the furthest point
    axis.advance(100.0)
    # Had the play not seen 50 mm, the nut would stand at 49.970 + its error; it was left at 50.005.
    assert axis.nut_mm == pytest.approx(50.005)


def test_the_same_target_again_does_not_disturb_a_move() -> None:
    axis = machine()
    axis.command(500.0 - 100_000.0, 0.0)
    axis.command(500.0 - 100_000.0, 1.0)
    axis.advance(2.5)
    assert axis.is_done


def test_stop_brakes_and_makes_the_stopping_place_the_target() -> None:
    axis = machine()
    axis.command(500.0 - 100_000.0, 0.0)
    axis.stop(1.0)
    axis.advance(1.5)
    assert axis.is_done
    assert axis.actual_counts == pytest.approx(500.0 - 50_000.0)


def test_time_does_not_go_back() -> None:
    axis = machine()
    axis.command(500.0 - 100_000.0, 0.0)
    axis.advance(1.0)
    before = axis.actual_counts
    axis.advance(0.5)
    assert axis.actual_counts == before


def test_an_alarmed_axis_takes_no_command() -> None:
    axis = machine()
    axis.alarm = True
    axis.command(1000.0, 0.0)
    assert not axis.is_moving
    assert not axis.is_done
