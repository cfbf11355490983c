"""What is said about the places between the targets: curves, harmonics, and what a table leaves there."""

from collections.abc import Sequence
from math import pi, sin
from random import Random

import numpy as np
import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.build import Fit, HomeCase, Shape
from gateway.metrology.cycle import random_targets
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import (
    Period,
    aliased_warning,
    is_aliased,
    lead_warnings,
    may_be_more,
    periods_of,
    shown_by,
    unseen,
)
from gateway.metrology.process import ANALYTIC, CurveKind, Samples, fitted
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.screw import screw_of
from gateway.tabfile import WriteOptions, dialect_named
from tests.metrology import screws
from tests.soak import IS_FULL

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
SEEDS = (0, 1) if IS_FULL else (0,)


def survey(targets: list[float], deviation: screws.Curve, lost: float = 0.01, runs: int = 1) -> Survey:
    return Survey(
        tuple(
            Reading(x, way, x + deviation(x) - way.value * lost / 2, run)
            for run in range(1, runs + 1)
            for way in (UP, DOWN)
            for x in targets
        ),
        Units.MM,
    )


RANDOM_TARGETS = [float(x) for x in random_targets(0.0, 300.0, 31, seed=3, spread=5.0)]


@pytest.mark.parametrize(
    ("step", "period", "aliased"),
    [
        (10.0, 5.0, True),  # two turns
        (25.0, 5.0, True),
        (25.0, 25.0, True),
        (10.2, 5.0, True),  # 2.04 turns: the angle drifts by 14° a target, a wave of 250 mm
        (12.0, 5.0, False),  # 2.4 turns
        (0.625, 5.0, False),  # an eighth of a turn
        (4.9, 5.0, True),  # 0.98 of a turn
    ],
)
def test_a_period_is_aliased_where_targets_lie_whole_turns_apart(
    step: float, period: float, aliased: bool
) -> None:
    assert is_aliased([step * index for index in range(13)], period) is aliased


def test_random_targets_over_a_lead_show_it_and_a_fine_run_of_two_turns_does_beside_a_grid() -> None:
    assert not is_aliased(RANDOM_TARGETS, 5.0)
    grid = [10.0 * index for index in range(31)]
    fine = [150 + 0.625 * index for index in range(17)]
    assert is_aliased(grid, 5.0)
    assert not is_aliased(sorted({*grid, *fine}), 5.0)


def test_the_warning_names_what_to_measure() -> None:
    targets = [10.0 * index for index in range(31)]
    _, aliased = shown_by(targets, periods_of(5.0))
    assert [each.name for each in aliased] == ["lead 5", "half of lead 5"]
    said = aliased_warning(targets, aliased, "mm")
    # Two turns of 5 mm from the middle target, in eighths of a turn.
    assert "the targets are 10 mm apart, a multiple, or near one, of lead 5 and half of lead 5" in said
    assert "--from 150 --to 160 --step 0.625" in said
    assert "--spread 5" in said
    (told,) = lead_warnings(targets, (), Units.MM)
    assert "the targets are 10 mm apart: an error that repeats every 10, 5, 3.33333… mm" in told
    assert lead_warnings(RANDOM_TARGETS, (), Units.MM) == []


def test_an_even_grid_may_show_a_turn_as_a_slower_wave() -> None:
    """A step of 6 mm is 1.2 turns of 5 mm: the angle comes back after five steps, a wave of 30 mm."""
    targets = [6.0 * index for index in range(67)]
    assert not is_aliased(targets, 5.0)
    (said,) = lead_warnings(targets, [Period(5.0, "lead 5")], Units.MM)
    assert "lead 5 like one of 30 mm" in said
    assert "--spread 5" in said
    step = "the step of 6 and its whole fractions"
    assert [each.name for each in unseen(targets, periods_of(5.0), Units.MM)] == ["lead 5", step]
    # 7 mm are 1.4 turns of 5 and 2.8 of 2.5: the second looks like a wave of five steps.
    assert [
        each.name for each in unseen([7.0 * index for index in range(50)], periods_of(5.0), Units.MM)
    ] == ["half of lead 5", "the step of 7 and its whole fractions"]
    # Steps of a quarter turn, and random targets, leave nothing open.
    assert unseen([0.625 * index for index in range(50)], periods_of(5.0), Units.MM) == ()
    assert unseen(RANDOM_TARGETS, periods_of(5.0), Units.MM) == ()


