"""What the next run of the gateway has to know of an axis, kept at every moment as it is (DESIGN 7).

After each input of the line the axis is compared with what was written last, so that whatever changes it (a
stop, homing, a lost reply, a command) changes the record as well. What cannot be seen afterwards is written
before a frame goes out: the target in it, which the drive may have got when the process dies; and that
nothing is known, where it moves the axis in another way.
"""

from collections.abc import Callable
from enum import Enum
from typing import Final

from gateway.compensation.fingerprint import scale_digest
from gateway.compensation.moves import State
from gateway.compensation.table import CorrectionTable
from gateway.drives.motion import Action
from gateway.exchange.arrival import WAS_THERE, Stage
from gateway.exchange.axis import Actual, AxisExchange, Rendering
from gateway.exchange.effects import MOVES_OTHERWISE, note_unknown
from gateway.exchange.events import EventKind
from gateway.exchange.plan import AxisPlan
from gateway.exchange.record_layout import RecordSlots, Remembered, Specs
from gateway.exchange.restoring import Finding, find, why_not_restored
from gateway.exchange.rewriting import Rewriting
from gateway.exchange.shadow import Shadow

LARGEST_COUNTS: Final = 2.0**53
"""Beyond it a double does not hold every whole count; such a target is not kept."""
_NO_TARGET: Final[tuple[float, ...]] = (0.0, 0.0)
_NO_FADE: Final = (False, 0.0, 0.0, 0.0, 0.0)
FindTable = Callable[[bytes], CorrectionTable | None]
"""The table with a digest (``compensation.fingerprint.table_digest``); None where it is not to be had."""


def digest_of_axis(plan: AxisPlan) -> bytes:
    """Digest of all that decides what the counts of an axis mean: a record made under another one is void."""
    fields = [
        (f.address, f.type.value, f.order.value, float(f.scale), f.block)
        for f in (*plan.command, *plan.actual[:1])
    ]
    return scale_digest(plan.settings, (plan.unit_id, len(plan.command), tuple(fields)))


class Fate(Enum):
    """What became of the record of the run before."""

    NONE = "none"
    """There was none."""
    OPEN = "open"
    """It is not decided yet whether it counts."""
    FITS = "fits"
    """It does, and waits for those of the other axes of its group: all of them are taken up, or none."""
    TAKEN = "taken"
    DROPPED = "dropped"


def _lacks_reference(axis: AxisExchange) -> bool:
    """Whether it is certain that an axis does not know where it is."""
    return axis.reference.is_known and not axis.reference.is_found


