"""The uncertainty of a table's corrections, at its points and between them."""

from dataclasses import replace
from math import exp, hypot, log, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.band import Band, band_of, without_noise
from gateway.metrology.build import Fit, HomeReference, home_of
from gateway.metrology.process import ANALYTIC, CurveKind, Process, Samples, with_sizes
from gateway.metrology.readings import MeanCorrections, Reading, Survey
from gateway.metrology.recipe import Recipe, build_from
from gateway.metrology.screw import MeasuredScrew, _Draws
from gateway.metrology.uncertainty import UncertaintyInputs
from tests.metrology import coverage, walks
from tests.metrology.screws import DOWN, UP
from tests.soak import IS_FULL

TARGETS = (0.0, 100.0, 200.0, 300.0, 400.0)
SLOPE = 20e-6
NOTHING = UncertaintyInputs()
SIGMA = 0.001
HOME = HomeReference(0.0, UP)


def line(sigma: float = SIGMA, *, rise: float = SLOPE) -> Process:
    """Return five values on a straight line, of a curve that is straight, each known to ``sigma``."""
    positions = np.array(TARGETS)
    samples = Samples(positions, rise * positions, np.full(5, sigma**2))
    kind = CurveKind(1.5)
    # Nothing is left of the smooth part; the offset and the slope are free: their prior is far wider.
    return with_sizes(samples, kind, {"smooth": log(1e-12), "length": log(100.0)}, typical=sigma * 100)


def screw(process: Process, reversal: Process | None = None, *, is_scale_known: bool = True) -> MeasuredScrew:
    values = tuple(process.mean(np.array(TARGETS)).tolist())
    backward = tuple(values if reversal is not None else [None] * 5)
    nothing = np.zeros((2, 2))
    return MeasuredScrew(
        Units.MM,
        MeanCorrections(TARGETS, values, backward),
        process,
        None,
        reversal,
        (),
        (),
        (),
        (),
        "",
        SIGMA,
        ((process, 1.0),),
        np.array([0.0, 400.0]),
        _Draws(nothing, nothing),
        (),
        is_scale_known,
        None if is_scale_known else (),
    )


AT = np.array([3.0, 24.0, 50.5, 84.0])


def curve(kind: CurveKind) -> Process:
    """Return seven values of a wave, 15 mm apart in the mean."""
    positions = np.array([0.0, 17.0, 31.0, 44.0, 63.0, 78.0, 90.0])
    samples = Samples(positions, np.sin(positions / 15), np.full(7, 0.01))
    sizes = {"smooth": 0.0, "length": log(20.0), "short": log(0.2), "period 0": log(0.3)}
    return with_sizes(samples, kind, sizes)


def table(forward: list[float], backward: list[float] | None = None) -> CorrectionTable:
    return make_table(TARGETS, forward, backward or forward, Units.MM)


ON_THE_LINE = table([SLOPE * x for x in TARGETS])


def band(of: MeasuredScrew, made: CorrectionTable, home: HomeReference | None, **stated: float) -> Band:
    found = band_of(of, made, home, UncertaintyInputs(**stated))
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("position", "variance"),
    [
        # A straight line through n = 5 values: σ² (1 / n + (x - 200)² / Σ (x_i - 200)²), the sum 100 000 mm².
        (200.0, 1 / 5),
        (0.0, 1 / 5 + 40_000 / 100_000),
        (350.0, 1 / 5 + 22_500 / 100_000),  # between two targets
    ],
)
def test_the_uncertainty_of_a_straight_line_is_that_of_the_textbooks(
    position: float, variance: float
) -> None:
    found = band(screw(line()), ON_THE_LINE, None).at(position, UP)
    assert found == pytest.approx(2 * SIGMA * sqrt(variance), rel=2e-3)


def test_corrections_that_count_from_home_are_certain_there_and_less_so_with_the_distance() -> None:
    # The offset falls out: σ² (x - 0)² / 100 000.
    found = band(screw(line()), ON_THE_LINE, HOME)
    assert found.at(0.0, UP) == pytest.approx(0.0, abs=1e-8)
    assert found.at(400.0, UP) == pytest.approx(2 * SIGMA * 400 / sqrt(100_000), rel=2e-3)
    assert found.backward is None, "only forward was measured"
    assert found.at(400.0, DOWN) is None


def test_where_home_was_not_measured_the_nearest_target_stands_for_it() -> None:
    beyond = band(screw(line()), ON_THE_LINE, HomeReference(-30.0, UP), instrument=0.003)
    assert beyond.forward == band(screw(line()), ON_THE_LINE, HOME, instrument=0.003).forward


