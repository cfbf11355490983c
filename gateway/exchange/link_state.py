"""Whether the drives of a line can be reached, how that ended last, and what is told of it.

A connection that its server closes when it is idle comes and goes all day: of each reason the first one is
told, then one a minute with how many there were. What lasts is told in any case.
"""

from collections.abc import Sequence
from typing import Final

from gateway.exchange.axis.acknowledge import OnWire
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MotionState, Said
from gateway.exchange.link_loss import BLINK_NS, CLOSES_SOON_NS, HEARD_NS, LinkLoss
from gateway.exchange.plan import DONE_BIT
from gateway.limits import Reports, others_of_pairs, times
from gateway.times import NS_PER_S

STREAM_ENDED_NS: Final = NS_PER_S
"""A stream without a setpoint for so long is over, or stands still."""
LASTS_NS: Final = NS_PER_S
"""A line that is down for so long is told of, however often it was told for the same reason."""
NEVER: Final = 1 << 62
IDLE: Final = "closed by its peer when idle"
ASKED: Final = "closed by its peer while a request was unanswered"
AT_REST: Final = frozenset(
    {MotionState.UNKNOWN, MotionState.STOPPED, MotionState.SUPERSEDED, MotionState.ARRIVED}
)
"""Places from which nothing that came through the gateway is under way."""


def is_at_rest(axis: Axis, up_ns: int, now_ns: int) -> bool:
    """Whether nothing of an axis is under way, streamed, unproven or staged: its drive may be left alone.

    ``up_ns``: when the link came up. Something else than a target may move the axis where it was sent off
    since, until its drive has said that it stands.
    """
    has_arrived = axis.motion.state in AT_REST
    if axis.motion.state is MotionState.UNKNOWN:
        has_arrived = axis.motion.sent_off_ns <= up_ns or axis.motion.said is Said.STOOD
    if axis.compensation.is_stream and now_ns - axis.motion.heard_ns < STREAM_ENDED_NS:
        return False
    if axis.motion.state is MotionState.IN_WINDOW:
        has_arrived = DONE_BIT not in axis.plan.bits  # it has no other way to say so
    is_standing = has_arrived and not axis.motion.is_moving and not axis.reference.is_homing
    if not is_standing or axis.acknowledgement.on_wire is not OnWire.NOTHING:
        return False
    staged = axis.rules.staged if axis.plan.motion.waits_for_trigger else None
    if staged is None:
        return True
    last, image = axis.motion.last_target, axis.fields[staged]
    return last is not None and (last.number, last.nominal_words) == (staged, image.nominal_words)


class LinkState:
    """See the module."""

    def __init__(self, axes: Sequence[Axis], *, connects: bool) -> None:
        self._axes = tuple(axes)
        self._connects = connects
        self.loss = LinkLoss.RESTART
        """How it ended last; of a blink that lasts it becomes what that is then."""
        self.lost: tuple[Axis, ...] = self._axes
        """Axes of which nothing is known since it ended: they are read when it is back."""
        self.up_ns = self.down_ns = 0
        self.blinks_until_ns = 0
        """Until then the link may come back as if it had not ended; 0: it did end."""
        self.closes_soon = connects
        """Whether the server may close its connection behind an answer: it was not seen yet that it stays."""
        self.has_closed_soon = False
        """Whether it did so the last time."""
        self._told: Reports[tuple[str, str]] = Reports(others=others_of_pairs)
        self._is_told = True
        """Whether somebody knows that it is down: then that it is up is told, too."""
        self._detail = ""
        self._tell_ns = 0
        """When it is told that it is still down; 0: it was told."""

    @property
    def is_blinking(self) -> bool:
        """Whether it may still come back as if it had not ended."""
        return self.blinks_until_ns > 0

    @property
    def deadline_ns(self) -> int:
        """When something is due here; :data:`NEVER`: nothing is."""
        return min(self.blinks_until_ns or NEVER, self._tell_ns or NEVER)

    def come_up(self, now_ns: int) -> bool:
        """The link is there; return whether that is told."""
        self.up_ns = now_ns
        self.blinks_until_ns = self._tell_ns = 0
        is_told, self._is_told = self._is_told, False
        return is_told

    def go_down(
        self, loss: LinkLoss, heard_ns: Sequence[int], answered_ns: int, now_ns: int
    ) -> tuple[Axis, ...]:
        """The link ended; return the axes of which nothing is known from now on.

        ``heard_ns``: when the drive of each axis answered last; ``answered_ns``: when any did.
        """
        self.loss = loss
        self.down_ns = now_ns
        closed = loss is LinkLoss.IDLE_CLOSE or loss is LinkLoss.OWN_CLOSE
        self.blinks_until_ns = now_ns + BLINK_NS if closed else 0
        by_us = loss is LinkLoss.OWN_CLOSE or loss is LinkLoss.RENEWAL
        if self._connects and not by_us and answered_ns >= self.up_ns:
            self.closes_soon = self.has_closed_soon = now_ns - answered_ns <= CLOSES_SOON_NS
        if loss is LinkLoss.RENEWAL:
            self.lost = ()
        elif closed:
            self.lost = tuple(
                [
                    axis
                    for axis, at_ns in zip(self._axes, heard_ns, strict=True)
                    if not at_ns or now_ns - at_ns > HEARD_NS
                ]
            )
        else:
            self.lost = self._axes
        return self.lost

    def end_blink(self, now_ns: int) -> tuple[Axis, ...]:
        """The link did not come back in time; return the axes of which nothing is known from now on."""
        if not self.blinks_until_ns or now_ns < self.blinks_until_ns:
            return ()
        self.blinks_until_ns = 0
        kept = tuple([axis for axis in self._axes if axis not in self.lost])
        self.lost = self._axes
        return kept

    def tell_down(self, detail: str, now_ns: int, *, is_under_way: bool) -> str | None:
        """Return what is told of the end of the link; None: nothing is told. A loss under way always is.

        What stands behind a colon does not make it another reason. A serial port that was unplugged is told
        of each time.
        """
        if not self._connects:
            self._is_told = True
            return detail
        count = self._told.due(("line-down", detail.partition(":")[0]), now_ns)
        self._detail = detail
        if count or is_under_way:
            self._is_told = True
            return detail + times(count)
        self.tell_later(detail, now_ns)
        return None

    def tell_later(self, detail: str, now_ns: int) -> None:
        """It is told only if it lasts."""
        self._is_told, self._detail, self._tell_ns = False, detail, now_ns + LASTS_NS

    def tell_nothing(self) -> None:
        """It is closed because nobody needs it."""
        self._is_told, self._tell_ns = False, 0

    def tell_lasting(self, now_ns: int) -> str:
        """Return what is told of a link that is still down, "" where nothing is due."""
        if not self._tell_ns or now_ns < self._tell_ns:
            return ""
        self._tell_ns = 0
        self._is_told = True
        return self._detail
