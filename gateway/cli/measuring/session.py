"""A measuring run from the first look at the axis to the last reading: connections, signals, files."""

import asyncio
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

from gateway.cli.measuring.checks import (
    Compensation,
    check_line,
    check_overrun,
    check_range,
    check_standing,
    check_writer,
    compensation_of,
)
from gateway.cli.measuring.errors import AxisError, MeasureError
from gateway.cli.measuring.halt import Halt
from gateway.cli.measuring.instruments import Instrument, Lines
from gateway.cli.measuring.link import AxisLink, LostAxisError
from gateway.cli.measuring.readings_file import MeasuringPlan, ReadingsFile
from gateway.cli.measuring.recipe import Recipe
from gateway.cli.measuring.running import Manners, Run
from gateway.cli.measuring.showing import Showing
from gateway.exchange.plan import AxisPlan
from gateway.metrology.cycle import Stop
from gateway.metrology.readings import Reading
from gateway.state.plan import ControllerLink, LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.errors import TransportError
from gateway.transport.master import ModbusMaster

ANY_ADDRESSES: Final = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}  # noqa: S104 - a listener's own
FREE_AFTER_S: Final = 0.5
Status = Callable[[], Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Place:
    """The axis, how it is driven, and where it is reached."""

    line: LinePlan
    recipe: Recipe
    controller: ControllerLink
    endpoint: TcpEndpoint | SerialEndpoint

    def master(self) -> ModbusMaster:
        """Return a master on the gateway's listener."""
        return ModbusMaster(self.endpoint, self.controller.plan.timeout_ms)


@dataclass(frozen=True, slots=True)
class Seen:
    """What was found before anything moves."""

    compensation: Compensation
    position: float
    needed_mode: tuple[int, int] | None


def endpoint_of(link: ControllerLink, port: str | None) -> TcpEndpoint | SerialEndpoint:
    """Return where a listener is reached from here.

    Raises:
        AxisError: a serial one without --port, or --port for one that is not serial.
    """
    endpoint, name = link.endpoint, link.plan.name
    if isinstance(endpoint, TcpEndpoint):
        if port is not None:
            raise AxisError(f"--port: controller {name} listens on {endpoint}: it is reached by TCP")
        return TcpEndpoint(ANY_ADDRESSES.get(endpoint.host, endpoint.host), endpoint.port, endpoint.rtu)
    if port is None:
        raise AxisError(
            f"controller {name} is the serial port {endpoint.device} of the gateway: give --port, the port "
            "of this computer at the other end of that cable, in place of the controller"
        )
    return SerialEndpoint(
        port, endpoint.baudrate, endpoint.parity, endpoint.data_bits, endpoint.stop_bits, endpoint.echo
    )


@asynccontextmanager
async def connected(place: Place) -> AsyncIterator[AxisLink]:
    """Connect to the gateway. Raises AxisError: nobody there, in use, no permission."""
    try:
        async with place.master() as master:
            yield AxisLink(master, place.recipe)
    except TransportError as error:
        raise AxisError(
            f"controller {place.controller.plan.name} ({place.endpoint}): {error.detail}"
        ) from None


async def look(place: Place, plan: MeasuringPlan, stops: list[Stop], status: Status) -> Seen:
    """Look at everything that must be right before the axis moves. Nothing is written.

    Raises:
        AxisError: something is not.
    """
    axis = place.recipe.plan
    now = status()
    check_line(now, place.line)
    compensation = compensation_of(now, axis)
    await _until_free(status, axis)
    check_overrun(axis, plan.overrun)
    async with connected(place) as link:
        check_range(link, stops, is_corrected=compensation.is_active)
        position = await check_standing(link)
        await link.starts()
        return Seen(compensation, position, await link.needed_mode())


async def _until_free(status: Status, axis: AxisPlan) -> None:
    """Wait while a program that has ended may still hold the axis. Raises AxisError: somebody holds on."""
    loop = asyncio.get_running_loop()
    give_up_s = loop.time() + axis.writer_hold_s + FREE_AFTER_S
    while True:
        try:
            return check_writer(status(), axis)
        except AxisError:
            if loop.time() > give_up_s:
                raise
        await asyncio.sleep(FREE_AFTER_S / 2)


class Session:
    """Runs the stops that are left. What was read stays in :attr:`readings` however it ends."""

    def __init__(
        self, place: Place, instrument: Instrument, manners: Manners, file: ReadingsFile, showing: Showing
    ) -> None:
        self.readings: list[Reading] = []
        self.stopped_by: signal.Signals | None = None
        self._place = place
        self._instrument = instrument
        self._manners = manners
        self._file = file
        self._showing = showing

    async def run(self, stops: list[Stop], seen: Seen, status: Status, lines: Lines | None) -> None:
        """Measure. The axis stands when it ends, or the error says that nobody knows.

        Raises:
            MeasureError: it ended early.
        """
        halt = Halt()
        self._listen(halt)
        await self._instrument.open()
        try:
            async with connected(self._place) as link:
                run = Run(link, self._instrument, self._manners, self._file, showing=self._showing, halt=halt)
                run.lines = lines
                run.readings = self.readings
                run.check_unchanged = self._unchanged(seen, status)
                # A person has thought about the question meanwhile.
                check_writer(await asyncio.to_thread(status), self._place.recipe.plan)
                await run.check_unchanged()
                await check_standing(link)
                await self._measure(run, link, stops, seen)
        finally:
            self._instrument.close()

    async def _measure(self, run: Run, link: AxisLink, stops: list[Stop], seen: Seen) -> None:
        try:
            if seen.needed_mode is not None:
                await link.set_mode(seen.needed_mode[1])
            await run.stops(stops)
        except BaseException as error:  # whatever it was, the axis must not go on by itself
            with suppress(Exception):  # who shows it may be gone: the axis has to be stopped all the same
                self._showing.end()
                self._showing.say(f"stopping: {error}")
                self._showing.happened("stopping", {"error": str(error)})
            await self._leave_standing(run, error)
            raise
        self._showing.end()

    async def _leave_standing(self, run: Run, error: BaseException) -> None:
        try:
            try:
                self._told(await run.leave_standing())
            except LostAxisError:
                await self._stop_anew(run)
        except MeasureError as second:
            with suppress(Exception):  # nobody may be listening: what was raised says it as well
                self._showing.happened("stop-failed", {"error": str(second), "may_move": run.may_move})
            if not run.may_move:
                return
            raise AxisError(
                f"{error}; then the stop failed: {second}. THE AXIS MAY STILL BE MOVING: press the emergency "
                "stop"
            ) from None

    async def _stop_anew(self, run: Run) -> None:
        """The connection is gone, perhaps only that one: stop the axis over another."""
        async with connected(self._place) as link:
            self._told(await run.leave_standing(link))

    def _told(self, how: str) -> None:
        with suppress(Exception):  # nobody may be listening any more
            self._showing.say(how)
            self._showing.happened("standing", {"text": how})

    def _listen(self, halt: Halt) -> None:
        loop = asyncio.get_running_loop()

        def stop(number: signal.Signals) -> None:
            self.stopped_by = self.stopped_by or number
            halt.ask("Ctrl-C" if number is signal.SIGINT else number.name)

        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, stop, number)

    def _unchanged(self, seen: Seen, status: Status) -> Callable[[], Any]:
        """Return what checks that readings with and without a table are never mixed."""
        axis = self._place.recipe.plan

        async def check() -> None:
            now = compensation_of(await asyncio.to_thread(status), axis)
            if now.fact != seen.compensation.fact:
                raise AxisError(
                    f"the compensation of axis {axis.name} changed from {seen.compensation.fact} to "
                    f"{now.fact} while it was measured: the last reading was not taken"
                )

        return check
