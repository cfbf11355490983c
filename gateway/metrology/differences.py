"""From differences to a curve: a gauge block walked along an axis, a step gauge, 1-2-3 blocks.

The instrument and its stop are placed at the axis. The axis goes to two or more positions, at some of them
with a block between instrument and stop. Then both are placed elsewhere. Each reading ``y`` (the block's
nominal length and what the dial shows) is linear in the unknowns::

    y = x + e(x, direction) + zero(placement) - d(block) + g * dial + scatter

``e`` is the error of the axis at the position ``x``: the random curve of :mod:`gateway.metrology.process`.
``zero`` is free: only readings of one placement compare directly. ``d`` is the deviation of the block's
length from its nominal length, equal wherever this block is used. It adds up along the walk, as a wrong scale
does. ``g`` is the error of the dial over its range. Zeros, ``d`` and ``g`` are in the covariance of the
readings, by their standard uncertainties (JCGM 102: a linear model propagates its covariance exactly). The
best estimate of the curve, its covariance, and the size of the scatter follow together.

A block of unknown length has a free ``d``. Then the straight line in ``e`` is unknown too, because a wrong
scale gives the same readings. It is left out: the table has no straight part, and E does not include one.

The difference of both directions at one position of a placement has neither zero nor block in it: the lost
motion comes from these.

Numbers are in the units of the readings. Needs numpy; its users import it locally.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import copysign, inf, sqrt
from statistics import fmean, median
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period
from gateway.metrology.process import Array, CurveKind, Process, Samples, Shared, fitted, with_sizes
from gateway.metrology.readings import APPROACHES, Reading, Survey, checked_approaches, small_unit
from gateway.metrology.screw import (
    LEAST_TARGETS,
    Differences,
    MeasuredScrew,
    screw_of_differences,
    without_slope,
)
from gateway.metrology.standard import Standard, in_mm
from gateway.metrology.walk import Walk, hidden
from gateway.plain import JsonObject

LEAST_PLACEMENTS: Final = 5
"""Fewer show nothing about the range between them."""
FREE_MM: Final = 1.0
"""Standard deviation of the deviation of a block of unknown length."""
ZERO: Final = 30.0
"""Standard deviation of a zero beside its estimate, in the differences that the curve makes."""
OPEN_ZERO: Final = 10.0
"""The same, in the straight part at the ends that the length of the block leaves open."""
NORMAL: Final = 0.6745
"""Median of the absolute value of a standard normal distribution."""
MOST_SCORE: Final = 6.0
"""A placement whose differences miss by more of their robust standard deviations has slipped."""
MOST_SLIPS: Final = 5
"""More are no slips: the screw is another one than its curve, or the block moves each time."""
LEAST_MM: Final = 0.002
"""A smaller miss has no cause that a person could find."""
LEAST_SCATTER_MM: Final = 1e-5
"""No dial scatters less; readings without any scatter are computed."""
SPREAD: Final = 0.5
"""Uncertainty of the scatter of a middle from that of the lost motion, as a logarithm."""
KINDS: Final = (1.5, inf)
"""Orders of curves that are tried; the positions of a walk are close enough for a smooth curve."""


class Slip(NamedTuple):
    """A placement that does not fit the others: something moved while it was measured."""

    placement: int
    low: float
    high: float
    miss: float
    """In the units of the readings."""

    def describe(self, units: Units) -> str:
        """Return it in a few words.

        >>> Slip(7, 100.0, 150.0, 0.012).describe(Units.MM)
        'placement 7 (100 to 150 mm): its differences miss the others by 12.00 µm'
        """
        return (
            f"placement {self.placement} ({self.low:.9g} to {self.high:.9g} {units.value}): its differences "
            f"miss the others by {small_unit(units).text(self.miss)}"
        )


@dataclass(frozen=True, slots=True)
class Joined:
    """Differences as one curve along the axis."""

    survey: Survey
    """The curve as readings from one zero: at each position of the walk, once in each direction.

    Its remarks say how it was joined.
    """
    screw: MeasuredScrew
    slips: tuple[Slip, ...]


def joined(survey: Survey, periods: Iterable[Period] = (), *, drop: bool = False) -> Joined:
    """Join the differences of a survey with a ``standard``; ``drop``: without placements that slipped.

    Raises:
        ReadingsError: too few placements or positions, readings without a direction or a number, or one
            certificate for several blocks.
    """
    standard = survey.standard
    assert standard is not None, "differences have a standard"
    checked_approaches(survey.readings)
    if standard.uncertainty_um is not None and len(_lengths(survey)) > 1:
        raise ReadingsError(
            f"{survey.source}: blocks of {_named(survey)} and one certificate: give the grade of the blocks "
            "(# block_grade) in place of deviation and uncertainty"
        )
    given = tuple(periods)
    fit, slip = _fitted(survey, given)
    slips: list[Slip] = []
    sound, sound_fit = survey, fit
    # The curve follows a wrong placement a little, so its neighbours seem wrong too: one after the other.
    while slip is not None and len(slips) < MOST_SLIPS:
        number = slip.placement
        kept = tuple(each for each in sound.readings if each.run != number)
        if len({each.run for each in kept}) < LEAST_PLACEMENTS:
            break
        slips.append(slip)
        sound = replace(sound, readings=kept)
        sound_fit, slip = _fitted(sound, given)
    if drop:
        fit = sound_fit
    done = "left out" if drop else "kept; --drop-outliers leaves it out, or take it back and measure it again"
    notes = [f"{each.describe(survey.units)}: {done}" for each in slips]
    count = len({each.run for each in survey.readings}) - (len(slips) if drop else 0)
    notes.append(
        f"joined from differences of {count} placements over {_named(survey)}, {standard.describe()}: the "
        "zero is where the curve begins"
    )
    if not standard.is_length_known:
        notes.append(
            "the length of the block is unknown, so the scale cannot be determined: the straight part of the "
            "error is in neither the table nor E. Measure one long distance of known length, or give the "
            "grade of the block (# block_grade)"
        )
    found = _absolute(survey, fit)
    return Joined(replace(found, remarks=(*survey.remarks, *notes)), fit, tuple(slips))


def _lengths(survey: Survey) -> list[float]:
    return sorted({abs(each.block) for each in survey.readings if each.block})


def _named(survey: Survey) -> str:
    lengths = " and ".join(f"{length:.9g}" for length in _lengths(survey))
    return f"{lengths} {survey.units.value}" if lengths else "no block"


# --- The samples of the linear model


class _Place(NamedTuple):
    """One position of a placement: correction at the middle of both directions, and half their difference."""

    setup: int
    position: float
    block: float
    dial: float
    middle: float
    half: float | None
    way: int
    """Of the only direction measured, 1 or -1; 0: both were."""
    share: float
    """Of the variance of one reading."""


def _places(survey: Survey) -> list[_Place]:
    """Return the positions of all placements, lowest first."""
    assert survey.standard is not None
    numbers = {run: index for index, run in enumerate(sorted({each.run for each in survey.readings}))}
    groups: dict[tuple[int, float, float], dict[Direction, list[Reading]]] = {}
    for each in survey.readings:
        key = (numbers[each.run], each.target, each.block)
        groups.setdefault(key, {}).setdefault(each.direction, []).append(each)
    length = survey.units.from_mm(survey.standard.deviation_um / 1000.0)
    found = []
    for (setup, position, block), ways in groups.items():
        means = {way: fmean(-each.deviation for each in group) for way, group in ways.items()}
        dial = fmean(each.measured - each.block for group in ways.values() for each in group)
        half = (means[APPROACHES[0]] - means[APPROACHES[1]]) / 2 if len(means) == 2 else None
        alone = 0 if half is not None else next(iter(ways)).value
        share = sum(1.0 / len(group) for group in ways.values()) / len(ways) ** 2
        middle = fmean(means.values()) - (copysign(length, block) if block else 0.0)
        found.append(_Place(setup, position, block, dial, middle, half, alone, share))
    return sorted(found, key=lambda each: (each.position, each.setup))


def _fitted(survey: Survey, periods: tuple[Period, ...]) -> tuple[MeasuredScrew, Slip | None]:
    """Fit both curves, and find the placement that fits worst, if it slipped.

    Raises:
        ReadingsError: too few placements or positions.
    """
    assert survey.standard is not None
    places = _places(survey)
    counts = Counter(each.setup for each in places)
    several = [setup for setup, count in counts.items() if count > 1]
    if len(several) < LEAST_PLACEMENTS or len({each.position for each in places}) < LEAST_TARGETS:
        raise ReadingsError(
            f"{survey.source}: {len(several)} placements with readings at two or more positions: the walk "
            f"needs at least {LEAST_PLACEMENTS}, each with a reading without the block and one with it"
        )
    places = [each for each in places if counts[each.setup] > 1]
    reversal, scatter = _reversal(places, survey.units.from_mm(LEAST_SCATTER_MM))
    middle = _middle(places, survey, reversal, scatter)
    concealed = hidden(
        [[each.position for each in places if each.setup == setup] for setup in several],
        periods,
    )
    screw = screw_of_differences(
        Differences(
            survey.units,
            middle,
            reversal,
            scatter,
            periods,
            concealed,
            is_scale_known=survey.standard.is_length_known,
            orders=KINDS,
        )
    )
    return screw, _slip(places, survey, screw)


def _reversal(places: Sequence[_Place], least: float) -> tuple[Process | None, float | None]:
    """Fit the half difference of both directions; return it with the scatter of a middle."""
    both = [each for each in places if each.half is not None]
    if len(both) < LEAST_TARGETS:
        return None, None
    positions, values, shares = (
        np.array(column) for column in zip(*((p.position, p.half, p.share) for p in both), strict=True)
    )
    guess = max(float(values.var()) * 0.01, least**2)
    samples = Samples(positions, values, shares / shares.mean() * guess, noise_spread=inf)
    process = min((fitted(samples, CurveKind(order)) for order in KINDS), key=lambda each: each.score)
    return process, max(float(np.exp(process.sizes["noise"])), least)


def _middle(
    places: Sequence[_Place], survey: Survey, reversal: Process | None, scatter: float | None
) -> Samples:
    """Return the samples of the mean of both directions, with the covariance of zeros, block and gauge."""
    assert survey.standard is not None
    setups = np.array([each.setup for each in places], dtype=np.intp)
    _, setups = np.unique(setups, return_inverse=True)
    positions = np.array([each.position for each in places])
    values = np.array([each.middle for each in places])
    if reversal is not None:
        values = values - np.array([each.way for each in places]) * reversal.mean(positions)
    values, rest = _level(positions, values, setups)
    shares = np.array([each.share for each in places])
    typical = float(np.sqrt(np.mean(rest**2)))
    noise = scatter if scatter is not None else max(0.1 * typical, survey.units.from_mm(LEAST_SCATTER_MM))
    # The block is placed once for both directions: that scatter is not in their difference.
    spread = SPREAD if scatter is not None else inf
    shared = Shared(setups, ZERO * max(typical, noise), _columns(places, survey))
    samples = Samples(positions, values, noise**2 * shares / shares.mean(), spread, shared)
    if survey.standard.is_length_known:
        # A length that is wrong moves the zeros along the walk: they are free beside that too.
        shared = replace(shared, zero=max(shared.zero, OPEN_ZERO * samples.open_line))
    return replace(samples, shared=shared)


def _level(positions: Array, values: Array, setups: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return the values with each placement's mean on one straight line, and their distances from it.

    The line has the slope of the differences within the placements. It only moves the zeros, which are free.
    """
    counts = np.bincount(setups)
    mean_x = np.bincount(setups, positions) / counts
    mean_y = np.bincount(setups, values) / counts
    x, y = positions - mean_x[setups], values - mean_y[setups]
    slope = float(x @ y) / float(x @ x)
    level = y + slope * mean_x[setups]
    return level, y - slope * x


