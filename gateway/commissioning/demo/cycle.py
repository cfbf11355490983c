"""One round of the demonstration: measure, build the table, compare the machine without and with it.

The steps write its state into :class:`View`; the screen and the report read it.
"""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Final

from gateway.commissioning.demo.machine import AXES, AxisSpec, Rig, RigAxis, write_configuration, write_table
from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.config.load import load
from gateway.metrology.build import Fit, HomeReference
from gateway.metrology.cycle import Stop, bidirectional_cycle
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.recipe import Recipe, build_from
from gateway.relay.gateway import Relay
from gateway.simulator.clock import scaled_clock
from gateway.simulator.controller import Arrival, AxisController
from gateway.simulator.errors import SimulatorError


class DemoPhase(Enum):
    """Steps of one round in order, in words for a person."""

    WAITING = "waiting"
    HOMING = "homing"
    MEASURING = "measuring with the laser, no correction"
    WITHOUT = "random targets from both sides, without correction"
    MEASURING_WITH = "measuring with the laser, with correction"
    WITH = "the same targets, with correction"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Judged:
    """One stop: the true position of the nut and the position that the controller requested."""

    nominal: float
    direction: Direction
    error_um: float


@dataclass(slots=True)
class AxisView:
    """The present state of one axis. Positions in its units."""

    spec: AxisSpec
    backlash_um: float
    pitch_error_um: float
    """Range of the screw's own error over the table, without backlash."""
    phase: DemoPhase = DemoPhase.WAITING
    stops_done: int = 0
    stops_total: int = 0
    nominal: float = 0.0
    commanded: float = 0.0
    """The position that the drive received: nominal plus correction."""
    nut: float = 0.0
    stops: int = 0
    inexact_readbacks: int = 0
    before: list[Reading] = field(default_factory=list)
    """Laser readings at its targets without correction; the table is made from them."""
    after: list[Reading] = field(default_factory=list)
    """Laser readings there with correction; only for a report."""
    measured: list[Judged] = field(default_factory=list)
    without: list[Judged] = field(default_factory=list)
    corrected: list[Judged] = field(default_factory=list)
    table: CorrectionTable | None = None

    @property
    def error_without_um(self) -> float:
        """Worst error of the nut without correction."""
        return worst_um(self.without)

    @property
    def error_with_um(self) -> float:
        """Worst error of the nut with correction."""
        return worst_um(self.corrected)

    @property
    def is_readback_exact(self) -> bool:
        """Whether the controller read back exactly what it commanded, at every stop so far."""
        return self.stops > 0 and self.inexact_readbacks == 0


class DemoObserver:
    """Receives the events of a round; this one ignores them."""

    def on_view(self, view: "View") -> None:
        """A round begins; its state is in ``view``."""

    def on_phase(self, axis: AxisView) -> None:
        """A step of an axis begins."""

    def on_end(self, view: "View") -> None:
        """The round is over."""


@dataclass(slots=True)
class View:
    """The whole machine, and the observer of its steps."""

    seed: int
    axes: dict[str, AxisView]
    listener: DemoObserver

    def begin(self, axis: AxisView, phase: DemoPhase, stops: int) -> None:
        """A step of an axis begins."""
        axis.phase, axis.stops_done, axis.stops_total = phase, 0, stops
        self.listener.on_phase(axis)


def worst_um(judged: list[Judged]) -> float:
    """Largest error as an absolute value; 0 before the first stop."""
    return max((abs(stop.error_um) for stop in judged), default=0.0)


TARGETS: Final = 60
LINES_UP_TIMEOUT_S: Final = 10.0
UM_PER_MM: Final = 1000.0


