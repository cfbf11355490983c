"""The measuring run: from stop to stop, a reading at each; at its end the axis is at standstill.

A stop request may come at any time. It takes effect between two exchanges, never inside one.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Final, TypeVar

from gateway.commissioning.measure.axis_link import AxisLink, AxisSnapshot, LostAxisError
from gateway.commissioning.measure.errors import AxisError, BadReadingError, StoppedError, TakenBackError
from gateway.commissioning.measure.instruments import Instrument, Keyboard, Lines
from gateway.commissioning.measure.options import Pace
from gateway.commissioning.measure.readings_file import ReadingsFile
from gateway.metrology.cycle import Hands, Stop
from gateway.metrology.readings import Reading, small_unit

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

    def took_back(self, count: int) -> None:
        """So many readings of a placement were taken back."""

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
    gap: float | None = None
    """With a walk: 1 if the gap of the dial opens while the axis moves forward, -1 if it closes."""
    per_placement: int = 0
    """With a walk: readings of a placement."""
    slipped: float = inf
    """With a walk: a placement whose lost motions differ by more is named."""


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
        self._block = 0.0
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
        self._block = max((abs(stop.block) for stop in stops), default=0.0)
        index = 0
        while index < len(stops):
            try:
                await self._stop(stops[index])
                index += 1
            except TakenBackError:
                index = self._take_back(stops, index)

    async def _stop(self, stop: Stop) -> None:
        self.halt.check()
        if stop.before is not None:
            await self._ask_for(stop.before, stop)
        await self._move(stop)
        if not stop.measure:
            return
        if stop.after is not None:
            await self._ask_for(stop.after, stop)
        await self.halt.wait(self._settings.pace.dwell_s)
        reading = await self._reading(stop)
        self._file.append(reading)
        self.readings.append(reading)
        self._showing.took(reading)
        if self._settings.gap is not None:
            self._judge_placement()

    def _take_back(self, stops: Sequence[Stop], index: int) -> int:
        """Remove the readings of this placement, or of the one before it; return its first stop."""
        run = stops[index].run
        if not any(each.run == run for each in self.readings):
            run = max((each.run for each in self.readings), default=run)
        count = sum(each.run == run for each in self.readings)
        self._file.take_back(count)
        self.readings[:] = [each for each in self.readings if each.run != run]
        self._showing.took_back(count)
        what = f"placement {run}: its {count} readings are taken back" if count else "nothing to take back"
        self._showing.show(f"{what}; placement {run} begins again")
        self._showing.happened("taken-back", {"placement": run, "readings": count})
        return next(at for at, stop in enumerate(stops) if stop.run == run)

    async def _ask_for(self, hands: Hands, stop: Stop) -> None:
        """Ask a person to do something at a stop, and wait until it is done.

        Raises:
            StoppedError: the user ended the run.
            TakenBackError: the user takes a placement back.
        """
        text = f"placement {stop.run}: {self._words(hands, stop)}"
        self._showing.happened("hands", {"do": hands.value, "placement": stop.run, "target": stop.nominal})
        if hands in (Hands.PLACE, Hands.INSERT) and isinstance(self._instrument, Keyboard):
            self._showing.show(f"{text}, and type what the dial shows")
            return
        assert self.lines is not None, "a walk has a person"
        self._showing.show(f"{text}. Enter goes on, b takes the placement back, q stops")
        while True:
            answer = await self.halt.during(self.lines.line())
            if answer == "":
                return
            if answer == "b":
                raise TakenBackError("b on the keyboard")
            if answer in ("q", None):
                raise StoppedError("q on the keyboard" if answer else "standard input has ended")
            self._showing.show("Enter goes on, b takes the placement back, q stops")

    def _words(self, hands: Hands, stop: Stop) -> str:
        block = f"the block of {self._block:.9g} {self._units}"
        return {
            Hands.CLEAR: f"take dial, stop and block out of the way. THE AXIS MOVES to {stop.nominal:.9g}",
            Hands.PLACE: "set up dial and stop against each other, without the block, near the middle of the "
            "dial's range",
            Hands.INSERT: f"put {block} between dial and stop",
            Hands.REMOVE: f"take {block} OUT: the axis moves back by it, to {stop.nominal:.9g}",
        }[hands]

    def _judge_placement(self) -> None:
        """Name a placement whose lost motion differs without the block and with it: something slipped."""
        run = self.readings[-1].run
        own = [each for each in self.readings if each.run == run]
        if len(own) < self._settings.per_placement:
            return
        rises: dict[bool, float] = {}
        for each in own:
            over = bool(each.block)
            share = 4 * each.direction.value / self._settings.per_placement
            rises[over] = rises.get(over, 0.0) + share * each.deviation
        apart = abs(rises[True] - rises[False])
        units = self._link.plan.settings.units
        if apart > self._settings.slipped:
            small = small_unit(units)
            self._showing.show(
                f"placement {run}: the lost motion is {small.text(-rises[False])} without the block and "
                f"{small.text(-rises[True])} with it. If something slipped, b takes this placement back"
            )
            self._showing.happened("doubt", {"placement": run, "apart": apart})

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
        if self._settings.gap is not None:
            over = " over the block" if stop.block else ""
            where = f"placement {stop.run}, {stop.nominal:.9g} {self._units} {way}{over}"
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
        if settings.gap is not None:
            return self._checked_dial(stop, settings.gap, raw)
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

    def _checked_dial(self, stop: Stop, gap: float, raw: float) -> Reading:
        """Return a reading of the dial; it must fit the first one of its placement."""
        settings = self._settings
        measured = stop.block + gap * settings.sign * settings.scale * raw
        reading = Reading(stop.nominal, stop.direction, measured, stop.run, block=stop.block)
        first = next((each for each in self.readings if each.run == stop.run), reading)
        away = reading.deviation - first.deviation
        if abs(away) > settings.largest_deviation:
            raise BadReadingError(
                f"{raw:.9g} is {away:+.6g} {self._units} from what the first reading of this placement leads "
                f"to: more than {settings.largest_deviation:g} (--largest-deviation). Check for a typing "
                "mistake, the block, the dial's sign (--reversed: it counts down while the gap opens) and "
                "its units (--reading-units)"
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
