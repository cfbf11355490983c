"""Conversion of the position that the drive reports to the position that the controller commanded.

There are three parts, all frozen when a target is accepted:

- the exact inverse of the correction in force,
- the *anchor*: the difference from rounding the command to whole counts. So an axis at its target reads back
  exactly the integer that was commanded,
- the *fade*: when the map changes, the reading at that moment is kept, and the difference is removed in step
  with the remaining way. So an axis at standstill never jumps, and a moving one reads monotonically.
"""

from typing import Final, NamedTuple

from gateway.compensation.correction_map import IDENTITY, CorrectionMap
from gateway.compensation.moves import Accepted
from gateway.counts import Counts

AWAY_PER_DIFFERENCE: Final = 20.0
"""For an axis that moves the other way, a fade this many times as long as the difference keeps its reading
monotonic."""
NEGLIGIBLE_COUNTS: Final = 1e-6
"""A smaller difference of readings needs no fade: it is floating point, not position."""


class Fade(NamedTuple):
    """A difference of nominal counts that decreases linearly between two nominal machine positions.

    An axis that is moved the other way loses it over ``away``, in machine units.
    """

    difference_counts: float
    start: float
    end: float
    away: float

    def remaining(self, nominal: float) -> float:
        """Return the counts still to be added to a reading at ``nominal`` (machine units, by the new map)."""
        way = self.end - self.start
        if not way:
            return 0.0
        done = (nominal - self.start) / way
        if done <= 0.0:
            done = abs(nominal - self.start) / self.away
        return 0.0 if done >= 1.0 else self.difference_counts * (1.0 - done)


class Readback(NamedTuple):
    """The map from corrected to nominal counts after one accepted target."""

    counts_per_unit: float
    zero_counts: float
    correction_map: CorrectionMap = IDENTITY
    anchor_counts: float = 0.0
    fade: Fade | None = None
    end: float | None = None
    """Nominal machine position of its target; None without a target."""

    def correction_counts(self, corrected_counts: Counts) -> float:
        """Return the counts to subtract from a reading: ``nominal = corrected - correction``, not rounded."""
        correction_map = self.correction_map
        if self.fade is None and correction_map.is_identity:
            return self.anchor_counts
        corrected = (corrected_counts - self.zero_counts) / self.counts_per_unit
        nominal, correction = correction_map.solve(
            corrected, corrected - correction_map.correction(corrected)
        )
        counts = correction * self.counts_per_unit + self.anchor_counts
        return counts if self.fade is None else counts - self.fade.remaining(nominal)

    def is_faded_out(self, corrected_counts: Counts) -> bool:
        """Whether there is a fade and the axis has reached its end."""
        if self.fade is None:
            return False
        corrected = (corrected_counts - self.zero_counts) / self.counts_per_unit
        return not self.fade.remaining(self.correction_map.nominal(corrected))

    def without_fade(self) -> "Readback":
        """Return the readback after the end of the fade."""
        return self._replace(fade=None)


def reached(previous: Readback, correction_map: CorrectionMap, target: Accepted) -> Readback:
    """Return the readback of an axis that has reached a target: its fade is over."""
    counts_per_unit, zero_counts = previous.counts_per_unit, previous.zero_counts
    end, anchor = _end_and_anchor(previous, correction_map, target)
    return Readback(counts_per_unit, zero_counts, correction_map, anchor, None, end)


def _end_and_anchor(
    previous: Readback, correction_map: CorrectionMap, target: Accepted
) -> tuple[float, float]:
    """Return the nominal machine position at a target, and the difference from rounding its counts."""
    counts_per_unit, zero_counts = previous.counts_per_unit, previous.zero_counts
    nominal_counts, corrected_counts = target
    corrected = (corrected_counts - zero_counts) / counts_per_unit
    end, correction = correction_map.solve(corrected, (nominal_counts - zero_counts) / counts_per_unit)
    return end, (corrected_counts - nominal_counts) - correction * counts_per_unit


def after_target(
    previous: Readback,
    correction_map: CorrectionMap,
    target: Accepted,
    actual_counts: Counts,
    *,
    is_at_target: bool,
) -> Readback:
    """Return the readback after a target was accepted.

    Args:
        previous: the readback in force until now.
        correction_map: the correction of the target.
        target: what the controller commanded, and what the drive was sent in whole steps of its register.
        actual_counts: position of the axis, as the drive reports it.
        is_at_target: the axis is exactly at the target of ``previous``.
    """
    counts_per_unit, zero_counts = previous.counts_per_unit, previous.zero_counts
    end, anchor = _end_and_anchor(previous, correction_map, target)
    if actual_counts == target.corrected_counts:
        return Readback(counts_per_unit, zero_counts, correction_map, anchor, None, end)
    if is_at_target and previous.end is not None and correction_map is previous.correction_map:
        # The same position in the same map, after the end of a fade: nothing needs to be solved again.
        start, difference = previous.end, anchor - previous.anchor_counts
    else:
        actual = (actual_counts - zero_counts) / counts_per_unit
        start, correction = correction_map.solve(actual, actual - correction_map.correction(actual))
        now_read = correction * counts_per_unit + anchor
        difference = now_read - previous.correction_counts(actual_counts)
    fade = None
    if abs(difference) >= NEGLIGIBLE_COUNTS:
        away = max(abs(end - start), AWAY_PER_DIFFERENCE * abs(difference / counts_per_unit))
        fade = Fade(difference, start, end, away)
    return Readback(counts_per_unit, zero_counts, correction_map, anchor, fade, end)
