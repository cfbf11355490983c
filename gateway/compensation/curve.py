"""One table as two piecewise linear functions of machine position, also outside it and on each turn.

Every result is a *piece*: the straight line around a position. The correction is a point on it, the exact
inverse solves it, and sums of curves intersect their pieces.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from math import floor, inf
from typing import Final

from gateway.compensation.errors import TableError
from gateway.compensation.settings import Outside, OutsideKind
from gateway.compensation.table import CorrectionTable, Range

CLOSURE_TOLERANCE: Final = 1e-9
"""How well both ends of a turn must agree: corrections in units, the turn relative to itself."""
HOLD: Final = Outside()


Piece = tuple[float, float, float, float, float, float, float]
"""A straight piece of both branches: low end, high end, reference position, forward and backward correction
at the reference, forward and backward slope. Machine units; a plain tuple, because one is made per
position."""


class Curve:
    """The corrections of one table at any machine position.

    Args:
        table: in the units of the axis.
        outside: policy beyond the ends. ``refuse`` reads like ``hold`` here: the axis does the refusing.
        modulo: length of one turn, 0 for a linear axis.

    Raises:
        TableError: a turn that the table does not cover exactly or that does not close, or a fade so short
            that its slope would reach 1.
    """

    __slots__ = (
        "_above",
        "_below",
        "_fade",
        "_first",
        "_last",
        "_modulo",
        "_outside",
        "backward",
        "forward",
        "max_correction",
        "max_slope",
        "table",
    )

    def __init__(self, table: CorrectionTable, outside: Outside = HOLD, modulo: float = 0.0) -> None:
        self.table = table
        self._outside = outside.kind
        self._modulo = modulo
        self._fade = outside.fade_length if outside.kind is OutsideKind.FADE else 0.0
        self.max_correction = table.max_correction()
        self.max_slope = table.max_slope()
        """Largest |slope| inside and outside; a step of ``zero`` has none."""
        if modulo:
            check_closes(table, modulo)
        elif self._fade:
            self.max_slope = max(self.max_slope, _check_fade(table, self._fade))
        self._below = (table.forward[0], table.backward[0])
        self._above = (table.forward[-1], table.backward[-1])
        self._first, self._last = table.first, table.last
        self.forward = self._branch(table.forward)
        """Correction of the forward branch at any machine position, in units."""
        self.backward = self._branch(table.backward)

    def covers(self, position: float) -> bool:
        """Whether this machine position is inside the table, so that the policy outside does not apply."""
        return bool(self._modulo) or self.table.first <= position <= self.table.last

    def range(self, *, is_forward: bool) -> Range:
        """Return the smallest and the largest correction of one branch over all positions."""
        low, high = self.table.facts.forward if is_forward else self.table.facts.backward
        if not self._modulo and (self._fade or self._outside is OutsideKind.ZERO):
            return Range(min(low, 0.0), max(high, 0.0))
        return Range(low, high)

    def piece(self, position: float) -> Piece:
        """Return the straight piece around a machine position; at a knot, the one that begins there."""
        table = self.table
        offset = 0.0
        if self._modulo:
            offset = floor((position - table.first) / self._modulo) * self._modulo
            position -= offset
        elif not table.first <= position <= table.last:
            return self._piece_outside(position)
        i = table.segment(position)
        low = table.positions[i]
        high = table.positions[i + 1]
        width = high - low
        forward = table.forward[i]
        backward = table.backward[i]
        return (
            low + offset,
            high + offset,
            low + offset,
            forward,
            backward,
            (table.forward[i + 1] - forward) / width,
            (table.backward[i + 1] - backward) / width,
        )

    def branch_piece(
        self, branch: Callable[[float], float], position: float
    ) -> tuple[float, float, float, float]:
        """Return the straight piece of ``forward`` or ``backward`` around a machine position.

        Its ends, the correction at the position itself, and the slope: :meth:`piece` for one branch.
        """
        is_forward = branch is self.forward
        table = self.table
        if self._modulo or not self._first <= position <= self._last:
            piece = self.piece(position)
            value, slope = (piece[3], piece[5]) if is_forward else (piece[4], piece[6])
            return piece[0], piece[1], value + slope * (position - piece[2]), slope
        positions, values = table.positions, table.forward if is_forward else table.backward
        i = table.segment(position)
        low, high, value = positions[i], positions[i + 1], values[i]
        slope = (values[i + 1] - value) / (high - low)
        return low, high, value + slope * (position - low), slope

    def _branch(self, values: Sequence[float]) -> Callable[[float], float]:
        """Return the function that gives one branch at a machine position.

        The numbers are those of :meth:`piece`, for a third of the cost: it is called for each setpoint.
        """
        positions = self.table.positions
        first, last, step = self.table.first, self.table.last, self.table.even_step
        last_segment = len(positions) - 2
        # The piece of the previous position: the next setpoint mostly lies on it.
        low, high, value, slope = inf, -inf, 0.0, 0.0

        def even(position: float) -> float:
            nonlocal low, high, value, slope
            if low <= position < high:
                return value + slope * (position - low)
            if not first <= position <= last:
                return outside(position)
            index = int((position - first) / step)
            if index > last_segment:
                index = last_segment
            low, high = positions[index], positions[index + 1]
            # Near a point the division may be off by one piece; the comparisons are exact.
            if position < low:
                index -= 1
                low, high = positions[index], low
            elif position >= high and index < last_segment:
                index += 1
                low, high = high, positions[index + 1]
            value = values[index]
            slope = (values[index + 1] - value) / (high - low)
            return value + slope * (position - low)

        def free(position: float) -> float:
            nonlocal low, high, value, slope
            if low <= position < high:
                return value + slope * (position - low)
            if not first <= position <= last:
                return outside(position)
            index = bisect_right(positions, position) - 1
            if index > last_segment:
                index = last_segment
            low, high, value = positions[index], positions[index + 1], values[index]
            slope = (values[index + 1] - value) / (high - low)
            return value + slope * (position - low)

        def wrapped(position: float) -> float:
            position -= floor((position - first) / self._modulo) * self._modulo
            index = self.table.segment(position)  # rounding may leave it slightly beyond the end of the turn
            low, value = positions[index], values[index]
            return value + (values[index + 1] - value) / (positions[index + 1] - low) * (position - low)

        def outside(position: float) -> float:
            piece = self._piece_outside(position)
            value, slope = (piece[3], piece[5]) if values is self.table.forward else (piece[4], piece[6])
            return value + slope * (position - piece[2])

        if self._modulo:
            return wrapped
        return even if step else free

    def _piece_outside(self, position: float) -> Piece:
        is_below = position < self.table.first
        end = self.table.first if is_below else self.table.last
        forward, backward = self._below if is_below else self._above
        if self._outside is OutsideKind.ZERO:
            forward = backward = 0.0
        elif self._fade:
            far = end - self._fade if is_below else end + self._fade
            if is_below is (position >= far):
                slope = 1.0 / (end - far)
                low, high = (far, end) if is_below else (end, far)
                return low, high, end, forward, backward, forward * slope, backward * slope
            end, forward, backward = far, 0.0, 0.0
        return -inf if is_below else end, end if is_below else inf, position, forward, backward, 0.0, 0.0


def check_closes(table: CorrectionTable, modulo: float) -> None:
    """Check that a table covers one turn exactly and ends where it began.

    Raises:
        TableError: with the range found, or the corrections that differ.
    """
    covered = table.last - table.first
    if abs(covered - modulo) > CLOSURE_TOLERANCE * modulo:
        raise TableError(
            f"a table of a rotary axis must cover one turn of {modulo:g} exactly; "
            f"this one covers {covered:.9g}, from {table.first:g} to {table.last:g}"
        )
    for name, curve in (("forward", table.forward), ("backward", table.backward)):
        if abs(curve[0] - curve[-1]) > CLOSURE_TOLERANCE:
            raise TableError(
                f"the {name} correction is {curve[0]:.9g} at {table.first:g} but {curve[-1]:.9g} a turn on: "
                "both ends of a turn must carry the same correction"
            )


def _check_fade(table: CorrectionTable, fade_length: float) -> float:
    """Return the slope of the steepest fade."""
    largest = max(abs(c) for curve in (table.forward, table.backward) for c in (curve[0], curve[-1]))
    if largest >= fade_length:
        raise TableError(
            f"a correction of {largest:.6g} at the end of the table cannot fade out over {fade_length:g}: "
            "its slope must stay below 1"
        )
    return largest / fade_length
