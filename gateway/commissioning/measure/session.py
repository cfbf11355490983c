"""A measuring run from the first check of the axis to the last reading: connections, signals, files.

After the check the user sees what will happen.
"""

import asyncio
import signal
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any, Final

from gateway.commissioning.measure.axis_link import AxisLink, DriveRecipe, LostAxisError
from gateway.commissioning.measure.checks import (
    Compensation,
    check_line,
    check_may_move,
    check_overrun,
    check_range,
    check_writer,
    compensation_of,
)
from gateway.commissioning.measure.errors import AxisError, MeasureError
from gateway.commissioning.measure.instruments import Instrument, Lines
from gateway.commissioning.measure.options import Pace
from gateway.commissioning.measure.readings_file import Plan, ReadingsFile
from gateway.commissioning.measure.running import Halt, Run, RunSettings, Showing
from gateway.exchange.plan import AxisPlan, Reference
from gateway.metrology.cycle import Stop
from gateway.metrology.readings import Reading
from gateway.state.plan import ControllerLink, LinePlan
from gateway.status.model import RelayModel
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.errors import TransportError
from gateway.transport.master import ModbusMaster

ANY_ADDRESSES: Final = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}  # noqa: S104 - a listener's own
FREE_AFTER_S: Final = 0.5
Status = Callable[[], RelayModel]


@dataclass(frozen=True, slots=True)
class AxisRoute:
    """The axis, how it is moved, and its address."""

    line: LinePlan
    recipe: DriveRecipe
    controller: ControllerLink
    endpoint: TcpEndpoint | SerialEndpoint

    def master(self) -> ModbusMaster:
        """Return a master on the gateway's listener."""
        return ModbusMaster(self.endpoint, self.controller.plan.timeout_ms)


@dataclass(frozen=True, slots=True)
class StartConditions:
    """The conditions found before any motion."""

    compensation: Compensation
    position: float
    needed_mode: tuple[int, int] | None


def endpoint_of(link: ControllerLink, port: str | None) -> TcpEndpoint | SerialEndpoint:
    """Return the address of a listener from here.

    Raises:
        AxisError: a serial one without --port, or --port for one that is not serial.
    """
    endpoint, name = link.endpoint, link.plan.name
    if isinstance(endpoint, TcpEndpoint):
        if port is not None:
            raise AxisError(f"--port: remove it: controller {name} listens on {endpoint}, reached by TCP")
        return TcpEndpoint(ANY_ADDRESSES.get(endpoint.host, endpoint.host), endpoint.port, endpoint.rtu)
    if port is None:
        raise AxisError(
            f"controller {name} is the serial port {endpoint.device} of the gateway: connect this "
            "computer to its cable in place of the controller, and give this computer's port with "
            "--port"
        )
    return SerialEndpoint(
        port, endpoint.baudrate, endpoint.parity, endpoint.data_bits, endpoint.stop_bits, endpoint.echo
    )


@asynccontextmanager
async def connected(route: AxisRoute) -> AsyncIterator[AxisLink]:
    """Connect to the gateway. Raises AxisError: no gateway, in use, no permission."""
    try:
        async with route.master() as master:
            yield AxisLink(master, route.recipe)
    except TransportError as error:
        raise AxisError(
            f"controller {route.controller.plan.name} ({route.endpoint}): {error.detail}"
        ) from None


async def check_ready(route: AxisRoute, plan: Plan, stops: list[Stop], status: Status) -> StartConditions:
    """Check all conditions before the axis moves. Nothing is written.

    Raises:
        AxisError: a condition is not met.
    """
    axis = route.recipe.plan
    now = status()
    check_line(now, route.line)
    compensation = compensation_of(now, axis)
    await _until_free(status, axis)
    check_overrun(axis, plan.overrun)
    async with connected(route) as link:
        check_range(link, stops, is_corrected=compensation.is_active)
        position = await check_may_move(link)
        await link.starts()
        return StartConditions(compensation, position, await link.needed_mode())