def test_lost_motion_adds_its_own_uncertainty_on_the_other_branch() -> None:
    # From home forward, the middle m and the half reversal h count as m(x) ± h(x) - m(0) - h(0). Backward at
    # home that is -2 h(0), with the variance 4 σ² 0.6; forward at home nothing is left.
    found = band(screw(line(), line(rise=0.0)), table([0.02 * x / 1000 for x in TARGETS]), HOME)
    one_curve = found.at(0.0, DOWN)
    assert one_curve == pytest.approx(0.0, abs=1e-8), "one curve is compared with the mean of both"
    both = band(
        screw(line(), line(rise=0.0)),
        table([SLOPE * x for x in TARGETS], [1e-12 + SLOPE * x for x in TARGETS]),
        HOME,
    )
    assert both.at(0.0, UP) == pytest.approx(0.0, abs=1e-8)
    assert both.at(0.0, DOWN) == pytest.approx(2 * SIGMA * sqrt(4 * 0.6), rel=2e-3)


def test_instrument_and_temperature_grow_from_home_and_are_added_as_squares() -> None:
    # k = 2: 3 µm over 400 mm, and 0.6 * 11.5e-6 * 400 * 1 = 2.76 µm for a range of 1 K; half of both at 200.
    without = band(screw(line()), ON_THE_LINE, HOME).at(200.0, UP)
    assert without is not None
    found = band(screw(line()), ON_THE_LINE, HOME, instrument=0.003, temperature_range=1.0, environment=0.001)
    assert found.at(200.0, UP) == pytest.approx(hypot(without, 0.0015, 0.00138, 0.0006))


def test_what_a_table_does_not_follow_is_in_its_uncertainty() -> None:
    off = [SLOPE * x + (0.002 if x == 200.0 else 0.0) for x in TARGETS]
    found = band(screw(line()), table(off), None)
    # Twice the root of σ² / 5 + (2 µm)²; half as far off at 250, where the line has 1/5 + 2500 / 100 000.
    assert found.at(200.0, UP) == pytest.approx(2 * hypot(SIGMA / sqrt(5), 0.002), rel=1e-3)
    assert found.at(250.0, UP) == pytest.approx(2 * hypot(SIGMA * sqrt(0.225), 0.001), rel=1e-2)


def test_of_an_unknown_scale_no_straight_part_counts() -> None:
    tilted = table([3 * SLOPE * x for x in TARGETS])
    found = band(screw(line(), is_scale_known=False), tilted, HOME)
    # The slope alone would have 2.53 µm; rounding of the free slope leaves some nm.
    assert found.largest()[0] == pytest.approx(0.0, abs=1e-4)


def test_nothing_is_said_beyond_the_targets() -> None:
    wide = make_table(
        [-50.0, *TARGETS, 450.0], [0.0, *(SLOPE * x for x in TARGETS), 0.008], [0.0] * 7, Units.MM
    )
    found = band(screw(line(), line(rise=0.0)), wide, HOME)
    assert (found.at(-50.0, UP), found.at(450.0, DOWN)) == (None, None)
    data = found.as_data(wide)
    shown = data["forward_um"]
    assert isinstance(shown, list)
    assert shown[0] is None
    assert shown[1] == pytest.approx(0.0, abs=1e-5)
    assert data["positions"] == [-50.0, *TARGETS, 450.0]
    assert (data["coverage"], data["k"]) == (0.95, 2.0)


def test_a_correction_below_its_uncertainty_is_noise_and_is_left_out_where_asked() -> None:
    # U from home: 2 σ x / 316.2 mm = 0.63, 1.26, 1.90 and 2.53 µm; each is hypot with twice what is missed.
    slight = table([0.0, 0.0005, 0.0020, 0.0010, 0.0040])
    found = Band(Units.MM, TARGETS, (0.0, 0.00063, 0.00126, 0.0019, 0.00253), (0.0, 0.0, 0.0, 0.0, 0.0), ())
    assert found.noise(slight) == [(100.0, UP), (300.0, UP)]
    left = without_noise(slight, found)
    assert list(left.forward) == [0.0, 0.0, 0.0020, 0.0, 0.0040]
    assert list(left.backward) == [0.0, 0.0005, 0.0020, 0.0010, 0.0040]
    said = found.described(slight)
    assert said[1] == (
        "2 of 10 corrections are noise: smaller than their own uncertainty. table build --drop-noise makes "
        "them 0"
    )
    one = found.described(table([0.0, 0.0005, 0.0020, 0.0030, 0.0040]), is_refined=True)
    assert one[1] == "1 of 10 corrections is noise: smaller than its own uncertainty"
    # 0, 0, 0, 0, 0, 0, 0.63, 1.26, 1.90, 2.53: the middle of ten.
    assert said[0].endswith("usually ±0.00 µm, at most ±2.53 µm (forward at 400 mm)")


def test_the_home_of_a_table_in_a_file_is_where_it_is_0() -> None:
    assert home_of(table([0.1, 0.2, 0.0, 0.1, 0.1], [0.1, 0.0, 0.1, 0.1, 0.1])) == HomeReference(100.0, DOWN)
    assert home_of(table([0.1, 0.2, 0.1, 0.1, 0.1])) is None