async def run_round(
    seed: int, folder: Path, speed_up: float, listener: DemoObserver, report_runs: int = 0
) -> View:
    """Run all steps on all axes at the same time and return the final state.

    Time on the simulated machine runs ``speed_up`` times as fast; the bytes on the cables do not. With
    ``report_runs`` the laser makes this many passes in each direction, and repeats them with the correction
    in force. Otherwise it makes one pass, for the table.
    """
    async with Rig(AXES, seed, scaled_clock(speed_up)) as rig:
        view = View(seed, {axis.spec.name: _axis_view(axis) for axis in rig.axes}, listener)
        listener.on_view(view)
        round_ = _Round(rig, view, max(1, report_runs))
        async with running_gateway(write_configuration(folder, rig.axes, corrected=False)):
            await round_.on_all_axes(round_.measure)
            await round_.on_all_axes(round_.judge_without)
        for axis in rig.axes:
            table = view.axes[axis.spec.name].table
            assert table is not None
            write_table(folder, axis, table)
        async with running_gateway(write_configuration(folder, rig.axes, corrected=True)):
            if report_runs:
                await round_.on_all_axes(round_.measure_with)
            await round_.on_all_axes(round_.judge_with)
        for axis_view in view.axes.values():
            view.begin(axis_view, DemoPhase.DONE, 0)
        listener.on_end(view)
        return view


@asynccontextmanager
async def running_gateway(configuration: Path) -> AsyncIterator[Relay]:
    """Run the real gateway from a configuration file in this process."""
    relay = Relay(load(configuration).plan)
    await relay.start()
    try:
        await _all_lines_up(relay)
        yield relay
    finally:
        await relay.stop()


async def _all_lines_up(relay: Relay) -> None:
    """Wait until the gateway, which connects in the background, has reached its drives."""
    loop = asyncio.get_running_loop()
    give_up_s = loop.time() + LINES_UP_TIMEOUT_S
    while down := _lines_down(relay):
        if loop.time() > give_up_s:
            raise SimulatorError(f"the gateway did not reach the drives of line {', '.join(down)}")
        await asyncio.sleep(0.005)


def _lines_down(relay: Relay) -> list[str]:
    return [name for name, line in relay.status().lines.items() if line.state != "up"]


def _axis_view(axis: RigAxis) -> AxisView:
    spec = axis.spec
    deviations_um = [axis.mechanics.screw.deviation_mm(x * spec.mm) * UM_PER_MM for x in spec.measured]
    pitch_error_um = max(deviations_um) - min(deviations_um)
    return AxisView(spec, axis.mechanics.backlash_mm * UM_PER_MM, pitch_error_um)


@dataclass(frozen=True, slots=True)
class _Station:
    """One axis with its connected controller and its part of the view."""

    axis: RigAxis
    view: AxisView
    controller: AxisController

    def add(self, arrival: Arrival) -> None:
        """Record the state at a stop."""
        axis, view = self.axis, self.view
        view.stops_done += 1
        view.stops += 1
        view.inexact_readbacks += not arrival.is_exact
        view.nut = axis.laser.true_mm(axis.clock()) / axis.spec.mm
        view.nominal = axis.spec.wiring.nominal(arrival.commanded_counts)
        view.commanded = axis.spec.wiring.nominal(axis.mechanics.target_counts)

    def judged(self, arrival: Arrival, nut: float) -> Judged:
        """Compare the position of the nut with the one that the controller requested."""
        error_um = (nut - self.view.nominal) * self.axis.spec.mm * UM_PER_MM
        return Judged(self.view.nominal, arrival.stop.direction, error_um)


_Step = Callable[[_Station], Awaitable[None]]


