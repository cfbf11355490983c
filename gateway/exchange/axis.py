"""One axis between its registers and its maths: shadow words, reference, and where the axis is.

The *shadow* of a command field holds what the controller believes the drive holds (nominal words) and what
the drive acknowledged (corrected words). Everything that can happen to a position on the wire, halves, masks,
blocks and cut reads, is a change of nominal words followed by rendering them with the correction in force.
"""

from dataclasses import dataclass, field
from math import isfinite
from typing import NamedTuple

from gateway.compensation.axis import AxisCompensation, Move, Place, PlaceKind
from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, spec_of_table
from gateway.compensation.errors import OutOfTableError, OutsideTravelError
from gateway.compensation.readback import Readback
from gateway.compensation.settings import Setpoints
from gateway.exchange.plan import AxisPlan, CompensationMode
from gateway.exchange.reference import ReferenceState
from gateway.exchange.shadow import Shadow
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.registers import PositionField
from gateway.times import NS_PER_MS, NS_PER_S


class RefusedPositionError(Exception):
    """A position that must not reach the drive (M8); the message says why."""


@dataclass(slots=True)
class Actual:
    """The last actual position seen, as the drive reported it."""

    counts: float
    seen_ns: int


class Rendering(NamedTuple):
    """A target ready to be written: both forms of its words, and what accepting it means."""

    axis: "AxisExchange"
    shadow: Shadow
    nominal_words: bytes
    corrected_words: bytes
    corrected_counts: float
    move: Move | None
    """None for a repeat: the drive is told exactly the same words again (M4)."""