def test_targets_beside_an_even_grid_are_one_too() -> None:
    """Stops up to 0.2 mm beside a grid of 20 mm, as a DRO shows them: a turn of 5 mm does not show."""
    beside = (0.1, -0.2, 0.0, 0.15, -0.1, 0.2, -0.05, 0.05)
    targets = [20.0 * index + beside[index % 8] for index in range(17)]
    assert [each.length for each in unseen(targets, periods_of(5.0), Units.MM)][:2] == [5.0, 2.5]
    (hidden,) = unseen(targets, (), Units.MM)
    assert hidden.length == pytest.approx(20.0, abs=0.02)
    assert "about 20 mm apart" in lead_warnings(targets, (), Units.MM)[0]
    # The same beside a grid of 6 mm, of which one target is missing.
    slow = [6.0 * index + beside[index % 8] for index in range(40) if index != 7]
    assert [each.name for each in unseen(slow, periods_of(5.0), Units.MM)][:1] == ["lead 5"]


@pytest.mark.parametrize("lead", [None, 40.0, 100.0])
def test_an_even_grid_names_its_step_whatever_lead_is_told(lead: float | None) -> None:
    """A motor that turns once in 10 mm behind a lead of 40: targets 10 mm apart see nothing of its 8 µm."""
    targets = [10.0 * index for index in range(41)]
    hidden = unseen(targets, periods_of(lead), Units.MM)
    assert "the step of 10 and its whole fractions" in [each.name for each in hidden]
    error = screws.total(screws.wave(8, 10, 1.0), screws.wave(10, 450, 0.3))
    built = build_from(survey(targets, error), Recipe(fit=Fit.AUTO, periods=periods_of(lead)))
    assert built.screw is not None
    left_out = built.screw.left_out(built.table)
    assert (left_out.e, left_out.high) == (None, None)
    assert "the step of 10" in left_out.unknown
    (said,) = lead_warnings(targets, periods_of(lead), Units.MM)
    assert "--spread" in said


def test_two_opposite_angles_of_a_turn_do_not_show_it() -> None:
    targets = [10.0 * index for index in range(41)]
    first, *_ = unseen(targets, periods_of(40.0), Units.MM)
    assert first.name == "half of lead 40"


@pytest.mark.parametrize("spread", [2.0, 4.5])
def test_random_targets_that_leave_a_turn_as_long_as_their_step_half_hidden_are_near_a_grid(
    spread: float,
) -> None:
    """21 targets 20 mm apart, on a lead of 20 mm that nobody told: 4.5 mm are no quarter of a turn."""
    near = [float(x) for x in random_targets(0.0, 400.0, 21, seed=0, spread=spread)]
    assert len(unseen(near, (), Units.MM)) == 1
    assert unseen(near, periods_of(5.0), Units.MM) == ()
    assert [each.length for each in unseen(near, periods_of(20.0), Units.MM)][:1] == [20.0]
    wide = [float(x) for x in random_targets(0.0, 400.0, 21, seed=0, spread=9.0)]
    assert unseen(wide, (), Units.MM) == ()


