"""Differences over a gauge block become a curve: by hand, by another way to compute it, and on screws."""

from collections.abc import Callable
from dataclasses import replace
from math import inf, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.build import Fit
from gateway.metrology.differences import Joined, Slip, joined
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.process import CurveKind, Samples, Shared, fitted
from gateway.metrology.readings import Reading, Survey, merged, understood
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.standard import Grade, Standard, standard_of
from gateway.metrology.walk import Walk, hidden
from tests.metrology import walks
from tests.soak import IS_FULL

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
LEAD = periods_of(5.0)
Error = Callable[[float], float]


def walk(
    error: Error,
    *,
    standard: Standard | None = None,
    block: float = 50.0,
    actual: float = 0.0,
    lost: float = 0.010,
    ways: tuple[Direction, ...] = (UP, DOWN),
    closes: bool = False,
    count: int = 14,
) -> Survey:
    """Return what a dial of 0.1 µm reads over a block that is ``actual`` mm longer than it says."""
    planned = Walk(0.0, 300.0, block, count, 6.0, closes=closes).placed(Units.MM)
    sign = -1.0 if closes else 1.0
    readings = []
    for each in planned:
        for way in ways:
            for x, length in [(x, 0.0) for x in each.bare] + [(x, block) for x in each.over_block]:
                nut = x + error(x) - way.value * lost / 2 - 0.37 * each.number
                gap = sign * nut - (length + actual if length else 0.0)
                readings.append(
                    Reading(x, way, sign * (length + round(gap, 4)), each.number, block=sign * length)
                )
    return Survey(tuple(readings), Units.MM, source="walk.csv", standard=standard or Standard(Grade.ZERO))


def errors_of(found: Joined) -> list[float]:
    """Return the error of the axis at the positions of the walk, less that of the first, in µm."""
    at = {way: [each for each in found.survey.readings if each.direction is way] for way in (UP, DOWN)}
    both = [(one.deviation + other.deviation) / 2 for one, other in zip(at[UP], at[DOWN], strict=True)]
    return [1000 * (each - both[0]) for each in both]


def test_the_error_between_the_placements_is_that_of_the_axis() -> None:
    """40 µm/m and a wave of 6 µm in 220 mm: a dial of 0.1 µm over an exact block leaves tenths of a µm."""
    error: Error = lambda x: 40e-6 * x + 0.006 * np.sin(x / 35)  # noqa: E731 - as in the other tests
    found = joined(walk(error, standard=Standard(uncertainty_um=0.02)), LEAD)
    positions = found.screw.means.targets
    assert (positions[0], positions[-1]) == (0.0, 300.0)
    expected = [1000 * (error(x) - error(0.0)) for x in positions]
    assert errors_of(found) == pytest.approx(expected, abs=0.6)


def test_the_lost_motion_comes_from_the_difference_of_both_directions() -> None:
    found = joined(walk(lambda x: 20e-6 * x, lost=0.014), LEAD)
    table = build_from(found.survey, Recipe(fit=Fit.AUTO, periods=LEAD), found.screw).table
    reversal = [1000 * (f - b) for f, b in zip(table.forward, table.backward, strict=True)]
    # The nut lags by 7 µm in each direction: forward 14 µm more are added than backward.
    assert reversal == pytest.approx([14.0] * len(reversal), abs=0.2)


@pytest.mark.parametrize(
    ("stated", "um_per_m"),
    [
        # The block is 2 µm longer than 50 mm: 40 µm a metre, which its certificate takes out.
        (Standard(deviation_um=2.0, uncertainty_um=0.02), 0.0),
        # With a certificate that leaves it out the axis seems to go too little: 50.002 mm are read as 50.
        (Standard(uncertainty_um=0.02), -40.0),
    ],
)
def test_a_deviation_of_the_block_is_a_scale(stated: Standard, um_per_m: float) -> None:
    found = joined(walk(lambda x: 0.0, actual=0.002, standard=stated), LEAD)
    assert errors_of(found)[-1] == pytest.approx(um_per_m * 0.3, abs=0.3)


@settings(max_examples=3, deadline=None)
@given(um_per_m=st.integers(-150, 150))
def test_a_block_of_unknown_length_leaves_out_every_scale(um_per_m: int) -> None:
    """The same screw with any straight part gives the same table, and the report says why."""
    bent: Error = lambda x: 0.008 * np.sin(x / 40)  # noqa: E731 - one of two
    found = [
        joined(walk(error, standard=Standard(Grade.UNKNOWN), actual=0.0007), LEAD)
        for error in (bent, lambda x: bent(x) + um_per_m * 1e-6 * x)
    ]
    one, other = (errors_of(each) for each in found)
    assert other == pytest.approx(one, abs=0.6)
    assert any("the scale cannot be determined" in each for each in found[0].survey.remarks)
    table = build_from(found[1].survey, Recipe(fit=Fit.AUTO, periods=LEAD), found[1].screw).table
    left_out = found[1].screw.left_out(table)
    # A dial that rounds to 0.1 µm: but for the scale, nothing shows that a micrometre is left.
    assert left_out.low is not None
    assert left_out.low < 0.001


