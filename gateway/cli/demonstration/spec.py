"""The machine of the demonstration: three axes, each wired and counted in another way."""

from dataclasses import dataclass
from enum import Enum
from math import floor, log10
from random import Random
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from gateway.simulator.axis import AxisRegisters
from gateway.simulator.controller import AxisWiring
from gateway.simulator.mechanics import unit_mm

OVERRUN_MM: Final = 1.0
"""How far the axis turns round outside the table: more than any lost motion."""
MOVED: Final = 0.3
"""So many steps at most a target lies off a point of the table: ISO 230-2 asks for irregular targets."""


class Cable(Enum):
    """What a cable carries."""

    TCP = "tcp"
    RTU = "rtu"


@dataclass(frozen=True, slots=True)
class AxisSpec:
    """One axis; lengths in its ``units``.

    The table runs from ``low`` to ``high`` with a point every ``step``; one of both ends is home, 0.
    """

    name: str
    controller: Cable
    drive: Cable
    units: Units
    counts_per_unit: float
    zero_counts: int
    low: float
    high: float
    step: float
    lead_mm: float
    unit_id: int
    registers: AxisRegisters

    @property
    def mm(self) -> float:
        """Millimetres of one unit."""
        return unit_mm(self.units)

    @property
    def overrun(self) -> float:
        """Overrun at both ends, in units."""
        return OVERRUN_MM / self.mm

    @property
    def home_direction(self) -> Direction:
        """Direction of the last move of homing: away from the end of travel where the home switch is."""
        return Direction.FORWARD if self.low == 0.0 else Direction.BACKWARD

    @property
    def measured(self) -> list[float]:
        """Where the laser measures, lowest first: both ends, and irregular targets between them."""
        count = round((self.high - self.low) / self.step)
        random = Random(self.name)
        digits = 1 - floor(log10(self.step / 10))
        inner = (self.low + (i + random.uniform(-MOVED, MOVED)) * self.step for i in range(1, count))
        return [self.low, *(round(x, digits) for x in inner), self.high]

    @property
    def wiring(self) -> AxisWiring:
        """What the controller knows of the axis."""
        registers = self.registers
        return AxisWiring(
            self.unit_id,
            registers.command[0],
            registers.actual[0],
            registers.bits["done"],
            self.counts_per_unit,
            self.zero_counts,
        )

    @property
    def title(self) -> str:
        """Name and cables, for a person."""
        return f"{self.name}: {self.controller.value} → gateway → {self.drive.value}"


def _registers(command: int, actual: int, status: int, order: WordOrder) -> AxisRegisters:
    return AxisRegisters(
        command=(PositionField(command, RegisterType.INT32, order),),
        actual=(PositionField(actual, RegisterType.INT32, order),),
        bits={"done": BitField(status, 4), "homed": BitField(status, 8), "moving": BitField(status, 1)},
    )


AXES: Final = (
    AxisSpec(
        name="x",
        controller=Cable.TCP,
        drive=Cable.TCP,
        units=Units.MM,
        counts_per_unit=2000.0,
        zero_counts=0,
        low=-300.0,
        high=0.0,
        step=10.0,
        lead_mm=5.0,
        unit_id=1,
        registers=_registers(0x0606, 0x0520, 0x005C, WordOrder.LOW_FIRST),
    ),
    AxisSpec(
        name="y",
        controller=Cable.RTU,
        drive=Cable.RTU,
        units=Units.MM,
        counts_per_unit=1000.0,
        zero_counts=0,
        low=0.0,
        high=250.0,
        step=10.0,
        lead_mm=10.0,
        unit_id=2,
        registers=_registers(0x6201, 0x602C, 0x1003, WordOrder.HIGH_FIRST),
    ),
    AxisSpec(
        name="z",
        controller=Cable.TCP,
        drive=Cable.RTU,
        units=Units.INCH,
        counts_per_unit=-50_000.0,
        zero_counts=120_000,
        low=-8.0,
        high=0.0,
        step=0.4,
        lead_mm=5.08,
        unit_id=3,
        registers=_registers(0x4000, 0x3700, 0x3200, WordOrder.LOW_FIRST),
    ),
)
