"""The gateway between a controller and a drive: shipped profile, relay."""

import asyncio
from contextlib import AsyncExitStack
from typing import Final

from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.drives.library import shipped
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, LineTiming, Reference
from gateway.relay.gateway import Relay
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import ModbusMaster
from gateway.transport.null_modem import NullModem
from tests.contract.bench import COUNTS_PER_MM, LOOPBACK, PATIENCE_S, DriveBench

MACHINE_SPEED_MM_S: Final = 1e6
"""The script's clock runs much faster than the gateway's: readings grow old at once."""
TRAVEL_MM: Final = (-200.0, 200.0)


def table_of(forward_mm: float, backward_mm: float, slope: float = 0.0) -> CorrectionTable:
    """Return a straight table: the corrections at 0 in both directions, and how they grow with each mm."""
    forward, backward = (
        [correction_mm + slope * position_mm for position_mm in TRAVEL_MM]
        for correction_mm in (forward_mm, backward_mm)
    )
    return make_table(TRAVEL_MM, forward, backward, Units.MM)


def axis_plan(drive: str, unit_id: int, table: CorrectionTable) -> AxisPlan:
    """Return the axis with the registers of the drive's shipped profile."""
    registers = shipped(drive).registers
    return AxisPlan(
        name="x",
        unit_id=unit_id,
        settings=AxisSettings(Units.MM, COUNTS_PER_MM, travel=TRAVEL_MM, max_speed=MACHINE_SPEED_MM_S),
        table=table,
        compensation=CompensationMode.ON,
        referenced=Reference.ABSOLUTE,
        command=tuple(field for position in registers.command for field in position.fields()),
        actual=tuple(position.field() for position in registers.actual),
        commanded=tuple(position.field() for position in registers.commanded),
        guarded=tuple(field for position in registers.position_like for field in position.fields()),
        remapping=tuple(field for position in registers.remap for field in position.fields()),
        limits=tuple(position.field() for position in registers.limits),
        aliases=tuple(position.field() for position in registers.aliases),
        settable=frozenset(n for n, position in enumerate(registers.actual) if position.set_position),
        motion=registers.motion(),
        addressing=registers.addressing,
        object_words={entry.address: entry.words for entry in registers.objects},
        reads_with=registers.read,
        writes_with=registers.write,
        bits={name: bit.field() for name, bit in registers.bits.named()},
        max_registers=registers.max_registers,
        safe_read=registers.safe_read,
        refused_read=registers.refused_read,
        done_drop_ms=registers.done_drop_ms,
        drive=drive,
    )


async def master_through_gateway(
    bench: DriveBench, exits: AsyncExitStack, table: CorrectionTable
) -> ModbusMaster:
    """Put a gateway in front of the drive; the controller has the same kind of cable as the drive."""
    drives = await bench.serve()
    axis = axis_plan(bench.session.drive, bench.session.unit_id, table)
    if isinstance(drives, TcpEndpoint):
        relay = await _start(axis, drives, TcpEndpoint(LOOPBACK, 0), exits)
        return await bench.master(relay.address("l", "cnc"))
    cable = NullModem()
    exits.callback(cable.close)
    await _start(axis, drives, SerialEndpoint(cable.near, 115200), exits)
    return await bench.master(SerialEndpoint(cable.far, 115200))


async def _start(
    axis: AxisPlan,
    drives: TcpEndpoint | SerialEndpoint,
    controller: TcpEndpoint | SerialEndpoint,
    exits: AsyncExitStack,
) -> Relay:
    plan = ControllerPlan("cnc", timeout_ms=PATIENCE_S * 1000, serial=isinstance(drives, SerialEndpoint))
    timing = LineTiming(gap_ms=shipped(axis.drive).registers.gap_ms)
    line = LinePlan("l", drives, (ControllerLink(plan, controller),), (axis,), timing)
    relay = Relay(GatewayPlan("contract", (line,)))
    await relay.start()
    exits.push_async_callback(relay.stop)
    async with asyncio.timeout(PATIENCE_S):
        while not _is_up(relay):  # noqa: ASYNC110 - a line tells nobody when its drive is there
            await asyncio.sleep(0)
    return relay


def _is_up(relay: Relay) -> bool:
    return relay.status().lines["l"].state == "up"
