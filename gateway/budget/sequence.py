"""What a controller sends in one round, derived from the register map of each axis.

A round of an axis is: its target, its trigger if the drive waits for one, its position, and with ``setpoints
= "targets"`` its state. Each is the smallest possible frame. :class:`Blocks` describes controllers that send
larger blocks.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Final, NamedTuple

from msgspec import Struct

from gateway.budget.wire import READ_BIT, WRITE_WORD, PduSizes, read_frame, write_frames
from gateway.compensation.settings import Setpoints
from gateway.drives.motion import Action, Addressing, Form, TriggerPlan
from gateway.exchange.cut_through.delay import (
    FrameShape,
    acknowledgement_shape,
    read_shape,
    reply_shape,
    write_shape,
)
from gateway.exchange.plan import DONE_BIT, MOVING_BIT, AxisPlan, CompensationMode, writes_alone
from gateway.modbus.pdu import MAX_READ_REGISTERS, MAX_WRITE_REGISTERS
from gateway.modbus.registers import BitTable, PositionField
from gateway.options import Option, Options

REGISTER_READS: Final = frozenset({Form.FC03, Form.FC04})


class What(Enum):
    """One exchange of a round, as displayed."""

    TARGET = "write target"
    TRIGGER = "trigger"
    POSITION = "read position"
    STATUS = "read status"
    BLOCK = "read block"


class Why(Enum):
    """A frame that the gateway adds, as displayed."""

    DIRECTION = "position, for the direction (M6)"
    BASE = "start of a distance (M5)"
    REWRITE = "target again for its trigger (M2)"


@dataclass(frozen=True, slots=True)
class Blocks(Options):
    """Block sizes of a controller that the register map does not show, in registers; 0: as in the map."""

    read_registers: Annotated[
        int,
        Option(
            "Size of a block of registers that the controller also reads from each drive in each round.",
            "registers",
            shown_default=False,
            min=0,
            max=MAX_READ_REGISTERS,
        ),
    ] = 0
    target_registers: Annotated[
        int,
        Option(
            "Size of the block in which the controller writes a target.",
            shown_default="as many as the position has",
            min=0,
            max=MAX_WRITE_REGISTERS,
        ),
    ] = 0


AS_MAPPED = Blocks()


class Shapes(NamedTuple):
    """Shapes of a request and its reply: which of their bytes depend on which."""

    request: FrameShape
    reply: FrameShape


class RoundStep(Struct, frozen=True):
    """One exchange of a round."""

    axis: str
    """"" on a line without axes."""
    what: What
    frame: PduSizes
    shapes: Shapes | None = None
    """Of frames that may be forwarded by cut-through; None: every line stores them."""


class Added(Struct, frozen=True):
    """Frames that the gateway may have to send before an exchange of the controller."""

    axis: str
    why: Why
    before: What
    frames: tuple[PduSizes, ...]


def round_of(
    axes: Sequence[AxisPlan], blocks: Blocks = AS_MAPPED, *, may_move: bool = True
) -> tuple[RoundStep, ...]:
    """Return one round over all axes of a line. A controller that may not move only reads."""
    if not axes and blocks.read_registers:
        return (RoundStep("", What.BLOCK, read_frame(Form.FC03, blocks.read_registers)),)
    with_rules = {axis.unit_id for axis in axes if axis.has_rules}
    of_unit = {axis.unit_id: [each for each in axes if each.unit_id == axis.unit_id] for axis in axes}
    return tuple(
        step
        for axis in axes
        for step in _steps(axis, blocks, with_rules, of_unit[axis.unit_id], may_move=may_move)
    )


def _steps(
    axis: AxisPlan,
    blocks: Blocks,
    with_rules: Collection[int],
    of_unit: Iterable[AxisPlan],
    *,
    may_move: bool,
) -> Iterator[RoundStep]:
    if may_move:
        for frame in _target_frames(axis, blocks.target_registers):
            yield RoundStep(axis.name, What.TARGET, frame, _target_shapes(axis, blocks, with_rules, of_unit))
        trigger = _trigger(axis)
        if trigger is not None:
            yield RoundStep(axis.name, What.TRIGGER, _trigger_frame(axis, trigger))
    yield RoundStep(
        axis.name, What.POSITION, _position_frame(axis), position_shapes(axis, _position_field(axis))
    )
    status = _status_frame(axis)
    if status is not None and axis.settings.setpoints is Setpoints.TARGETS:  # a stream does not wait for it
        is_word = status is not READ_BIT
        yield RoundStep(axis.name, What.STATUS, status, registers_shapes(axis, 1) if is_word else None)
    if blocks.read_registers:
        form = axis.reads_with if axis.reads_with is Form.FC04 else Form.FC03
        yield RoundStep(axis.name, What.BLOCK, read_frame(form, blocks.read_registers))


def least_target_registers(axis: AxisPlan) -> int:
    """Return the least number of registers in a target's frame: with its block and its mode."""
    field = axis.command[0]
    first, end = field.address if field.block is None else field.block, field.end
    mode = axis.motion.modes[0] if axis.motion.modes else None
    if axis.addressing is Addressing.REGISTERS and mode is not None and mode.is_in_frame:
        first, end = min(first, mode.address), max(end, mode.address + 1)
    return end - first


