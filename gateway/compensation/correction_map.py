"""The correction in force: weighted branches of one or two curves, forward and exactly inverted.

``corrected = nominal + correction(nominal)``, both machine positions. Blends between the branches and between
two tables are sums of piecewise linear curves, so they are piecewise linear and have an exact inverse too.
"""

from typing import Final, NamedTuple

from gateway.compensation.curve import Curve

MAX_BISECTIONS: Final = 200
"""More than enough to reduce any interval of doubles to neighbours."""


class Term(NamedTuple):
    """Share of one curve: how much of its forward and of its backward branch counts."""

    curve: Curve
    forward_weight: float
    backward_weight: float


class CorrectionMap:
    """An immutable map between nominal and corrected machine positions, in units of the axis."""

    __slots__ = ("_bound", "offset", "terms")

    def __init__(self, terms: tuple[Term, ...] = (), offset: float = 0.0) -> None:
        self.terms = tuple(t for t in terms if t.forward_weight or t.backward_weight)
        self.offset = offset
        weights = (abs(t.forward_weight) + abs(t.backward_weight) for t in self.terms)
        self._bound = abs(offset) + sum(
            w * t.curve.max_correction for w, t in zip(weights, self.terms, strict=True)
        )

    @property
    def is_identity(self) -> bool:
        """Whether nothing is ever added."""
        return not self.terms and not self.offset

    def correction(self, nominal: float) -> float:
        """Amount to add at a nominal machine position, in units."""
        total = self.offset
        for curve, forward_weight, backward_weight in self.terms:
            _, _, reference, forward, backward, forward_slope, backward_slope = curve.piece(nominal)
            distance = nominal - reference
            if forward_weight:
                total += forward_weight * (forward + forward_slope * distance)
            if backward_weight:
                total += backward_weight * (backward + backward_slope * distance)
        return total

    def nominal(self, corrected: float) -> float:
        """Return the nominal machine position whose corrected one is ``corrected``: the exact inverse.

        The first guess lands on the right piece nearly always and solving that piece is exact; else the
        interval that the largest correction leaves open is halved until its piece is found.
        """
        if not self.terms:
            return corrected - self.offset
        guess = corrected - self.correction(corrected)
        solution = self._solve(guess, corrected)
        return self._search(corrected) if solution is None else solution

    def _solve(self, near: float, corrected: float) -> float | None:
        """Solve the piece around ``near``, or return None when the solution lies on another."""
        low, high, correction, slope = self._piece(near)
        solution = near + (corrected - near - correction) / (1.0 + slope)
        return solution if low <= solution <= high else None

    def _piece(self, nominal: float) -> tuple[float, float, float, float]:
        """Bounds of the common straight stretch around ``nominal``, correction there, its slope."""
        low, high = float("-inf"), float("inf")
        correction, slope = self.offset, 0.0
        for curve, forward_weight, backward_weight in self.terms:
            piece = curve.piece(nominal)
            low, high = max(low, piece.low), min(high, piece.high)
            distance = nominal - piece.reference
            correction += forward_weight * (piece.forward + piece.forward_slope * distance)
            correction += backward_weight * (piece.backward + piece.backward_slope * distance)
            slope += forward_weight * piece.forward_slope + backward_weight * piece.backward_slope
        return low, high, correction, slope

    def _search(self, corrected: float) -> float:
        low, high = corrected - self._bound, corrected + self._bound
        middle = low
        for _ in range(MAX_BISECTIONS):
            middle = 0.5 * (low + high)
            solution = self._solve(middle, corrected)
            if solution is not None:
                return solution
            if middle in (low, high):
                break  # a step of the `zero` policy: no position maps there, the edge is the nearest
            if middle + self.correction(middle) <= corrected:
                low = middle
            else:
                high = middle
        return middle


IDENTITY: Final = CorrectionMap()