def _columns(places: Sequence[_Place], survey: Survey) -> Array:
    """Return a column for each block, and one for the gauge, each times its standard uncertainty."""
    standard, units = survey.standard, survey.units
    assert standard is not None
    columns = []
    for length in _lengths(survey):
        uncertainty = units.from_mm(min(standard.uncertainty_of(in_mm(length, units)), FREE_MM))
        columns.append([uncertainty * (abs(each.block) == length) * np.sign(each.block) for each in places])
    dials = [each.dial for each in places]
    reach = max(dials) - min(dials)
    if standard.dial_error_um and reach:
        limit = units.from_mm(standard.dial_error_um / 1000.0)
        columns.append([2.0 * limit / sqrt(3.0) * each.dial / reach for each in places])
    if not columns:
        return np.zeros((len(places), 0))
    return np.array(columns).T


# --- Placements that slipped


def _slip(places: Sequence[_Place], survey: Survey, screw: MeasuredScrew) -> Slip | None:
    """Return the placement that misses its prediction from all others most, if far more than is usual."""
    shared = screw.smooth.samples.shared
    assert shared is not None
    setups = shared.setups
    least = survey.units.from_mm(LEAST_MM)
    found = (MOST_SCORE, 0, 0.0)
    # A slip that one curve follows at the expense of the others shows in the other curve.
    curves = [each for each in (screw.smooth, screw.harmonic) if each is not None]
    for misses in (
        *(_left_out(each, setups) for each in curves),
        _left_out_halves(places, setups, screw.reversal),
    ):
        usual = median([score for score, _ in misses.values()] or [1.0]) / NORMAL
        for setup, (score, miss) in misses.items():
            if usual and miss > least and score > found[0] * usual:
                found = (score / usual, setup, miss)
    _, worst, miss = found
    if not miss:
        return None
    own = [each for each, number in zip(places, setups.tolist(), strict=True) if number == worst]
    runs = sorted({each.run for each in survey.readings})
    return Slip(runs[own[0].setup], own[0].position, own[-1].position, miss)


