"""One axis: the state of its direction and blends, and the correction of targets and readings.

:meth:`AxisCompensation.plan` only computes; :meth:`AxisCompensation.commit` applies the result once the drive
has accepted the target. Nothing changes between the two, so a refused target leaves no trace.
"""

from collections.abc import Iterable
from itertools import product
from typing import Final

from gateway.catalogue import refusals
from gateway.compensation.blend import share_of, towards
from gateway.compensation.correction_map import IDENTITY, CorrectionMap
from gateway.compensation.correction_spec import (
    NOTHING,
    CorrectionSpec,
    changeover_distance,
    steepest_change,
    towards_line,
)
from gateway.compensation.direction import Direction, Travel, follow
from gateway.compensation.errors import OutOfTableError, OutsideTravelError
from gateway.compensation.moves import (
    Accepted,
    EstimateKind,
    Move,
    PositionEstimate,
    State,
    SteadyMove,
    advance_change,
    is_reversing,
    map_in_force,
)
from gateway.compensation.readback import Fade, Readback, after_target, reached
from gateway.compensation.settings import AxisSettings, OutsideKind, Setpoints
from gateway.counts import Counts
from gateway.times import NS_PER_MS

_new: Final = tuple.__new__
"""Makes a named tuple of its fields in their order, for half the cost of calling its class."""
FORWARD: Final = Direction.FORWARD
JUST_BELOW: Final = 1.0 - 1e-6
"""A distance of exactly the hysteresis must reach it, whatever floating point does."""


