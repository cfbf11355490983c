"""The state of one axis: everything that decides what its next target becomes, in one record.

Theory of operation
===================

A controller commands *nominal* positions, its drive is told *corrected* ones. What is added depends on where
the axis is to go, and, as a worn screw has lost motion, on the side from which it gets there: its *branch*.
So two things have to be known of an axis: whether its positions mean anything, and where it is.

*Whether its positions mean anything* is :class:`Referenced`; whether they are to be corrected a person
decides, or a drive whose registers were moved about (:class:`Switched`). While nothing is known, positions
pass 1:1 in both directions.

*Where it is* is :class:`Whereabouts`. A target that the drive acknowledged makes the axis be under way; bits
and positions that are seen afterwards prove its arrival step by step; a stop, a jog, homing, an alarm or a
lost reply takes that away again. Of an axis that has arrived the sign of its next way tells on which branch
the next target lies, however short that way; of any other a reading has to tell, or the branch is flagged
(``rendering``). What is seen counts only where it cannot be of the time before: a sample is as old as the
sending of its request, and a done bit may be that of the move before until it was seen to fall or the drive
has had the time to let it fall (:class:`Said`).

*How it is corrected* at the moment is in ``compensation`` (``gateway.compensation``): direction, blends,
offset, the last target in both frames, and the readback map that turns readings back. The target is there
exactly while the place is one of :data:`TARGETED`.

*What the drive holds* is the register image (``registers``): targets may stand in the drive without being
run, and parts of them may have been lost. What was lost *blocks* the triggers (:class:`Block`).

All of that changes in ``transitions`` and nowhere else: each thing that can happen to an axis is one method
of ``Axis`` there. What becomes of its whereabouts, its reference and its block is a table in the file of each
(``motion``, ``reference``, ``interlock``). This class only answers questions. Who moves the axis (``hold``) is
kept beside it, by ``ownership``.
"""

from enum import Enum
from math import isfinite
from typing import Final

from gateway.compensation.axis import AxisCompensation
from gateway.compensation.correction_spec import NOTHING, CorrectionSpec
from gateway.compensation.readback import Readback
from gateway.compensation.settings import Setpoints
from gateway.counts import Counts
from gateway.drives.motion import Action, Form
from gateway.exchange.axis.acknowledge import AT_ONE_END, OnWire, Proof, Rendering
from gateway.exchange.axis.beam import Fixed
from gateway.exchange.axis.hold import Hold
from gateway.exchange.axis.hunting import Hunting
from gateway.exchange.axis.interlock import Block
from gateway.exchange.axis.motion import (
    KEEPING,
    ON_BRANCH,
    WAS_THERE,
    Actual,
    Keeping,
    KeptOver,
    Retained,
    Said,
    Whereabouts,
)
from gateway.exchange.axis.reference import (
    FOUND,
    HOMING,
    IN_DOUBT,
    REFERENCE_FRESH_NS,
    UNTOLD,
    Referenced,
)
from gateway.exchange.axis.registers import FieldImage, RuleImage
from gateway.exchange.axis.sight import Sight
from gateway.exchange.events import Event
from gateway.exchange.field_counts import counts_of, raw_of, steps_of
from gateway.exchange.plan import DONE_BIT, HOMED_BIT, AxisPlan, CompensationMode, Reference
from gateway.modbus.pdu import ExceptionCode
from gateway.modbus.registers import PositionField
from gateway.times import NS_PER_MS

_FOUND: Final = Referenced.FOUND  # a member is looked up slowly, and these are asked for with each frame
_FOUND_IN_DOUBT: Final = Referenced.FOUND_IN_DOUBT
_SAYS_NOTHING_WRITTEN: Final = frozenset(
    {
        ExceptionCode.ILLEGAL_DATA_ADDRESS,
        ExceptionCode.ILLEGAL_DATA_VALUE,
        ExceptionCode.SERVER_DEVICE_FAILURE,
    }
)


