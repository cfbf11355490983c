"""Whether the drive of an axis answers requests, and whether it reports its position to the gateway (W8).

A drive that leaves requests unanswered for long may have been switched off, and may have lost its reference.
``Axis`` draws the conclusions.
"""

from enum import Enum
from typing import Final

from gateway.exchange.plan import AxisPlan
from gateway.modbus.registers import PositionField
from gateway.times import NS_PER_MS


class Readability(Enum):
    """Whether the drive reports the position of its axis when the gateway reads it (W8)."""

    __hash__ = object.__hash__

    OPEN = "open"
    """Nothing shows that it refuses such reads."""
    REFUSED_ONCE = "refused-once"
    """It answered one such read with an exception since the link came up."""
    REFUSED = "refused"
    """It did so twice in a row: the gateway stops reading until a controller gets a position, or the link
    comes up again."""


class PositionAnswer(Enum):
    """How the drive answers a read of its position."""

    __hash__ = object.__hash__

    POSITION = "place"
    PASSING = "passing"
    """A position, to a controller that read it."""
    REFUSAL = "refusal"
    """An exception that does not mean "later"."""
    LINK_LOST = "link-lost"
    """No answer; behind the next link there may be another drive, or the same one with other settings."""


READABILITY_AFTER: Final[dict[Readability, dict[PositionAnswer, Readability]]] = {
    Readability.OPEN: {
        PositionAnswer.POSITION: Readability.OPEN,
        PositionAnswer.PASSING: Readability.OPEN,
        PositionAnswer.REFUSAL: Readability.REFUSED_ONCE,  # it may have been busy
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
    Readability.REFUSED_ONCE: {
        PositionAnswer.POSITION: Readability.OPEN,
        PositionAnswer.PASSING: Readability.REFUSED_ONCE,  # says nothing about the gateway's own read
        PositionAnswer.REFUSAL: Readability.REFUSED,
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
    Readability.REFUSED: {
        PositionAnswer.POSITION: Readability.REFUSED,
        PositionAnswer.PASSING: Readability.REFUSED_ONCE,  # after one more refusal it is not read again
        PositionAnswer.REFUSAL: Readability.REFUSED,
        PositionAnswer.LINK_LOST: Readability.OPEN,
    },
}
"""The state after each answer; every pair is possible."""


class DriveReach:
    """What the gateway may read of one drive, and since when it is silent. Time is monotonic, in ns."""

    __slots__ = (
        "_actual",
        "asked_actual",
        "asked_commanded",
        "longest_silence_ns",
        "may_read",
        "readability",
        "silent_since_ns",
        "silent_until_ns",
    )

    def __init__(self, plan: AxisPlan) -> None:
        self.may_read = plan.safe_read and plan.added_frames
        """Whether the gateway may add reads of this axis's registers (W8)."""
        self._actual = self._asked(plan.actual)
        self.asked_actual = self._actual
        """The actual position that the gateway may read (W8); None: it only sees it in other replies."""
        self.readability = Readability.OPEN
        """Whether its drive answers such reads; if it refuses, ``asked_actual`` is None."""
        self.asked_commanded = self._asked(plan.commanded)
        """The drive's own commanded position that the gateway may read; None: none."""
        self.longest_silence_ns = plan.lost_ms * NS_PER_MS
        """After a longer silence the drive may have been switched off."""
        self.silent_since_ns: int | None = None
        self.silent_until_ns = 0
        """The time for which its drive is known to be silent: from when the first unanswered request was sent
        until the newest time-out, or until a later end that is known."""

    def _asked(self, fields: tuple[PositionField, ...]) -> PositionField | None:
        """Return the position field that the gateway may read; None: none."""
        return fields[0] if self.may_read and fields and fields[0].is_readable else None

    @property
    def is_unreadable(self) -> bool:
        """Whether the gateway does not read its position because its drive refuses to report it."""
        return self.readability is Readability.REFUSED

    def update_readability(self, answer: PositionAnswer) -> None:
        """Record how its drive answers when the gateway reads its position."""
        self.readability = READABILITY_AFTER[self.readability][answer]
        self.asked_actual = None if self.is_unreadable else self._actual

    def fall_silent(self, since_ns: int, now_ns: int) -> None:
        """The drive left a request unanswered; ``since_ns``: when the first such request was sent."""
        if self.silent_since_ns is None:
            self.silent_since_ns = since_ns
        self.silent_until_ns = now_ns

    def end_silence(self, *, is_answer: bool, until_ns: int | None = None) -> bool:
        """Return whether the silence was so long that the drive may have been switched off.

        ``is_answer``: the silence ends now. ``until_ns``: its minimum end, if known.
        """
        if until_ns is not None:
            self.silent_until_ns = until_ns
        since_ns = self.silent_since_ns
        if since_ns is None:
            return False
        if is_answer:
            self.silent_since_ns = None
        return self.silent_until_ns - since_ns > self.longest_silence_ns