class AxisCompensation:
    """Compensation of one axis. Its arguments and results are counts, nominal or corrected.

    ``counts = zero_counts + counts_per_unit * (nominal + machine_offset)``
    """

    def __init__(self, settings: AxisSettings) -> None:
        self.settings = settings
        self._hysteresis = settings.hysteresis * JUST_BELOW
        self._state = State()
        self._readback = Readback(settings.counts_per_unit, settings.zero_counts)
        self._way = (0.0, 0.0)
        self._steps = 0
        """Number of targets of the present run: accepted since the three values above were computed, each
        continuing from the one before."""
        self._before_last = Accepted(0, 0)
        """The last target but one of the run."""
        self.accepted: Accepted | None = None
        """The last accepted target; None: none yet, or the target in the drive is unknown."""
        self._position = self._extreme = 0.0
        self._at_ns = 0
        self._requested = NOTHING
        self._changeover_distance = settings.reload_distance
        self._actual_counts: Counts | None = None
        self._map_key: tuple[object, ...] = ()
        self._map = IDENTITY
        self.is_steady = False
        """Whether the requested branch is completely in force: :meth:`plan_steady` may be called."""
        self._steady_map = IDENTITY
        self.is_stream = settings.setpoints is Setpoints.STREAM
        """Whether a setpoint comes each cycle."""
        self._counts_per_unit, self._zero_counts = settings.counts_per_unit, settings.zero_counts
        self._refuses_outside = settings.outside.kind is OutsideKind.REFUSE
        self._lowest, self._highest = settings.corrected_bounds

    @property
    def state(self) -> State:
        """The state after the last accepted target."""
        if self._steps:
            self._end_run()
        return self._state

    @property
    def readback(self) -> Readback:
        """The conversion of readings."""
        if self._steps:
            self._end_run()
        return self._readback

    @property
    def way(self) -> tuple[float, float]:
        """Corrected counts between which the axis moves for the last accepted target, lower one first."""
        if self._steps:
            self._end_run()
        return self._way

    def take_limits(self, settings: AxisSettings) -> None:
        """Take the limits of other settings, which are equal in everything else."""
        self.settings = settings
        self._lowest, self._highest = settings.corrected_bounds

    @property
    def base(self) -> State:
        """The state after the last target before a run; only the same object is the same base."""
        return self._state

    @property
    def steps(self) -> int:
        """Targets of a run accepted since then."""
        return self._steps

    @property
    def step(self) -> tuple[object, ...]:
        """The last target but one of a run and the last one; empty without a run.

        Nominal and corrected counts of each, position and extreme of the travel, time in ns.
        """
        if not self._steps or self.accepted is None:
            return ()
        from_nominal, from_corrected = self._before_last
        to_nominal, to_corrected = self.accepted
        return (
            from_nominal, from_corrected, to_nominal, to_corrected,
            self._position, self._extreme, self._at_ns,
        )  # fmt: skip

    @property
    def is_unsure(self) -> bool:
        """Whether the branch of the last accepted target was only assumed; that of a run never is."""
        return not self._steps and self._state.is_unsure

    @property
    def is_passing(self) -> bool:
        """Whether no correction is in force or requested: words pass unchanged."""
        state = self._state  # a run changes nothing of what counts here
        return self._requested is NOTHING and state.spec is NOTHING and state.previous is None

    @property
    def is_blending(self) -> bool:
        """Whether a reversal or a change-over is in progress."""
        state = self._state
        return state.previous is not None or state.spec is not self._requested or is_reversing(state)

    def machine_position(self, counts: Counts) -> float:
        """Return the machine position of a count on either scale, in units."""
        return (counts - self.settings.zero_counts) / self.settings.counts_per_unit

    def is_outside(self, counts: Counts) -> bool:
        """Whether this nominal position is outside the requested table."""
        curve = self._requested.curve
        return curve is not None and not curve.covers(self.machine_position(counts))

    def want(self, spec: CorrectionSpec) -> None:
        """Request another correction. It comes into force with different targets, never without one."""
        if spec is not self._requested:
            self._requested = spec
            self._measure_change()
            self._update_steadiness()

    def assume_offset(
        self, actual_counts: Counts, nominal_counts: Counts, specs: Iterable[CorrectionSpec], slack: float
    ) -> float:
        """Derive the offset in force when setpoints begin to stream: drive position less command.

        The offset is limited to what a correction can be: between 0 and the corrections of both branches of
        ``specs``, at the drive's position and at the setpoint, plus ``slack``. So the axis does not move if
        the controller read 1:1 until now and holds its setpoint. Nor does it move if the correction was in
        force before.

        Args:
            actual_counts: position of the drive.
            nominal_counts: the first setpoint.
            specs: the corrections that may have been in force.
            slack: resolution of the registers plus what terms may have added, in units.

        Returns:
            The part that is no correction and therefore motion, in units.
        """
        offset = (actual_counts - nominal_counts) / self.settings.counts_per_unit
        drive, setpoint = self.machine_position(actual_counts), self.machine_position(nominal_counts)
        bounds = [0.0]
        for spec, forward_share in product(specs, (0.0, 1.0)):
            branch = spec.map_at(forward_share)
            bounds.append(branch.correction(setpoint))
            bounds.append(branch.solve(drive, drive - branch.correction(drive)).correction)
        taken = min(max(offset, min(bounds) - slack), max(bounds) + slack)
        self._stand_on(taken)
        return offset - taken

    def _stand_on(self, offset: float) -> None:
        """Put a constant offset completely into force."""
        spec = CorrectionSpec(offset=offset) if offset else NOTHING
        self._state = self.state._replace(spec=spec, previous=None, change=1.0)
        self._measure_change()
        self._update_steadiness()

    def lose_reference(self) -> None:
        """Request no correction until the axis is referenced again: positions have no meaning.

        Targets pass 1:1 from now on. A stream keeps its offset, which fades with different setpoints.
        """
        state, anchor_counts = self.state, self.readback.anchor_counts
        self.begin_anew()
        if not self.is_stream or state.position is None:
            return
        self._state = state
        self._stand_on(self.map_of(state).correction(state.position))
        self._readback = Readback(
            self._counts_per_unit, self._zero_counts, self.map_of(self.state), anchor_counts
        )

    def begin_anew(self) -> None:
        """Pass 1:1 from now on, and request nothing: earlier positions are no longer valid."""
        self._steps = 0
        self._state = State()
        self.accepted = None
        self._requested = NOTHING
        self._actual_counts = None
        self._readback = Readback(self._counts_per_unit, self._zero_counts)
        self._update_steadiness()

    def read_as_set(self) -> None:
        """Its position was set: it reads 1:1 until the next target, and what was read before is void."""
        self._actual_counts = None
        self._readback = Readback(self._counts_per_unit, self._zero_counts)
        self._update_steadiness()

    def end_dry_run(self) -> None:
        """Discard the computed state: the drive never had it, and holds the last target as commanded.

        The state is then as after passing the same targets 1:1; no correction is requested yet.
        """
        state, accepted = self.state, self.accepted
        self.begin_anew()
        self._state = state._replace(spec=NOTHING, previous=None, change=1.0, change_distance=0.0)
        if accepted is not None:
            here = accepted.nominal_counts
            self.accepted, self._way = Accepted(here, here), (here, here)

    def find_reference(self, spec: CorrectionSpec) -> None:
        """The axis is referenced: request ``spec``, on the branch on which homing ended.

        If setpoints stream already, the correction in force changes over to ``spec``.
        """
        if self.settings.setpoints is Setpoints.TARGETS or self.state.position is None:
            approach = Direction(self.settings.home_approach)
            self._state = State(travel=Travel(approach, 0.0), progress=approach.goal)
        self.want(spec)
        self._update_steadiness()

    def forget_target(self) -> None:
        """Forget the target: the drive may hold another one. The next target is never taken for a repeat."""
        if self._steps:
            self._end_run()
        self.accepted = None

    def invalidate(self) -> None:
        """Mark the branch in force as only assumed."""
        self._state = self.state._replace(is_unsure=True)

    @property
    def is_seen(self) -> bool:
        """Whether an actual position has come since the last target was accepted."""
        return self._actual_counts is not None

    def observe(self, actual_counts: Counts) -> None:
        """Take the drive's actual position: a fade begins there, and one that has ended there is over."""
        self._actual_counts = actual_counts
        readback = self.readback
        if readback.is_faded_out(actual_counts):
            self._readback = readback.without_fade()

    def again(self) -> Move:
        """Return the last accepted target as a move: the same correction, and no change of state."""
        assert self.accepted is not None
        nominal_counts, corrected_counts = self.accepted
        correction_map = self.readback.correction_map
        return Move(nominal_counts, corrected_counts - nominal_counts, correction_map, self.state)

    def touch(self, now_ns: int) -> None:
        """Record that the same setpoint came again: a blend by time pauses meanwhile."""
        self._state = self.state._replace(at_ns=now_ns)

    def plan(self, nominal_counts: Counts, estimate: PositionEstimate | None, now_ns: int) -> Move:
        """Compute the correction of a target. Nothing changes until :meth:`commit`.

        Args:
            nominal_counts: the target as commanded.
            estimate: position of the axis, if it is known; only used if the drive profiles the move.
            now_ns: monotonic time.

        Raises:
            OutOfTableError: outside the table of an axis whose policy is ``refuse``.
            OutsideTravelError: the corrected position leaves the travel by more than the margin.
        """
        position = self.machine_position(nominal_counts)
        state = self._stream(position, now_ns) if self.is_stream else self._target(position, estimate, now_ns)
        if self._refuses_outside:
            self._check_covered(state, position)
        correction_map = self.map_of(state)
        correction = correction_map.correction(position)
        # Without a requested correction only a constant offset is left: the axis position is unknown.
        knows_position = self._requested is not NOTHING or bool(correction_map.terms)
        if knows_position and not correction_map.is_identity:
            self._check_travel(position, correction)
        return Move(nominal_counts, correction * self.settings.counts_per_unit, correction_map, state)

    def commit(
        self,
        move: Move,
        corrected_counts: Counts,
        *,
        is_reached: bool = False,
    ) -> None:
        """Take a planned target as accepted by the drive, with the counts that were sent.

        Args:
            move: as :meth:`plan` returned it.
            corrected_counts: the counts that the drive was sent.
            is_reached: the axis is at the previous target, whatever was read on the way there.
        """
        if self._steps:
            self._end_run()
        accepted, seen = self.accepted, self._actual_counts
        has_target = accepted is not None
        before = corrected_counts if accepted is None else accepted.corrected_counts
        actual = before if seen is None or (is_reached and has_target) else seen
        low, high = (before, corrected_counts) if before < corrected_counts else (corrected_counts, before)
        low, high = min(low, actual), max(high, actual)
        is_way_unknown = seen is None and has_target and not is_reached and not self.is_stream
        if is_way_unknown:  # the axis may be anywhere on its previous way
            low, high = min(low, self._way[0]), max(high, self._way[1])
        self._way = (low, high)
        target = Accepted(move.nominal_counts, corrected_counts)
        is_there = has_target and actual == before
        self._readback = after_target(
            self._readback, move.correction_map, target, actual, is_at_target=is_there
        )
        goes_on = self._goes_on(move)
        is_other = move.state.spec is not self._state.spec
        self._state = move.state
        if is_other:  # another correction may have been requested meanwhile
            self._measure_change()
        self.accepted = target
        self._actual_counts = None
        if not goes_on:
            self._update_steadiness()

    def plan_steady(self, nominal_counts: Counts, now_ns: int, is_reached: bool) -> SteadyMove | None:
        """Compute a target that continues in its direction, while ``is_steady``; None: call :meth:`plan`.

        The result is that of :meth:`plan`, in a fraction of its time.

        Args:
            nominal_counts: the target as commanded.
            now_ns: monotonic time.
            is_reached: the last accepted target is known to be reached.
        """
        accepted, position = self.accepted, (nominal_counts - self._zero_counts) / self._counts_per_unit
        if accepted is not None and accepted.nominal_counts == nominal_counts:
            return None
        direction, extreme = self._state.travel
        if self._steps:
            extreme = self._extreme
        slack = self._hysteresis
        if not self.is_stream:
            if accepted is None or not is_reached:
                return None
            extreme = (accepted.nominal_counts - self._zero_counts) / self._counts_per_unit
            slack = 0.0
        behind = extreme - position if direction is FORWARD else position - extreme
        if behind > 0.0:
            if behind >= slack:
                return None
        else:
            extreme = position
        if self._refuses_outside and not self._is_covered(position):
            return None
        correction_map = self._steady_map
        if correction_map.is_identity:
            return SteadyMove(nominal_counts, 0.0, position, extreme, now_ns, self._state, correction_map)
        correction = correction_map.correction(position)
        if not self._lowest <= position + correction <= self._highest:
            return None
        counts = correction * self._counts_per_unit
        return SteadyMove(nominal_counts, counts, position, extreme, now_ns, self._state, correction_map)

    def steady_correction(self, nominal_counts: Counts) -> float:
        """Return what :meth:`plan_steady` adds to a target, in counts, if it returns a move.

        When the target rises, target plus correction never falls: slopes stay above -1.
        """
        position = (nominal_counts - self._zero_counts) / self._counts_per_unit
        return self._steady_map.correction(position) * self._counts_per_unit

    def move_of(self, steady: SteadyMove) -> Move:
        """Return a steady move with the state that accepting it leads to, as :meth:`plan` would."""
        state = self._state_after(steady.before, steady.position, steady.extreme, steady.now_ns)
        return _new(Move, (steady.nominal_counts, steady.correction_counts, steady.correction_map, state))

    def _state_after(self, before: State, position: float, extreme: float, now_ns: int) -> State:
        """Return the state after a target that continues in its direction."""
        is_stream = self.is_stream
        return _new(
            State,
            (
                position,
                _new(Travel, (before.travel.direction, extreme)),
                before.progress,
                before.spec,
                None,
                before.change if is_stream else 1.0,
                before.change_distance if is_stream else 0.0,
                False,
                now_ns,
            ),
        )

    def go_on(self, steady: SteadyMove, corrected_counts: Counts, *, is_reached: bool) -> None:
        """Take a steady move as accepted by the drive, as :meth:`commit` would, in a fraction of its time.

        The state after it is computed only when it is read, and only for the last target of the run.

        Args:
            steady: as :meth:`plan_steady` returned it.
            corrected_counts: the counts that the drive was sent.
            is_reached: as of :meth:`commit`.
        """
        accepted = self.accepted
        if (
            accepted is None
            or not self.is_steady
            or steady.before is not self._state
            or steady.correction_map is not self._steady_map
            or not (self._actual_counts is None or is_reached)
        ):
            self.commit(self.move_of(steady), corrected_counts, is_reached=is_reached)
            return
        self._before_last = accepted
        self.accepted = _new(Accepted, (steady.nominal_counts, corrected_counts))
        self._position, self._extreme, self._at_ns = steady.position, steady.extreme, steady.now_ns
        self._actual_counts = None
        self._steps += 1

    def _end_run(self) -> None:
        """Compute the state after the last target of a run."""
        steps, self._steps = self._steps, 0
        correction_map, before, accepted = self._steady_map, self._readback, self.accepted
        assert accepted is not None
        if steps > 1:
            before = reached(before, correction_map, self._before_last)
        self._state = self._state_after(self._state, self._position, self._extreme, self._at_ns)
        came_from, corrected = self._before_last.corrected_counts, accepted.corrected_counts
        self._readback = after_target(before, correction_map, accepted, came_from, is_at_target=True)
        self._way = (came_from, corrected) if came_from < corrected else (corrected, came_from)

    def _is_covered(self, position: float) -> bool:
        curve = self._state.spec.curve
        return curve is None or curve.covers(position)

    def _goes_on(self, move: Move) -> bool:
        """Whether the axis was steady and stays so after a move."""
        state, before = move.state, self._state  # a run changes nothing of what counts here
        return (
            self.is_steady
            and move.correction_map is self._steady_map
            and state.spec is self._requested
            and state.previous is None
            and not state.is_unsure
            and state.travel.direction is before.travel.direction
            and state.progress == before.progress
        )

    def _update_steadiness(self) -> None:
        state = self.state
        self._steady_map = self.readback.correction_map
        self.is_steady = (
            state.position is not None
            and state.previous is None
            and state.spec is self._requested
            and state.travel.direction is not Direction.UNKNOWN
            and state.progress == state.travel.direction.goal
            and not state.is_unsure
            and self._steady_map is self.map_of(state)
        )

    def accept_again(self, target: Accepted) -> None:
        """Take the axis as at a target that the drive accepted before: later ones were not executed."""
        if self._steps:
            self._end_run()
        self.accepted = target
        self._readback = reached(self._readback, self.map_of(self._state), target)

    def read_as_reached(self, move: Move, corrected_counts: Counts) -> None:
        """Convert readings as if the axis were at a target that it may not have reached."""
        target = Accepted(move.nominal_counts, corrected_counts)
        self._readback = reached(self.readback, move.correction_map, target)

    def resume(
        self,
        state: State,
        accepted: Accepted | None,
        anchor_counts: float,
        fade: Fade | None,
        way: tuple[float, float],
        *,
        came_from: Accepted | None = None,
    ) -> None:
        """Continue from the state of another run of the gateway; the requested correction stays.

        ``came_from``: the target before the last one; anchor and fade are then computed from it.
        """
        self._steps = 0
        self._state = state
        self.accepted = accepted
        self._way = way
        self._readback = Readback(
            self._counts_per_unit, self._zero_counts, self.map_of(state), anchor_counts, fade
        )
        if came_from is not None and accepted is not None:
            correction_map = self.map_of(state)
            self._readback = after_target(
                reached(self._readback, correction_map, came_from), correction_map, accepted,
                came_from.corrected_counts, is_at_target=True,
            )  # fmt: skip
        self._actual_counts = None
        self._measure_change()
        self._update_steadiness()

    def _measure_change(self) -> None:
        if self.settings.setpoints is Setpoints.STREAM:
            self._changeover_distance = changeover_distance(self.state.spec, self._requested, self.settings)

    def _target(self, position: float, estimate: PositionEstimate | None, now_ns: int) -> State:
        direction, is_unsure = self._direction(position, estimate)
        travel = Travel(direction, position)
        return State(
            position, travel, direction.goal, spec=self._requested, is_unsure=is_unsure, at_ns=now_ns
        )

    def _direction(self, position: float, estimate: PositionEstimate | None) -> tuple[Direction, bool]:
        """Return the direction of a move to ``position``, and whether it is only assumed (M6)."""
        kept = self.state.travel.direction
        if estimate is None:
            return kept, True
        if estimate.kind is EstimateKind.ON_DRIVE:
            return self._direction_from_drive(position, self.machine_position(estimate.counts), kept)
        if estimate.kind is EstimateKind.ON_WAY:
            return self._direction_on_way(position, self.machine_position(estimate.counts), kept)
        if self._is_same_again(position):
            return kept, self.state.is_unsure
        distance = position - self.machine_position(estimate.counts)
        is_short = estimate.kind is EstimateKind.MEASURED and abs(distance) < self._hysteresis
        if distance:
            kept = Direction.FORWARD if distance > 0 else Direction.BACKWARD
        return kept, is_short or estimate.kind is EstimateKind.ASSUMED

    def _is_same_again(self, position: float) -> bool:
        """Whether a target repeats the last one, apart from the controller's jitter."""
        accepted, within = self.accepted, self.settings.repeat_within_counts
        if accepted is None or not within:
            return False
        distance = abs(position - self.machine_position(accepted.nominal_counts))
        return distance * abs(self._counts_per_unit) <= within / JUST_BELOW

    def _direction_from_drive(
        self, position: float, actual: float, kept: Direction
    ) -> tuple[Direction, bool]:
        """Decide on the drive's scale, where no branch needs to be known.

        If the axis is where one branch puts the target, it got there on that branch. Otherwise the direction
        is certain only if the axis is outside the range of both branches for the target.
        """
        forward = position + self._requested.correction(position, is_forward=True)
        backward = position + self._requested.correction(position, is_forward=False)
        is_at_forward = abs(actual - forward) <= self._hysteresis
        is_at_backward = abs(actual - backward) <= self._hysteresis
        if is_at_forward and is_at_backward:
            return kept, False
        if is_at_forward or is_at_backward:  # first: whole counts may lie just outside of both
            return (Direction.FORWARD if is_at_forward else Direction.BACKWARD), False
        if min(forward, backward) <= actual <= max(forward, backward):
            return kept, True
        return (Direction.FORWARD if actual < forward else Direction.BACKWARD), False

    def _direction_on_way(self, position: float, actual: float, kept: Direction) -> tuple[Direction, bool]:
        """Do the same for a moving axis: its position at one moment does not prove a branch."""
        forward = position + self._requested.correction(position, is_forward=True)
        backward = position + self._requested.correction(position, is_forward=False)
        if actual < min(forward, backward) - self._hysteresis:
            return Direction.FORWARD, False
        if actual > max(forward, backward) + self._hysteresis:
            return Direction.BACKWARD, False
        return kept, True

    def _stream(self, position: float, now_ns: int) -> State:
        state = self.state
        distance = 0.0 if state.position is None else abs(position - state.position)
        elapsed_ms = (now_ns - state.at_ns) / NS_PER_MS
        travel = state.travel if state.position is not None else Travel(state.travel.direction, position)
        travel = follow(travel, position, self._hysteresis)
        was_reversing = is_reversing(state)
        state = State(
            position, travel, state.progress, state.spec, state.previous, state.change,
            state.change_distance, False, now_ns,
        )  # fmt: skip
        if state.previous is not None:  # one blend at a time: a reversal waits for the change-over
            return advance_change(state, distance)
        if is_reversing(state):
            if not distance:
                return state
            share = 1.0
            if state.spec.curve:
                share = share_of(state.spec.reversal, distance, elapsed_ms if was_reversing else 0.0)
            return state._replace(progress=towards(state.progress, travel.direction.goal, share))
        if state.spec is not self._requested:
            if state.spec.is_kin_of(self._requested):
                most = steepest_change(state.spec, self._requested, self.settings.max_slope) * distance
                return state._replace(spec=towards_line(state.spec, self._requested, position, most))
            return state._replace(
                previous=state.spec,
                spec=self._requested,
                change=0.0,
                change_distance=self._changeover_distance,
            )
        return state

    def map_of(self, state: State) -> CorrectionMap:
        """Return the correction that a state puts into force."""
        key = (state.spec, state.previous, state.change, state.progress)
        if key != self._map_key:
            self._map = map_in_force(state)
            self._map_key = key
        return self._map

    def _check_covered(self, state: State, position: float) -> None:
        curve = state.spec.curve
        if curve and not curve.covers(position):
            first, last = curve.table.first, curve.table.last
            raise OutOfTableError(refusals.OUTSIDE_TABLE.sentence(position=position, first=first, last=last))

    def _check_travel(self, position: float, correction: float) -> None:
        corrected = position + correction
        if self.settings.travel is not None and not self._lowest <= corrected <= self._highest:
            low, high = self.settings.travel
            margin, units = self.settings.travel_margin, self.settings.units.value
            raise OutsideTravelError(
                refusals.OUTSIDE_TRAVEL.sentence(
                    position=corrected, low=low, high=high, margin=margin, units=units
                )
            )
