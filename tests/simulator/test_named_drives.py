"""What all drives of known makes have in common, and how they are served."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.settings import AxisSettings
from gateway.compensation.units import Units
from gateway.exchange.plan import AxisPlan, CompensationMode, LineTiming, Reference
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.registers import PositionField, RegisterType
from gateway.simulator.bus import DriveBus
from gateway.simulator.drives.catalogue import DRIVES
from gateway.simulator.drives.motor_drive import HOMING_S, Basis
from gateway.simulator.endpoints import TcpDriveServer
from gateway.simulator.errors import SimulatorError
from gateway.simulator.ledger import MoveKind, MoveRecord
from gateway.simulator.world import World, simulated_bus
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.transport.endpoints import TcpEndpoint
from tests.simulator.drive_bench import ABSOLUTE, HOME, RELATIVE, SET_POSITION, STOP, Drive, motor

NAMES = sorted(DRIVES)


@pytest.mark.parametrize("name", NAMES)
@given(requests=st.lists(st.binary(min_size=1, max_size=60), max_size=5))
def test_no_bytes_upset_a_drive(name: str, requests: list[bytes]) -> None:
    drive = Drive(name)
    for number, request in enumerate(requests):
        reply = drive.bus.answer(1, request, float(number))
        assert reply is None or 1 <= len(reply) <= 253


@pytest.mark.parametrize("name", NAMES)
def test_a_drive_knows_its_function_codes_only(name: str) -> None:
    drive = Drive(name)
    for function in range(1, 128):
        reply = drive.ask(f"{function:02X}")
        knows = function in drive.unit.functions
        assert knows or reply in (f"{function | 0x80:02X} 01", ""), function


@pytest.mark.parametrize("name", NAMES)
def test_only_akd2g_moves_two_axes(name: str) -> None:
    if name == "kollmorgen-akd2g":
        assert len(Drive(name, axes=2).unit.axes) == 2
    else:
        with pytest.raises(
            SimulatorError,
            match="unit 1: give each axis its own unit id: this drive moves 1 axis, but 2 axes",
        ):
            Drive(name, axes=2)


def test_a_motor_says_what_it_does() -> None:
    drive = Drive("tl-r")
    axis = drive.motor
    axis.absolute(1_000, 0.0)
    assert list(drive.bus.ledger.moves) == [MoveRecord(1, "x", MoveKind.ABSOLUTE, 1_000, 0.0)]
    drive.wait()
    axis.relative(-1, Basis.ACTUAL, drive.now_s)
    assert drive.bus.ledger.moves[-1] == MoveRecord(1, "x", MoveKind.RELATIVE, 999, drive.now_s, -1)


def test_distances_count_from_target_or_place() -> None:
    axis = motor()
    axis.absolute(10_000, 0.0)
    axis.relative(1, Basis.COMMANDED, 0.05)
    assert axis.target_counts == 1_251  # 1000 mm/s² for 0.05 s is 1.25 mm.
    axis.relative(1, Basis.TARGET, 0.06)
    assert axis.target_counts == 1_252


def test_homing_takes_its_time_and_clears_the_reference() -> None:
    axis = motor()
    assert axis.home(0.0)
    axis.advance(HOMING_S / 2)
    assert (axis.is_homed, axis.is_homing, axis.is_done) == (False, True, False)
    axis.advance(HOMING_S)
    assert (axis.is_homed, axis.is_homing, axis.is_done) == (True, False, True)


def test_a_homing_that_is_stopped_leaves_no_reference() -> None:
    axis = motor()
    axis.absolute(10_000, 0.0)
    axis.advance(1.0)
    axis.home(1.0)
    axis.stop(1.05)
    axis.advance(9.0)
    assert (axis.is_homed, axis.actual_counts) == (False, 7_500)


def test_an_alarm_starts_nothing() -> None:
    axis = motor()
    axis.mechanics.alarm = True
    assert not axis.absolute(1, 0.0)
    assert not axis.relative(1, Basis.TARGET, 0.0)
    assert not axis.home(0.0)
    assert axis.target_counts == 0


def test_a_renamed_place_shifts_everything_after_it() -> None:
    axis = motor()
    axis.absolute(10_000, 0.0)
    axis.advance(1.0)
    axis.set_position(-3, 1.0)
    assert (axis.actual_counts, axis.target_counts) == (-3, -3)
    axis.absolute(0, 1.0)
    axis.advance(2.0)
    assert axis.mechanics.motor_mm == pytest.approx(10.003)


def test_all_kinds_of_moves_have_names() -> None:
    assert {kind.value for kind in (ABSOLUTE, RELATIVE, HOME, STOP, SET_POSITION)} < {
        k.value for k in MoveKind
    }


def plan(name: str, drive: str, unit_id: int = 1) -> AxisPlan:
    return AxisPlan(
        name=name,
        unit_id=unit_id,
        settings=AxisSettings(Units.MM, 1000.0, travel=(0.0, 100.0)),
        table=None,
        compensation=CompensationMode.OFF,
        referenced=Reference.ABSOLUTE,
        command=(PositionField(0x10, RegisterType.INT32),),
        drive=drive,
    )


def test_an_axis_gets_the_endpoint_of_its_drive_and_not_of_its_registers() -> None:
    bus = simulated_bus([plan("x", "kinco-fd"), plan("y", "", 2), plan("z", "./mine.toml", 3)], seed=0)
    assert bus.answer(1, bytes.fromhex("0300000001"), 0.0) == b"\x81\x02"
    for unit_id in (2, 3):
        bus.answer(unit_id, pack(">BHHBi", 16, 0x10, 2, 4, 500), 0.0)
    assert [bus.axis(name).mechanics.target_counts for name in "xyz"] == [0, 500, 500]


def test_two_axes_share_an_akd2g() -> None:
    bus = simulated_bus([plan(name, "kollmorgen-akd2g") for name in "xy"], seed=0)
    bus.answer(1, bytes.fromhex("10 0050 0002 04 0000 2710"), 0.0)
    bus.answer(1, bytes.fromhex("10 0048 0002 04 0000 0001"), 0.0)
    assert [bus.axis(name).mechanics.target_counts for name in "xy"] == [0, 10_000]
    assert [(move.axis, move.target_counts) for move in bus.ledger.moves] == [("y", 10_000)]


async def test_the_world_serves_named_drives(unused_tcp_port: int) -> None:
    endpoint = TcpEndpoint("127.0.0.1", unused_tcp_port)
    line = LinePlan("l", endpoint, (), (plan("x", "mitsubishi-mr-je-c", 255),), LineTiming())
    async with World(GatewayPlan("test", (line,)), lambda: 0.0) as world:
        assert world.served[0].axes[0].drive == "mitsubishi-mr-je-c"
        reader, writer = await asyncio.open_connection("127.0.0.1", unused_tcp_port)
        writer.write(encode_mbap(7, 255, bytes.fromhex("0360410001")))
        assert await reader.readexactly(11) == encode_mbap(7, 255, bytes.fromhex("03020640"))
        writer.close()
        await writer.wait_closed()


@pytest.fixture
async def served() -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """A Leadshine (1) and a Kinco (2) behind RTU over TCP."""
    async with AsyncExitStack() as exits:
        units = [DRIVES["leadshine-pr"](1, [motor()]), DRIVES["kinco-fd"](2, [motor("y")])]
        server = TcpDriveServer(DriveBus(units), lambda: 0.0, rtu=True)
        await server.start()
        exits.push_async_callback(server.stop)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        yield reader, writer
        writer.close()
        await writer.wait_closed()


async def test_leadshine_answers_a_wrong_check_sum_and_then_what_is_right(
    served: tuple[asyncio.StreamReader, asyncio.StreamWriter],
) -> None:
    reader, writer = served
    writer.write(bytes.fromhex("01 03 00 01 00 01 D5 C1"))  # D5 CA would be right.
    assert await reader.readexactly(5) == bytes.fromhex("01 83 08 40 F6")
    writer.write(bytes.fromhex("01 03 00 01 00 01 D5 CA"))
    assert await reader.readexactly(7) == bytes.fromhex("01 03 02 00 00 B8 44")


async def test_other_drives_stay_silent_at_a_wrong_check_sum(
    served: tuple[asyncio.StreamReader, asyncio.StreamWriter],
) -> None:
    reader, writer = served
    writer.write(bytes.fromhex("02 06 31 00 00 0F 00 00"))
    writer.write(bytes.fromhex("02 06 31 00 00 0F C7 01"))
    assert await reader.readexactly(8) == bytes.fromhex("02 06 31 00 00 0F C7 01")


async def test_each_drive_of_a_bus_has_its_own_response_delay() -> None:
    bus = DriveBus([DRIVES["delta-asda"](1, [motor()]), DRIVES["kinco-fd"](2, [motor("y")])])
    asked: list[int] = []

    def delay(unit_id: int) -> float:
        asked.append(unit_id)
        return bus.response_delay_s(unit_id, 9600) / 10

    server = TcpDriveServer(bus, lambda: 0.0, response_delay_s=delay)
    await server.start()
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    # The quick drive's reply does not overtake the slow one's.
    writer.write(encode_mbap(1, 1, b"\x03\x05\x20\x00\x02") + encode_mbap(2, 2, b"\x03\x32\x00\x00\x02"))
    expected = encode_mbap(1, 1, bytes.fromhex("030400000000")) + encode_mbap(
        2, 2, bytes.fromhex("030484000000")
    )
    assert await reader.readexactly(len(expected)) == expected
    assert asked == [1, 2]
    writer.close()
    await writer.wait_closed()
    await server.stop()