def _target_frames(axis: AxisPlan, registers: int) -> tuple[PduSizes, ...]:
    least = least_target_registers(axis)
    if registers > least:
        return write_frames(Form.MEI if axis.writes_with is Form.MEI else Form.FC16, registers)
    return write_frames(axis.writes_with, least)


def _target_shapes(
    axis: AxisPlan, blocks: Blocks, with_rules: Collection[int], of_unit: Iterable[AxisPlan]
) -> Shapes | None:
    """Return the shapes of a target. In a larger block, its position is assumed to be first."""
    least = least_target_registers(axis)
    if blocks.target_registers <= least and axis.writes_with is not Form.FC16:
        return None
    return target_shapes(axis, max(blocks.target_registers, least), with_rules, of_unit)


def _trigger(axis: AxisPlan) -> TriggerPlan | None:
    """Return the trigger that starts a target in a separate frame; None if writing the target does."""
    if not axis.motion.is_staged:
        return None
    triggers = axis.motion.triggers
    if axis.settings.setpoints is Setpoints.STREAM and any(
        operation.action in {Action.FOLLOW, Action.FOLLOW_NEXT}
        for t in triggers
        for operation in t.deeds.values()
    ):
        return None  # set once; then each setpoint moves when written
    return next((trigger for trigger in triggers if _runs(trigger)), None)


def _runs(trigger: TriggerPlan) -> bool:
    return trigger.otherwise.runs_target or any(
        operation.action.runs_target for operation in trigger.deeds.values()
    )


def _trigger_frame(axis: AxisPlan, trigger: TriggerPlan) -> PduSizes:
    if trigger.is_coil:
        return WRITE_WORD
    if axis.writes_with is Form.MEI:
        return write_frames(Form.MEI, axis.object_words.get(trigger.address, 1))[0]
    if trigger.block is not None and trigger.block != trigger.address:
        return write_frames(Form.FC16, trigger.address + 1 - trigger.block)[0]
    return WRITE_WORD


def _position_field(axis: AxisPlan) -> PositionField:
    reported = (*axis.actual, *axis.commanded, *axis.command)
    return next((field for field in reported if field.is_readable), axis.command[0])


def _position_frame(axis: AxisPlan) -> PduSizes:
    field = _position_field(axis)
    first = field.address if field.block is None else field.block
    return read_frame(axis.reads_with, field.end - first)


def _status_frame(axis: AxisPlan) -> PduSizes | None:
    """Return the read of the state that shows the end of a move."""
    bit = axis.bits.get(DONE_BIT) or axis.bits.get(MOVING_BIT)
    if bit is None:
        return None
    if bit.table is not BitTable.REGISTER:
        return READ_BIT
    return read_frame(axis.reads_with, axis.object_words.get(bit.address, 1))


def added_of(axis: AxisPlan) -> tuple[Added, ...]:
    """Return what the gateway may add for an axis (W8): nothing without a table or without permission."""
    if not axis.added_frames or axis.table is None or axis.compensation is not CompensationMode.ON:
        return ()
    return tuple(_added(axis))


