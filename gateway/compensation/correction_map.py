"""The correction in force: weighted branches of one or two curves, forward and exactly inverted.

``corrected = nominal + correction(nominal)``, both machine positions. Blends between the branches and between
two tables are sums of piecewise linear curves. So they are piecewise linear and have an exact inverse too. A
straight line may be added without changing that: an offset, and a tilt about machine position 0.
"""

from collections.abc import Callable
from math import inf
from typing import Final, NamedTuple

from gateway.compensation.curve import Curve

GUESSES: Final = 3
"""Pieces that are tried before the search: a setpoint leads to the same piece or to the next."""
MAX_BISECTIONS: Final = 200
"""More than enough to reduce any interval of doubles to neighbours."""


class Term(NamedTuple):
    """Share of one curve: the weights of its forward and of its backward branch."""

    curve: Curve
    forward_weight: float
    backward_weight: float


class Solution(NamedTuple):
    """A nominal machine position and the correction there, both in units."""

    nominal: float
    correction: float


class CorrectionMap:
    """An immutable map between nominal and corrected machine positions, in units of the axis."""

    __slots__ = ("_bound", "_branch", "_single", "_weight", "is_identity", "offset", "terms", "tilt")

    def __init__(self, terms: tuple[Term, ...] = (), offset: float = 0.0, tilt: float = 0.0) -> None:
        self.terms = tuple([term for term in terms if term.forward_weight or term.backward_weight])
        self.offset = offset
        self.tilt = tilt
        self.is_identity = not self.terms and not offset and not tilt
        """Whether the correction is always 0."""
        self._branch, self._weight = _single_branch(self.terms)
        self._single = None if offset or tilt else self._branch
        """The only branch, if there is nothing else."""
        bound = 0.0
        for curve, forward_weight, backward_weight in self.terms:
            bound += (abs(forward_weight) + abs(backward_weight)) * curve.max_correction
        self._bound = abs(offset) + bound

    def correction(self, nominal: float) -> float:
        """Return the correction at a nominal machine position, in units."""
        if self._single is not None:
            return self._weight * self._single(nominal)
        total = self.offset + self.tilt * nominal
        if self._branch is not None:
            return total + self._weight * self._branch(nominal)
        for curve, forward_weight, backward_weight in self.terms:
            _, _, reference, forward, backward, forward_slope, backward_slope = curve.piece(nominal)
            distance = nominal - reference
            total += forward_weight * (forward + forward_slope * distance)
            total += backward_weight * (backward + backward_slope * distance)
        return total

    def nominal(self, corrected: float) -> float:
        """Return the nominal machine position whose corrected one is ``corrected``: the exact inverse."""
        return self.solve(corrected, corrected - self.correction(corrected)).nominal

    def solve(self, corrected: float, near: float) -> Solution:
        """Return the nominal machine position of ``corrected``, and the correction there.

        Args:
            corrected: machine position on the drive's scale.
            near: a guess. The piece around a good guess nearly always holds the solution, and solving that
                piece is exact. Otherwise the interval that the largest correction allows is halved until its
                piece is found.
        """
        if not self.terms:
            correction = (self.offset + self.tilt * corrected) / (1.0 + self.tilt)
            return Solution(corrected - correction, correction)
        for _ in range(GUESSES):
            solution, correction, is_exact = self._step(near, corrected)
            if is_exact:
                return Solution(solution, correction)
            near = solution
        return self._search(corrected)

    def _step(self, near: float, corrected: float) -> tuple[float, float, bool]:
        """Solve the piece around ``near``; return whether it holds the solution, or only a better guess."""
        low, high, correction, slope = self._piece(near)
        step = (corrected - near - correction) / (1.0 + slope)
        solution = near + step
        return solution, correction + slope * step, low <= solution <= high

    def _piece(self, nominal: float) -> tuple[float, float, float, float]:
        """Return bounds, correction and slope of the common straight piece around ``nominal``."""
        if self._branch is not None:
            curve, weight = self.terms[0].curve, self._weight
            low, high, correction, slope = curve.branch_piece(self._branch, nominal)
            if self._single is not None:
                return low, high, weight * correction, weight * slope
            line = self.offset + self.tilt * nominal
            return low, high, line + weight * correction, self.tilt + weight * slope
        low, high = -inf, inf
        correction, slope = self.offset + self.tilt * nominal, self.tilt
        for curve, forward_weight, backward_weight in self.terms:
            start, end, reference, forward, backward, forward_slope, backward_slope = curve.piece(nominal)
            if start > low:
                low = start
            if end < high:
                high = end
            distance = nominal - reference
            correction += forward_weight * (forward + forward_slope * distance)
            correction += backward_weight * (backward + backward_slope * distance)
            slope += forward_weight * forward_slope + backward_weight * backward_slope
        return low, high, correction, slope

    def _search(self, corrected: float) -> Solution:
        # |correction| <= bound + |tilt| * |nominal|, and nominal lies within |correction| of corrected.
        bound = (self._bound + abs(self.tilt * corrected)) / (1.0 - abs(self.tilt))
        low, high = corrected - bound, corrected + bound
        middle = low
        for _ in range(MAX_BISECTIONS):
            middle = 0.5 * (low + high)
            solution, correction, is_exact = self._step(middle, corrected)
            if is_exact:
                return Solution(solution, correction)
            if middle in (low, high):
                break  # a step of the `zero` policy: no position maps there, the edge is the nearest
            if middle + self.correction(middle) <= corrected:
                low = middle
            else:
                high = middle
        return Solution(middle, corrected - middle)


def _single_branch(terms: tuple[Term, ...]) -> tuple[Callable[[float], float] | None, float]:
    """Return the only branch in force as a function, and its weight; None if there is not exactly one."""
    if len(terms) != 1:
        return None, 0.0
    curve, forward_weight, backward_weight = terms[0]
    if not backward_weight:
        return curve.forward, forward_weight
    return (None, 0.0) if forward_weight else (curve.backward, backward_weight)


IDENTITY: Final = CorrectionMap()
