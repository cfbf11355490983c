"""One axis on its line: its parts, and how each event changes them.

Theory of operation
===================

A controller commands *nominal* positions. The drive receives *corrected* positions. The correction depends on
the target. A worn screw has lost motion, so it also depends on the side from which the axis reaches the
target: its *branch*. So the gateway must know two things of an axis: whether its positions are meaningful
(its reference), and where it is (its motion state).

An axis consists of parts. Each is in its own file and owns the data that it changes. The first four are
state machines, with their states, their events and the table of both:

===============  ==========================================  ===============================================
part             answers                                     sees
===============  ==========================================  ===============================================
``reference``    are its positions meaningful?               homed bit, homing, set positions, losses
``motion``       where is it?                                acknowledgements, stops, bits, actual positions
``acknowledge``  did its drive receive a target?             frames sent, their end, readings at both ends
``interlock``    are its triggers refused?                   targets lost, complete targets accepted
``targets``      what became of the targets that were sent?  the ends of their frames, actual positions
``correction``   which correction is requested?              switch, table, gain, temperatures
``member``       what did its group's first trigger fix?     triggers of all axes of its group (``gantry``)
``reach``        does its drive answer?                      silences, answers to the gateway's own reads
``recall``       does the record of the last run count?      the first actual positions
``reports``      what is to be reported?                     events, changes of lasting states
``hold``         who moves it?                               targets, connections (``ownership`` maintains it)
===============  ==========================================  ===============================================

What concerns one part is a method of that part. What concerns several is a method of :class:`Axis`: a lost
reference, for example, also voids the last target and the words in the drive. ``exchange.effects`` calls both
when a request is sent and when it ends; ``exchange.group`` does so for the axes of a group. The gateway
believes only what is proven: by an acknowledgement, a status bit, or a position that was read. Without a
proof the state says so (``UNACKNOWLEDGED``, ``UNKNOWN``).

A person decides *whether* positions are corrected, and with which table (``correction``). Compensation also
ends when a remapping register of the drive was written (``reference.is_remapped``). While the reference is
not known, positions pass 1:1 in both directions.

``compensation`` (``gateway.compensation``) has *how* they are corrected now: direction, blends, offset, the
last target on both scales, and the readback map that converts readings back.

The register image (``registers``) has *what the drive holds*. The drive may hold staged targets that no
trigger has run, and parts of a target may have been lost. A lost target blocks the triggers (``interlock``).
"""

from collections.abc import Iterable
from dataclasses import replace
from math import isfinite
from typing import Final

from gateway.catalogue import exchange_events
from gateway.compensation.axis import AxisCompensation
from gateway.compensation.settings import Setpoints
from gateway.drives.motion import Action, Form
from gateway.exchange.axis.acknowledge import Acknowledgement, Rendering, SteadyTarget
from gateway.exchange.axis.correction import RequestedCorrection
from gateway.exchange.axis.cross_term import Partner
from gateway.exchange.axis.gantry import Gantry
from gateway.exchange.axis.hold import Hold
from gateway.exchange.axis.interlock import Block, Interlock
from gateway.exchange.axis.member import Member
from gateway.exchange.axis.motion import (
    ON_BRANCH,
    Actual,
    KeptOver,
    Motion,
    MotionEvent,
    MotionState,
    RepeatKind,
)
from gateway.exchange.axis.reach import DriveReach, PositionAnswer, Readability
from gateway.exchange.axis.recall import Recall
from gateway.exchange.axis.reference import AxisReference, ReferenceEvent
from gateway.exchange.axis.registers import FieldImage, RuleImage
from gateway.exchange.axis.reports import AxisReports
from gateway.exchange.axis.targets import Targets
from gateway.exchange.events import Event
from gateway.exchange.field_counts import counts_of
from gateway.exchange.plan import (
    ALARM_BIT,
    DONE_BIT,
    HOMED_BIT,
    MOVING_BIT,
    AxisPlan,
    CompensationMode,
)
from gateway.modbus.pdu import ExceptionCode
from gateway.modbus.registers import PositionField

