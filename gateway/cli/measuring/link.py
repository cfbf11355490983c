"""One axis over a Modbus connection of our own: where it is, going somewhere, stopping.

Positions are machine positions in units of the axis, as in its table and its travel:
``counts = zero_counts + counts_per_unit * machine position``. One exchange at a time; every write has to be
acknowledged, and none is ever repeated.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Final, Protocol

from gateway.cli.measuring.errors import AxisError
from gateway.cli.measuring.recipe import FULL, Lever, Recipe, acknowledges, pull, writes
from gateway.drives.motion import Action
from gateway.exchange.added_frames import AddedFrame, Purpose, read_bit, read_field
from gateway.exchange.axis.axis import Axis
from gateway.exchange.field_counts import counts_of, steps_of
from gateway.exchange.plan import ALARM_BIT, DONE_BIT, HOMED_BIT, MOVING_BIT
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import ExceptionCode, is_exception
from gateway.transport.master import NoReplyError

STANDING_BITS: Final = (DONE_BIT, MOVING_BIT, ALARM_BIT)


class Asking(Protocol):
    """One exchange at a time, as ``ModbusMaster`` does it."""

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request and return its reply. Raises NoReplyError."""
        ...


class LostAxisError(AxisError):
    """No reply: the connection or the drive is gone, and nobody knows what the last request did."""


@dataclass(frozen=True, slots=True)
class Look:
    """An axis at one moment. Bits are None where the map has none."""

    position: float
    is_done: bool | None
    is_moving: bool | None
    is_alarm: bool | None


