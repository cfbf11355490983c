"""What is added to an axis's table: the thermal growth of its screw, and the influence of other axes.

Both together are one line over the position of the axis (``compensation.correction_spec.with_line``). So it
is inverted, recorded and restored like every other correction, and it changes only with different targets.
This file computes which line is requested. It does so before a different target is rendered, when an update
is due (:meth:`Terms.is_due`); such a target takes the slow path.
"""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue import exchange_events
from gateway.compensation.axis import AxisCompensation
from gateway.compensation.blend import shape
from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, with_line
from gateway.compensation.errors import SettingsError
from gateway.compensation.thermal import TermState, Thermal
from gateway.exchange.axis.cross_term import CrossTerm, Partner
from gateway.exchange.events import Event
from gateway.exchange.plan import AxisPlan
from gateway.status.axis import CrossStatus, TermsStatus, ThermalStatus
from gateway.times import NS_PER_MS, NS_PER_S

UPDATE_NS: Final = 500 * NS_PER_MS
"""Longest time between temperature updates: at 2 K/min and 1 m of steel one step is 0.2 µm."""
ROUNDING: Final = 1e-9
"""Fraction of a limit by which decimal fractions may exceed it."""
FITS_AGAIN_NS: Final = 60 * NS_PER_S
"""A line must fit for this time before a misfit is reported again: a sensor value may jitter about the
limit."""
_EVENTS: Final = {
    TermState.FOLLOWING: exchange_events.TERM_FOLLOWS,
    TermState.HELD: exchange_events.TERM_HELD,
    TermState.FADING: exchange_events.TERM_FADES,
    TermState.FADED: exchange_events.TERM_FADES,
}
_SILENT: Final = frozenset({TermState.HELD, TermState.FADING, TermState.FADED})