_SAYS_NOTHING_WRITTEN: Final = frozenset(
    {
        ExceptionCode.ILLEGAL_DATA_ADDRESS,
        ExceptionCode.ILLEGAL_DATA_VALUE,
        ExceptionCode.SERVER_DEVICE_FAILURE,
    }
)
MOVES_OTHERWISE: Final = frozenset(
    {
        Action.STOP,
        Action.HOME,
        Action.SET_POSITION,
        Action.STORED,
        Action.OTHER_MOTION,
        Action.UNKNOWN,
    }
)
"""Actions after which the last target no longer says where the axis is."""
_REFUSED: Final = Readability.REFUSED  # member lookup is slow, and these are used for each sample
_MOVING: Final = MotionState.MOVING
_SUPERSEDED: Final = MotionState.SUPERSEDED
REMAPPED: Final = "its drive's registers were moved about; corrected again after a restart of the gateway"


class Axis:
    """An axis on its line: its state, and all that can happen to it. See the module."""

    __slots__ = (
        "acknowledgement",
        "compensation",
        "correction",
        "fields",
        "hold",
        "interlock",
        "is_alarmed",
        "limit_fields",
        "member",
        "motion",
        "peers",
        "plan",
        "reach",
        "recall",
        "reference",
        "reports",
        "rules",
        "targets",
        "waits_for_trigger",
        "writes_words_alone",
    )

    def __init__(self, plan: AxisPlan) -> None:
        self.plan = plan
        self.waits_for_trigger = plan.motion.waits_for_trigger
        """Whether the drive may hold a position that it does not run (M3)."""
        self.writes_words_alone = plan.writes_with is Form.FC06
        """Whether the drive takes single registers only: each word is sent as it is written."""
        # --- what the drive holds
        self.fields = [FieldImage(each, waits=self.waits_for_trigger) for each in plan.command]
        self.limit_fields = [FieldImage(each) for each in plan.limits]
        self.rules = RuleImage(plan.motion)
        self.is_alarmed = False
        """Its alarm bit was set when last seen: only a rising bit is an event."""
        # --- its parts
        self.compensation = AxisCompensation(plan.settings)
        self.reference = AxisReference(plan, self.report_fault)
        self.acknowledgement = Acknowledgement(self.report_fault)
        self.motion = Motion(plan, self.compensation, self.acknowledgement, self.fields, self.report_fault)
        self.interlock = Interlock(self.report_fault)
        self.reach = DriveReach(plan)
        self.reports = AxisReports(plan, self.reference, self.reach)
        self.member = Member(self.motion, self.reference)
        self.correction = RequestedCorrection(self.motion, self.reference, self.member, self.reports)
        self.targets = Targets(self.motion, self.acknowledgement, self.correction, self.reports)
        self.recall = Recall(self.motion, self.reference, self.correction, self.targets, self.reports)
        self.hold = Hold(plan.writer_hold_s, is_shared=not plan.has_one_writer)
        self.peers: tuple[Axis, ...] = ()
        """The other axes of its group (M11)."""
        if self.reference.is_referenced:
            self.compensation.find_reference(self.correction.requested)

    @property
    def passes_unchanged(self) -> bool:
        """Whether words of this axis pass 1:1 in both directions (M9)."""
        return self.correction.is_dry_run or self.compensation.is_passing

    @property
    def reads_unchanged(self) -> bool:
        """Whether its readings pass 1:1; not while the last correction still fades out."""
        return self.passes_unchanged and (
            self.correction.is_dry_run or self.compensation.readback.fade is None
        )

    def needs_reference(self, now_ns: int, *, is_target: bool) -> bool:
        """Whether the homed bit must be read before this axis's positions pass.

        An old bit does not hold up a stream of setpoints while the axis is referenced. Nor does it hold up a
        group of which one axis has started: its reference is fixed.
        """
        if not self.reach.may_read or self.member.fixed is not None:
            return False
        reference = self.reference
        is_stream = self.plan.settings.setpoints is Setpoints.STREAM
        before_target = is_target and not (is_stream and reference.is_referenced)
        return reference.needs_reading(now_ns, before_target=before_target)

    @property
    def is_unsure(self) -> bool:
        """Whether the branch in force was assumed, and the correction depends on the branch."""
        compensation = self.compensation
        if not (compensation.is_unsure or self.motion.is_distance_unconfirmed):
            return False
        has_branches = self.correction.has_branches or compensation.state.spec.has_branches
        return has_branches and not compensation.is_passing

    def writes_nothing(self, code: int, *, reads_too: bool) -> bool:
        """Whether an exception to a write proves that nothing was written (M7).

        A drive cannot have executed a function code that it does not know. Codes 2 to 4 (address, value,
        device failure) prove it only if the register map says so. They do not prove it for a frame that also
        reads: the read may have been refused after the write. Busy, acknowledge and gateway codes never prove
        it.
        """
        if code == ExceptionCode.ILLEGAL_FUNCTION:
            return True
        return code in _SAYS_NOTHING_WRITTEN and self.plan.exception_writes_nothing and not reads_too

    def report_fault(self, sentence: str) -> None:
        """Handle an impossible event in one of its machines: a bug of this program.

        The axis goes to its safest state. Its position is unknown. Its reference is lost if a bit can restore
        it. While it is corrected, its triggers are refused until a complete target is accepted.
        """
        self.reports.report(exchange_events.INTERNAL_FAULT, sentence)
        self.motion.enter(MotionState.UNKNOWN)
        if self.reference.follows_homed_bit:
            was_referenced = self.reference.is_referenced
            self.reference.invalidate()
            self._follow_reference(was_referenced=was_referenced)
        why = "the gateway has a fault: triggers are refused until a complete target was accepted"
        self.block_triggers(ExceptionCode.SERVER_DEVICE_FAILURE, why)

    def take_events(self) -> tuple[Event, ...]:
        """Bring its record up to date, and return its new events, each change once."""
        record = self.recall.record
        if record is not None:
            record.publish(self.motion, self.acknowledgement, self.correction.requested)
        return self.reports.take(is_unsure=self.is_unsure)

    # --- where it is -----------------------------------------------------------------------------------

    def repeat_kind(self, number: int, nominal_words: bytes) -> RepeatKind:
        """Return how to handle a target that may be the one from before a loss (``Motion.repeat_kind``)."""
        field_ = self.plan.command[number]
        starts = not self.plan.motion.starts_on.isdisjoint(range(field_.address, field_.end))
        waits = not (starts or self.rules.goes_at_once(number))
        return self.motion.repeat_kind(number, nominal_words, waits=waits)

    def forget(self) -> None:
        """Mark as unknown where the axis is and what its drive holds (M7)."""
        self.motion.displace()
        self._forget_words()

    def _forget_words(self) -> None:
        self.rules.forget()
        for image in (*self.fields, *self.limit_fields):
            image.forget()

    def _lose_reach(self, *, was_closed: bool = False) -> None:
        """The drive was out of reach: what it holds and where its axis is must be read again.

        ``was_closed``: the connection was closed in order, by an idle server or by us.
        """
        self.member.end()
        self.motion.lose_reach(KeptOver.ORDERLY_CLOSE if was_closed else KeptOver.LOSS)
        self._forget_words()

    def invalidate_words(self) -> None:
        """The drive may hold other targets than were sent to it; the controller's view stays the same."""
        for image in self.fields:
            image.invalidate()

    # --- whether its positions are meaningful ----------------------------------------------------------

    def reference_happens(self, event: ReferenceEvent) -> None:
        """Enter the reference state that the table gives, and put it into force."""
        was_referenced = self.reference.is_referenced
        self.reference.happens(event)
        if self.reference.is_referenced is not was_referenced:
            self.recall.note_other_reference()
        self._follow_reference(was_referenced=was_referenced)

    def _follow_reference(self, *, was_referenced: bool) -> None:
        """Put the present reference into force."""
        is_referenced = self.reference.is_referenced
        if is_referenced is was_referenced or self.member.put_off_reference(is_referenced=is_referenced):
            return
        self._take_reference(is_referenced=is_referenced)

    def _take_reference(self, *, is_referenced: bool) -> None:
        """Positions become meaningful now, or stop being so."""
        self.motion.change_reference()
        self.invalidate_words()
        if is_referenced:
            self.motion.forget_position()  # it may have been counted from another zero
            self.compensation.find_reference(self.correction.requested)
        else:
            self.compensation.lose_reference()

    def see_homed_bit(self, now_ns: int, *, is_set: bool) -> None:
        """Record the drive's homed bit, if it decides."""
        was_referenced = self.reference.is_referenced
        self.reference.see_homed_bit(now_ns, is_set=is_set)
        if not is_set:
            self.recall.note_other_reference()
        self._follow_reference(was_referenced=was_referenced)

    def begin_homing(self, now_ns: int, *, is_certain: bool) -> None:
        """A homing command was sent; ``is_certain``: the drive acknowledged it."""
        was_referenced = self.reference.is_referenced
        self.reference.begin_homing(now_ns, is_certain=is_certain)
        if not self.reference.is_referenced:
            self.recall.note_other_reference()
        self._follow_reference(was_referenced=was_referenced)

    def lose_reference(self) -> None:
        """The drive may have lost its position."""
        self.reference_happens(ReferenceEvent.LOSS)

    def declare_referenced(self) -> None:
        """A person confirms that the axis is where its drive says.

        The drive counts from the same zero. So a target that it received since the last loss keeps its words,
        also while the axis still moves there.
        """
        members = [each for each in (self, *self.peers) if each.compensation.accepted is not None]
        self.reference_happens(ReferenceEvent.DECLARED)
        if self.member.gantry is not None:
            self.follow_group()
        for member in members:
            member.motion.mark_kept_over(KeptOver.DECLARATION)

    def follow_group(self) -> None:
        """Correct the axes of its group only while all of them are referenced (M11)."""
        members = (self, *self.peers)
        is_whole = all(member.reference.is_found for member in members)
        for member in members:
            member.wait_for_peers(waits=not is_whole)

    def wait_for_peers(self, *, waits: bool) -> None:
        """Another axis of the group is not referenced (``waits``), or all are."""
        was_referenced = self.reference.is_referenced
        self.reference.wait_for_peers(waits=waits)
        self._follow_reference(was_referenced=was_referenced)

    def join(self, peers: "tuple[Axis, ...]", gantry: Gantry) -> None:
        """Make it a member of a group."""
        self.peers = peers
        self.recall.join(tuple([peer.recall for peer in peers]))
        self.member.join(gantry)
        self.follow_group()

    def release(self) -> None:
        """Put deferred changes into force, with the next different target (M11)."""
        fixed = self.member.release()
        if fixed is None:
            return
        if fixed.has_other_correction:
            self.correction.choose()
        if fixed.is_referenced and (fixed.was_lost or not self.reference.is_referenced):
            self._take_reference(is_referenced=False)
        if self.reference.is_referenced and (fixed.was_lost or not fixed.is_referenced):
            self._take_reference(is_referenced=True)
        self.correction.want()

    @property
    def blocked_by(self) -> int | None:
        """Exception code that refuses its triggers, for its own lost target or one of its group."""
        return self.interlock.block_code if self.interlock.is_blocked else self.blocked_by_peer

    @property
    def blocked_by_peer(self) -> int | None:
        """Exception code of a target that another axis of the group has lost itself (M11)."""
        return self.blocked_by_one_of(self.peers)

    @staticmethod
    def blocked_by_one_of(axes: "Iterable[Axis]") -> int | None:
        """Return the exception code of a target that one of these axes has lost itself; None: none has."""
        for axis in axes:
            if axis.interlock.block is Block.OWN:
                return axis.interlock.block_code
        return None

    # --- another plan, other registers, another zero ---------------------------------------------------

    def end_dry_run(self) -> None:
        """Apply what was only shown, from the next different target on; the axis is at standstill."""
        self._take_plan(replace(self.plan, compensation=CompensationMode.ON))
        self.correction.end_dry_run()
        self.compensation.end_dry_run()
        if self.plan.actual:
            # A dry run ends only at the target; an axis that is seen elsewhere later was moved.
            self.motion.happens(MotionEvent.IN_WINDOW)
        self.correction.want()

    def _take_plan(self, plan: AxisPlan) -> None:
        """Use another plan with the same registers."""
        self.plan = self.motion.plan = plan

    def adopt(self, plan: AxisPlan) -> None:
        """Use another table or gain; it comes into force with the next different target."""
        self._take_plan(plan)
        self.correction.choose()
        self.correction.want()

    def limit(self, plan: AxisPlan) -> None:
        """Use other limits, from now on."""
        self._take_plan(plan)
        self.compensation.take_limits(plan.settings)

    def end(self) -> None:
        """End compensation until the gateway restarts: its registers have another meaning now."""
        if self.reference.is_remapped:
            return
        self.reports.report(exchange_events.COMPENSATION_ENDED, REMAPPED)
        self.member.end()
        self.reference.end()
        self.correction.end()
        self.forget()
        self.compensation.begin_anew()

    def move_zero(self, *, is_certain: bool) -> None:
        """The drive counts from another zero: its targets, and the positions that were read, are void.

        ``is_certain``: the drive acknowledged it. Otherwise the old zero may still count, and so may the
        correction of the last run that has not faded out.
        """
        self.invalidate_words()
        self.motion.forget_position()
        has_begun = self.compensation.state.position is not None
        if is_certain or (has_begun and self.compensation.is_passing):
            self.correction.former = ()
        if self.compensation.is_stream:
            self.compensation.begin_anew()
            if self.reference.is_referenced:
                self.compensation.find_reference(self.correction.requested)

    # --- silence ---------------------------------------------------------------------------------------

    def fall_silent(self, since_ns: int, now_ns: int) -> None:
        """The drive left a request unanswered, and may have lost its reference.

        ``since_ns``: when the first unanswered request was sent.
        """
        self.reach.fall_silent(since_ns, now_ns)
        if not self.reference.follows_homed_bit:
            return
        if self.reach.may_read:
            self.reference_happens(ReferenceEvent.SILENCE)
        else:
            self.see_homed_bit(now_ns, is_set=False)

    def end_silence(self, *, is_answer: bool, until_ns: int | None = None) -> None:
        """Check how long the drive was silent: it may have been switched off meanwhile.

        ``until_ns``: the minimum end of the silence, if known.
        """
        if not self.reach.end_silence(is_answer=is_answer, until_ns=until_ns):
            return
        motion, acknowledgement = self.motion, self.acknowledgement
        target, pending = motion.unacknowledged, acknowledgement.pending
        kept = motion.superseded
        self._lose_reach(was_closed=kept is not None and kept.over is KeptOver.ORDERLY_CLOSE)
        if target is not None:  # it may have reached the drive before the silence
            motion.happens(MotionEvent.NOT_ACKNOWLEDGED, target)
            acknowledgement.go_on_naming(pending)
        self.motion.send_off(self.reach.silent_until_ns)
        self.lose_reference()

    def lose_link(self, now_ns: int, *, was_closed: bool = False) -> None:
        """Forget what may have changed while the link was down; ``was_closed``: see :meth:`_lose_reach`."""
        if self.recall.record is not None:
            self.recall.record.pause()
        self._lose_reach(was_closed=was_closed)
        self.motion.forget_position()
        self.reach.update_readability(PositionAnswer.LINK_LOST)
        self.fall_silent(now_ns, now_ns)

    # --- what its record says before a frame is sent ---------------------------------------------------

    def send_target(self, rendering: Rendering) -> None:
        """A target is sent next: if the process dies now, the drive may hold it or not."""
        record, acknowledgement = self.recall.record, self.acknowledgement
        if record is None:
            return
        if record.saved is not None:
            self.recall.drop("a target came before the axis was read")
        if rendering.move is None and not rendering.is_distance:
            return  # a repeat changes nothing
        is_open = acknowledgement.pending is not None
        if rendering.move is None or is_open or self.motion.state not in ON_BRANCH:
            self.send_motion()
            return
        acknowledgement.send(rendering)
        record.write_ahead(self.motion, acknowledgement, self.correction.requested)

    def send_steady(self, target: SteadyTarget) -> bool:
        """Do the same for a target on the fast path; return whether it was recorded without being rendered.

        It is rendered if it ends in an unusual way (``Acknowledgement.name``).
        """
        record, steady = self.recall.record, target.steady
        if record is None or steady is None:
            return True  # a repeat changes nothing
        acknowledgement = self.acknowledgement
        if acknowledgement.pending is not None or not record.write_step_ahead(
            self.motion, self.correction.requested, steady, target.corrected_counts
        ):
            return False
        acknowledgement.send(None)
        return True

    def send_motion(self) -> None:
        """Something is sent that moves the axis in a way that its record does not describe."""
        record = self.recall.record
        if record is None:
            return
        if record.saved is not None:
            self.recall.drop("the axis was moved before it was read")
        self.acknowledgement.send_motion()
        record.write_ahead(self.motion, self.acknowledgement, self.correction.requested)

    # --- triggers that are refused ---------------------------------------------------------------------

    def lose_mode(self, address: int, code: int) -> None:
        """The write of a mode register was lost."""
        self.rules.lose_mode(address, code, self.interlock.begin_epoch())

    def block_triggers(self, code: int, why: str, *, is_own: bool = True) -> None:
        """Refuse triggers from now on, and report why if they passed before.

        ``is_own``: the axis lost the target itself, not because another axis of the group was blocked (M11).
        An axis that passes 1:1 lets its triggers pass until it is corrected (M9).
        """
        if self.interlock.refuse(code, is_own=is_own):
            passing = "; while its positions pass 1:1, its triggers pass" if self.passes_unchanged else ""
            self.reports.report(exchange_events.AXIS_BLOCKED, f"{why}{passing}")

    def release_triggers(self, epoch: int) -> None:
        """A complete target was accepted; ``epoch``: when it was sent."""
        if self.interlock.complete(epoch):
            self.reports.report(
                exchange_events.AXIS_RELEASED, "a complete target was accepted: its triggers pass again"
            )

    # --- a staged target that is rewritten -------------------------------------------------------------

    def lose_rewritten(self, rendering: Rendering, code: int, why: str) -> None:
        """The rewrite of a staged target was not acknowledged."""
        image = self.fields[rendering.number]
        image.leave(rendering.nominal_words, rendering.corrected_words)
        image.invalidate_rewritten(rendering.corrected_words)
        image.lose_all_words()
        self.block_triggers(code, why)

    # --- another writer --------------------------------------------------------------------------------

    def take_over(self, former: str, code: int) -> None:
        """Discard the former writer's parts of positions: they belong to no target of the next one (M3)."""
        for image in self.fields:
            image.lose_all_words()
        if self.waits_for_trigger and self.rules.staged is not None:
            why = (
                f"it was taken over from {former}: triggers are refused until a complete target was accepted"
            )
            # All axes of a group are taken over together. None blocks the others: each needs a target anyway.
            self.block_triggers(code, why, is_own=not self.peers)

    def forget_parts(self) -> None:
        """Forget parts of positions that came on a connection that broke: nothing completes them."""
        for image in (*self.fields, *self.limit_fields):
            image.forget_parts()

    def lose_everything(self, code: int) -> None:
        """More requests of a writer were lost than are remembered: all its targets and modes are lost."""
        for image in self.fields:
            image.lose_all_words()
        for mode in self.plan.motion.modes:
            if mode is not None:
                self.lose_mode(mode.address, code)
        if self.waits_for_trigger:
            self.block_triggers(code, "more requests of its writer were lost than are remembered")

    def overwrite(self, numbers: list[int], writer: str, code: int) -> None:
        """A stop of another controller changed targets: the writer of the axis must write them again."""
        for number in numbers:
            self.fields[number].lose_all_words()
        if not numbers:
            return
        self.hold.overwrite(writer)
        if self.waits_for_trigger:
            why = f"a stop of {writer} changed the target: triggers are refused until a complete one came"
            self.block_triggers(code, why)

    # --- what the gateway sees of it -------------------------------------------------------------------

    def observe_actual(self, field_: PositionField, words: bytes, asked_ns: int) -> Actual | None:
        """Record an actual position, read at ``asked_ns``; None if it is not a number."""
        raw = field_.unpack(words)
        if not isfinite(raw):
            return None
        before, now = self.motion.actual, Actual(counts_of(field_, raw), asked_ns)
        was_unseen = self.motion.is_unseen(asked_ns)
        self.motion.see(now)
        if self.reach.readability is _REFUSED:
            self.reach.update_readability(PositionAnswer.PASSING)
        record = self.recall.record
        if record is not None and record.saved is not None:
            self.recall.decide(now)
        if self.motion.unacknowledged is not None:
            self.targets.prove(before, now)
        self.compensation.observe(now.counts)
        is_at_rest = self.motion.is_at_rest
        if self.compensation.accepted is not None:
            self.motion.see_position(now)
        elif self.motion.seen_at_superseded is False:
            for member in (self, *self.peers):  # a group keeps all targets from before a loss, or none (M11)
                if member.motion.state is _SUPERSEDED:
                    member.motion.happens(MotionEvent.ELSEWHERE)
        if was_unseen and self.motion.state is _MOVING:
            self.motion.see_way(now)
        if before is not None and is_at_rest and self.motion.has_jumped(before, now):
            self.motion.displace()
            self.lose_reference()  # its drive counts from another zero now
        return now

    def observe_bit(self, name: str, asked_ns: int, *, is_set: bool) -> None:
        """Record one of the drive's status bits, read at ``asked_ns``."""
        if not self.motion.is_unseen(asked_ns):  # after a gap it does not show where the axis was meanwhile
            self.motion.mark_heard(asked_ns)
        if name == DONE_BIT:
            self.motion.observe_done(asked_ns, is_done=is_set)
        elif name == MOVING_BIT:
            self.motion.observe_moving(asked_ns, is_moving=is_set)
        elif name == ALARM_BIT:
            if is_set and not self.is_alarmed:
                self.motion.displace()  # the drive has given up: it stopped anywhere
                self.lose_reference()
            self.is_alarmed = is_set
        elif name == HOMED_BIT and self.reference.follows_homed_bit:
            self.see_homed_bit(asked_ns, is_set=is_set)
        if name == self.reference.bit:
            was_referenced = self.reference.is_referenced
            self.reference.see_end_of_homing(asked_ns, is_set=is_set)
            self._follow_reference(was_referenced=was_referenced)


def join_terms(axes: Iterable[Axis]) -> None:
    """Connect each axis with the axes that act on it, also those of other lines."""
    axes = tuple(axes)
    partners = {axis.plan.name: Partner(axis.motion, axis.reference) for axis in axes}
    for axis in axes:
        if axis.correction.terms is not None:
            axis.correction.terms.join(partners)
