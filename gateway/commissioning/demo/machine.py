"""The machine of the demonstration: three axes on real sockets and pseudo terminals, with controllers.

Each has its own wiring and counting. The files that a retrofitter would write, gateway.toml and one .tab file
for each axis, are made here too.
"""

import random
import socket
from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, asynccontextmanager, closing
from dataclasses import dataclass
from enum import Enum
from math import floor, log10
from pathlib import Path
from random import Random
from typing import Final, Self

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from gateway.simulator.bus import DriveBus
from gateway.simulator.clock import SimulationClock
from gateway.simulator.controller import AxisController, AxisWiring
from gateway.simulator.drive import AxisRegisters, SimulatedAxis, SimulatedDrive
from gateway.simulator.endpoints import SerialDriveServer, TcpDriveServer
from gateway.simulator.gauge import Laser
from gateway.simulator.mechanics import Encoder, Mechanics, unit_mm
from gateway.simulator.motion import Dynamics
from gateway.simulator.pty import Pty
from gateway.simulator.screw import worn_screw
from gateway.tabfile import WriteOptions, dialect_named
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import ModbusMaster
from gateway.transport.null_modem import NullModem

OVERRUN_MM: Final = 1.0
"""Distance outside the table at which the axis turns round: more than any lost motion."""
MOVED: Final = 0.3
"""Largest distance of a target from a table point, in steps: ISO 230-2 requires irregular targets."""


class CableProtocol(Enum):
    """The protocol on a cable."""

    TCP = "tcp"
    RTU = "rtu"


@dataclass(frozen=True, slots=True)
class AxisSpec:
    """One axis; lengths in its ``units``.

    The table runs from ``low`` to ``high`` with a point every ``step``; one of both ends is home, 0.
    """

    name: str
    controller: CableProtocol
    drive: CableProtocol
    counts_per_unit: float
    low: float
    high: float
    lead_mm: float
    unit_id: int
    registers: AxisRegisters
    units: Units = Units.MM
    step: float = 10.0
    zero_counts: int = 0

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
        """Positions of the laser readings, lowest first: both ends, and irregular targets between them."""
        count = round((self.high - self.low) / self.step)
        random = Random(self.name)
        digits = 1 - floor(log10(self.step / 10))
        inner = (self.low + (i + random.uniform(-MOVED, MOVED)) * self.step for i in range(1, count))
        return [self.low, *(round(x, digits) for x in inner), self.high]

    @property
    def wiring(self) -> AxisWiring:
        """The controller's data about the axis."""
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
    def fields_at(address: int) -> tuple[PositionField, ...]:
        return (PositionField(address, RegisterType.INT32, order),)

    bits = {name: BitField(status, bit) for name, bit in (("done", 4), ("homed", 8), ("moving", 1))}
    return AxisRegisters(command=fields_at(command), actual=fields_at(actual), bits=bits)


AXES: Final = (
    AxisSpec(
        name="x",
        controller=CableProtocol.TCP,
        drive=CableProtocol.TCP,
        counts_per_unit=2000.0,
        low=-300.0,
        high=0.0,
        lead_mm=5.0,
        unit_id=1,
        registers=_registers(0x0606, 0x0520, 0x005C, WordOrder.LOW_FIRST),
    ),
    AxisSpec(
        name="y",
        controller=CableProtocol.RTU,
        drive=CableProtocol.RTU,
        counts_per_unit=1000.0,
        low=0.0,
        high=250.0,
        lead_mm=10.0,
        unit_id=2,
        registers=_registers(0x6201, 0x602C, 0x1003, WordOrder.HIGH_FIRST),
    ),
    AxisSpec(
        name="z",
        controller=CableProtocol.TCP,
        drive=CableProtocol.RTU,
        counts_per_unit=-50_000.0,
        low=-8.0,
        high=0.0,
        lead_mm=5.08,
        unit_id=3,
        registers=_registers(0x4000, 0x3700, 0x3200, WordOrder.LOW_FIRST),
        units=Units.INCH,
        step=0.4,
        zero_counts=120_000,
    ),
)


LOOPBACK: Final = "127.0.0.1"
PATIENCE_MS: Final = 10_000.0
"""Long time-outs: a busy computer may stop a whole demonstration for seconds."""
LASER_NOISE_UM: Final = 0.1
BACKLASH_UM: Final = (25.0, 45.0)
DYNAMICS: Final = Dynamics(speed_mm_s=200.0, acceleration_mm_s2=4000.0)


