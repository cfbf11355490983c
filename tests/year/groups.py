"""Axes of a group, as the account follows them: they go by one decision (M11).

The frame that makes the first of them go fixes by what all go, until each has gone, one that has gone
gets another target, one is stopped, or 10 s have passed.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from tests.year.corrections import Correction
from tests.year.machine import S

if TYPE_CHECKING:
    from tests.year.account import Axis

LONGEST_NS: Final = 10 * S


class Group:
    """One decision after the other."""

    def __init__(self, axes: Sequence["Axis"]) -> None:
        self.axes = axes
        self._fixed: dict[Axis, Correction] = {}
        self._went: dict[Axis, tuple[bool, bool]] = {}
        """The axes that went since: by what was fixed; with the words that they had before."""
        self._sent: set[Axis] = set()
        self._since_ns = 0

    def fixed(self, axis: "Axis") -> Correction:
        """Return by what an axis goes."""
        return self._fixed.get(axis, axis.correction)

    def leaves(self, axis: "Axis", now_ns: int, *, runs: bool, is_target: bool, is_stop: bool) -> None:
        """A frame leaves that makes an axis go, gives it a target or stops it."""
        is_over = is_stop or now_ns - self._since_ns > LONGEST_NS
        if is_over or ((runs or is_target) and axis in self._sent):
            self._fixed, self._went, self._sent = {}, {}, set()
        if runs:
            if not self._fixed:
                self._fixed = {each: each.correction for each in self.axes}
                self._since_ns = now_ns
            self._sent.add(axis)

    def went(self, axis: "Axis", nominal: int, end: int) -> bool:
        """An axis goes to a position; return whether one keeps older words and another does not (M4)."""
        if axis not in self._sent:
            return False
        is_kept = (nominal, end) == (axis.place, axis.words)
        self._went[axis] = self.fixed(axis).makes(axis.layout, end, nominal), is_kept
        by_fixed, kept = zip(*self._went.values(), strict=True)
        return len(self._went) == len(self.axes) and not all(by_fixed) and not all(kept)