class AxisMemory:
    """Keeps the record of one axis, and takes the axis up from it once.

    ``recalled`` is the record of the run before, until it is decided whether it counts.
    """

    __slots__ = (
        "_axis",
        "_find_elsewhere",
        "_finding",
        "_first",
        "_has_rules",
        "_is_empty",
        "_is_on_wire",
        "_is_paused",
        "_pending",
        "_seen",
        "_slots",
        "fate",
        "recalled",
    )

    def __init__(
        self,
        axis: AxisExchange,
        slots: RecordSlots,
        recalled: Remembered | None,
        find_table: FindTable | None = None,
    ) -> None:
        self._axis = axis
        self._slots = slots
        self._find_elsewhere = find_table
        self._has_rules = axis.plan.has_rules
        self._is_empty = False
        self._is_on_wire = False
        self._is_paused = False
        self._pending: Rendering | None = None
        self._seen: tuple[object, ...] = ()
        self._first: Actual | None = None
        """Where the drive was read to be first."""
        self._finding: tuple[Finding, Actual] | None = None
        self.fate = Fate.NONE if recalled is None else Fate.OPEN
        self.recalled = recalled
        if recalled is not None and not axis.is_enabled:
            self.drop("the compensation of the axis is off")
        elif recalled is None:
            self._clear()

    # --- from the run before ---------------------------------------------------------------------------

    @property
    def wants_look(self) -> bool:
        """Whether the drive has to be read once more before it is decided."""
        return self.fate is Fate.OPEN and self._first is not None

    def decide(self, actual: Actual) -> None:
        """Find out, with an actual position, whether the record of the run before counts."""
        axis, recalled = self._axis, self.recalled
        assert recalled is not None
        if not axis.is_referenced:
            lacking = [each for each in (axis, *axis.peers) if _lacks_reference(each)]
            if not lacking:
                return
            if not (axis.compensation.is_stream and recalled.is_of_this_boot):
                if axis in lacking:
                    self.drop("the axis is not referenced now")
                return
        found = find(axis, recalled, self._first or actual, actual)
        if found is None:
            self._first = self._first or actual
        elif isinstance(found, str):
            self.drop(found)
        else:
            self.fate, self._finding = Fate.FITS, (found, actual)
            self._take_group()

    def _take_group(self) -> None:
        """Take all axes of the group up, as soon as the records of all of them fit."""
        memories = [peer.memory for peer in self._axis.peers if peer.memory is not None]
        if any(memory.fate in (Fate.NONE, Fate.DROPPED) for memory in memories):
            self.drop("another axis of its group has none that counts")
        elif all(memory.fate is not Fate.OPEN for memory in memories):
            for memory in (self, *memories):
                if memory.fate is Fate.FITS:
                    memory.take()

    def take(self) -> None:
        """Take the axis up from its record, which fits."""
        axis, recalled, fitting = self._axis, self.recalled, self._finding
        assert recalled is not None
        assert fitting is not None
        finding, actual = fitting
        reason = why_not_restored(axis, recalled, finding, actual, self._find_table)
        if reason:
            self.drop(reason)
            return
        if not axis.is_referenced:
            axis.compensation.lose_reference()  # what a stream has passed with stays, and fades (M9)
        self._decided(Fate.TAKEN)
        settings, state = axis.plan.settings, axis.compensation.state
        offset = settings.machine_offset
        read_back = axis.compensation.machine_position(axis.nominal_of(actual.counts)) - offset
        axis.tell(
            EventKind.RESTORED,
            f"goes on from its record: nominal {read_back:.6g} {settings.units.value}, the drive at "
            f"{actual.counts:.10g} counts, {state.travel.direction.name.lower()}, progress of a reversal "
            f"{state.progress:.3g}, of a change-over {state.change:.3g}, generation {recalled.generation}",
        )

    def _decided(self, fate: Fate) -> None:
        """Note what became of the record; it is there only as long as that is open."""
        self.fate, self.recalled, self._finding = fate, None, None

    def drop(self, reason: str) -> None:
        """The record of the run before does not count."""
        self._decided(Fate.DROPPED)
        self._clear()
        self._axis.tell(EventKind.RECORD_NOT_USED, f"{reason}; it starts without its record")
        for peer in self._axis.peers:
            if peer.memory is not None and peer.memory.recalled is not None:
                peer.memory.drop(f"axis {self._axis.plan.name} of its group starts without one")

    def _find_table(self, digest: bytes) -> CorrectionTable | None:
        axis = self._axis
        if axis.wanted.table_digest == digest:
            return axis.plan.table
        return None if self._find_elsewhere is None else self._find_elsewhere(digest)

    # --- for the run after -----------------------------------------------------------------------------

    def look(self) -> None:
        """Write down what has changed since it was written last."""
        if self._is_on_wire or self._is_paused or self.recalled is not None:
            return
        axis, pending = self._axis, self._pending
        if pending is not None:
            if axis.unproven is pending:
                return  # both are possible still, and the record says so
            self._pending = None
            self._seen = ()
        compensation = axis.compensation
        shadow = axis.last_shadow
        seen = (
            compensation.state,
            compensation.readback,
            compensation.accepted,
            axis.wanted,
            axis.is_branch_known,
            axis.arrival.stage,
            shadow is not None and not self._has_rules and _holds_its_words(shadow),
        )
        if seen != self._seen:
            self._seen = seen
            self._keep(None)

    def sending(self, rendering: Rendering) -> None:
        """A target goes out next: when the process dies now, the drive may hold it or not."""
        if self.recalled is not None:
            self.drop("a target came before the axis was read")
        if rendering.move is None and not rendering.is_distance:
            return  # a repeat changes nothing
        self._is_on_wire = True
        if rendering.move is None or self._pending is not None or not self._axis.is_branch_known:
            self.doubt()
            return
        self._pending = rendering
        self._keep(rendering)

    def stopping(self) -> None:
        """A stop goes out next: where the axis goes is not known from now on, only the way that it is on."""
        if self.recalled is not None:
            return
        if self._pending is not None:
            self.doubt()
            return
        self._is_on_wire = True
        self._seen = ()
        self._keep(None, has_target=False)

    def doubt(self) -> None:
        """Something goes out that moves the axis in a way that the record does not say."""
        if self.recalled is not None:
            self.drop("the axis was moved before it was read")
        self._is_on_wire = True
        self._pending = None
        self._seen = ()
        self._clear()

    def conclude(self) -> None:
        """What was sent has been answered, or never will be."""
        self._is_on_wire = False

    def pause(self) -> None:
        """The way to the drives is lost, or closed: what the record says stays true."""
        self._is_paused = True

    def go_on(self) -> None:
        """The way to the drives is there."""
        self._is_paused = False

    def _clear(self) -> None:
        if not self._is_empty:
            self._slots.clear()
            self._is_empty = True

    def _keep(self, pending: Rendering | None, *, has_target: bool = True) -> None:
        axis = self._axis
        compensation = axis.compensation
        low, high = compensation.way
        if not axis.is_branch_known or high > LARGEST_COUNTS or low < -LARGEST_COUNTS:
            self._clear()
            return
        state, accepted, shadow = compensation.state, compensation.accepted, axis.last_shadow
        _, _, _, anchor, fade, _ = compensation.readback
        move = None
        specs: Specs = (state.spec, state.previous, None, None, axis.wanted)
        if pending is not None and pending.move is not None:
            after = pending.move.state
            specs = (state.spec, state.previous, after.spec, after.previous, axis.wanted)
            number = axis.shadows.index(pending.shadow)
            ends = (pending.move.nominal_counts, pending.corrected_counts)
            move = (pending.is_distance, number, *ends, *_state_numbers(after))
        has_target = has_target and accepted is not None
        numbers = (
            has_target,
            has_target and _was_there(axis),
            has_target and axis.arrival.is_proven,
            has_target and axis.arrival.may_have_left,
            has_target and not self._has_rules and shadow is not None and _holds_its_words(shadow),
            0 if shadow is None else axis.shadows.index(shadow),
            *(accepted or _NO_TARGET),
            low,
            high,
            *_state_numbers(state),
            anchor,
            *(_NO_FADE if fade is None else (True, *fade)),
        )
        self._is_empty = False
        self._slots.write(numbers, move, specs)


