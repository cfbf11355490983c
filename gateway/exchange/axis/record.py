"""What the next run of the gateway must know of an axis, kept up to date at every moment.

After each input of the line the axis is compared with the newest record. So whatever changes the axis (a
stop, homing, a lost reply, a command) changes the record too. Some things cannot be observed afterwards. They
are written before a frame is sent (``axis``): the target in it, which the drive may have received when the
process dies; or, if the frame moves the axis in another way, that nothing is known.

At the start the record of the last run is compared with the position of the drive (:func:`find`).
:class:`Decision` says whether it counts; ``axis.recall`` restores the axis from it in one step.
"""

from collections.abc import Callable
from enum import Enum
from typing import Final

from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, spec_of_table, with_line
from gateway.compensation.direction import Direction, Travel
from gateway.compensation.fingerprint import scale_digest, table_digest
from gateway.compensation.moves import State, SteadyMove
from gateway.compensation.settings import AxisSettings, Gain
from gateway.compensation.table import CorrectionTable
from gateway.counts import Counts
from gateway.exchange.axis.acknowledge import Acknowledgement, OnWire, Proof
from gateway.exchange.axis.motion import MAY_BE_ELSEWHERE, ON_BRANCH, WAS_THERE, Actual, Motion, MotionState
from gateway.exchange.axis.record_layout import (
    RecordSlots,
    Remembered,
    RememberedSpec,
    RememberedState,
    Specs,
)
from gateway.exchange.plan import AxisPlan
from gateway.times import NS_PER_MS, NS_PER_S

LARGEST_COUNTS: Final = 2.0**53
"""Above it a double does not hold every whole count; such a target is not recorded."""
STILL_FOLLOWS_NS: Final = 5 * NS_PER_S
"""If the record is of this boot and no older than this, the drive may still follow its last setpoint."""
LONGEST_POLL_NS: Final = 100 * NS_PER_MS
"""How long the gateway checks whether the drive comes nearer."""
_NO_TARGET: Final[tuple[float, ...]] = (0.0, 0.0)
_NO_FADE: Final = (False, 0.0, 0.0, 0.0, 0.0)
_Base = tuple[State, CorrectionSpec, MotionState, bool, int | None, bool]
"""State before a run and the requested correction, both compared as objects; motion state, whether its start
was known, field, whether its words are known."""
FindTable = Callable[[bytes], CorrectionTable | None]
"""Returns the table with a digest (``compensation.fingerprint.table_digest``); None: not available."""


def digest_of_axis(plan: AxisPlan) -> bytes:
    """Digest of all that decides what an axis's counts mean: a record with another digest is void."""
    fields = [
        (f.address, f.type.value, f.order.value, float(f.scale), f.block)
        for f in (*plan.command, *plan.actual[:1])
    ]
    return scale_digest(plan.settings, (plan.unit_id, len(plan.command), tuple(fields)))


class Decision(Enum):
    """The decision about the record of the last run."""

    NONE = "none"
    """There was no record."""
    OPEN = "open"
    """It is not decided yet whether it counts."""
    FITS = "fits"
    """It counts, and waits for the records of the other axes of its group: all are restored, or none."""
    TAKEN = "taken"
    DROPPED = "dropped"


class Finding(Enum):
    """Where the drive was found, relative to its record."""

    AT_TARGET = "at-target"
    """At the last accepted target."""
    ON_WAY = "on-way"
    """On its way to that target, or on the way on which it was stopped."""
    AT_UNACKNOWLEDGED = "at-unproven"
    """At the target that was on the wire when the gateway ended: the drive received it."""
    ON_WAY_TO_UNACKNOWLEDGED = "on-way-to-unproven"
    """On its way to the unacknowledged target, where no other target can have brought it."""
    EITHER = "either"
    """At the unacknowledged target, and also on the way to the accepted one: its target is not known yet."""


PROVEN: Final = frozenset({Finding.AT_UNACKNOWLEDGED, Finding.ON_WAY_TO_UNACKNOWLEDGED})
"""Findings which prove that the drive received the unacknowledged target."""


