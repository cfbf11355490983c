"""A screw's error as a random curve: its smoothness, what repeats, and its uncertainty.

There are no readings between targets. The error there is predicted by the kind of curve that explains the
readings best (universal kriging, a Gaussian process; Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006). Its parts are: a straight line; a smooth part (Matérn kernels from a broken line to an
analytic curve); what repeats with a period; what is too short for the distance of the targets; and the
scatter of the readings. The sizes may change slowly along the screw; they are those of the largest marginal
likelihood. ``left_out`` is exact: each value predicted from all others in closed form (ibid., 5.12).

Numbers are in the units of the readings. This module needs numpy and is imported where it is used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf, log, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUGH: Final = 0.5
"""Kernel of a curve that is a broken line between its points."""
ANALYTIC: Final = inf
"""Kernel of a curve without any corner."""
KERNELS: Final = (ROUGH, 1.5, 2.5, ANALYTIC)
"""Orders of Matérn kernels."""
TREND: Final = 100.0
"""Variance of offset and slope, in those of what a straight line leaves: they are free."""
MOST_OPEN: Final = 100.0
"""A straight part that is more open, in what a straight line leaves, could not be solved for in doubles."""
MOST_TUNED: Final = 120
"""The sizes are fitted with at most this many of the targets; these are enough."""
FEATURES: Final = 240
PAIR: Final = (0.9, 0.44)
"""What is too short to be resolved consists of two waves: their shares, with squares that sum to 1."""
SHORT_TURNS: Final = (2.0, 8.0)
"""Their turns in the mean distance of the samples are between these, all equally likely."""
MODULATED: Final = 60
LOCAL: Final = 1.6
"""By scatter alone, three neighbours rarely miss by more than this many times the expected distance."""
JOINT_ROUNDS: Final = 3
JOINT_WORTH: Final = 3.0
"""A joint must improve the explanation of the samples by this logarithm of likelihoods."""
JOINT_PARTS: Final = 8
"""Parts of a gap between targets: the resolution of a joint's position."""
MOST_JOINTS: Final = 8
"""This many positions represent all possible positions of a joint."""
MOST_JUMPS: Final = 3
JUMP_ROUNDS: Final = 2
JUMP_WORTH: Final = 3.0
"""A further jump needs the same improvement as a joint."""
JUMP_NAMED: Final = 0.5
"""A jump must improve the explanation by this much before its position is named."""
JUMP_POSITIONS: Final = 8
"""All positions of a jump between its two targets are equally likely: this many represent them."""
_FINEST: Final = 0.08
_FIRST: Final = 1.2
_ROUNDS: Final = 60

CHANGE: Final = "change"
"""Name of the size that says over which length the repeating parts change."""
_SMOOTH, _LENGTH, _SHORT, _NOISE = "smooth", "length", "short", "noise"


@dataclass(frozen=True, slots=True)
class Shared:
    """What values have in common beside the curve: unknown zeros of an instrument, an unknown length.

    ``setups`` numbers the set-up of each value. All values of one have the same unknown zero, of the standard
    deviation ``zero``. A column of ``columns`` is the effect of another unknown amount on each value, for one
    standard deviation of it.
    """

    setups: NDArray[np.intp]
    zero: float
    columns: Array

    def covariance(self) -> Array:
        """Return the covariance that it gives the values."""
        is_same = self.setups[:, None] == self.setups[None, :]
        result: Array = self.zero**2 * is_same + self.columns @ self.columns.T
        return result

    def draws(self, count: int, random: np.random.Generator) -> Array:
        """Return what it adds to the values, one draw a column."""
        zeros = self.zero * random.standard_normal((int(self.setups.max()) + 1, count))
        result: Array = zeros[self.setups] + self.columns @ random.standard_normal(
            (self.columns.shape[1], count)
        )
        return result

    def of(self, chosen: NDArray[np.intp]) -> "Shared":
        """Return it for the chosen values only."""
        return Shared(self.setups[chosen], self.zero, self.columns[chosen])


