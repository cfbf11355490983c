"""What of a round may be cut through, by the register map; and how much sooner its frames are through.

Which requests have a fast path the exchange decides frame by frame (``exchange.fast_path``,
``exchange.cut_through``). Here stands what follows of that from the plan of an axis, for the frames of a
round; tests/budget holds one against the other.
"""

from collections.abc import Collection, Iterable
from typing import Final, NamedTuple

from gateway.drives.motion import Addressing, Form
from gateway.exchange.cut_through.delay import (
    Shape,
    acknowledgement_shape,
    delay_ns,
    margin_ns,
    read_shape,
    reply_shape,
    stored_ns,
    write_shape,
)
from gateway.exchange.plan import AxisPlan, CompensationMode, writes_alone
from gateway.modbus.registers import PositionField

REGISTER_READS: Final = frozenset({Form.FC03, Form.FC04})


class Shapes(NamedTuple):
    """A request and its reply, and which of their bytes wait for which."""

    request: Shape
    reply: Shape


class Delay(NamedTuple):
    """A frame that leaves while it arrives."""

    delay_ns: int
    """From its first bit on the one wire to its first bit on the other, with the margin."""
    saves_ns: int
    """So much sooner than stored; 0: it is not worth it, and is stored."""


def delay_of(shape: Shape, in_ns: int, out_ns: int) -> Delay:
    """Return how a frame leaves between two wires with so long characters, as ``MeasuredDelay`` has it.

    >>> delay_of(write_shape(2, 0, 2), 1_145_833, 1_145_833)  # both at 9 600 baud, 8E1
    Delay(delay_ns=4944790, saves_ns=9951039)
    """
    after_ns = delay_ns(shape, in_ns, out_ns) + margin_ns(out_ns)
    saves_ns = stored_ns(shape, in_ns) - after_ns
    return Delay(after_ns, saves_ns if saves_ns >= max(in_ns, out_ns) else 0)


def target_shapes(
    axis: AxisPlan, registers: int, with_rules: Collection[int], of_unit: Iterable[AxisPlan]
) -> Shapes | None:
    """Return the shapes of a target in a block of so many registers; None: it is stored.

    ``with_rules``: unit ids whose frames may mean something else than positions to be gone to at once.
    ``of_unit``: all axes of its unit id.
    """
    field = axis.command[0]
    is_plain = axis.compensation is not CompensationMode.SHADOW and not field.type.is_float
    if not (is_plain and _is_read_as_registers(axis)) or axis.unit_id in with_rules:
        return None
    is_early = not _word(field) and field.is_high_first_pair and writes_alone(of_unit, field)
    request = write_shape(registers, _word(field), field.words, is_early=is_early)
    return Shapes(request, acknowledgement_shape())


def position_shapes(axis: AxisPlan, field: PositionField) -> Shapes | None:
    """Return the shapes of a read of one position, with the block that it stands in; None: it is stored."""
    if not _is_read_as_registers(axis):
        return None
    word = _word(field)
    early = [word] if field.is_high_first_pair else []
    return Shapes(read_shape(), reply_shape(word + field.words, [(word, field.words)], early))


def registers_shapes(axis: AxisPlan, registers: int) -> Shapes | None:
    """Return the shapes of a read of registers that are no positions; None: it is stored."""
    return Shapes(read_shape(), reply_shape(registers)) if _is_read_as_registers(axis) else None


def _is_read_as_registers(axis: AxisPlan) -> bool:
    return axis.addressing is Addressing.REGISTERS and axis.reads_with in REGISTER_READS and axis.checks_crc


def _word(field: PositionField) -> int:
    """Return at which word of its block a position begins."""
    return 0 if field.block is None else field.address - field.block