def test_a_gap_that_closes_gives_the_same_error() -> None:
    error: Error = lambda x: 30e-6 * x + 0.004 * np.cos(x / 30)  # noqa: E731 - as above
    found = joined(walk(error, closes=True, standard=Standard(uncertainty_um=0.02)), LEAD)
    positions = found.screw.means.targets
    assert errors_of(found) == pytest.approx([1000 * (error(x) - error(0.0)) for x in positions], abs=0.6)


def test_one_direction_is_enough_for_one_curve() -> None:
    survey = walk(lambda x: 30e-6 * x, ways=(UP,), standard=Standard(uncertainty_um=0.02))
    found = joined(survey, LEAD)
    built = build_from(found.survey, Recipe(fit=Fit.AUTO, periods=LEAD, one_way=True), found.screw)
    assert built.table.is_unidirectional
    rise = built.table.forward[-1] - built.table.forward[0]
    assert 1000 * rise == pytest.approx(-9.0, abs=0.5)


def slipped(survey: Survey, placement: int, by: float, *, over_block_only: bool) -> Survey:
    moved = tuple(
        replace(each, measured=each.measured + by)
        if each.run == placement and (each.block or (not over_block_only and each.direction is DOWN))
        else each
        for each in survey.readings
    )
    return replace(survey, readings=moved)


@pytest.mark.parametrize("over_block_only", [True, False])
def test_a_placement_that_slipped_is_named_and_left_out(over_block_only: bool) -> None:
    """Dirt under the block is in both directions; a stop that slips, in all readings after it."""
    survey = walk(lambda x: 20e-6 * x, count=20, standard=Standard(uncertainty_um=0.02))
    wrong = slipped(survey, 8, 0.015, over_block_only=over_block_only)
    found = joined(wrong, LEAD, drop=True)
    assert [each.placement for each in found.slips] == [8]
    assert any("placement 8 (" in each and each.endswith("left out") for each in found.survey.remarks)
    assert errors_of(found)[-1] == pytest.approx(6.0, abs=0.4)
    assert joined(survey, LEAD).slips == ()


def test_a_slip_is_described_with_its_place() -> None:
    text = Slip(3, 20.0, 71.5, 0.0123).describe(Units.MM)
    assert text == "placement 3 (20 to 71.5 mm): its differences miss the others by 12.30 µm"


def test_free_zeros_are_the_same_as_differences() -> None:
    """The posterior by the covariance of zeros, and by differences that have none of them."""
    low = np.array([0.0, 9.0, 21.0, 30.0, 42.0, 50.0])
    setups = np.tile(np.arange(6), 2)
    positions = np.concatenate((low, low + 25.0))
    order = np.argsort(positions, kind="stable")
    values = np.sin(positions / 20.0) * 0.01 + np.repeat([0.0, 0.0], 6)
    columns = np.concatenate((np.zeros(6), np.full(6, 0.0004)))[:, None]
    shared = Shared(setups[order], 0.5, columns[order])
    samples = Samples(positions[order], values[order], np.full(12, 1e-8), 0.0, shared)
    process = fitted(samples, CurveKind(1.5))
    at = np.linspace(0.0, 75.0, 16)
    found = process.mean(at) - process.mean(np.array([0.0]))

    everywhere = np.concatenate((at, samples.positions))
    distances = np.abs(everywhere[:, None] - everywhere[None, :])
    scaled = distances / np.exp(process.sizes["length"]) * sqrt(3.0)
    kernel = np.exp(2 * process.sizes["smooth"]) * (1 + scaled) * np.exp(-scaled)
    middle = (everywhere - samples.positions.mean()) / (samples.span / 2)
    trend = np.column_stack((np.ones_like(middle), middle))
    line = np.polyfit(samples.positions, samples.values, 1)
    rest = samples.values - np.polyval(line, samples.positions)
    typical = float(rest.std())
    kernel += 100.0 * typical**2 * trend @ trend.T
    pairs = [np.flatnonzero(shared.setups == setup) for setup in range(6)]
    differences = np.zeros((6, 12))
    for index, (before, after) in enumerate(pairs):
        differences[index, [before, after]] = -1.0, 1.0
    noise = 1e-8 * np.eye(12) + shared.columns @ shared.columns.T
    own = differences @ (kernel[16:, 16:] + noise) @ differences.T
    weights = np.linalg.solve(own, differences @ rest)
    curve = np.polyval(line, at) + kernel[:16, 16:] @ differences.T @ weights
    assert found == pytest.approx(curve - curve[0], abs=2e-6)