class Terms:
    """The terms of one axis. Time is monotonic, in ns."""

    def __init__(self, plan: AxisPlan) -> None:
        settings = plan.settings
        self.thermal = None if plan.thermal is None else Thermal(plan.thermal)
        self.crosses = tuple(CrossTerm(each, plan) for each in plan.cross)
        self._fresh_ns = int(min((each.fresh_s for each in plan.cross), default=0.0) * NS_PER_S)
        self.offset = self.tilt = 0.0
        """The requested line: its value at machine position 0, in units, and its slope."""
        self.is_too_large = False
        """The computed line and the table together would exceed ``max_correction``."""
        self._ends = settings.travel or (0.0, 0.0)
        finest_counts = min(field.step_counts(settings.largest_counts) for field in plan.command)
        self._least = 0.5 * finest_counts / abs(settings.counts_per_unit)
        """Changes smaller than this cannot be expressed by any command field, in units."""
        self._due_ns = 0
        self._cross = self._held_cross = 0.0
        self._is_cross_known = False
        self._lost_ns: int | None = None
        """Since when the position of one of the other axes is unknown."""
        self._reported: dict[str, TermState] = {}
        self._began_ns: int | None = None
        self._was_missed = False
        self._too_large_reported_ns: int | None = None
        """When it was last seen to be too large, since that was reported."""

    # --- inputs ----------------------------------------------------------------------------------------

    def join(self, axes: Mapping[str, Partner]) -> None:
        """Find the other axes among these."""
        for cross in self.crosses:
            cross.join(axes)

    def take_temperature(self, celsius: float, now_ns: int) -> None:
        """Take a sensor value; it counts from the next update. Raises TemperatureError."""
        assert self.thermal is not None
        self.thermal.take(celsius, now_ns)
        self._due_ns = 0

    def resume(self, spec: CorrectionSpec, now_ns: int) -> None:
        """Continue from the line that was in force in another run.

        Without a line it is unknown whether that run had any values. The first sensor value then counts
        immediately, as at any start.
        """
        self.offset, self.tilt = spec.offset, spec.tilt
        self._due_ns = 0
        fixed_at = 0.0
        if self.thermal is not None:
            fixed_at = self.thermal.settings.fixed_at
            if spec.tilt:
                self.thermal.resume(-spec.tilt / self.thermal.settings.alpha, now_ns)
        if self.crosses and self._has_line:
            self._held_cross = self._cross = spec.offset + spec.tilt * fixed_at
            self._is_cross_known = True
            self._lost_ns = now_ns

    # --- the requested line ----------------------------------------------------------------------------

    def is_due(self, now_ns: int) -> bool:
        """Whether the line must be updated before the next target."""
        if now_ns >= self._due_ns:
            return True
        for cross in self.crosses:  # noqa: SIM110 (runs for each setpoint: no generator)
            if cross.target is not cross.seen:
                return True
        return False

    def follow(self, base: CorrectionSpec, plan: AxisPlan, now_ns: int) -> bool:
        """Compute the line again; return whether the requested line has changed."""
        self._due_ns = now_ns + UPDATE_NS
        offset, tilt = self._cross_now(now_ns), 0.0
        if self.thermal is not None:
            settings = self.thermal.settings
            tilt = -settings.alpha * self.thermal.follow(now_ns)
            offset -= tilt * settings.fixed_at
        low, high = self._ends
        more, steeper = offset - self.offset, tilt - self.tilt
        is_small = max(abs(more + steeper * low), abs(more + steeper * high)) < self._least
        if is_small and ((offset or tilt) or not self._has_line):
            self.is_too_large = False
            return not self._fits(base, plan, self.offset, self.tilt)  # limits may have been lowered
        self.is_too_large = not self._fits(base, plan, offset, tilt)
        if self.is_too_large:
            return not self._fits(base, plan, self.offset, self.tilt)
        self.offset, self.tilt = offset, tilt
        return True

    def on(self, base: CorrectionSpec, plan: AxisPlan) -> CorrectionSpec:
        """Return a table with the line, or without it if both together do not fit. A line needs a table."""
        if base is NOTHING or not self._has_line:
            return base
        if not self._fits(base, plan, self.offset, self.tilt):
            self.is_too_large = True
            self.offset = self.tilt = 0.0
            return base
        return with_line(base, self.offset, self.tilt)

    def largest_at(self, position: float) -> float:
        """Return the most that the terms can add at a machine position, in units."""
        largest = sum(cross.largest for cross in self.crosses)
        if self.thermal is not None:
            settings = self.thermal.settings
            largest += settings.alpha * settings.largest_dt * abs(position - settings.fixed_at)
        return largest

    @property
    def _has_line(self) -> bool:
        return bool(self.offset or self.tilt)

    def _fits(self, base: CorrectionSpec, plan: AxisPlan, offset: float, tilt: float) -> bool:
        low, high = self._ends
        largest = max(abs(offset + tilt * low), abs(offset + tilt * high))
        if base.curve is not None:
            largest += base.curve.max_correction
            try:
                with_line(base, offset, tilt)
            except SettingsError:
                return False
        return largest <= plan.settings.max_correction * (1.0 + ROUNDING)

    def _cross_now(self, now_ns: int) -> float:
        """Return the sum of the cross terms; held as a whole while the position of one axis is unknown."""
        if not self.crosses:
            return 0.0
        total, is_known = 0.0, True
        for cross in self.crosses:
            cross.refresh()
            position = cross.position(now_ns)
            if position is None:
                is_known = False
            else:
                total += cross.correction(position)
        if is_known:
            self._cross = self._held_cross = total
            self._lost_ns = None
            self._is_cross_known = True
        elif self._lost_ns is None:
            self._lost_ns = now_ns
        else:
            self._cross = self._held_cross * self._left(now_ns)
        return self._cross

    def _left(self, now_ns: int) -> float:
        """Return the remaining fraction of the cross terms, 1 to 0."""
        if self._lost_ns is None:
            return 1.0
        if not self._fresh_ns:
            return 0.0
        return min(1.0, max(0.0, 2.0 - (now_ns - self._lost_ns) / self._fresh_ns))

    # --- reports ---------------------------------------------------------------------------------------

    def cross_state(self, now_ns: int) -> TermState:
        """Return how well the positions of the other axes are known."""
        if all(cross.position(now_ns) is not None for cross in self.crosses):
            return TermState.FOLLOWING
        if not self._is_cross_known:
            return TermState.WAITING
        left = self._left(now_ns)
        if left == 1.0:
            return TermState.HELD
        return TermState.FADING if left else TermState.FADED

    def events(self, name: str, now_ns: int) -> list[Event]:
        """Return the events for what has changed since the last call; the terms themselves do not change."""
        found = []
        for kind, state in self.states(now_ns).items():
            reported = self._reported.get(kind, TermState.WAITING)
            if state is TermState.WAITING and kind == "thermal" and self._is_missed(now_ns):
                detail = "no temperature since the start: no correction"
                found.append(Event(exchange_events.TERM_HELD, name, detail, (("term", kind),)))
            if state is not reported:
                self._reported[kind] = state
                event = _EVENTS.get(state)
                # The position of another axis may become known and be lost again before it was used: the term
                # still waits then.
                if event is not None and event is not _EVENTS.get(reported):
                    found.append(Event(event, name, self._detail(kind, state), (("term", kind),)))
        reported_ns = self._too_large_reported_ns
        if self.is_too_large:
            self._too_large_reported_ns = now_ns
            if reported_ns is None:
                detail = "with the table it would come to more than max_correction; it does not follow"
                found.append(Event(exchange_events.TERM_TOO_LARGE, name, detail))
        elif reported_ns is not None and now_ns - reported_ns > FITS_AGAIN_NS:
            self._too_large_reported_ns = None
        return found

    def _is_missed(self, now_ns: int) -> bool:
        """Whether no value came since the start for longer than a sensor may be silent; true only once."""
        assert self.thermal is not None
        if self._began_ns is None:
            self._began_ns = now_ns
        if self._was_missed or now_ns - self._began_ns <= self.thermal.settings.timeout_s * NS_PER_S:
            return False
        self._was_missed = True
        return True

    def states(self, now_ns: int) -> dict[str, TermState]:
        """Return the state of each kind of term."""
        states = {}
        if self.thermal is not None:
            states["thermal"] = self.thermal.state(now_ns)
        if self.crosses:
            states["cross"] = self.cross_state(now_ns)
        return states

    def status(self, compensation: AxisCompensation, now_ns: int) -> TermsStatus:
        """Return its part of the status model. Corrections are in units, in force at the last target."""
        of_thermal, of_cross = self._in_force(compensation)
        total = None if of_thermal is None or of_cross is None else of_thermal + of_cross
        found = TermsStatus(correction=total, is_too_large=self.is_too_large)
        thermal = self.thermal
        if thermal is not None:
            state = thermal.state(now_ns)
            found.thermal = ThermalStatus(
                state=state.value,
                celsius=thermal.celsius,
                age_s=thermal.age_s(now_ns),
                difference=thermal.difference_at(now_ns),
                correction=of_thermal,
                is_silent=self._was_missed if state is TermState.WAITING else state in _SILENT,
            )
        if self.crosses:
            found.cross = CrossStatus(
                state=self.cross_state(now_ns).value,
                axes=[cross.axis for cross in self.crosses],
                correction=of_cross,
            )
        return found

    def _in_force(self, compensation: AxisCompensation) -> tuple[float, float] | tuple[None, None]:
        """Return the thermal and the cross correction in the last target, in units.

        Only the temperature tilts the line, and ``fixed_at`` stays in place. So the two can be separated. A
        correction without a table is an offset that was found; it contains no term.
        """
        state = compensation.state
        if compensation.accepted is None or state.position is None:
            return None, None
        fixed_at = 0.0 if self.thermal is None else self.thermal.settings.fixed_at
        weight = 1.0 if state.previous is None else shape(state.change)
        of_thermal = of_cross = 0.0
        for spec, share in ((state.spec, weight), (state.previous, 1.0 - weight)):
            if spec is not None and spec.curve is not None:
                of_thermal += share * spec.tilt * (state.position - fixed_at)
                of_cross += share * spec.line_at(fixed_at)
        return of_thermal, of_cross

    def _detail(self, kind: str, state: TermState) -> str:
        if kind == "thermal":
            assert self.thermal is not None
            difference = self.thermal.difference
            return f"{_OF_SENSOR[state]}; {difference:+.3g} K count"
        return f"{_OF_PARTNER[state]}: {', '.join(cross.axis for cross in self.crosses)}"


_OF_SENSOR: Final = {
    TermState.FOLLOWING: "the sensor reports",
    TermState.HELD: "the sensor is silent: its last value is held",
    TermState.FADING: "the sensor is still silent: the correction returns to 0",
    TermState.FADED: "the sensor is still silent: the correction is 0",
}
_OF_PARTNER: Final = {
    TermState.FOLLOWING: "the positions of the other axes are known",
    TermState.HELD: "the position of another axis is unknown; the correction is held",
    TermState.FADING: "the position of another axis is still unknown; the correction returns to 0",
    TermState.FADED: "the position of another axis is still unknown; the correction is 0",
}
