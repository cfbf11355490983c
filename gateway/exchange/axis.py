"""One axis between its registers and its maths: shadow words, reference, and where the axis is.

The *shadow* of a command field holds what the controller believes the drive holds (nominal words) and what
the drive acknowledged (corrected words). Everything that can happen to a position on the wire, halves, masks,
blocks and cut reads, is a change of nominal words followed by rendering them with the correction in force.
"""

from dataclasses import dataclass, field
from math import isfinite
from typing import NamedTuple

from gateway.compensation.axis import AxisCompensation, Move, Place
from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, spec_of_table
from gateway.compensation.direction import Direction
from gateway.compensation.errors import OutOfTableError, OutsideTravelError
from gateway.compensation.readback import Readback
from gateway.compensation.settings import Setpoints
from gateway.exchange.plan import AxisPlan, CompensationMode, Reference
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.registers import PositionField

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000


class RefusedPositionError(Exception):
    """A position that must not reach the drive (M8); the message says why."""


@dataclass(slots=True)
class Shadow:
    """What is known about the words of one command field."""

    nominal_words: bytes | None = None
    corrected_words: bytes | None = None

    def forget(self) -> None:
        """Nobody knows any more what the drive holds."""
        self.nominal_words = self.corrected_words = None


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
    is_referenced: bool = False
    actual: Actual | None = None
    is_done_seen: bool = False
    needs_offset: bool = True
    """The next streamed setpoint is the first since the start or a reconnect."""
    is_unsure: bool = False
    was_refused: bool = False

    def __post_init__(self) -> None:
        self.compensation = AxisCompensation(self.plan.settings)
        self.shadows = [Shadow() for _ in self.plan.command]
        is_off = self.plan.compensation is CompensationMode.OFF or self.plan.table is None
        self.wanted = NOTHING
        if not is_off and self.plan.table is not None:
            self.wanted = spec_of_table(self.plan.table, self.plan.settings)
        if self.plan.referenced is Reference.ABSOLUTE:
            self.is_referenced = True
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
    def follows_homed_bit(self) -> bool:
        """Whether the drive's homed bit decides that the axis is referenced."""
        return self.plan.referenced is Reference.DRIVE_BIT

    @property
    def may_read(self) -> bool:
        """Whether the gateway may add reads of this axis's registers (W8)."""
        return self.plan.safe_read and self.plan.added_frames

    # --- reference -------------------------------------------------------------------------------------

    def set_referenced(self, is_referenced: bool) -> bool:
        """Take note of the drive's homed bit; return whether that is news."""
        if is_referenced is self.is_referenced:
            return False
        self.is_referenced = is_referenced
        self.forget()
        if is_referenced:
            self.compensation.find_reference(self.wanted)
        else:
            self.compensation.lose_reference()
        return True

    def forget(self) -> None:
        """What the drive holds is unknown: after a time-out, an odd reply, an exception, a lost link (M7)."""
        self.compensation.forget_target()
        self.is_done_seen = False
        for shadow in self.shadows:
            shadow.forget()

    def link_lost(self) -> None:
        """Forget everything that may have changed while nobody looked."""
        self.forget()
        self.actual = None
        self.needs_offset = True

    # --- reading ---------------------------------------------------------------------------------------

    def observe_actual(self, field_: PositionField, words: bytes, now_ns: int) -> None:
        """Note an actual position, as the drive reported it at ``now_ns``."""
        raw = field_.unpack(words)
        if isfinite(raw):
            self.actual = Actual(counts_of(field_, raw), now_ns)
            self.compensation.observe(self.actual.counts)

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
        """Turn the words of a command field that is read back into what the controller wrote."""
        if shadow.nominal_words is not None and shadow.corrected_words == words:
            return shadow.nominal_words
        return self.nominal_words(field_, words, readback)

    # --- writing ---------------------------------------------------------------------------------------

    def needs_actual(self, nominal_words: bytes, field_: PositionField, now_ns: int) -> bool:
        """Whether an actual position has to be read before this target can be rendered (M6)."""
        if not self.may_read or not self.plan.actual or self.wanted is NOTHING or not self.is_referenced:
            return False
        nominal_counts = counts_of(field_, field_.unpack(nominal_words))
        if self._is_repeat(nominal_counts):
            return False
        if self.plan.settings.setpoints is Setpoints.STREAM:
            return self.needs_offset
        curve = self.wanted.curve
        if curve is not None and curve.table.is_unidirectional and self.wanted.gain.is_even:
            return False
        return self._known_place(nominal_counts, now_ns) is None

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
        nominal_counts = counts_of(field_, raw)
        if self._is_repeat(nominal_counts):
            return self._repeat(field_, shadow, nominal_words, is_passing)
        try:
            move = self._plan_move(nominal_counts, now_ns, fresh)
            corrected = raw + _steps(field_, move.correction_counts)
            corrected_words = field_.pack(corrected) if move.correction_counts else nominal_words
        except (OutOfTableError, OutsideTravelError, RegisterRangeError) as error:
            raise RefusedPositionError(str(error)) from error
        corrected_counts = counts_of(field_, field_.unpack(corrected_words))
        sent = nominal_words if is_passing else corrected_words
        return Rendering(self, shadow, nominal_words, sent, corrected_counts, move)

    def commit(self, rendering: Rendering) -> None:
        """The drive acknowledged a target with its full native success (M7)."""
        rendering.shadow.nominal_words = rendering.nominal_words
        rendering.shadow.corrected_words = rendering.corrected_words
        if rendering.move is not None:
            self.compensation.commit(rendering.move, rendering.corrected_counts)
            self.is_done_seen = False
            self.needs_offset = False

    def _is_repeat(self, nominal_counts: float) -> bool:
        accepted = self.compensation.accepted
        return accepted is not None and accepted.nominal_counts == nominal_counts

    def _repeat(
        self, field_: PositionField, shadow: Shadow, nominal_words: bytes, is_passing: bool
    ) -> Rendering:
        accepted = self.compensation.accepted
        assert accepted is not None
        if is_passing:
            words = nominal_words
        elif shadow.nominal_words == nominal_words and shadow.corrected_words is not None:
            words = shadow.corrected_words
        else:  # the same target through another register of the axis
            words = field_.pack(_raw(field_, accepted.corrected_counts))
        return Rendering(self, shadow, nominal_words, words, accepted.corrected_counts, None)

    def _plan_move(self, nominal_counts: float, now_ns: int, fresh: Actual | None) -> Move:
        if self.plan.settings.setpoints is Setpoints.STREAM:
            if self.needs_offset and fresh is not None and self.is_referenced:
                self.compensation.assume_offset(fresh.counts, nominal_counts)
            return self.compensation.plan(nominal_counts, None, now_ns)
        place = self._known_place(nominal_counts, now_ns)
        if place is None and fresh is not None:
            place = Place(self._nominal_of(fresh.counts), is_reached=False)
        if place is None and not self.plan.actual and self.compensation.accepted is not None:
            # Nothing tells where this axis is; the order of its targets is the best there is, and flagged.
            place = Place(self.compensation.accepted.nominal_counts, is_reached=True, is_assumed=True)
        return self.compensation.plan(nominal_counts, place, now_ns)

    def _known_place(self, nominal_counts: float, now_ns: int) -> Place | None:
        """Where the axis is, as far as passing traffic told it (M6)."""
        accepted = self.compensation.accepted
        if accepted is not None and self.is_done_seen:
            return Place(accepted.nominal_counts, is_reached=True)
        actual = self.actual
        settings = self.plan.settings
        if actual is None or not settings.max_speed:
            return None
        age_ns = now_ns - actual.seen_ns
        if age_ns > settings.fresh_ms * NS_PER_MS:
            return None
        nominal_actual = self._nominal_of(actual.counts)
        reach = settings.max_speed * age_ns / NS_PER_S * abs(settings.counts_per_unit)
        if abs(nominal_counts - nominal_actual) <= reach:
            return None
        return Place(nominal_actual, is_reached=False)

    def _nominal_of(self, corrected_counts: float) -> float:
        if self.is_shadow:
            return corrected_counts
        return corrected_counts - self.compensation.readback.correction_counts(corrected_counts)

    # --- status ----------------------------------------------------------------------------------------

    @property
    def direction(self) -> str:
        """Direction as the status shows it."""
        state = self.compensation.state
        return (
            "unsure"
            if state.is_unsure and state.position is not None
            else state.travel.direction.name.lower()
        )

    def state_name(self) -> str:
        """State of the compensation as the status shows it."""
        if self.plan.compensation is CompensationMode.OFF:
            return "off"
        if self.plan.table is None:
            return "no-table"
        if not self.is_referenced:
            return "unreferenced"
        if self.is_shadow:
            return "shadow"
        accepted = self.compensation.accepted
        if accepted is not None and self.compensation.is_outside(accepted.nominal_counts):
            return "outside"
        is_stream = self.plan.settings.setpoints is Setpoints.STREAM
        return "blending" if is_stream and self.compensation.is_blending else "active"

    def status(self) -> dict[str, object]:
        """Return this axis's part of the status model; positions in units, on their own scale."""
        settings = self.plan.settings
        accepted = self.compensation.accepted
        correction: float | None = None

        def units(counts: float | None) -> float | None:
            if counts is None:
                return None
            return self.compensation.machine_position(counts) - settings.machine_offset

        nominal_actual = None if self.actual is None else self._nominal_of(self.actual.counts)
        if accepted is not None:
            correction = (accepted.corrected_counts - accepted.nominal_counts) / settings.counts_per_unit
        return {
            "compensation": self.state_name(),
            "units": settings.units.value,
            "direction": self.direction,
            "correction": correction,
            "nominal_setpoint": units(None if accepted is None else accepted.nominal_counts),
            "corrected_setpoint": units(None if accepted is None else accepted.corrected_counts),
            "nominal_actual": units(nominal_actual),
            "corrected_actual": units(None if self.actual is None else self.actual.counts),
            "table": self._table_status(),
        }

    def _table_status(self) -> dict[str, object]:
        table = self.plan.table
        return {
            "file": self.plan.table_name or None,
            "format": self.plan.table_format or None,
            "sha256": self.plan.table_digest or None,
            "points": 0 if table is None else len(table.positions),
            "status": "none" if table is None else "active",
            "error": None,
        }


def is_direction_known(axis: AxisExchange) -> bool:
    """Whether the branch in force was decided and not assumed."""
    state = axis.compensation.state
    return not state.is_unsure and state.travel.direction is not Direction.UNKNOWN


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