def _added(axis: AxisPlan) -> Iterator[Added]:
    trigger = _trigger(axis)
    runs_by = What.TARGET if trigger is None else What.TRIGGER
    reads_actual, reads_commanded = (
        axis.safe_read and bool(fields) and fields[0].is_readable for fields in (axis.actual, axis.commanded)
    )
    if reads_actual and axis.settings.setpoints is Setpoints.TARGETS and _has_branches(axis):
        yield Added(axis.name, Why.DIRECTION, runs_by, (_position_frame(axis),))
    if (reads_actual or reads_commanded) and _has_distances(axis):
        status = _status_frame(axis)
        standstill = () if status is None else (status,)
        yield Added(axis.name, Why.BASE, runs_by, (*standstill, _position_frame(axis)))
    if trigger is not None:
        frames = write_frames(axis.writes_with, axis.command[0].words)
        yield Added(axis.name, Why.REWRITE, What.TRIGGER, frames)


def _has_branches(axis: AxisPlan) -> bool:
    """Whether the correction depends on the direction of travel."""
    if axis.settings.backlash is not None:
        return True
    return axis.table is not None and axis.table.max_reversal() > 0.0


def _has_distances(axis: AxisPlan) -> bool:
    modes = (action for mode in axis.motion.modes if mode for action in mode.actions.values())
    triggers = (operation.action for trigger in axis.motion.triggers for operation in trigger.deeds.values())
    return any(action.is_relative for action in (*modes, *triggers))


def misfits(axis: AxisPlan, blocks: Blocks) -> Iterator[str]:
    """Yield why a drive would refuse these blocks."""
    least = least_target_registers(axis)
    if blocks.target_registers and blocks.target_registers < least:
        yield f"a target of axis {axis.name} needs at least {least} registers, not {blocks.target_registers}"
    for registers in (blocks.read_registers, blocks.target_registers):
        if registers > axis.max_registers:
            yield (
                f"the drive of axis {axis.name} takes at most {axis.max_registers} registers in one frame "
                f"(max_registers), not {registers}"
            )


# --- what cut-through may forward --------------------------------------------------------------------------
#
# The exchange decides for each frame whether it has a fast path (``exchange.fast_path``,
# ``exchange.cut_through``). This part derives from the plan of an axis what that means for the frames of a
# round. tests/budget compares the two.


def target_shapes(
    axis: AxisPlan, registers: int, with_rules: Collection[int], of_unit: Iterable[AxisPlan]
) -> Shapes | None:
    """Return the shapes of a target in a block of so many registers; None: it is stored.

    ``with_rules``: unit ids whose frames can have another meaning than positions that are executed
    immediately. ``of_unit``: all axes of its unit id.
    """
    field = axis.command[0]
    is_plain = axis.compensation is not CompensationMode.SHADOW and not field.type.is_float
    if not (is_plain and _is_read_as_registers(axis)) or axis.unit_id in with_rules:
        return None
    is_early = not _word(field) and field.is_high_first_pair and writes_alone(of_unit, field)
    request = write_shape(registers, _word(field), field.words, is_early=is_early)
    return Shapes(request, acknowledgement_shape())


def position_shapes(axis: AxisPlan, field: PositionField) -> Shapes | None:
    """Return the shapes of a read of one position, with its block; None: it is stored."""
    if not _is_read_as_registers(axis):
        return None
    word = _word(field)
    early = [word] if field.is_high_first_pair else []
    return Shapes(read_shape(), reply_shape(word + field.words, [(word, field.words)], early))


def registers_shapes(axis: AxisPlan, registers: int) -> Shapes | None:
    """Return the shapes of a read of registers without positions; None: it is stored."""
    return Shapes(read_shape(), reply_shape(registers)) if _is_read_as_registers(axis) else None


def _is_read_as_registers(axis: AxisPlan) -> bool:
    return axis.addressing is Addressing.REGISTERS and axis.reads_with in REGISTER_READS and axis.checks_crc


def _word(field: PositionField) -> int:
    """Return the word of its block at which a position begins."""
    return 0 if field.block is None else field.address - field.block
