"""One axis over our own Modbus connection: read its position, move it, stop it.

The register map alone determines how. Two kinds of drives can be moved: those that move as soon as a position
is written, and those that wait for a trigger whose value is in the map. All others are refused with the
reason, before anything is written.

Positions are machine positions in units of the axis, as in its table and its travel: ``counts = zero_counts +
counts_per_unit * machine position``. One exchange at a time; every write must be acknowledged, and none is
ever repeated.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Final, Protocol

from gateway.commissioning.measure.errors import AxisError, UndrivableError
from gateway.compensation.settings import Setpoints
from gateway.drives.motion import Action, Addressing, Form, ModePlan, MotionPlan, TriggerPlan
from gateway.exchange.added_frames import AddedFrame, Purpose, read_bit, read_field
from gateway.exchange.axis.axis import Axis
from gateway.exchange.field_counts import counts_of, steps_of
from gateway.exchange.plan import ALARM_BIT, DONE_BIT, HOMED_BIT, MOVING_BIT, AxisPlan
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import ExceptionCode, FunctionCode, is_exception
from gateway.modbus.registers import FieldAccess, PositionField
from gateway.transport.master import NoReplyError

FULL: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class Lever:
    """A trigger value with one effect on the drive."""

    trigger: TriggerPlan
    value: int

    @property
    def needs_reading(self) -> bool:
        """Whether other bits of the register must keep their value."""
        return self.trigger.mask != FULL or bool(self.trigger.rising)

    def word(self, before: int) -> int:
        """Return the content with this effect, if the register holds ``before``."""
        return (before & ~self.trigger.mask & FULL) | self.value

    def rested(self, before: int) -> int:
        """Return the content from which the start bit can rise."""
        return before & ~self.trigger.rising & FULL

    def __str__(self) -> str:
        return f"register {self.trigger.address:#06x} = {self.value:#x}"


@dataclass(frozen=True, slots=True)
class DriveRecipe:
    """How one axis is moved."""

    plan: AxisPlan
    target: PositionField
    start: Lever | None = None
    """None: the axis moves as soon as the target is written."""
    stop: Lever | None = None
    """None: the map names no stop; commanding its present position holds the axis."""
    mode: ModePlan | None = None
    """This register must say that positions are absolute."""
    following: tuple[TriggerPlan, ...] = ()
    """Registers that may make the drive follow each written position, which must not happen here."""

    @property
    def mode_value(self) -> int:
        """Content of the mode register for absolute positions."""
        assert self.mode is not None
        return min(value for value, action in self.mode.actions.items() if action is Action.ABSOLUTE)

    def check_words(self, address: int, word: int, before: int, allowed: tuple[Action, ...]) -> None:
        """Check that a word has only the intended effect.

        Raises:
            UndrivableError: the register's other bits would have an effect too.
        """
        for trigger in self.plan.motion.triggers:
            if trigger.is_coil or trigger.address != address:
                continue
            does = trigger.operation(word, before).action
            if does not in (*allowed, Action.IGNORE):
                raise UndrivableError(
                    f"axis {self.plan.name}: register {trigger.address:#06x} holds {before:#06x}; "
                    f"writing {word:#06x} there would also {does.value.replace('_', ' ')}: bring the "
                    "drive into the state in which its controller moves it, then measure"
                )


def recipe_of(plan: AxisPlan) -> DriveRecipe:
    """Return how an axis is moved.

    Raises:
        UndrivableError: the map does not determine it, or requires more than targets and a trigger.
    """
    motion, target = plan.motion, plan.command[0]
    _check_fields(plan, target)
    mode = motion.mode(0)
    if mode is not None:
        _check_mode(plan, mode)
    levers = [trigger for trigger in motion.triggers if trigger.block is None and not trigger.is_coil]
    stop = next((lever for lever in map(_stopping, levers) if lever and not _stays(lever, levers)), None)
    following = tuple(trigger for trigger in motion.triggers if trigger.can_follow and not trigger.is_coil)
    target_words = range(target.address, target.end)
    if motion.starts_on and not motion.starts_on.isdisjoint(target_words):
        return DriveRecipe(plan, target, None, stop, mode, following)
    if motion.starts_on:
        raise _undrivable(plan, "its moves start with writes to further registers (starts_on)")
    if not motion.is_staged:
        return DriveRecipe(plan, target, None, stop, mode, following)
    start = next((lever for lever in (_starting(each, motion) for each in levers) if lever), None)
    if start is None:
        raise _undrivable(
            plan, "a written target waits for a trigger, and no trigger register has a value that starts it"
        )
    return DriveRecipe(plan, target, start, stop, mode, following)


def writes(plan: AxisPlan, address: int, data: bytes) -> list[bytes]:
    """Return the requests that write registers, in the form for the drive."""
    if plan.writes_with is Form.FC06:
        code = bytes((FunctionCode.WRITE_SINGLE_REGISTER,))
        return [
            code + (address + index // 2).to_bytes(2) + data[index : index + 2]
            for index in range(0, len(data), 2)
        ]
    count = len(data) // 2
    head = bytes((FunctionCode.WRITE_MULTIPLE_REGISTERS,)) + address.to_bytes(2) + count.to_bytes(2)
    return [head + bytes((len(data),)) + data]


def pull(plan: AxisPlan, lever: Lever, word: int) -> list[bytes]:
    """Return the requests that write a trigger."""
    return writes(plan, lever.trigger.address, word.to_bytes(2))


def acknowledges(request: bytes, reply: bytes) -> bool:
    """Whether a reply acknowledges a write completely."""
    if request[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS:
        return reply == request[:5]
    return reply == request


def _check_fields(plan: AxisPlan, target: PositionField) -> None:
    if plan.settings.setpoints is Setpoints.STREAM:
        raise _undrivable(plan, 'it follows a stream of setpoints (setpoints = "stream"), and would jump')
    if plan.addressing is Addressing.OBJECTS or Form.MEI in (plan.reads_with, plan.writes_with):
        raise _undrivable(plan, "its registers are CANopen objects")
    if target.block is not None or target.access is FieldAccess.READ:
        raise _undrivable(plan, "its target is part of a longer command")
    if not plan.actual or not plan.actual[0].is_readable or not plan.safe_read:
        raise _undrivable(plan, "its actual position cannot be read")
    if plan.writes_with is Form.FC06 and target.words > 1 and not plan.motion.is_staged:
        raise _undrivable(plan, "its target is written word by word, and each word moves it")


def _check_mode(plan: AxisPlan, mode: ModePlan) -> None:
    if mode.is_in_frame:
        raise _undrivable(plan, "the frame of its target also contains the mode of the move")
    acting = {*plan.motion.starts_on, *(each.address for each in plan.motion.triggers if each.mask == FULL)}
    if mode.address in acting:
        raise _undrivable(plan, "writing its mode starts an action")
    absolutes = [value for value, action in mode.actions.items() if action is Action.ABSOLUTE]
    if not absolutes:
        raise _undrivable(plan, "no mode of its map is absolute")
    if mode.resets_to is not None and mode.action(mode.resets_to) is not Action.ABSOLUTE:
        raise _undrivable(plan, "its mode does not return to absolute after each move")


def _stays(lever: Lever, levers: list[TriggerPlan]) -> bool:
    """Whether a stop is a bit in a control word where 0 stops too: a set bit would hold the next move."""
    others = (each for each in levers if each is not lever.trigger and each.address == lever.trigger.address)
    return any(each.operation(0, None).action is Action.STOP for each in others)


def _starting(trigger: TriggerPlan, motion: MotionPlan) -> Lever | None:
    """Return the value that runs the first target of the map, as an absolute move."""
    actions = {Action.ABSOLUTE, Action.START}
    values = [
        value
        for value, operation in trigger.deeds.items()
        if operation.action in actions and operation.number in (None, 0)
    ]
    if not values or (motion.mode(0) is None and any(motion.modes)):
        return None
    return Lever(trigger, min(values))


def _stopping(trigger: TriggerPlan) -> Lever | None:
    """Return a value that is a stop command.

    0 is not one: it clears an enabling bit, and the axis would coast, or continue when the bit is set again.
    """
    stops = (value for value, operation in trigger.deeds.items() if operation.action is Action.STOP and value)
    value = next(stops, None)
    return None if value is None else Lever(trigger, value)


def _undrivable(plan: AxisPlan, why: str) -> UndrivableError:
    return UndrivableError(
        f"axis {plan.name}: {why}, so measure cannot move it. Move it with its controller "
        "(pitch-gateway table program writes the moves) and make the table from the readings "
        "(pitch-gateway table build)"
    )


STANDSTILL_BITS: Final = (DONE_BIT, MOVING_BIT, ALARM_BIT)


class AxisMaster(Protocol):
    """One exchange at a time, as with ``ModbusMaster``."""

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request and return its reply. Raises NoReplyError."""
        ...