class Record:
    """The record of one axis: what is written for the next run, and what the last run left.

    ``saved`` is the record of the last run, until it is decided whether it counts.
    """

    __slots__ = (
        "_base",
        "_find_elsewhere",
        "_is_empty",
        "_is_paused",
        "_slots",
        "_step",
        "_written",
        "decision",
        "finding",
        "first",
        "polls",
        "saved",
    )

    def __init__(
        self, slots: RecordSlots, saved: Remembered | None, find_table: FindTable | None = None
    ) -> None:
        self._slots = slots
        self._find_elsewhere = find_table
        self._is_empty = False
        self._is_paused = False
        self._written: tuple[object, ...] = ()
        """What the newest record says of the axis."""
        self._base: _Base | None = None
        """The part of it that does not change while setpoints continue in their direction; None: no step may
        follow."""
        self._step = (0, False)
        """The last step after it: number of accepted targets of the run, and whether one was on the wire."""
        self.decision = Decision.NONE if saved is None else Decision.OPEN
        self.saved = saved
        self.first: Actual | None = None
        """The first position that was read of the drive."""
        self.finding: tuple[Finding, Actual] | None = None
        self.polls = 0
        """Number of readings since then that were taken to decide whether the drive received its last
        target."""
        if saved is None:
            self.clear()

    # --- from the last run -----------------------------------------------------------------------------

    @property
    def wants_poll(self) -> bool:
        """Whether the drive must be read once more before the decision."""
        return self.decision is Decision.OPEN and self.first is not None

    def start_polling(self, actual: Actual) -> None:
        """Begin to watch the drive: one that comes nearer to its target is on its way there."""
        self.first = self.first or actual

    def count_poll(self) -> None:
        """Count a reading that is taken to decide whether the drive received its last target."""
        self.polls += 1

    def fit(self, finding: Finding, actual: Actual) -> None:
        """The record counts, as far as this axis is concerned."""
        self.decision, self.finding = Decision.FITS, (finding, actual)

    def decide(self, decision: Decision) -> None:
        """Set the decision; the saved record is dropped with it."""
        self.decision, self.saved, self.finding = decision, None, None

    def find_table(
        self, table: CorrectionTable | None, requested: CorrectionSpec, digest: bytes
    ) -> CorrectionTable | None:
        """Return the table with a digest: the configured one, or one that is kept elsewhere."""
        if requested.table_digest == digest or (table is not None and table_digest(table) == digest):
            return table
        return None if self._find_elsewhere is None else self._find_elsewhere(digest)

    # --- for the next run ------------------------------------------------------------------------------

    def publish(self, motion: Motion, acknowledgement: Acknowledgement, requested: CorrectionSpec) -> None:
        """Write what has changed since the last record."""
        if self._is_paused or self.saved is not None or acknowledgement.on_wire is not OnWire.NOTHING:
            return
        if acknowledgement.pending is not None:
            return  # the target may have arrived or not, and the record says so
        compensation = motion.compensation
        if self._goes_on(motion, requested):
            if self._step != (compensation.steps, False):
                self._slots.write_step(compensation.step, None)
                self._step = (compensation.steps, False)
            return
        now = (
            compensation.state,
            compensation.readback,
            compensation.accepted,
            requested,
            motion.state,
            motion.is_start_known,
            _knows_words(motion),
            motion.state is MotionState.IN_WINDOW and _was_there(motion),
        )
        if now != self._written:
            self._write(motion, acknowledgement, requested)
            self._written = now
            if compensation.is_stream and compensation.accepted is not None and not self._is_empty:
                number, knows_words = motion.last_number, _knows_words(motion)
                motion_state = (motion.state, motion.is_start_known)
                self._base = (compensation.base, requested, *motion_state, number, knows_words)
                self._step = (0, False)

    def write_ahead(
        self, motion: Motion, acknowledgement: Acknowledgement, requested: CorrectionSpec
    ) -> None:
        """Write the present state, and the frame that is about to be sent."""
        self._write(motion, acknowledgement, requested)
        self._written, self._base = (), None

    def write_step_ahead(
        self, motion: Motion, requested: CorrectionSpec, steady: SteadyMove, corrected_counts: Counts
    ) -> bool:
        """Do the same for a target that continues in its direction; return whether a step was enough."""
        if not (self._goes_on(motion, requested) and -LARGEST_COUNTS <= corrected_counts <= LARGEST_COUNTS):
            return False
        compensation = motion.compensation
        going = (steady.nominal_counts, corrected_counts, steady.position, steady.extreme, steady.now_ns)
        self._slots.write_step(compensation.step, going)
        self._step = (compensation.steps, True)
        return True

    def _goes_on(self, motion: Motion, requested: CorrectionSpec) -> bool:
        """Whether nothing but a run of targets has changed since the newest record."""
        base = self._base
        if base is None:
            return False
        state, asked, motion_state, is_start_known, number, knows_words = base
        return (
            motion.compensation.base is state
            and requested is asked
            and motion.state is motion_state
            and motion.is_start_known is is_start_known
            and motion.last_number == number
            and _knows_words(motion) is knows_words
        )

    def clear(self) -> None:
        """Write a record that says nothing."""
        self._written, self._base = (), None
        if not self._is_empty:
            self._slots.clear()
            self._is_empty = True

    def pause(self) -> None:
        """The link to the drives is lost or closed: what the record says stays true."""
        self._is_paused = True

    def go_on(self) -> None:
        """The link to the drives is up."""
        self._is_paused = False

    def _write(self, motion: Motion, acknowledgement: Acknowledgement, requested: CorrectionSpec) -> None:
        """Write the record of an axis. It depends only on the axis's state."""
        compensation, on_wire = motion.compensation, acknowledgement.on_wire
        low, high = compensation.way
        is_known = motion.state in ON_BRANCH and on_wire is not OnWire.MOTION
        if not is_known or high > LARGEST_COUNTS or low < -LARGEST_COUNTS:
            self.clear()
            return
        state, accepted, number = compensation.state, compensation.accepted, motion.last_number
        _, _, _, anchor, fade, _ = compensation.readback
        move = None
        pending = acknowledgement.pending if on_wire is OnWire.TARGET else None
        specs: Specs = (state.spec, state.previous, None, None, requested)
        if pending is not None and pending.move is not None:
            after = pending.move.state
            specs = (state.spec, state.previous, after.spec, after.previous, requested)
            ends = (pending.move.nominal_counts, pending.corrected_counts)
            move = (pending.is_distance, pending.number, *ends, *_state_numbers(after))
        has_target = accepted is not None
        numbers = (
            has_target,
            has_target and _was_there(motion),
            has_target and motion.state is MotionState.ARRIVED,
            has_target and motion.state in MAY_BE_ELSEWHERE,
            has_target and _knows_words(motion),
            0 if number is None else number,
            *(accepted or _NO_TARGET),
            low,
            high,
            *_state_numbers(state),
            anchor,
            *(_NO_FADE if fade is None else (True, *fade)),
        )
        self._is_empty = False
        self._slots.write(numbers, move, specs)


