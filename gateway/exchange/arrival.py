"""How far the move to the last accepted target has come, as far as anybody can tell.

A done bit that was left from the move before looks like arrival, and so does a position that is passed by.
A sample is as old as the sending of its request, and counts only if that was after the acknowledgement. The
done bit counts only after it was seen to fall, or once the drive has had the time to let it fall; where the
actual position is mapped, that has to lie in the in-position window too.
"""

from enum import Enum
from typing import Final

from gateway.times import NS_PER_MS


class Stage(Enum):
    """How far a move has come."""

    UNDER_WAY = "under-way"
    """Nothing has shown the axis at its target."""
    DONE_SAID = "done-said"
    """Its drive says done; where it stands has not been seen yet."""
    SEEN_THERE = "seen-there"
    """Its actual position was seen in the window; its drive has not said done."""
    ARRIVED = "arrived"
    """Both, or the drive's word alone where no actual position is mapped."""
    MAY_HAVE_LEFT = "may-have-left"
    """Done fell after that: a motion that is not of our making, or the bit has flickered."""


class Sign(Enum):
    """What was seen of an axis."""

    DONE = "done"
    DONE_ALONE = "done-alone"
    """Done, and there is no actual position to look at."""
    FELL = "fell"
    """Not done."""
    THERE = "there"
    """The actual position lies in the in-position window."""
    NEAR = "near"
    """It lies beside it, by no more than a correction."""
    AWAY = "away"
    """It lies elsewhere."""


class Said(Enum):
    """What the drive has said since the last motion began: the end of an old one and of this look alike."""

    NOTHING = "nothing"
    """Nothing that could not be of the time before."""
    MOVES = "moves"
    STOOD = "stood"
    """It moved, and then stood."""


AFTER: Final = {
    (Stage.UNDER_WAY, Sign.DONE): Stage.DONE_SAID,
    (Stage.UNDER_WAY, Sign.DONE_ALONE): Stage.ARRIVED,
    (Stage.UNDER_WAY, Sign.THERE): Stage.SEEN_THERE,
    (Stage.DONE_SAID, Sign.FELL): Stage.MAY_HAVE_LEFT,
    (Stage.DONE_SAID, Sign.THERE): Stage.ARRIVED,
    (Stage.DONE_SAID, Sign.AWAY): Stage.UNDER_WAY,
    (Stage.SEEN_THERE, Sign.DONE): Stage.ARRIVED,
    (Stage.SEEN_THERE, Sign.DONE_ALONE): Stage.ARRIVED,
    (Stage.SEEN_THERE, Sign.AWAY): Stage.UNDER_WAY,
    (Stage.ARRIVED, Sign.FELL): Stage.MAY_HAVE_LEFT,
    (Stage.ARRIVED, Sign.AWAY): Stage.UNDER_WAY,
    (Stage.MAY_HAVE_LEFT, Sign.THERE): Stage.SEEN_THERE,
    (Stage.MAY_HAVE_LEFT, Sign.NEAR): Stage.SEEN_THERE,
    (Stage.MAY_HAVE_LEFT, Sign.AWAY): Stage.UNDER_WAY,
}
"""What each sign makes of each stage; what is not here changes nothing."""
WAS_THERE: Final = frozenset({Stage.DONE_SAID, Stage.SEEN_THERE, Stage.ARRIVED, Stage.MAY_HAVE_LEFT})
"""Stages from which an axis that is seen away has been moved by something else."""


class Arrival:
    """The move of one axis. Times are monotonic, in ns; a sample carries that of its request."""

    __slots__ = ("_drop_ns", "_has_actual", "_is_in_position_only", "_said", "_since_ns", "stage")

    def __init__(self, done_drop_ms: float, *, has_actual: bool, is_in_position_only: bool) -> None:
        self._drop_ns = int(done_drop_ms * NS_PER_MS)
        self._has_actual = has_actual
        self._is_in_position_only = is_in_position_only
        self._since_ns = 0
        self._said = Said.NOTHING
        self.stage = Stage.UNDER_WAY

    @property
    def is_proven(self) -> bool:
        """Whether the axis is known to stand at its target."""
        return self.stage is Stage.ARRIVED

    @property
    def may_have_left(self) -> bool:
        """Whether it was there and may have been moved since."""
        return self.stage is Stage.MAY_HAVE_LEFT

    @property
    def is_at_rest(self) -> bool:
        """Whether anything says that it stands."""
        return self.stage is not Stage.UNDER_WAY

    def begin(self, now_ns: int) -> None:
        """The drive was made to move, or may have been."""
        self.stage = Stage.UNDER_WAY
        self._since_ns = now_ns
        self._said = Said.NOTHING

    def lose_place(self) -> None:
        """Nobody knows any more where the axis goes; how long ago it was sent there stays."""
        self.stage = Stage.UNDER_WAY

    def resume(self, stage: Stage, since_ns: int = 0) -> None:
        """Go on where another run of the gateway left off; ``since_ns``: when it sent the axis there."""
        self.begin(since_ns)
        self.stage = stage

    def has_started(self, asked_ns: int) -> bool:
        """Whether a done bit that was asked for then is not that of the move before."""
        is_new = self._said is not Said.NOTHING or asked_ns - self._since_ns >= self._drop_ns
        return is_new and asked_ns >= self._since_ns

    def may_stand(self, asked_ns: int) -> bool:
        """Whether a position that was asked for then may be that of an axis that has come to rest."""
        return self.has_started(asked_ns) and self._said is not Said.MOVES

    def hear(self, asked_ns: int, *, moves: bool) -> None:
        """Take note of the drive's word that it moves, or stands, wherever it goes."""
        if asked_ns < self._since_ns:
            return
        if moves:
            self._said = Said.MOVES
        elif self._said is Said.MOVES:
            self._said = Said.STOOD

    def see_done(self, asked_ns: int, *, is_done: bool) -> None:
        """Take note of the done bit."""
        if asked_ns < self._since_ns:
            return
        self.hear(asked_ns, moves=not is_done)
        if not is_done:
            self._take(Sign.FELL)
        elif self.has_started(asked_ns) and (self._has_actual or not self._is_in_position_only):
            self._take(Sign.DONE if self._has_actual else Sign.DONE_ALONE)

    def see_place(self, asked_ns: int, sign: Sign) -> bool:
        """Take note of the actual position; whether something else has moved the axis away."""
        if asked_ns < self._since_ns:
            return False
        was_there = self.stage in WAS_THERE
        self._take(sign)
        return was_there and sign is Sign.AWAY

    def _take(self, sign: Sign) -> None:
        self.stage = AFTER.get((self.stage, sign), self.stage)
