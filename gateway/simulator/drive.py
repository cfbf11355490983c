"""A generic drive: its axes have the registers of a configuration.

It moves as soon as a position is written. It echoes the vendor codes 0x41, 0x64 and 0x65.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from gateway.exchange.plan import AxisPlan
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from gateway.simulator.ledger import Ledger
from gateway.simulator.mechanics import Mechanics
from gateway.simulator.server import MAX_READ_REGISTERS, MAX_WRITE_REGISTERS, RegisterImage, RegisterServer

STANDARD_FUNCTIONS: Final = frozenset({1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 22, 23})
VENDOR_FUNCTIONS: Final = (0x41, 0x64, 0x65)


class StatusBit(Enum):
    """Bits of a drive's state, by their names in a configuration."""

    HOMED = "homed"
    DONE = "done"
    MOVING = "moving"
    ALARM = "alarm"


@dataclass(frozen=True, slots=True)
class AxisRegisters:
    """Registers for the commands and the state of an axis."""

    command: tuple[PositionField, ...]
    actual: tuple[PositionField, ...] = ()
    commanded: tuple[PositionField, ...] = ()
    bits: Mapping[str, BitField] = field(default_factory=dict)


DEFAULT_REGISTERS = AxisRegisters(
    command=(PositionField(0x0100, RegisterType.INT32, WordOrder.HIGH_FIRST),),
    actual=(PositionField(0x0200, RegisterType.INT32, WordOrder.HIGH_FIRST),),
    commanded=(PositionField(0x0202, RegisterType.INT32, WordOrder.HIGH_FIRST),),
    bits={
        "homed": BitField(0x0204, 0),
        "done": BitField(0x0204, 1),
        "moving": BitField(0x0204, 2),
        "alarm": BitField(0x0204, 3),
    },
)
"""The map of a generic drive, for trials without a configuration."""


class SimulatedAxis:
    """Joins mechanics and registers: a written command starts a move; readings are computed when read."""

    def __init__(self, name: str, registers: AxisRegisters, mechanics: Mechanics) -> None:
        self.name = name
        self.registers = registers
        self.mechanics = mechanics

    @classmethod
    def from_plan(cls, plan: AxisPlan, mechanics: Mechanics) -> "SimulatedAxis":
        """Return an axis with the registers of a configuration's axis."""
        registers = AxisRegisters(plan.command, plan.actual, plan.commanded, plan.bits)
        return cls(plan.name, registers, mechanics)

    def initialise(self, image: RegisterImage) -> None:
        """Write the start position into every field, also into the command fields."""
        for command_field in self.registers.command:
            _show(image, command_field, self.mechanics.target_counts)
        self.refresh(image, 0.0)

    def refresh(self, image: RegisterImage, now_s: float) -> None:
        """Update positions and status bits."""
        mechanics = self.mechanics
        mechanics.advance(now_s)
        for actual_field in self.registers.actual:
            _show(image, actual_field, mechanics.actual_counts)
        for commanded_field in self.registers.commanded:
            # The profile's own position at this moment; the simulated motor follows it without lag.
            _show(image, commanded_field, mechanics.actual_counts)
        for name, bit_field in self.registers.bits.items():
            image.set_bit(bit_field, self._bit(StatusBit(name)))

    def written(self, image: RegisterImage, address: int, count: int, now_s: float) -> None:
        """Handle written registers: start a move if one of them belongs to a command field.

        If only one word of a command is written, the axis moves to the field's new value, like a drive whose
        register is live.
        """
        for command_field in self.registers.command:
            if command_field.address < address + count and address < command_field.end:
                raw = command_field.unpack(image.words(command_field.address, command_field.words))
                self.mechanics.command(raw * command_field.scale, now_s)

    def _bit(self, bit: StatusBit) -> bool:
        match bit:
            case StatusBit.HOMED:
                return self.mechanics.homed
            case StatusBit.DONE:
                return self.mechanics.is_done
            case StatusBit.MOVING:
                return self.mechanics.is_moving
            case StatusBit.ALARM:
                return self.mechanics.alarm


def _show(image: RegisterImage, position_field: PositionField, counts: float) -> None:
    """Write a position as the drive shows it: whole counts that wrap round, or a float unchanged."""
    raw = counts / position_field.scale
    if position_field.type.is_float:
        image.store_words(position_field.address, position_field.pack(raw))
        return
    bits = 16 * position_field.words
    low = 0 if position_field.type.value.startswith("u") else -(1 << (bits - 1))
    image.store_words(position_field.address, position_field.pack((round(raw) - low) % (1 << bits) + low))


class SimulatedDrive(RegisterServer):
    """One unit on a bus, with its axes.

    ``max_registers`` is the most in one frame; ``without`` lists function codes that this drive does not
    support.
    """

    def __init__(
        self,
        unit_id: int,
        axes: Sequence[SimulatedAxis] = (),
        *,
        image: RegisterImage | None = None,
        max_registers: int = MAX_READ_REGISTERS,
        without: Sequence[int] = (),
        ledger: Ledger | None = None,
    ) -> None:
        super().__init__(unit_id, image)
        self.axes: tuple[SimulatedAxis, ...] = tuple(axes)
        self.ledger = ledger if ledger is not None else self.ledger
        self.max_read = min(MAX_READ_REGISTERS, max_registers)
        self.max_write = min(MAX_WRITE_REGISTERS, max_registers)
        self.functions = STANDARD_FUNCTIONS.union(VENDOR_FUNCTIONS).difference(without)
        self._handlers.update(dict.fromkeys(VENDOR_FUNCTIONS, _echo))
        for axis in self.axes:
            axis.initialise(self.image)

    def answer(self, pdu: bytes, now_s: float) -> bytes:
        """Execute a request; always returns a reply."""
        reply = super().answer(pdu, now_s)
        assert reply is not None
        return reply

    def refresh(self, now_s: float) -> None:
        """Update all registers."""
        for axis in self.axes:
            axis.refresh(self.image, now_s)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Store registers and start the moves that they command."""
        self.image.store_words(address, data)
        for axis in self.axes:
            axis.written(self.image, address, len(data) // 2, now_s)


def _echo(pdu: bytes, _now_s: float) -> bytes:
    return pdu