def _knows_words(motion: Motion) -> bool:
    """Whether the drive holds the words of the last target, so that a restart may recognise a repeat.

    Not if a write was lost since.
    """
    if motion.last_number is None or motion.has_rules:
        return False
    image = motion.fields[motion.last_number]
    return image.corrected_words is not None and image.nominal_words is not None and not image.is_incomplete


def _was_there(motion: Motion) -> bool:
    """Whether an axis was at its target so certainly that a drive found elsewhere was moved since."""
    accepted, actual, settings = motion.compensation.accepted, motion.actual, motion.plan.settings
    if motion.state is not MotionState.IN_WINDOW or accepted is None or actual is None:
        return motion.state in WAS_THERE
    near = settings.hysteresis_counts
    return abs(actual.counts - accepted.corrected_counts) <= near


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


# --- whether it counts -----------------------------------------------------------------------------


class TableNotFoundError(Exception):
    """A table that a record names is not available."""


def find(motion: Motion, record: Remembered, first: Actual, now: Actual) -> Finding | str | None:
    """Compare where the drive is with where its record says that it may be.

    Return a sentence if it cannot be there, None if it must be read once more.

    The drive of a stream lags behind. If it comes nearer to the last setpoint, it is on its way there, at any
    distance, if the record is only some seconds old.

    Args:
        motion: where the axis is; it is not changed.
        record: its record.
        first: the first position that was read.
        now: the last position that was read; at first the same.
    """
    finding = _find(motion, record, now.counts)
    move = record.unacknowledged
    is_distance = move is not None and move.is_distance
    if finding is Finding.EITHER and not (
        is_distance or proof_of(motion.plan.settings, record, finding) is Proof.TWO
    ):
        here, before = f"{now.counts:.10g} counts", f"{record.corrected_counts:.10g}"
        return f"the drive is at {here}: a lost target, and also on the way to the one before, {before}"
    if finding is not None:
        return finding
    if motion.compensation.is_stream and record.has_target and _is_recent(record, first):
        if _has_come_nearer(motion.plan.settings, record, first.counts, now.counts):
            return Finding.ON_WAY
        if now.seen_ns - first.seen_ns <= LONGEST_POLL_NS:
            return None
    low, high = record.way
    if record.was_at_target or low == high:
        where = f"at {record.corrected_counts:.10g}"
    else:
        where = f"between {low:.10g} and {high:.10g}"
    return f"the drive is at {now.counts:.10g} counts, and the record says {where}"


def _is_recent(record: Remembered, first: Actual) -> bool:
    at_ns = record.state.at_ns if record.unacknowledged is None else record.unacknowledged.state.at_ns
    return record.is_of_this_boot and 0 <= first.seen_ns - at_ns <= STILL_FOLLOWS_NS


