"""The measuring run: from stop to stop, a reading at each; at its end the axis is at standstill.

A stop request may come at any time. It takes effect between two exchanges, never inside one.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from gateway.commissioning.measure.axis_link import AxisLink, AxisSnapshot, LostAxisError
from gateway.commissioning.measure.errors import AxisError, BadReadingError, StoppedError
from gateway.commissioning.measure.instruments import Instrument, Lines
from gateway.commissioning.measure.options import Pace
from gateway.commissioning.measure.readings_file import ReadingsFile
from gateway.metrology.cycle import Stop
from gateway.metrology.readings import Reading

POLL_S: Final = 0.02
STILL: Final = 3
"""This many polls in a row must show the axis at its target."""
STILL_FOR_SURE: Final = 25
"""The same if the axis could not be stopped: half a second at one position."""
STOP_TIMEOUT_S: Final = 10.0
Result = TypeVar("Result")


class Showing:
    """Receives all events of a run; this one shows nothing. Positions are in units of the axis."""

    def show(self, text: str) -> None:
        """Show one sentence."""

    def begin(self, total: int, done: int) -> None:
        """A run begins: ``total`` readings are required, ``done`` of them exist."""

    def going(self, stop: Stop) -> None:
        """The axis was commanded to a stop."""

    def waiting(self, stop: Stop) -> None:
        """The axis is at standstill at a stop, which the next reading belongs to."""

    def took(self, reading: Reading) -> None:
        """A reading was taken, and is on the disk."""

    def happened(self, event: str, facts: Mapping[str, Any]) -> None:
        """An event for a program; a person gets it in words."""

    def end(self) -> None:
        """All motion has ended."""


class Halt:
    """Waits of a measuring run: each one ends as soon as the user requests a stop."""

    def __init__(self) -> None:
        self._asked = asyncio.Event()
        self._why = ""

    def ask(self, why: str) -> None:
        """Request the end; the first reason is reported."""
        if not self._asked.is_set():
            self._why = why
            self._asked.set()

    def check(self) -> None:
        """Raise StoppedError if the end was requested."""
        if self._asked.is_set():
            raise StoppedError(self._why)

    async def wait(self, seconds: float) -> None:
        """Wait. Raises StoppedError as soon as the end is requested."""
        self.check()
        try:
            async with asyncio.timeout(seconds):
                await self._asked.wait()
        except TimeoutError:
            return
        self.check()

    async def during(self, work: Coroutine[object, object, Result]) -> Result:
        """Return the result of ``work``; cancel it if the end is requested first.

        Raises:
            StoppedError: the end was requested.
        """
        if self._asked.is_set():
            work.close()
            self.check()
        task = asyncio.ensure_future(work)
        asked = asyncio.ensure_future(self._asked.wait())
        try:
            await asyncio.wait((task, asked), return_when=asyncio.FIRST_COMPLETED)
            if task.done():
                return task.result()
            raise StoppedError(self._why)
        finally:
            for each in (task, asked):
                each.cancel()
            await asyncio.gather(task, asked, return_exceptions=True)


@dataclass(frozen=True, slots=True)
class RunSettings:
    """Settings of a run; lengths in units of the axis."""

    pace: Pace
    """As requested."""
    window: float
    """Largest distance from its target at which the axis counts as arrived."""
    largest_deviation: float
    """A larger deviation is a mistake or the instrument's zero: the reading is requested again."""
    sign: float = 1.0
    """-1 if the instrument counts the other way."""
    zero_at: float = 0.0
    """Machine position at which the instrument shows 0."""
    scale: float = 1.0
    """Units of the axis in one unit of the instrument."""