def test_the_upper_bound_holds_a_turn_as_long_as_the_step_where_no_lead_is_told() -> None:
    """81 targets 5 mm apart, moved by up to 1.5 mm as usual, on a screw of the lead 5 mm."""
    kind = next(each for each in screws.KINDS if "issue, lead not told" in each.name)
    screw, random = screws.screw_of(kind, 0)
    targets = [float(x) for x in random_targets(0.0, 400.0, 81, seed=0)]
    chosen = screws.built(screw.survey(targets, 0.4, random), kind, Fit.AUTO)
    assert chosen.screw is not None
    left_out = chosen.screw.left_out(chosen.table)
    assert left_out.e is not None
    assert left_out.high is not None
    true = screw.leaves_um(chosen.table, targets[0], targets[-1]) / 1000
    # Half of the turn is seen: the figure is too small, the bound is not.
    assert 1.5 * left_out.e < true < left_out.high
    assert may_be_more(targets, periods_of(5.0), Units.MM) == 1.0
    # A mean vector of 0.86 leaves the square root of 1 - 0.74 to be seen.
    assert may_be_more(targets, (), Units.MM) == pytest.approx(2.0, abs=0.3)


def test_a_grid_too_fine_for_any_screw_hides_nothing_though_no_lead_is_told() -> None:
    """On steps of 1.5 mm only turns of 2 mm and less look like a wave of four steps and more."""
    assert unseen([1.5 * index for index in range(50)], (), Units.MM) == ()
    assert len(unseen([1.6 * index for index in range(50)], (), Units.MM)) == 1
    assert unseen([0.059 * index for index in range(50)], (), Units.INCH) == ()
    assert len(unseen([0.06 * index for index in range(50)], (), Units.INCH)) == 1
    # An angle says nothing of that kind.
    assert len(unseen([0.5 * index for index in range(50)], (), Units.DEGREE)) == 1


@pytest.mark.parametrize("step", [5.0, 10.0])
def test_a_fine_run_of_two_turns_shows_the_turn_beside_however_long_a_grid(step: float) -> None:
    targets = sorted({*(step * index for index in range(201)), *(500 + 0.625 * index for index in range(17))})
    assert not is_aliased(targets, 5.0)
    assert unseen(targets, periods_of(5.0), Units.MM) == ()


@pytest.mark.parametrize("step", [20.0, 6.0, 5.0])
def test_what_a_grid_hides_makes_the_prediction_unknown(step: float) -> None:
    """The error of the issue comes and goes along the screw; of steps of 20 mm 0.5 µm would be said."""
    kind = next(each for each in screws.KINDS if "lead 5 told" in each.name)
    screw = screws.screw_of(kind, 2)[0]
    targets = [step * index for index in range(int(400 / step) + 1)]
    chosen = screws.built(screw.survey(targets, 0.4, Random(2)), kind, Fit.AUTO)
    assert chosen.screw is not None
    left_out = chosen.screw.left_out(chosen.table)
    assert (left_out.e, left_out.high) == (None, None)
    assert 0 < left_out.low < screw.leaves_um(chosen.table, 0.0, targets[-1]) / 1000
    assert "lead 5" in [each.name for each in left_out.unseen]
    assert left_out.unknown.startswith(
        "not known from these readings: their targets cannot separate an error that repeats"
    )


@pytest.mark.parametrize("lead", [0.0, -5.0, float("nan"), float("inf")])
def test_a_lead_that_is_no_length_is_refused(lead: float) -> None:
    with pytest.raises(ReadingsError, match=r"lead .*: it must be a length above 0"):
        periods_of(lead)


def test_a_harmonic_has_the_amplitude_and_the_phase_that_the_screw_has() -> None:
    found = screw_of(
        survey(RANDOM_TARGETS, lambda x: 0.003 * sin(2 * pi * x / 5 + pi / 3)).readings,
        Units.MM,
        periods_of(5.0),
    )
    once, twice = found.harmonics
    assert once.amplitude == pytest.approx(0.003, rel=0.01)
    assert once.phase_deg == pytest.approx(60.0, abs=1.0)
    assert once.significance is not None
    assert once.significance < 1e-6
    assert twice.amplitude is not None
    assert twice.amplitude < 0.0001