def _has_come_nearer(settings: AxisSettings, record: Remembered, before: Counts, now: Counts) -> bool:
    """Whether the drive goes to one of the last two setpoints, by more than its jitter at standstill."""
    near = settings.hysteresis_counts
    targets = [record.corrected_counts]
    if record.unacknowledged is not None:
        targets.append(record.unacknowledged.corrected_counts)
    return any(abs(before - target) - abs(now - target) > near for target in targets)


def _find(motion: Motion, record: Remembered, counts: Counts) -> Finding | None:
    """Compare where the drive is with where it may be; None: the record cannot be true.

    Near both the accepted and the unacknowledged target, the nearer one counts. At an unacknowledged target
    that lies on the way to the accepted one, either may be its target. In a stream this case does not occur,
    because it goes from setpoint to setpoint.
    """
    settings = motion.plan.settings
    near = settings.hysteresis_counts
    low, high = record.way
    from_target = abs(counts - record.corrected_counts)
    is_at_target = record.has_target and from_target <= near
    is_on_way = is_at_target or (not record.was_at_target and low - near <= counts <= high + near)
    before = Finding.AT_TARGET if is_at_target else Finding.ON_WAY
    move = record.unacknowledged
    if move is None:
        return before if is_on_way else None
    from_move = abs(counts - move.corrected_counts)
    is_ambiguous = is_on_way and not (is_at_target or motion.compensation.is_stream)
    if from_move <= settings.in_position_counts and is_ambiguous:  # it may be some counts off
        return Finding.EITHER
    if from_move <= near and not (is_at_target and from_target <= from_move):
        return Finding.AT_UNACKNOWLEDGED
    if is_on_way:
        return before
    low, high = min(low, move.corrected_counts), max(high, move.corrected_counts)
    if low - near <= counts <= high + near:
        return Finding.ON_WAY_TO_UNACKNOWLEDGED
    return None


def proof_of(settings: AxisSettings, record: Remembered, finding: Finding) -> Proof:
    """Return what is needed to decide whether the target on the wire was executed.

    It is unknown what happened to a machine that was switched off since. Readings decide then only if the
    axis was found at the target before.
    """
    move = record.unacknowledged
    if move is None or not (move.is_distance or finding is Finding.EITHER):
        return Proof.ONE
    if not (record.has_target and (record.is_of_this_boot or finding is Finding.AT_TARGET)):
        return Proof.NONE
    distance_counts = abs(move.corrected_counts - record.corrected_counts)
    return Proof.TWO if distance_counts > 2.0 * settings.in_position_counts else Proof.NONE


def state_of(
    settings: AxisSettings,
    requested: CorrectionSpec,
    numbers: RememberedState,
    find_table: FindTable,
    now_ns: int,
) -> State:
    """Return the state of the compensation for recorded numbers.

    Raises:
        TableNotFoundError: a table is not available.
        TableError, SettingsError: a table does not fit the settings of the axis.
    """
    return State(
        position=numbers.position,
        travel=Travel(Direction(numbers.direction), numbers.extreme),
        progress=numbers.progress,
        spec=_spec(settings, requested, numbers.spec, find_table),
        previous=None
        if numbers.previous is None
        else _spec(settings, requested, numbers.previous, find_table),
        change=numbers.change,
        change_distance=numbers.change_distance,
        is_unsure=numbers.is_unsure,
        at_ns=min(numbers.at_ns, now_ns),  # the clock restarts with the machine
    )


def _spec(
    settings: AxisSettings, requested: CorrectionSpec, numbers: RememberedSpec, find_table: FindTable
) -> CorrectionSpec:
    """Return the correction for recorded numbers; the requested object itself if it is the same.

    Raises:
        TableNotFoundError: its table is not available.
        TableError, SettingsError: its table does not fit the settings of the axis.
    """
    if not numbers.digest:
        return CorrectionSpec(offset=numbers.offset) if numbers.offset else NOTHING
    gain = Gain(numbers.forward_gain, numbers.backward_gain)
    if numbers.was_requested and requested.table_digest == numbers.digest and requested.gain == gain:
        is_same = (requested.offset, requested.tilt) == (numbers.offset, numbers.tilt)
        return requested if is_same else with_line(requested, numbers.offset, numbers.tilt)
    table = find_table(numbers.digest)
    if table is None:
        raise TableNotFoundError
    found = spec_of_table(table, settings, gain, numbers.digest)
    return with_line(found, numbers.offset, numbers.tilt) if numbers.offset or numbers.tilt else found
