"""The uncertainty of a table's corrections, at its points and between them.

One model serves every method: the curves that the readings allow (:mod:`gateway.metrology.screw`; a linear
model with its covariance, as in JCGM 102). With the correction ``c`` of the table, the curve ``e`` that the
nut needs, and everything counted from home::

    u² = variance of e + (c - mean of e)² + (d / L)² (instrument² + alignment² + temperature²) + environment²

The variance of ``e`` comes from the scatter of the readings, the fit, and the block and dial of a walk. The
second part is what the points of the table do not follow, or what was left out of it. The others are stated
(:mod:`gateway.metrology.uncertainty`); instrument and temperature grow with the distance ``d`` from home.
``U = 2 u``: about 95 % of the truths are within it (GUM, JCGM 100:2008, 5.1.2, 6.2.1 and 6.3.3).

Needs numpy; its users import it locally.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Final

import numpy as np

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.build import HomeReference
from gateway.metrology.process import Array, Process
from gateway.metrology.readings import APPROACHES, small_unit
from gateway.metrology.residue import LeftOut
from gateway.metrology.screw import MeasuredScrew
from gateway.metrology.tables import correction_at
from gateway.metrology.uncertainty import RANGE, UncertaintyInputs, growing_parts
from gateway.plain import JsonObject

K: Final = 2.0
"""Coverage factor."""
COVERAGE: Final = 0.95
"""Share of the truths within ``K`` standard uncertainties, of a normal distribution (GUM, 6.3.3)."""
PLACES: Final = 400
"""Positions between the points of the table."""
MOST_POINTS: Final = 500
"""Of a table with more points the positions between represent them."""
SLOPE_PLACES: Final = 100
"""Positions that show the straight part of a curve."""


@dataclass(frozen=True, slots=True)
class Band:
    """Expanded uncertainties (k = 2) of the corrections of a table, from the first target to the last."""

    units: Units
    positions: tuple[float, ...]
    """Points of the table and positions between them, ascending."""
    forward: tuple[float, ...] | None
    """None: this direction was not measured."""
    backward: tuple[float, ...] | None
    missing: tuple[str, ...]
    """What is not in it because nobody stated it."""
    unknown: str = ""
    """Why it is only the least that it can be: what no target shows. Empty: it is complete."""

    def of(self, way: Direction) -> tuple[float, ...] | None:
        """Return the uncertainties of a direction."""
        return self.forward if way is Direction.FORWARD else self.backward

    def at(self, position: float, way: Direction) -> float | None:
        """Return the uncertainty at a position; None outside the measured stretch."""
        values = self.of(way)
        if values is None or not self.positions[0] <= position <= self.positions[-1]:
            return None
        return float(np.interp(position, self.positions, values))

    def noise(self, table: CorrectionTable) -> list[tuple[float, Direction]]:
        """Return where a correction is smaller than its own uncertainty; a correction of 0 is none."""
        here = table.in_units(self.units)
        return [
            (position, way)
            for way, curve in zip(APPROACHES, (here.forward, here.backward), strict=True)
            for position, correction in zip(here.positions, curve, strict=True)
            if correction and abs(correction) < (self.at(position, way) or 0.0)
        ]

    def largest(self) -> tuple[float, float, Direction]:
        """Return the largest uncertainty, its position and its direction."""
        values = (
            (value, position, way)
            for way in APPROACHES
            for value, position in zip(self.of(way) or (), self.positions, strict=False)
        )
        return max(values, key=lambda each: each[0])

    def described(self, table: CorrectionTable, *, is_refined: bool = False) -> list[str]:
        """Return sentences: the uncertainty at the points and between them, what it lacks, what is noise."""
        small = small_unit(self.units)
        most, where, way = self.largest()
        usual = median(value for each in APPROACHES for value in self.of(each) or ())
        first = (
            f"uncertainty of a correction (k = 2, 95 %): usually ±{small.text(usual)}, at most "
            f"±{small.text(most)} ({way.name.lower()} at {where:.6g} {self.units.value})"
        )
        if self.unknown:
            first += "; it may be larger, because the targets hide a part of the error"
        if self.missing:
            first += f"; not in it, because not stated: {' and '.join(self.missing)}"
        found = [first]
        if noise := len(self.noise(table)):
            count = 2 * len(table.positions)
            remedy = "" if is_refined else ". table build --drop-noise makes them 0"
            are = "is noise: smaller than its" if noise == 1 else "are noise: smaller than their"
            found.append(f"{noise} of {count} corrections {are} own uncertainty{remedy}")
        return found

    def as_data(self, table: CorrectionTable) -> JsonObject:
        """Return it at the points of the table as plain data, null where nothing was measured."""
        small = small_unit(self.units)
        here = table.in_units(self.units)

        def column(way: Direction) -> list[float | None]:
            values = [self.at(position, way) for position in here.positions]
            return [None if value is None else value * small.factor for value in values]

        most, where, way = self.largest()
        noise = self.noise(table)
        return {
            "coverage": COVERAGE,
            "k": K,
            f"largest_{small.key}": most * small.factor,
            "largest_at": where,
            "largest_direction": way.name.lower(),
            "positions": list(here.positions),
            f"forward_{small.key}": column(Direction.FORWARD),
            f"backward_{small.key}": column(Direction.BACKWARD),
            "noise": [{"position": position, "direction": each.name.lower()} for position, each in noise],
            "missing": list(self.missing),
            "at_least_because": self.unknown or None,
        }


def band_of(
    screw: MeasuredScrew,
    table: CorrectionTable,
    home: HomeReference | None,
    stated: UncertaintyInputs,
    missing: Sequence[str] = (),
) -> Band | None:
    """Return the uncertainty of a table for the screw that readings show; None: nothing is known about it.

    ``home`` is where the correction is 0 by definition; beyond the targets the nearest one stands for it.
    Without it the corrections count from the zero of the instrument, those of differences from the first
    position. ``missing`` is what nobody stated.
    """
    if screw.unsettled:
        return None
    here = table.in_units(screw.units)
    low, high = screw.means.targets[0], screw.means.targets[-1]
    reach = here.max_correction()
    points = [x for x in here.positions if low - reach <= x <= high + reach]
    between = np.linspace(low, high, PLACES).tolist()
    at = np.array(sorted({*between, *(points if len(points) <= MOST_POINTS else ())}))
    zero = 0.0 if screw.concealed is None else low
    zero = min(max(zero if home is None else home.position, low), high)
    found = uncertainty(screw, here, at, None if home is None else replace(home, position=zero))
    grown = sum((part / K) ** 2 for _, part in growing_parts(stated, high - low))
    share = np.abs(at - zero) / (high - low)
    same = (RANGE * stated.environment / K) ** 2
    values = {
        way: tuple((K * np.sqrt(each**2 + grown * share**2 + same)).tolist()) for way, each in found.items()
    }
    return Band(
        screw.units,
        tuple(at.tolist()),
        values.get(Direction.FORWARD),
        values.get(Direction.BACKWARD),
        tuple(missing),
        LeftOut(None, 0.0, None, screw.unseen).unknown,
    )


def uncertainty(
    screw: MeasuredScrew, table: CorrectionTable, at: Array, home: HomeReference | None
) -> dict[Direction, Array]:
    """Return the standard uncertainty of a table's corrections by the readings, for each measured direction.

    ``table`` is in the units of the screw. A table with one curve is compared with the mean of both
    directions. If the readings leave the scale open, no straight part counts.
    """
    way_home = 0 if home is None else home.direction.value
    places, counted = _counted(screw, at, home)
    ways = {way: way.value for way in screw.ways}
    if table.is_unidirectional and screw.reversal is not None:
        ways, way_home = dict.fromkeys(ways, 0), 0
    # The way at each place: that of the correction, that of home, and none for the straight part.
    home_ways = np.zeros(len(places) - len(at))
    home_ways[:1] = way_home
    squares = {}
    for way, sign in ways.items():
        signs = np.concatenate((np.full(len(at), sign), home_ways))
        mean, half = _moved(table, places, signs), None
        square = np.zeros_like(at)
        if screw.reversal is not None:
            half = signs * screw.reversal.mean(places + mean)
            square += _variance(screw.reversal, places, counted * signs)
        for process, share in screw.kinds:
            missed = mean - process.mean(places + mean) - (0.0 if half is None else half)
            square += share * (_variance(process, places, counted) + (counted @ missed) ** 2)
        squares[way] = square
    return {way: np.sqrt(np.maximum(square, 0.0)) for way, square in squares.items()}


def _counted(screw: MeasuredScrew, at: Array, home: HomeReference | None) -> tuple[Array, Array]:
    """Return positions, and for each of ``at`` the weights of values there: from home, without the slope."""
    own = np.eye(len(at))
    start = home.position if home is not None else None
    if start is None and screw.concealed is not None:
        start = screw.means.targets[0]
    if start is None:
        return at, own
    places, parts = [at, np.array([start])], [own, np.full((len(at), 1), -1.0)]
    if not screw.is_scale_known:
        line = np.linspace(screw.means.targets[0], screw.means.targets[-1], SLOPE_PLACES)
        middle = line - line.mean()
        places.append(line)
        parts.append(np.outer(start - at, middle / (middle @ middle)))
    return np.concatenate(places), np.hstack(parts)


def _moved(table: CorrectionTable, places: Array, signs: Array) -> Array:
    """Return the corrections of a table: of each direction, or of the mean of both for the sign 0."""
    forward, backward = (np.interp(places, table.positions, c) for c in (table.forward, table.backward))
    result: Array = (forward + backward) / 2 + signs * (forward - backward) / 2
    return result


def _variance(process: Process, places: Array, counted: Array) -> Array:
    """Return the variance of weighted sums of a curve's values: each of its own place, and of the last."""
    count = len(counted)
    own, others = np.diag(counted), counted[:, count:]
    result: Array = own**2 * process.variance(places[:count])
    if others.size:
        shared = process.covariance(places, places[count:])
        result += 2 * own * np.einsum("ij,ij->i", others, shared[:count])
        result += np.einsum("ij,ij->i", others @ shared[count:], others)
    return result


def without_noise(table: CorrectionTable, band: Band) -> CorrectionTable:
    """Return the table with 0 in place of each correction that is smaller than its own uncertainty."""
    noise = set(band.noise(table))
    forward, backward = (
        [0.0 if (x, way) in noise else correction_at(table, x, way) for x in table.positions]
        for way in APPROACHES
    )
    return make_table(table.positions, forward, backward, table.units)