def _left_out_halves(
    places: Sequence[_Place], setups: NDArray[np.intp], reversal: Process | None
) -> dict[int, tuple[float, float]]:
    """Return the same for the lost motion of each placement, from the position that misses most."""
    found: dict[int, tuple[float, float]] = {}
    if reversal is None:
        return found
    missed, expected = reversal.left_out()
    both = [index for index, each in enumerate(places) if each.half is not None]
    for index, miss, score in zip(
        both, np.abs(missed).tolist(), (np.abs(missed) / np.sqrt(expected)).tolist(), strict=True
    ):
        setup = int(setups[index])
        found[setup] = max(found.get(setup, (0.0, 0.0)), (score, 2 * miss))
    return found


def _left_out(process: Process, setups: NDArray[np.intp]) -> dict[int, tuple[float, float]]:
    """Return for each placement how its differences miss those predicted from all others.

    The score is in standard deviations, the miss in the units of the readings (Rasmussen and Williams, 5.4.2,
    for several values together).
    """
    found = {}
    for setup in np.unique(setups).tolist():
        own = np.flatnonzero(setups == setup)
        missed, expected = process.left_out_together(own)
        # Differences from the first value: the zero is not in them.
        steps = np.hstack((-np.ones((len(own) - 1, 1)), np.eye(len(own) - 1)))
        step, covariance = steps @ missed, steps @ expected @ steps.T
        score = float(step @ np.linalg.solve(covariance, step)) / len(step)
        found[int(setup)] = (sqrt(max(score, 0.0)), float(np.abs(step).max()))
    return found