class LostAxisError(AxisError):
    """No reply: the connection or the drive is lost, and the effect of the last request is unknown."""


@dataclass(frozen=True, slots=True)
class AxisSnapshot:
    """The state of an axis at one moment. Bits are None if the map has none."""

    position: float
    is_done: bool | None
    is_moving: bool | None
    is_alarm: bool | None


class AxisLink:
    """Moves one axis by its recipe."""

    def __init__(self, master: AxisMaster, recipe: DriveRecipe) -> None:
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
        """Read the position of the axis. Raises AxisError."""
        field = self.plan.actual[0]
        raw = field.unpack(await self._read(read_field(self._axis, Purpose.ACTUAL, field), "actual position"))
        if not isfinite(raw):
            raise AxisError(f"axis {self.plan.name}: its actual position reads as {raw}: check its type")
        return self.machine(counts_of(field, raw))

    async def bit(self, name: str) -> bool | None:
        """Read a status bit; None if the map has none. Raises AxisError."""
        bit = self.plan.bits.get(name)
        if bit is None:
            return None
        words = await self._read(read_bit(self._axis, Purpose.STANDSTILL, bit), f"bit {name}")
        return bit.is_set(int.from_bytes(words))

    async def snapshot(self) -> AxisSnapshot:
        """Read the bits that show motion, then the position. Raises AxisError."""
        done, moving, alarm = [await self.bit(name) for name in STANDSTILL_BITS]
        return AxisSnapshot(await self.position(), done, moving, alarm)

    async def is_homed(self) -> bool | None:
        """Read the homed bit. Raises AxisError."""
        return await self.bit(HOMED_BIT)

    async def needed_mode(self) -> tuple[int, int] | None:
        """Return the present and the required content of the mode register; None if it is absolute already.

        Raises:
            AxisError: no reply, or the drive would follow positions without the trigger.
        """
        for trigger in self.recipe.following:
            held = await self._word(trigger.address)
            if trigger.is_following(held) or trigger.holds_unknown(held):
                raise AxisError(
                    f"axis {self.plan.name}: register {trigger.address:#06x} holds {held:#06x}, so the "
                    "drive may move as soon as a position is written, but measure starts each move "
                    "with its trigger: set the drive to its state after power-up"
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
        """Return the words to write to the trigger, one after the other, to start a move.

        Raises:
            AxisError: no reply.
            UndrivableError: they would have another effect too; the drive may not be enabled.
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
        """Command a position once; ``starts`` is the last result of :meth:`starts`.

        Raises:
            AxisError: refused, or not acknowledged; it is then unknown whether the axis moves.
        """
        what = f"the target {position:.9g}"
        await self._write(writes(self.plan, self.recipe.target.address, self.packed(position)), what)
        for word in starts:
            assert self.recipe.start is not None
            await self._write(pull(self.plan, self.recipe.start, word), what)

    async def stop(self) -> str:
        """Stop the axis, by its own stop or by commanding its present position; return how.

        Raises:
            AxisError: refused, or not acknowledged.
        """
        stop = self.recipe.stop
        if stop is None:
            starts = await self.starts()
            here = await self.position()
            await self.go(here, starts)
            return f"commanded back to {here:.6g}, its position at that moment (its map names no stop)"
        before = await self._word(stop.trigger.address) if stop.needs_reading else 0
        await self._write(pull(self.plan, stop, stop.word(before)), "the stop")
        self._before_stop = before
        return f"stopped by its stop command ({stop})"

    async def let_go(self) -> None:
        """Clear a stop bit that stays set, once the axis is at standstill. Raises AxisError.

        The bits that start a move do not change.
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
        return f"the reply does not belong to the request: {reply.hex(' ')}"
    code = reply[1] if len(reply) > 1 else 0
    try:
        name = f" ({ExceptionCode(code).name.lower().replace('_', ' ')})"
    except ValueError:
        name = ""
    return f"refused with exception {code}{name}; if the gateway refused it, its log says why"