class AxisLink:
    """Drives one axis by its recipe."""

    def __init__(self, master: Asking, recipe: Recipe) -> None:
        self.recipe = recipe
        self.plan = recipe.plan
        self._master = master
        self._axis = Axis(recipe.plan)
        self._before_stop: int | None = None

    def machine(self, counts: float) -> float:
        """Machine position of counts, in units."""
        settings = self.plan.settings
        return (counts - settings.zero_counts) / settings.counts_per_unit

    def packed(self, position: float) -> bytes:
        """Return the content of the target register for a machine position.

        Raises:
            AxisError: the register cannot hold it.
        """
        settings, field = self.plan.settings, self.recipe.target
        counts = settings.zero_counts + settings.counts_per_unit * position
        whole = counts if field.type.is_float else round(counts)
        try:
            return field.pack(steps_of(field, whole))
        except RegisterRangeError as error:
            raise AxisError(f"{position:.9g} {settings.units.value} cannot be commanded: {error}") from None

    async def position(self) -> float:
        """Read where the axis is. Raises AxisError."""
        field = self.plan.actual[0]
        raw = field.unpack(await self._read(read_field(self._axis, Purpose.ACTUAL, field), "actual position"))
        if not isfinite(raw):
            raise AxisError(f"axis {self.plan.name}: its actual position reads as {raw}: check its type")
        return self.machine(counts_of(field, raw))

    async def bit(self, name: str) -> bool | None:
        """Read a status bit; None where the map has none. Raises AxisError."""
        bit = self.plan.bits.get(name)
        if bit is None:
            return None
        words = await self._read(read_bit(self._axis, Purpose.STANDING, bit), f"bit {name}")
        return bit.is_set(int.from_bytes(words))

    async def look(self) -> Look:
        """Read the bits that tell whether it moves, then where it is. Raises AxisError."""
        done, moving, alarm = [await self.bit(name) for name in STANDING_BITS]
        return Look(await self.position(), done, moving, alarm)

    async def is_homed(self) -> bool | None:
        """Read the homed bit. Raises AxisError."""
        return await self.bit(HOMED_BIT)

    async def needed_mode(self) -> tuple[int, int] | None:
        """Return what the mode register holds and what it has to hold; None where it is absolute already.

        Raises:
            AxisError: no reply, or the drive would go to positions without the trigger.
        """
        for trigger in self.recipe.following:
            held = await self._word(trigger.address)
            if trigger.is_following(held) or trigger.holds_unknown(held):
                raise AxisError(
                    f"axis {self.plan.name}: register {trigger.address:#06x} holds {held:#06x}, with which "
                    "the drive may go to each position as it is written: measure starts each move by its "
                    "trigger; let the drive be as it is after power-up"
                )
        mode = self.recipe.mode
        if mode is None:
            return None
        held = await self._word(mode.address)
        if mode.action(held) is Action.ABSOLUTE:
            return None
        word = (held & ~mode.mask & FULL) | self.recipe.mode_value
        self.recipe.check_words(mode.address, word, held, ())
        return held, word

    async def set_mode(self, word: int) -> None:
        """Write the mode register. Raises AxisError."""
        assert self.recipe.mode is not None
        await self._write(writes(self.plan, self.recipe.mode.address, word.to_bytes(2)), "the mode")

    async def starts(self) -> list[int]:
        """Return the words that are to be written to the trigger, one after the other, to start a move.

        Raises:
            AxisError: no reply.
            UndrivableError: they would do something else too; the drive is not enabled, perhaps.
        """
        start = self.recipe.start
        if start is None:
            return []
        before = await self._word(start.trigger.address) if start.needs_reading else 0
        rested = start.rested(before)
        word = start.word(rested)
        address = start.trigger.address
        self.recipe.check_words(address, word, rested, (Action.ABSOLUTE, Action.START))
        if rested == before:
            return [word]
        self.recipe.check_words(address, rested, before, ())
        return [rested, word]

    async def go(self, position: float, starts: list[int]) -> None:
        """Command a position, once; ``starts`` is what :meth:`starts` has just returned.

        Raises:
            AxisError: refused, or not acknowledged; whether the axis moves is then not known.
        """
        what = f"the target {position:.9g}"
        await self._write(writes(self.plan, self.recipe.target.address, self.packed(position)), what)
        for word in starts:
            assert self.recipe.start is not None
            await self._write(pull(self.plan, self.recipe.start, word), what)

    async def stop(self) -> str:
        """Stop the axis, by its own stop or by commanding the place where it is; return how.

        Raises:
            AxisError: refused, or not acknowledged.
        """
        stop = self.recipe.stop
        if stop is None:
            starts = await self.starts()
            here = await self.position()
            await self.go(here, starts)
            return f"commanded back to {here:.6g}, where it was then (its map names no stop)"
        before = await self._word(stop.trigger.address) if stop.needs_reading else 0
        await self._write(pull(self.plan, stop, stop.word(before)), "the stop")
        self._before_stop = before
        return f"stopped by its own stop command ({stop})"

    async def let_go(self) -> None:
        """Take a stop back that is a bit which stays, once the axis stands. Raises AxisError.

        The bits that start a move stay at rest.
        """
        stop, before = self.recipe.stop, self._before_stop
        if stop is None or before is None or stop.trigger.mask == FULL:
            return
        word = Lever(stop.trigger, before & stop.trigger.mask).word(await self._word(stop.trigger.address))
        if self.recipe.start is not None and self.recipe.start.trigger.address == stop.trigger.address:
            word = self.recipe.start.rested(word)
        await self._write(pull(self.plan, stop, word), "the end of the stop")

    async def _word(self, address: int) -> int:
        frame = AddedFrame(self._axis, Purpose.RULE, address, 1)
        return int.from_bytes(await self._read(frame, f"register {address:#06x}"))

    async def _read(self, frame: AddedFrame, what: str) -> bytes:
        reply = await self._exchange(frame.pdu, what)
        words = frame.words_of(reply)
        if words is None:
            raise AxisError(f"axis {self.plan.name}: {what}: {_refusal(reply)}")
        return words

    async def _write(self, requests: list[bytes], what: str) -> None:
        for request in requests:
            reply = await self._exchange(request, what)
            if not acknowledges(request, reply):
                raise AxisError(f"axis {self.plan.name}: {what}: {_refusal(reply)}")

    async def _exchange(self, request: bytes, what: str) -> bytes:
        try:
            return await self._master.exchange(self.plan.unit_id, request)
        except NoReplyError as error:
            raise LostAxisError(f"axis {self.plan.name}: {what}: {error}") from None


def _refusal(reply: bytes) -> str:
    if not is_exception(reply):
        return f"the reply is none to what was asked: {reply.hex(' ')}"
    code = reply[1] if len(reply) > 1 else 0
    try:
        name = f" ({ExceptionCode(code).name.lower().replace('_', ' ')})"
    except ValueError:
        name = ""
    return f"refused with exception {code}{name}; the gateway's log says why where it was the gateway"
