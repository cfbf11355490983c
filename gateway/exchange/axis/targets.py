"""The targets of an axis, from the end of their frame: acknowledged, or left open and proven later (M5, M7).

A drive has a target if it acknowledged it, or if the axis was seen to have gone there. Until then the target
is unacknowledged (``axis.motion``). A drive that waits for a trigger holds targets that were not run.
"""

from typing import Final

from gateway.compensation.moves import Move
from gateway.drives.motion import Action
from gateway.exchange.axis.acknowledge import Acknowledgement, Proof, Rendering, SteadyTarget
from gateway.exchange.axis.correction import RequestedCorrection
from gateway.exchange.axis.motion import Actual, Motion, MotionState
from gateway.exchange.axis.reports import AxisReports

_SUPERSEDED: Final = MotionState.SUPERSEDED


class Targets:
    """What happens to the targets of one axis. Time is monotonic, in ns."""

    __slots__ = ("_correction", "_motion", "_reports", "acknowledgement", "holds_unrun", "last_run")

    def __init__(
        self,
        motion: Motion,
        acknowledgement: Acknowledgement,
        correction: RequestedCorrection,
        reports: AxisReports,
    ) -> None:
        self._motion, self.acknowledgement = motion, acknowledgement
        self._correction, self._reports = correction, reports
        self.holds_unrun = False
        """A target was written after the last trigger that ran one."""
        self.last_run = Action.ABSOLUTE
        """Kind of the last target: the best guess for one that is staged before its mode is known."""

    def mark_staged(self) -> None:
        """Its drive has a target that no trigger has run."""
        self.holds_unrun = True

    def mark_run(self, action: Action) -> None:
        """Its drive runs a target of the kind ``action``."""
        self.holds_unrun = False
        self.last_run = action

    # --- acknowledged ----------------------------------------------------------------------------------

    def acknowledge(self, rendering: Rendering, now_ns: int = 0, epoch: int | None = None) -> None:
        """The drive acknowledged a target with a complete normal reply, and goes there (M7).

        ``epoch``: of its field, when the target was sent.
        """
        motion = self._motion
        motion.fields[rendering.number].settle(rendering.nominal_words, rendering.corrected_words, epoch)
        motion.mark_heard(now_ns)
        if rendering.move is None:
            motion.compensation.touch(now_ns)
        else:
            self.go(rendering, rendering.move, now_ns)

    def acknowledge_steady(self, number: int, target: SteadyTarget, now_ns: int) -> None:
        """Do the same for a target on the fast path: it continues in its direction, or is a repeat."""
        motion = self._motion
        motion.fields[number].settle(target.nominal_words, target.corrected_words, target.epoch)
        motion.mark_heard(now_ns)
        steady = target.steady
        if steady is None:
            motion.compensation.touch(now_ns)
        else:
            motion.go_on(number, steady, target.corrected_counts, now_ns)

    def go(self, rendering: Rendering, move: Move, now_ns: int) -> None:
        """The axis goes to a target, or has gone there, whatever its registers hold now."""
        compensation = self._motion.compensation
        if (
            not compensation.is_stream
            and compensation.state.travel.direction is not move.state.travel.direction
            and self._correction.has_branches
        ):
            self._reports.count_branch_change(now_ns)
        self._motion.go(rendering, move, now_ns)

    # --- left open -------------------------------------------------------------------------------------

    def leave_unacknowledged(self, rendering: Rendering, now_ns: int) -> None:
        """A target was sent and not acknowledged: the drive may hold it or not.

        After a repeat it holds the same words in either case.
        """
        motion = self._motion
        is_repeat = rendering.move is None and not rendering.is_distance
        if is_repeat and (motion.compensation.accepted is not None or motion.state is _SUPERSEDED):
            return
        image = motion.fields[rendering.number]
        if image.corrected_words == rendering.corrected_words:
            rendering = self.acknowledgement.marked(rendering, rendering._replace(stood_there=True))
        self.leave_run_unacknowledged(rendering, now_ns)
        image.leave(rendering.nominal_words, rendering.corrected_words)
        image.forget()

    def leave_run_unacknowledged(self, rendering: Rendering, now_ns: int) -> None:
        """A trigger was not acknowledged: the drive holds its target, and may be moving there or not."""
        motion = self._motion
        kept = motion.superseded_as(rendering.number, rendering.nominal_words)
        is_same = kept is not None and kept.corrected_words == rendering.corrected_words
        if is_same and not rendering.is_distance:
            motion.send_off(now_ns)  # its repeat still has the same words
        elif rendering.move is None:
            motion.displace(now_ns)
        else:
            motion.leave_unacknowledged(rendering, now_ns)

    # --- proven later ----------------------------------------------------------------------------------

    def prove(self, before: Actual | None, now: Actual) -> None:
        """Take an unacknowledged target as accepted when the axis is seen to have gone there (M7)."""
        motion = self._motion
        target = motion.unacknowledged
        if motion.is_distance_unconfirmed:
            self.prove_distance(now, before)
        elif target is not None and target.move is not None and motion.is_proven(before, now):
            self.go(target, target.move, now.seen_ns)

    def prove_distance(self, now: Actual, before: Actual | None = None) -> None:
        """Take an unacknowledged distance as executed or not executed, when that is certain (M5)."""
        target = self._motion.unacknowledged
        proof = self._motion.proof_at(now, before)
        if target is None or target.move is None or target.start is None:
            return
        if proof is Proof.EXECUTED:
            self.go(target, target.move, now.seen_ns)
        elif proof is Proof.NOT_EXECUTED:
            self._motion.run_not(target.start)

    def prove_by_words(self, number: int, words: bytes) -> None:
        """Take an unacknowledged target as acknowledged if a command field that is read holds its words.

        Not if the drive held the same words before, and not a distance: its words do not prove that it was
        executed.
        """
        motion = self._motion
        target = motion.unacknowledged
        if (
            target is not None
            and target.number == number
            and target.corrected_words == words
            and not target.stood_there
            and not target.is_distance
            and not motion.plan.motion.waits_for_trigger
        ):
            self.acknowledge(target, motion.heard_ns)

    def read_back(self, number: int, words: bytes) -> None:
        """Record the words of a command field that the gateway has read.

        If they are those of the target before a lost link, the drive has kept it. This proves nothing else,
        and what was lost on the way stays lost (M3).
        """
        image, superseded = self._motion.fields[number], self._motion.superseded
        if superseded is None or superseded.number != number or superseded.corrected_words != words:
            return
        if image.nominal_words is None and not image.is_incomplete:
            image.settle(superseded.nominal_words, words)