class RigAxis:
    """One axis of the machine, and both of its cables."""

    def __init__(self, spec: AxisSpec, seed: int, clock: SimulationClock) -> None:
        rng = random.Random(f"{seed}/{spec.name}")
        self.spec = spec
        self.clock = clock
        self.mechanics = Mechanics(
            worn_screw(rng, spec.low * spec.mm, (spec.high - spec.low) * spec.mm, spec.lead_mm),
            Encoder(spec.counts_per_unit / spec.mm, spec.zero_counts),
            backlash_mm=rng.uniform(*BACKLASH_UM) / 1000.0,
            dynamics=DYNAMICS,
        )
        self.laser = Laser(self.mechanics, noise_um=LASER_NOISE_UM, seed=rng.getrandbits(32))
        self.target_rng = rng
        self.drive_address = ""
        """The gateway's address of the drive: HOST:PORT, or the path of a port."""
        self.controller_address = ""
        """The address that the gateway opens for the controller."""
        self._controller_end: TcpEndpoint | SerialEndpoint | None = None

    async def open(self, exits: AsyncExitStack) -> None:
        """Connect the drive to its cable and set up the controller's; ``exits`` removes them."""
        axis = SimulatedAxis(self.spec.name, self.spec.registers, self.mechanics)
        bus = DriveBus([SimulatedDrive(self.spec.unit_id, [axis])])
        if self.spec.drive is CableProtocol.TCP:
            tcp = TcpDriveServer(bus, self.clock, host=LOOPBACK)
            await tcp.start()
            exits.push_async_callback(tcp.stop)
            self.drive_address = f"{LOOPBACK}:{tcp.port}"
        else:
            pty = exits.enter_context(closing(Pty()))
            exits.enter_context(closing(SerialDriveServer(bus, self.clock, pty.master_fd)))
            self.drive_address = pty.path
        if self.spec.controller is CableProtocol.TCP:
            self._controller_end = TcpEndpoint(LOOPBACK, free_port())
            self.controller_address = str(self._controller_end)
        else:
            cable = exits.enter_context(closing(NullModem()))
            self._controller_end = SerialEndpoint(cable.far)
            self.controller_address = cable.near

    @asynccontextmanager
    async def controller(self) -> AsyncIterator[AxisController]:
        """Connect the controller to the gateway, which must be running."""
        assert self._controller_end is not None
        async with ModbusMaster(self._controller_end, PATIENCE_MS) as master:
            yield AxisController(master, self.spec.wiring)


class Rig:
    """All axes; entering it connects them to their cables."""

    def __init__(self, specs: tuple[AxisSpec, ...], seed: int, clock: SimulationClock) -> None:
        self.axes = tuple(RigAxis(spec, seed, clock) for spec in specs)
        self._exits = AsyncExitStack()

    async def __aenter__(self) -> Self:
        """Open everything."""
        async with AsyncExitStack() as exits:
            for axis in self.axes:
                await axis.open(exits)
            self._exits = exits.pop_all()
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        """Close everything."""
        await self._exits.aclose()


def free_port() -> int:
    """Return a TCP port that is free now."""
    with socket.create_server((LOOPBACK, 0)) as listener:
        port: int = listener.getsockname()[1]
    return port


CONFIGURATION_NAME: Final = "gateway.toml"
TABLES_FOLDER: Final = "tables"
TABLE_FORMAT: Final = "centroid-3"

_HEAD: Final = f"""\
# Written by pitch-gateway demo. Ports and device paths belong to that one run.
[gateway]
name = "demo"
tables = "{TABLES_FOLDER}"

[http]
listen = ""
"""
_DRIVE_PORT: Final = ', baudrate = 115200, parity = "even"'
_CONTROLLER_PORT: Final = 'baudrate = 38400\nparity = "even"\n'
"""Serial settings; pseudo terminals ignore them."""


def table_name(spec: AxisSpec) -> str:
    """File name of an axis's table, as the old control names it."""
    return f"cnc10{spec.name}.tab"


def write_table(folder: Path, axis: RigAxis, table: CorrectionTable) -> Path:
    """Write a table as a Centroid version 3 file and return its path."""
    path = folder / TABLES_FOLDER / table_name(axis.spec)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = dialect_named(TABLE_FORMAT).write(table, WriteOptions(axis=axis.spec.name)).text
    path.write_text(text, encoding="ascii")
    return path


def write_configuration(folder: Path, axes: Iterable[RigAxis], *, corrected: bool) -> Path:
    """Write gateway.toml, with the tables in use or without, and return its path."""
    path = folder / CONFIGURATION_NAME
    path.write_text(_HEAD + "".join(_axis(axis, corrected=corrected) for axis in axes), encoding="utf-8")
    return path


def _axis(axis: RigAxis, *, corrected: bool) -> str:
    """Return the section of an axis's line, and that of the axis."""
    spec, registers = axis.spec, axis.spec.registers
    margin = 2 * spec.overrun
    port = _DRIVE_PORT if spec.drive is CableProtocol.RTU else ""
    use = f'table = "{table_name(spec)}"\ncompensation = "on"' if corrected else 'compensation = "off"'
    return f"""
[line.{spec.name}]
drives = {{ {spec.drive.value} = "{axis.drive_address}"{port} }}
response_timeout_ms = {PATIENCE_MS}

[[line.{spec.name}.controllers]]
name = "controller-{spec.name}"
{spec.controller.value} = "{axis.controller_address}"
timeout_ms = {PATIENCE_MS}
{_CONTROLLER_PORT if spec.controller is CableProtocol.RTU else ""}
[axis.{spec.name}]
line = "{spec.name}"
unit_id = {spec.unit_id}
units = "{spec.units.value}"
counts_per_unit = {spec.counts_per_unit}
zero_counts = {spec.zero_counts}
travel = [{spec.low - margin}, {spec.high + margin}]
referenced = "drive-bit"
home_approach = "{spec.home_direction.name.lower()}"
{use}

[axis.{spec.name}.registers]
command = [{_position(registers.command[0])}]
actual = [{_position(registers.actual[0])}]
bits = {{ {", ".join(f"{name} = {_bit(bit)}" for name, bit in registers.bits.items())} }}
"""


def _position(field: PositionField) -> str:
    return f'{{ address = {field.address:#06x}, type = "{field.type.value}", words = "{field.order.value}" }}'


def _bit(bit: BitField) -> str:
    return f"{{ address = {bit.address:#06x}, bit = {bit.bit} }}"
