"""A model of the screw from readings: its error at the targets and, as far as possible, between them.

The mean of both directions and half their difference (the reversal) are two separate curves
(:mod:`gateway.metrology.process`). What repeats with a revolution belongs to the screw and is in the first;
the scatter of readings is in both. Needs numpy; its users import it locally.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import atan2, degrees, hypot, inf, log, pi
from statistics import fmean
from typing import Final, NamedTuple

import numpy as np

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.build import Shape
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period, may_be_more, shown_by, unseen
from gateway.metrology.process import (
    CHANGE,
    KERNELS,
    ROUGH,
    Array,
    CurveKind,
    Process,
    Samples,
    fitted,
    jointed,
    jumped,
    likely_jumps,
)
from gateway.metrology.readings import (
    APPROACHES,
    MeanCorrections,
    Reading,
    Survey,
    by_approach,
    mean_corrections,
)
from gateway.metrology.residue import LeftOut
from gateway.metrology.wrong_runs import wrong_runs

LEAST_TARGETS: Final = 5
"""Fewer targets show nothing about the range between them."""
MOST_TARGETS: Final = 2000
"""More need minutes of calculation; they are so close that lines between them lose nothing."""
LEAST_JOINTED: Final = 9
"""With fewer targets a corner is like any other bend."""
MOST_JOINTED: Final = 500
"""With more targets a corner between two of them does not matter, and the search takes minutes."""
DRAWS: Final = 64
QUANTILES: Final = (0.05, 0.5, 0.95)
"""Of the draws: nine of ten are between the outer two."""
LEAST_SPREAD: Final = 1.75
"""Least distance of the bounds from the middle: the draws do not include kinds that were not tried."""
POSITIONS: Final = 2000
MOST_POSITIONS: Final = 8000
POSITIONS_A_PERIOD: Final = 16
SPREAD: Final = 0.3
"""Uncertainty of the reversal's scatter from the scatter of the runs, as a share."""
LEAST_SCATTER_MM: Final = 1e-6
"""Readings without any scatter are computed, or from a file with few digits."""
WORTH: Final = 4.0
"""Kinds whose logarithmic likelihood is worse by more do not count between targets."""
PLAUSIBLE: Final = 8.0
"""Repeating kinds that are worse by more do not count for the bounds: few targets favour one by chance."""
PLAUSIBLE_DRAWS: Final = 32
SIGNIFICANT: Final = 0.01
TELLING: Final = 1000.0
"""Limit of the ratio of uncertainties. A period is unknown if one half of it is this many times less certain
than the other, or both than without the other periods. It is also unknown if it is present but its worse half
may be as large as all of it."""
SAME: Final = 1e-10
"""Of the largest information: less is none."""
SEED: Final = 20
QUICK: Final = 1 / 8
"""Of the span: the length over which a repeating error changes, at the beginning of the search."""
ROUNDS: Final = 4
"""Iterations from a nut position to its drive position; each is nearer by the error's slope."""


@dataclass(frozen=True, slots=True)
class Harmonic:
    """A part of the error that repeats: ``amplitude * sin(360° * position / period + phase)``.

    ``amplitude`` is of the deviation, in the units of the readings. ``significance`` is the probability of
    such an amplitude by scatter alone (F test with 2 degrees of freedom); 0.01 and below is hardly chance.
    All three are None if the targets do not determine them: the targets meet only two opposite angles of the
    period, or show it like another given period.
    """

    period: Period
    amplitude: float | None
    phase_deg: float | None
    significance: float | None

    @property
    def is_significant(self) -> bool:
        """Whether it is hardly chance."""
        return self.significance is not None and self.significance <= SIGNIFICANT


class Jump(NamedTuple):
    """The error jumps by ``size`` between one target and the next; in the units of the readings."""

    low: float
    high: float
    size: float


