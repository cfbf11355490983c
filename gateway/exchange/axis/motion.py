"""Where an axis is, as far as anybody can tell (M4 to M6).

A target that its drive acknowledged makes the axis move (``MOVING``); a done bit and positions that are seen
afterwards prove its arrival step by step (``DONE_REPORTED``, ``IN_WINDOW``, ``ARRIVED``); a stop, a jog,
homing, an alarm or a lost reply takes that away again. Of an axis that has arrived the sign of its next way
tells on which branch the next target lies, however short that way; of any other a reading has to tell, or the
branch is flagged (``render``).

Three words. The *branch* is the side from which the axis came to where it stands: with rising positions, or
with falling ones. Its *way* is the stretch from where it set out to its target. A *stream* is a drive that is
given setpoints one after the other, and lags behind them.

What is seen counts only where it cannot be of the time before. A reading counts from when its request was
sent. A done bit may be that of the move before until it was seen to fall or the drive has had the time
to let it fall (:class:`Reported`).

:class:`Motion` is the machine. What belongs to a state is set with it in :meth:`Motion.enter`, and nowhere
else: the target that was not acknowledged is there exactly in ``UNACKNOWLEDGED``, the target of before a loss
exactly in ``SUPERSEDED``, and the accepted target (``gateway.compensation``) exactly in :data:`TARGETED`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from gateway.compensation.axis import AxisCompensation
from gateway.compensation.moves import Accepted, Move, SteadyMove
from gateway.counts import Counts
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
    """Where the axis is, as far as anybody can tell."""

    __hash__ = object.__hash__  # looked up with each sample; that of Enum is slow

    UNKNOWN = "unknown"
    """Something else than a target decides where it is: homing, a jog, a stored position, an alarm."""
    STOPPED = "stopped"
    """A stop came after the last target: it stands somewhere, on the branch of that target."""
    SUPERSEDED = "superseded"
    """The last target means nothing any more, but its words are kept: the reference has changed since, or its
    drive could not be reached, or was silent for long. If the axis is seen to stand there, a repeat of that
    target is the same words, and moves nothing (:class:`RepeatKind`)."""
    UNACKNOWLEDGED = "unacknowledged"
    """A target was sent and not acknowledged: the drive may hold it or not. It may have said done since."""
    MOVING = "moving"
    """The last target was acknowledged, and nothing has shown the axis there. Where it set out, and on which
    branch, may have been known or not."""
    DONE_REPORTED = "done-reported"
    """Its drive says done; where it stands has not been seen yet."""
    IN_WINDOW = "in-window"
    """Its actual position was seen in the window; its drive has not said done."""
    ARRIVED = "arrived"
    """Its drive says done, and it was seen in the window; or done alone, where no position is mapped."""
    MAY_HAVE_LEFT = "may-have-left"
    """Its drive had said done, and says so no more: something else moves it, or the bit has flickered."""
    AT_REST = "at-rest"
    """It stands, at its target or elsewhere: done rose after ``MAY_HAVE_LEFT``, or it was seen beside its
    target after ``ARRIVED``."""


# A member is looked up slowly, and these are asked for with each move.
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
"""States in which an axis that is seen away has been moved by something else."""
MAY_BE_ELSEWHERE: Final = frozenset({MotionState.MAY_HAVE_LEFT, MotionState.AT_REST})
"""States in which an axis is looked at before a repeat of its target (M4)."""
ON_BRANCH: Final = TARGETED | {_STOPPED}
"""States in which the branch of the last target is that on which the axis stands or moves."""


class MotionEvent(Enum):
    """What decides, or shows, where an axis is."""

    __hash__ = object.__hash__  # looked up with each sample; that of Enum is slow

    ACKNOWLEDGED = "acknowledged"
    """The drive acknowledged a target and goes there, or was seen to have gone there."""
    NOT_ACKNOWLEDGED = "not-acknowledged"
    """A target went out, and its acknowledgement never came."""
    NOT_EXECUTED = "not-executed"
    """A distance that was not acknowledged did not run: the axis was seen where it would have started."""
    STOPPED = "stopped"
    """It stands, or soon will, somewhere on the way that it was on."""
    DISPLACED = "displaced"
    """Something else than a target moves it, or has moved it, or nobody knows."""
    LINK_LOST = "link-lost"
    """The way to its drive was lost, or it was silent for so long that it may have been switched off; there
    is a target whose words the drive holds."""
    REFERENCE_CHANGED = "reference-changed"
    """Its last target means nothing from now on, and nothing but a target has moved it since."""
    DONE = "done"
    """Its drive says done, and what it says is not of the time before."""
    DONE_ALONE = "done-alone"
    """The same, and there is no actual position to look at."""
    NOT_DONE = "not-done"
    """Its drive says: not done."""
    IN_WINDOW = "in-window"
    """The actual position lies in the in-position window of the last target."""
    BESIDE = "beside"
    """It lies beside it, by no more than a correction."""
    ELSEWHERE = "elsewhere"
    """It lies elsewhere."""


MOTION_AFTER: Final[dict[MotionState, dict[MotionEvent, MotionState | None]]] = {
    MotionState.UNKNOWN: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.UNKNOWN,  # it stands on a branch that nobody knows
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        # It goes to no target of ours: a bit says only whether it moves (``Reported``).
        MotionEvent.DONE: IGNORED,
        MotionEvent.DONE_ALONE: IGNORED,
        MotionEvent.NOT_DONE: IGNORED,
        MotionEvent.IN_WINDOW: IGNORED,  # the end of a dry run (``Axis.end_dry_run``) that got no target
        # Not executed: no target is open. Link lost, reference changed: there is no target to keep, so both
        # come as displaced. Beside, elsewhere: there is no accepted target to compare with.
    },
    MotionState.STOPPED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.DONE: IGNORED,  # as of ``UNKNOWN``
        MotionEvent.DONE_ALONE: IGNORED,
        MotionEvent.NOT_DONE: IGNORED,
        # Not executed, link lost, reference changed, beside, elsewhere: as of ``UNKNOWN``. In window: no
        # dry run ends while nobody knows where the axis stands.
    },
    MotionState.SUPERSEDED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.UNKNOWN,  # the branch of a target that means nothing says nothing
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,  # once more: the first loss stays the reason
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: IGNORED,  # as of ``UNKNOWN``
        MotionEvent.DONE_ALONE: IGNORED,
        MotionEvent.NOT_DONE: IGNORED,
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,  # it was moved since: the same words would not help
        # In window, beside: no events here; a target that comes asks for them (``seen_at_superseded``).
    },
    MotionState.UNACKNOWLEDGED: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,  # the next target, or a proof that this one was taken
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,  # the next one
        MotionEvent.NOT_EXECUTED: MotionState.MOVING,  # it stands where the target before sent it
        MotionEvent.STOPPED: MotionState.UNKNOWN,  # nobody knows on which of two ways
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.DONE: MotionState.UNACKNOWLEDGED,  # it stands at one of two places
        MotionEvent.DONE_ALONE: MotionState.UNACKNOWLEDGED,
        MotionEvent.NOT_DONE: IGNORED,  # it goes there, or has: what it was said to be done with stays said
        # Link lost, reference changed: come as displaced, for nobody knows which target its drive holds.
        # Where it is seen proves the target, or that it did not run (``Proof``); it is no event before.
    },
    MotionState.MOVING: {
        MotionEvent.ACKNOWLEDGED: MotionState.MOVING,
        MotionEvent.NOT_ACKNOWLEDGED: MotionState.UNACKNOWLEDGED,
        MotionEvent.STOPPED: MotionState.STOPPED,
        MotionEvent.DISPLACED: MotionState.UNKNOWN,
        MotionEvent.LINK_LOST: MotionState.SUPERSEDED,
        MotionEvent.REFERENCE_CHANGED: MotionState.SUPERSEDED,
        MotionEvent.DONE: MotionState.DONE_REPORTED,
        MotionEvent.DONE_ALONE: MotionState.ARRIVED,  # nothing else can ever tell
        MotionEvent.NOT_DONE: IGNORED,  # as it should be
        MotionEvent.IN_WINDOW: MotionState.IN_WINDOW,
        MotionEvent.BESIDE: IGNORED,  # it comes from there, or goes on there
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
        MotionEvent.BESIDE: IGNORED,  # a done drive may stand off by a correction: the next reading tells
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,  # done with another motion
        # Done alone: without an actual position done is arrival, so this state is never come to.
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
        MotionEvent.BESIDE: MotionState.MOVING,  # it swings, or passed through: as if it had not been there
        MotionEvent.ELSEWHERE: MotionState.UNKNOWN,
        # Done alone: what is in a window was read.
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
        MotionEvent.BESIDE: MotionState.AT_REST,  # pushed, or it has crept: it stands, and not quite there
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
        MotionEvent.DONE_ALONE: IGNORED,  # it stands, and nothing can tell whether it stands there again
        MotionEvent.NOT_DONE: IGNORED,
        MotionEvent.IN_WINDOW: IGNORED,  # it may pass through: its drive has to say done first
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
        # Done alone: an axis without an actual position never comes here.
    },
}
"""What each event makes of each state. ``IGNORED``: nothing happens, and what belongs to the state stays. The
state itself: it is entered anew, with what the event brings. A pair that is not here cannot be."""


class Reported(Enum):
    """What the drive has said since the last motion began: the end of an old one and of this look alike."""

    NOTHING = "nothing"
    """Nothing that could not be of the time before."""
    MOVES = "moves"
    STOOD = "stood"
    """It moved, and then stood."""


@dataclass(slots=True)
class Actual:
    """The last actual position seen, as the drive reported it."""

    counts: Counts
    seen_ns: int


# --- the target of before a loss ---------------------------------------------------------------------------


class RepeatKind(Enum):
    """What a target is that equals the one of before a loss of reach or reference."""

    NEW = "new"
    """A new target: no such one is kept, or the axis was seen elsewhere since."""
    SAME_WORDS = "same-words"
    """The same words as before: the axis was seen to stand there since, or nobody may look and its drive goes
    with each write (a cyclic writer must not jerk it)."""
    UNSEEN = "unseen"
    """Nobody may look, and its drive waits for a trigger: refused until a reading or a different target."""


REPEAT_KINDS: Final[dict[tuple[bool, bool, bool], RepeatKind]] = {
    # was seen there since, its drive waits for a trigger, had been seen there before the loss
    (True, True, True): RepeatKind.SAME_WORDS,
    (True, True, False): RepeatKind.SAME_WORDS,
    (True, False, True): RepeatKind.SAME_WORDS,
    (True, False, False): RepeatKind.SAME_WORDS,
    (False, False, True): RepeatKind.SAME_WORDS,
    (False, False, False): RepeatKind.SAME_WORDS,
    (False, True, True): RepeatKind.UNSEEN,
    (False, True, False): RepeatKind.NEW,
}
"""What a kept target is; one that was seen elsewhere is not kept any more."""


class KeptOver(Enum):
    """What a last target is kept over."""

    LOSS = "loss"
    """The drive may have been switched off, or counts from another zero."""
    ORDERLY_CLOSE = "orderly-close"
    """The link was closed in order, and nothing else was lost: its drive may hold these words still."""
    DECLARATION = "declaration"
    """Nothing was lost: a person has declared the reference, and the drive holds these words as before."""


class Superseded(NamedTuple):
    """The last target as its drive was told it, over a loss of reach or reference."""

    number: int
    nominal_words: bytes
    corrected_words: bytes
    corrected_counts: Counts
    move: Move
    """The correction it was told with."""
    was_there: bool
    """The axis had been seen at it, or its drive had said so, before the loss."""
    newest_ns: int
    """When the last actual position before the loss was asked for: only a later one proves anything."""
    over: KeptOver = KeptOver.LOSS
    is_other_reference: bool = False
    """The reference has changed since; else its drive could not be reached, or was silent for long."""

    @property
    def is_declared(self) -> bool:
        """Whether it needs no proof: nothing was lost."""
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
        """Whether a frame to it may mean something else than positions to be gone to at once."""
        self._done_drop_ns = int(plan.done_drop_ms * NS_PER_MS)
        # --- the state, and what belongs to it: all of that is set in ``enter``
        self.state = _UNKNOWN
        self.unacknowledged: Rendering | None = None
        """The target that was not acknowledged; there exactly in the state of that name."""
        self.has_reported_done = False
        """Its drive has said done since it was sent; only there."""
        self.superseded: Superseded | None = None
        """The last target of before a loss; there exactly in the state of that name."""
        self.is_start_known = False
        """It was known where it stood, and on which branch, when it set out; only while ``MOVING``."""
        # --- what was seen and said
        self.reported = Reported.NOTHING
        self.sent_off_ns = 0
        """When the drive was made to move last, or may have been."""
        self.last_number: int | None = None
        """Of the command field through which the last accepted target came."""
        self.actual: Actual | None = None
        self.heard_ns = 0
        """When it was seen last, or was told something that it acknowledged."""
        self.is_moving = False
        """Its moving bit was set when it was seen last, and nothing has been commanded since."""

    # --- from state to state ---------------------------------------------------------------------------

    def happens(
        self,
        event: MotionEvent,
        target: Rendering | None = None,
        superseded: Superseded | None = None,
        *,
        is_start_known: bool = False,
    ) -> None:
        """Go on to the state that the table says, with what belongs to it."""
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
        """Be in a state, with exactly what belongs to it; with anything else nobody knows where it is."""
        has_its_own = (
            (unacknowledged is not None) is (state is _UNACKNOWLEDGED)
            and (superseded is not None) is (state is _SUPERSEDED)
            and (state not in TARGETED or self.compensation.has_target)
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
        """Go on as a record says; ``number``: of the command field of its last target."""
        self.enter(state)
        self.send_off(sent_off_ns)
        self.last_number = number

    def replace_unacknowledged(self, unacknowledged: Rendering) -> None:
        """Know more of the target that was not acknowledged, which stays the same one."""
        self.unacknowledged = unacknowledged

    def mark_kept_over(self, over: KeptOver) -> None:
        """Note over what the target of before a loss is kept, where there is one."""
        if self.superseded is not None:
            self.superseded = self.superseded._replace(over=over)

    # --- what moves it ---------------------------------------------------------------------------------

    def send_off(self, now_ns: int) -> None:
        """The drive is made to move, or may be: what it said before is of the time before."""
        self.sent_off_ns = now_ns
        self.reported = Reported.NOTHING

    def displace(self, moved_ns: int | None = None, *, keeps_branch: bool = False) -> None:
        """Something else than the last target decides where the axis is (M5).

        ``moved_ns``: since when it may be on a new way; None: it is on none. ``keeps_branch``: it came there
        by the last target all the same, as after a stop.
        """
        self.happens(MotionEvent.STOPPED if keeps_branch else MotionEvent.DISPLACED)
        if moved_ns is not None:
            self.send_off(moved_ns)
        self.is_moving = False

    def lose_reach(self, over: KeptOver) -> None:
        """The drive cannot be seen: what was its last target may be so still, or not."""
        last = self.last_target
        if last is None:
            self.happens(MotionEvent.DISPLACED)
        else:
            self.happens(MotionEvent.LINK_LOST, None, last._replace(over=over))
        self.is_moving = False

    def change_reference(self) -> None:
        """Its positions mean something from now on, or nothing: a stream keeps its branch."""
        last = self.last_target
        if self.compensation.is_stream:
            self.displace(keeps_branch=True)
        elif last is None:
            self.displace()
        else:
            self.happens(MotionEvent.REFERENCE_CHANGED, None, last._replace(is_other_reference=True))
            self.is_moving = False

    def go(self, rendering: Rendering, move: Move, now_ns: int) -> None:
        """The axis goes to a target, or has gone there, whatever its registers hold by now."""
        compensation = self.compensation
        target = (move.nominal_counts, rendering.corrected_counts)
        is_same_way = self.is_start_known and compensation.accepted == target
        was_seen = compensation.is_seen
        compensation.commit(move, rendering.corrected_counts, is_reached=self.state is _ARRIVED)
        self._set_out(rendering.number, now_ns, was_seen=was_seen, is_same_way=is_same_way)

    def go_on(self, number: int, steady: SteadyMove, corrected_counts: Counts, now_ns: int) -> None:
        """The same of a target on the fast path: it goes on in its direction."""
        compensation = self.compensation
        was_seen = compensation.is_seen
        compensation.go_on(steady, corrected_counts, is_reached=self.state is _ARRIVED)
        self._set_out(number, now_ns, was_seen=was_seen, is_same_way=False)

    def _set_out(self, number: int, now_ns: int, *, was_seen: bool, is_same_way: bool) -> None:
        """It is on its way to the target of a field, from where it was known to stand, or not."""
        state, had_reported_done = self.state, self.has_reported_done
        self.last_number = number
        if state is _MOVING:
            self.is_start_known = is_same_way  # the same state, with the same that belongs to it
        else:
            is_known = state is _ARRIVED or state is _STOPPED or (was_seen and state in WAS_THERE)
            self.happens(MotionEvent.ACKNOWLEDGED, is_start_known=is_known)
        if not self.compensation.is_stream or had_reported_done or state in WAS_THERE:
            self.send_off(now_ns)
        self.is_moving = False

    def leave_unacknowledged(self, rendering: Rendering, now_ns: int) -> None:
        """A target that means something else than before was sent, and was not acknowledged."""
        unacknowledged, before = self.unacknowledged, self.unacknowledged or self.compensation.accepted
        if before is not None:  # an axis that is seen near both may have gone to either
            distance_counts = abs(rendering.corrected_counts - before.corrected_counts)
            is_beside = 0.0 < distance_counts <= 2.0 * self.plan.settings.hysteresis_counts
            if unacknowledged is not None and not distance_counts:  # the same once more
                is_beside = unacknowledged.is_beside_another
            rendering = self._acknowledgement.marked(
                rendering, rendering._replace(is_beside_another=is_beside)
            )
        self.happens(MotionEvent.NOT_ACKNOWLEDGED, rendering)
        self.send_off(now_ns)
        self.is_moving = False

    def run_not(self, start: Accepted) -> None:
        """A distance that was not acknowledged did not run: the axis stands where it would have started."""
        was_done = self.has_reported_done
        self.compensation.accept_again(start)
        self.happens(MotionEvent.NOT_EXECUTED)
        if was_done:
            self.happens(MotionEvent.DONE if self.plan.actual else MotionEvent.DONE_ALONE)

    # --- what is seen of it ----------------------------------------------------------------------------

    def see(self, actual: Actual) -> None:
        """Note where the drive said that it was."""
        self.actual = actual
        self.heard_ns = actual.seen_ns

    def forget_position(self) -> None:
        """What the drive said of its place means nothing any more."""
        self.actual = None

    def mark_heard(self, now_ns: int) -> None:
        """The drive has acknowledged something, or told one of its bits."""
        self.heard_ns = now_ns

    def observe_motion(self, asked_ns: int, *, moves: bool) -> None:
        """Take note of the drive's word that it moves, or stands, wherever it goes."""
        if asked_ns < self.sent_off_ns:
            return
        if moves:
            self.reported = Reported.MOVES
        elif self.reported is Reported.MOVES:
            self.reported = Reported.STOOD

    def observe_done(self, asked_ns: int, *, is_done: bool) -> None:
        """Note the drive's done bit; of an axis that goes nowhere we know it only says whether it moves."""
        self.observe_motion(asked_ns, moves=not is_done)
        if asked_ns < self.sent_off_ns:
            return
        has_actual = bool(self.plan.actual)
        if not is_done:
            self.happens(MotionEvent.NOT_DONE)
        elif self.has_started(asked_ns) and (has_actual or not self.plan.done_is_in_position):
            self.happens(MotionEvent.DONE if has_actual else MotionEvent.DONE_ALONE)

    def observe_moving(self, asked_ns: int, *, is_moving: bool) -> None:
        """Note the drive's moving bit; where there is a done bit that may be older, that one counts."""
        self.is_moving = is_moving
        if DONE_BIT not in self.plan.bits:
            self.observe_motion(asked_ns, moves=is_moving)

    def see_position(self, actual: Actual) -> None:
        """Notice that the axis has come to its target, or that something else moved it away (M4)."""
        if actual.seen_ns < self.sent_off_ns:
            return
        accepted = self.compensation.accepted
        assert accepted is not None
        if self.is_at_target(actual.counts):
            is_start_unknown = self.state is _MOVING and not self.is_start_known
            if is_start_unknown and self.compensation.readback.fade is not None:
                return  # the reading still fades from a start that nobody knew: it may have stood there
            event = MotionEvent.IN_WINDOW
        elif abs(actual.counts - accepted.corrected_counts) <= self.plan.settings.max_correction_counts:
            event = MotionEvent.BESIDE
        elif self.compensation.is_stream and self.state is _DONE_REPORTED:
            return  # a stream lags behind its setpoints, done or not
        elif self.plan.queues_targets and self.state is not _ARRIVED:
            return  # it may have been done with the target before, and be there yet
        else:
            event = MotionEvent.ELSEWHERE
        self.happens(event)

    def take_poll(self, actual: Actual, *, is_for_distance: bool) -> None:
        """The axis was asked for, because nobody had seen it for a while: it may have been moved.

        One that was not at its target yet may be anywhere on its way there; a distance has no base there.
        """
        if self.is_at_target(actual.counts) or self.is_seen_at_superseded:
            return
        is_on_way = self.state is _MOVING and self._is_on_way(actual)
        if is_for_distance or not is_on_way:
            self.displace()

    def see_way(self, actual: Actual) -> None:
        """Notice that an axis that nobody had seen for a while is not on its way any more (M4, M6).

        If nobody knows where it set out, every place is on its way; a stream has none to leave.
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
        """Whether an axis at rest stands where no motion can have brought it (M9)."""
        settings = self.plan.settings
        if not settings.max_speed:
            return False
        distance = abs(now.counts - before.counts) / abs(settings.counts_per_unit)
        reach = settings.max_speed * (now.seen_ns - before.seen_ns) / NS_PER_S + settings.max_correction
        return distance > 2.0 * reach

    # --- what proves a target that was not acknowledged ------------------------------------------------

    def is_proven(self, before: Actual | None, now: Actual) -> bool:
        """Whether the axis is seen to have gone to the target that was not acknowledged (M7)."""
        target = self.unacknowledged
        if before is None or target is None or target.move is None or target.is_beside_another:
            return False
        near = self.plan.settings.hysteresis_counts
        end = target.corrected_counts
        return abs(now.counts - end) <= near < abs(before.counts - end)

    def proof_at(self, now: Actual, before: Actual | None = None) -> Proof:
        """Find out whether a distance that was never acknowledged has run: from which of its ends (M5).

        Only of an axis that has had the time to start and may stand. At neither of the ends, or at both,
        nobody knows where the next distance would begin. So it is with a target that a record names.

        Returns:
            ``EXECUTED`` or ``NOT_EXECUTED`` where it is certain; what is to follow is the caller's.
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
        """Whether a distance was sent of which nobody knows if it ran: its axis is at one of two places.

        So it is with a target that the axis may have gone to or have come past (``record.Finding.EITHER``).
        """
        target = self.unacknowledged
        return target is not None and (target.is_distance or target.proof is not Proof.ONE)

    def polls_needed(self, now_ns: int) -> int:
        """How often it has to be read to tell whether it went, of a target that its record names; 0: not."""
        target = self.unacknowledged
        if target is None or target.proof in (Proof.ONE, Proof.NONE) or not self.may_stand(now_ns):
            return 0
        return 1 if target.proof in AT_ONE_END else 2

    @property
    def says_done(self) -> bool:
        """Of an axis at rest whose target is not proven: whether its drive says so, where it has a bit."""
        return DONE_BIT not in self.plan.bits or self.has_reported_done

    # --- where it is -----------------------------------------------------------------------------------

    @property
    def is_at_rest(self) -> bool:
        """Whether anything says that the axis stands."""
        return self.state in WAS_THERE or self.has_reported_done

    @property
    def has_arrived(self) -> bool:
        """Whether the axis is known to stand at its target."""
        return self.state is _ARRIVED

    @property
    def knows_branch(self) -> bool:
        """Whether a position of the drive can be turned back on a branch that was not merely assumed.

        A target that was reached on an assumed branch is where the controller takes the axis to be; a place
        short of it, where the axis was stopped, is not.
        """
        is_assumed = self.state is _STOPPED and self.compensation.is_unsure
        return self.state in ON_BRANCH and not is_assumed

    def is_unseen(self, now_ns: int) -> bool:
        """Whether somebody may have moved it since anything was heard of it or said to it (M5, M6)."""
        return now_ns - self.heard_ns > self.plan.unseen_ms * NS_PER_MS

    def is_at_target(self, corrected_counts: Counts) -> bool:
        """Whether a position lies in the in-position window of the last accepted target."""
        accepted = self.compensation.accepted
        if accepted is None:
            return False
        return abs(corrected_counts - accepted.corrected_counts) <= self.plan.settings.in_position_counts

    def has_started(self, asked_ns: int) -> bool:
        """Whether a done bit that was asked for then is not that of the move before."""
        is_new = self.reported is not Reported.NOTHING or asked_ns - self.sent_off_ns >= self._done_drop_ns
        return is_new and asked_ns >= self.sent_off_ns

    def may_stand(self, asked_ns: int) -> bool:
        """Whether a position that was asked for then may be that of an axis that has come to rest."""
        return self.has_started(asked_ns) and self.reported is not Reported.MOVES

    def nominal_of(self, corrected_counts: Counts) -> float:
        """Nominal counts of an actual position, as the controller would read it, not rounded."""
        if self.plan.compensation is CompensationMode.SHADOW:
            return corrected_counts
        return corrected_counts - self.compensation.readback.correction_counts(corrected_counts)

    @property
    def why_not_at_rest(self) -> str:
        """Why nobody can say that it stands at its last target, "" where it does, or was told none yet.

        In a dry run the drive stands at the target as it was commanded. Where no register tells where it is,
        nobody ever can: then the last word of its drive has to do.
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

    # --- the target of before a loss -------------------------------------------------------------------

    def holds_target(self, number: int) -> bool:
        """Whether the words of a command field are the last accepted target, in both frames.

        Not those of a distance, of a position written where it means nothing, or with a word replaced.
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
        """The last accepted target with its words, where nothing but a target moves the axis since."""
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
            return None  # another one is staged there by now, or a distance
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
        """Return the target of before a loss of reach or reference, where these words are it; else None."""
        kept = self.superseded
        if kept is None or (kept.number, kept.nominal_words) != (number, nominal_words):
            return None
        return kept

    def repeat_kind(self, number: int, nominal_words: bytes) -> RepeatKind:
        """Return what a target is by what is known now, that may be the one of before a loss."""
        kept = self.superseded_as(number, nominal_words)
        if kept is None:
            return RepeatKind.NEW
        if kept.is_declared:
            return RepeatKind.SAME_WORDS
        if not self.plan.actual and not kept.is_other_reference:
            return RepeatKind.SAME_WORDS  # no reading can ever tell, and its positions still mean something
        return REPEAT_KINDS[self.is_seen_at_superseded, self.plan.motion.waits_for_trigger, kept.was_there]

    @property
    def is_seen_at_superseded(self) -> bool:
        """Whether the axis was seen, after the loss, where its superseded target had sent it."""
        return self.seen_at_superseded is True

    @property
    def seen_at_superseded(self) -> bool | None:
        """Whether it stands where its superseded target had sent it; None: nobody has seen it stand since.

        With a declared reference another place proves nothing: the axis may be on its way.
        """
        kept, actual = self.superseded, self.actual
        if kept is None or actual is None or actual.seen_ns <= kept.newest_ns or self.is_moving:
            return None
        window = self.plan.settings.in_position_counts
        is_there = abs(actual.counts - kept.corrected_counts) <= window
        return None if kept.is_declared and not is_there else is_there