class Run:
    """One measuring run."""

    def __init__(
        self,
        link: AxisLink,
        instrument: Instrument,
        settings: RunSettings,
        file: ReadingsFile,
        *,
        showing: Showing,
        halt: Halt,
    ) -> None:
        self._link = link
        self._instrument = instrument
        self._settings = settings
        self._file = file
        self._showing = showing
        self._units = link.plan.settings.units.value
        self.halt = halt
        self.readings: list[Reading] = []
        self.may_move = False
        """Whether the axis may be moving: a command was sent, and its arrival was not observed."""
        self.lines: Lines | None = None
        """Where a person answers whether to read again; None: no person."""
        self.check_unchanged: Callable[[], Awaitable[None]] | None = None
        """Raises AxisError if the compensation has changed."""

    async def stops(self, stops: Sequence[Stop]) -> None:
        """Go to the stops one after the other, and read at the measuring stops.

        Raises:
            MeasureError: it ended early; the axis may still be moving: see :meth:`bring_to_standstill`.
        """
        for stop in stops:
            self.halt.check()
            await self._move(stop)
            if stop.measure:
                await self.halt.wait(self._settings.pace.dwell_s)
                reading = await self._reading(stop)
                self._file.append(reading)
                self.readings.append(reading)
                self._showing.took(reading)

    async def bring_to_standstill(self, link: AxisLink | None = None) -> str:
        """Stop the axis if it may be moving; return its position and how it was stopped.

        ``link``: another connection, if its own is lost.

        Raises:
            AxisError: it is unknown whether the axis is at standstill.
        """
        self._link = link or self._link
        how = ""
        if self.may_move:
            try:
                how = f"it was {await self._link.stop()}"
            except LostAxisError:
                raise
            except AxisError as error:  # it has most likely refused the move, too
                snapshot = await self._until_still(STILL_FOR_SURE)
                self.may_move = False
                return f"{self._position_text(snapshot)}; its stop was refused: {error}"
        snapshot = await self._until_still()
        if self.may_move:
            await self._link.let_go()
            if not self._is_near((await self._until_still()).position, snapshot.position):
                await self._link.stop()
                raise AxisError("it moved again when its stop was released, and was stopped once more")
            self.may_move = False
        return f"{self._position_text(snapshot)}; {how}" if how else self._position_text(snapshot)

    def _position_text(self, snapshot: AxisSnapshot) -> str:
        return f"axis {self._link.plan.name} is at standstill at {snapshot.position:.6g} {self._units}"

    async def _until_still(self, looks: int = STILL) -> AxisSnapshot:
        first = await self._link.snapshot()
        still = 0
        try:
            async with asyncio.timeout(STOP_TIMEOUT_S):
                while still < looks:
                    await asyncio.sleep(POLL_S)
                    snapshot = await self._link.snapshot()
                    if self._is_near(snapshot.position, first.position) and not snapshot.is_moving:
                        still += 1
                    else:
                        still, first = 0, snapshot
        except TimeoutError:
            raise AxisError(
                f"axis {self._link.plan.name} still moves {STOP_TIMEOUT_S:g} s after the stop command: "
                "press the emergency stop"
            ) from None
        return first

    def _is_near(self, one: float, other: float) -> bool:
        return abs(one - other) <= self._slack

    @property
    def _slack(self) -> float:
        """Tolerance for the position of an axis at standstill."""
        settings = self._link.plan.settings
        return max(settings.hysteresis, 2.0 * settings.step)

    async def _move(self, stop: Stop) -> None:
        self._showing.going(stop)
        starts = await self._link.starts()
        self.may_move = True
        await self._link.go(stop.nominal, starts)
        loop = asyncio.get_running_loop()
        give_up_s = loop.time() + self._settings.pace.move_timeout_s
        still, last = 0, await self._link.snapshot()
        while still < STILL:
            await self.halt.wait(POLL_S)
            snapshot = await self._link.snapshot()
            if snapshot.is_alarm:
                raise AxisError(
                    f"axis {self._link.plan.name} reports an alarm on the way to {stop.nominal:.9g}"
                )
            is_there = abs(snapshot.position - stop.nominal) <= self._settings.window
            is_still = self._is_near(snapshot.position, last.position)
            says_so = snapshot.is_done is not False and snapshot.is_moving is not True
            still, last = (still + 1 if is_there and is_still and says_so else 0), snapshot
            if loop.time() > give_up_s:
                raise AxisError(self._why_not_there(stop, snapshot))
        self.may_move = False

    def _why_not_there(self, stop: Stop, snapshot: AxisSnapshot) -> str:
        limit, away = self._settings.pace.move_timeout_s, abs(snapshot.position - stop.nominal)
        name = self._link.plan.name
        if away > self._settings.window:
            return (
                f"axis {name} is at {snapshot.position:.9g} {limit:g} s after it was sent to "
                f"{stop.nominal:.9g}. Check whether it moves at all. A longer move needs "
                f"--move-timeout; if it stops {away:.6g} {self._units} away, --window must be wider "
                f"than {self._settings.window:g}"
            )
        return f"axis {name} is at {stop.nominal:.9g}, but its bits do not report this within {limit:g} s"

    async def _reading(self, stop: Stop) -> Reading:
        way = stop.direction.name.lower()
        where = f"{stop.nominal:.9g} {self._units} {way}, run {stop.run}"
        while True:
            try:
                before = await self._position_at(stop)
                raw = await self.halt.during(self._read(where, stop))
                reading = self._checked(stop, raw)
            except BadReadingError as error:
                await self._ask_again(where, error)
                continue
            await self._check_still(stop, before)
            return reading

    async def _position_at(self, stop: Stop) -> float:
        """Return the position of the axis. Raises AxisError: it has left its target."""
        here = await self._link.position()
        if abs(here - stop.nominal) > self._settings.window + self._slack:
            raise AxisError(
                f"axis {self._link.plan.name} is at {here:.9g} and has left {stop.nominal:.9g}, where "
                "it had arrived: another program moves it, or its drive does not hold it; no reading "
                "was taken"
            )
        return here

    async def _read(self, where: str, stop: Stop) -> float:
        """Read the instrument; early data are an error, raised before the user is asked for a reading."""
        self._instrument.arm()
        self._showing.waiting(stop)
        return await self._instrument.read(where)

    def _checked(self, stop: Stop, raw: float) -> Reading:
        settings = self._settings
        measured = settings.zero_at + settings.sign * settings.scale * raw
        reading = Reading(stop.nominal, stop.direction, measured, stop.run)
        if abs(reading.deviation) > settings.largest_deviation:
            raise BadReadingError(
                f"{raw:.9g} gives {measured:.9g} {self._units}, {reading.deviation:+.6g} from the "
                f"target: more than {settings.largest_deviation:g} (--largest-deviation). Check for a "
                "typing mistake, and the instrument's zero (--zero-at), sign (--reversed) and units "
                "(--reading-units)"
            )
        return reading

    async def _ask_again(self, where: str, error: BadReadingError) -> None:
        """Show the error; read again only if the user agrees."""
        if self.lines is None:
            raise error
        self._showing.show(f"{where}: {error}")
        while True:
            self._showing.show("r reads again, q stops")
            answer = await self.halt.during(self.lines.line())
            if answer == "r":
                return
            if answer in ("q", None):
                raise StoppedError("q on the keyboard" if answer else "standard input has ended") from error

    async def _check_still(self, stop: Stop, before: float) -> None:
        """Check that axis and compensation have not changed during the reading."""
        here = await self._link.position()
        if not self._is_near(here, before):
            raise AxisError(
                f"axis {self._link.plan.name} moved from {before:.9g} to {here:.9g} during the reading "
                f"at {stop.nominal:.9g}: another program moves it; the reading was not taken"
            )
        if self.check_unchanged is not None:
            await self.check_unchanged()
