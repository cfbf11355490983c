"""How the drive of an axis is made to go somewhere, and to stop, from its register map alone.

Two kinds can be driven: those that go to a position as soon as it is written, and those that wait for a
trigger whose value the map names. Everything else is refused with the reason, before anything is written.
"""

from dataclasses import dataclass
from typing import Final

from gateway.cli.measuring.errors import UndrivableError
from gateway.compensation.settings import Setpoints
from gateway.drives.motion import Action, Addressing, Form, ModePlan, MotionPlan, TriggerPlan
from gateway.exchange.plan import AxisPlan
from gateway.modbus.pdu import FunctionCode
from gateway.modbus.registers import FieldAccess, PositionField

FULL: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class Lever:
    """A value of a trigger that makes the drive do one thing."""

    trigger: TriggerPlan
    value: int

    @property
    def needs_reading(self) -> bool:
        """Whether the register holds other things, which have to stay as they are."""
        return self.trigger.mask != FULL or bool(self.trigger.rising)

    def word(self, before: int) -> int:
        """Return the content that does it, where the register holds ``before``."""
        return (before & ~self.trigger.mask & FULL) | self.value

    def rested(self, before: int) -> int:
        """Return the content from which the bit that starts it can rise."""
        return before & ~self.trigger.rising & FULL

    def __str__(self) -> str:
        return f"register {self.trigger.address:#06x} = {self.value:#x}"


@dataclass(frozen=True, slots=True)
class Recipe:
    """How one axis is driven."""

    plan: AxisPlan
    target: PositionField
    start: Lever | None = None
    """None: the axis goes as soon as the target is written."""
    stop: Lever | None = None
    """None: the map names no stop, and the axis is held by commanding the place where it is."""
    mode: ModePlan | None = None
    """It has to say that positions are absolute."""
    following: tuple[TriggerPlan, ...] = ()
    """Registers that may make the drive go to each position as it is written, which nobody wants here."""

    @property
    def mode_value(self) -> int:
        """Content of the mode register that means absolute."""
        assert self.mode is not None
        return min(value for value, action in self.mode.actions.items() if action is Action.ABSOLUTE)

    def check_words(self, address: int, word: int, before: int, allowed: tuple[Action, ...]) -> None:
        """Check that a word does what it is for and nothing else.

        Raises:
            UndrivableError: the register's other bits would do something too.
        """
        for trigger in self.plan.motion.triggers:
            if trigger.is_coil or trigger.address != address:
                continue
            does = trigger.deed(word, before).action
            if does not in (*allowed, Action.IGNORE):
                raise UndrivableError(
                    f"axis {self.plan.name}: register {trigger.address:#06x} holds {before:#06x}; writing "
                    f"{word:#06x} there would {does.value.replace('_', ' ')} too: bring the drive into the "
                    "state in which the controller moves it, then measure"
                )


def recipe_of(plan: AxisPlan) -> Recipe:
    """Return how an axis is driven.

    Raises:
        UndrivableError: its map does not say how, or says that it needs more than targets and a trigger.
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
        return Recipe(plan, target, None, stop, mode, following)
    if motion.starts_on:
        raise _undrivable(plan, "its moves are started by writing further registers (starts_on)")
    if not motion.is_staged:
        return Recipe(plan, target, None, stop, mode, following)
    start = next((lever for lever in (_starting(each, motion) for each in levers) if lever), None)
    if start is None:
        raise _undrivable(
            plan, "a written target waits for a trigger, and no trigger register has a value that starts it"
        )
    return Recipe(plan, target, start, stop, mode, following)


def writes(plan: AxisPlan, address: int, data: bytes) -> list[bytes]:
    """Return the requests that write registers, in the form that the drive takes."""
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
    """Whether a reply is the full success of a write."""
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
        raise _undrivable(plan, "its actual position cannot be read, and nobody would see where it is")
    if plan.writes_with is Form.FC06 and target.words > 1 and not plan.motion.is_staged:
        raise _undrivable(plan, "its target is written word by word, and each word moves it")


def _check_mode(plan: AxisPlan, mode: ModePlan) -> None:
    if mode.is_in_frame:
        raise _undrivable(plan, "the mode of a move stands in the frame of its target")
    acting = {*plan.motion.starts_on, *(each.address for each in plan.motion.triggers if each.mask == FULL)}
    if mode.address in acting:
        raise _undrivable(plan, "writing its mode makes it act")
    absolutes = [value for value, action in mode.actions.items() if action is Action.ABSOLUTE]
    if not absolutes:
        raise _undrivable(plan, "no mode of its map is absolute")
    if mode.resets_to is not None and mode.action(mode.resets_to) is not Action.ABSOLUTE:
        raise _undrivable(plan, "its mode is not absolute again after each move")


def _stays(lever: Lever, levers: list[TriggerPlan]) -> bool:
    """Whether a stop is a bit of a control word, in which 0 stops too: set, it would hold the next move."""
    others = (each for each in levers if each is not lever.trigger and each.address == lever.trigger.address)
    return any(each.deed(0, None).action is Action.STOP for each in others)


def _starting(trigger: TriggerPlan, motion: MotionPlan) -> Lever | None:
    """Return what runs the first target of the map, as an absolute move."""
    wanted = {Action.ABSOLUTE, Action.START}
    values = [
        value for value, deed in trigger.deeds.items() if deed.action in wanted and deed.number in (None, 0)
    ]
    if not values or (motion.mode(0) is None and any(motion.modes)):
        return None
    return Lever(trigger, min(values))


def _stopping(trigger: TriggerPlan) -> Lever | None:
    """Return a value that is a stop command.

    0 is none: it takes an enabling bit away, and the axis would run out freely, or go on when it comes back.
    """
    stops = (value for value, deed in trigger.deeds.items() if deed.action is Action.STOP and value)
    value = next(stops, None)
    return None if value is None else Lever(trigger, value)


def _undrivable(plan: AxisPlan, why: str) -> UndrivableError:
    return UndrivableError(
        f"axis {plan.name}: {why}: measure does not drive it; move it by its controller "
        "(pitch-gateway table program writes the moves) and build the table of the readings"
    )
