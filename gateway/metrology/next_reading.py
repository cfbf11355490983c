"""Where another reading brings most, and whether it is worth its time.

A reading at a new place changes the curve everywhere, by its covariance with it (kriging; Rasmussen and
Williams, 2.25). So what it would bring is known before it is taken. For each possible place the table is
thought of as made again with that reading, over curves that the readings allow; the best place is the one
with the largest decrease of the predicted E (its median). A reading here is a target as the others: in the
same directions, with as many runs. Of a walk it is one more placement of the block.

The measure of what is worth it is the gauge's own noise: the standard deviation of the mean of a target's
readings in one direction. If the best place brings less, a reading in the middle of every gap is tried.

Needs numpy; its users import it locally.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.process import Array, Process
from gateway.metrology.readings import small_unit
from gateway.metrology.residue import LeftOut
from gateway.metrology.screw import MeasuredScrew, without_slope
from gateway.plain import JsonObject

DRAWN: Final = 100
POSITIONS: Final = 400
"""Positions at which E is looked for."""
MOST_PLACES: Final = 80
"""Possible places of a reading; of more gaps every second, third, ... is tried."""
SEED: Final = 7


@dataclass(frozen=True, slots=True)
class Advice:
    """What another reading would bring; lengths in units of the axis."""

    units: Units
    at: float
    """The best place; of a walk the lower end of the placement."""
    reach: float
    """Length of the placement; 0: a target."""
    e: float
    """E that the table leaves now."""
    e_then: float
    """E with a reading at the best place."""
    noise: float
    """The gauge's own noise."""
    gaps: int
    """Readings that fill every gap, or placements in the middle of all others."""
    e_filled: float
    """E with all of these."""
    is_part: bool = False
    """The targets hide a part of the error: each E is of what they show."""

    @property
    def is_worth_it(self) -> bool:
        """Whether one reading brings more than the gauge's own noise."""
        return self.e - self.e_then >= self.noise

    @property
    def is_enough(self) -> bool:
        """Whether neither one reading nor one in every gap brings more."""
        return not self.is_worth_it and self.e - self.e_filled < self.noise

    def describe(self) -> str:
        """Return it as a sentence.

        >>> Advice(Units.MM, 187.5, 0.0, 0.0115, 0.0072, 0.0004, 16, 0.0051).describe()
        'measure next at 187.5 mm: there another reading takes most of E, from 11.50 µm to 7.20 µm'
        """
        small = small_unit(self.units)
        where, what = f"{self.at:.6g} {self.units.value}", "reading"
        if self.reach:
            where, what = f"{self.at:.6g} to {self.at + self.reach:.6g} {self.units.value}", "placement"
        now, then = small.text(self.e), small.text(self.e_then)
        if self.is_worth_it:
            part = " (of what the targets show)" if self.is_part else ""
            return (
                f"measure next at {where}: there another {what} takes most of E, from {now} to {then}{part}"
            )
        noise = small.text(self.noise)
        if self.is_enough:
            return (
                f"stop: another {what} brings less than the gauge's own noise of {noise} (the best one, at "
                f"{where}, takes E from {now} to {then}: a curve as smooth as this gains little)"
            )
        return (
            f"measure in the middle of every gap: {self.gaps} more {what}s take E from {now} to "
            f"{small.text(self.e_filled)}. A single one brings less than the gauge's own noise of {noise}"
        )

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        small = small_unit(self.units)
        return {
            "do": "next" if self.is_worth_it else "stop" if self.is_enough else "every-gap",
            "at": self.at,
            "reach": self.reach,
            f"e_{small.key}": self.e * small.factor,
            f"e_then_{small.key}": self.e_then * small.factor,
            f"noise_{small.key}": self.noise * small.factor,
            "gaps": self.gaps,
            f"e_filled_{small.key}": self.e_filled * small.factor,
            "is_part": self.is_part,
        }