def test_what_readings_share_has_the_covariance_of_its_parts() -> None:
    # Two placements; the second and the third reading are over a block known to 0.3 µm, zeros to 2 µm.
    shared = Shared(np.array([0, 0, 1]), 2.0, np.array([[0.0], [0.3], [0.3]]))
    assert shared.covariance().tolist() == [
        [4.0, 4.0, 0.0],
        [4.0, pytest.approx(4.09), 0.09],
        [0.0, 0.09, 4.09],
    ]


def test_the_length_of_a_block_leaves_a_straight_part_open() -> None:
    # 0.3 µm on 50 mm are 0.45 µm at each end of 150 mm, from their middle; with 0.4 µm more 0.75 (3, 4, 5).
    positions = np.array([0.0, 50.0, 100.0, 150.0])
    columns = np.array([[0.0, 0.0], [0.3, 0.4], [0.0, 0.0], [0.3, 0.4]])
    setups = np.array([3, 3, 7, 7])
    for chosen, size in ((columns[:, :1], 0.45), (columns, 0.75), (np.zeros((4, 0)), 0.0)):
        samples = Samples(positions, positions, positions, shared=Shared(setups, 1.0, chosen))
        assert samples.open_line == pytest.approx(size)
    assert Samples(positions, positions, positions).open_line == 0.0


@pytest.mark.parametrize(
    ("standard", "length_mm", "um"),
    [
        (Standard(Grade.TWO), 50.0, 0.8 / sqrt(3)),
        (Standard(Grade.K), 50.8, 0.5 / sqrt(3)),
        (Standard(Grade.ZERO), 1200.0, 2.0 / sqrt(3)),
        (Standard(deviation_um=0.2, uncertainty_um=0.1), 50.0, 0.05),
        # 1 K beside the axis: 11.5 µm/m of 50 mm are 0.575 µm, as a range to either side.
        (Standard(uncertainty_um=0.0, temperature_range=1.0), 50.0, 0.575 / sqrt(3)),
        (Standard(Grade.UNKNOWN), 50.0, inf),
    ],
)
def test_the_length_of_a_block_is_known_by_its_grade_or_its_certificate(
    standard: Standard, length_mm: float, um: float
) -> None:
    assert 1000 * standard.uncertainty_of(length_mm) == pytest.approx(um)


@given(
    st.builds(
        Standard,
        st.sampled_from(Grade),
        temperature_range=st.integers(0, 90).map(lambda tenths: tenths / 10),
        dial_error_um=st.integers(0, 90).map(lambda tenths: tenths / 10),
    )
)
def test_the_facts_of_a_standard_come_back(standard: Standard) -> None:
    assert standard_of(standard.facts()) == standard


@pytest.mark.parametrize(
    ("facts", "told"),
    [
        ({}, "give either its grade .block_grade: K, 0, 1, 2, or unknown., or from its certificate"),
        ({"block_grade": "3"}, "# block_grade: 3: allowed are K, 0, 1, 2, and unknown"),
        ({"block_uncertainty_um": "0,1"}, "# block_uncertainty_um: 0,1: it must be a number"),
        ({"block_grade": "1", "dial_error_um": "-1"}, "dial_error_um -1: it must be 0 or more"),
        (
            {"block_uncertainty_um": "0.1", "block_deviation_um": "nan"},
            "block_deviation_um nan: it must be a fin",
        ),
    ],
)
def test_a_block_of_which_nothing_is_known_is_refused(facts: dict[str, str], told: str) -> None:
    with pytest.raises(ReadingsError, match=told):
        standard_of(facts)


def test_a_block_of_whole_turns_hides_the_turn_and_no_figure_is_promised() -> None:
    exact = Walk(0.0, 300.0, 50.0, 20, 0.0).placed(Units.MM)
    positions = [(*each.bare, *each.over_block) for each in exact]
    five, seven = Period(5.0, "lead 5"), Period(7.0, "lead 7")
    assert hidden(positions, [five, seven]) == (five,)
    wide = Walk(0.0, 300.0, 50.0, 20, 6.0).placed(Units.MM)
    assert hidden([(*each.bare, *each.over_block) for each in wide], [five, seven]) == ()
    [unnamed] = hidden(positions, [])
    assert unnamed.name == "the length of 50 between two readings and its whole fractions"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"high": 90.0}, "the range must be at least twice the block"),
        ({"placements": 4}, "4 placements: give 5 to 500"),
        ({"reach": 50.0}, "give less than the block"),
        ({"block": 0.0}, "a block longer than 0"),
        ({"per_side": 20}, "20 positions on each side of the block: give a dial range of at least 2"),
    ],
)
def test_a_walk_that_cannot_be_gone_is_refused(change: dict[str, Any], told: str) -> None:
    with pytest.raises(ReadingsError, match=told):
        replace(Walk(0.0, 300.0, 50.0, 20, 1.0), **change)


