"""Whether what a controller reads of one axis moves only as the axis does: no jumps, no way back."""

from typing import NamedTuple

ROUNDING = 3
"""Counts: both readings and both anchors."""
SLOPE = 0.012
"""More than any branch of a screw, or the difference of two, changes per count."""


class Reading(NamedTuple):
    """One position as the drive had it and as the controller was told, during one of the drive's motions."""

    corrected: int
    nominal: int
    motion: int
    faded: float
    """Counts that may still be fading out."""


class Continuity:
    def __init__(self) -> None:
        self._last: Reading | None = None

    def forget(self) -> None:
        """Something is not known: the next reading may be anywhere."""
        self._last = None

    def jump(self, now: Reading, begun_at: int, way: int) -> float:
        """Return by how many counts a reading moved more, or less, than it may have.

        Between the two there may be the beginning of the motion that is under way, from ``begun_at``, where
        the axis stood, and ``way`` counts long.
        """
        before, self._last = self._last, now
        if before is None or (now.motion != before.motion and before.corrected != begun_at):
            return 0.0
        travelled = abs(now.corrected - before.corrected)
        share = min(1.0, travelled / way) if way else 1.0  # a move of nothing ends where it began
        limit = ROUNDING + SLOPE * travelled + max(before.faded, now.faded) * share
        moved = abs((now.nominal - before.nominal) - (now.corrected - before.corrected))
        return max(0.0, moved - limit)