@pytest.mark.parametrize(
    ("step", "periods", "known"),
    [
        # at 0°, 180°, 360° of lead 40: its cosine, and of its half one angle
        (20.0, periods_of(40.0), [None]),
        # of lead 40 four angles, of its half two
        (10.0, periods_of(40.0), [0.003, None]),
        # 3/4 of a turn on, of 13.333, is 1/4 of a turn back, of 40
        (10.0, periods_of(40.0, [40 / 3]), [None, None, None]),
        # half a turn on, and one and a half
        (10.0, periods_of(20.0, [20 / 3]), [None, None]),
    ],
)
def test_a_harmonic_that_even_targets_show_in_part_or_as_another_has_no_amplitude(
    step: float, periods: tuple[Period, ...], known: list[float | None]
) -> None:
    targets = [step * number for number in range(31)]
    readings = survey(targets, lambda x: 0.003 * sin(2 * pi * x / 40 + pi / 3), runs=3)
    built = build_from(readings, Recipe(fit=Fit.AUTO, periods=periods))
    assert built.screw is not None
    found = built.screw.harmonics
    for harmonic, amplitude in zip(found, known, strict=True):
        assert harmonic.amplitude == (None if amplitude is None else pytest.approx(amplitude, rel=0.01))
        is_said = any(note.startswith(f"{harmonic.period.name}: its size is unknown") for note in built.notes)
        assert is_said == (amplitude is None)


def test_harmonics_of_nothing_but_scatter_are_not_significant() -> None:
    random = Random(1)
    scattered = tuple(
        Reading(x, way, x + random.gauss(0, 0.0005), run)
        for run in range(1, 6)
        for way in (UP, DOWN)
        for x in RANDOM_TARGETS
    )
    found = screw_of(scattered, Units.MM, periods_of(5.0))
    assert not any(each.is_significant for each in found.harmonics)
    assert None not in [each.significance for each in found.harmonics]


def test_leaving_out_in_closed_form_is_leaving_out() -> None:
    """Each sample predicted by solving the system of all others, with the same sizes of the curve."""
    positions = np.array([0.0, 11.0, 19.0, 32.0, 40.0, 53.0, 60.0])
    values = np.array([0.0, 0.004, 0.003, -0.002, -0.001, 0.005, 0.006])
    process = fitted(Samples(positions, values, np.full(7, 1e-7)), CurveKind(ANALYTIC, has_short=True))
    missed, expected = process.left_out()
    covariance = np.linalg.inv(process._inverse)
    rest = values - process._straight(positions)
    for index in range(7):
        others = [other for other in range(7) if other != index]
        weights = np.linalg.solve(covariance[np.ix_(others, others)], covariance[others, index])
        assert missed[index] == pytest.approx(rest[index] - weights @ rest[others], rel=1e-4, abs=1e-12)
        variance = covariance[index, index] - weights @ covariance[others, index]
        assert expected[index] == pytest.approx(variance, rel=1e-4)


def test_left_out_targets_are_missed_by_lines_as_by_hand() -> None:
    # Deviations 0 0 6 0 0 µm, no lost motion: the lines over the inner targets miss by 3, 6 and 3 µm.
    heights = {0.0: 0.0, 10.0: 0.0, 20.0: 0.006, 30.0: 0.0, 40.0: 0.0}
    found = screw_of(survey(list(heights), heights.__getitem__, lost=0.0).readings, Units.MM)
    assert found.misses(Shape.LINES) == pytest.approx(((9 + 36 + 9) / 3) ** 0.5 / 1000)