# --- Before the first placement


class Promise(NamedTuple):
    """E that a walk will leave of a usual screw, by its covariance alone; in the units of the axis."""

    e: float
    """Half of the walks leave more."""
    high: float
    """Nine of ten leave no more."""
    by_block: float
    """The part of ``high`` by the length of the block alone."""

    def describe(self, units: Units, *, is_scale_known: bool) -> str:
        """Return it as a sentence.

        >>> Promise(0.0031, 0.0052, 0.0034).describe(Units.MM, is_scale_known=True)
        'E of 3.10 µm, nine of ten under 5.20 µm; the length of the block alone makes 3.40 µm of that'
        """
        small = small_unit(units)
        block = f"; the length of the block alone makes {small.text(self.by_block)} of that"
        without = ", but for the scale: the length of the block is unknown"
        return (
            f"E of {small.text(self.e)}, nine of ten under {small.text(self.high)}"
            f"{block if is_scale_known else without}"
        )

    def as_data(self, units: Units) -> JsonObject:
        """Return it as plain data."""
        small = small_unit(units)
        return {f"{name}_{small.key}": value * small.factor for name, value in self._asdict().items()}


def promise(walk: Walk, standard: Standard, units: Units, digit: float) -> Promise:
    """Return how good the table of a walk can become, from the covariance of its readings.

    The screw is a usual one: its error bends by :data:`BEND_MM` over :data:`BEND_LENGTH_MM`. ``digit`` is the
    last digit of the dial, and the scatter of a reading. The same seed gives the same figure.
    """
    readings = tuple(
        Reading(x, way, x, each.number, block=block)
        for each in walk.placed(units)
        for x, block in [(x, 0.0) for x in each.bare] + [(x, walk.block) for x in each.over_block]
        for way in APPROACHES
    )
    e, high = _promised(readings, standard, units, digit)
    if not standard.is_length_known:
        return Promise(e, high, 0.0)
    # The straight line that the block's uncertainty adds: nine of ten are within 1.645 of its deviations.
    length = units.from_mm(standard.uncertainty_of(in_mm(walk.block, units)))
    return Promise(e, high, 1.645 * length * (walk.high - walk.low) / walk.block)


