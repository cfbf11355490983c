"""Choice of the curve and the points of a table: those that leave least between the targets.

Lines from target to target, a smooth curve, and a curve with harmonics of the lead all become tables. All are
judged by what each would leave of the curves that the readings allow (:meth:`MeasuredScrew.leaves`). Among
equally good ones the plainest is used, with the fewest points. Needs numpy; its users import it locally.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Final

import numpy as np

from gateway.compensation.direction import Direction
from gateway.compensation.errors import TableError
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.build import Fit, Recipe, Shape
from gateway.metrology.lead import lead_warnings
from gateway.metrology.readings import small_unit
from gateway.metrology.resample import DIGITS, at_positions, fewest_points, grid_positions
from gateway.metrology.screw import Harmonic, Jump, MeasuredScrew
from gateway.plain import JsonObject

LEAST_FITTED: Final = 9
"""With fewer targets lines are as good as any curve, and the table keeps the readings unchanged."""
AS_GOOD: Final = 1.05
"""Times the least that any table leaves: a plainer table that leaves no more than this is used."""
NOTHING_MM: Final = 0.00005
"""A difference below the resolution of all instruments."""
PERIOD_PARTS: Final = (8, 10, 16, 20)
"""Points in the shortest period, from coarse to fine: with fewer, straight lines make another wave."""
GAP_PARTS: Final = (1, 2, 4, 8)
"""Points from one target to the next."""
JUMP_PARTS: Final = 8
"""Fraction of a gap to which the position of a jump should be measured."""
CLEARLY: Final = 1.25
"""Another format is recommended only if this one leaves at least this many times as much."""
MOST_POINTS: Final = 20_000


@dataclass(frozen=True, slots=True)
class Candidate:
    """One possible table; lengths in the units of the readings."""

    shape: Shape
    table: CorrectionTable
    misses: float
    """Distance of each target from the prediction of the others, root of the mean square."""
    left_out: float
    """Predicted E of the table between the targets."""
    step: float | None = None
    """Distance of its points if they were chosen for the curve."""
    at_nut: bool = False
    """Its points are the actual positions of the nut."""
    refused: str | None = None
    """The reason why it cannot be written, and the remedy."""


@dataclass(frozen=True, slots=True)
class FitEvidence:
    """The evidence for the chosen table."""

    chosen: Candidate
    candidates: tuple[Candidate, ...]
    """One of each shape, the plainest first."""
    harmonics: tuple[Harmonic, ...]
    warnings: tuple[str, ...]
    unheld: Candidate | None = None
    """A candidate that would leave clearly less, but cannot be written."""
    has_left_out: bool = True
    """Whether the readings determine the remaining error; otherwise ``left_out`` only compares candidates."""

    def described(self, units: Units, subject: str) -> list[str]:
        """Return sentences: the curve of the ``subject``, the reason, and what repeats."""
        chosen, small = self.chosen, small_unit(units)
        where = "its points at the targets"
        if chosen.at_nut:
            where = "its points at the measured positions of the nut, not at the commanded ones"
        elif chosen.step is not None:
            where = f"a point every {chosen.step:.6g} {units.value}"
        missed = ", ".join(f"{each.shape.words} {small.text(each.misses)}" for each in self.candidates)
        first = (
            f"the {subject} follows {chosen.shape.words}, {where}; error of each shape at a target that is "
            f"left out (root mean square): {missed}"
        )
        notes = [first]
        if self.unheld is not None:
            other = self.unheld
            less = "less"
            if self.has_left_out:
                less = f"E = {small.text(other.left_out)} instead of {small.text(chosen.left_out)}"
            notes.append(
                f"{other.shape.words} with {len(other.table.positions)} points would leave {less}, but "
                f"cannot be written: {other.refused}"
            )
        notes.extend(f"{each.period.name}: {_of_harmonic(each, units)}" for each in self.harmonics)
        return notes

    def as_data(self) -> JsonObject:
        """Return the reasons for the curve of a table as plain data."""
        chosen = self.chosen
        small = small_unit(chosen.table.units)
        return {
            "follows": chosen.shape.value,
            "step": chosen.step,
            "points_where_the_nut_stood": chosen.at_nut,
            "candidates": [
                {
                    "follows": each.shape.value,
                    "points": len(each.table.positions),
                    f"left_out_rms_{small.key}": each.misses * small.factor,
                    f"left_out_e_{small.key}": each.left_out * small.factor if self.has_left_out else None,
                }
                for each in self.candidates
            ],
            "harmonics": [
                {
                    "name": each.period.name,
                    "period": each.period.length,
                    f"amplitude_{small.key}": None
                    if each.amplitude is None
                    else each.amplitude * small.factor,
                    "phase_deg": each.phase_deg,
                    "p": each.significance,
                }
                for each in self.harmonics
            ],
            "warnings": list(self.warnings),
        }


def choose(screw: MeasuredScrew, lines: CorrectionTable, recipe: Recipe) -> FitEvidence:
    """Make a table of each allowed shape, and choose; ``lines`` is the existing table.

    Here the home of a recipe only moves the knots, without subtraction: the error at the drive's position is
    relative to home.
    """
    held: list[Candidate] = []
    unheld: list[Candidate] = []
    for shape in _shapes(screw, recipe):
        fitting, others = _of(screw, shape, lines, recipe)
        held.extend([_plainest(fitting, screw.units)] if fitting else [])
        unheld.extend([_plainest(others, screw.units)] if others else [])
    if not held:
        # The writer refuses what cannot be written, with a remedy.
        held = [Candidate(Shape.LINES, lines, screw.misses(Shape.LINES), screw.leaves(lines))]
    chosen = _plainest(held, screw.units)
    better = min(unheld, key=lambda each: each.left_out, default=None)
    if better is not None and better.left_out * CLEARLY > chosen.left_out:
        better = None
    return FitEvidence(
        chosen, tuple(held), screw.harmonics, warnings_of(screw), better, has_left_out=not screw.unseen
    )


def _of_harmonic(harmonic: Harmonic, units: Units) -> str:
    if harmonic.amplitude is None or harmonic.phase_deg is None:
        return "its size is unknown, because these targets show only a part of it, or another period"
    found = "not significant"
    # An amplitude that scatter can also produce is not used: with few targets it would be any number.
    if harmonic.is_significant:
        size = small_unit(units).text(harmonic.amplitude)
        found = f"amplitude {size}, phase {round(harmonic.phase_deg) % 360}°, significant"
    return f"{found} (p = {harmonic.significance:.2g})"


def warnings_of(screw: MeasuredScrew) -> tuple[str, ...]:
    """Return warnings about what the targets cannot show."""
    return (
        *lead_warnings(screw.means.targets, screw.periods, screw.units),
        *(_jump_warning(each, screw.units) for each in screw.jumps),
    )


def _jump_warning(jump: Jump, units: Units) -> str:
    """Return where the error jumps, and what to measure."""
    fine = (jump.high - jump.low) / JUMP_PARTS
    return (
        f"measure finely between {jump.low:.9g} and {jump.high:.9g} {units.value}, with --from "
        f"{jump.low:.9g} --to {jump.high:.9g} --step {fine:.6g}, and give both files. The error jumps "
        f"there by {small_unit(units).text(abs(jump.size))}, as at a joint of two racks or scales, and a "
        "table with these targets cannot follow it"
    )


def _shapes(screw: MeasuredScrew, recipe: Recipe) -> tuple[Shape, ...]:
    # Smoothed lines are not changed.
    fit = Fit.LINES if recipe.smooth is not None else recipe.fit or Fit.LINES
    if fit is Fit.AUTO:
        return screw.shapes if len(screw.means.targets) >= LEAST_FITTED else (Shape.LINES,)
    shape = Shape(fit.value)
    return (shape,) if shape in screw.shapes else ()


def _plainest(found: Sequence[Candidate], units: Units) -> Candidate:
    """Return the first that is as good as the best."""
    least = min(each.left_out for each in found)
    limit = max(least * AS_GOOD, least + units.from_mm(NOTHING_MM))
    return next(each for each in found if each.left_out <= limit)


def _of(
    screw: MeasuredScrew,
    shape: Shape,
    lines: CorrectionTable,
    recipe: Recipe,
) -> tuple[list[Candidate], list[Candidate]]:
    """Return the tables of a shape, from few points to many: those that can be written, and the others."""
    held: list[Candidate] = []
    others: list[Candidate] = []
    for table, step, at_nut in _tables(screw, shape, lines, recipe):
        refused = recipe.refusal(table) if recipe.refusal is not None else None
        found = Candidate(
            shape, table, screw.misses(shape), screw.leaves(table), step, at_nut=at_nut, refused=refused
        )
        (held if refused is None else others).append(found)
    return held, others


def _tables(
    screw: MeasuredScrew,
    shape: Shape,
    lines: CorrectionTable,
    recipe: Recipe,
) -> Iterator[tuple[CorrectionTable, float | None, bool]]:
    """Yield tables from few points to many."""
    if shape is Shape.LINES:
        is_free = recipe.step is None and recipe.tolerance is None
        nut = _at_nut(screw, lines, recipe) if is_free else None
        if nut is not None and (recipe.refusal is None or recipe.refusal(nut) is None):
            yield nut, None, True
        else:
            yield lines, None, False
        return
    low, high = screw.means.targets[0], screw.means.targets[-1]
    if recipe.step is not None:
        positions = grid_positions(recipe.step, recipe.travel or (lines.first, lines.last), lines.units)
        yield _table(screw, shape, positions, recipe, reach=recipe.step), recipe.step, False
        return
    if shape is Shape.SMOOTH and recipe.tolerance is None:
        yield _table(screw, shape, screw.means.targets, recipe), None, False
    finest = None
    for step in _steps(screw, shape):
        first, last = floor(low / step + 1e-9), ceil(high / step - 1e-9)
        if last - first > MOST_POINTS:
            break
        positions = [round(index * step, DIGITS) + 0.0 for index in range(first, last + 1)]
        finest = _table(screw, shape, positions, recipe, reach=step)
        if recipe.tolerance is None:
            yield finest, step, False
    if recipe.tolerance is not None and finest is not None:
        yield fewest_points(finest, recipe.tolerance)[0], None, False


def _steps(screw: MeasuredScrew, shape: Shape) -> Iterator[float]:
    if shape is Shape.HARMONICS:
        telling = [each.period.length for each in screw.harmonics if each.is_significant]
        shortest = min(telling or [each.period.length for each in screw.harmonics])
        yield from (shortest / parts for parts in PERIOD_PARTS)
        return
    span = screw.means.targets[-1] - screw.means.targets[0]
    gap = span / (len(screw.means.targets) - 1)
    yield from (_round_down(gap / parts) for parts in GAP_PARTS)


def _round_down(length: float) -> float:
    """Return the largest of 1, 2, 2.5, 5 and their powers of ten that is not longer.

    >>> [_round_down(length) for length in (10.0, 9.7, 3.1, 0.07)]
    [10.0, 5.0, 2.5, 0.05]
    """
    scale = 10.0 ** floor(log10(length) + 1e-9)
    return float(
        max(
            round(part * scale, DIGITS)
            for part in (1.0, 2.0, 2.5, 5.0)
            if part * scale <= length * (1 + 1e-9)
        )
    )


def _at_nut(screw: MeasuredScrew, lines: CorrectionTable, recipe: Recipe) -> CorrectionTable | None:
    """Return the lines with points at the nut's actual positions; None if that changes nothing."""
    if tuple(lines.positions) != screw.means.targets:
        return None
    offset = _offset(screw, Shape.LINES, lines, recipe)
    positions = screw.nut_positions(offset)
    try:
        moved = screw.table(
            Shape.LINES,
            [round(position, DIGITS) for position in positions],
            offset=offset,
            one_way=recipe.one_way,
        )
    except TableError:
        return None
    # What the table at the targets has there, and what it should have.
    shifts = [
        abs(float(np.interp(x, moved.positions, curve)) - (value - offset))
        for curve, values in ((moved.forward, lines.forward), (moved.backward, lines.backward))
        for x, value in zip(lines.positions, values, strict=True)
        if moved.first <= x <= moved.last
    ]
    return moved if max(shifts, default=0.0) > screw.units.from_mm(NOTHING_MM) else None


def _table(
    screw: MeasuredScrew,
    shape: Shape,
    positions: Sequence[float],
    recipe: Recipe,
    *,
    reach: float = 0.0,
) -> CorrectionTable:
    """Return the curve at points; farther than ``reach`` beyond the targets its value does not change."""
    low, high = screw.means.targets[0] - reach, screw.means.targets[-1] + reach
    inside = [x for x in positions if low <= x <= high]
    probe = screw.table(shape, inside, one_way=recipe.one_way)
    offset = _offset(screw, shape, probe, recipe)
    table = screw.table(shape, inside, offset=offset, one_way=recipe.one_way) if offset else probe
    if len(inside) == len(positions):
        return table
    return at_positions(table, positions)


def _offset(screw: MeasuredScrew, shape: Shape, table: CorrectionTable, recipe: Recipe) -> float:
    """Return the correction at home, which is 0 by definition."""
    reference = recipe.reference(table)
    if reference is None:
        return 0.0
    at = np.array([reference.position])
    way = Direction.BACKWARD if reference.direction is Direction.BACKWARD else Direction.FORWARD
    return float(screw.correction(shape, way, at)[0])