def test_few_targets_stay_in_the_table_as_they_were_read() -> None:
    six = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]
    built = build_from(survey(six, lambda x: 0.003 * sin(x / 7)), Recipe(fit=Fit.AUTO))
    assert built.evidence is not None
    assert built.evidence.chosen.shape is Shape.LINES
    assert list(built.table.positions) == six
    four = build_from(survey(six[:4], lambda x: 0.003 * sin(x / 7)), Recipe(fit=Fit.AUTO))
    assert four.screw is None
    assert any("4 targets" in note and "is unknown" in note for note in four.notes)


def test_points_lie_where_the_nut_stood_where_that_matters() -> None:
    """A scale that is wrong by 1 mm/m with a turn of 5 mm on it, sent to 0, 10, … 60."""
    targets = [10.0 * index for index in range(7)]
    heights = dict(zip(targets, (0.0, 0.012, 0.018, 0.033, 0.038, 0.052, 0.060), strict=True))
    recipe = Recipe(HomeCase.SWITCH_POSITIVE, fit=Fit.LINES)
    built = build_from(survey(targets, heights.__getitem__, lost=0.0), recipe)
    assert built.evidence is not None
    assert built.evidence.chosen.at_nut
    # Sent to 30 it stood at 30.033: to get there it has to be sent 0.033 less far.
    assert built.table.positions[3] == pytest.approx(30.033)
    assert built.table.forward[3] == pytest.approx(-0.033)
    flat = build_from(survey(targets, lambda x: heights[x] / 100, lost=0.0), recipe)
    assert list(flat.table.positions) == targets


def test_a_format_of_few_points_says_what_it_costs() -> None:
    kind = next(each for each in screws.KINDS if "lead 5 told" in each.name)
    screw, random = screws.screw_of(kind, 0)
    readings = screw.survey(screws.targets_of(kind, 81, 0), 0.4, random)
    held = dialect_named("linuxcnc-0")

    def refusal(table: CorrectionTable) -> str | None:
        return None if len(table.positions) <= 100 else "a hundred points at most"

    built = build_from(readings, Recipe(fit=Fit.AUTO, periods=kind.periods, refusal=refusal))
    assert built.evidence is not None
    assert built.evidence.unheld is not None
    assert len(built.table.positions) <= 100
    assert held.write(built.table, WriteOptions()).text
    assert any("but cannot be written: a hundred points at most" in note for note in built.notes)


def test_harmonics_that_were_not_seen_are_not_made_up() -> None:
    grid = [10.0 * index for index in range(31)]
    aliased = survey(grid, lambda x: 0.003 * sin(2 * pi * x / 5 + 1))
    with pytest.raises(ReadingsError, match=r"harmonics: nothing to fit: the targets are 10 mm apart"):
        build_from(aliased, Recipe(fit=Fit.HARMONICS, periods=periods_of(5.0)))
    with pytest.raises(ReadingsError, match="give the lead"):
        build_from(aliased, Recipe(fit=Fit.HARMONICS))
    built = build_from(aliased, Recipe(fit=Fit.AUTO, periods=periods_of(5.0)))
    assert built.evidence is not None
    assert built.evidence.chosen.shape is not Shape.HARMONICS
    assert any("(aliasing)" in note for note in built.notes)


def test_a_fine_run_beside_an_even_grid_brings_the_turn_out() -> None:
    grid, fine = [10.0 * index for index in range(31)], [150 + 0.625 * index for index in range(17)]
    error = screws.total(screws.wave(3, 5, 1.0), screws.wave(10, 400, 0.3))
    built = build_from(survey(sorted({*grid, *fine}), error), Recipe(fit=Fit.AUTO, periods=periods_of(5.0)))
    assert built.evidence is not None
    assert built.evidence.chosen.shape is Shape.HARMONICS
    kind = screws.CurveKind("fine", 300, lambda _: (error, screws.constant(10)), 2, 2, 0)
    left = screws.Screw(kind, error, screws.constant(10)).leaves_um(built.table, 0.0, 300.0)
    # Of the 6 µm of a turn hardly anything: the grid alone leaves all of it.
    assert left < 0.6


