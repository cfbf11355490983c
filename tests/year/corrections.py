"""What an axis is corrected by at a time: the arithmetic is that of the ledger's screws."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from tests.ledger.layouts import Layout
from tests.ledger.screws import Screw

ROUNDING: Final = 0.5 + 1e-6


class Correction(NamedTuple):
    """A table with its gains, switched on or off."""

    table: str
    """The name of its file; "": none."""
    screw: Screw | None
    forward: float = 1.0
    backward: float = 1.0
    is_on: bool = True

    @property
    def is_plain(self) -> bool:
        """Whether positions pass 1:1."""
        return self.screw is None or not self.is_on

    def value(self, layout: Layout, nominal: int, *, is_forward: bool) -> float:
        """Counts at which a drive has to be for a nominal position, reached in one direction."""
        if self.screw is None or not self.is_on:
            return nominal
        correction = self.screw.correction_mm(layout.machine_mm(nominal), is_forward=is_forward)
        gain = self.forward if is_forward else self.backward
        return nominal + gain * correction * layout.counts_per_unit

    def branches(self, layout: Layout, nominal: int) -> tuple[float, float]:
        """Return these counts for a position that is reached forward and backward."""
        return self.value(layout, nominal, is_forward=True), self.value(layout, nominal, is_forward=False)

    def makes(self, layout: Layout, corrected: int, nominal: int) -> bool:
        """Whether these are the words of a target: for either direction, or half way between."""
        up, down = self.branches(layout, nominal)
        return any(abs(corrected - value) <= ROUNDING for value in (up, down, (up + down) / 2))


NONE: Final = Correction("", None)


def span(layout: Layout, corrections: Iterable[Correction], nominal: int) -> tuple[float, float]:
    """Return between which counts a drive may be for a nominal position while these fade into each other."""
    ends = [end for each in corrections for end in each.branches(layout, nominal)]
    return min(ends), max(ends)
