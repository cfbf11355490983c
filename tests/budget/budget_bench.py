"""Lines made of plain data, for the arithmetic of their times."""

from dataclasses import replace

from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.library import shipped
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, LineTiming, Reference, Role
from gateway.modbus.registers import PositionField, RegisterType
from gateway.state.plan import ControllerLink, LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

TABLE = make_table([0.0, 100.0], [0.01, 0.02], [0.0, 0.0], Units.MM)
"""Its directions differ."""
TCP = TcpEndpoint("127.0.0.1", 502)


def serial(baudrate: int, parity: str = "E") -> SerialEndpoint:
    """Return a serial port; 8E1 unless told otherwise: 11 bits for a byte."""
    return SerialEndpoint(f"/dev/{baudrate}", baudrate, parity)


def axis(name: str = "x", unit_id: int = 1) -> AxisPlan:
    """Return an axis that is written with FC16 and read with FC03, 32 bits each, and moves at once."""
    return AxisPlan(
        name=name,
        unit_id=unit_id,
        settings=AxisSettings(units=Units.MM, counts_per_unit=1000.0),
        table=None,
        compensation=CompensationMode.ON,
        referenced=Reference.ABSOLUTE,
        command=(PositionField(0x100, RegisterType.INT32),),
        actual=(PositionField(0x200, RegisterType.INT32),),
    )


def known_axis(profile: str, name: str = "x", unit_id: int = 1) -> AxisPlan:
    """Return an axis with the registers of a shipped profile and a table."""
    registers = shipped(profile).registers
    return replace(
        axis(name, unit_id),
        table=TABLE,
        command=tuple(field for position in registers.command for field in position.fields()),
        actual=tuple(position.field() for position in registers.actual),
        commanded=tuple(position.field() for position in registers.commanded),
        motion=registers.motion(),
        addressing=registers.addressing,
        object_words={entry.address: entry.words for entry in registers.objects},
        reads_with=registers.read,
        writes_with=registers.write,
        bits={name: bit.field() for name, bit in registers.bits.named()},
        max_registers=registers.max_registers,
        drive=profile,
    )


def controller(
    endpoint: SerialEndpoint | TcpEndpoint,
    name: str = "cnc",
    *,
    role: Role = Role.MOTION,
    timeout_ms: float = 1000.0,
) -> ControllerLink:
    """Return a controller."""
    return ControllerLink(ControllerPlan(name, role, timeout_ms), endpoint)


def line(
    drives: SerialEndpoint | TcpEndpoint,
    *controllers: ControllerLink,
    axes: tuple[AxisPlan, ...] = (),
    timing: LineTiming | None = None,
) -> LinePlan:
    """Return a line; without axes one of :func:`axis`."""
    return LinePlan("xyz", drives, controllers, axes or (axis(),), timing or LineTiming())