@dataclass(frozen=True, slots=True)
class MeasuredScrew:
    """Readings of one axis as curves. Corrections are in ``units``; positions are those of the drive."""

    units: Units
    means: MeanCorrections
    smooth: Process
    """The mean of both directions without the repeating part."""
    harmonic: Process | None
    """The same with it; None if the targets show no given period."""
    reversal: Process | None
    """Half of forward less backward; None if only one direction was measured."""
    harmonics: tuple[Harmonic, ...]
    periods: tuple[Period, ...]
    """The given periods."""
    aliased: tuple[Period, ...]
    """Those of them that the targets do not show."""
    jumps: tuple[Jump, ...]
    """Jumps of the error between two targets."""
    unsettled: str
    """Runs that do not fit the others, in words."""
    scatter: float | None
    """Standard deviation of one reading; None if unknown."""
    kinds: tuple[tuple[Process, float], ...]
    """Every kind of curve that is nearly as good as the best, with the share of its likelihood."""
    _positions: Array
    _likely: "_Draws"
    _plausible: "tuple[_Draws, ...]"
    is_scale_known: bool = True
    """False: the readings leave the straight part of the error open. No curve and no E includes one."""
    concealed: tuple[Period, ...] | None = None
    """Periods that differences do not show; None if the readings are from one zero."""

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The shapes that can be made from these readings."""
        curves = (Shape.SMOOTH, Shape.HARMONICS) if self.harmonic is not None else (Shape.SMOOTH,)
        # Differences have no readings to draw lines through.
        return curves if self.concealed is not None else (Shape.LINES, *curves)

    def correction(self, shape: Shape, direction: Direction, at: Array) -> Array:
        """Return the correction for the drive position ``at``."""
        if shape is Shape.LINES:
            ways = [self.means.forward, self.means.backward]
            # If only one direction was measured, it is used for both.
            values = next(
                each
                for each in (ways[::-1] if direction is Direction.BACKWARD else ways)
                if any(value is not None for value in each)
            )
            points = [(x, c) for x, c in zip(self.means.targets, values, strict=True) if c is not None]
            result: Array = np.interp(at, [x for x, _ in points], [c for _, c in points])
            return result
        middle = self.harmonic if shape is Shape.HARMONICS else self.smooth
        assert middle is not None, "harmonics are fitted"
        result = middle.mean(at)
        if self.concealed is not None:
            result = result - _zero_line(middle, self._positions, is_scale_known=self.is_scale_known)(at)
        if self.reversal is not None:
            result = result + direction.value * self.reversal.mean(at)
        return result

    def table(
        self, shape: Shape, positions: Sequence[float], *, offset: float = 0.0, one_way: bool = False
    ) -> CorrectionTable:
        """Return the table with the corrections for these nut positions; ``offset`` is subtracted from each.

        The error was measured at drive positions, but a table is looked up by nut positions. So for each
        position the drive position is computed that brings the nut there.
        """
        at = np.asarray(positions, dtype=np.float64)
        curves = []
        for way in APPROACHES:
            drive = at
            for _ in range(ROUNDS):
                drive = at + self._curve(shape, way, drive, one_way=one_way) - offset
            curves.append(drive - at)
        return make_table(list(positions), curves[0].tolist(), curves[1].tolist(), self.units)

    def _curve(self, shape: Shape, way: Direction, at: Array, *, one_way: bool) -> Array:
        if not one_way:
            return self.correction(shape, way, at)
        forward, backward = (self.correction(shape, each, at) for each in APPROACHES)
        result: Array = (forward + backward) / 2
        return result

    def nut_positions(self, offset: float = 0.0) -> list[float]:
        """Return the nut position at each target, the mean of both directions, with ``offset`` at home."""
        positions = np.asarray(self.means.targets)
        both = [self.correction(Shape.LINES, way, positions) for way in APPROACHES]
        nut: list[float] = (positions - (both[0] + both[1]) / 2 + offset).tolist()
        return nut

    def misses(self, shape: Shape) -> float:
        """Return the misses of the inner targets by prediction from all others, root of the mean square.

        Both directions of a target are left out together.
        """
        errors: list[float] = []
        if shape is Shape.LINES:
            for values in (self.means.forward, self.means.backward):
                points = [(x, c) for x, c in zip(self.means.targets, values, strict=True) if c is not None]
                for (x0, c0), (x, c), (x1, c1) in zip(points, points[1:], points[2:], strict=False):
                    errors.append(c - (c0 + (c1 - c0) * (x - x0) / (x1 - x0)))
        else:
            middle = self.harmonic if shape is Shape.HARMONICS else self.smooth
            assert middle is not None, "harmonics are fitted"
            missed, _ = middle.left_out()
            reversal_error = np.zeros_like(missed)
            if self.reversal is not None and len(self.reversal.samples.positions) == len(missed):
                reversal_error, _ = self.reversal.left_out()
            errors = [*(missed + reversal_error)[1:-1].tolist(), *(missed - reversal_error)[1:-1].tolist()]
        return float(np.sqrt(np.mean(np.square(errors))))

    def leaves(self, table: CorrectionTable) -> float:
        """Return E of what a table leaves from the first target to the last, as the median of the draws.

        This value compares tables. The result for the user is :meth:`left_out`, which includes what no target
        shows.
        """
        return self._quantiles(table, self._likely)[1]

    @property
    def unseen(self) -> tuple[Period, ...]:
        """Possible periods that every target confuses with a slower curve."""
        found = unseen(self.means.targets, self.periods, self.units)
        more = self.concealed or ()
        return (*found, *(each for each in more if each not in found))

    def left_out(self, table: CorrectionTable) -> LeftOut:
        """Return E of what a table leaves everywhere between the first and the last target."""
        low, middle, high = self._quantiles(table, self._likely)
        for each in self._plausible:
            least, _, most = self._quantiles(table, each)
            low, high = min(low, least), max(high, most)
        low, high = min(low, middle / LEAST_SPREAD), max(high, middle * LEAST_SPREAD)
        high *= may_be_more(self.means.targets, self.periods, self.units)
        hidden = self.unseen
        if self.unsettled:
            return LeftOut(None, 0.0, None, hidden, self.unsettled)
        if hidden:
            return LeftOut(None, low, None, hidden)
        return LeftOut(middle, low, high)

    @property
    def ways(self) -> tuple[Direction, ...]:
        """The directions that were measured."""
        if self.reversal is not None:
            return APPROACHES
        return APPROACHES[:1] if any(value is not None for value in self.means.forward) else APPROACHES[1:]

    def _quantiles(self, table: CorrectionTable, drawn: "_Draws") -> tuple[float, float, float]:
        """Return quantiles of E over curves that the readings allow.

        Each curve counts as a whole: with both directions, and with the corrections at the drive positions of
        the table.
        """
        here = table.in_units(self.units)
        added = [
            np.interp(self._positions, np.asarray(here.positions), np.asarray(curve))
            for curve in (here.forward, here.backward)
        ]
        ways = [APPROACHES.index(way) for way in self.ways]
        left = np.vstack([added[way][:, None] - _at(drawn[way], self._positions, added[way]) for way in ways])
        if not self.is_scale_known:
            left = without_slope(np.tile(self._positions, len(ways)), left)
        low, middle, high = np.quantile(left.max(axis=0) - left.min(axis=0), QUANTILES).tolist()
        return low, middle, high


class _Draws(NamedTuple):
    """Curves that the readings allow, one a column, at the positions of a screw."""

    forward: Array
    backward: Array


def _zero_line(process: Process, positions: Array, *, is_scale_known: bool) -> Callable[[Array], Array]:
    """Return what differences leave open: a constant, and with an unknown scale a straight line.

    Without it a curve is 0 at the first of the positions.
    """
    start, slope = positions[0], 0.0
    if not is_scale_known:
        slope = float(np.polyfit(positions - start, process.mean(positions), 1)[0])
    first = float(process.mean(positions[:1])[0])
    return lambda at: first + slope * (at - start)


def without_slope(positions: Array, curves: Array) -> Array:
    """Return curves, one a column, each without its best straight slope."""
    middle = positions - positions.mean()
    result: Array = curves - np.outer(middle, middle @ curves / float(middle @ middle))
    return result


def _at(curves: Array, positions: Array, moved: Array) -> Array:
    """Return the curves at the drive positions: ``moved`` from each position."""
    step = positions[1] - positions[0]
    exact = np.clip((positions + moved - positions[0]) / step, 0.0, len(positions) - 1.0)
    below = np.minimum(exact.astype(np.intp), len(positions) - 2)
    share = (exact - below)[:, None]
    result: Array = curves[below] * (1.0 - share) + curves[below + 1] * share
    return result


def screw_of(readings: Iterable[Reading], units: Units, periods: Iterable[Period] = ()) -> MeasuredScrew:
    """Fit the curves.

    Raises:
        ReadingsError: readings without a number or a direction; fewer than five targets, or more than useful.
    """
    all_readings = tuple(readings)
    means = mean_corrections(all_readings)
    count = len(means.targets)
    if not LEAST_TARGETS <= count <= MOST_TARGETS:
        raise ReadingsError(
            f"{count} targets: the error between targets can be judged with {LEAST_TARGETS} to "
            f"{MOST_TARGETS} targets"
        )
    wrong = wrong_runs(Survey(all_readings, units))
    unsettled = "; ".join(each.describe(units) for each in wrong)
    scatter, counts = (
        _scatter(all_readings),
        {position: len(group) for position, group in by_approach(all_readings).items()},
    )
    if scatter is not None:
        scatter = max(scatter, units.from_mm(LEAST_SCATTER_MM))
    reversal = _reversal(means, counts, scatter)
    middle, is_guessed = _middle(means, counts, scatter, reversal)
    given = tuple(periods)
    shown, aliased = shown_by(means.targets, given)
    kinds = _fit_all(middle, tuple(period.length for period in shown), has_scatter=scatter is not None)
    # The correction removes the deviation.
    jumps = tuple(Jump(low, high, -rise) for low, high, rise in likely_jumps(kinds))
    smooth = min((each for each in kinds if not each.kind.periods), key=lambda each: each.score)
    repeating = [each for each in kinds if each.kind.periods]
    harmonic = min(repeating, key=lambda each: each.score) if repeating else None
    positions = _positions(middle, [period.length for period in shown])
    near = _shares(kinds)
    likely, plausible = _draw(kinds, near, reversal, positions)
    if scatter is None and is_guessed and reversal is not None:
        scatter = float(np.exp(reversal.sizes["noise"])) * 2**0.5
    return MeasuredScrew(
        units, means, smooth, harmonic, reversal, _harmonics(harmonic, shown), given, aliased, jumps,
        unsettled, scatter, near, positions, likely, plausible,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Differences:
    """Samples of readings that are not from one zero (:mod:`gateway.metrology.differences`)."""

    units: Units
    middle: Samples
    """Mean correction of both directions, with what the samples share."""
    reversal: Process | None
    scatter: float | None
    """Standard deviation of a middle by the scatter of the readings; None if unknown."""
    periods: tuple[Period, ...]
    concealed: tuple[Period, ...]
    """Possible periods that the differences do not show."""
    is_scale_known: bool
    orders: tuple[float, ...]
    """Kinds of curves to be tried."""


def screw_of_differences(given: Differences) -> MeasuredScrew:
    """Fit the curves to differences; the curve begins with the correction 0."""
    middle, periods = given.middle, given.periods
    targets = tuple(sorted(set(middle.positions.tolist())))
    shown = tuple(each for each in shown_by(targets, periods)[0] if each not in given.concealed)
    lengths = tuple(period.length for period in shown)
    kinds = []
    for order in given.orders:
        plain = fitted(middle, CurveKind(order))
        kinds += [plain, fitted(middle, CurveKind(order, has_short=True), plain.sizes)]
        if lengths:
            steady = fitted(middle, CurveKind(order, periods=lengths))
            # From a slow change the search finds none at all.
            start = {**steady.sizes, CHANGE: log(middle.span * QUICK)}
            changing = fitted(middle, CurveKind(order, periods=lengths, changes=True), start)
            kinds += [steady, changing]
    smooth = min((each for each in kinds if not each.kind.periods), key=lambda each: each.score)
    repeating = [each for each in kinds if each.kind.periods]
    harmonic = min(repeating, key=lambda each: each.score) if repeating else None
    positions = _positions(middle, lengths)
    near = _shares(kinds)
    likely, plausible = _draw(kinds, near, given.reversal, positions)
    best = smooth if harmonic is None or smooth.score < harmonic.score else harmonic
    at = np.array(targets)
    mean = best.mean(at) - _zero_line(best, positions, is_scale_known=given.is_scale_known)(at)
    half = np.zeros_like(at) if given.reversal is None else given.reversal.mean(at)
    means = MeanCorrections(targets, tuple((mean + half).tolist()), tuple((mean - half).tolist()))
    aliased = tuple(each for each in periods if each not in shown)
    return MeasuredScrew(
        given.units, means, smooth, harmonic, given.reversal, _harmonics(harmonic, shown), periods, aliased,
        (), "", given.scatter, near, positions, likely, plausible, given.is_scale_known, given.concealed,
    )  # fmt: skip


def _scatter(readings: Sequence[Reading]) -> float | None:
    """Standard deviation of one reading among its runs, without the shift and the stretch of a whole run."""
    several = [group for group in by_approach(readings).values() if len(group) >= 2]
    runs: dict[tuple[int, Direction], list[tuple[float, float]]] = {}
    for group in several:
        mean = fmean(each.deviation for each in group)
        for each in group:
            runs.setdefault((each.run, each.direction), []).append((each.target, each.deviation - mean))
    left, lines = 0.0, 0
    for rests in runs.values():
        positions, values = (np.array(column) for column in zip(*rests, strict=True))
        if len(rests) >= LEAST_TARGETS:
            values = values - np.polyval(np.polyfit(positions, values, 1), positions)
            lines += 1
        left += float(values @ values)
    # The lines of all runs of a direction add up to zero, as their rests do.
    free = sum(map(len, several)) - len(several) - 2 * max(lines - 2, 0)
    if free < LEAST_TARGETS:
        return None
    return float((left / free) ** 0.5)


def _reversal(
    means: MeanCorrections, counts: dict[tuple[float, Direction], int], scatter: float | None
) -> Process | None:
    """Fit half of forward less backward at the targets that have both."""
    both = [
        (x, (f - b) / 2, _variance(counts, x))
        for x, f, b in zip(means.targets, means.forward, means.backward, strict=True)
        if f is not None and b is not None
    ]
    if len(both) < LEAST_TARGETS - 1:
        return None
    positions, values, shares = (np.array(column) for column in zip(*both, strict=True))
    if scatter is None:
        samples = Samples(positions, values, shares * _guess(values), noise_spread=inf)
        kinds = [CurveKind(order) for order in KERNELS]
    else:
        samples = Samples(positions, values, shares * scatter**2, noise_spread=SPREAD)
        kinds = [CurveKind(order) for order in KERNELS]
    return min((fitted(samples, kind) for kind in kinds), key=lambda each: each.score)


def _variance(counts: dict[tuple[float, Direction], int], target: float) -> float:
    """Share of the variance of one reading in the mean of both directions."""
    ways = [counts[target, way] for way in APPROACHES if (target, way) in counts]
    return sum(1.0 / count for count in ways) / len(ways) ** 2


def _guess(values: Array) -> float:
    """Return a start value: a tenth of the variation of the values."""
    return max(float(values.var()) * 0.01, 1e-18)


def _middle(
    means: MeanCorrections,
    counts: dict[tuple[float, Direction], int],
    scatter: float | None,
    reversal: Process | None,
) -> tuple[Samples, bool]:
    """Return the mean of both directions at all targets; a missing one is replaced by the reversal."""
    positions = np.asarray(means.targets)
    half = reversal.mean(positions) if reversal is not None else np.zeros_like(positions)
    values = np.array(
        [
            fmean(
                side
                for side in (
                    None if f is None else (f + b) / 2 if b is not None else f - h,
                    None if b is None else (f + b) / 2 if f is not None else b + h,
                )
                if side is not None
            )
            for f, b, h in zip(means.forward, means.backward, half.tolist(), strict=True)
        ]
    )
    shares = np.array([_variance(counts, x) for x in means.targets])
    if scatter is not None:
        return Samples(positions, values, shares * scatter**2), False
    if reversal is not None and "noise" in reversal.sizes:
        # One run: the scatter of the reversal is that of the readings, because no screw has a short wave in
        # it.
        noise = float(np.exp(2 * reversal.sizes["noise"]))
        spread = 1.0 / (2.0 * max(len(reversal.samples.positions) - 3, 2)) ** 0.5
        return Samples(positions, values, noise * shares / shares.mean(), noise_spread=spread), True
    return Samples(positions, values, shares * _guess(values), noise_spread=inf), True


def _fit_all(samples: Samples, periods: tuple[float, ...], *, has_scatter: bool) -> list[Process]:
    shorts = (False, True) if has_scatter or samples.noise_spread < inf else (False,)
    smooth = [fitted(samples, CurveKind(order, short)) for order in KERNELS for short in shorts]
    if LEAST_JOINTED <= len(samples.positions) <= MOST_JOINTED:
        smooth += jointed(samples, smooth)
    if not periods:
        return [*smooth, *_jumped(samples, smooth)]
    orders = [order for order in KERNELS if order != ROUGH]
    smooth_sizes = {
        (each.kind.order, each.kind.has_short): each.sizes for each in smooth if each.kind.joint is None
    }
    several = len(samples.positions) >= 3 * (3 + 2 * len(periods))
    repeating = [
        fitted(
            samples, CurveKind(order, short, periods, changes), _usual(smooth_sizes[order, short], samples)
        )
        for order in orders
        for short in shorts
        for changes in ((False, True) if several else (False,))
    ]
    return [*smooth, *repeating, *_jumped(samples, [*smooth, *repeating])]


def _jumped(samples: Samples, kinds: Sequence[Process]) -> list[Process]:
    return jumped(samples, kinds) if LEAST_JOINTED <= len(samples.positions) <= MOST_JOINTED else []


def _usual(sizes: object, samples: Samples) -> dict[str, float] | None:
    """Return new start values if a smooth curve went through every wave."""
    usual = dict(sizes) if isinstance(sizes, dict) else {}
    return None if usual.get("length", 0.0) < np.log(samples.gap * 3) else usual


def _positions(samples: Samples, periods: Sequence[float]) -> Array:
    """Return the positions of drawn curves, so close that every period is followed."""
    count = max(POSITIONS, POSITIONS_A_PERIOD * samples.span / min(periods, default=samples.span))
    return np.linspace(samples.positions[0], samples.positions[-1], int(min(count, MOST_POSITIONS)))


def _shares(kinds: Sequence[Process]) -> tuple[tuple[Process, float], ...]:
    """Return every kind that is nearly as good as the best, with the share of its likelihood."""
    best = min(each.score for each in kinds)
    near = [each for each in kinds if each.score - best < WORTH]
    weights = np.array([np.exp(best - each.score) for each in near])
    return tuple(zip(near, (weights / weights.sum()).tolist(), strict=True))


def _draw(
    kinds: Sequence[Process],
    near: Sequence[tuple[Process, float]],
    reversal: Process | None,
    positions: Array,
) -> tuple[_Draws, tuple[_Draws, ...]]:
    """Draw curves from the kinds that are nearly as good as the best, in proportion to their likelihood.

    Beside them are the curves of each repeating kind that may be right, whatever its likelihood. Few targets
    show only by chance whether the repeating part varies along the screw; the bounds must not depend on that.
    """
    best = min(each.score for each in kinds)
    shares = np.floor(np.cumsum([share for _, share in near]) * DRAWS + 0.5).astype(int)
    random = np.random.default_rng(SEED)
    counts = zip([each for each, _ in near], np.diff(shares, prepend=0), strict=True)
    middle = np.hstack([each.draws(positions, int(count), random) for each, count in counts if count])

    half = np.zeros_like(middle) if reversal is None else reversal.draws(positions, middle.shape[1], random)
    may_be = [
        (each.draws(positions, PLAUSIBLE_DRAWS, random), half[:, :PLAUSIBLE_DRAWS])
        for each in kinds
        if each.kind.periods and each.score - best < PLAUSIBLE
    ]
    likely, *plausible = [_Draws(each + side, each - side) for each, side in ((middle, half), *may_be)]
    return likely, tuple(plausible)


def _harmonics(process: Process | None, periods: Sequence[Period]) -> tuple[Harmonic, ...]:
    """Fit each period with one amplitude, beside the fixed smooth part (generalised least squares)."""
    if process is None:
        return ()
    samples = process.samples
    columns = []
    for period in periods:
        angle = 2 * pi * samples.positions / period.length
        columns += [np.sin(angle), np.cos(angle)]
    design = np.column_stack(columns)
    inverse = np.linalg.inv(process.without_periods())
    information = design.T @ inverse @ design
    # The correction removes the deviation. Parts that the targets cannot separate are not used.
    parts = -np.linalg.pinv(information, rcond=SAME, hermitian=True) @ (design.T @ inverse @ samples.values)
    rest = samples.values + design @ parts
    free = max(len(samples.positions) - 2 - len(columns), 1)
    scale = max(float(rest @ inverse @ rest) / free, 1.0)
    found = []
    for index, period in enumerate(periods):
        own = [2 * index, 2 * index + 1]
        alone, beside = information[np.ix_(own, own)], _beside_others(information, own)
        least, most = float(np.linalg.eigvalsh(beside)[0]), float(np.linalg.eigvalsh(alone)[-1])
        sine, cosine = (float(part) for part in parts[own])
        size = hypot(sine, cosine)
        ratio = float(parts[own] @ beside @ parts[own]) / (2 * scale)
        chance = (1.0 + 2.0 * max(ratio, 0.0) / free) ** (-free / 2)
        is_open = least * TELLING**2 <= most
        if is_open or (chance <= SIGNIFICANT and least * size**2 < scale):
            found.append(Harmonic(period, None, None, None))
            continue
        found.append(Harmonic(period, size, degrees(atan2(cosine, sine)) % 360.0, chance))
    return tuple(found)


def _beside_others(information: Array, own: Sequence[int]) -> Array:
    """Return the information about two parts if all others must be fitted too."""
    others = [each for each in range(len(information)) if each not in own]
    shared = information[np.ix_(own, others)]
    result: Array = (
        information[np.ix_(own, own)]
        - shared @ np.linalg.pinv(information[np.ix_(others, others)], rcond=SAME, hermitian=True) @ shared.T
    )
    return result
