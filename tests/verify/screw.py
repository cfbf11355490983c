"""The exact correction of a worn screw: the drive's own arithmetic, nothing of it is the gateway's."""

from collections.abc import Sequence
from typing import NamedTuple

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units

COUNTS_PER_MM = 1000


class Screw(NamedTuple):
    """Straight lines between points: what is added at each position, going forward and going backward."""

    positions_mm: Sequence[float]
    forward_mm: Sequence[float]
    backward_mm: Sequence[float]
    counts_per_mm: float = COUNTS_PER_MM
    """Negative: the drive counts the other way."""

    def longer(self, share: float) -> "Screw":
        """Return it by a share longer, held at 0: so much less has to be added."""
        forward, backward = (
            [value - share * at for at, value in zip(self.positions_mm, values, strict=True)]
            for values in (self.forward_mm, self.backward_mm)
        )
        return self._replace(forward_mm=tuple(forward), backward_mm=tuple(backward))

    def beside(self, offset_mm: float) -> "Screw":
        """Return it where so much more has to be added everywhere."""
        forward, backward = (
            tuple(each + offset_mm for each in values) for values in (self.forward_mm, self.backward_mm)
        )
        return self._replace(forward_mm=forward, backward_mm=backward)

    def table(self) -> CorrectionTable:
        """The same as the gateway has it."""
        return make_table(list(self.positions_mm), list(self.forward_mm), list(self.backward_mm), Units.MM)

    def correction_counts(self, nominal_counts: float, *, is_forward: bool) -> float:
        """What has to be added to a nominal position; beyond the ends what holds at the end."""
        at_mm = nominal_counts / self.counts_per_mm
        values = self.forward_mm if is_forward else self.backward_mm
        places = self.positions_mm
        if at_mm <= places[0]:
            return values[0] * self.counts_per_mm
        for i in range(1, len(places)):
            if at_mm <= places[i]:
                share = (at_mm - places[i - 1]) / (places[i] - places[i - 1])
                return (values[i - 1] + share * (values[i] - values[i - 1])) * self.counts_per_mm
        return values[-1] * self.counts_per_mm

    def corrected(self, nominal_counts: int) -> tuple[float, float]:
        """Where the drive has to stand for a nominal position: come with rising counts, with falling ones.

        Not rounded. Where the drive counts the other way, rising counts go backward.
        """
        is_forward = self.counts_per_mm > 0
        return (
            nominal_counts + self.correction_counts(nominal_counts, is_forward=is_forward),
            nominal_counts + self.correction_counts(nominal_counts, is_forward=not is_forward),
        )


WORN = Screw((-20, 0, 20, 40), (0.21, 0.03, 0.33, 0.12), (-0.05, -0.17, 0.05, -0.12))
"""Steep, and its branches lie 170 to 280 counts apart: a wrong one is seen."""
REGROUND = Screw((-20, 0, 20, 40), (0.02, 0.14, -0.06, 0.22), (-0.21, -0.11, -0.28, -0.03))
"""Another one, for a table that changes under way."""
