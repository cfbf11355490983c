"""Whether an axis knows where it is, as far as its drive's homed bit tells.

The bit is read when the line comes up, after every silence, and before a target when it was last seen a while
ago; else it is seen in passing. While it is not set, positions pass 1:1 (M9).
"""

from typing import Final

from gateway.exchange.plan import Reference
from gateway.times import NS_PER_S

REFERENCE_FRESH_NS: Final = NS_PER_S
"""A homed bit that was seen longer ago is read again before a target."""


class ReferenceState:
    """What is known about the reference of one axis."""

    __slots__ = ("_is_known", "_seen_ns", "follows_bit", "is_found", "is_in_doubt")

    def __init__(self, reference: Reference) -> None:
        self.follows_bit = reference is Reference.DRIVE_BIT
        self.is_found = reference is Reference.ABSOLUTE
        """Whether the axis counts as referenced."""
        self.is_in_doubt = self.follows_bit
        """Whether the bit has to be looked at before anything else is done with the axis."""
        self._is_known = not self.follows_bit
        self._seen_ns = 0

    def see(self, now_ns: int, *, is_set: bool) -> bool:
        """Take note of the bit; return whether that is news: a change, or the first that is known."""
        is_news = is_set is not self.is_found or not self._is_known
        self.is_found = is_set
        self.is_in_doubt = False
        self._is_known = True
        self._seen_ns = now_ns
        return is_news

    def has_to_be_asked(self, now_ns: int, *, before_target: bool) -> bool:
        """Whether the bit has to be read before positions of the axis pass."""
        if not self.follows_bit:
            return False
        return self.is_in_doubt or (before_target and now_ns - self._seen_ns > REFERENCE_FRESH_NS)