def note_leaving(rewriting: Rewriting) -> int:
    """Keep what must be known if nobody lives to see the reply; return how many meanings are not known."""
    note_sending(rewriting)
    return note_unknown(rewriting.request.meanings)


def note_sending(rewriting: Rewriting) -> None:
    """Keep what must be known if nobody lives to see the reply."""
    for rendering in (*rewriting.renderings, *rewriting.runs):
        memory = rendering.axis.memory
        if memory is not None:
            memory.sending(rendering)
    for meaning in rewriting.request.meanings:
        memory = meaning.axis.memory
        if memory is None:
            continue
        runs_unknown = meaning.runs_alone and not any(run.axis is meaning.axis for run in rewriting.runs)
        if meaning.action is Action.STOP:
            memory.stopping()
        elif meaning.action in MOVES_OTHERWISE or meaning.is_doubtful or runs_unknown:
            memory.doubt()
    for axis, _ in rewriting.touched_blindly:
        if axis.memory is not None:
            axis.memory.doubt()
    for axis in (*rewriting.moved_unknown, *(rewriting.request.unit.axes if rewriting.remaps else ())):
        if axis.memory is not None:
            axis.memory.doubt()


def _was_there(axis: AxisExchange) -> bool:
    """Whether an axis was at its target so surely that a drive found elsewhere has been moved since."""
    accepted, actual, settings = axis.compensation.accepted, axis.actual, axis.plan.settings
    if axis.arrival.stage is not Stage.SEEN_THERE or accepted is None or actual is None:
        return axis.arrival.stage in WAS_THERE
    near = settings.hysteresis * abs(settings.counts_per_unit)
    return abs(actual.counts - accepted.corrected_counts) <= near


def _holds_its_words(shadow: Shadow) -> bool:
    """Whether the drive holds the words of the last target, and nothing was lost on the way there since."""
    return shadow.corrected_words is not None and shadow.nominal_words is not None and not shadow.is_torn


def _state_numbers(state: State) -> tuple[object, ...]:
    position, (direction, extreme), progress, _, _, change, change_distance, is_unsure, at_ns = state
    return (
        direction._value_,
        is_unsure,
        extreme if position is None else position,
        extreme,
        progress,
        change,
        change_distance,
        at_ns,
    )