def test_what_any_table_leaves_is_judged_alike() -> None:
    found = screw_of(survey(RANDOM_TARGETS, lambda x: 20e-6 * x, lost=0.0).readings, Units.MM)
    low, high = RANDOM_TARGETS[0], RANDOM_TARGETS[-1]
    nothing = make_table([low, high], [0.0, 0.0], [0.0, 0.0], Units.MM)
    right = make_table([low, high], [-20e-6 * low, -20e-6 * high], [-20e-6 * low, -20e-6 * high], Units.MM)
    assert found.leaves(nothing) == pytest.approx(20e-6 * (high - low), rel=0.01)
    assert found.leaves(right) < 0.0001


def joints(name: str, count: int, noise_um: float) -> list[float | None]:
    kind = next(each for each in screws.KINDS if each.name == name)
    found = []
    for seed in range(3):
        screw, random = screws.screw_of(kind, seed)
        readings = screw.survey(screws.targets_of(kind, count, seed), noise_um, random).readings
        found.append(screw_of(readings, Units.MM).smooth.kind.joint)
    return found


@pytest.mark.parametrize(("count", "noise_um", "within"), [(16, 0.0, 1.0), (51, 0.0, 0.5), (51, 0.6, 12.0)])
def test_a_joint_of_two_screws_is_found_where_it_is(count: int, noise_um: float, within: float) -> None:
    assert joints("jointed", count, noise_um) == pytest.approx([260.0] * 3, abs=within)


@pytest.mark.parametrize(
    "name", ["straight, 30 µm a metre", "slow waves, even targets", "worn in the middle"]
)
def test_no_joint_is_made_up_where_there_is_none(name: str) -> None:
    assert joints(name, 41, 0.5) == [None] * 3


def racks(phases: Sequence[float]) -> tuple[screws.Curve, screws.Curve]:
    """Two racks: the error jumps by 12 µm where they are butted."""
    waves = screws.total(screws.wave(8, 420, phases[0]), screws.wave(3, 170, phases[1]))
    return screws.total(waves, lambda x: np.where(x < 437.3, 0.0, 0.012)), screws.constant(8)


RACKS = screws.CurveKind("two racks", 1000, racks, 21, 61, 0.4)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("count", [RACKS.few, RACKS.many])
def test_the_upper_bound_holds_a_jump_between_two_targets(count: int, seed: int) -> None:
    found = screws.case(RACKS, count, RACKS.noise_um, seed)
    # A straight line from one target to the other leaves all of the jump.
    assert found.true > 11.5
    assert found.is_within
    assert found.high is None or found.high > 12


def test_the_place_of_a_jump_is_named_with_what_to_measure() -> None:
    screw, random = screws.screw_of(RACKS, 1)
    targets = screws.targets_of(RACKS, RACKS.many, 1)
    made = screws.built(screw.survey(targets, RACKS.noise_um, random), RACKS, Fit.AUTO)
    assert made.screw is not None
    [jump] = made.screw.jumps
    assert jump.low == max(target for target in targets if target < 437.3)
    assert jump.high == min(target for target in targets if target > 437.3)
    assert jump.size == pytest.approx(0.012, abs=0.001)
    [said] = [note for note in made.notes if "error jumps" in note]
    assert said.startswith(f"measure finely between {jump.low:.9g} and {jump.high:.9g} mm, with --from ")
    assert "The error jumps there by 1" in said
    assert f"--from {jump.low:.9g} --to {jump.high:.9g} --step " in said


@pytest.mark.parametrize("name", ["slow waves, irregular targets", "of the issue, lead not told"])
def test_no_jump_is_made_up_where_there_is_none(name: str) -> None:
    [kind] = [each for each in screws.KINDS if each.name == name]
    screw, random = screws.screw_of(kind, 1)
    survey = screw.survey(screws.targets_of(kind, kind.few, 1), kind.noise_um, random)
    made = screws.built(survey, kind, Fit.AUTO)
    assert made.screw is not None
    assert made.screw.jumps == ()


