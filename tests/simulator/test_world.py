"""The simulated machine around a plan: every drive behind its own address, every port made and taken away."""

import asyncio
import os
from pathlib import Path
from struct import pack

import pytest

from gateway.compensation.settings import AxisSettings
from gateway.compensation.units import Units
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, LineTiming, Reference
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.registers import BitField, PositionField, RegisterType
from gateway.modbus.rtu import encode_rtu
from gateway.simulator.errors import SimulatorError
from gateway.simulator.pty import FdChannel, PortLinks, open_serial
from gateway.simulator.world import World, simulated_axis
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import ModbusMaster

COMMAND, ACTUAL, STATUS = 0x10, 0x20, 0x30


def axis(name: str, unit_id: int = 1, counts_per_unit: float = 1000.0, units: Units = Units.MM) -> AxisPlan:
    settings = AxisSettings(units, counts_per_unit, travel=(-300.0, -10.0) if name == "x" else (0.0, 10.0))
    return AxisPlan(
        name=name,
        unit_id=unit_id,
        settings=settings,
        table=None,
        compensation=CompensationMode.OFF,
        referenced=Reference.DRIVE_BIT,
        command=(PositionField(COMMAND + 0x100 * unit_id, RegisterType.INT32),),
        actual=(PositionField(ACTUAL + 0x100 * unit_id, RegisterType.INT32),),
        bits={"homed": BitField(STATUS, 2)},
    )


def plan(drives: TcpEndpoint | SerialEndpoint, *axes: AxisPlan, device: str = "") -> GatewayPlan:
    controllers = [ControllerLink(ControllerPlan("hmi"), TcpEndpoint("127.0.0.1", 1))]
    if device:
        serial = ControllerPlan("cnc", serial=True)
        controllers.append(ControllerLink(serial, SerialEndpoint(device, 1_000_000)))
    return GatewayPlan("test", (LinePlan("l", drives, tuple(controllers), axes, LineTiming()),))


def names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


async def read_status(device: Path) -> bytes:
    async with ModbusMaster(SerialEndpoint(str(device))) as master:
        return await master.exchange(1, pack(">BHH", 3, STATUS, 1))


@pytest.mark.parametrize("paced", [True, False])
async def test_a_serial_line_has_its_ports_while_it_is_simulated(tmp_path: Path, paced: bool) -> None:
    drives, cnc = tmp_path / "dev" / "ttyDrives", tmp_path / "dev" / "ttyCnc"
    line = SerialEndpoint(str(drives), 1_000_000)
    async with World(plan(line, axis("x"), device=str(cnc)), lambda: 0.0, paced=paced) as world:
        (served,) = world.served
        assert (served.kind, served.address) == ("rtu", str(drives))
        assert served.controllers[1].gateway_opens == str(cnc)
        assert served.controllers[1].controller_opens == f"{cnc}.controller"
        assert await read_status(drives) == b"\x03\x02\x00\x04"
    assert names_in(tmp_path) == []


async def test_the_two_ends_of_a_controllers_wire_are_joined(tmp_path: Path) -> None:
    cnc = tmp_path / "ttyCnc"
    line = SerialEndpoint(str(tmp_path / "ttyDrives"))
    async with World(plan(line, axis("x"), device=str(cnc)), lambda: 0.0) as world:
        controller_side = open_serial(world.served[0].controllers[1].controller_opens)
        gateway_side = open_serial(str(cnc))
        arrived = asyncio.get_running_loop().create_future()
        gateway = FdChannel(gateway_side)
        gateway.listen(arrived.set_result)
        os.write(controller_side, b"!")
        assert await arrived == b"!"
        gateway.close()
        os.close(gateway_side)
        os.close(controller_side)


@pytest.mark.parametrize("rtu", [False, True])
async def test_drives_with_tcp_addresses_are_listened_for(unused_tcp_port: int, rtu: bool) -> None:
    endpoint = TcpEndpoint("127.0.0.1", unused_tcp_port, rtu=rtu)
    async with World(plan(endpoint, axis("x"), axis("y", 2)), lambda: 0.0) as world:
        assert [(a.name, a.unit_id) for a in world.served[0].axes] == [("x", 1), ("y", 2)]
        request = pack(">BHH", 3, STATUS, 1)
        reader, writer = await asyncio.open_connection("127.0.0.1", unused_tcp_port)
        writer.write(encode_rtu(2, request) if rtu else encode_mbap(7, 2, request))
        reply = b"\x03\x02\x00\x04"
        expected = encode_rtu(2, reply) if rtu else encode_mbap(7, 2, reply)
        assert await reader.readexactly(len(expected)) == expected
        writer.close()
        await writer.wait_closed()


async def test_an_address_of_another_machine_is_named_with_what_to_do() -> None:
    world = World(plan(TcpEndpoint("203.0.113.7", 502), axis("x")), lambda: 0.0)
    with pytest.raises(
        SimulatorError, match=r"203\.0\.113\.7:502.*not an address of this machine.*127\.0\.0\.1"
    ):
        async with world:
            pass


async def test_a_port_that_exists_is_left_alone(tmp_path: Path) -> None:
    device = tmp_path / "ttyS0"
    device.touch()
    with pytest.raises(SimulatorError, match="ttyS0 exists"):
        async with World(plan(SerialEndpoint(str(device)), axis("x")), lambda: 0.0):
            pass
    assert device.exists()


def test_a_link_left_over_from_a_killed_simulation_is_replaced(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB7"
    device.symlink_to(tmp_path / "gone")
    links = PortLinks()
    pty = links.make(device)
    assert str(device.readlink()) == pty.path
    links.close()
    assert not device.is_symlink()


def test_a_place_that_may_not_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    links = PortLinks()
    with pytest.raises(SimulatorError, match=r"cannot make a port at .*/file/ttyX.*/tmp/ttyX"):
        links.make(tmp_path / "file" / "ttyX")
    links.close()


def test_an_axis_stands_at_zero_or_at_the_end_of_travel_that_is_nearest() -> None:
    x, y = simulated_axis(axis("x"), 0).mechanics, simulated_axis(axis("y"), 0).mechanics
    assert (x.motor_mm, y.motor_mm) == (-10.0, 0.0)


def test_the_same_seed_makes_the_same_machine_and_units_are_millimetres_inside() -> None:
    inch = axis("y", counts_per_unit=-2540.0, units=Units.INCH)
    first, same, other = (simulated_axis(inch, seed).mechanics for seed in (1, 1, 2))
    assert first.screw == same.screw != other.screw
    assert first.backlash_mm == same.backlash_mm >= 0.020
    assert first.encoder.counts_per_mm == pytest.approx(-100.0)
    assert first.screw.length_mm == pytest.approx(254.0)  # 10 inches of travel