@given(st.integers(1, 10_000), st.integers(5, 60), st.floats(0.3, 12.0), st.integers(1, 3), st.booleans())
def test_a_walk_stays_inside_and_the_dial_in_its_range(
    seed: int, count: int, reach: float, per_side: int, closes: bool
) -> None:
    planned = Walk(-10.0, 290.0, 50.0, count, reach, seed, closes, per_side).placed(Units.MM)
    assert [each.number for each in planned] == list(range(1, count + 1))
    assert min(planned[0].positions) == -10.0
    assert max(planned[-1].positions) == 290.0
    for each in planned:
        low, high = (each.over_block, each.bare) if closes else (each.bare, each.over_block)
        assert len(set(low)) == len(set(high)) == per_side
        assert -10.0 <= low[0] <= low[-1] < high[0] <= high[-1] <= 290.0
        # What the dial shows over the block and without it; the last digit of each position is rounded.
        shown = [*low, *(x - 50.0 for x in high)]
        assert max(shown) - min(shown) <= reach + 0.0021


def test_too_few_placements_make_no_curve() -> None:
    survey = walk(lambda x: 0.0, count=5)
    kept = tuple(each for each in survey.readings if each.run > 1)
    with pytest.raises(
        ReadingsError, match=r"walk\.csv: 4 placements with readings at two or more positions"
    ):
        joined(replace(survey, readings=kept))


def test_blocks_of_several_lengths_have_grades_and_no_certificate() -> None:
    one = walk(lambda x: 0.0, standard=Standard(uncertainty_um=0.1))
    other = walk(lambda x: 0.0, block=25.0, standard=Standard(uncertainty_um=0.1))
    with pytest.raises(ReadingsError, match=r"blocks of 25 and 50 mm and one certificate: give the grade"):
        joined(merged([one, other]))


def test_blocks_of_two_lengths_are_joined_to_one_curve() -> None:
    error: Error = lambda x: 25e-6 * x  # noqa: E731 - as above
    surveys = [walk(error, block=block, standard=Standard(Grade.ZERO)) for block in (25.0, 50.0)]
    both = merged(surveys)
    assert understood(both).endswith("28 placements of a block, grade 0, from 0 to 300")
    found = joined(both, LEAD)
    assert errors_of(found)[-1] == pytest.approx(7.5, abs=0.6)


def test_walks_by_two_blocks_that_are_known_differently_are_not_one() -> None:
    one, other = (walk(lambda x: 0.0, standard=Standard(grade)) for grade in (Grade.ZERO, Grade.ONE))
    with pytest.raises(ReadingsError, match=r"is of block grade 0, .* of block grade 1"):
        merged([one, other])


@pytest.mark.parametrize("name", ["straight, 30 µm a metre", "of the issue, lead 5 told"])
def test_one_block_and_a_dial_leave_a_few_micrometres(name: str) -> None:
    """A seed of the table in bench/screws.md: E of 25 µm before, one block of 50 mm of grade 0.

    The second screw has a turn of 5 mm, as a block has ten, that comes and goes along the screw.
    """
    [kind] = [each for each in walks.kinds() if each.name == name]
    found = walks.case(kind, walks.SetUp(grade=Grade.ZERO, per_side=2), 1)
    assert found.before > 24.0
    assert found.true <= 5.0
    assert found.high is not None
    assert found.true <= found.high
    assert found.slips == ()


@pytest.mark.skipif(not IS_FULL, reason="minutes: in make soak")
@pytest.mark.timeout(3600)
def test_nine_of_ten_screws_keep_5_um_and_the_band_holds_the_truth() -> None:
    """Ten screws of each kind, of the hundred in bench/screws.md."""
    made = walks.SetUp(grade=Grade.ZERO, per_side=2)
    found = [walks.case(kind, made, seed) for kind in walks.kinds() for seed in range(10)]
    assert sum(each.true <= 5.0 for each in found) >= 90
    assert 0.93 <= sum(each.covered for each in found) / len(found) <= 0.99