@dataclass(slots=True)
class AxisExchange:
    """State of one axis on its line."""

    plan: AxisPlan
    compensation: AxisCompensation = field(init=False)
    wanted: CorrectionSpec = field(init=False)
    shadows: list[Shadow] = field(init=False)
    has_branches: bool = field(init=False)
    """Whether the direction of travel makes a difference to the correction."""
    reference: ReferenceState = field(init=False)
    is_ended: bool = False
    """A remapping register of its unit was written (M10)."""
    actual: Actual | None = None
    is_done_seen: bool = False
    was_at_target: bool = False
    was_unsure: bool = False
    last_shadow: Shadow | None = None
    """Of the field through which the last accepted target came."""
    unproven: Rendering | None = None
    """A target that was sent and not acknowledged: the drive may hold it or not."""

    def __post_init__(self) -> None:
        self.compensation = AxisCompensation(self.plan.settings)
        self.shadows = [Shadow(field_) for field_ in self.plan.command]
        self.reference = ReferenceState(self.plan.referenced)
        is_off = self.plan.compensation is CompensationMode.OFF or self.plan.table is None
        self.wanted = NOTHING
        self.has_branches = False
        if not is_off and self.plan.table is not None:
            self.wanted = spec_of_table(self.plan.table, self.plan.settings)
            curve = self.wanted.curve
            one_way = curve is not None and curve.table.is_unidirectional and self.wanted.gain.is_even
            self.has_branches = not one_way
        if self.is_referenced:
            self.compensation.find_reference(self.wanted)

    @property
    def is_shadow(self) -> bool:
        """Compute and show, but write and read 1:1."""
        return self.plan.compensation is CompensationMode.SHADOW

    @property
    def passes_unchanged(self) -> bool:
        """Whether words of this axis go through 1:1 in both directions (M9)."""
        return self.is_shadow or self.compensation.is_passing

    @property
    def is_unsure(self) -> bool:
        """Whether the branch in force was assumed, where there are two and they count."""
        state = self.compensation.state
        return self.has_branches and state.is_unsure and not self.compensation.is_passing

    @property
    def is_referenced(self) -> bool:
        """Whether the axis knows where it is, as far as the gateway can tell."""
        return self.reference.is_found

    @property
    def may_read(self) -> bool:
        """Whether the gateway may add reads of this axis's registers (W8)."""
        return self.plan.safe_read and self.plan.added_frames

    # --- reference -------------------------------------------------------------------------------------

    def see_homed_bit(self, now_ns: int, *, is_set: bool) -> bool:
        """Take note of the drive's homed bit; return whether that is news."""
        was_referenced = self.is_referenced
        is_news = self.reference.see(now_ns, is_set=is_set)
        if is_set is not was_referenced:
            self.forget()
            if is_set:
                self.compensation.find_reference(self.wanted)
            else:
                self.compensation.lose_reference()
        return is_news

    def needs_reference(self, now_ns: int, *, is_target: bool) -> bool:
        """Whether the homed bit has to be read before this axis's positions pass.

        A stream of setpoints is not held up for an old bit while the axis is referenced.
        """
        is_stream = self.plan.settings.setpoints is Setpoints.STREAM
        before_target = is_target and not (is_stream and self.is_referenced)
        return self.may_read and self.reference.has_to_be_asked(now_ns, before_target=before_target)

    def end(self) -> None:
        """End the compensation until the gateway is started again: its registers mean something else now."""
        self.is_ended = True
        self.wanted = NOTHING
        self.has_branches = False
        self.forget()
        self.compensation.lose_reference()

    def doubt(self, now_ns: int) -> bool:
        """The drive was silent and may have lost its reference; return whether it counts as lost at once."""
        if not self.reference.follows_bit:
            return False
        if not self.may_read:
            return self.see_homed_bit(now_ns, is_set=False)
        self.reference.is_in_doubt = True
        return False

    def forget(self) -> None:
        """What the drive holds is unknown (M7)."""
        self.compensation.forget_target()
        self.is_done_seen = self.was_at_target = False
        self.unproven = None
        for shadow in self.shadows:
            shadow.forget()

    def link_lost(self, now_ns: int) -> bool:
        """Forget what may have changed while nobody looked; return whether the reference is lost with it."""
        self.forget()
        self.actual = None
        return self.doubt(now_ns)

    def fail(self, rendering: Rendering) -> None:
        """A target was sent and not acknowledged: the drive may hold it or not."""
        self.compensation.forget_target()
        self.is_done_seen = self.was_at_target = False
        rendering.shadow.forget()
        if rendering.move is not None:
            self.unproven = rendering

    # --- reading ---------------------------------------------------------------------------------------

    def observe_actual(self, field_: PositionField, words: bytes, now_ns: int) -> Actual | None:
        """Note an actual position as the drive reported it; None where it is no number."""
        raw = field_.unpack(words)
        if not isfinite(raw):
            return None
        self.actual = Actual(counts_of(field_, raw), now_ns)
        self.compensation.observe(self.actual.counts)
        self._watch(self.actual.counts)
        return self.actual

    def observe_done(self, is_done: bool) -> None:
        """Note the drive's done bit; a second motion after a target was reached is not of our making."""
        if self.is_done_seen and not is_done:
            self.compensation.forget_target()
        self.is_done_seen = is_done and self.compensation.accepted is not None

    def _watch(self, corrected_counts: float) -> None:
        """Notice that something else moved the axis away from where it had been sent (M4)."""
        accepted = self.compensation.accepted
        if accepted is None:
            return
        settings = self.plan.settings
        distance = abs(corrected_counts - accepted.corrected_counts) / abs(settings.counts_per_unit)
        if distance <= settings.hysteresis:
            self.was_at_target = True
        elif self.was_at_target and distance > settings.max_correction:
            self.compensation.forget_target()
            self.was_at_target = self.is_done_seen = False

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
            return field_.pack(_raw(field_, accepted.nominal_counts))
        correction = readback.correction_counts(corrected_counts)
        if not correction:
            return words
        return field_.pack(corrected - _steps(field_, correction))

    def command_words(self, shadow: Shadow, field_: PositionField, words: bytes, readback: Readback) -> bytes:
        """Turn the words of a command field that is read back into what the controller wrote.

        They also prove that a target arrived which was never acknowledged.
        """
        unproven = self.unproven
        if unproven is not None and unproven.shadow is shadow and unproven.corrected_words == words:
            self.commit(unproven)
        if shadow.nominal_words is not None and shadow.corrected_words == words:
            return shadow.nominal_words
        return self.nominal_words(field_, words, readback)

    # --- writing ---------------------------------------------------------------------------------------

    @property
    def needs_offset(self) -> bool:
        """Whether the next streamed setpoint is the first: nothing is in force before it."""
        return self.compensation.state.position is None

    def needs_actual(self, nominal_words: bytes, shadow: Shadow, field_: PositionField, now_ns: int) -> bool:
        """Whether an actual position has to be read before this target can be rendered (M6)."""
        if not self.may_read or not self.plan.actual or self.wanted is NOTHING or not self.is_referenced:
            return False
        if self.is_repeat(shadow, nominal_words):
            return False
        nominal_counts = counts_of(field_, field_.unpack(nominal_words))
        accepted = self.compensation.accepted
        if accepted is not None and accepted.nominal_counts == nominal_counts:
            return False
        if self.plan.settings.setpoints is Setpoints.STREAM:
            return self.needs_offset
        return self.has_branches and self._known_place(nominal_counts, now_ns) is None

    def is_repeat(self, shadow: Shadow, nominal_words: bytes) -> bool:
        """Whether a command field is written with what the drive acknowledged there already (M4)."""
        return (
            self.compensation.accepted is not None
            and not shadow.is_torn
            and shadow.nominal_words == nominal_words
            and shadow.corrected_words is not None
        )

    def render_repeat(self, shadow: Shadow, *, is_passing: bool) -> Rendering:
        """Render exactly the same words as before; accepting them changes nothing."""
        assert shadow.nominal_words is not None
        assert shadow.corrected_words is not None
        words = shadow.nominal_words if is_passing else shadow.corrected_words
        return Rendering(self, shadow, shadow.nominal_words, words, 0.0, None)

    def render(
        self, index: int, nominal_words: bytes, now_ns: int, fresh: Actual | None, *, is_passing: bool
    ) -> Rendering:
        """Render a whole target with the correction in force.

        Args:
            index: which of the axis's command fields.
            nominal_words: the target as commanded, in the field's own form.
            now_ns: monotonic time.
            fresh: an actual position that was read for this very target.
            is_passing: the words go out as they came; what they would have become is still worked out.

        Raises:
            RefusedPositionError: the corrected position must not reach the drive (M8).
        """
        field_ = self.plan.command[index]
        shadow = self.shadows[index]
        raw = field_.unpack(nominal_words)
        if not isfinite(raw):
            if is_passing:
                return Rendering(self, shadow, nominal_words, nominal_words, 0.0, None)
            raise RefusedPositionError(f"{raw} is not a position")
        try:
            move = self._plan_move(counts_of(field_, raw), now_ns, fresh)
            if move.state.is_unsure and self._is_unproven(shadow, nominal_words) and self.unproven:
                return self.unproven  # nothing tells better: the same target is the same words (M4)
            corrected_words = nominal_words
            if move.correction_counts:
                corrected_words = field_.pack(raw + _steps(field_, move.correction_counts))
        except (OutOfTableError, OutsideTravelError, RegisterRangeError) as error:
            raise RefusedPositionError(str(error)) from error
        corrected_counts = counts_of(field_, field_.unpack(corrected_words))
        sent = nominal_words if is_passing else corrected_words
        return Rendering(self, shadow, nominal_words, sent, corrected_counts, move)

    def commit(self, rendering: Rendering, now_ns: int = 0) -> None:
        """The drive acknowledged a target with its full native success (M7)."""
        rendering.shadow.settle(rendering.nominal_words, rendering.corrected_words)
        if rendering.move is None:
            self.compensation.touch(now_ns)
            return
        self.compensation.commit(rendering.move, rendering.corrected_counts)
        self.last_shadow = rendering.shadow
        self.unproven = None
        self.is_done_seen = self.was_at_target = False

    def _is_unproven(self, shadow: Shadow, nominal_words: bytes) -> bool:
        unproven = self.unproven
        return unproven is not None and unproven.shadow is shadow and unproven.nominal_words == nominal_words

    def _plan_move(self, nominal_counts: float, now_ns: int, fresh: Actual | None) -> Move:
        accepted = self.compensation.accepted
        if accepted is not None and accepted.nominal_counts == nominal_counts:
            return self.compensation.again()  # the same target through another register of the axis
        if self.plan.settings.setpoints is Setpoints.STREAM:
            if self.needs_offset and fresh is not None and self.is_referenced:
                self.compensation.assume_offset(fresh.counts, nominal_counts)
            return self.compensation.plan(nominal_counts, None, now_ns)
        place = self._known_place(nominal_counts, now_ns)
        if place is None and fresh is not None:
            place = self._measured(fresh)
        if place is None and accepted is not None and not self.plan.actual and "done" not in self.plan.bits:
            # Nothing tells where this axis is; the order of its targets is the best there is, and flagged.
            place = Place(accepted.nominal_counts, PlaceKind.ASSUMED)
        return self.compensation.plan(nominal_counts, place, now_ns)

    def _known_place(self, nominal_counts: float, now_ns: int) -> Place | None:
        """Where the axis is, as far as passing traffic told it (M6)."""
        accepted = self.compensation.accepted
        if accepted is not None and self.is_done_seen:
            return Place(accepted.nominal_counts, PlaceKind.REACHED)
        actual = self.actual
        settings = self.plan.settings
        if actual is None or not settings.max_speed:
            return None
        age_ns = now_ns - actual.seen_ns
        if age_ns > settings.fresh_ms * NS_PER_MS:
            return None
        place = self._measured(actual)
        reach = settings.max_speed * age_ns / NS_PER_S * abs(settings.counts_per_unit)
        return None if abs(nominal_counts - place.counts) <= reach else place

    def _measured(self, actual: Actual) -> Place:
        """Turn a measured position back where its branch is known; else leave it on the drive's scale."""
        if self.is_shadow:
            return Place(actual.counts, PlaceKind.MEASURED)
        if self.compensation.accepted is None:
            return Place(actual.counts, PlaceKind.ON_DRIVE)
        return Place(self.nominal_of(actual.counts), PlaceKind.MEASURED)

    def nominal_of(self, corrected_counts: float) -> float:
        """Nominal counts of an actual position, as the controller would read it, not rounded."""
        if self.is_shadow:
            return corrected_counts
        return corrected_counts - self.compensation.readback.correction_counts(corrected_counts)


def counts_of(field_: PositionField, raw: float) -> float:
    """Counts of a register's content; integers stay integers, so that 64 bits lose nothing."""
    return raw if field_.scale == 1.0 else raw * field_.scale


def _steps(field_: PositionField, counts: float) -> float:
    """Whole steps of a register for a number of counts; a float register takes them as they are."""
    return counts / field_.scale if field_.type.is_float else round(counts / field_.scale)


def _raw(field_: PositionField, counts: float) -> float:
    """Content of a register for counts: the inverse of :func:`counts_of`."""
    raw = counts if field_.scale == 1.0 else counts / field_.scale
    return raw if field_.type.is_float else round(raw)