def advice_of(screw: MeasuredScrew, table: CorrectionTable, left_out: LeftOut | None) -> Advice | None:
    """Return where another reading brings most; None: the readings do not tell it.

    Where the targets hide a part of the error, one place may be worth it; that it is enough is never said.
    """
    if left_out is None or left_out.unsettled or screw.scatter is None:
        return None
    e = screw.leaves(table) if left_out.e is None else left_out.e
    places = _places_of(screw)
    drawn = _Drawn.of(screw, table.in_units(screw.units), places)
    before = drawn.e_with([])
    singles = [drawn.e_with([index]) for index in range(len(places.lows))]
    best = int(np.argmin(singles))
    filled = drawn.e_with(range(len(places.lows)))
    # The figure for the user stays the predicted one: these draws only tell how it changes.
    change = e / before if before else 0.0
    found = Advice(
        screw.units,
        float(places.lows[best]),
        places.reach,
        e,
        min(singles[best] * change, e),
        float(np.sqrt(2.0 * np.median(screw.kinds[0][0].noise()))),
        len(places.lows),
        min(filled * change, e),
        left_out.e is None,
    )
    return None if found.is_part and not found.is_worth_it else found


class _Places(NamedTuple):
    """Possible readings: at the lower ends, or of the distance from each to ``reach`` above it."""

    at: Array
    """Positions at which E is looked for."""
    lows: Array
    reach: float = 0.0
    column: Array = np.zeros(0)
    """Of a placement: what the block adds to its reading, for one standard deviation of each amount."""

    @property
    def ends(self) -> Array:
        """Both ends of each, the lower ones first; of a target both are the same."""
        return np.concatenate((self.lows, self.lows + self.reach))