def test_even_targets_cannot_tell_two_screws_apart_of_which_a_table_leaves_different_amounts() -> None:
    """Why no estimator can be near on all of them: a wave of 61.3 mm reads as one of 130 mm every 41.7 mm."""
    kind = next(each for each in screws.KINDS if each.is_even)
    targets = screws.targets_of(kind, 13, 0)
    alias = 1 / (1 / targets[1] - 1 / 130)
    slow, lost = screws.wave(20, 350, 1.0), screws.constant(10)
    screw = screws.Screw(kind, screws.total(slow, screws.wave(4, 130, 2.0)), lost)
    twin = screws.Screw(kind, screws.total(slow, screws.wave(-4, alias, -2.0)), lost)
    assert [twin.error(x) for x in targets] == pytest.approx([screw.error(x) for x in targets], abs=1e-12)
    table = screws.built(screw.survey(targets, 0.0, Random(0)), kind, Fit.AUTO).table
    assert screw.leaves_um(table, 0.0, 500.0) < 1.0
    assert twin.leaves_um(table, 0.0, 500.0) > 12.0


def test_drift_is_no_scatter() -> None:
    """Each run is shifted and longer than the one before; what a reading scatters by is what it was."""
    kind = next(each for each in screws.KINDS if each.name.startswith("straight"))
    screw, random = screws.screw_of(kind, 0)
    warming = screws.Drifting(kind, screw.error, screw.lost)
    found = screw_of(warming.survey(screws.targets_of(kind, 41, 0), 0.4, random).readings, Units.MM)
    assert found.scatter == pytest.approx(0.0004, rel=0.15)


def test_the_bounds_of_a_prediction_hold_it_and_lie_a_factor_apart() -> None:
    found = screw_of(survey(RANDOM_TARGETS, lambda x: 0.003 * sin(x / 40)).readings, Units.MM)
    nothing = make_table([0.0, 300.0], [0.0, 0.0], [0.0, 0.0], Units.MM)
    left_out = found.left_out(nothing)
    assert left_out.e is not None
    assert left_out.high is not None
    assert left_out.e == found.leaves(nothing)
    assert left_out.low <= left_out.e / 1.5
    assert left_out.high >= left_out.e * 1.5


@pytest.mark.parametrize("seed", [5, 16, 34])
def test_the_upper_bound_does_not_hang_on_the_kind_that_few_targets_choose_by_luck(seed: int) -> None:
    """21 targets of a screw whose turn comes and goes: one that is the same all along explains them as well.

    6 to 9 µm were left where the bound was 5 to 6.6.
    """
    kind = next(each for each in screws.KINDS if "lead 5 told" in each.name and not each.is_even)
    assert screws.case(kind, 21, kind.noise_um, seed).is_below


@pytest.mark.parametrize("kind", screws.KINDS, ids=lambda kind: kind.name)
def test_a_table_leaves_what_it_says_and_no_more_than_the_best(kind: screws.CurveKind) -> None:
    found = [
        screws.case(kind, count, kind.noise_um, seed) for count in (kind.few, kind.many) for seed in SEEDS
    ]
    sys_out = [screws.row([each]) for each in found]
    print("\n".join(sys_out))  # noqa: T201
    assert all(each.is_good for each in found)
    assert sum(each.is_within for each in found) >= len(found) - 1
    told = [each for each in found if each.predicted is not None]
    # A step between two targets has a bound; how near the figure is the place of the step decides.
    assert "butt joint" in kind.name or sum(each.is_near for each in told) >= len(told) - 1
    # At even targets, where no lead is told or the lead is hidden, there is no figure; nor where few random
    # ones happen to lie near a grid.
    if kind.is_even and kind.length > 200:
        assert told == []
    else:
        assert len(told) >= len(found) - 1
