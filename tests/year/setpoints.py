"""A stream of setpoints, as the account follows it: which words may leave for each (M6).

What comes into force is blended over the way, at a reversal and after a command. The blends are not worked
out again here: they have bounds, and where none can be under way any more the words are those of one branch.
"""

from typing import Final

from tests.ledger.layouts import Layout
from tests.year.corrections import NONE, ROUNDING, Correction, span

STEEPEST: Final = 0.42
"""What a blend may add to a count of way: sin² over four times its height, (π/2)/4, and slopes of tables."""
BLENDED_MM: Final = 10.0
"""Way behind a command after which it is wholly in force: two blends one after the other, of 2.7 mm each."""
TURNED_MM: Final = 3.0
"""The same behind a reversal: five times the largest difference of the branches, with one of them off."""


STEPS: Final = 6
"""Setpoints that each of them takes, however long: a blend begins behind the end of the one before."""


class Flow:
    """The setpoints of one axis, in the order in which they left."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._before: list[tuple[int, int]] = []
        """Setpoints, with their words, from which the next one may go on: all since the last acknowledged."""
        self._older: list[tuple[int, int]] = []
        """The one before these: the record may not have got further."""
        self._corrections = [NONE]
        """What may be in force, the newest last."""
        self._offset: tuple[int, ...] = ()
        """With which it began, in counts."""
        self._blended_mm = self._turned_mm = 0.0
        self._is_forward = True
        self.is_new = True
        """No setpoint has left since the process began."""
        self.is_begun = False
        """The process has had a setpoint acknowledged, or goes on from its record."""

    def change(self, correction: Correction) -> None:
        """Something else comes into force, blended."""
        self._corrections = [*(each for each in self._corrections if each != correction), correction]
        self._blended_mm = 0.0

    def restart(self, *, is_recorded: bool) -> None:
        """Another process goes on, by the record if that was kept."""
        self._before = [*self._older, *self._before] if is_recorded else []
        self._older, self.is_begun, self.is_new = [], False, True

    def span(self, nominal: int) -> tuple[float, float]:
        """Return the counts between which the words of a setpoint are."""
        low, high = span(self._layout, self._corrections, nominal)
        offsets = [nominal + each for each in self._offset]
        return min(low, *offsets, high), max(low, *offsets, high)

    def covers(self, corrected: int, nominal: int) -> bool:
        """Whether these may be the words of a setpoint."""
        low, high = self.span(nominal)
        return low - ROUNDING <= corrected <= high + ROUNDING

    @property
    def has_before(self) -> bool:
        """Whether it is known with what its record goes on."""
        return bool(self._before)

    def begins(self, corrected: int, nominal: int, at: int) -> bool:
        """Whether these may be the words of the first setpoint, with the drive at a position."""
        low, high = self.offsets(nominal, at, *self._corrections)
        return low - 3 * ROUNDING <= corrected - nominal <= high + 3 * ROUNDING

    def offsets(self, nominal: int, at: int, *corrections: Correction) -> tuple[float, float]:
        """Return between which counts the offset of a drive at a position can be a correction."""
        spans = ((here, span(self._layout, (NONE, *corrections), here)) for here in (at, nominal))
        ends = [end - here for here, each in spans for end in each]
        return min(ends), max(ends)

    def begin(self, corrected: int, nominal: int) -> None:
        """It begins with this offset, which fades."""
        self.is_new = False
        self.change(self._corrections[-1])
        self._before, self._offset, self._turned_mm = [(nominal, corrected)], (corrected - nominal,), 0.0

    def go_on(self, corrected: int, nominal: int) -> None:
        """A setpoint has left with these words."""
        if self._before:
            way_mm = (nominal - self._before[-1][0]) / self._layout.counts_per_unit
            if way_mm and (way_mm > 0) != self._is_forward:
                self._is_forward, self._turned_mm = way_mm > 0, 0.0
        self._before = [*self._before[-8:], (nominal, corrected)]

    def acknowledged(self) -> None:
        """The newest was accepted: the next goes on from it."""
        if len(self._before) > 1:
            way_mm = abs((self._before[-1][0] - self._before[0][0]) / self._layout.counts_per_unit)
            self._turned_mm += min(way_mm, TURNED_MM / STEPS)
            self._blended_mm += min(way_mm, BLENDED_MM / STEPS)
            if self._blended_mm > BLENDED_MM:
                self._corrections, self._offset = self._corrections[-1:], ()
            self._older = self._before[-2:-1]
        self._before = self._before[-1:]
        self.is_begun = True

    def why_not(self, corrected: int, nominal: int) -> str:
        """Return why these cannot be the next words, "" if they can."""
        jump = min(self._jump(corrected, nominal, *each) for each in self._before)
        if jump > 2 * ROUNDING:
            return f"{corrected} for {nominal} jumps by {jump:.1f} counts after {self._before}"
        if self.is_even(nominal):
            end = self._corrections[-1].value(self._layout, nominal, is_forward=self._is_forward)
            if abs(corrected - end) > ROUNDING:
                return f"{corrected} for {nominal}, not {end:.3f}"
        return ""

    @staticmethod
    def _jump(corrected: int, nominal: int, nominal_before: int, corrected_before: int) -> float:
        way = nominal - nominal_before
        if not way:
            return 2.0 * abs(corrected - corrected_before)  # the same words (M4)
        return abs(corrected - corrected_before - way) - STEEPEST * abs(way)

    def is_even(self, nominal: int) -> bool:
        """Whether a setpoint goes on in a direction with nothing being blended."""
        if len(self._before) != 1 or self._blended_mm <= BLENDED_MM or self._turned_mm <= TURNED_MM:
            return False
        way = (nominal - self._before[0][0]) * self._layout.machine_sign
        return way > 0 if self._is_forward else way < 0