def _places_of(screw: MeasuredScrew) -> _Places:
    """Return the middles of the gaps between targets, or between placements, as long as the usual one."""
    samples, targets = screw.kinds[0][0].samples, screw.means.targets
    at = np.linspace(targets[0], targets[-1], POSITIONS)
    if samples.shared is None:
        return _Places(at, _thinned([(low + high) / 2 for low, high in pairwise(targets)]))
    ends = []
    for setup in np.unique(samples.shared.setups).tolist():
        own = np.flatnonzero(samples.shared.setups == setup)
        low, high = int(own[0]), int(own[-1])
        ends.append((float(samples.positions[high] - samples.positions[low]), low, high))
    reach, low, high = sorted(ends)[len(ends) // 2]
    starts = sorted(float(samples.positions[index]) for _, index, _ in ends)
    middles = [(one + two) / 2 for one, two in pairwise(starts)]
    last = targets[-1] - reach
    column = samples.shared.columns[high] - samples.shared.columns[low]
    return _Places(at, _thinned([each for each in middles if each <= last]), reach, column)


def _thinned(places: list[float]) -> Array:
    return np.array(places[:: -(-len(places) // MOST_PLACES)])


@dataclass(frozen=True, slots=True)
class _Kind:
    """One kind of curve, drawn: what a table leaves, and how each reading would change it."""

    left: Array
    """Table less curve, a row a position, forward then backward; a draw a column."""
    seen: Array
    """What each reading shows beside the expected, a row a reading; a draw a column."""
    reaches: Array
    """Covariance of each position with each reading."""
    readings: Array
    """Covariance of the readings with each other."""


@dataclass(frozen=True, slots=True)
class _Drawn:
    kinds: tuple[_Kind, ...]
    halves: _Kind | None
    """Curves of the reversal, for one direction: the draws of all kinds, one after the other."""
    positions: Array
    ways: tuple[int, ...]
    per_place: int
    """Readings of the reversal at each place."""
    is_scale_known: bool

    @classmethod
    def of(cls, screw: MeasuredScrew, table: CorrectionTable, places: _Places) -> "_Drawn":
        """Draw curves of every kind in proportion to its likelihood."""
        random = np.random.default_rng(SEED)
        shares = np.floor(np.cumsum([share for _, share in screw.kinds]) * DRAWN + 0.5).astype(int)
        counts = np.diff(shares, prepend=0).tolist()
        ways = tuple(way.value for way in screw.ways)
        curves = [table.forward if way == 1 else table.backward for way in ways]
        added = np.concatenate([np.interp(places.at, table.positions, curve) for curve in curves])
        mean = np.zeros(2 * len(places.lows))
        for process, share in screw.kinds:
            mean += share * process.mean(places.ends)
        kinds = []
        for (process, _), count in zip(screw.kinds, counts, strict=True):
            if count:
                drawn = _drawn(process, count, places, mean, random)
                left = added[:, None] - np.tile(drawn.left, (len(ways), 1))
                kinds.append(replace(drawn, left=left, reaches=np.tile(drawn.reaches, (len(ways), 1))))
        halves = None
        if screw.reversal is not None:
            each = _Places(places.at, places.ends if places.reach else places.lows)
            expected = screw.reversal.mean(each.ends)
            halves = _drawn(screw.reversal, sum(counts), each, expected, random)
        per_place = 2 if places.reach else 1
        return cls(tuple(kinds), halves, np.tile(places.at, len(ways)), ways, per_place, screw.is_scale_known)

    def e_with(self, chosen: Sequence[int]) -> float:
        """Return the median of E over the draws if the table is made again with the chosen readings."""
        halves = None
        if self.halves is not None:
            count = len(self.halves.seen) // self.per_place
            own = [index + count * side for side in range(self.per_place) for index in chosen]
            halves = self.halves.left - _update(self.halves, own)
        found, start = [], 0
        for kind in self.kinds:
            left = kind.left + _update(kind, chosen)
            if halves is not None:
                part = halves[:, start : start + left.shape[1]]
                left = left - np.vstack([way * part for way in self.ways])
            start += left.shape[1]
            if not self.is_scale_known:
                left = without_slope(self.positions, left)
            found.append(left.max(axis=0) - left.min(axis=0))
        return float(np.median(np.concatenate(found)))


def _update(kind: _Kind, chosen: Sequence[int]) -> Array:
    """Return what readings change in the estimate of each draw."""
    rows = list(chosen)
    if not rows:
        return np.zeros_like(kind.left)
    weights = np.linalg.solve(kind.readings[np.ix_(rows, rows)], kind.seen[rows])
    result: Array = kind.reaches[:, rows] @ weights
    return result


def _drawn(process: Process, count: int, places: _Places, mean: Array, random: np.random.Generator) -> _Kind:
    """Return drawn curves; ``mean`` is what is expected at the ends of all places."""
    number, size = len(places.at), len(places.lows)
    positions = np.concatenate((places.at, places.ends))
    curves = process.draws(np.concatenate((positions, process.samples.positions)), count, random)
    covariance = process.covariance(positions, places.ends)
    # A reading of a placement is the upper end less the lower one; its block is the one of the others.
    sides = (-1.0, 1.0) if places.reach else (1.0, 0.0)
    change = np.hstack([side * np.eye(size) for side in sides])
    reaches, own = covariance[:number] @ change.T, change @ covariance[number:] @ change.T
    seen = change @ (curves[number : len(positions)] - mean[:, None])
    noise = float(np.median(process.noise())) * (2.0 if places.reach else 1.0)
    own += noise * np.eye(size)
    seen += noise**0.5 * random.standard_normal(seen.shape)
    if places.column.size:
        cross, amounts = process.shared_given(positions)
        of_block = cross @ places.column
        reaches += of_block[:number, None]
        with_block = change @ of_block[number:]
        own += with_block[:, None] + with_block[None, :] + float(places.column @ amounts @ places.column)
        seen += places.column @ process.shared_draws(curves[len(positions) :], random)
    return _Kind(curves[:number], seen, reaches, own)