class _Round:
    """The steps of one round."""

    def __init__(self, rig: Rig, view: View, runs: int) -> None:
        self._rig = rig
        self._view = view
        self._runs = runs
        self._targets = {axis.spec.name: list(random_targets(axis)) for axis in rig.axes}

    async def on_all_axes(self, step: _Step) -> None:
        """Run a step on all axes at the same time, each with its own controller."""
        try:
            async with asyncio.TaskGroup() as tasks:
                for axis in self._rig.axes:
                    tasks.create_task(self._on_axis(axis, step))
        except ExceptionGroup as failures:
            raise failures.exceptions[
                0
            ] from None  # An axis that fails ends the others; its reason is reported.

    async def measure(self, station: _Station) -> None:
        """Home, zero the laser, read it at every target in both directions; build the table."""
        axis, view = station.axis, station.view

        def show(arrival: Arrival, reading: Reading) -> None:
            view.measured.append(station.judged(arrival, reading.measured))

        await self._home(station)
        axis.laser.zero(axis.clock())
        await self._survey(DemoPhase.MEASURING, station, view.before, show)
        home = HomeReference(0.0, axis.spec.home_direction)
        survey = Survey(tuple(view.before), axis.spec.units)
        recipe = Recipe(home=home, step=axis.spec.step, fit=Fit.AUTO)
        view.table = (await asyncio.to_thread(build_from, survey, recipe)).table

    async def measure_with(self, station: _Station) -> None:
        """Read the laser at the same targets with the correction in force. The laser keeps its zero."""
        await self._home(station)
        await self._survey(DemoPhase.MEASURING_WITH, station, station.view.after, lambda *_: None)

    async def judge_without(self, station: _Station) -> None:
        """Go to the random targets from both sides; the table exists but is not in use yet."""
        await self._judge(DemoPhase.WITHOUT, station, station.view.without)

    async def judge_with(self, station: _Station) -> None:
        """Make the same moves, corrected. The laser keeps its zero."""
        await self._home(station)
        await self._judge(DemoPhase.WITH, station, station.view.corrected)

    async def _on_axis(self, axis: RigAxis, step: _Step) -> None:
        async with axis.controller() as controller:
            await step(_Station(axis, self._view.axes[axis.spec.name], controller))

    async def _home(self, station: _Station) -> None:
        """Go to 0 in the direction of homing, the reference of the table."""
        spec = station.axis.spec
        self._view.begin(station.view, DemoPhase.HOMING, 0)
        before = Stop(-spec.home_direction.value * spec.overrun, spec.home_direction, measure=False)
        for stop in (before, Stop(0.0, spec.home_direction, measure=False)):
            station.add(await station.controller.move(stop))

    async def _survey(
        self,
        phase: DemoPhase,
        station: _Station,
        readings: list[Reading],
        show: Callable[[Arrival, Reading], None],
    ) -> None:
        axis = station.axis
        runs: Counter[tuple[float, Direction]] = Counter()

        def read_laser(arrival: Arrival) -> None:
            stop = arrival.stop
            runs[stop.nominal, stop.direction] += 1
            measured = axis.laser.read_mm(axis.clock()) / axis.spec.mm
            reading = Reading(stop.nominal, stop.direction, measured, runs[stop.nominal, stop.direction])
            readings.append(reading)
            show(arrival, reading)

        stops = list(bidirectional_cycle(axis.spec.measured, axis.spec.overrun, self._runs))
        await self._run(phase, station, stops, read_laser)

    async def _judge(self, phase: DemoPhase, station: _Station, judged: list[Judged]) -> None:
        def judge(arrival: Arrival) -> None:
            judged.append(station.judged(arrival, station.view.nut))

        axis = station.axis
        stops = list(bidirectional_cycle(self._targets[axis.spec.name], axis.spec.overrun))
        await self._run(phase, station, stops, judge)

    async def _run(
        self, phase: DemoPhase, station: _Station, stops: list[Stop], at_stop: Callable[[Arrival], None]
    ) -> None:
        """Go from stop to stop; call ``at_stop`` at measuring stops, while the axis is at standstill."""
        self._view.begin(station.view, phase, len(stops))
        async for arrival in station.controller.run(iter(stops)):
            station.add(arrival)
            if arrival.stop.measure:
                at_stop(arrival)


def random_targets(axis: RigAxis) -> Iterator[float]:
    """Random targets all over the travel, off the table's points."""
    spec = axis.spec
    for index in range(TARGETS):
        while True:
            target = spec.low + (index + axis.target_rng.random()) * (spec.high - spec.low) / TARGETS
            if 0.05 < (target - spec.low) / spec.step % 1.0 < 0.95:
                break
        yield target