def _promised(
    readings: tuple[Reading, ...], standard: Standard, units: Units, digit: float
) -> tuple[float, float]:
    survey = Survey(readings, units, standard=standard)
    places = _places(survey)
    setups = np.array([each.setup for each in places], dtype=np.intp)
    positions = np.array([each.position for each in places])
    bend = units.from_mm(BEND_MM)
    shared = Shared(setups, ZERO * bend, _columns(places, survey))
    variance = np.full(len(places), digit**2 / len(APPROACHES))
    samples = Samples(positions, np.zeros(len(places)), variance, 0.0, shared)
    sizes = {"smooth": float(np.log(bend)), "length": float(np.log(units.from_mm(BEND_LENGTH_MM)))}
    process = with_sizes(samples, CurveKind(1.5), sizes, typical=bend)
    at = np.linspace(positions[0], positions[-1], PROMISED_AT)
    drawn = process.draws(at, PROMISED_DRAWS, np.random.default_rng(1))
    if not standard.is_length_known:
        drawn = without_slope(at, drawn)
    e, high = np.quantile(drawn.max(axis=0) - drawn.min(axis=0), (0.5, 0.9)).tolist()
    return e, high


BEND_MM: Final = 0.010
BEND_LENGTH_MM: Final = 100.0
PROMISED_AT: Final = 500
PROMISED_DRAWS: Final = 200


# --- The curve as readings


def _absolute(survey: Survey, screw: MeasuredScrew) -> Survey:
    """Return the most likely curve as readings: at each position of the walk, once in each direction."""
    readings = [
        Reading(target, way, target - correction)
        for way, values in zip(APPROACHES, (screw.means.forward, screw.means.backward), strict=True)
        for target, correction in zip(screw.means.targets, values, strict=True)
        if correction is not None
    ]
    return replace(survey, readings=tuple(readings), standard=None)
