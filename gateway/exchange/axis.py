"""One axis between its registers and its maths: shadow words, reference, and what is seen of it.

The *shadow* of a command field holds what the controller believes the drive holds (nominal words) and what
the drive acknowledged (corrected words). Everything that can happen to a position on the wire, halves, masks,
blocks and cut reads, is a change of nominal words followed by rendering them with the correction in force.
"""

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

from gateway.compensation.axis import AxisCompensation
from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, spec_of_table
from gateway.compensation.fingerprint import table_digest
from gateway.compensation.moves import Accepted, Move
from gateway.compensation.readback import Readback
from gateway.compensation.settings import Setpoints
from gateway.counts import Counts
from gateway.drives.motion import Form
from gateway.exchange.arrival import Arrival, Stage
from gateway.exchange.events import Event, EventKind
from gateway.exchange.field_counts import counts_of, raw_of, steps_of
from gateway.exchange.hold import Hold
from gateway.exchange.hunting import MOST, Hunting
from gateway.exchange.motion_state import MotionState
from gateway.exchange.plan import (
    DONE_BIT,
    HOMED_BIT,
    AxisPlan,
    CompensationMode,
    Reference,
)
from gateway.exchange.reference import ReferenceState
from gateway.exchange.shadow import Shadow
from gateway.exchange.terms import Terms
from gateway.modbus.pdu import ExceptionCode
from gateway.modbus.registers import PositionField
from gateway.times import NS_PER_MS

if TYPE_CHECKING:
    from gateway.exchange.remembering import AxisMemory


@dataclass(slots=True)
class Actual:
    """The last actual position seen, as the drive reported it."""

    counts: Counts
    seen_ns: int


class Rendering(NamedTuple):
    """A target ready to be written: both forms of its words, and what accepting it means."""

    axis: "AxisExchange"
    shadow: Shadow
    nominal_words: bytes
    corrected_words: bytes
    corrected_counts: Counts
    move: Move | None
    """None for a repeat: the drive is told exactly the same words again (M4)."""
    is_distance: bool = False
    """The words are a distance; ``corrected_counts`` is where it ends."""
    start: Accepted | None = None
    """Where a distance starts."""


class Held(NamedTuple):
    """The last target as its drive was told it, over a change of the reference: its repeat moves nothing."""

    shadow: Shadow
    nominal_words: bytes
    corrected_words: bytes


