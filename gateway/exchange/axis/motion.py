"""Where an axis is, as far as the gateway can know (M4 to M6).

An acknowledged target makes the axis move (``MOVING``). A done bit and actual positions then prove its
arrival step by step (``DONE_REPORTED``, ``IN_WINDOW``, ``ARRIVED``). A stop, a jog, homing, an alarm or a
lost reply takes that knowledge away. For an axis that has arrived, the sign of its next travel gives the
branch of the next target, however short the travel is. For any other axis a reading must give it. Without a
reading the branch is assumed and flagged (``render``).

Three terms: the *branch* is the side from which the axis came to its position: with rising or with falling
positions. Its *way* is the range of positions from its start to its target. A *stream* is a drive that gets
setpoints one after the other and lags behind them.

An observation counts only if it cannot be older than the last command. A reading has the time at which its
request was sent. A done bit may still be that of the move before. It counts only after it was seen to fall,
or after the drive had enough time to clear it (:class:`Reported`).

:class:`Motion` is the machine. :meth:`Motion.enter` sets the data of a state together with the state, and
nothing else does: the unacknowledged target exists exactly in ``UNACKNOWLEDGED``, the target from before a
loss exactly in ``SUPERSEDED``, and the accepted target (``gateway.compensation``) exactly in
:data:`TARGETED`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from gateway.compensation.axis import AxisCompensation
from gateway.compensation.moves import Accepted, Move, SteadyMove
from gateway.counts import Counts
from gateway.drives.motion import NextTarget
from gateway.exchange.axis.acknowledge import (
    AT_ONE_END,
    DECIDED,
    PROOF_AFTER,
    Acknowledgement,
    Proof,
    Rendering,
    WayEnd,
)
from gateway.exchange.axis.impossible import IGNORED, fault, sentence_of
from gateway.exchange.axis.registers import FieldImage
from gateway.exchange.field_counts import counts_of
from gateway.exchange.plan import DONE_BIT, AxisPlan, CompensationMode
from gateway.times import NS_PER_MS, NS_PER_S


class MotionState(Enum):
    """Where the axis is, as far as the gateway can know."""

    __hash__ = object.__hash__  # looked up for each sample; the hash of Enum is slow

    UNKNOWN = "unknown"
    """Something other than a target decides where it is: homing, a jog, a stored position, an alarm."""
    STOPPED = "stopped"
    """A stop came after the last target: the axis is somewhere on its way, on the branch of that target."""
    SUPERSEDED = "superseded"
    """The last target is void, but its words are kept: the reference has changed, the drive could not be
    reached, or it was silent for long. If the axis is then seen at that target, a repeat of the target gets
    the same words and moves nothing."""
    UNACKNOWLEDGED = "unacknowledged"
    """A target was sent and not acknowledged: the drive may hold it or not. It may have reported done
    since."""
    MOVING = "moving"
    """The last target was acknowledged, and the axis was not seen there yet. Its start and branch may be
    known or not."""
    DONE_REPORTED = "done-reported"
    """Its drive reports done; its position was not seen yet."""
    IN_WINDOW = "in-window"
    """Its actual position was seen in the window; its drive has not reported done."""
    ARRIVED = "arrived"
    """Its drive reports done, and it was seen in the window; without a mapped position, done alone."""
    MAY_HAVE_LEFT = "may-have-left"
    """Its drive reports done no longer: something else moves it, or the bit flickered."""
    AT_REST = "at-rest"
    """It is at standstill, at its target or elsewhere. It enters this state from ``MAY_HAVE_LEFT`` if its
    drive reports done again, and from ``ARRIVED`` if it is seen beside its target."""


# Member lookup is slow, and these are used for each move.
_UNKNOWN: Final = MotionState.UNKNOWN
_STOPPED: Final = MotionState.STOPPED
_SUPERSEDED: Final = MotionState.SUPERSEDED
_UNACKNOWLEDGED: Final = MotionState.UNACKNOWLEDGED
_MOVING: Final = MotionState.MOVING
_DONE_REPORTED: Final = MotionState.DONE_REPORTED
_ARRIVED: Final = MotionState.ARRIVED
_MAY_HAVE_LEFT: Final = MotionState.MAY_HAVE_LEFT

TARGETED: Final = frozenset(
    {
        MotionState.MOVING,
        MotionState.DONE_REPORTED,
        MotionState.IN_WINDOW,
        MotionState.ARRIVED,
        MotionState.MAY_HAVE_LEFT,
        MotionState.AT_REST,
    }
)
"""States in which the last accepted target says where the axis is or goes."""
WAS_THERE: Final = TARGETED - {_MOVING}
"""States in which an axis seen elsewhere was moved by something else."""
MAY_BE_ELSEWHERE: Final = frozenset({MotionState.MAY_HAVE_LEFT, MotionState.AT_REST})
"""States in which the position is read before a repeat of the target (M4)."""
ON_BRANCH: Final = TARGETED | {_STOPPED}
"""States in which the axis is or moves on the branch of the last target."""


class MotionEvent(Enum):
    """What decides, or shows, where an axis is."""

    __hash__ = object.__hash__  # looked up for each sample; the hash of Enum is slow

    ACKNOWLEDGED = "acknowledged"
    """The drive acknowledged a target and goes there, or was seen to have gone there."""
    NOT_ACKNOWLEDGED = "not-acknowledged"
    """A target was sent, and its acknowledgement never came."""
    NOT_EXECUTED = "not-executed"
    """An unacknowledged distance was not executed: the axis was seen where it would have started."""
    STOPPED = "stopped"
    """It has stopped, or soon will, somewhere on its way."""
    DISPLACED = "displaced"
    """Something other than a target moves it or has moved it, or that is unknown."""
    LINK_LOST = "link-lost"
    """The link to its drive was lost, or the drive was silent for so long that it may have been switched off.
    There is a target whose words the drive holds."""
    REFERENCE_CHANGED = "reference-changed"
    """Its last target is void from now on, and nothing but a target has moved it since."""
    DONE = "done"
    """Its drive reports done, and the report is not older than the last command."""
    DONE_ALONE = "done-alone"
    """The same, for an axis without an actual position."""
    NOT_DONE = "not-done"
    """Its drive reports: not done."""
    IN_WINDOW = "in-window"
    """The actual position is in the in-position window of the last target."""
    BESIDE = "beside"
    """It is beside the window, by no more than a correction."""
    ELSEWHERE = "elsewhere"
    """It is elsewhere."""


MOTION_AFTER: Final[dict[MotionState, dict[MotionEvent, MotionState | None]]] = {
    MotionState.UNKNOWN: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.UNKNOWN,  # it stops on an unknown branch
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        # It goes to no known target: a bit says only whether it moves (``Reported``).
        MotionEvent.DONE: IGNORED,
        MotionEvent.DONE_ALONE: IGNORED,
        MotionEvent.NOT_DONE: IGNORED,
        MotionEvent.IN_WINDOW: IGNORED,  # a dry run (positions pass 1:1) ends, and there was no target
        # Not executed: no target is open. Link lost, reference changed: there is no target to keep, so they
        # are handled as the event displaced. Beside, elsewhere: there is no accepted target to compare with.
    },
    MotionState.STOPPED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.DONE: IGNORED,  # as for ``UNKNOWN``
        MotionEvent.DONE_ALONE: IGNORED,
        MotionEvent.NOT_DONE: IGNORED,
        # Not executed, link lost, reference changed, beside, elsewhere: as for ``UNKNOWN``. In window: a dry
        # run does not end while the position is unknown.
    },
    MotionState.SUPERSEDED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.UNKNOWN,  # a void target gives no branch
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,  # again: the first loss stays the reason
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: IGNORED,  # as for ``UNKNOWN``
        MotionEvent.DONE_ALONE: IGNORED,
        MotionEvent.NOT_DONE: IGNORED,
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,  # it was moved since: the same words would be wrong
        # Not executed: no target is open. In window, beside: the next target checks that
        # (``seen_at_superseded``).
    },
    MotionState.UNACKNOWLEDGED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,  # the next target, or a proof that this one was taken
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,  # the next target
        MotionEvent.NOT_EXECUTED: MotionState.MOVING,  # it is where the target before sent it
        MotionEvent.STOPPED: MotionState.UNKNOWN,  # it may be on either of two ways
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.DONE: MotionState.UNACKNOWLEDGED,  # it is at one of two positions
        MotionEvent.DONE_ALONE: MotionState.UNACKNOWLEDGED,
        MotionEvent.NOT_DONE: IGNORED,  # it goes there, or has; an earlier done report stays valid
        # Link lost, reference changed: handled as displaced, because the drive's target is unknown. In
        # window, beside, elsewhere: a reading causes an event only when it proves that the target was
        # executed (acknowledged) or was not (not executed); see ``Proof``.
    },
    MotionState.MOVING: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: MotionState.DONE_REPORTED,
        MotionEvent.DONE_ALONE: MotionState.ARRIVED,  # there is no other proof
        MotionEvent.NOT_DONE: IGNORED,  # as expected
        MotionEvent.IN_WINDOW: MotionState.IN_WINDOW,
        MotionEvent.BESIDE: IGNORED,  # it comes from there, or passes through
        MotionEvent.ELSEWHERE: IGNORED,
    },
    MotionState.DONE_REPORTED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: IGNORED,
        MotionEvent.NOT_DONE: MotionState.MAY_HAVE_LEFT,
        MotionEvent.IN_WINDOW: MotionState.ARRIVED,
        MotionEvent.BESIDE: IGNORED,  # a done drive may be off by a correction: the next reading decides
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,  # another motion is done
        # Done alone: without an actual position done is arrival, so this state does not occur.
    },
    MotionState.IN_WINDOW: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: MotionState.ARRIVED,
        MotionEvent.NOT_DONE: IGNORED,  # it settles
        MotionEvent.IN_WINDOW: IGNORED,
        MotionEvent.BESIDE: MotionState.MOVING,  # it overshot or passed through: as if not seen there
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,
        # Done alone: an axis in the window has an actual position.
    },
    MotionState.ARRIVED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: IGNORED,
        MotionEvent.DONE_ALONE: IGNORED,
        MotionEvent.NOT_DONE: MotionState.MAY_HAVE_LEFT,
        MotionEvent.IN_WINDOW: IGNORED,
        MotionEvent.BESIDE: MotionState.AT_REST,  # pushed or crept: at standstill, but not quite there
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,
    },
    MotionState.MAY_HAVE_LEFT: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: MotionState.AT_REST,
        MotionEvent.DONE_ALONE: IGNORED,  # at standstill; nothing shows whether it is there again
        MotionEvent.NOT_DONE: IGNORED,
        MotionEvent.IN_WINDOW: IGNORED,  # it may pass through: its drive must report done first
        MotionEvent.BESIDE: IGNORED,
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,
    },
    MotionState.AT_REST: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: IGNORED,
        MotionEvent.NOT_DONE: MotionState.MAY_HAVE_LEFT,
        MotionEvent.IN_WINDOW: MotionState.ARRIVED,
        MotionEvent.BESIDE: IGNORED,
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,
        # Done alone: an axis without an actual position never enters this state.
    },
}
"""The state after each event. ``IGNORED``: nothing changes, not even the data of the state. A row that leads
to its own state replaces the data with that of the event. A missing pair is impossible."""


class Reported(Enum):
    """What the drive has reported since the last command. Old and new moves end with the same report."""

    NOTHING = "nothing"
    """Nothing that is certainly newer than the command."""
    MOVES = "moves"
    STOOD = "stood"
    """It moved, and then it was at standstill."""


@dataclass(slots=True)
class Actual:
    """The last actual position seen, as the drive reported it."""

    counts: Counts
    seen_ns: int


# --- the target from before a loss -------------------------------------------------------------------------


class RepeatKind(Enum):
    """How to handle a target that equals the one from before a loss of reach or reference."""

    NEW = "new"
    """As a new target: none is kept, or the axis was seen elsewhere since."""
    SAME_WORDS = "same-words"
    """With the same words as before. Either the axis was seen at standstill there since. Or the position
    cannot be read, and the drive moves with each write: a cyclic writer must not make it jump."""
    UNSEEN = "unseen"
    """The position cannot be read, and the drive waits for a trigger: the target is refused until a reading
    or a different target comes."""


REPEAT_KINDS: Final[dict[tuple[bool, bool, bool], RepeatKind]] = {
    # seen there since, drive waits for a trigger, seen there before the loss
    (True, True, True): RepeatKind.SAME_WORDS,
    (True, True, False): RepeatKind.SAME_WORDS,
    (True, False, True): RepeatKind.SAME_WORDS,
    (True, False, False): RepeatKind.SAME_WORDS,
    (False, False, True): RepeatKind.SAME_WORDS,
    (False, False, False): RepeatKind.SAME_WORDS,
    (False, True, True): RepeatKind.UNSEEN,
    (False, True, False): RepeatKind.NEW,
}
"""How to handle a kept target; one that was seen elsewhere is not kept any more."""


class KeptOver(Enum):
    """The kind of loss over which a last target is kept."""

    LOSS = "loss"
    """The drive may have been switched off, or counts from another zero."""
    ORDERLY_CLOSE = "orderly-close"
    """The link was closed in order, and nothing else was lost: the drive may still hold these words."""
    DECLARATION = "declaration"
    """Nothing was lost: a person declared the reference, and the drive still holds these words."""


class Superseded(NamedTuple):
    """The last target as its drive received it, kept over a loss of reach or reference."""

    number: int
    nominal_words: bytes
    corrected_words: bytes
    corrected_counts: Counts
    move: Move
    """The correction in it."""
    was_there: bool
    """The axis was seen at it, or its drive reported so, before the loss."""
    newest_ns: int
    """When the last actual position before the loss was requested: only a later one proves anything."""
    over: KeptOver = KeptOver.LOSS
    is_other_reference: bool = False
    """The reference has changed; otherwise the drive could not be reached, or was silent for long."""

    @property
    def is_declared(self) -> bool:
        """Whether it needs no proof, because nothing was lost."""
        return self.over is KeptOver.DECLARATION


# --- the machine -------------------------------------------------------------------------------------------


class Motion:
    """Where one axis is, and what was seen of it. Time is monotonic, in ns."""

    __slots__ = (
        "_acknowledgement",
        "_done_drop_ns",
        "_on_fault",
        "actual",
        "compensation",
        "fields",
        "has_reported_done",
        "has_rules",
        "heard_ns",
        "is_moving",
        "is_start_known",
        "last_number",
        "plan",
        "reported",
        "sent_off_ns",
        "state",
        "superseded",
        "unacknowledged",
    )

    def __init__(
        self,
        plan: AxisPlan,
        compensation: AxisCompensation,
        acknowledgement: Acknowledgement,
        fields: list[FieldImage],
        on_fault: Callable[[str], None],
    ) -> None:
        self.plan = plan
        self.compensation = compensation
        self._acknowledgement = acknowledgement
        self.fields = fields
        self._on_fault = on_fault
        self.has_rules = plan.has_rules
        """Whether a frame to it may mean something other than a position to go to immediately."""
        self._done_drop_ns = int(plan.done_drop_ms * NS_PER_MS)
        # --- the state and its data: only ``enter`` sets them
        self.state = _UNKNOWN
        self.unacknowledged: Rendering | None = None
        """The unacknowledged target; only in the state of that name."""
        self.has_reported_done = False
        """Its drive has reported done since it was sent; only in that state."""
        self.superseded: Superseded | None = None
        """The last target from before a loss; only in the state of that name."""
        self.is_start_known = False
        """Its position and branch were known at its start; only while ``MOVING``."""
        # --- what was seen and reported
        self.reported = Reported.NOTHING
        self.sent_off_ns = 0
        """When the drive was last made to move, or may have been."""
        self.last_number: int | None = None
        """Number of the command field that brought the last accepted target."""
        self.actual: Actual | None = None
        self.heard_ns = 0
        """When the axis was last seen, or its drive last acknowledged something."""
        self.is_moving = False
        """Its moving bit was set when last seen, and nothing was commanded since."""

    # --- changes of state ------------------------------------------------------------------------------

    def happens(
        self,
        event: MotionEvent,
        target: Rendering | None = None,
        superseded: Superseded | None = None,
        *,
        is_start_known: bool = False,
    ) -> None:
        """Enter the state that the table gives, with its data."""
        try:
            after = MOTION_AFTER[self.state][event]
        except KeyError:
            self._on_fault(sentence_of("motion", self.state, event))  # ``_on_fault`` enters ``UNKNOWN``
            return
        if after is IGNORED:
            return
        has_reported_done = after is _UNACKNOWLEDGED and target is None
        if has_reported_done:
            target = self.unacknowledged
        self.enter(
            after, target, superseded, is_start_known=is_start_known, has_reported_done=has_reported_done
        )

    def enter(
        self,
        state: MotionState,
        unacknowledged: Rendering | None = None,
        superseded: Superseded | None = None,
        *,
        is_start_known: bool = False,
        has_reported_done: bool = False,
    ) -> None:
        """Enter a state with exactly its data; with missing data the position becomes unknown."""
        has_its_own = (
            (unacknowledged is not None) is (state is _UNACKNOWLEDGED)
            and (superseded is not None) is (state is _SUPERSEDED)
            and (state not in TARGETED or self.compensation.accepted is not None)
        )
        if not has_its_own:
            self._on_fault(fault(f"motion: {state.value} without what belongs to it"))
            return
        if state not in TARGETED:
            self.compensation.forget_target()
        before = self.unacknowledged
        if before is not None and before is not unacknowledged:
            self._acknowledgement.let_go(before)
        self.state = state
        self.unacknowledged = unacknowledged
        self.has_reported_done = has_reported_done
        self.superseded = superseded
        self.is_start_known = is_start_known

    def resume(self, state: MotionState, sent_off_ns: int, number: int) -> None:
        """Continue as a record says; ``number``: of the command field of its last target."""
        self.enter(state)
        self.send_off(sent_off_ns)
        self.last_number = number

    def replace_unacknowledged(self, unacknowledged: Rendering) -> None:
        """Add knowledge about the unacknowledged target, which stays the same one."""
        self.unacknowledged = unacknowledged

    def mark_kept_over(self, over: KeptOver) -> None:
        """Record the kind of loss over which the last target is kept, if one is."""
        if self.superseded is not None:
            self.superseded = self.superseded._replace(over=over)

    # --- what moves it ---------------------------------------------------------------------------------

    def send_off(self, now_ns: int) -> None:
        """The drive starts to move, or may: its earlier reports count no more."""
        self.sent_off_ns = now_ns
        self.reported = Reported.NOTHING

    def displace(self, moved_ns: int | None = None, *, keeps_branch: bool = False) -> None:
        """Something other than the last target decides where the axis is (M5).

        ``moved_ns``: since when it may be on a new way; None: it is on none. ``keeps_branch``: it is still on
        the branch of the last target, as after a stop.
        """
        self.happens(MotionEvent.STOPPED if keeps_branch else MotionEvent.DISPLACED)
        if moved_ns is not None:
            self.send_off(moved_ns)
        self.is_moving = False

    def lose_reach(self, over: KeptOver) -> None:
        """The drive is out of reach: its last target may still be valid or not."""
        if self.superseded is not None and self.superseded.over is KeptOver.LOSS:
            over = KeptOver.LOSS  # an orderly close afterwards does not undo the loss
        last = self.last_target
        if last is None:
            self.happens(MotionEvent.DISPLACED)
        else:
            self.happens(MotionEvent.LINK_LOST, None, last._replace(over=over))
        self.is_moving = False

    def change_reference(self) -> None:
        """Its positions become meaningful, or stop being so; a stream keeps its branch."""
        last = self.last_target
        if self.compensation.is_stream:
            self.displace(keeps_branch=True)
        elif last is None:
            self.displace()
        else:
            self.happens(MotionEvent.REFERENCE_CHANGED, None, last._replace(is_other_reference=True))
            self.is_moving = False

    def go(self, rendering: Rendering, move: Move, now_ns: int) -> None:
        """The axis goes to a target, or has gone there, whatever its registers hold now."""
        compensation = self.compensation
        target = (move.nominal_counts, rendering.corrected_counts)
        is_same_way = self.is_start_known and compensation.accepted == target
        was_seen = compensation.is_seen
        compensation.commit(move, rendering.corrected_counts, is_reached=self.state is _ARRIVED)
        self._set_out(rendering.number, now_ns, was_seen=was_seen, is_same_way=is_same_way)

    def go_on(self, number: int, steady: SteadyMove, corrected_counts: Counts, now_ns: int) -> None:
        """Do the same for a target on the fast path: it continues in its direction."""
        compensation = self.compensation
        was_seen = compensation.is_seen
        compensation.go_on(steady, corrected_counts, is_reached=self.state is _ARRIVED)
        self._set_out(number, now_ns, was_seen=was_seen, is_same_way=False)

    def _set_out(self, number: int, now_ns: int, *, was_seen: bool, is_same_way: bool) -> None:
        """It moves to the target of a command field, from a known start or an unknown one."""
        state, had_reported_done = self.state, self.has_reported_done
        self.last_number = number
        if state is _MOVING:
            self.is_start_known = is_same_way  # the same state, with the same data
        else:
            is_known = state is _ARRIVED or state is _STOPPED or (was_seen and state in WAS_THERE)
            self.happens(MotionEvent.ACKNOWLEDGED, is_start_known=is_known)
        if not self.compensation.is_stream or had_reported_done or state in WAS_THERE:
            self.send_off(now_ns)
        self.is_moving = False

    def leave_unacknowledged(self, rendering: Rendering, now_ns: int) -> None:
        """A target unlike the last one was sent, and was not acknowledged."""
        unacknowledged, before = self.unacknowledged, self.unacknowledged or self.compensation.accepted
        if before is not None:  # an axis seen near both may have gone to either
            distance_counts = abs(rendering.corrected_counts - before.corrected_counts)
            is_beside = 0.0 < distance_counts <= 2.0 * self.plan.settings.hysteresis_counts
            if unacknowledged is not None and not distance_counts:  # the same target again
                is_beside = unacknowledged.is_beside_another
            rendering = self._acknowledgement.marked(
                rendering, rendering._replace(is_beside_another=is_beside)
            )
        self.happens(MotionEvent.NOT_ACKNOWLEDGED, rendering)
        self.send_off(now_ns)
        self.is_moving = False

    def run_not(self, start: Accepted) -> None:
        """An unacknowledged distance was not executed: the axis is where it would have started."""
        was_done = self.has_reported_done
        self.compensation.accept_again(start)
        self.happens(MotionEvent.NOT_EXECUTED)
        if was_done:
            self.happens(MotionEvent.DONE if self.plan.actual else MotionEvent.DONE_ALONE)

    # --- what is seen of it ----------------------------------------------------------------------------

    def see(self, actual: Actual) -> None:
        """Record the position that the drive reported."""
        self.actual = actual
        self.heard_ns = actual.seen_ns

    def forget_position(self) -> None:
        """Forget the position that the drive reported: it is void."""
        self.actual = None

    def mark_heard(self, now_ns: int) -> None:
        """The drive acknowledged something, or reported one of its bits."""
        self.heard_ns = now_ns

    def observe_motion(self, asked_ns: int, *, moves: bool) -> None:
        """Record whether the drive reports motion, whatever its target is."""
        if asked_ns < self.sent_off_ns:
            return
        if moves:
            self.reported = Reported.MOVES
        elif self.reported is Reported.MOVES:
            self.reported = Reported.STOOD

    def observe_done(self, asked_ns: int, *, is_done: bool) -> None:
        """Record the drive's done bit; without a known target it only says whether the axis moves."""
        self.observe_motion(asked_ns, moves=not is_done)
        if asked_ns < self.sent_off_ns:
            return
        has_actual = bool(self.plan.actual)
        if not is_done:
            self.happens(MotionEvent.NOT_DONE)
        elif self.has_started(asked_ns) and (has_actual or not self.plan.done_is_in_position):
            self.happens(MotionEvent.DONE if has_actual else MotionEvent.DONE_ALONE)

    def observe_moving(self, asked_ns: int, *, is_moving: bool) -> None:
        """Record the drive's moving bit; where a done bit is mapped, that one decides."""
        self.is_moving = is_moving
        if DONE_BIT not in self.plan.bits:
            self.observe_motion(asked_ns, moves=is_moving)

    def see_position(self, actual: Actual) -> None:
        """Decide whether the axis has reached its target, or something else moved it away (M4)."""
        if actual.seen_ns < self.sent_off_ns:
            return
        accepted = self.compensation.accepted
        assert accepted is not None
        if self.is_at_target(actual.counts):
            is_start_unknown = self.state is _MOVING and not self.is_start_known
            if is_start_unknown and self.compensation.readback.fade is not None:
                return  # the reading still fades from an unknown start: the axis may have been there already
            event = MotionEvent.IN_WINDOW
        elif abs(actual.counts - accepted.corrected_counts) <= self.plan.settings.max_correction_counts:
            event = MotionEvent.BESIDE
        elif self.compensation.is_stream and self.state is _DONE_REPORTED:
            return  # a stream lags behind its setpoints, done or not
        elif self.plan.next_target is NextTarget.QUEUED and self.state is not _ARRIVED:
            return  # done may belong to the target before, and the axis may still be there
        else:
            event = MotionEvent.ELSEWHERE
        self.happens(event)

    def take_poll(self, actual: Actual, *, is_for_distance: bool) -> None:
        """Use a position that was read because the axis was unseen for a while: it may have been moved.

        An axis that had not arrived may be anywhere on its way. That is no base for a distance.
        """
        if self.is_at_target(actual.counts) or self.is_seen_at_superseded:
            return
        is_on_way = self.state is _MOVING and self._is_on_way(actual)
        if is_for_distance or not is_on_way:
            self.displace()

    def see_way(self, actual: Actual) -> None:
        """Check whether an axis that was unseen for a while has left its way (M4, M6).

        With an unknown start every position is on its way. A stream has no way that it could leave.
        """
        low, high = self.compensation.way
        is_known = low < high or self.is_start_known
        if is_known and not self.compensation.is_stream and not self._is_on_way(actual):
            self.displace()

    def _is_on_way(self, actual: Actual) -> bool:
        low, high = self.compensation.way
        window = self.plan.settings.in_position_counts
        return low - window <= actual.counts <= high + window

    def has_jumped(self, before: Actual, now: Actual) -> bool:
        """Whether an axis at standstill changed its position faster than any motion could (M9)."""
        settings = self.plan.settings
        if not settings.max_speed:
            return False
        distance = abs(now.counts - before.counts) / abs(settings.counts_per_unit)
        reach = settings.max_speed * (now.seen_ns - before.seen_ns) / NS_PER_S + settings.max_correction
        return distance > 2.0 * reach

    # --- what proves an unacknowledged target ----------------------------------------------------------

    def is_proven(self, before: Actual | None, now: Actual) -> bool:
        """Whether the axis was seen to have gone to the unacknowledged target (M7)."""
        target = self.unacknowledged
        if before is None or target is None or target.move is None or target.is_beside_another:
            return False
        near = self.plan.settings.hysteresis_counts
        end = target.corrected_counts
        return abs(now.counts - end) <= near < abs(before.counts - end)

    def proof_at(self, now: Actual, before: Actual | None = None) -> Proof:
        """Find out from both of its ends whether an unacknowledged distance was executed (M5).

        A reading counts only after the axis had time to start, and only if it may be at standstill. At
        neither end, or at both, the base of the next distance is unknown. A target that a record names is
        handled in the same way.

        Returns:
            ``EXECUTED`` or ``NOT_EXECUTED`` if it is certain; the caller acts on it.
        """
        target = self.unacknowledged
        if target is None or target.start is None or target.move is None:
            return Proof.NONE
        proof = target.proof
        if not self.may_stand(now.seen_ns) or not (proof is Proof.ONE or self.says_done):
            return proof
        settings = self.plan.settings
        window = settings.in_position_counts
        is_at_end = abs(now.counts - target.corrected_counts) <= window
        is_at_start = abs(now.counts - target.start.corrected_counts) <= window
        end = WayEnd.NEITHER if is_at_end is is_at_start else WayEnd.END if is_at_end else WayEnd.START
        if proof in AT_ONE_END and (
            before is None or abs(now.counts - before.counts) > settings.hysteresis_counts
        ):
            proof = Proof.TWO  # it creeps
        proof = PROOF_AFTER[proof][end]
        if proof not in DECIDED and proof is not target.proof:
            self.replace_unacknowledged(self._acknowledgement.marked(target, target._replace(proof=proof)))
        return proof

    @property
    def is_distance_unconfirmed(self) -> bool:
        """Whether it is unknown if a sent distance was executed: the axis is at one of two positions.

        A target that the axis may have gone to or passed counts too (``record.Finding.EITHER``).
        """
        target = self.unacknowledged
        return target is not None and (target.is_distance or target.proof is not Proof.ONE)

    def polls_needed(self, now_ns: int) -> int:
        """Return how many more readings decide whether the target in its record was executed; 0: none."""
        target = self.unacknowledged
        if target is None or target.proof in (Proof.ONE, Proof.NONE) or not self.may_stand(now_ns):
            return 0
        return 1 if target.proof in AT_ONE_END else 2

    @property
    def says_done(self) -> bool:
        """Whether the drive of an axis with an unacknowledged target reports done, or has no done bit."""
        return DONE_BIT not in self.plan.bits or self.has_reported_done

    # --- where it is -----------------------------------------------------------------------------------

    @property
    def is_at_rest(self) -> bool:
        """Whether anything shows that the axis is at standstill."""
        return self.state in WAS_THERE or self.has_reported_done

    @property
    def has_arrived(self) -> bool:
        """Whether the axis is known to be at standstill at its target."""
        return self.state is _ARRIVED

    @property
    def knows_branch(self) -> bool:
        """Whether a drive position can be converted back on a branch that was not merely assumed.

        An axis that has reached its target is at the commanded position, even if its branch was assumed. For
        an axis that was stopped before its target, this does not hold.
        """
        is_assumed = self.state is _STOPPED and self.compensation.is_unsure
        return self.state in ON_BRANCH and not is_assumed

    def is_unseen(self, now_ns: int) -> bool:
        """Whether it may have been moved since it was last seen or last acknowledged something (M5, M6)."""
        return now_ns - self.heard_ns > self.plan.unseen_ms * NS_PER_MS

    def is_at_target(self, corrected_counts: Counts) -> bool:
        """Whether a position is in the in-position window of the last accepted target."""
        accepted = self.compensation.accepted
        if accepted is None:
            return False
        return abs(corrected_counts - accepted.corrected_counts) <= self.plan.settings.in_position_counts

    def has_started(self, asked_ns: int) -> bool:
        """Whether a done bit requested then belongs to the present move."""
        is_new = self.reported is not Reported.NOTHING or asked_ns - self.sent_off_ns >= self._done_drop_ns
        return is_new and asked_ns >= self.sent_off_ns

    def may_stand(self, asked_ns: int) -> bool:
        """Whether a position requested then may be that of an axis at standstill."""
        return self.has_started(asked_ns) and self.reported is not Reported.MOVES

    def nominal_of(self, corrected_counts: Counts) -> float:
        """Nominal counts of an actual position, as the controller would read it, not rounded."""
        if self.plan.compensation is CompensationMode.SHADOW:
            return corrected_counts
        return corrected_counts - self.compensation.readback.correction_counts(corrected_counts)

    @property
    def why_not_at_rest(self) -> str:
        """Why it is not certain to be at standstill at its last target; "" if it is, or has no target yet.

        In a dry run the drive is at the target as it was commanded. Without a position register there is no
        better proof than the drive's last report.
        """
        compensation, accepted = self.compensation, self.compensation.accepted
        if self.unacknowledged is not None:
            return "a target of it is not acknowledged"
        if self.is_moving:
            return "it moves"
        if accepted is None:
            is_never_commanded = self.last_number is None and self.state is _UNKNOWN
            return "" if is_never_commanded else "its position is unknown"
        if self.state in WAS_THERE and self.state is not _MAY_HAVE_LEFT:
            return ""
        if not self.plan.actual:
            return ""
        actual = self.actual
        if actual is None or not compensation.is_seen:
            return "it was not seen at its target"
        away_counts = abs(actual.counts - accepted.nominal_counts)
        return "" if away_counts <= self.plan.settings.in_position_counts else "it is not at its target yet"

    # --- the target from before a loss -----------------------------------------------------------------

    def holds_target(self, number: int) -> bool:
        """Whether a command field holds the last accepted target, on both scales.

        False if it holds a distance, a position written without a reference, or a replaced word.
        """
        accepted, image, field_ = self.compensation.accepted, self.fields[number], self.plan.command[number]
        if accepted is None or image.nominal_words is None or image.corrected_words is None:
            return False
        near = 0.5 * field_.step_counts(accepted.corrected_counts)
        nominal = counts_of(field_, field_.unpack(image.nominal_words))
        corrected = counts_of(field_, field_.unpack(image.corrected_words))
        return (
            abs(nominal - accepted.nominal_counts) < near
            and abs(corrected - accepted.corrected_counts) < near
        )

    @property
    def last_target(self) -> Superseded | None:
        """The last accepted target with its words, if nothing but a target has moved the axis since."""
        accepted, number = self.compensation.accepted, self.last_number
        newest_ns = 0 if self.actual is None else self.actual.seen_ns
        if self.compensation.is_stream or accepted is None or number is None:
            kept = self.superseded
            if kept is None:
                return None
            was_there = kept.was_there or self.is_seen_at_superseded
            over = KeptOver.LOSS if kept.is_declared else kept.over
            return kept._replace(was_there=was_there, newest_ns=newest_ns, over=over)
        image = self.fields[number]
        if not self.holds_target(number):
            return None  # the field holds another staged target by now, or a distance
        assert image.nominal_words is not None
        assert image.corrected_words is not None
        return Superseded(
            number,
            image.nominal_words,
            image.corrected_words,
            accepted.corrected_counts,
            self.compensation.again(),
            self.state in WAS_THERE,
            newest_ns,
        )

    def superseded_as(self, number: int, nominal_words: bytes) -> Superseded | None:
        """Return the target from before a loss of reach or reference, if these words are it; else None."""
        kept = self.superseded
        if kept is None or (kept.number, kept.nominal_words) != (number, nominal_words):
            return None
        return kept

    def repeat_kind(self, number: int, nominal_words: bytes, *, waits: bool) -> RepeatKind:
        """Return how to handle a target that may be the one from before a loss, by present knowledge.

        ``waits``: the drive may wait for a trigger.
        """
        kept = self.superseded_as(number, nominal_words)
        if kept is None:
            return RepeatKind.NEW
        if kept.is_declared:
            return RepeatKind.SAME_WORDS
        if not self.plan.actual and not kept.is_other_reference:
            return RepeatKind.SAME_WORDS  # no reading is possible, and its positions are still meaningful
        return REPEAT_KINDS[self.is_seen_at_superseded, waits, kept.was_there]

    @property
    def is_seen_at_superseded(self) -> bool:
        """Whether the axis was seen, after the loss, at its superseded target."""
        return self.seen_at_superseded is True

    @property
    def seen_at_superseded(self) -> bool | None:
        """Whether it is at its superseded target; None: it was not seen at standstill since.

        With a declared reference another position proves nothing: the axis may still be moving.
        """
        kept, actual = self.superseded, self.actual
        if kept is None or actual is None or actual.seen_ns <= kept.newest_ns or self.is_moving:
            return None
        window = self.plan.settings.in_position_counts
        is_there = abs(actual.counts - kept.corrected_counts) <= window
        return None if kept.is_declared and not is_there else is_there