class Switched(Enum):
    """Whether the table is to be applied, as far as anybody decides that."""

    ON = "on"
    OFF = "off"
    ENDED = "ended"
    """A remapping register of its unit was written (M10): off until a restart."""


class AxisState:
    """What is known of one axis, and the questions that can be asked of it. See the module."""

    __slots__ = (
        "_done_drop_ns",
        "actual",
        "asked_actual",
        "asked_commanded",
        "base",
        "began",
        "block",
        "block_code",
        "blocked_in_epoch",
        "compensation",
        "epoch",
        "events",
        "fields",
        "fixed",
        "has_branches",
        "has_rules",
        "heard_ns",
        "hold",
        "holds_unrun",
        "homing_since_ns",
        "hunting",
        "is_alarmed",
        "is_dry_run",
        "is_moving",
        "last_number",
        "last_run",
        "limit_fields",
        "may_read",
        "on_wire",
        "pending",
        "plan",
        "reference",
        "reference_seen_ns",
        "retained",
        "rules",
        "said",
        "sent_off_ns",
        "sight",
        "silent_since_ns",
        "silent_until_ns",
        "switched",
        "told_referenced",
        "told_restaged_ns",
        "told_unknown",
        "told_unsure",
        "unproven",
        "waits_for_peers",
        "wanted",
        "whereabouts",
    )

    def __init__(self, plan: AxisPlan) -> None:
        self.plan = plan
        # --- what of the plan is asked for with each request
        self.is_dry_run = plan.compensation is CompensationMode.SHADOW
        """Whether it is a dry run: computed and shown, written and read 1:1 (``compensation = "shadow"``).

        The only one of these that changes: a reload may end it (``Axis.end_dry_run``).
        """
        self.has_rules = plan.has_rules
        """Whether a frame to it may mean something else than positions to be gone to at once."""
        self.may_read = plan.safe_read and plan.added_frames
        """Whether the gateway may add reads of this axis's registers (W8)."""
        self.asked_actual = self.asked(plan.actual)
        """The actual position that the gateway may read by itself (W8); None: it only sees it in passing."""
        self.sight = Sight.OPEN
        """Whether its drive tells that; where it does not, ``asked_actual`` is None."""
        self.asked_commanded = self.asked(plan.commanded)
        """The same of the drive's own commanded position."""
        # --- whether its positions mean anything
        self.reference = Referenced.FOUND
        self.reference_seen_ns = 0
        """When the bit that decides was seen last."""
        self.homing_since_ns = 0
        """When the last homing command went out, or when the bit was seen to be down since."""
        self.waits_for_peers = False
        """Another axis of its group is not referenced (M11)."""
        self.switched = Switched.ON
        self.fixed: Fixed | None = None
        """What counts in place of reference and switch until its group has gone (M11); None: nothing does."""
        # --- where it is
        self.whereabouts = Whereabouts.UNKNOWN
        self.said = Said.NOTHING
        self.sent_off_ns = 0
        """When the drive was made to move last, or may have been."""
        self.unproven: Rendering | None = None
        """The target that was not acknowledged; there exactly in both places of that name."""
        self.retained: Retained | None = None
        """The last target: there exactly in the places :data:`RETAINING`."""
        self.last_number: int | None = None
        """Of the command field through which the last accepted target came."""
        self.actual: Actual | None = None
        self.heard_ns = 0
        """When it was seen last, or was told something that it acknowledged."""
        self.is_moving = False
        """Its moving bit was set when it was seen last, and nothing has been commanded since."""
        self.is_alarmed = False
        """Its alarm bit was set when it was seen last: only its rise tells of something."""
        self.silent_since_ns: int | None = None
        self.silent_until_ns = 0
        """The first and the last request since then that its drive left unanswered."""
        # --- how it is corrected
        self.compensation = AxisCompensation(plan.settings)
        self.base: CorrectionSpec = NOTHING
        """What the table asks for."""
        self.wanted: CorrectionSpec = NOTHING
        """The same with its terms."""
        self.has_branches = False
        """Whether the direction of travel makes a difference to the correction."""
        # --- what the drive holds
        self.fields = [FieldImage(each, waits=plan.motion.waits_for_trigger) for each in plan.command]
        self.limit_fields = [FieldImage(each) for each in plan.limits]
        self.rules = RuleImage(plan.motion)
        self.block = Block.NONE
        self.block_code = 0
        """Exception code of the target that was lost; its triggers are refused with it."""
        self.blocked_in_epoch = 0
        """The epoch that began with the loss for which triggers were blocked last."""
        self.holds_unrun = False
        """A target was written since a trigger ran one."""
        self.epoch = 0
        """Goes up with each target and mode that is lost: what was sent before makes up for none."""
        self.last_run = Action.ABSOLUTE
        """How the last target was meant: the best guess for one that is staged before its mode is known."""
        self.on_wire = OnWire.NOTHING
        self.pending: Rendering | None = None
        """The target that was on the wire last, as long as its record has to name it."""
        # --- who moves it, and what is to be told
        self.hold = Hold(plan.writer_hold_s, is_shared=not plan.has_one_writer)
        self.hunting = Hunting()
        self.events: list[Event] = []
        """What the line has still to report."""
        self.began: tuple[float, float] | None = None
        """Offset with which a stream has begun and what of it was motion, in units, until it is told."""
        self.told_referenced: bool | None = None
        self.told_unsure = False
        self.told_restaged_ns: int | None = None
        self.told_unknown: tuple[tuple[int, int], ...] | None = None
        """Register contents that were reported as unknown last."""
        self._done_drop_ns = int(plan.done_drop_ms * NS_PER_MS)

    # --- whether its positions mean anything -----------------------------------------------------------

    @property
    def is_found(self) -> bool:
        """Whether the axis itself knows where it is, as far as one can tell."""
        return self.reference is _FOUND or self.reference is _FOUND_IN_DOUBT

    @property
    def is_referenced(self) -> bool:
        """Whether the axis, and every axis of its group, knows where it is, as far as one can tell."""
        reference = self.reference
        return (reference is _FOUND or reference is _FOUND_IN_DOUBT) and not self.waits_for_peers

    @property
    def goes_as_referenced(self) -> bool:
        """Whether its next target goes as that of an axis that knows where it is (M11)."""
        fixed = self.fixed
        return self.is_referenced if fixed is None else fixed.is_referenced

    @property
    def follows_homed_bit(self) -> bool:
        """Whether the drive's homed bit decides."""
        return self.plan.referenced is Reference.DRIVE_BIT

    @property
    def hangs_on_a_bit(self) -> bool:
        """Whether a status bit of the drive tells when the reference is found."""
        return self.plan.referenced in (Reference.DRIVE_BIT, Reference.HOMING)

    @property
    def is_reference_told(self) -> bool:
        """Whether the homed bit was ever seen, where it decides."""
        return self.reference not in UNTOLD

    @property
    def is_enabled(self) -> bool:
        """Whether a person or the configuration wants the table to be applied."""
        return self.switched is Switched.ON

    @property
    def passes_unchanged(self) -> bool:
        """Whether words of this axis go through 1:1 in both directions (M9)."""
        return self.is_dry_run or self.compensation.is_passing

    @property
    def reads_unchanged(self) -> bool:
        """Whether what is read of it goes through 1:1: not yet while the last correction fades out."""
        return self.passes_unchanged and (self.is_dry_run or self.compensation.readback.fade is None)

    @property
    def homed_bit(self) -> str:
        """Name of the bit that tells when homing has ended."""
        return (
            DONE_BIT
            if self.plan.referenced is Reference.HOMING and HOMED_BIT not in self.plan.bits
            else HOMED_BIT
        )

    def needs_reference(self, now_ns: int, *, is_target: bool) -> bool:
        """Whether the homed bit has to be read before this axis's positions pass.

        A stream of setpoints is not held up for an old bit while the axis is referenced. Nor is anything of a
        group of which one axis has gone: its reference is fixed.
        """
        if not self.may_read or self.fixed is not None:
            return False
        is_stream = self.plan.settings.setpoints is Setpoints.STREAM
        before_target = is_target and not (is_stream and self.is_referenced)
        if not self.follows_homed_bit:
            return before_target and self.reference in HOMING and self.plan.referenced is Reference.HOMING
        is_old = self.reference not in FOUND or now_ns - self.reference_seen_ns > REFERENCE_FRESH_NS
        return self.reference in IN_DOUBT or (before_target and is_old)

    # --- where it is -----------------------------------------------------------------------------------

    @property
    def has_arrived(self) -> bool:
        """Whether the axis is known to stand at its target."""
        return self.whereabouts is Whereabouts.ARRIVED

    @property
    def is_unsure(self) -> bool:
        """Whether the branch in force was assumed, where there are two and they count."""
        is_assumed = self.compensation.is_unsure or self.is_distance_unproven
        return is_assumed and self.has_branches and not self.compensation.is_passing

    @property
    def knows_branch(self) -> bool:
        """Whether a position of the drive can be turned back on a branch that was not merely assumed.

        A target that was reached on an assumed branch is where the controller takes the axis to be; a place
        short of it, where the axis was stopped, is not.
        """
        is_assumed = self.whereabouts is Whereabouts.STOPPED and self.compensation.is_unsure
        return self.whereabouts in ON_BRANCH and not is_assumed

    @property
    def is_distance_unproven(self) -> bool:
        """Whether a distance was sent of which nobody knows if it ran: its axis is at one of two places.

        So it is with a target that the axis may have gone to or have come past (``record.Finding.EITHER``).
        """
        unproven = self.unproven
        return unproven is not None and (unproven.is_distance or unproven.proof is not Proof.ONE)

    @property
    def is_out_of_sight(self) -> bool:
        """Whether it is not asked where it is because its drive refuses to tell."""
        return self.sight is Sight.REFUSED

    def looks_wanted(self, now_ns: int) -> int:
        """How often it has to be read to tell whether it went, of a target that its record names; 0: not."""
        unproven = self.unproven
        if unproven is None or unproven.proof in (Proof.ONE, Proof.NONE) or not self.may_stand(now_ns):
            return 0
        return 1 if unproven.proof in AT_ONE_END else 2

    @property
    def says_done(self) -> bool:
        """Of an axis at rest whose target is not proven: whether its drive says so, where it has a bit."""
        return DONE_BIT not in self.plan.bits or self.whereabouts is Whereabouts.UNPROVEN_AT_REST

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
        is_new = self.said is not Said.NOTHING or asked_ns - self.sent_off_ns >= self._done_drop_ns
        return is_new and asked_ns >= self.sent_off_ns

    def may_stand(self, asked_ns: int) -> bool:
        """Whether a position that was asked for then may be that of an axis that has come to rest."""
        return self.has_started(asked_ns) and self.said is not Said.MOVES

    def asked(self, fields: tuple[PositionField, ...]) -> PositionField | None:
        """Return the one of some positions that the gateway may read by itself; None: none."""
        return fields[0] if self.may_read and fields and fields[0].is_readable else None

    # --- what the drive holds --------------------------------------------------------------------------

    def is_repeat(self, number: int, nominal_words: bytes) -> bool:
        """Whether a command field is written with what the drive acknowledged there already (M4)."""
        image = self.fields[number]
        return (
            self.compensation.accepted is not None
            and not image.is_torn
            and image.nominal_words == nominal_words
            and image.corrected_words is not None
            and (number != self.last_number or self.is_dry_run or self._holds_target(number))
        )

    def _holds_target(self, number: int) -> bool:
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
    def writes_words_alone(self) -> bool:
        """Whether the drive takes single registers only: a word is sent as it is written."""
        return self.plan.writes_with is Form.FC06

    def writes_nothing(self, code: int, *, reads_too: bool) -> bool:
        """Whether an exception to a write proves that nothing was written (M7).

        A function code that a drive does not know it cannot have carried out. What is wrong with an address,
        a value or the drive itself (2 to 4) proves it where the register map says so; not of a frame that
        reads too, whose reading may have been refused after the writing. Busy, acknowledge and the codes of
        gateways never prove it.
        """
        if code == ExceptionCode.ILLEGAL_FUNCTION:
            return True
        return code in _SAYS_NOTHING_WRITTEN and self.plan.exception_writes_nothing and not reads_too

    @property
    def retained_target(self) -> Retained | None:
        """The last accepted target with its words, where nothing but a target moves the axis since."""
        accepted, number = self.compensation.accepted, self.last_number
        newest_ns = 0 if self.actual is None else self.actual.seen_ns
        if self.compensation.is_stream or accepted is None or number is None:
            retained = self.retained
            if retained is None:
                return None
            was_there = retained.was_there or self.is_seen_at_retained
            over = KeptOver.LOSS if retained.is_declared else retained.over
            return retained._replace(was_there=was_there, newest_ns=newest_ns, over=over)
        image = self.fields[number]
        if not self._holds_target(number):
            return None  # another one is staged there by now, or a distance
        assert image.nominal_words is not None
        assert image.corrected_words is not None
        return Retained(
            number,
            image.nominal_words,
            image.corrected_words,
            accepted.corrected_counts,
            self.compensation.again(),
            self.whereabouts in WAS_THERE,
            newest_ns,
        )

    def retained_as(self, number: int, nominal_words: bytes) -> Retained | None:
        """Return the target of before a loss of reach or reference, where these words are it; else None."""
        retained = self.retained
        if retained is None or (retained.number, retained.nominal_words) != (number, nominal_words):
            return None
        return retained

    def keeping(self, number: int, nominal_words: bytes) -> Keeping:
        """Return what a target is by what is known now, that may be the one of before a loss."""
        retained = self.retained_as(number, nominal_words)
        if retained is None:
            return Keeping.NEW
        if retained.is_declared:
            return Keeping.SAME_WORDS
        if not self.plan.actual and self.whereabouts is Whereabouts.OUT_OF_REACH:
            return Keeping.SAME_WORDS  # no reading can ever tell, and its positions still mean something
        return KEEPING[self.is_seen_at_retained, self.plan.motion.waits_for_trigger, retained.was_there]

    @property
    def is_seen_at_retained(self) -> bool:
        """Whether the axis was seen, after the loss, where its retained target had sent it."""
        return self.seen_at_retained is True

    @property
    def seen_at_retained(self) -> bool | None:
        """Whether it stands where its retained target had sent it; None: nobody has seen it stand since.

        With a declared reference another place proves nothing: the axis may be on its way.
        """
        retained, actual = self.retained, self.actual
        if retained is None or actual is None or actual.seen_ns <= retained.newest_ns or self.is_moving:
            return None
        window = self.plan.settings.in_position_counts
        is_there = abs(actual.counts - retained.corrected_counts) <= window
        return None if retained.is_declared and not is_there else is_there

    # --- what is read of it ----------------------------------------------------------------------------

    def nominal_words(self, field_: PositionField, words: bytes, readback: Readback) -> bytes:
        """Turn words reported by the drive into what the controller is to see.

        Raises:
            RegisterRangeError: the nominal position does not fit the register.
        """
        corrected = field_.unpack(words)
        if not isfinite(corrected):
            return words
        corrected_counts = counts_of(field_, corrected)
        accepted = self.compensation.accepted
        if accepted is not None:
            corrected_target = accepted.corrected_counts
            # A register in coarser steps than that of the target says the same of the places around it.
            if corrected_counts == corrected_target or corrected == raw_of(field_, corrected_target):
                return field_.pack(raw_of(field_, accepted.nominal_counts))
        correction = readback.correction_counts(corrected_counts)
        if not correction:
            return words
        return field_.pack(corrected - steps_of(field_, correction))

    def nominal_of(self, corrected_counts: Counts) -> float:
        """Nominal counts of an actual position, as the controller would read it, not rounded."""
        if self.is_dry_run:
            return corrected_counts
        return corrected_counts - self.compensation.readback.correction_counts(corrected_counts)