async def _until_free(status: Status, axis: AxisPlan) -> None:
    """Wait while an ended program may still hold the axis. Raises AxisError: it is still held."""
    loop = asyncio.get_running_loop()
    give_up_s = loop.time() + axis.writer_hold_s + FREE_AFTER_S
    while True:
        try:
            return check_writer(status(), axis)
        except AxisError:
            if loop.time() > give_up_s:
                raise
        await asyncio.sleep(FREE_AFTER_S / 2)


class MeasureSession:
    """Runs the remaining stops. All readings stay in :attr:`readings`, however it ends."""

    def __init__(
        self,
        route: AxisRoute,
        instrument: Instrument,
        settings: RunSettings,
        file: ReadingsFile,
        showing: Showing,
    ) -> None:
        self.readings: list[Reading] = []
        self.stopped_by: signal.Signals | None = None
        self._route = route
        self._instrument = instrument
        self._settings = settings
        self._file = file
        self._showing = showing

    async def run(
        self, stops: list[Stop], seen: StartConditions, status: Status, lines: Lines | None
    ) -> None:
        """Measure. At the end the axis is at standstill, or the error says that this is unknown.

        Raises:
            MeasureError: it ended early.
        """
        halt = Halt()
        self._listen(halt)
        await self._instrument.open()
        try:
            async with connected(self._route) as link:
                run = Run(
                    link, self._instrument, self._settings, self._file, showing=self._showing, halt=halt
                )
                run.lines = lines
                run.readings = self.readings
                run.check_unchanged = self._unchanged(seen, status)
                # Time has passed while the user answered the question.
                check_writer(await asyncio.to_thread(status), self._route.recipe.plan)
                await run.check_unchanged()
                await check_may_move(link)
                await self._measure(run, link, stops, seen)
        finally:
            self._instrument.close()

    async def _measure(self, run: Run, link: AxisLink, stops: list[Stop], seen: StartConditions) -> None:
        try:
            if seen.needed_mode is not None:
                await link.set_mode(seen.needed_mode[1])
            await run.stops(stops)
        except BaseException as error:  # whatever it was, the axis must not continue
            with suppress(Exception):  # the display may have failed: stop the axis in any case
                self._showing.end()
                self._showing.show(f"stopping: {error}")
                self._showing.happened("stopping", {"error": str(error)})
            await self._bring_to_standstill(run, error)
            raise
        self._showing.end()

    async def _bring_to_standstill(self, run: Run, error: BaseException) -> None:
        try:
            try:
                self._show_stop(await run.bring_to_standstill())
            except LostAxisError:
                await self._stop_anew(run)
        except MeasureError as second:
            with suppress(Exception):  # the display may have failed; the raised error has the same text
                self._showing.happened("stop-failed", {"error": str(second), "may_move": run.may_move})
            if not run.may_move:
                return
            raise AxisError(
                f"{error}; then the stop failed: {second}. THE AXIS MAY STILL BE MOVING: press the emergency "
                "stop"
            ) from None

    async def _stop_anew(self, run: Run) -> None:
        """Stop the axis over a new connection: only the old one may be lost."""
        async with connected(self._route) as link:
            self._show_stop(await run.bring_to_standstill(link))

    def _show_stop(self, how: str) -> None:
        with suppress(Exception):  # the display may have failed
            self._showing.show(how)
            self._showing.happened("standing", {"text": how})

    def _listen(self, halt: Halt) -> None:
        loop = asyncio.get_running_loop()

        def stop(number: signal.Signals) -> None:
            self.stopped_by = self.stopped_by or number
            halt.ask("Ctrl-C" if number is signal.SIGINT else number.name)

        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, stop, number)

    def _unchanged(self, seen: StartConditions, status: Status) -> Callable[[], Any]:
        """Return a check that readings with and without a table are never mixed."""
        axis = self._route.recipe.plan

        async def check() -> None:
            now = compensation_of(await asyncio.to_thread(status), axis)
            if now.fact != seen.compensation.fact:
                raise AxisError(
                    f"the compensation of axis {axis.name} changed from {seen.compensation.fact} to "
                    f"{now.fact} during the measurement: the last reading was not taken"
                )

        return check


