"""What can happen to an axis, each as one method: nothing else changes its state.

What one of several states becomes is a table: :data:`WHEREABOUTS_AFTER`, :data:`REFERENCE_AFTER`,
:data:`BLOCK_AFTER`. What is not in a table changes nothing. A method says what follows
beside the table; what it changes is the axis alone, and what is to be told of it, which the line passes on
(``events``).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import Final

from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, spec_of_table
from gateway.compensation.errors import SettingsError, TableError
from gateway.compensation.fingerprint import table_digest
from gateway.compensation.moves import Accepted, Move, State
from gateway.compensation.readback import Fade, Readback
from gateway.compensation.settings import AxisSettings
from gateway.drives.motion import Action
from gateway.exchange.axis.acknowledge import (
    AT_ONE_END,
    PROOF_AFTER,
    End,
    OnWire,
    Outcome,
    Proof,
    Rendering,
)
from gateway.exchange.axis.axis_request import AxisRequest, Command, Part, SteadyTarget
from gateway.exchange.axis.beam import Beam, BeamEvent, Fixed
from gateway.exchange.axis.hunting import MOST
from gateway.exchange.axis.interlock import BLOCK_AFTER, Block, BlockEvent
from gateway.exchange.axis.motion import (
    AT_REST,
    ON_BRANCH,
    ON_WAY,
    RETAINING,
    TARGETED,
    UNPROVEN,
    WAS_THERE,
    WHEREABOUTS_AFTER,
    Actual,
    Happening,
    KeptOver,
    Retained,
    Said,
    Whereabouts,
)
from gateway.exchange.axis.record import (
    PROVEN,
    Fate,
    Finding,
    Record,
    TableNotFoundError,
    find,
    lacks_reference,
    may_have_stopped,
    proof_of,
    state_of,
)
from gateway.exchange.axis.record_layout import Remembered, RememberedMove
from gateway.exchange.axis.reference import (
    HOMING,
    HOMING_SETTLE_NS,
    REFERENCE_AFTER,
    REFERENCE_AT_START,
    Referenced,
    ReferenceEvent,
)
from gateway.exchange.axis.registers import JOIN_NS, Loss
from gateway.exchange.axis.sight import SIGHT_AFTER, Sight, Told
from gateway.exchange.axis.state import AxisState, Switched
from gateway.exchange.axis.terms import Terms
from gateway.exchange.events import Event, EventKind
from gateway.exchange.field_counts import counts_of, raw_of
from gateway.exchange.plan import (
    ALARM_BIT,
    DONE_BIT,
    HOMED_BIT,
    MOVING_BIT,
    AxisPlan,
    CompensationMode,
    Reference,
)
from gateway.modbus.registers import PositionField
from gateway.times import NS_PER_MS, NS_PER_S

SEEN_LATELY_NS: Final = 500 * NS_PER_MS
"""An actual position seen so long ago says where a stream begins, where none can be read."""
RESTAGED_EVERY_NS: Final = 60 * NS_PER_S
"""How often restaging is reported; all of it is counted."""

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
"""Actions after which the last target does not say any more where the axis is."""

# A member is looked up slowly, and these are asked for with each move.
_UNDER_WAY: Final = Whereabouts.UNDER_WAY
_SET_OUT: Final = Whereabouts.SET_OUT
_STOPPED: Final = Whereabouts.STOPPED
_ARRIVED: Final = Whereabouts.ARRIVED
_NOTHING: Final = OnWire.NOTHING
_REFUSED: Final = Sight.REFUSED
REMAPPED: Final = "its drive's registers were moved about; corrected again after a restart of the gateway"


class Axis(AxisState):
    """An axis on its line: its state, and what can happen to it."""

    __slots__ = ("beam", "peers", "record", "terms")

    def __init__(self, plan: AxisPlan) -> None:
        super().__init__(plan)
        self.terms = Terms(plan) if plan.thermal or plan.cross else None
        self.peers: tuple[Axis, ...] = ()
        """The other axes of its group (M11)."""
        self.beam: Beam | None = None
        """What the first trigger of its group has fixed; one for all of its axes."""
        self.record: Record | None = None
        """What is kept of it for the next run of the gateway."""
        self.reference = REFERENCE_AT_START[plan.referenced]
        self.switched = Switched.OFF if plan.compensation is CompensationMode.OFF else Switched.ON
        self._choose_correction()
        if self.is_referenced:
            self.compensation.find_reference(self.wanted)
        self.told_referenced = None if self.follows_homed_bit else self.is_referenced

    def tell(self, kind: EventKind, detail: str = "") -> None:
        """Report something about this axis."""
        self.events.append(Event(kind, self.plan.name, detail))

    def take_events(self) -> tuple[Event, ...]:
        """Return what is to be reported of this axis, each change once; its record says the same then."""
        if self.record is not None:
            self.publish()
        if self.is_referenced is not self.told_referenced and self.is_reference_told:
            self._tell_reference()
        if self.is_unsure is not self.told_unsure:
            self.told_unsure = self.is_unsure
            if self.told_unsure:
                detail = "where the axis is could not be told; it keeps its branch"
                if self.is_out_of_sight:
                    detail += "; its drive refuses to tell its actual position"
                self.tell(EventKind.DIRECTION_UNSURE, detail)
        if not self.events:
            return ()
        taken = tuple(self.events)
        self.events = []
        return taken

    def _tell_reference(self) -> None:
        self.told_referenced = self.is_referenced
        if self.is_referenced:
            self.tell(EventKind.AXIS_REFERENCED)
            return
        detail = "the drive does not say that it is homed: positions pass 1:1"
        if not self.follows_homed_bit:
            detail = "it may not stand where its drive says any more: positions pass 1:1"
        if self.waits_for_peers and self.is_found:
            detail = "another axis of its group is not referenced: positions pass 1:1"
        self.tell(EventKind.REFERENCE_LOST, detail)

    # --- where it is -----------------------------------------------------------------------------------

    def happens(self, happening: Happening) -> None:
        """Go on to the place that the table says, and let go of what belongs to other places."""
        place = WHEREABOUTS_AFTER.get((self.whereabouts, happening))
        if place is None:
            return
        self.whereabouts = place
        if place not in TARGETED:
            self.compensation.forget_target()
        if self.unproven is not None and place not in UNPROVEN:
            if self.pending is self.unproven and self.on_wire is _NOTHING:
                self.pending = None  # its record need not name it any more
            self.unproven = None
        if place not in RETAINING:
            self.retained = None

    def _send_off(self, now_ns: int) -> None:
        """The drive is made to move, or may be: what it said before is of the time before."""
        self.sent_off_ns = now_ns
        self.said = Said.NOTHING

    def displace(self, moved_ns: int | None = None, *, keeps_branch: bool = False) -> None:
        """Something else than the last target decides where the axis is (M5).

        ``moved_ns``: since when it may be on a new way; None: it is on none. ``keeps_branch``: it came there
        by the last target all the same, as after a stop.
        """
        self.happens(Happening.STOPPED if keeps_branch else Happening.DISPLACED)
        if moved_ns is not None:
            self._send_off(moved_ns)
        self.is_moving = False

    def forget(self) -> None:
        """Where the axis is and what its drive holds is unknown (M7)."""
        self.displace()
        self._forget_words()

    def _forget_words(self) -> None:
        self.rules.forget()
        for image in (*self.fields, *self.limit_fields):
            image.forget()

    def _lose_reach(self, *, was_closed: bool = False) -> None:
        """The drive cannot be seen: what it holds and where its axis is has to be found out anew.

        ``was_closed``: a connection was closed in order, by its server when it was idle or by us.
        """
        if self.beam is not None:
            self._group_happens(BeamEvent.ENDED)
        retained = self.retained_target
        over = KeptOver.ORDERLY_CLOSE if was_closed else KeptOver.LOSS
        self.happens(Happening.DISPLACED if retained is None else Happening.OUT_OF_REACH)
        self.retained = None if retained is None else retained._replace(over=over)
        self.is_moving = False
        self._forget_words()

    def doubt_words(self) -> None:
        """The drive may hold other targets than it was told; what the controller believes stays."""
        for image in self.fields:
            image.doubt()

    # --- whether its positions mean anything -----------------------------------------------------------

    def _reference_happens(self, event: ReferenceEvent) -> None:
        """Go on to the state of the reference that the table says, and put it into force."""
        was_referenced = self.is_referenced
        after = REFERENCE_AFTER[self.plan.referenced].get(event, {})
        self.reference = after.get(self.reference, self.reference)
        self._follow_reference(was_referenced=was_referenced)

    def _follow_reference(self, *, was_referenced: bool) -> None:
        """Put into force what the reference is now."""
        is_referenced = self.is_referenced
        if is_referenced is was_referenced:
            return
        if self.fixed is not None:
            self._put_off(self.fixed._replace(was_lost=self.fixed.was_lost or not is_referenced))
            return
        self._take_reference(is_referenced=is_referenced)

    def _take_reference(self, *, is_referenced: bool) -> None:
        """Let positions mean something from now on, or nothing."""
        retained = self.retained_target
        if self.compensation.is_stream:
            self.displace(keeps_branch=True)  # a stream keeps its offset
        elif retained is None:
            self.displace()
        else:
            self._retain_target(retained)
            self.is_moving = False
        self.doubt_words()
        if is_referenced:
            self.actual = None  # it may have been counted from another zero
            self.compensation.find_reference(self.wanted)
        else:
            self.compensation.lose_reference()

    def _retain_target(self, retained: Retained) -> None:
        """Let the last target mean nothing, and its repeat move nothing."""
        self.happens(Happening.REFERENCE_CHANGED)
        self.retained = retained

    def see_homed_bit(self, now_ns: int, *, is_set: bool) -> None:
        """Take note of the drive's homed bit, where it decides."""
        if is_set and self.reference in HOMING and now_ns - self.homing_since_ns < HOMING_SETTLE_NS:
            return  # it may be that of the homing before
        self.reference_seen_ns = now_ns
        self._reference_happens(ReferenceEvent.BIT_SET if is_set else ReferenceEvent.BIT_CLEAR)

    def _see_end_of_homing(self, now_ns: int, *, is_set: bool) -> None:
        """Take note of the bit that ends a homing command."""
        if self.plan.referenced is not Reference.HOMING or self.reference is not Referenced.HOMING:
            return
        if not is_set:
            self.homing_since_ns = now_ns - HOMING_SETTLE_NS
        elif now_ns - self.homing_since_ns >= HOMING_SETTLE_NS:
            self._reference_happens(ReferenceEvent.BIT_SET)

    def lose_reference(self) -> None:
        """The drive may have lost its position."""
        self._reference_happens(ReferenceEvent.LOSS)

    def declare_referenced(self) -> None:
        """A person says that the axis stands where its drive says.

        The drive counts from the same zero: a target that it was given since the last loss keeps its
        words, also on its way.
        """
        members = [each for each in (self, *self.peers) if each.compensation.accepted is not None]
        self._reference_happens(ReferenceEvent.DECLARED)
        if self.beam is not None:
            self.follow_group()
        for member in members:
            if member.retained is not None:
                member.retained = member.retained._replace(over=KeptOver.DECLARATION)

    def follow_group(self) -> None:
        """Compensate the axes of its group only while every one of them knows where it is (M11)."""
        members = (self, *self.peers)
        is_whole = all(member.is_found for member in members)
        for member in members:
            member.wait_for_peers(waits=not is_whole)

    def wait_for_peers(self, *, waits: bool) -> None:
        """Another axis of the group does not know where it is, or all of them do."""
        was_referenced = self.is_referenced
        self.waits_for_peers = waits
        self._follow_reference(was_referenced=was_referenced)

    def join(self, peers: "tuple[Axis, ...]", beam: Beam) -> None:
        """Be one of a group from now on."""
        self.peers, self.beam = peers, beam
        self.follow_group()

    # --- what the first trigger of its group fixes (M11) -----------------------------------------------

    def settle_group(self, now_ns: int) -> None:
        """Bring its group up to date: one reference for all, and no decision of before that has ended."""
        if self.beam is None:
            return
        self.follow_group()
        if self.beam.is_over(now_ns):
            self._group_happens(BeamEvent.EXPIRED)
        elif self.beam.is_under_way and self._is_group_through(now_ns):
            self._group_happens(BeamEvent.WHOLE)

    def begin_group_anew(self) -> None:
        """It has gone, and is given another target before the others of its group went: a new round."""
        self._group_happens(BeamEvent.AGAIN)

    def is_joined(self, first: int, count: int, now_ns: int) -> bool:
        """Whether words of a target, from its word ``first`` on, belong to that with which it went."""
        fixed = self.fixed
        if fixed is None or now_ns - fixed.part_ns > JOIN_NS:
            return False
        words = (1 << count) - 1 << first
        return fixed.missing & words == words

    def _group_happens(self, event: BeamEvent) -> None:
        """Go on to the state that the table says; with ``OPEN`` what was put off comes into force."""
        assert self.beam is not None
        if self.beam.happens(event):
            for member in (self, *self.peers):
                member.release()

    def fix(self, run: Rendering | None, *, keeps_words: bool) -> None:
        """Its group goes: reference and correction are what they are now, until nothing is fixed any more."""
        accepted, actual = self.compensation.accepted, self.actual
        nominal_counts = None if accepted is None else accepted.nominal_counts
        if nominal_counts is None and actual is not None:
            nominal_counts = self.nominal_of(actual.counts)
        self.fixed = Fixed(self.goes_as_referenced, self.whereabouts, nominal_counts, run, keeps_words)

    def release(self) -> None:
        """What was put off comes into force: as ever, with the next different target."""
        fixed, self.fixed = self.fixed, None
        if fixed is None:
            return
        if fixed.has_other_correction:
            self._choose_correction()
        if fixed.is_referenced and (fixed.was_lost or not self.is_referenced):
            self._take_reference(is_referenced=False)
        if self.is_referenced and (fixed.was_lost or not fixed.is_referenced):
            self._take_reference(is_referenced=True)
        self._want()

    def _put_off(self, fixed: Fixed) -> None:
        """Note what has to wait until nothing is fixed any more."""
        assert self.beam is not None
        self.fixed = fixed
        self.beam.put_off()

    def _leave_in_group(self, request: AxisRequest, now_ns: int) -> None:
        """A request leaves to an axis of a group: it fixes what all go by, or goes by that, or ends it."""
        beam, command = self.beam, request.command
        if beam is None:
            return
        if command is not None and command.action in MOVES_OTHERWISE:
            self._group_happens(BeamEvent.ENDED)
        elif request.targets or request.runs or (command is not None and command.action.runs_target):
            is_first = beam.is_open
            if is_first:
                beam.fix(self.plan.name, now_ns)
                keeps_words = self._keeps_other_words(request)
                for member in (self, *self.peers):
                    run = None if member is self else request.peer_runs.get(member.plan.name)
                    member.fix(run, keeps_words=keeps_words)
            elif not self._keeps_other_words(request):
                self._keep_no_other_words()
            if not is_first and beam.has_put_off and self.fixed is not None and not self.fixed.has_gone:
                detail = f"it goes as {beam.led_by} has gone; what was asked for since comes into force then"
                self.tell(EventKind.GROUP_HELD, detail)
            self._group_happens(BeamEvent.LEFT)

    def _keep_no_other_words(self) -> None:
        """One goes by what was fixed, so no other one of its group keeps words of another switch any more."""
        for member in (self, *self.peers):
            if member.fixed is not None and member.fixed.keeps_words:
                member.fixed = member.fixed._replace(keeps_words=False)

    def _end_in_group(self, request: AxisRequest, outcome: Outcome, code: int, now_ns: int) -> None:
        """A request to an axis of a group has ended: it has gone, was refused, or was given a target."""
        command, fixed = request.command, self.fixed
        if fixed is None:
            return
        if request.targets or request.runs or (command is not None and command.action.runs_target):
            if outcome is Outcome.ACKNOWLEDGED or outcome is Outcome.BROADCAST:
                missing = self._missing_words(request, fixed, now_ns)
                self.fixed = fixed._replace(has_gone=True, missing=missing, part_ns=now_ns if missing else 0)
                is_whole = self._is_group_through(now_ns)
                self._group_happens(BeamEvent.WHOLE if is_whole else BeamEvent.WENT)
            else:
                is_refusal = outcome is Outcome.EXCEPTION
                is_undone = is_refusal and self.writes_nothing(code, reads_too=request.reads_too)
                if not is_undone and not any(fixed.has_gone for fixed in self._all_fixed()):
                    self.fixed = fixed._replace(may_have_gone=True)
                    self._tell_unproven_first(code)
                else:
                    self._note_skew(code)
                self._group_happens(BeamEvent.REFUSED if is_undone else BeamEvent.UNPROVEN)
        elif command is not None and outcome is Outcome.ACKNOWLEDGED:
            is_distance = self.last_run.is_relative
            if fixed.has_gone:
                is_other = any(is_distance or not self._holds_target(number) for number in command.written)
            else:
                is_other = fixed.may_have_gone
                is_other = is_other and any(not self._holds_unproven(number) for number in command.written)
            if is_other:
                self._group_happens(BeamEvent.AGAIN)

    def _all_fixed(self) -> list[Fixed]:
        """What is fixed of the axes of its group."""
        return [member.fixed for member in (self, *self.peers) if member.fixed is not None]

    def _holds_unproven(self, number: int) -> bool:
        """Whether a command field holds the target to which it may have gone, or not all of one."""
        image = self.fields[number]
        if image.nominal_words is None or image.is_torn:
            return True  # the rest of it is to come
        return self.may_have_gone_to(number, image.nominal_words)

    def may_have_gone_to(self, number: int, nominal_words: bytes) -> bool:
        """Whether some words are the absolute target that was sent last and never acknowledged."""
        unproven, field = self.unproven, self.plan.command[number]
        if unproven is None or unproven.move is None or unproven.is_distance:
            return False
        return counts_of(field, field.unpack(nominal_words)) == unproven.move.nominal_counts

    # --- which words may stay as they are (M4, M11) ------------------------------------------------------

    def may_keep_words(self, spec: CorrectionSpec) -> bool:
        """Whether a target that comes again may be the same words, which were made with ``spec``.

        With what is asked for now they are right in any case. Of a group one axis must not keep words of
        another switch, table or gain while another axis goes by what is asked for. Setpoints of a stream may:
        what is asked for comes into force with way that they go, and the same one again has none.
        """
        if self.beam is None or self.compensation.is_stream or not self._is_other(spec):
            return True
        if self.fixed is not None:
            return self.fixed.keeps_words
        is_again = self.unproven is None  # else the others have to come there yet
        return all(peer.keeps_other_words and (is_again or peer.holds_unrun) for peer in self.peers)

    @property
    def keeps_other_words(self) -> bool:
        """Whether the next target of it, as far as it is known, keeps words of another switch, table or gain.

        Of a target that has not come nobody knows: then it is taken for the last one, come again.
        """
        number = self.rules.staged
        words = None if number is None else self.fields[number].nominal_words
        if self.holds_unrun and number is not None and words is not None:
            spec = self.spec_of_words(number, words)
            return spec is not None and self._is_other(spec)
        if self.unproven is not None and self.unproven.move is not None:
            return self._is_other(self.unproven.move.state.spec)
        if self.retained is not None:
            return self._is_other(self.retained.move.state.spec)
        state = self.compensation.state
        return state.position is None or self._is_other(state.spec)

    def spec_of_words(self, number: int, nominal_words: bytes) -> CorrectionSpec | None:
        """With which correction the words were made that a target may keep; None: it is a new one."""
        if self.may_have_gone_to(number, nominal_words):
            assert self.unproven is not None
            assert self.unproven.move is not None
            return self.unproven.move.state.spec
        retained, accepted = self.retained_as(number, nominal_words), self.compensation.accepted
        if retained is not None:
            return retained.move.state.spec
        field = self.plan.command[number]
        if accepted is None or counts_of(field, field.unpack(nominal_words)) != accepted.nominal_counts:
            return None
        return self.compensation.state.spec

    def _is_other(self, spec: CorrectionSpec) -> bool:
        """Whether a correction is that of another switch, table or gain than what counts for it now."""
        asked = self.wanted if self.goes_as_referenced else NOTHING
        if spec.curve is None or asked.curve is None:
            return spec.curve is not asked.curve
        is_same_table = spec.curve is asked.curve or spec.table_digest == asked.table_digest
        return not (is_same_table and spec.gain == asked.gain)

    def _keeps_other_words(self, request: AxisRequest) -> bool:
        """Whether the first target of its group keeps words of another switch, table or gain."""
        for rendering in (*request.targets, *request.runs):
            if not rendering.is_distance:
                spec = self.spec_of_words(rendering.number, rendering.nominal_words)
                if spec is not None and self._is_other(spec):
                    return rendering.move is None or rendering.move.state.spec is spec
        return False

    def _missing_words(self, request: AxisRequest, fixed: Fixed, now_ns: int) -> int:
        """Return which words of a target have not come yet, of a drive that goes to each part of one."""
        missing = 0
        for part in request.parts:
            if part.first >= 0:
                count = len(part.words) // 2
                is_joined = self.is_joined(part.first, count, now_ns)
                all_words = (1 << max(field.words for field in self.plan.command)) - 1
                missing = (fixed.missing if is_joined else all_words) & ~((1 << count) - 1 << part.first)
        return missing

    def _is_group_through(self, now_ns: int) -> bool:
        """Whether each axis of its group has gone, and no word of its target is to come."""
        for member in (self, *self.peers):
            fixed = member.fixed
            if fixed is None or not fixed.has_gone:
                return False
            if fixed.missing and now_ns - fixed.part_ns <= JOIN_NS:
                return False
        return True

    def _tell_unproven_first(self, code: int) -> None:
        """It is the first of its group, and nobody knows whether it goes."""
        assert self.beam is not None
        self.beam.skew_by(None)
        detail = (
            f"its trigger was sent, and the drive may have obeyed it (exception {code:#04x}): the skew is "
            "not known"
        )
        self.tell(EventKind.GROUP_SKEWED, detail)

    def _note_skew(self, code: int) -> None:
        """It is refused after another axis of its group has gone: nothing of ours stops that one (M3)."""
        beam, fixed = self.beam, self.fixed
        if beam is None or not beam.is_under_way or fixed is None or fixed.has_gone:
            return
        skew: float | None = 0.0
        gone = [member for member in self.peers if member.fixed is not None and member.fixed.has_gone]
        for member in gone:
            way = member.way_in_group
            if way is None or skew is None:
                skew = None
            elif abs(way) > abs(skew):
                skew = way
        if skew == 0.0:
            return  # nothing has moved
        beam.skew_by(skew)
        names, units = " and ".join(member.plan.name for member in gone), self.plan.settings.units.value
        by = "by a way that nobody knows" if skew is None else f"by {skew:+.6g} {units}"
        detail = f"{names} has gone, and its own target was refused (exception {code:#04x}): skewed {by}"
        self.tell(EventKind.GROUP_SKEWED, detail)

    @property
    def way_in_group(self) -> float | None:
        """How far it was sent since its group began to go, in units; None: nobody knows."""
        fixed, accepted = self.fixed, self.compensation.accepted
        if fixed is None or fixed.nominal_counts is None or accepted is None:
            return None
        return (accepted.nominal_counts - fixed.nominal_counts) / self.plan.settings.counts_per_unit

    @property
    def blocked_by(self) -> int | None:
        """Exception code with which its triggers are refused, for a lost target of its own or its group's."""
        return self.block_code if self.block is not Block.NONE else self.blocked_by_peer

    @property
    def blocked_by_peer(self) -> int | None:
        """Exception code of a target that another axis of the group lost for its own sake (M11)."""
        for axis in self.peers:
            if axis.block is Block.OWN:
                return axis.block_code
        return None

    # --- what correction is wanted ---------------------------------------------------------------------

    def _want(self) -> None:
        """Ask for what its table says, where its positions mean something and nothing else is fixed."""
        if self.is_referenced and self.fixed is None:
            self.compensation.want(self.wanted)

    def _choose_correction(self) -> None:
        if self.fixed is not None:
            self._put_off(self.fixed._replace(has_other_correction=True))
            return
        self.base = NOTHING
        self.has_branches = False
        if self.switched is Switched.ON and self.plan.table is not None:
            table = self.plan.table
            self.base = spec_of_table(table, self.plan.settings, digest=table_digest(table))
            curve = self.base.curve
            one_way = curve is not None and curve.table.is_unidirectional and self.base.gain.is_even
            self.has_branches = not one_way
        self.wanted = self.base if self.terms is None else self.terms.on(self.base, self.plan)

    def enable(self, *, is_wanted: bool) -> None:
        """Apply the table, or stop to: with the next different target, never by itself."""
        if self.switched is not Switched.ENDED:
            self.switched = Switched.ON if is_wanted else Switched.OFF
        self._choose_correction()
        self._want()

    @property
    def why_not_at_rest(self) -> str:
        """Why nobody can say that it stands at its last target, "" where it does, or was told none yet.

        In a dry run the drive stands at the target as it was commanded. Where no register tells where it is,
        nobody ever can: then the last word of its drive has to do.
        """
        compensation, accepted = self.compensation, self.compensation.accepted
        if self.unproven is not None:
            return "a target of it is not acknowledged"
        if self.is_moving:
            return "it moves"
        if accepted is None:
            is_untold = self.last_number is None and self.whereabouts is Whereabouts.UNKNOWN
            return "" if is_untold else "nobody knows where it stands"
        if self.whereabouts in WAS_THERE and self.whereabouts is not Whereabouts.MAY_HAVE_LEFT:
            return ""
        if not self.plan.actual:
            return ""
        actual = self.actual
        if actual is None or not compensation.is_seen:
            return "nobody has seen it at its target"
        away_counts = abs(actual.counts - accepted.nominal_counts)
        return "" if away_counts <= self.plan.settings.in_position_counts else "it is not at its target yet"

    def end_dry_run(self) -> None:
        """Apply what was only shown until now, from the next different target on; it stands."""
        self.plan = replace(self.plan, compensation=CompensationMode.ON)
        self.is_dry_run = False
        self._choose_correction()
        self.compensation.end_dry_run()
        if self.plan.actual:
            self.happens(Happening.THERE)  # else it could not end; so whoever is seen away has been moved
        self._want()

    def adopt(self, plan: AxisPlan) -> None:
        """Go on with another table or gain; comes into force as in :meth:`enable`."""
        self.plan = plan
        self._choose_correction()
        self._want()

    def limit(self, plan: AxisPlan, settings: AxisSettings) -> None:
        """Go on with other limits, from now on."""
        self.plan = plan
        self.compensation.take_limits(settings)

    def end(self) -> None:
        """End the compensation until the gateway is started again: its registers mean something else now."""
        if self.switched is Switched.ENDED:
            return
        self.tell(EventKind.COMPENSATION_ENDED, REMAPPED)
        if self.beam is not None:
            self._group_happens(BeamEvent.ENDED)
        self.switched = Switched.ENDED
        self._choose_correction()
        self.forget()
        self.compensation.begin_anew()

    def follow_terms(self, now_ns: int) -> None:
        """Look what its terms ought to be; another line comes into force with different targets."""
        terms = self.terms
        assert terms is not None
        if terms.follow(self.base, self.plan, now_ns):
            self.wanted = terms.on(self.base, self.plan)
            self._want()
        self.tell_terms(now_ns)

    def tell_terms(self, now_ns: int) -> None:
        """Report what is new about how well its terms are known."""
        if self.terms is not None:
            self.events += self.terms.events(self.plan.name, now_ns)

    def _begin_stream_anew(self) -> None:
        """The drive counts from another zero: setpoints begin again from where it is."""
        if self.compensation.is_stream:
            self.compensation.begin_anew()
            if self.is_referenced:
                self.compensation.find_reference(self.wanted)

    def begin_stream(self, number: int, nominal_words: bytes, fresh: Actual | None, now_ns: int) -> None:
        """Let the offset that the drive has be in force before the first setpoint of a stream (M6).

        Read for this setpoint; where the gateway may not read, seen in passing a moment ago.
        """
        actual = fresh
        if actual is None and self.asked_actual is None and self.actual is not None:
            is_recent = now_ns - self.actual.seen_ns <= SEEN_LATELY_NS
            actual = self.actual if is_recent else None
        field_ = self.plan.command[number]
        raw = field_.unpack(nominal_words)
        if actual is None or not isfinite(raw):
            return
        settings = self.plan.settings
        fields = (field_, self.plan.actual[0])
        slack = sum(0.5 * each.step_counts(settings.largest_counts) for each in fields)
        slack /= abs(settings.counts_per_unit)
        position = self.compensation.machine_position(actual.counts)
        slack += 0.0 if self.terms is None else self.terms.largest_at(position)
        rest = self.compensation.assume_offset(actual.counts, counts_of(field_, raw), self.base, slack)
        self.began = (self.compensation.state.spec.offset, rest)

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

    # --- silence ---------------------------------------------------------------------------------------

    def fall_silent(self, since_ns: int, now_ns: int) -> None:
        """The drive left a request unanswered, and may have lost its reference.

        ``since_ns``: when the first one was sent that it has not answered.
        """
        if self.silent_since_ns is None:
            self.silent_since_ns = since_ns
        self.silent_until_ns = now_ns
        if not self.follows_homed_bit:
            return
        if self.may_read:
            self._reference_happens(ReferenceEvent.SILENCE)
        else:
            self.see_homed_bit(now_ns, is_set=False)

    def end_silence(self, *, is_answer: bool, until_ns: int | None = None) -> None:
        """Look at how long the drive has been silent: it may have been switched off meanwhile.

        ``until_ns``: so long at least, where that is known.
        """
        if until_ns is not None:
            self.silent_until_ns = until_ns
        since_ns = self.silent_since_ns
        if since_ns is None:
            return
        if is_answer:
            self.silent_since_ns = None
        if self.silent_until_ns - since_ns <= self.plan.lost_ms * NS_PER_MS:
            return
        unproven, pending = self.unproven, self.pending
        retained = self.retained
        is_closed = retained is not None and retained.over is KeptOver.ORDERLY_CLOSE
        self._lose_reach(was_closed=is_closed)
        if unproven is not None:  # it may have arrived before the drive fell silent
            self.happens(Happening.UNACKNOWLEDGED)
            self.unproven, self.pending = unproven, pending
        self._send_off(self.silent_until_ns)
        self.lose_reference()

    def lose_link(self, now_ns: int, *, was_closed: bool = False) -> None:
        """Forget what may have changed while nobody looked; ``was_closed``: see :meth:`_lose_reach`."""
        if self.record is not None:
            self.record.pause()
        self._lose_reach(was_closed=was_closed)
        self.actual = None
        self.hear_place(Told.LINK_LOST)
        self.fall_silent(now_ns, now_ns)

    def hear_place(self, told: Told) -> None:
        """Take note of what its drive answers when the gateway asks it where the axis is."""
        self.sight = SIGHT_AFTER[self.sight, told]
        self.asked_actual = None if self.is_out_of_sight else self.asked(self.plan.actual)

    # --- a target on its way ---------------------------------------------------------------------------

    def send_target(self, rendering: Rendering) -> None:
        """A target goes out next: when the process dies now, the drive may hold it or not."""
        record = self.record
        if record is None:
            return
        if record.recalled is not None:
            self.drop_record("a target came before the axis was read")
        if rendering.move is None and not rendering.is_distance:
            return  # a repeat changes nothing
        if rendering.move is None or self.pending is not None or self.whereabouts not in ON_BRANCH:
            self.send_motion()
            return
        self.on_wire = OnWire.TARGET
        self.pending = rendering
        record.keep(self)

    def send_steady(self, target: SteadyTarget) -> bool:
        """The same of a target on the fast path; whether it was kept without being rendered.

        It is rendered when it ends in another way than it usually does (:meth:`name_pending`).
        """
        record, steady = self.record, target.steady
        if record is None or steady is None:
            return True  # a repeat changes nothing
        if self.pending is not None or not record.keep_step(self, steady, target.corrected_counts):
            return False
        self.on_wire = OnWire.TARGET
        return True

    def name_pending(self, rendering: Rendering) -> None:
        """Name the target that is on the wire, where it was not rendered before."""
        if self.on_wire is OnWire.TARGET and self.pending is None:
            self.pending = rendering

    def send_motion(self) -> None:
        """Something goes out that moves the axis in a way that its record does not say."""
        record = self.record
        if record is None:
            return
        if record.recalled is not None:
            self.drop_record("the axis was moved before it was read")
        self.on_wire = OnWire.MOTION
        self.pending = None
        record.keep(self)

    def conclude(self) -> None:
        """What was sent has been answered, or never will be."""
        self.on_wire = _NOTHING
        if self.unproven is not self.pending:
            self.pending = None

    def acknowledge(self, rendering: Rendering, now_ns: int = 0, epoch: int | None = None) -> None:
        """The drive acknowledged a target with its full native success, and goes there (M7).

        ``epoch``: of its field, when the target was sent.
        """
        self.fields[rendering.number].settle(rendering.nominal_words, rendering.corrected_words, epoch)
        self.heard_ns = now_ns
        if rendering.move is None:
            self.compensation.touch(now_ns)
        else:
            self.go(rendering, rendering.move, now_ns)

    def acknowledge_steady(self, number: int, target: SteadyTarget, now_ns: int) -> None:
        """The same of a target on the fast path: it goes on in its direction, or is a repeat."""
        self.fields[number].settle(target.nominal_words, target.corrected_words, target.epoch)
        self.heard_ns = now_ns
        compensation, steady = self.compensation, target.steady
        if steady is None:
            compensation.touch(now_ns)
            return
        was_seen = compensation.is_seen
        compensation.go_on(steady, target.corrected_counts, is_reached=self.whereabouts is _ARRIVED)
        self._set_out(number, now_ns, was_seen=was_seen)

    def go(self, rendering: Rendering, move: Move, now_ns: int) -> None:
        """The axis goes to a target, or has gone there, whatever its registers hold by now."""
        compensation, place = self.compensation, self.whereabouts
        if (
            not compensation.is_stream
            and compensation.state.travel.direction is not move.state.travel.direction
        ):
            self._note_branch_change(now_ns)
        target = (move.nominal_counts, rendering.corrected_counts)
        is_same_way = place is _SET_OUT and compensation.accepted == target
        was_seen = compensation.is_seen
        compensation.commit(move, rendering.corrected_counts, is_reached=place is _ARRIVED)
        self._set_out(rendering.number, now_ns, was_seen=was_seen, is_same_way=is_same_way)

    def _set_out(self, number: int, now_ns: int, *, was_seen: bool, is_same_way: bool = False) -> None:
        """It is on its way to the target of a field, from where it was known to stand, or not."""
        place = self.whereabouts
        self.last_number = number
        if place is not _UNDER_WAY and not is_same_way:
            is_at_rest = place is _ARRIVED or place is _STOPPED or (was_seen and place in WAS_THERE)
            self.happens(Happening.ACKNOWLEDGED_AT_REST if is_at_rest else Happening.ACKNOWLEDGED)
        if not self.compensation.is_stream or place in AT_REST:
            self._send_off(now_ns)
        self.is_moving = False

    def _note_branch_change(self, now_ns: int) -> None:
        if self.has_branches and self.hunting.note_change(now_ns):
            detail = f"its branch changed more than {MOST} times in 10 s"
            self.tell(EventKind.BRANCH_HUNTS, detail)

    def leave_unproven(self, rendering: Rendering, now_ns: int) -> None:
        """A target was sent and not acknowledged: the drive may hold it or not.

        Of a repeat it holds the same words in either case.
        """
        is_repeat = rendering.move is None and not rendering.is_distance
        if is_repeat and (self.compensation.accepted is not None or self.whereabouts in RETAINING):
            return
        image = self.fields[rendering.number]
        if image.corrected_words == rendering.corrected_words:
            rendering = self._marked(rendering, rendering._replace(stood_there=True))
        self.leave_run_unproven(rendering, now_ns)
        image.leave(rendering.nominal_words, rendering.corrected_words)
        image.forget()

    def leave_run_unproven(self, rendering: Rendering, now_ns: int) -> None:
        """A trigger was not acknowledged: the drive holds its target, and may be going there or not."""
        retained = self.retained_as(rendering.number, rendering.nominal_words)
        is_same = retained is not None and retained.corrected_words == rendering.corrected_words
        if is_same and not rendering.is_distance:
            self._send_off(now_ns)  # its repeat is the same words all the same
            return
        unproven, before = self.unproven, self.unproven or self.compensation.accepted
        self.displace(now_ns)
        if rendering.move is None:
            return
        self.happens(Happening.UNACKNOWLEDGED)
        if before is not None:  # who is seen near both went to either
            distance_counts = abs(rendering.corrected_counts - before.corrected_counts)
            is_beside = 0.0 < distance_counts <= 2.0 * self.plan.settings.hysteresis_counts
            if unproven is not None and not distance_counts:  # the same once more
                is_beside = unproven.is_beside_another
            rendering = self._marked(rendering, rendering._replace(is_beside_another=is_beside))
        self.unproven = rendering

    def _marked(self, rendering: Rendering, marked: Rendering) -> Rendering:
        """Return a target of which more is known now; its record goes on to name it."""
        self.pending = marked if self.pending is rendering else self.pending
        return marked

    def _run_not(self, start: Accepted) -> None:
        """A distance that was not acknowledged did not run: the axis stands where it would have started."""
        was_at_rest = self.whereabouts is Whereabouts.UNPROVEN_AT_REST
        self.happens(Happening.RAN_NOT)
        self.compensation.accept_again(start)
        if was_at_rest:
            self.happens(Happening.DONE if self.plan.actual else Happening.DONE_ALONE)

    # --- a request -------------------------------------------------------------------------------------

    def send(self, request: AxisRequest, now_ns: int) -> bool:
        """A request goes out next: keep what must be known if nobody lives to see the reply.

        Returns:
            Whether it means something that the register map does not know.
        """
        self._leave_in_group(request, now_ns)
        for rendering in (*request.targets, *request.runs):
            self.send_target(rendering)
        command = request.command
        if command is not None:
            runs_unknown = command.runs_alone and not request.runs
            if (
                command.is_stop
            ):  # who is found on its way counts as stopped in any case (``may_have_stopped``)
                is_untold = command.sets_position_too or self.pending is not None
            else:
                is_untold = command.action in MOVES_OTHERWISE or command.is_doubtful or runs_unknown
            if is_untold:
                self.send_motion()
        if request.blind or request.goes_unknown or request.remaps:
            self.send_motion()
        is_unknown = command is not None and command.action is Action.UNKNOWN and not self.passes_unchanged
        if command is not None and is_unknown:
            self._tell_unknown(command)
        return is_unknown

    def finish(self, request: AxisRequest, outcome: Outcome, code: int, now_ns: int) -> None:
        """Take note of how a request ended that went out, and of which exception it ended with."""
        if outcome is Outcome.ACKNOWLEDGED:
            self._obeyed(request, now_ns)
        else:
            self._not_obeyed(request, outcome, code, now_ns)
        self.conclude()
        self._end_in_group(request, outcome, code, now_ns)
        if request.remaps:
            for axis in (self, *self.peers):
                axis.end()

    def _obeyed(self, request: AxisRequest, now_ns: int) -> None:
        """The drive acknowledged a request in full (M7)."""
        for image, nominal_words, corrected_words, epoch, written in request.stagings:
            image.settle(nominal_words, corrected_words, epoch, written)
        for part in request.buffered_parts:
            part.image.buffer(part.first, part.words, request.arrived_ns, request.follows_ns)
        for rendering in (*request.targets, *request.runs):
            self.acknowledge(rendering, now_ns, request.epochs.get(rendering.number))
            self.tell_beginning()
        self._write_blindly(request, now_ns)
        if request.goes_unknown:
            self._go_unknown(request, now_ns)
        command = request.command
        if command is None:
            return
        rules, action = self.rules, command.action
        rules.note_words(dict(command.words), command.epoch)
        rules.note_coils(dict(command.coils))
        rules.doubt(dict.fromkeys(command.unclear_words, 0), {})
        for number in command.written:
            rules.stage(number)
        if command.written or action.runs_target:
            self.holds_unrun = not action.runs_target
        if action.runs_target:
            self._reference_happens(ReferenceEvent.OTHER_MOTION)
            self.last_run = action
            mode = None if command.number is None else rules.plan.mode(command.number)
            if mode is not None and mode.resets_to is not None:
                rules.note_words({mode.address: mode.resets_to}, command.epoch)
        if action in MOVES_OTHERWISE:
            self._move_otherwise(action, now_ns, is_certain=True)
            if command.runs_stored and not self.passes_unchanged:
                self.compensation.doubt()  # with words that nobody corrected for it
            if command.sets_position_too:
                self._move_otherwise(Action.SET_POSITION, now_ns, is_certain=True)
        elif command.is_doubtful:
            self.displace(now_ns, keeps_branch=True)  # the reading counts on it already
        is_whole = not any(self.fields[number].is_torn for number in command.written)
        if command.written and is_whole:
            self._release(command.epoch)
        if command.runs_alone and not request.is_run_known and not self._runs_retained(request):
            self.displace(now_ns)

    def _runs_retained(self, request: AxisRequest) -> bool:
        """Whether a request runs the target of before a loss as it was: its axis stays where it is."""
        retained = self.retained
        if retained is None:
            return False
        words = (retained.nominal_words, retained.corrected_words)
        return any((run.nominal_words, run.corrected_words) == words for run in request.runs)

    def _not_obeyed(self, request: AxisRequest, outcome: Outcome, code: int, now_ns: int) -> None:
        """A request went out and was not acknowledged; what a refusal proves, the register map says (M7)."""
        is_broadcast = outcome is Outcome.BROADCAST
        is_refusal = outcome is Outcome.EXCEPTION
        is_undone = is_refusal and self.writes_nothing(code, reads_too=request.reads_too)
        if not is_undone:
            for rendering in request.targets:
                self.leave_unproven(rendering, now_ns)
            for rendering in request.runs:
                self.leave_run_unproven(rendering, now_ns)
            for part in request.buffered_parts:
                part.image.doubt()
            for staging in request.stagings:
                staging.image.leave(staging.nominal_words, staging.corrected_words)
                staging.image.forget()
        if not is_broadcast:
            loss = Loss.REFUSED_UNWRITTEN if is_undone else Loss.REFUSED
            self._lose(request.parts, loss, request.arrived_ns, request.follows_ns, now_ns)
        self._write_blindly(request, now_ns)
        if request.goes_unknown and not is_undone:
            self._go_unknown(request, now_ns)
        command = request.command
        if command is None:
            return
        if not is_undone:
            unclear = dict.fromkeys(command.unclear_words, 0)
            self.rules.doubt({**command.words, **unclear}, dict(command.coils))
            if command.action in MOVES_OTHERWISE:
                self._move_otherwise(command.action, now_ns, is_certain=False)
                if command.runs_stored and not self.passes_unchanged:
                    self.compensation.doubt()
                if command.sets_position_too:
                    self._move_otherwise(Action.SET_POSITION, now_ns, is_certain=False)
            elif command.runs_alone and not request.is_run_known and not self._runs_retained(request):
                self.displace(now_ns)
        if not (is_broadcast or (self.passes_unchanged and is_refusal)):
            self._block_for(command, code)

    def _go_unknown(self, request: AxisRequest, now_ns: int) -> None:
        """Nobody knows where the axis goes; flag its branch where its words were not corrected for that."""
        self.displace(now_ns)
        if request.is_uncorrected and not self.passes_unchanged:
            self.compensation.doubt()

    def _write_blindly(self, request: AxisRequest, now_ns: int) -> None:
        """Nobody knows what command fields hold that were written, nor where the axis goes with them."""
        for image in request.blind:
            self.displace(now_ns)
            image.forget()
            if image.is_torn:  # words that were lost before are older than what has gone out by now
                image.tear(request.arrived_ns)

    def lose_request(
        self,
        parts: Sequence[Part],
        command: Command | None,
        code: int,
        loss: Loss,
        *,
        arrived_ns: int,
        follows_ns: int,
    ) -> None:
        """A request never reached the drive: what it wrote is lost, and torn from the rest (M3)."""
        self._lose(parts, loss, arrived_ns, follows_ns, arrived_ns)
        if command is not None:
            if command.action.runs_target:
                self._note_skew(code)
            self._block_for(command, code)

    @staticmethod
    def _lose(parts: Sequence[Part], loss: Loss, arrived_ns: int, follows_ns: int, now_ns: int) -> None:
        for image, first, words in parts:
            if first < 0:
                image.tear(arrived_ns)
            else:
                image.lose(loss, first, words, arrived_ns=arrived_ns, follows_ns=follows_ns, now_ns=now_ns)

    def _move_otherwise(self, action: Action, now_ns: int, *, is_certain: bool) -> None:
        """Something else than a target moves the axis, or stops it, or moves its zero."""
        is_at_rest = not self.is_moving
        moved_ns = None if action in (Action.STOP, Action.SET_POSITION) else now_ns
        self.displace(moved_ns, keeps_branch=action is Action.STOP)
        if action in (Action.HOME, Action.SET_POSITION):
            self.doubt_words()
            self.actual = None  # it was counted from another zero
            self._begin_stream_anew()
        if action is Action.HOME:
            self.homing_since_ns = now_ns
            self._reference_happens(ReferenceEvent.HOMING)
            if not is_certain:
                self._reference_happens(ReferenceEvent.OTHER_MOTION)
        elif action is Action.SET_POSITION:
            is_set_at_rest = is_at_rest and is_certain
            self._reference_happens(
                ReferenceEvent.SET_AT_REST if is_set_at_rest else ReferenceEvent.SET_MOVING
            )
        else:
            self._reference_happens(ReferenceEvent.OTHER_MOTION)

    # --- triggers that are refused ---------------------------------------------------------------------

    def _block_for(self, command: Command, code: int) -> None:
        """A target, its mode or a part of it was lost: its triggers are refused from now on (M3)."""
        # The others of a beam must not go alone (M11); a run refused for their sake holds nobody up.
        is_run_of_beam = bool(self.peers) and command.action.runs_target and self.blocked_by_peer is None
        may_stand = self.plan.motion.waits_for_trigger or bool(self.peers)
        if not may_stand or not (command.written or command.writes_mode or is_run_of_beam):
            return
        for address in command.modes_written:
            self.lose_mode(address, code)
        if command.written or is_run_of_beam:
            why = (
                f"a target or its mode was lost (exception {code:#04x}): triggers are refused until a "
                "complete one was accepted; stops always pass"
            )
            # Of what only stages, the loss is its own: a peer that is released must not go without it.
            is_own = self.blocked_by_peer is None or not command.action.runs_target
            self.block_triggers(code, why, is_own=is_own)

    def lose_mode(self, address: int, code: int) -> None:
        """The writing of a mode register was lost."""
        self.epoch += 1
        self.rules.lose_mode(address, code, self.epoch)

    def block_triggers(self, code: int, why: str, *, is_own: bool = True) -> None:
        """Refuse triggers from now on, and say why if they were not refused before.

        ``is_own``: for its own sake, not because another axis of the group was blocked (M11).
        """
        self.epoch += 1
        self.blocked_in_epoch = self.epoch
        if self.block is Block.NONE:
            self.block_code = code
            self.tell(EventKind.AXIS_BLOCKED, why)
        self._block_happens(BlockEvent.LOST if is_own else BlockEvent.LOST_OF_GROUP)

    def _block_happens(self, event: BlockEvent) -> None:
        """Go on to the block that the table says."""
        self.block = BLOCK_AFTER.get((self.block, event), self.block)

    def _release(self, epoch: int) -> None:
        """A complete target was accepted; ``epoch``: when it was sent."""
        if epoch < self.blocked_in_epoch or self.block is Block.NONE:
            return
        self._block_happens(BlockEvent.COMPLETED)
        self.tell(EventKind.AXIS_RELEASED, "a complete target was accepted: its triggers pass again")

    def _tell_unknown(self, command: Command) -> None:
        """Report a frame that means something the register map does not know: once for the same contents."""
        words = dict(command.words)
        mode = None if command.number is None else self.rules.plan.mode(command.number)
        word = None if mode is None else self.rules.word(mode.address)
        if mode is not None and word is not None:
            words.setdefault(mode.address, word)
        contents = tuple(sorted(words.items()))
        if self.told_unknown == contents:
            return
        self.told_unknown = contents
        shown = ", ".join(f"{address:#06x} = {word:#06x}" for address, word in contents)
        what = f"the register map does not know {shown}" if shown else "nobody can tell what a frame means"
        self.tell(EventKind.UNKNOWN_MODE, f"{what}: it passed untouched")

    # --- a staged target that is written once more -----------------------------------------------------

    def restage(self, rendering: Rendering, first: int, words: bytes, epoch: int) -> None:
        """The drive acknowledged words of a staged target, from its word ``first`` on (M2)."""
        self.fields[rendering.number].restage(rendering.nominal_words, first, words, epoch)

    def tell_restaged(self, count: int, now_ns: int) -> None:
        """Report restaging now and then: where an axis goes to and fro, every second move needs it."""
        told_ns = self.told_restaged_ns
        if told_ns is None or now_ns - told_ns >= RESTAGED_EVERY_NS:
            self.told_restaged_ns = now_ns
            detail = f"a staged target was written anew for its trigger; {count} on this line since the start"
            self.tell(EventKind.RESTAGED, detail)

    def lose_restaged(self, rendering: Rendering, code: int, why: str) -> None:
        """A staged target that was written anew was not acknowledged."""
        image = self.fields[rendering.number]
        image.leave(rendering.nominal_words, rendering.corrected_words)
        image.doubt_restaged(rendering.corrected_words)
        image.tear()
        self.block_triggers(code, why)

    # --- another writer --------------------------------------------------------------------------------

    def take_over(self, former: str, code: int) -> None:
        """What the former writer wrote is no part of what the next one means, who writes all of it (M3)."""
        for image in self.fields:
            image.tear()
        if self.plan.motion.waits_for_trigger and self.rules.staged is not None:
            why = (
                f"it was taken over from {former}: triggers are refused until a complete target was accepted"
            )
            self.block_triggers(code, why)

    def forget_parts(self) -> None:
        """Let no part of a position be completed that came on a connection which broke off."""
        for image in (*self.fields, *self.limit_fields):
            image.forget_parts()

    def lose_everything(self, code: int) -> None:
        """More requests of a writer were lost than are remembered: all of its targets and modes are."""
        for image in self.fields:
            image.tear()
        for mode in self.plan.motion.modes:
            if mode is not None:
                self.lose_mode(mode.address, code)
        if self.plan.motion.waits_for_trigger:
            self.block_triggers(code, "more requests of its writer were lost than are remembered")

    def overwrite(self, numbers: list[int], writer: str, code: int) -> None:
        """A stop of somebody else changed targets: whoever moves the axis has to write them again."""
        for number in numbers:
            self.fields[number].tear()
        if not numbers:
            return
        self.hold.overwrite(writer)
        if self.plan.motion.waits_for_trigger:
            why = f"a stop of {writer} changed the target: triggers are refused until a complete one came"
            self.block_triggers(code, why)

    # --- what is seen of it ----------------------------------------------------------------------------

    def observe_actual(self, field_: PositionField, words: bytes, asked_ns: int) -> Actual | None:
        """Note an actual position as it was when asked at ``asked_ns``; None where it is no number."""
        raw = field_.unpack(words)
        if not isfinite(raw):
            return None
        before, now = self.actual, Actual(counts_of(field_, raw), asked_ns)
        was_unseen = self.is_unseen(asked_ns)
        self.actual = now
        self.heard_ns = asked_ns
        if self.sight is _REFUSED:
            self.hear_place(Told.PASSING)
        if self.record is not None and self.record.recalled is not None:
            self._decide_record(now)
        if self.unproven is not None:
            self._prove(self.unproven, before, now)
        self.compensation.observe(now.counts)
        is_at_rest = self.whereabouts in AT_REST
        if self.compensation.accepted is not None:
            self._see_place(now)
        elif self.seen_at_retained is False:
            for member in (self, *self.peers):  # of a beam all targets of before a loss count, or none (M11)
                if member.whereabouts in RETAINING:
                    member.happens(Happening.AWAY)
        if was_unseen and self.whereabouts in ON_WAY:
            self._see_way(now)
        if before is not None and is_at_rest:
            self._look_for_jump(before, now)
        return now

    def _prove(self, unproven: Rendering, before: Actual | None, now: Actual) -> None:
        """Take a target without a reply as accepted when the axis is seen to have gone there (M7)."""
        if self.is_distance_unproven:
            self.prove_distance(now, before)
            return
        if before is None or unproven.move is None or unproven.is_beside_another:
            return
        near = self.plan.settings.hysteresis_counts
        end = unproven.corrected_counts
        if abs(now.counts - end) <= near < abs(before.counts - end):
            self.go(unproven, unproven.move, now.seen_ns)

    def prove_distance(self, now: Actual, before: Actual | None = None) -> None:
        """Find out whether a distance that was never acknowledged has run: from which of its ends (M5).

        Only of an axis that has had the time to start and may stand. At neither of the ends, or at both,
        nobody knows where the next distance would begin. So it is with a target that a record names.
        """
        unproven = self.unproven
        if unproven is None or unproven.start is None or unproven.move is None:
            return
        proof = unproven.proof
        if not self.may_stand(now.seen_ns) or not (proof is Proof.ONE or self.says_done):
            return
        settings = self.plan.settings
        window = settings.in_position_counts
        is_at_end = abs(now.counts - unproven.corrected_counts) <= window
        is_at_start = abs(now.counts - unproven.start.corrected_counts) <= window
        end = End.NEITHER if is_at_end is is_at_start else End.END if is_at_end else End.START
        if proof in AT_ONE_END and (
            before is None or abs(now.counts - before.counts) > settings.hysteresis_counts
        ):
            proof = Proof.TWO  # it creeps
        proof = PROOF_AFTER[proof, end]
        if proof is Proof.RAN:
            self.go(unproven, unproven.move, now.seen_ns)
        elif proof is Proof.RAN_NOT:
            self._run_not(unproven.start)
        elif proof is not unproven.proof:
            self.unproven = self._marked(unproven, unproven._replace(proof=proof))

    def note_rule(self, address: int, word: int) -> None:
        """Note what a mode or trigger register was read to hold."""
        self.rules.note_read(address, word)

    def look(self, actual: Actual, *, is_for_distance: bool) -> None:
        """The axis was asked for, because nobody had seen it for a while: it may have been moved.

        One that was not at its target yet may be anywhere on its way there; a distance has no base there.
        """
        if self.is_at_target(actual.counts) or self.is_seen_at_retained:
            return
        is_on_way = self.whereabouts in ON_WAY and self._is_on_way(actual)
        if is_for_distance or not is_on_way:
            self.displace()

    def _is_on_way(self, actual: Actual) -> bool:
        low, high = self.compensation.way
        window = self.plan.settings.in_position_counts
        return low - window <= actual.counts <= high + window

    def _see_way(self, actual: Actual) -> None:
        """Notice that an axis that nobody had seen for a while is not on its way any more (M4, M6).

        Of one that set out from nobody knows where every place is on it; a stream leaves none.
        """
        low, high = self.compensation.way
        is_known = low < high or self.whereabouts is _SET_OUT
        if is_known and not self.compensation.is_stream and not self._is_on_way(actual):
            self.displace()

    def observe_bit(self, name: str, asked_ns: int, *, is_set: bool) -> None:
        """Note one of the drive's status bits, as it was when asked at ``asked_ns``."""
        if not self.is_unseen(
            asked_ns
        ):  # whoever looks again does not see by it where the axis has been since
            self.heard_ns = asked_ns
        if name == DONE_BIT:
            self.observe_done(asked_ns, is_done=is_set)
        elif name == MOVING_BIT:
            self.is_moving = is_set
            if DONE_BIT not in self.plan.bits:  # a done bit may be older than this one
                self.hear(asked_ns, moves=is_set)
        elif name == ALARM_BIT:
            if is_set and not self.is_alarmed:
                self.displace()  # the drive has given up: it stands somewhere
                self.lose_reference()
            self.is_alarmed = is_set
        elif name == HOMED_BIT and self.follows_homed_bit:
            self.see_homed_bit(asked_ns, is_set=is_set)
        if name == self.homed_bit:
            self._see_end_of_homing(asked_ns, is_set=is_set)

    def hear(self, asked_ns: int, *, moves: bool) -> None:
        """Take note of the drive's word that it moves, or stands, wherever it goes."""
        if asked_ns < self.sent_off_ns:
            return
        if moves:
            self.said = Said.MOVES
        elif self.said is Said.MOVES:
            self.said = Said.STOOD

    def observe_done(self, asked_ns: int, *, is_done: bool) -> None:
        """Note the drive's done bit; of an axis that goes nowhere we know it only says whether it moves."""
        self.hear(asked_ns, moves=not is_done)
        if asked_ns < self.sent_off_ns:
            return
        has_actual = bool(self.plan.actual)
        if not is_done:
            self.happens(Happening.FELL)
        elif self.has_started(asked_ns) and (has_actual or not self.plan.done_is_in_position):
            self.happens(Happening.DONE if has_actual else Happening.DONE_ALONE)

    def _see_place(self, actual: Actual) -> None:
        """Notice that the axis has come to its target, or that something else moved it away (M4)."""
        if actual.seen_ns < self.sent_off_ns:
            return
        accepted = self.compensation.accepted
        assert accepted is not None
        if self.is_at_target(actual.counts):
            if self.whereabouts is _UNDER_WAY and self.compensation.readback.fade is not None:
                return  # the reading still fades from a start that nobody knew: it may have stood there
            happening = Happening.THERE
        elif abs(actual.counts - accepted.corrected_counts) <= self.plan.settings.max_correction_counts:
            happening = Happening.NEAR
        elif self.compensation.is_stream and self.whereabouts is Whereabouts.DONE_SAID:
            return  # a stream lags behind its setpoints, done or not
        elif self.plan.queues_targets and self.whereabouts is not _ARRIVED:
            return  # it may have been done with the target before, and be there yet
        else:
            happening = Happening.AWAY
        self.happens(happening)

    def _look_for_jump(self, before: Actual, now: Actual) -> None:
        """Notice that an axis at rest stands where no motion can have brought it (M9).

        Its drive counts from another zero now.
        """
        settings = self.plan.settings
        if not settings.max_speed:
            return
        distance = abs(now.counts - before.counts) / abs(settings.counts_per_unit)
        reach = settings.max_speed * (now.seen_ns - before.seen_ns) / NS_PER_S + settings.max_correction
        if distance > 2.0 * reach:
            self.displace()
            self.lose_reference()

    def read_command_words(
        self, number: int, field_: PositionField, words: bytes, readback: Readback
    ) -> bytes:
        """Turn the words of a command field that is read back into what the controller wrote.

        They also prove that a target arrived which was never acknowledged, unless the drive held the same
        words before; of a distance they say nothing about its having run.
        """
        unproven, image = self.unproven, self.fields[number]
        if (
            unproven is not None
            and unproven.number == number
            and unproven.corrected_words == words
            and not unproven.stood_there
            and not unproven.is_distance
            and not self.plan.motion.waits_for_trigger
        ):
            self.acknowledge(unproven, self.heard_ns)
        return image.means(words) or self.nominal_words(field_, words, readback)

    def read_back(self, number: int, words: bytes) -> None:
        """Note the words of a command field that the gateway has read.

        Where they are those of the target of before a lost link, its drive has kept it: nothing else is told
        by that, and what was lost on the way there stays lost (M3).
        """
        image, retained = self.fields[number], self.retained
        if retained is None or retained.number != number or retained.corrected_words != words:
            return
        if image.nominal_words is None and not image.is_torn:
            image.settle(retained.nominal_words, words)

    # --- its record ------------------------------------------------------------------------------------

    def keep_record(self, record: Record | None) -> None:
        """Keep a record from now on, and let that of the run before count where it does; None: keep none."""
        self.record = record
        if record is not None and record.recalled is not None and not self.is_enabled:
            self.drop_record("the compensation of the axis is off")

    @property
    def is_recalling(self) -> bool:
        """Whether it is not decided yet if the record of the run before counts."""
        return self.record is not None and self.record.recalled is not None

    def publish(self) -> None:
        """Let its record say what holds now."""
        if self.record is not None:
            self.record.publish(self)

    def _decide_record(self, actual: Actual) -> None:
        """Find out, with an actual position, whether the record of the run before counts."""
        record = self.record
        assert record is not None
        recalled = record.recalled
        assert recalled is not None
        if not self.is_referenced:
            lacking = [each for each in (self, *self.peers) if lacks_reference(each)]
            if not lacking:
                return
            if not (self.compensation.is_stream and recalled.is_of_this_boot):
                if self in lacking:
                    self.drop_record("the axis is not referenced now")
                return
        found = find(self, recalled, record.first or actual, actual)
        if found is None:
            record.look_first(actual)
        elif isinstance(found, str):
            self.drop_record(found)
        else:
            record.fit(found, actual)
            self._take_group_up()

    def _take_group_up(self) -> None:
        """Take all axes of the group up, as soon as the records of all of them fit."""
        members = [self, *(peer for peer in self.peers if peer.record is not None)]
        fates = [member.record.fate for member in members if member.record is not None]
        if Fate.NONE in fates or Fate.DROPPED in fates:
            self.drop_record("another axis of its group has none that counts")
        elif Fate.OPEN not in fates:
            for member in members:
                if member.record is not None and member.record.fate is Fate.FITS:
                    member.take_up(member.record)

    def drop_record(self, reason: str) -> None:
        """The record of the run before does not count."""
        assert self.record is not None
        self.record.decide(Fate.DROPPED)
        self.record.clear()
        self.tell(EventKind.RECORD_NOT_USED, f"{reason}; it starts without its record")
        for peer in self.peers:
            if peer.is_recalling:
                peer.drop_record(f"axis {self.plan.name} of its group starts without one")

    def take_up(self, record: Record) -> None:
        """Go on from the record of the run before, which fits: all of it, or nothing of it."""
        recalled, fitting = record.recalled, record.finding
        assert recalled is not None
        assert fitting is not None
        finding, actual = fitting
        find_table = partial(record.find_table, self)
        try:
            state = state_of(self, recalled.state, find_table, actual.seen_ns)
            move = recalled.unproven
            after = None if move is None else state_of(self, move.state, find_table, actual.seen_ns)
        except TableNotFoundError:
            self.drop_record("the table that was in force is not the one configured now")
            return
        except (TableError, SettingsError) as error:
            self.drop_record(f"the table that was in force cannot be used any more ({error})")
            return
        self._restore(recalled, state, is_at_target=finding is Finding.AT_TARGET)
        if move is not None and after is not None:
            self._restore_unproven(recalled, move, after, finding)
        self._resume_terms(actual.seen_ns)
        if not self.is_referenced:
            self.displace(keeps_branch=self.compensation.is_stream)
            self.compensation.lose_reference()  # what a stream has passed with stays, and fades (M9)
        record.decide(Fate.TAKEN)
        settings, in_force = self.plan.settings, self.compensation.state
        position = (
            self.compensation.machine_position(self.nominal_of(actual.counts)) - settings.machine_offset
        )
        is_open = "; whether it has gone there is not certain yet" if self.is_distance_unproven else ""
        self.tell(
            EventKind.RESTORED,
            f"goes on from its record: nominal {position:.6g} {settings.units.value}, the drive at "
            f"{actual.counts:.10g} counts, {in_force.travel.direction.name.lower()}, progress of a reversal "
            f"{in_force.progress:.3g}, of a change-over {in_force.change:.3g}, generation "
            f"{recalled.generation}{is_open}",
        )

    def _restore(self, recalled: Remembered, state: State, *, is_at_target: bool) -> None:
        """Be where the record says, on its branch, with its correction."""
        accepted = None
        if is_at_target or (recalled.has_target and not may_have_stopped(self)):
            accepted = Accepted(recalled.nominal_counts, recalled.corrected_counts)
        fade = None if recalled.fade is None else Fade(*recalled.fade)
        came_from = None if recalled.came_from is None else Accepted(*recalled.came_from)
        self.compensation.resume(
            state, accepted, recalled.anchor_counts, fade, recalled.way, came_from=came_from
        )
        fade = self.compensation.readback.fade
        if accepted is None:
            self.whereabouts = Whereabouts.STOPPED
        elif not is_at_target:
            self.whereabouts = _UNDER_WAY  # a record does not say how well the start of the way was known
        elif recalled.may_have_left:
            self.whereabouts = Whereabouts.MAY_HAVE_LEFT
        elif recalled.was_done_seen:
            self.whereabouts = _ARRIVED
        else:
            self.whereabouts = Whereabouts.SEEN_THERE if fade is None else _UNDER_WAY
        self.unproven = self.retained = None
        self._send_off(state.at_ns if recalled.is_of_this_boot else 0)
        self.last_number = recalled.number
        if accepted is not None and recalled.knows_words:
            field_ = self.plan.command[recalled.number]
            self.fields[recalled.number].settle(
                field_.pack(raw_of(field_, accepted.nominal_counts)),
                field_.pack(raw_of(field_, accepted.corrected_counts)),
            )

    def _restore_unproven(
        self, recalled: Remembered, move: RememberedMove, after: State, finding: Finding
    ) -> None:
        """Take the target that was on its way as accepted, or as one that nobody acknowledged."""
        field_ = self.plan.command[move.number]
        nominal_words = corrected_words = b""
        if not move.is_distance:
            nominal_words = field_.pack(raw_of(field_, move.nominal_counts))
            corrected_words = field_.pack(raw_of(field_, move.corrected_counts))
        correction_counts = move.corrected_counts - move.nominal_counts
        planned = Move(move.nominal_counts, correction_counts, self.compensation.map_of(after), after)
        proof = proof_of(self, recalled, finding)
        start = None
        if recalled.has_target and (move.is_distance or proof is not Proof.ONE):
            start = Accepted(recalled.nominal_counts, recalled.corrected_counts)
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
            self.pending = rendering  # its record goes on to name it, for the next start as for this one
            is_timed = recalled.is_of_this_boot and proof is Proof.TWO
            self.leave_unproven(rendering, after.at_ns if is_timed else self.heard_ns)
            if finding is Finding.EITHER:
                self.compensation.read_as_reached(planned, move.corrected_counts)
            return
        if self.plan.has_rules:
            self.go(rendering, planned, self.heard_ns)
        else:
            self.acknowledge(rendering, self.heard_ns)
        if finding is not Finding.AT_UNPROVEN and may_have_stopped(self):
            self.displace(keeps_branch=True)

    def _resume_terms(self, now_ns: int) -> None:
        """Let its terms go on from what its record put into force."""
        terms, spec = self.terms, self.compensation.state.spec
        if terms is None or spec.curve is None:  # a mere offset holds a table too
            return
        terms.resume(spec, now_ns)
        self.wanted = spec if spec.is_kin_of(self.base) else terms.on(self.base, self.plan)
        self.compensation.want(self.wanted)