@pytest.mark.parametrize("has_short", [False, True])
def test_the_variance_is_the_diagonal_of_the_covariance(has_short: bool) -> None:
    process = curve(CurveKind(ANALYTIC, has_short, periods=(11.0,), jumps=(50.0,)))
    covariance = process.covariance(AT, AT)
    assert process.variance(AT) == pytest.approx(np.diag(covariance))
    if not has_short:
        # Of 20 000 draws a variance is known to a percent; that they consist of waves adds some.
        drawn = np.cov(process.draws(AT, 20_000, np.random.default_rng(1)))
        assert drawn == pytest.approx(covariance, abs=0.1 * float(np.diag(covariance).max()))


def test_waves_too_short_for_the_samples_are_known_nowhere_and_alike_only_close_by() -> None:
    with_short, without = (curve(CurveKind(ANALYTIC, short)) for short in (True, False))
    sizes = with_short.sizes
    bare = with_sizes(with_short.samples, CurveKind(ANALYTIC), sizes)
    more = with_sizes(
        replace(with_short.samples, variance=with_short.samples.variance + 0.04), CurveKind(ANALYTIC), sizes
    )
    assert without.variance(AT) == pytest.approx(bare.variance(AT))
    # They are in the samples as further scatter, and in the curve with all of their variance, 0.2².
    assert with_short.variance(AT) == pytest.approx(more.variance(AT) + 0.04, rel=1e-3)
    # Mean distance 15: 2 to 8 turns in it. At a distance of 1/16 of it, a half: mean of cos(2 pi q / 16),
    # (sin(pi) - sin(pi / 4)) / (6 * 2 pi / 16).
    near = np.array([24.0, 24.0 + 15 / 16])
    extra = with_short.covariance(near, near)[0, 1] - more.covariance(near, near)[0, 1]
    assert extra == pytest.approx(0.04 * -sin(pi / 4) / (6 * 2 * pi / 16), rel=1e-2)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(-0.05, 0.05), min_size=5, max_size=5),
    st.floats(0.0, 0.01),
    st.sampled_from([None, HOME, HomeReference(200.0, DOWN)]),
)
def test_another_table_and_a_worse_instrument_never_make_the_band_narrower(
    forward: list[float], instrument: float, home: HomeReference | None
) -> None:
    of = screw(line(), line(rise=0.0))
    best = band(of, table([SLOPE * x for x in TARGETS], [SLOPE * x + 1e-12 for x in TARGETS]), home)
    other = band(of, table(forward, [x + 1e-12 for x in forward]), home, instrument=instrument)
    for position in TARGETS:
        for way in (UP, DOWN):
            narrow, wide = best.at(position, way), other.at(position, way)
            assert narrow is not None
            assert wide is not None
            assert wide >= narrow * (1 - 1e-6) - 1e-7


def test_inches_and_millimetres_give_the_same_band() -> None:
    positions = [0.0, 37.0, 81.0, 120.0, 166.0, 203.0, 240.0, 287.0, 333.0, 380.0]
    shown = [0.0, 0.004, 0.007, 0.006, 0.009, 0.012, 0.010, 0.013, 0.017, 0.016]
    survey = Survey(
        tuple(
            Reading(x, way, x + shift + jitter, run)
            for run, jitter in ((1, 0.0002), (2, -0.0003), (3, 0.0001))
            for way in (UP, DOWN)
            for x, shift in zip(positions, shown, strict=True)
        ),
        Units.MM,
    )
    found = []
    for each in (survey, survey.in_units(Units.INCH)):
        built = build_from(each, Recipe(fit=Fit.LINES))
        assert built.screw is not None
        units = each.units
        found.append(
            band(built.screw, built.table, None, instrument=units.from_mm(0.001)).largest()[0]
            / units.from_mm(1.0)
        )
    assert found[0] == pytest.approx(found[1], rel=1e-3)


def test_the_truth_lies_in_the_band() -> None:
    """Of some screws. ``python -m tests.metrology.coverage`` measures hundreds (bench/screws.md)."""
    methods = [each for each in coverage.METHODS if each.name != "block"][: 3 if IS_FULL else 1]
    kinds = walks.kinds() if IS_FULL else walks.kinds()[::2]
    found = [coverage.case(kind, method, 0) for method in methods for kind in kinds]
    covered = sum(each.covered for each in found) / len(found)
    # By screws the share scatters by about 0.1: of five screws the mean by 0.04.
    assert 0.83 <= covered <= 1.0
    # A band three times as wide as it has to be would cover all: U is twice the usual miss.
    wide, missed = (
        exp(sum(map(log, each)) / len(found)) for each in zip(*((c.u, c.missed) for c in found), strict=True)
    )
    assert wide / missed <= 3.0
