"""How an axis is restored from its record of the last run of the gateway.

The record counts if the drive is where the record says that it is, or may be (``axis.record.find``). The
first actual positions decide that. A target or another motion before them drops the record. The axes of a
group are restored together or not at all.
"""

from functools import partial
from typing import Final

from gateway.catalogue import exchange_events
from gateway.compensation.correction_spec import CorrectionSpec
from gateway.compensation.errors import SettingsError, TableError
from gateway.compensation.moves import Accepted, Move, State
from gateway.compensation.readback import Fade, Readback
from gateway.exchange.axis.acknowledge import Proof, Rendering
from gateway.exchange.axis.correction import RequestedCorrection
from gateway.exchange.axis.motion import Actual, Motion, MotionState
from gateway.exchange.axis.record import (
    PROVEN,
    Decision,
    Finding,
    Record,
    TableNotFoundError,
    find,
    proof_of,
    state_of,
)
from gateway.exchange.axis.record_layout import Remembered, RememberedMove
from gateway.exchange.axis.reference import AxisReference
from gateway.exchange.axis.reports import AxisReports
from gateway.exchange.axis.targets import Targets
from gateway.exchange.field_counts import raw_of

_MOVING: Final = MotionState.MOVING


class Recall:
    """The record of one axis, and how the axis is restored from it. Times are monotonic, in ns."""

    __slots__ = (
        "_at_start",
        "_correction",
        "_motion",
        "_peers",
        "_reports",
        "_targets",
        "record",
        "reference",
    )

    def __init__(
        self,
        motion: Motion,
        reference: AxisReference,
        correction: RequestedCorrection,
        targets: Targets,
        reports: AxisReports,
    ) -> None:
        self._motion, self.reference = motion, reference
        self._correction, self._targets, self._reports = correction, targets, reports
        self._at_start: Readback | None = None
        self._peers: tuple[Recall, ...] = ()
        """Those of the other axes of its group."""
        self.record: Record | None = None
        """Its record for the next run of the gateway; None: none is kept."""

    def join(self, peers: "tuple[Recall, ...]") -> None:
        """The axis is a member of a group with these."""
        self._peers = peers

    def attach(self, record: Record | None) -> None:
        """Keep a record from now on, and use that of the last run if it counts; None: keep none."""
        self.record = record
        if record is None or record.saved is None:
            return
        if self._motion.compensation.is_stream and record.saved.was_corrected:
            self._correction.former = self._corrections_in_force(record, record.saved)
        elif not self._correction.is_enabled:
            self.drop("the compensation of the axis is off")

    def start_without(self) -> None:
        """The record of the last run is not used: until its first target the axis reads 1:1."""
        readback = self._motion.compensation.readback
        if readback.end is None and not self.reference.is_lost:
            self._at_start = readback

    def note_other_reference(self) -> None:
        """Its reference is not that of the last run: what it reads is right."""
        self._at_start = None

    @property
    def reads_uncorrected(self) -> bool:
        """Whether it still reads 1:1 because the record of the last run is not used.

        Or it waits for the records of the other axes of its group.
        """
        if self.record is not None and self.record.decision is Decision.FITS:
            return True
        return self._at_start is not None and self._motion.compensation.readback is self._at_start

    @property
    def is_open(self) -> bool:
        """Whether it is still undecided if the record of the last run counts."""
        return self.record is not None and self.record.saved is not None

    def decide(self, actual: Actual) -> None:
        """Decide with an actual position whether the record of the last run counts."""
        record = self.record
        assert record is not None
        saved = record.saved
        assert saved is not None
        if not self.reference.is_referenced:
            lacking = [each for each in (self, *self._peers) if each.reference.is_lost]
            if not lacking:
                return
            if not (self._motion.compensation.is_stream and saved.is_of_this_boot):
                if self in lacking:
                    self.drop("the axis is not referenced now")
                return
        found = find(self._motion, saved, record.first or actual, actual)
        if found is None:
            record.start_polling(actual)
        elif isinstance(found, str):
            self.drop(found)
        else:
            record.fit(found, actual)
            self._take_group_up()

    def _take_group_up(self) -> None:
        """Restore all axes of the group as soon as the records of all of them fit."""
        members = [self, *(peer for peer in self._peers if peer.record is not None)]
        decisions = [member.record.decision for member in members if member.record is not None]
        if Decision.NONE in decisions or Decision.DROPPED in decisions:
            self.drop("another axis of its group has none that counts")
        elif Decision.OPEN not in decisions:
            fitting = [each for each in members if each.record and each.record.decision is Decision.FITS]
            states = []
            for member in fitting:
                found = member.saved_states()
                if isinstance(found, str):
                    member.drop(found)
                    return
                states.append(found)
            for member, (state, after) in zip(fitting, states, strict=True):
                member.take_up(state, after)

    def drop(self, reason: str) -> None:
        """Drop the records of the last run, of this axis and of the others of its group."""
        assert self.record is not None
        self.record.decide(Decision.DROPPED)
        self.record.clear()
        self.start_without()
        self._reports.report(exchange_events.RECORD_NOT_USED, f"{reason}; it starts without its record")
        for peer in self._peers:
            if peer.is_open:
                peer.drop(f"axis {self._motion.plan.name} of its group starts without one")

    def saved_states(self) -> tuple[State, State | None] | str:
        """Return the recorded state, and that after a target on the wire; or why they cannot be restored."""
        record = self.record
        assert record is not None
        saved, fitting = record.saved, record.finding
        assert saved is not None
        assert fitting is not None
        try:
            return self._states_of(record, saved, fitting[1].seen_ns)
        except TableNotFoundError:
            return "the table that was in force is not the one configured now"
        except (TableError, SettingsError) as error:
            return f"the table that was in force cannot be used any more ({error})"

    def _states_of(self, record: Record, saved: Remembered, now_ns: int) -> tuple[State, State | None]:
        """Do the same; raises what ``state_of`` raises."""
        plan, requested = self._motion.plan, self._correction.requested
        find_table = partial(record.find_table, plan.table, requested)
        state = state_of(plan.settings, requested, saved.state, find_table, now_ns)
        move = saved.unacknowledged
        if move is None:
            return state, None
        return state, state_of(plan.settings, requested, move.state, find_table, now_ns)

    def _corrections_in_force(self, record: Record, saved: Remembered) -> tuple[CorrectionSpec, ...]:
        """Return the corrections that the last run may have left in force; none if a table is missing."""
        try:
            states = self._states_of(record, saved, 0)
        except (TableNotFoundError, TableError, SettingsError):
            return ()
        specs = [spec for state in states if state is not None for spec in (state.spec, state.previous)]
        return tuple([spec for spec in specs if spec is not None])

    def take_up(self, state: State, after: State | None) -> None:
        """Continue from the record of the last run, which fits.

        ``after``: the state after the target that was on the wire, if one was.
        """
        record = self.record
        assert record is not None
        saved, fitting = record.saved, record.finding
        assert saved is not None
        assert fitting is not None
        finding, actual = fitting
        motion, compensation = self._motion, self._motion.compensation
        settings, now_ns, move = motion.plan.settings, actual.seen_ns, saved.unacknowledged
        self._restore(saved, state, is_at_target=finding is Finding.AT_TARGET)
        if move is not None and after is not None:
            self._restore_unacknowledged(saved, move, after, finding)
        self._correction.resume_terms(now_ns)
        if not self.reference.is_referenced:
            motion.displace(keeps_branch=compensation.is_stream)
            compensation.lose_reference()  # the offset of a stream stays, and fades (M9)
        record.decide(Decision.TAKEN)
        in_force = compensation.state
        position = compensation.machine_position(motion.nominal_of(actual.counts)) - settings.machine_offset
        is_open = "; whether it has gone there is not certain yet" if motion.is_distance_unconfirmed else ""
        self._reports.report(
            exchange_events.RESTORED,
            f"goes on from its record: nominal {position:.6g} {settings.units.value}, the drive at "
            f"{actual.counts:.10g} counts, {in_force.travel.direction.name.lower()}, progress of a reversal "
            f"{in_force.progress:.3g}, of a change-over {in_force.change:.3g}, generation "
            f"{saved.generation}{is_open}",
        )

    @property
    def may_have_stopped(self) -> bool:
        """Whether an axis that was found on its way may have stopped there.

        Its next distance then begins where it is. A drive that takes nothing but positions gets its target
        again, or another one. A drive that takes stops and distances may have stopped because its master was
        missing. Its target must not be the base of a distance then (M5).
        """
        return self._motion.has_rules

    def _restore(self, saved: Remembered, state: State, *, is_at_target: bool) -> None:
        """Restore the recorded position, branch and correction."""
        motion, compensation, accepted = self._motion, self._motion.compensation, None
        if is_at_target or (saved.has_target and not self.may_have_stopped):
            accepted = Accepted(saved.nominal_counts, saved.corrected_counts)
        fade = None if saved.fade is None else Fade(*saved.fade)
        came_from = None if saved.came_from is None else Accepted(*saved.came_from)
        compensation.resume(state, accepted, saved.anchor_counts, fade, saved.way, came_from=came_from)
        if accepted is None:
            motion_state = MotionState.STOPPED
        elif not is_at_target:
            motion_state = _MOVING  # a record does not say whether the start was known
        elif saved.may_have_left:
            motion_state = MotionState.MAY_HAVE_LEFT
        elif saved.was_done_seen:
            motion_state = MotionState.ARRIVED
        else:
            motion_state = MotionState.IN_WINDOW if compensation.readback.fade is None else _MOVING
        motion.resume(motion_state, state.at_ns if saved.is_of_this_boot else 0, saved.number)
        if accepted is not None and saved.knows_words:
            field_ = motion.plan.command[saved.number]
            motion.fields[saved.number].settle(
                field_.pack(raw_of(field_, accepted.nominal_counts)),
                field_.pack(raw_of(field_, accepted.corrected_counts)),
            )

    def _restore_unacknowledged(
        self, saved: Remembered, move: RememberedMove, after: State, finding: Finding
    ) -> None:
        """Take the target that was on the wire as accepted, or as unacknowledged."""
        motion, compensation, plan = self._motion, self._motion.compensation, self._motion.plan
        field_ = plan.command[move.number]
        nominal_words = corrected_words = b""
        if not move.is_distance:
            nominal_words = field_.pack(raw_of(field_, move.nominal_counts))
            corrected_words = field_.pack(raw_of(field_, move.corrected_counts))
        correction_counts = move.corrected_counts - move.nominal_counts
        planned = Move(move.nominal_counts, correction_counts, compensation.map_of(after), after)
        proof = proof_of(plan.settings, saved, finding)
        start = None
        if saved.has_target and (move.is_distance or proof is not Proof.ONE):
            start = Accepted(saved.nominal_counts, saved.corrected_counts)
        rendering = Rendering(
            move.number,
            nominal_words,
            corrected_words,
            move.corrected_counts,
            planned,
            move.is_distance,
            start,
            proof=proof,
        )
        if finding not in PROVEN:
            # The record continues to name the target, so that the next start of the gateway finds it too.
            self._targets.acknowledgement.go_on_naming(rendering)
            is_timed = saved.is_of_this_boot and proof is Proof.TWO
            self._targets.leave_unacknowledged(rendering, after.at_ns if is_timed else motion.heard_ns)
            if finding is Finding.EITHER:
                compensation.read_as_reached(planned, move.corrected_counts)
            return
        if plan.has_rules:
            self._targets.go(rendering, planned, motion.heard_ns)
        else:
            self._targets.acknowledge(rendering, motion.heard_ns)
        if finding is not Finding.AT_UNACKNOWLEDGED and self.may_have_stopped:
            motion.displace(keeps_branch=True)
