"""From what the drive reports back to what the controller commanded.

Three parts, all frozen when a target is accepted:

- the exact inverse of the correction in force,
- the *anchor*: the difference that rounding the command to whole counts made, so that an axis which stands
  where it was sent reads back exactly the integer that was commanded,
- the *fade*: when the map changes under an axis, the reading it had is kept and the difference is taken away
  in step with the way still to go, so that a standing axis never jumps and a moving one reads monotonically.
"""

from dataclasses import dataclass
from typing import Final

from gateway.compensation.correction_map import IDENTITY, CorrectionMap

NEGLIGIBLE_COUNTS: Final = 1e-6
"""A difference of readings below this needs no fade: it is floating point, not position."""


@dataclass(frozen=True, slots=True)
class Fade:
    """A difference of nominal counts that lessens linearly between two nominal machine positions."""

    difference_counts: float
    start: float
    end: float

    def remaining(self, nominal: float) -> float:
        """Counts still to be added to a reading at ``nominal`` (machine units, through the new map)."""
        way = self.end - self.start
        if not way:
            return 0.0
        done = (nominal - self.start) / way
        return self.difference_counts * (1.0 - min(1.0, max(0.0, done)))


@dataclass(frozen=True, slots=True)
class Readback:
    """The map from corrected to nominal counts that one accepted target left behind."""

    counts_per_unit: float
    zero_counts: float
    correction_map: CorrectionMap = IDENTITY
    anchor_counts: float = 0.0
    fade: Fade | None = None

    def position(self, corrected_counts: float) -> float:
        """Nominal machine position through the map alone, without anchor and fade."""
        return self.correction_map.nominal((corrected_counts - self.zero_counts) / self.counts_per_unit)

    def correction_counts(self, corrected_counts: float) -> float:
        """Counts to take out of a reading: ``nominal = corrected - correction``, not rounded."""
        if self.correction_map.is_identity and self.fade is None:
            return self.anchor_counts
        nominal = self.position(corrected_counts)
        correction = self.correction_map.correction(nominal) * self.counts_per_unit + self.anchor_counts
        return correction if self.fade is None else correction - self.fade.remaining(nominal)


def after_target(
    previous: Readback,
    correction_map: CorrectionMap,
    nominal_counts: float,
    corrected_counts: float,
    standing_counts: float,
) -> Readback:
    """Return the readback that holds once a target was accepted.

    Args:
        previous: the readback in force until now.
        correction_map: the correction that the target was given.
        nominal_counts: what the controller commanded.
        corrected_counts: what the drive was told, in whole steps of its register.
        standing_counts: where the axis is, as the drive reports it.
    """
    plain = Readback(previous.counts_per_unit, previous.zero_counts, correction_map)
    anchor = (corrected_counts - nominal_counts) - plain.correction_counts(corrected_counts)
    anchored = Readback(plain.counts_per_unit, plain.zero_counts, correction_map, anchor)
    difference = anchored.correction_counts(standing_counts) - previous.correction_counts(standing_counts)
    if abs(difference) < NEGLIGIBLE_COUNTS or standing_counts == corrected_counts:
        return anchored
    fade = Fade(difference, plain.position(standing_counts), plain.position(corrected_counts))
    return Readback(plain.counts_per_unit, plain.zero_counts, correction_map, anchor, fade)