@dataclass(frozen=True, slots=True)
class Samples:
    """Values at ascending positions, and the variance that the scatter of readings gives each.

    ``noise_spread`` is the uncertainty of that variance, as the standard deviation of its logarithm's half.
    0: it is known. Infinity: it must be fitted too (then ``variance`` has the proportions). ``shared``: the
    values are not from one zero; only those of one set-up compare directly.
    """

    positions: Array
    values: Array
    variance: Array
    noise_spread: float = 0.0
    shared: Shared | None = None

    @property
    def span(self) -> float:
        """From the first position to the last."""
        return float(self.positions[-1] - self.positions[0])

    @property
    def open_line(self) -> float:
        """Size at the ends of the straight part that shared amounts leave open, as a block's length does."""
        if self.shared is None or not self.shared.columns.size:
            return 0.0
        _, setups = np.unique(self.shared.setups, return_inverse=True)
        middles = np.bincount(setups, self.positions) / np.bincount(setups)
        along = self.positions - middles[setups]
        slopes = along @ self.shared.columns / float(along @ along)
        return float(np.linalg.norm(slopes)) * self.span / 2

    @property
    def gap(self) -> float:
        """Mean distance of the positions."""
        return self.span / (len(self.positions) - 1)


@dataclass(frozen=True, slots=True)
class CurveKind:
    """The parts of a curve. ``periods`` repeat; ``changes``: their sizes change slowly along the screw.

    ``joint`` is a position at which the slope changes, as at the joint of two screws or scales. ``jumps`` are
    those at which the curve itself changes, as between two butted racks.
    """

    order: float
    has_short: bool = False
    periods: tuple[float, ...] = ()
    changes: bool = False
    joint: float | None = None
    jumps: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Process:
    """A curve with its sizes, given the samples."""

    kind: CurveKind
    samples: Samples
    sizes: Mapping[str, float]
    """Logarithms."""
    score: float
    """The smaller, the better it explains the samples."""
    _line: Array = field(repr=False)
    _free: float = field(repr=False)
    _inverse: Array = field(repr=False)
    _weights: Array = field(repr=False)

    def mean(self, at: Array) -> Array:
        """Return the most likely curve for the samples."""
        return self._straight(at) + self._reach(at) @ self._weights

    def left_out(self) -> tuple[Array, Array]:
        """Return each sample less its prediction from all others, and the expected variance."""
        precision = np.diag(self._inverse)
        return self._weights / precision, 1.0 / precision

    def left_out_together(self, own: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return some samples less their prediction from all others, and the expected covariance."""
        expected: Array = np.linalg.inv(self._inverse[np.ix_(own, own)]).astype(np.float64)
        return expected @ self._weights[own], expected

    def draws(self, at: Array, count: int, random: np.random.Generator) -> Array:
        """Return curves, one a column, that the samples allow with equal likelihood (Matheron's rule)."""
        positions = self.samples.positions
        all_positions = np.concatenate((positions, at))
        curves = self._free_curves(all_positions, count, random)
        noise = np.sqrt(self.noise())[:, None] * random.standard_normal((len(positions), count))
        if self.samples.shared is not None:
            noise += self.samples.shared.draws(count, random)
        rest = (self.samples.values - self._straight(positions))[:, None] - curves[: len(positions)] - noise
        drawn = (
            self._straight(at)[:, None] + curves[len(positions) :] + self._reach(at) @ (self._inverse @ rest)
        )
        mean = self.mean(at)[:, None]
        result: Array = mean + self.surprise(at)[:, None] * (drawn - mean)
        return result

    def covariance(self, one: Array, other: Array) -> Array:
        """Return the covariance of the curve at two lists of positions, given the samples.

        It is that of :meth:`draws` (ibid., 2.26). What is too short for the samples is in it as unknown.
        """
        sizes, signed = self.sizes, one[:, None] - other[None, :]
        found: Array = _kernel(self.kind, sizes, _Distances.of(self.kind, signed))
        found += self._free * _trend(self.samples, self.kind, one) @ _trend(self.samples, self.kind, other).T
        found -= self._reach(one) @ (self._inverse @ self._reach(other).T)
        if self.kind.has_short:
            found += np.exp(2 * sizes[_SHORT]) * _short_kernel(signed / self.samples.gap)
        return self.surprise(one)[:, None] * found * self.surprise(other)

    def variance(self, at: Array) -> Array:
        """Return the variance of the curve at positions, given the samples: the diagonal of that."""
        sizes, reach = self.sizes, self._reach(at)
        found: Array = _kernel(self.kind, sizes, _Distances.of(self.kind, np.zeros((1, 1))))[0, 0]
        found = found + self._free * np.square(_trend(self.samples, self.kind, at)).sum(axis=1)
        found -= np.einsum("ij,ij->i", reach @ self._inverse, reach)
        if self.kind.has_short:
            found += np.exp(2 * sizes[_SHORT])
        # Differences of large numbers: at a sample without scatter nothing is left but their rounding.
        result: Array = self.surprise(at) ** 2 * np.maximum(found, 0.0)
        return result

    def surprise(self, at: Array) -> Array:
        """Return the ratio of left-out misses to the expected ones, at least 1.

        This detects sizes that fit the samples too well, and positions at which a screw differs from the rest
        of it, as at a joint: the misses of left-out neighbours there count for the positions between them.
        Few samples that fit by chance prove nothing.
        """
        missed, expected = self.left_out()
        squares = missed**2 / expected
        around = np.convolve(squares, np.ones(3) / 3, mode="same")
        here = np.sqrt(np.maximum(squares.mean(), around / LOCAL**2))
        result: Array = np.maximum(np.interp(at, self.samples.positions, here), 1.0)
        return result

    def without_periods(self) -> Array:
        """Return the covariance of the samples without what repeats."""
        bare = replace(self.kind, periods=(), changes=False)
        return _Covariance.of(self.samples, bare, self._free).at(self.sizes)

    def _straight(self, at: Array) -> Array:
        middle = self.samples.positions.mean()
        result: Array = self._line[0] + self._line[1] * (at - middle)
        return result

    def _reach(self, at: Array) -> Array:
        positions = self.samples.positions
        distances = _Distances.of(self.kind, at[:, None] - positions[None, :])
        trend = _trend(self.samples, self.kind, at) @ _trend(self.samples, self.kind, positions).T
        result: Array = _kernel(self.kind, self.sizes, distances) + self._free * trend
        return result

    def noise(self) -> Array:
        """Return the variance that the scatter of readings gives each sample."""
        return _noise_variance(self.samples, self.sizes)

    def shared_given(self, at: Array) -> tuple[Array, Array]:
        """Return what the samples tell of the other amounts that they share, in their standard deviations.

        First the covariance of the curve at positions with each, then that of the amounts.
        """
        assert self.samples.shared is not None
        columns = self.samples.shared.columns
        known = self._inverse @ columns
        return -self.surprise(at)[:, None] * (self._reach(at) @ known), np.eye(
            columns.shape[1]
        ) - columns.T @ known

    def shared_draws(self, curves: Array, random: np.random.Generator) -> Array:
        """Return these amounts less the expected ones, for drawn curves at the positions of the samples."""
        shared = self.samples.shared
        assert shared is not None
        covariance = shared.covariance() + np.diag(self.noise())
        known = np.linalg.solve(covariance, shared.columns)
        rest = np.eye(shared.columns.shape[1]) - shared.columns.T @ known
        result: Array = known.T @ (self.samples.values[:, None] - curves)
        result -= (shared.columns.T @ self._weights)[:, None]
        result += np.linalg.cholesky(rest + 1e-12 * np.eye(len(rest))) @ random.standard_normal(result.shape)
        return result

    def _free_curves(self, at: Array, count: int, random: np.random.Generator) -> Array:
        kind, sizes = self.kind, self.sizes
        order = FEATURES if kind.order == ANALYTIC else 2 * kind.order
        wide = np.ones(FEATURES) if kind.order == ANALYTIC else random.chisquare(order, FEATURES) / order
        waves = random.standard_normal(FEATURES) / np.sqrt(wide) / np.exp(sizes[_LENGTH])
        curves: Array = np.exp(sizes[_SMOOTH]) * _random_waves(at, waves, count, random)
        for index, period in enumerate(kind.periods):
            shift = random.standard_normal(MODULATED) / np.exp(sizes[CHANGE]) if kind.changes else np.zeros(1)
            curves += np.exp(sizes[_period(index)]) * _random_waves(
                at, 2 * pi / period + shift, count, random
            )
        trend = _trend(self.samples, kind, at)
        curves += trend @ (np.sqrt(self._free) * random.standard_normal((trend.shape[1], count)))
        if kind.has_short:
            curves += np.exp(sizes[_SHORT]) * self._short_waves(at, count, random)
        return curves

    def _short_waves(self, at: Array, count: int, random: np.random.Generator) -> Array:
        """Return waves too short for the targets: nearly always they repeat, with one period or two."""
        total: Array = np.zeros((len(at), count))
        for share in PAIR:
            periods = self.samples.gap / random.uniform(*SHORT_TURNS, count)
            phases = random.uniform(0.0, 2 * pi, count)
            total += share * 2**0.5 * np.sin(2 * pi * at[:, None] / periods + phases)
        return total


def fitted(samples: Samples, kind: CurveKind, start: Mapping[str, float] | None = None) -> Process:
    """Find the sizes with which a kind of curve explains the samples best, beginning at ``start``."""
    _, rest, typical = _about_line(samples)
    search = _Search(_thinned(samples, rest), kind, typical)
    starts = [dict(start)] if start else []
    lengths = (samples.span / 3, samples.span / 8, samples.gap * 1.5)
    starts += [search.usual(length) for length in (lengths[:1] if start else lengths)]
    _, sizes = min((search.climb(each) for each in starts), key=lambda found: found[0])
    return with_sizes(samples, kind, sizes)


def with_sizes(
    samples: Samples, kind: CurveKind, sizes: Mapping[str, float], *, typical: float | None = None
) -> Process:
    """Return a process with known sizes, and how well it explains the samples.

    ``typical`` is the size of what a straight line leaves; default: that of the samples.
    """
    line, rest, found = _about_line(samples)
    typical = found if typical is None else typical
    free = _free(samples, typical)
    inverse: Array = np.linalg.inv(_Covariance.of(samples, kind, free).at(sizes)).astype(np.float64)
    score = _Search(_thinned(samples, rest), kind, typical).cost(sizes)
    count = len(sizes) + (kind.joint is not None) + len(kind.jumps)
    score += 0.5 * log(len(samples.positions)) * count  # Schwarz's criterion: an added part must be worth it
    return Process(kind, samples, sizes, score, line, free, inverse, inverse @ rest)


def _free(samples: Samples, typical: float) -> float:
    """Return the variance of offset and slope, so large that they are free."""
    return TREND * max(typical, min(samples.open_line, MOST_OPEN * typical)) ** 2


def _about_line(samples: Samples) -> tuple[Array, Array, float]:
    """Return the straight line through the samples, their distances from it, and the size of these."""
    middle = samples.positions.mean()
    design = np.column_stack((np.ones_like(samples.positions), samples.positions - middle))
    line, *_ = np.linalg.lstsq(design, samples.values, rcond=None)
    rest = samples.values - design @ line
    typical = max(float(rest.std()), float(np.sqrt(samples.variance.mean())), 1e-12 * samples.span)
    return line, rest, typical


def jointed(samples: Samples, smooth: Sequence[Process]) -> list[Process]:
    """Return the processes with a joint, one for each possible position, or nothing.

    At a change of slope, a smooth curve rounds the corner and misses its neighbours. The search takes the
    position where a change of slope explains most of the rest, twice, each time fitting the sizes of the
    smooth part again. All likely positions stay, each as its own process.
    """
    best = min(smooth, key=lambda each: each.score)
    positions = _between(samples)
    found: dict[float, Process] = {}
    process = best
    for _ in range(JOINT_ROUNDS):
        at = max(positions, key=lambda position: _gain(process, position))
        order = ANALYTIC if process is best else process.kind.order
        tried = [
            fitted(samples, CurveKind(each, best.kind.has_short, joint=at), best.sizes)
            for each in {order, 1.5}
        ]
        process = min(tried, key=lambda each: each.score)
        found[at] = process
    chosen = min(found.values(), key=lambda each: each.score)
    if chosen.score + log(len(positions)) > best.score - JOINT_WORTH:
        return []
    wide = samples.gap / JOINT_PARTS
    near = _likely(chosen, [chosen.kind.joint or 0.0], _between(samples, JOINT_PARTS))
    if len(near) < JOINT_PARTS:
        around = [each.kind.joint or 0.0 for each in near]
        finer = np.arange(min(around) - wide, max(around) + wide, wide / JOINT_PARTS).tolist()
        near = _likely(chosen, around, finer)
    near = near[:: ceil(len(near) / MOST_JOINTS)]
    least = min(each.score for each in near)
    # One joint at one of these positions: together they have its likelihood.
    share = log(sum(np.exp(least - each.score) for each in near)) - (least - chosen.score)
    return [replace(each, score=each.score + max(share, 0.0) + log(len(positions))) for each in near]


def jumped(samples: Samples, candidates: Sequence[Process]) -> list[Process]:
    """Return the processes with jumps between neighbours.

    A jump shows in the left-out samples: both of its neighbours are missed, to opposite sides. The search
    takes the position where a step explains most of the rest, fitting the sizes again. Few samples hardly
    distinguish a jump from a short wave: then both count for the range between them.
    """
    best = min((each for each in candidates if each.kind.joint is None), key=lambda each: each.score)
    middles = ((samples.positions[1:-2] + samples.positions[2:-1]) / 2).tolist()
    chosen = _with_jump(best, best, middles)
    for _ in range(MOST_JUMPS - 1):
        further = _with_jump(chosen, best, middles)
        if further.score > chosen.score - JUMP_WORTH:
            break
        chosen = further
    edges = [samples.positions[index : index + 2] for index in _gaps(samples, chosen.kind.jumps)]
    spread = []
    for index in range(JUMP_POSITIONS // 2, JUMP_POSITIONS // 2 + JUMP_POSITIONS):
        shares = [
            ((index + 3 * number) % JUMP_POSITIONS + 0.5) / JUMP_POSITIONS for number in range(len(edges))
        ]
        positions = (
            float(low + share * (high - low)) for share, (low, high) in zip(shares, edges, strict=True)
        )
        spread.append(with_sizes(samples, replace(chosen.kind, jumps=tuple(positions)), chosen.sizes))
    # All positions between its targets explain the samples equally: together they are one jump.
    return [replace(each, score=chosen.score + log(JUMP_POSITIONS)) for each in spread]


def _with_jump(process: Process, best: Process, middles: Sequence[float]) -> Process:
    """Return the process with one more jump, where it explains most; ``best`` has none."""
    samples, found, bare = process.samples, process, process
    for _ in range(JUMP_ROUNDS):
        gains = {position: _explains(bare, _step(samples.positions, position)) for position in middles}
        at = max(gains, key=gains.__getitem__)
        if at in found.kind.jumps:
            break
        jumps = tuple(sorted({*process.kind.jumps, at}))
        tried = [
            fitted(samples, replace(best.kind, order=order, jumps=jumps), process.sizes)
            for order in dict.fromkeys((best.kind.order, 1.5, ANALYTIC))
        ]
        found = min([*tried, *([found] if found is not process else [])], key=lambda each: each.score)
        bare = with_sizes(samples, replace(found.kind, jumps=process.kind.jumps), found.sizes)
    return replace(found, score=found.score + log(len(middles)))


def likely_jumps(candidates: Sequence[Process]) -> list[tuple[float, float, float]]:
    """Return the two samples around each jump of the curve, and its rise there.

    Empty if the samples are explained as well without a jump.
    """
    with_jumps = [each for each in candidates if each.kind.jumps]
    if not with_jumps:
        return []
    process = with_jumps[0]
    least = min(each.score for each in candidates if not each.kind.jumps)
    if process.score - log(JUMP_POSITIONS) > least - JUMP_NAMED:
        return []
    positions = process.samples.positions
    found = []
    for index, position in zip(_gaps(process.samples, process.kind.jumps), process.kind.jumps, strict=True):
        near = 1e-9 * process.samples.span
        before, behind = process.mean(np.array([position - near, position + near])).tolist()
        found.append((float(positions[index]), float(positions[index + 1]), behind - before))
    return found


def _gaps(samples: Samples, jumps: Sequence[float]) -> list[int]:
    """Return the index of the sample before each jump."""
    return [int(np.searchsorted(samples.positions, position)) - 1 for position in jumps]


def _step(at: Array, position: float) -> Array:
    result: Array = (at > position).astype(np.float64)
    return result


def _likely(process: Process, joints: list[float], positions: list[float]) -> list[Process]:
    """Return the same curve with its joint at each of these positions at which it is likely."""
    bare = _moved(process, None)
    gains = {position: _gain(bare, position) / 2 for position in {*joints, *positions}}
    most = max(gains.values())
    # The gain from a change of slope is cheap to compute, and close to that of the likelihood itself.
    worth = {position for position, gain in gains.items() if gain > most - 2 * JOINT_WORTH}
    found = [_moved(process, position) for position in sorted({*joints, *worth})]
    least = min(each.score for each in found)
    return [each for each in found if each.score < least + JOINT_WORTH]


def _between(samples: Samples, parts: int = 3) -> list[float]:
    """Return positions between the inner samples; beyond them, nothing shows a change of slope."""
    inner = samples.positions[1:-1]
    shares = (np.arange(parts) + 0.5) / parts
    result: list[float] = (inner[:-1, None] + shares * np.diff(inner)[:, None]).ravel().tolist()
    return result


def _gain(process: Process, position: float) -> float:
    """Return the gain in likelihood from a change of slope at a position."""
    return _explains(process, np.maximum(process.samples.positions - position, 0.0))


def _explains(process: Process, column: Array) -> float:
    """Return the gain in likelihood from a further column of the trend."""
    whitened = process._inverse @ column  # noqa: SLF001 - a function of this module
    return float((process._weights @ column) ** 2 / (column @ whitened))  # noqa: SLF001


def _moved(process: Process, position: float | None) -> Process:
    """Return the same curve with another joint, or without one."""
    return with_sizes(process.samples, replace(process.kind, joint=position), process.sizes)


def _thinned(samples: Samples, rest: Array) -> Samples:
    """Return the samples for fitting the sizes; of many a random choice, so that no period is aliased."""
    count, shared = len(samples.positions), samples.shared
    chosen = np.arange(count)
    if count > MOST_TUNED and shared is None:
        chosen = np.sort(np.random.default_rng(count).choice(count, MOST_TUNED, replace=False))
    elif count > MOST_TUNED and shared is not None:
        # A value without the others of its set-up shows nothing: whole set-ups are chosen.
        setups = np.unique(shared.setups)
        kept = np.random.default_rng(count).choice(
            setups, max(len(setups) * MOST_TUNED // count, 2), replace=False
        )
        chosen = np.flatnonzero(np.isin(shared.setups, kept))
    return Samples(
        samples.positions[chosen],
        rest[chosen],
        samples.variance[chosen],
        samples.noise_spread,
        None if shared is None else shared.of(chosen),
    )


class _Search:
    """The likelihood of sizes, and the search for its maximum."""

    def __init__(self, samples: Samples, kind: CurveKind, typical: float) -> None:
        self._samples = samples
        self._kind = kind
        self._typical = typical
        self._covariance = _Covariance.of(samples, kind, _free(samples, typical))
        low, high = log(typical * 1e-4), log(typical * 30)
        span, gap = samples.span, samples.gap
        self._bounds = {
            _SMOOTH: (low, high),
            _LENGTH: (log(gap * 0.7), log(span * 2)),
            _SHORT: (low, log(typical * 2)),
            _NOISE: (low, log(typical * 2)),
            CHANGE: (log(max(4 * gap, span / 10)), log(span * 4)),
            **{_period(index): (low, log(typical * 5)) for index in range(len(kind.periods))},
        }

    def usual(self, length: float) -> dict[str, float]:
        """Return sizes to begin with."""
        kind, typical = self._kind, self._typical
        sizes = {_LENGTH: log(length), _SMOOTH: log(typical)}
        if kind.has_short:
            sizes[_SHORT] = log(typical * 0.3)
        if self._samples.noise_spread:
            sizes[_NOISE] = log(max(self._stated_noise(), typical * 0.1))
        sizes |= {_period(index): log(typical * 0.3) for index in range(len(kind.periods))}
        if kind.changes:
            sizes[CHANGE] = log(self._samples.span)
        return sizes

    def climb(self, start: Mapping[str, float]) -> tuple[float, dict[str, float]]:
        """Change one size after the other, with smaller steps where they bring nothing."""
        sizes = {name: self._inside(name, start.get(name, size)) for name, size in self.usual(1.0).items()}
        best = self.cost(sizes)
        steps = dict.fromkeys(sizes, _FIRST)
        for _ in range(_ROUNDS):
            if max(steps.values()) <= _FINEST:
                break
            for name in tuple(sizes):
                if steps[name] <= _FINEST:
                    continue
                for sign in (1, -1):
                    size = self._inside(name, sizes[name] + sign * steps[name])
                    if size == sizes[name]:  # at its bound: no change
                        continue
                    moved = {**sizes, name: size}
                    cost = self.cost(moved)
                    if cost < best - 1e-9:
                        best, sizes = cost, moved
                        steps[name] = min(steps[name] * 1.3, 1.5)
                        break
                else:
                    steps[name] /= 2
        return best, sizes

    def _inside(self, name: str, size: float) -> float:
        low, high = self._bounds[name]
        return min(max(size, low), high)

    def cost(self, sizes: Mapping[str, float]) -> float:
        """Return the negative logarithm of the likelihood, with weak priors for the sizes of screws."""
        try:
            root = np.linalg.cholesky(self._covariance.at(sizes))
        except np.linalg.LinAlgError:
            return inf
        white = np.linalg.solve(root, self._samples.values)
        cost = float(white @ white) / 2 + float(np.log(np.diag(root)).sum())
        cost += _belief(sizes[_LENGTH], self._samples.span / 3, 1.5)
        cost += _belief(sizes[_SMOOTH], self._typical, 2.0)
        if _SHORT in sizes:
            cost += _belief(sizes[_SHORT], self._typical * 0.1, 3.0)
        if _NOISE in sizes:
            spread = self._samples.noise_spread
            cost += _belief(sizes[_NOISE], self._typical * 0.1, 3.0)
            if spread < inf:
                cost += _belief(sizes[_NOISE], self._stated_noise(), spread)
        return cost

    def _stated_noise(self) -> float:
        return float(np.sqrt(self._samples.variance.mean()))


def _belief(size: float, around: float, spread: float) -> float:
    return 0.5 * ((size - log(around)) / spread) ** 2


@dataclass(frozen=True, slots=True)
class _Distances:
    """Distances of positions, with the parts of a kernel that do not depend on the sizes."""

    signed: Array
    absolute: Array
    waves: tuple[Array, ...]
    """The cosine of each period."""

    @classmethod
    def of(cls, kind: CurveKind, signed: Array) -> "_Distances":
        waves = tuple(np.cos(2 * pi * signed / period) for period in kind.periods)
        return cls(signed, np.abs(signed), waves)


@dataclass(frozen=True, slots=True)
class _Covariance:
    """The covariance of samples for any sizes; the parts common to all are computed once."""

    samples: Samples
    kind: CurveKind
    free: float
    distances: _Distances
    fixed: Array
    """Of the trend, and of what the samples share."""

    @classmethod
    def of(cls, samples: Samples, kind: CurveKind, free: float) -> "_Covariance":
        positions = samples.positions
        trend = _trend(samples, kind, positions)
        distances = _Distances.of(kind, positions[:, None] - positions[None, :])
        fixed = free * (trend @ trend.T)
        if samples.shared is not None:
            fixed = fixed + samples.shared.covariance()
        return cls(samples, kind, free, distances, fixed)

    def at(self, sizes: Mapping[str, float]) -> Array:
        """Return the covariance of the samples with these sizes."""
        covariance = _kernel(self.kind, sizes, self.distances) + self.fixed
        short = np.exp(2 * sizes[_SHORT]) if self.kind.has_short else 0.0
        # A share below all measurement keeps the sums solvable if readings have no scatter.
        alone = _noise_variance(self.samples, sizes) + short + 3e-12 * self.free
        covariance.flat[:: len(covariance) + 1] += alone
        return covariance


def _noise_variance(samples: Samples, sizes: Mapping[str, float]) -> Array:
    if _NOISE not in sizes:
        return samples.variance
    mean = samples.variance.mean()
    share = samples.variance / mean if mean else np.ones_like(samples.variance)
    result: Array = np.exp(2 * sizes[_NOISE]) * share
    return result


def _kernel(kind: CurveKind, sizes: Mapping[str, float], distances: _Distances) -> Array:
    ratio = distances.absolute / np.exp(sizes[_LENGTH])
    covariance: Array = np.exp(2 * sizes[_SMOOTH]) * _matern(kind.order, ratio)
    if kind.periods:
        repeating = sum(
            np.exp(2 * sizes[_period(index)]) * wave for index, wave in enumerate(distances.waves)
        )
        if kind.changes:
            repeating = repeating * np.exp(-0.5 * (distances.signed / np.exp(sizes[CHANGE])) ** 2)
        covariance = covariance + repeating
    return covariance


def _matern(order: float, ratio: Array) -> Array:
    if order == ROUGH:
        result: Array = np.exp(-ratio)
    elif order == 1.5:
        scaled = ratio * 3**0.5
        result = (1.0 + scaled) * np.exp(-scaled)
    elif order == 2.5:
        scaled = ratio * 5**0.5
        result = (1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled)
    else:
        result = np.exp(-0.5 * ratio**2)
    return result


def _short_kernel(ratio: Array) -> Array:
    """Return the correlation of waves too short for the samples; ``ratio``: distances in their mean one.

    It is the mean of a wave over :data:`SHORT_TURNS`: ``(sin(2 π b r) - sin(2 π a r)) / (2 π r (b - a))``.
    """
    low, high = SHORT_TURNS
    result: Array = (high * np.sinc(2 * high * ratio) - low * np.sinc(2 * low * ratio)) / (high - low)
    return result


def _random_waves(at: Array, waves: Array, count: int, random: np.random.Generator) -> Array:
    """Return curves of variance 1 whose spectrum is that of the waves (random Fourier features)."""
    phase = np.outer(at, waves)
    shape = (len(waves), count)
    curves: Array = np.cos(phase) @ random.standard_normal(shape)
    curves += np.sin(phase) @ random.standard_normal(shape)
    curves /= len(waves) ** 0.5
    return curves


def _trend(samples: Samples, kind: CurveKind, at: Array) -> Array:
    """Return the unconstrained parts, a column each: offset, slope, and its change."""
    unit = _unit(samples, at)
    columns = [np.ones_like(at), unit]
    if kind.joint is not None:
        columns.append(np.maximum(unit - _unit(samples, np.array([kind.joint]))[0], 0.0))
    columns += [_step(at, position) for position in kind.jumps]
    result: Array = np.column_stack(columns)
    return result


def _unit(samples: Samples, at: Array) -> Array:
    middle = samples.positions.mean()
    result: Array = (at - middle) / (samples.span / 2)
    return result


def _period(index: int) -> str:
    return f"period {index}"


def best_of(samples: Samples, kinds: Sequence[CurveKind]) -> list[Process]:
    """Return a process for each kind of curve, the one that explains the samples best first."""
    return sorted((fitted(samples, kind) for kind in kinds), key=lambda each: each.score)
