"""Where another reading brings most, and when to stop."""

from dataclasses import replace
from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.units import Units
from gateway.metrology.build import Fit
from gateway.metrology.next_reading import Advice, advice_of
from gateway.metrology.recipe import Recipe, build_from, from_one_zero
from gateway.metrology.residue import LeftOut
from gateway.metrology.standard import Grade
from tests.metrology import screws, walks
from tests.metrology.test_band import ON_THE_LINE, SIGMA, line, screw

LEFT = LeftOut(0.010, 0.005, 0.020)


def test_a_straight_line_gains_most_at_its_ends_and_as_much_as_by_the_textbooks() -> None:
    found = advice_of(screw(line()), ON_THE_LINE, LEFT)
    assert found is not None
    # What is left of a line is its slope, known to σ² / Σ (x - mean)². Five values at 0 to 400 mm sum up to
    # 100 000; one more at 50 or 350, 150 mm from their mean, adds 150² * 5 / 6 = 18 750.
    assert found.at in (50.0, 350.0)
    assert found.e == 0.010
    assert found.e_then / found.e == pytest.approx(sqrt(100_000 / 118_750), abs=0.05)
    # One in each gap: 2 * 150² + 2 * 50² more.
    assert found.gaps == 4
    assert found.e_filled / found.e == pytest.approx(sqrt(100_000 / 150_000), abs=0.05)
    # The line is known by values to σ in one direction: in both, each is σ * sqrt(2).
    assert found.noise == pytest.approx(SIGMA * sqrt(2))


def test_nothing_is_advised_where_the_readings_do_not_tell_what_is_left() -> None:
    unsettled = LeftOut(None, 0.0, None, (), "run 3 lies apart")
    assert advice_of(screw(line()), ON_THE_LINE, unsettled) is None
    # The targets hide a turn: nothing may be called enough.
    assert advice_of(screw(line()), ON_THE_LINE, LeftOut(None, 0.001, None)) is None
    assert advice_of(screw(line()), ON_THE_LINE, None) is None
    assert advice_of(replace(screw(line()), scatter=None), ON_THE_LINE, LEFT) is None


WORTH = Advice(Units.MM, 187.5, 0.0, 0.0115, 0.0072, 0.0004, 16, 0.0051)


@pytest.mark.parametrize(
    ("advice", "do", "words"),
    [
        (
            replace(WORTH, reach=50.0),
            "next",
            (
                "measure next at 187.5 to 237.5 mm: there another placement takes most of E, "
                "from 11.50 µm to 7.20 µm"
            ),
        ),
        (
            replace(WORTH, e_then=0.0112),
            "every-gap",
            (
                "measure in the middle of every gap: 16 more readings take E from 11.50 µm to 5.10 µm. "
                "A single one brings less than the gauge's own noise of 0.40 µm"
            ),
        ),
        (
            replace(WORTH, e_then=0.0114, e_filled=0.0112),
            "stop",
            (
                "stop: another reading brings less than the gauge's own noise of 0.40 µm (the best one, "
                "at 187.5 mm, takes E from 11.50 µm to 11.40 µm: a curve as smooth as this gains little)"
            ),
        ),
    ],
)
def test_the_advice_is_one_of_three(advice: Advice, do: str, words: str) -> None:
    assert advice.describe() == words
    assert advice.as_data()["do"] == do
    assert advice.as_data()["e_um"] == pytest.approx(11.5)


def test_what_the_targets_hide_is_not_in_the_figures_of_the_advice() -> None:
    assert (
        replace(WORTH, is_part=True)
        .describe()
        .endswith("from 11.50 µm to 7.20 µm (of what the targets show)")
    )


@given(*(st.floats(0.0, 1.0) for _ in range(4)), st.sampled_from(list(Units)))
def test_it_says_stop_only_if_neither_one_reading_nor_many_bring_more_than_the_noise(
    e: float, then: float, filled: float, noise: float, units: Units
) -> None:
    advice = Advice(units, 1.0, 0.0, e, then, noise, 3, filled)
    brings = max(e - then, e - filled)
    assert advice.describe().startswith("stop:") is (brings < noise)
    assert (advice.as_data()["do"] == "next") is (e - then >= noise)


def test_of_a_dip_that_the_targets_hardly_show_the_readings_beside_it_are_advised() -> None:
    """13 targets of a wave of 130 mm; the reading that is advised takes E down in truth too."""
    [kind] = [each for each in screws.KINDS if each.name == "slow waves, irregular targets"]
    made, random = screws.screw_of(kind, 1)
    survey = made.survey(screws.targets_of(kind, kind.few, 1), kind.noise_um, random)
    left = []
    for _ in range(2):
        built = screws.built(survey, kind, Fit.AUTO)
        assert built.screw is not None
        advice = advice_of(built.screw, built.table, built.screw.left_out(built.table))
        assert advice is not None
        left.append((made.leaves_um(built.table, 0.0, kind.length), advice))
        more = made.survey([advice.at], kind.noise_um, random)
        survey = replace(survey, readings=(*survey.readings, *more.readings))
    (before, first), (after, second) = left
    assert first.is_worth_it
    assert after < before
    assert second.e < first.e


def test_another_placement_of_the_same_block_does_not_make_its_length_better_known() -> None:
    """A dial that scatters by 0.05 µm and a block of grade 2: what is left is the length of the block.

    By more placements as of other blocks, E would go down with the root of their number: by a third if it is
    doubled.
    """
    kind = walks.kinds()[0]
    made, random = screws.screw_of(kind, 2)
    exact = walks.SetUp(12, grade=Grade.TWO, scatter_um=0.05, seat_um=0.0, digit_um=0.01, dial_error_um=0.0)
    survey, curves = from_one_zero(walks.measured(made, exact, random, 2), kind.periods)
    built = build_from(survey, Recipe(fit=Fit.AUTO, periods=kind.periods), curves)
    assert built.screw is not None
    advice = advice_of(built.screw, built.table, built.screw.left_out(built.table))
    assert advice is not None
    assert advice.reach == pytest.approx(walks.BLOCK, abs=5.0)
    assert advice.e_filled > 0.9 * advice.e