@dataclass(slots=True)
class AxisExchange:
    """State of one axis on its line."""

    plan: AxisPlan
    compensation: AxisCompensation = field(init=False)
    base: CorrectionSpec = field(init=False)
    """What the table asks for."""
    terms: Terms | None = field(init=False)
    wanted: CorrectionSpec = field(init=False)
    """The same with its terms."""
    shadows: list[Shadow] = field(init=False)
    limit_shadows: list[Shadow] = field(init=False)
    motion: MotionState = field(init=False)
    has_branches: bool = field(init=False)
    """Whether the direction of travel makes a difference to the correction."""
    reference: ReferenceState = field(init=False)
    is_enabled: bool = field(init=False)
    """Whether a person or the configuration wants the table to be applied."""
    hold: Hold = field(init=False)
    """Who moves it."""
    is_ended: bool = False
    """A remapping register of its unit was written (M10)."""
    is_held_back: bool = False
    """Another axis of its group is not referenced (M11)."""
    actual: Actual | None = None
    arrival: Arrival = field(init=False)
    """How far the move to the last accepted target has come."""
    hunting: Hunting = field(default_factory=Hunting)
    heard_ns: int = 0
    """When it was seen last, or was told something that it acknowledged."""
    is_moving: bool | None = None
    """What the drive's moving bit said last; None: not known."""
    was_unsure: bool = False
    last_shadow: Shadow | None = None
    """Of the field through which the last accepted target came."""
    began: tuple[float, float] | None = None
    """Offset with which a stream has begun and what of it was motion, in units, until it is told."""
    held: Held | None = None
    unproven: Rendering | None = None
    """A target that was sent and not acknowledged: the drive may hold it or not."""
    peers: "tuple[AxisExchange, ...]" = ()
    """The other axes of its group (M11)."""
    is_branch_known: bool = False
    """The axis stands, or moves, on the branch of the last target, although it may have been stopped."""
    silent_since_ns: int | None = None
    silent_until_ns: int = 0
    """The first and the last request since then that its drive left unanswered."""
    is_alarmed: bool = False
    memory: "AxisMemory | None" = None
    """Its record for the next run of the gateway."""
    news: list[Event] = field(default_factory=list)
    """What the line has still to report."""

    def __post_init__(self) -> None:
        self.compensation = AxisCompensation(self.plan.settings)
        self.terms = Terms(self.plan) if self.plan.thermal or self.plan.cross else None
        self.shadows = [Shadow(field_) for field_ in self.plan.command]
        self.limit_shadows = [Shadow(field_) for field_ in self.plan.limits]
        self.motion = MotionState(self.plan.motion)
        self.arrival = Arrival(
            self.plan.done_drop_ms,
            has_actual=bool(self.plan.actual),
            is_in_position_only=self.plan.done_is_in_position,
        )
        self.reference = ReferenceState(self.plan.referenced)
        self.hold = Hold(self.plan.writer_hold_s, is_shared=not self.plan.has_one_writer)
        self.is_enabled = self.plan.compensation is not CompensationMode.OFF
        self._choose_correction()
        if self.is_referenced:
            self.compensation.find_reference(self.wanted)

    def _choose_correction(self) -> None:
        self.base = NOTHING
        self.has_branches = False
        if self.is_enabled and not self.is_ended and self.plan.table is not None:
            table = self.plan.table
            self.base = spec_of_table(table, self.plan.settings, digest=table_digest(table))
            curve = self.base.curve
            one_way = curve is not None and curve.table.is_unidirectional and self.base.gain.is_even
            self.has_branches = not one_way
        self.wanted = self.base if self.terms is None else self.terms.on(self.base, self.plan)

    @property
    def is_shadow(self) -> bool:
        """Compute and show, but write and read 1:1."""
        return self.plan.compensation is CompensationMode.SHADOW

    @property
    def is_recalling(self) -> bool:
        """Whether it is not decided yet if the record of the run before counts."""
        return self.memory is not None and self.memory.recalled is not None

    @property
    def passes_unchanged(self) -> bool:
        """Whether words of this axis go through 1:1 in both directions (M9)."""
        return self.is_shadow or self.compensation.is_passing

    @property
    def reads_unchanged(self) -> bool:
        """Whether what is read of it goes through 1:1: not yet while the last correction fades out."""
        return self.passes_unchanged and (self.is_shadow or self.compensation.readback.fade is None)

    @property
    def is_unsure(self) -> bool:
        """Whether the branch in force was assumed, where there are two and they count."""
        is_assumed = self.compensation.state.is_unsure or self.is_distance_unproven
        return self.has_branches and is_assumed and not self.compensation.is_passing

    @property
    def is_distance_unproven(self) -> bool:
        """Whether a distance was sent of which nobody knows if it ran: its axis is at one of two places."""
        return self.unproven is not None and self.unproven.is_distance

    @property
    def is_referenced(self) -> bool:
        """Whether the axis, and every axis of its group, knows where it is, as far as one can tell."""
        return self.reference.is_found and not self.is_held_back

    @property
    def may_read(self) -> bool:
        """Whether the gateway may add reads of this axis's registers (W8)."""
        return self.plan.safe_read and self.plan.added_frames

    @property
    def asked_actual(self) -> PositionField | None:
        """The actual position that the gateway may read by itself (W8); None: it only sees it in passing."""
        return self._asked(self.plan.actual)

    @property
    def asked_commanded(self) -> PositionField | None:
        """The same of the drive's own commanded position."""
        return self._asked(self.plan.commanded)

    def _asked(self, fields: tuple[PositionField, ...]) -> PositionField | None:
        return fields[0] if self.may_read and fields and fields[0].is_readable else None

    @property
    def blocked_by(self) -> int | None:
        """Exception code with which its triggers are refused, for a lost target of its own or its group's."""
        return self.motion.blocked_by if self.motion.is_blocked else self.blocked_by_peer

    @property
    def blocked_by_peer(self) -> int | None:
        """Exception code of a target that another axis of the group lost for its own sake (M11)."""
        for axis in self.peers:
            if axis.motion.is_blocked_first:
                return axis.motion.blocked_by
        return None

    @property
    def writes_words_alone(self) -> bool:
        """Whether the drive takes single registers only: a word is sent as it is written."""
        return self.plan.writes_with is Form.FC06

    def tell(self, kind: EventKind, detail: str = "") -> None:
        """Report something about this axis."""
        self.news.append(Event(kind, self.plan.name, detail))

    def is_unseen(self, now_ns: int) -> bool:
        """Whether somebody may have moved it since anything was heard of it or said to it (M5, M6)."""
        return now_ns - self.heard_ns > self.plan.unseen_ms * NS_PER_MS

    def is_at_target(self, corrected_counts: Counts) -> bool:
        """Whether a position lies in the in-position window of the last accepted target."""
        accepted = self.compensation.accepted
        if accepted is None:
            return False
        return abs(corrected_counts - accepted.corrected_counts) <= self.plan.settings.in_position_counts

    # --- reference -------------------------------------------------------------------------------------

    def follow_reference(self, *, was_referenced: bool) -> None:
        """Put into force what the reference is now."""
        is_referenced = self.is_referenced
        if is_referenced is was_referenced:
            return
        held = self._target_that_holds()
        self.forget_place(keeps_branch=self.compensation.is_stream)  # a stream keeps its offset
        self.held = held
        self.doubt_words()
        if is_referenced:
            self.actual = None  # it may have been counted from another zero
            self.compensation.find_reference(self.wanted)
        else:
            self.compensation.lose_reference()

    def _target_that_holds(self) -> Held | None:
        """Return the last accepted target with its words, where nothing but a target moves the axis since."""
        shadow, accepted = self.last_shadow, self.compensation.accepted
        if self.compensation.is_stream or accepted is None or shadow is None:
            return self.held
        if shadow.nominal_words is None or shadow.corrected_words is None:
            return None
        field_ = self.plan.command[self.shadows.index(shadow)]
        if counts_of(field_, field_.unpack(shadow.nominal_words)) != accepted.nominal_counts:
            return None  # another one is staged there by now, or a distance
        return Held(shadow, shadow.nominal_words, shadow.corrected_words)

    def begin_stream_anew(self) -> None:
        """The drive counts from another zero: setpoints begin again from where it is."""
        if self.compensation.is_stream:
            self.compensation.begin_anew()
            if self.is_referenced:
                self.compensation.find_reference(self.wanted)

    def see_homed_bit(self, now_ns: int, *, is_set: bool) -> None:
        """Take note of the drive's homed bit."""
        was_referenced = self.is_referenced
        self.reference.see(now_ns, is_set=is_set)
        self.follow_reference(was_referenced=was_referenced)

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

        A stream of setpoints is not held up for an old bit while the axis is referenced.
        """
        is_stream = self.plan.settings.setpoints is Setpoints.STREAM
        before_target = is_target and not (is_stream and self.is_referenced)
        return self.may_read and self.reference.has_to_be_asked(now_ns, before_target=before_target)

    def enable(self, *, is_wanted: bool) -> None:
        """Apply the table, or stop to: with the next different target, never by itself."""
        self.is_enabled = is_wanted
        self._choose_correction()
        if self.is_referenced:
            self.compensation.want(self.wanted)

    def adopt(self, plan: AxisPlan) -> None:
        """Go on with another table or gain; comes into force as in :meth:`enable`."""
        self.plan = plan
        self.enable(is_wanted=self.is_enabled)

    def end(self) -> None:
        """End the compensation until the gateway is started again: its registers mean something else now."""
        self.is_ended = True
        self._choose_correction()
        self.forget()
        self.compensation.begin_anew()

    def doubt(self, now_ns: int) -> None:
        """The drive was silent and may have lost its reference."""
        if self.silent_since_ns is None:
            self.silent_since_ns = now_ns
        self.silent_until_ns = now_ns
        if not self.reference.follows_bit:
            return
        if self.may_read:
            self.reference.is_in_doubt = True
        else:
            self.see_homed_bit(now_ns, is_set=False)

    def end_silence(self, *, is_answer: bool) -> None:
        """Look at how long the drive has been silent: it may have been switched off meanwhile."""
        since_ns = self.silent_since_ns
        if since_ns is None:
            return
        if is_answer:
            self.silent_since_ns = None
        if self.silent_until_ns - since_ns > self.plan.lost_ms * NS_PER_MS:
            unproven, held = self.unproven, self._target_that_holds()
            self.forget()
            self.unproven = unproven  # it may have arrived before the drive fell silent
            self.arrival.begin(self.silent_until_ns)
            self.lose()
            if not self.is_referenced:
                self.held = held

    def lose(self) -> None:
        """The drive may have lost its position."""
        was_referenced = self.is_referenced
        self.reference.note_loss()
        self.follow_reference(was_referenced=was_referenced)

    def declare_referenced(self) -> None:
        """A person says that the axis stands where its drive says."""
        was_referenced = self.is_referenced
        self.reference.declare()
        self.follow_reference(was_referenced=was_referenced)

    def forget(self) -> None:
        """What the drive holds is unknown (M7)."""
        self.forget_place()
        self.motion.forget()
        for shadow in (*self.shadows, *self.limit_shadows):
            shadow.forget()

    def doubt_words(self) -> None:
        """The drive may hold other targets than it was told; what the controller believes stays."""
        for shadow in self.shadows:
            shadow.corrected_words = None

    def forget_place(self, moved_ns: int | None = None, *, keeps_branch: bool = False) -> None:
        """Something else than the last target decides where the axis is (M5).

        ``moved_ns``: since when it may be on a new way; None: it is on none. ``keeps_branch``: it came there
        by the last target all the same, as after a stop.
        """
        self.is_branch_known &= keeps_branch
        self.compensation.forget_target()
        if moved_ns is None:
            self.arrival.lose_place()
        else:
            self.arrival.begin(moved_ns)
        self.is_moving = None
        self.unproven = self.held = None

    def link_lost(self, now_ns: int) -> None:
        """Forget what may have changed while nobody looked."""
        if self.memory is not None:
            self.memory.pause()
        self.forget()
        self.actual = None
        self.doubt(now_ns)

    def writes_nothing(self, code: int) -> bool:
        """Whether an exception to a write proves that nothing was written (M7).

        A function code that a drive does not know it cannot have carried out.
        """
        return self.plan.exception_writes_nothing or code == ExceptionCode.ILLEGAL_FUNCTION

    def fail(self, rendering: Rendering, now_ns: int) -> None:
        """A target was sent and not acknowledged: the drive may hold it or not.

        Of a repeat it holds the same words in either case.
        """
        is_repeat = rendering.move is None and not rendering.is_distance
        if is_repeat and (self.compensation.accepted is not None or self.held is not None):
            return
        self.fail_run(rendering, now_ns)
        rendering.shadow.forget()

    def fail_run(self, rendering: Rendering, now_ns: int) -> None:
        """A trigger was not acknowledged: the drive holds its target, and may be going there or not."""
        self.forget_place(now_ns)
        if rendering.move is not None:
            self.unproven = rendering

    def go_nowhere(self) -> None:
        """A distance that was not acknowledged did not run: the axis stands where it would have started."""
        assert self.unproven is not None
        self.compensation.accepted = self.unproven.start
        self.unproven = None
        self.is_branch_known = True

    # --- reading ---------------------------------------------------------------------------------------

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
        if accepted is not None and corrected_counts == accepted.corrected_counts:
            return field_.pack(raw_of(field_, accepted.nominal_counts))
        correction = readback.correction_counts(corrected_counts)
        if not correction:
            return words
        return field_.pack(corrected - steps_of(field_, correction))

    def command_words(self, shadow: Shadow, field_: PositionField, words: bytes, readback: Readback) -> bytes:
        """Turn the words of a command field that is read back into what the controller wrote.

        They also prove that a target arrived which was never acknowledged.
        """
        unproven = self.unproven
        is_proof = unproven is not None and unproven.shadow is shadow and unproven.corrected_words == words
        if unproven is not None and unproven.is_distance:
            is_proof = False  # that it is written says nothing about its having run
        if unproven is not None and is_proof and not self.motion.plan.waits_for_trigger:
            self.commit(unproven, self.heard_ns)
        if shadow.nominal_words is not None and shadow.corrected_words == words:
            return shadow.nominal_words
        return self.nominal_words(field_, words, readback)

    def nominal_of(self, corrected_counts: Counts) -> float:
        """Nominal counts of an actual position, as the controller would read it, not rounded."""
        if self.is_shadow:
            return corrected_counts
        return corrected_counts - self.compensation.readback.correction_counts(corrected_counts)

    # --- writing ---------------------------------------------------------------------------------------

    def commit(self, rendering: Rendering, now_ns: int = 0, losses: int | None = None) -> None:
        """The drive acknowledged a target with its full native success, and goes there (M7).

        ``losses``: of its shadow, when the target was sent.
        """
        rendering.shadow.settle(rendering.nominal_words, rendering.corrected_words, losses)
        self.heard_ns = now_ns
        if rendering.move is None:
            self.compensation.touch(now_ns)
        else:
            self.accept(rendering, now_ns)

    def _note_branch_change(self, now_ns: int) -> None:
        if self.has_branches and self.hunting.note_change(now_ns):
            detail = f"its branch changed more than {MOST} times in 10 s"
            self.tell(EventKind.BRANCH_HUNTS, detail)

    def tell_beginning(self) -> None:
        """Report with what offset a stream has begun."""
        if self.began is None:
            return
        (offset, rest), units = self.began, self.plan.settings.units.value
        self.began = None
        if offset or rest:
            what = f"the drive stood {offset:+.6g} {units} from the first setpoint, which stays in force"
            motion = f"; {rest:+.6g} {units} more cannot be a correction and were gone" if rest else ""
            self.tell(EventKind.STREAM_BEGAN, f"{what} until the table has taken over{motion}")

    def accept(self, rendering: Rendering, now_ns: int) -> None:
        """The axis goes to a target, or has gone there, whatever its registers hold by now."""
        assert rendering.move is not None
        compensation, stage = self.compensation, self.arrival.stage
        is_stream, is_reached = compensation.is_stream, stage is Stage.ARRIVED
        if not is_stream and compensation.state.travel.direction is not rendering.move.state.travel.direction:
            self._note_branch_change(now_ns)
        compensation.commit(rendering.move, rendering.corrected_counts, is_reached=is_reached)
        self.is_branch_known = True
        self.last_shadow = rendering.shadow
        self.unproven = None
        self.motion.runs_stored = False
        if not is_stream or stage is not Stage.UNDER_WAY:
            self.arrival.begin(now_ns)
        self.held = None
        self.is_moving = None