MINUTE_S: Final = 60.0
SETTLE_S: Final = 0.3
"""Polls of an arrived axis, and the exchanges of one stop."""


def preview(
    route: AxisRoute, seen: StartConditions, stops: Sequence[Stop], instrument: str, pace: Pace
) -> Iterator[str]:
    """Yield the axis, its range, the number of moves, the correction, and how it is stopped."""
    recipe, axis = route.recipe, route.recipe.plan
    units, state = axis.settings.units.value, seen.compensation.state
    low, high = min(stop.nominal for stop in stops), max(stop.nominal for stop in stops)
    use = f"{axis.table_name} is refined" if seen.compensation.is_active else "the readings make a new table"
    readings = sum(stop.measure for stop in stops)
    here = f"{seen.position:.6g} {units}"
    yield f"Axis {axis.name} is at {here} and WILL MOVE between {low:.9g} and {high:.9g} {units}."
    yield f"  stops         {len(stops)}, with a reading at {readings} of them"
    yield f"  compensation  {state}: {use}"
    yield f"  instrument    {instrument}"
    yield f"  connection    controller {route.controller.plan.name} at {route.endpoint}"
    yield f"  each move     begins with {recipe.start or 'the writing of its target'}"
    yield f"  Ctrl-C        {recipe.stop or 'commands it back to where it is then: its map names no stop'}"
    yield (
        "  speed         the drive's own, because no register map names a speed: set a slow one at the drive"
    )
    yield f"  time          {_time(route, stops, seen.position, pace)}"
    if seen.needed_mode is not None and recipe.mode is not None:
        before, after = seen.needed_mode
        yield f"  mode          register {recipe.mode.address:#06x} is set from {before:#06x} to {after:#06x}"
    if axis.referenced in (Reference.HOMING, Reference.SET_POSITION) and not seen.compensation.is_active:
        yield "  homed?        unknown while nothing is corrected: home the axis first"
    yield from _terms(axis, is_active=seen.compensation.is_active)
    if axis.settings.machine_offset:
        off = -axis.settings.machine_offset
        yield f"  positions     machine positions, as in travel and the table; the controller's: {off:+.9g}"


def _terms(axis: AxisPlan, *, is_active: bool) -> Iterator[str]:
    """Yield other corrections beside the table, present or future: the table must not include them again."""
    if axis.thermal is not None and is_active:
        yield "  thermal       active: the table is refined as for a screw at its reference temperature"
    elif axis.thermal is not None:
        at = axis.thermal.reference
        yield f"  thermal       not active now, but used with the new table, which will be valid at {at:g} °C"
    for cross in axis.cross:
        if is_active:
            yield f"  cross {cross.axis:7} active: the table is refined without the effect of {cross.axis}"
        else:
            yield (
                f"  cross {cross.axis:7} not active now, but used with the new table: move it to where "
                f"{cross.table_name} is 0"
            )


def _time(route: AxisRoute, stops: Sequence[Stop], position: float, pace: Pace) -> str:
    ways = [position, *(stop.nominal for stop in stops)]
    distance = sum(abs(after - before) for before, after in pairwise(ways))
    waits_s = len(stops) * SETTLE_S + sum(stop.measure for stop in stops) * pace.dwell_s
    settings = route.recipe.plan.settings
    speed = pace.speed or settings.max_speed
    units = settings.units.value
    if not 0.0 < speed < inf:
        return f"{waits_s / MINUTE_S:.1f} min of waiting, and {distance:.6g} {units} of moves (give --speed)"
    whole_s = waits_s + distance / speed
    return f"about {whole_s / MINUTE_S:.1f} min, if it moves with {speed:g} {units}/s"
