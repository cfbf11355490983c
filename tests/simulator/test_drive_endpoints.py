"""Simulated drives on their endpoints, with frames of the manuals."""

import asyncio
import contextlib
import os
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack
from struct import pack

import pytest
from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.client.base import ModbusBaseClient

from gateway.modbus.crc import append_crc, inverted_crc, is_intact, residue_after
from gateway.modbus.rtu import encode_rtu
from gateway.simulator.bus import DriveBus
from gateway.simulator.drive import DEFAULT_REGISTERS, SimulatedAxis, SimulatedDrive
from gateway.simulator.ears import Hearing
from gateway.simulator.endpoints import SerialDriveServer, TcpDriveServer
from gateway.simulator.errors import SimulatorError
from gateway.simulator.mechanics import Encoder, Mechanics
from gateway.simulator.pty import FdChannel, Pty, open_serial
from gateway.simulator.screw import Screw
from gateway.simulator.wire import Cable as WireCable
from gateway.simulator.wire import SerialWire
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import LostError, ModbusMaster, SilentError
from tests.simulator.drive_bench import ABSOLUTE, GOLDEN_FRAMES, HOME, OTHER, STOP, Drive

COMMAND, ACTUAL, STATUS = 0x0100, 0x0200, 0x0204


class SteppedClock:
    """The simulated world moves on only when the test says so."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.was_looked_at = asyncio.Event()

    def __call__(self) -> float:
        self.was_looked_at.set()
        return self.now_s


def two_axes() -> DriveBus:
    return DriveBus(
        SimulatedDrive(unit, [SimulatedAxis(name, DEFAULT_REGISTERS, Mechanics(Screw(), Encoder(1000.0)))])
        for unit, name in ((1, "x"), (2, "y"))
    )


class Cable:
    """One way to reach the same two drives."""

    def __init__(self, exits: AsyncExitStack) -> None:
        self.exits = exits
        self.bus = two_axes()
        self.clock = SteppedClock()
        self.pty: Pty | None = None
        self.tcp: TcpDriveServer | None = None

    async def lay(self, kind: str, response_delay_s: float = 0.0) -> None:
        if kind == "rtu":
            self.pty = Pty()
            self.exits.callback(self.pty.close)
            server = SerialDriveServer(
                self.bus, self.clock, self.pty.master_fd, response_delay_s=response_delay_s
            )
            self.exits.callback(server.close)
        else:
            self.tcp = TcpDriveServer(
                self.bus, self.clock, rtu=kind == "rtu_over_tcp", response_delay_s=response_delay_s
            )
            await self.tcp.start()
            self.exits.push_async_callback(self.tcp.stop)

    async def pymodbus(self) -> ModbusBaseClient:
        client: ModbusBaseClient
        if self.pty is not None:
            client = AsyncModbusSerialClient(self.pty.path, baudrate=115200, timeout=20, retries=0)
        else:
            assert self.tcp is not None
            framer = FramerType.RTU if self.tcp.rtu else FramerType.SOCKET
            port = self.tcp.port
            client = AsyncModbusTcpClient("127.0.0.1", port=port, framer=framer, timeout=20, retries=0)
        assert await client.connect()
        self.exits.callback(client.close)
        return client

    async def master(self, timeout_ms: float = 2000.0) -> ModbusMaster:
        endpoint: TcpEndpoint | SerialEndpoint
        if self.pty is not None:
            endpoint = SerialEndpoint(self.pty.path)
        else:
            assert self.tcp is not None
            endpoint = TcpEndpoint("127.0.0.1", self.tcp.port, rtu=self.tcp.rtu)
        return await self.exits.enter_async_context(ModbusMaster(endpoint, timeout_ms))


LayCable = Callable[..., Awaitable[Cable]]


@pytest.fixture
async def lay_cable() -> AsyncIterator[LayCable]:
    async with AsyncExitStack() as exits:

        async def lay(kind: str, response_delay_s: float = 0.0) -> Cable:
            cable = Cable(exits)
            await cable.lay(kind, response_delay_s)
            return cable

        yield lay


@pytest.mark.parametrize("kind", ["tcp", "rtu", "rtu_over_tcp"])
async def test_pymodbus_moves_and_reads_an_axis(lay_cable: LayCable, kind: str) -> None:
    cable = await lay_cable(kind)
    client = await cable.pymodbus()
    target = client.convert_to_registers(-25_000, client.DATATYPE.INT32)
    assert not (await client.write_registers(COMMAND, target, device_id=2)).isError()
    status = await client.read_holding_registers(STATUS, count=1, device_id=2)
    assert status.registers == [0b101]  # homed, moving
    cable.clock.now_s = 60.0
    actual = await client.read_input_registers(ACTUAL, count=2, device_id=2)
    assert client.convert_from_registers(actual.registers, client.DATATYPE.INT32) == -25_000
    status = await client.read_holding_registers(STATUS, count=1, device_id=2)
    assert status.registers == [0b011]  # homed, done
    assert cable.bus.axis("x").mechanics.motor_mm == 0.0


@pytest.mark.parametrize("kind", ["tcp", "rtu", "rtu_over_tcp"])
async def test_pymodbus_understands_every_other_function(lay_cable: LayCable, kind: str) -> None:
    client = await (await lay_cable(kind)).pymodbus()
    await client.write_coils(10, [True, False, True], device_id=1)
    await client.write_coil(11, True, device_id=1)
    assert (await client.read_coils(10, count=3, device_id=1)).bits[:3] == [True, True, True]
    assert (await client.read_discrete_inputs(13, count=1, device_id=1)).bits[0] is False
    await client.write_register(0x50, 0x12, device_id=1)
    await client.mask_write_register(address=0x50, and_mask=0xF2, or_mask=0x25, device_id=1)
    reply = await client.readwrite_registers(
        read_address=0x50, read_count=2, write_address=0x51, values=[7], device_id=1
    )
    assert reply.registers == [0x17, 7]
    refused = await client.read_holding_registers(0xFFFF, count=2, device_id=1)
    assert refused.isError()
    assert refused.exception_code == 2


@pytest.mark.parametrize("kind", ["tcp", "rtu"])
@pytest.mark.parametrize("request_hex", ["41010203", "6400", "65AABBCCDD", "080000A537"])
async def test_vendor_codes_come_back_over_the_wire(lay_cable: LayCable, kind: str, request_hex: str) -> None:
    master = await (await lay_cable(kind)).master()
    pdu = bytes.fromhex(request_hex)
    assert await master.exchange(1, pdu) == pdu


async def test_a_tcp_drive_answers_pipelined_requests_in_order(lay_cable: LayCable) -> None:
    cable = await lay_cable("tcp", 0.002)
    assert cable.tcp is not None
    reader, writer = await asyncio.open_connection("127.0.0.1", cable.tcp.port)
    writer.write(bytes.fromhex("000700000006010300000001" + "000800000006020300000001" + "0009000000020107"))
    replies = await reader.readexactly(11 + 11 + 9)
    assert replies.hex() == "000700000005010302000000080000000502030200000009000000030107" + "00"
    writer.close()
    await writer.wait_closed()


async def test_an_unknown_unit_is_a_failed_target_on_tcp(lay_cable: LayCable) -> None:
    master = await (await lay_cable("tcp")).master()
    assert await master.exchange(9, pack(">BHH", 3, 0, 1)) == b"\x83\x0b"


async def test_an_unknown_unit_is_silence_on_a_serial_line(lay_cable: LayCable) -> None:
    master = await (await lay_cable("rtu")).master(timeout_ms=20.0)
    with pytest.raises(SilentError, match="no reply within 20 ms"):
        await master.exchange(9, pack(">BHH", 3, 0, 1))


async def test_a_frame_with_a_bad_check_sum_is_not_answered_and_the_next_is(lay_cable: LayCable) -> None:
    cable = await lay_cable("rtu_over_tcp")
    assert cable.tcp is not None
    reader, writer = await asyncio.open_connection("127.0.0.1", cable.tcp.port)
    writer.write(bytes.fromhex("010300000001840B" + "010300000001840A"))
    assert await reader.readexactly(7) == bytes.fromhex("0103020000B844")
    writer.close()
    await writer.wait_closed()


async def test_a_connection_that_speaks_something_else_is_closed(lay_cable: LayCable) -> None:
    cable = await lay_cable("tcp")
    assert cable.tcp is not None
    reader, writer = await asyncio.open_connection("127.0.0.1", cable.tcp.port)
    writer.write(b"GET / HTTP/1.1\r\nHost: drive\r\n\r\n")
    assert await reader.read() == b""
    writer.close()
    await writer.wait_closed()


async def test_a_drive_that_is_switched_off_ends_the_exchange(lay_cable: LayCable) -> None:
    cable = await lay_cable("tcp", 60.0)
    assert cable.tcp is not None
    master = await cable.master(timeout_ms=60_000.0)
    exchange = asyncio.create_task(master.exchange(1, pack(">BHH", 3, 0, 1)))
    await cable.clock.was_looked_at.wait()
    cable.tcp.drop_connections()
    with pytest.raises(LostError, match="closed"):
        await exchange


async def test_a_port_in_use_is_named() -> None:
    first = TcpDriveServer(two_axes(), SteppedClock())
    await first.start()
    with pytest.raises(SimulatorError, match=rf"cannot listen on 127\.0\.0\.1:{first.port}"):
        await TcpDriveServer(two_axes(), SteppedClock(), port=first.port).start()
    await first.stop()


@pytest.mark.parametrize("turns", range(5))
async def test_who_connected_just_before_the_end_is_not_left_hanging(turns: int) -> None:
    server = TcpDriveServer(two_axes(), SteppedClock())
    await server.start()
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as there:
        for _ in range(turns):
            await asyncio.sleep(0)
        await server.stop()
        with contextlib.suppress(ConnectionResetError):
            assert await asyncio.get_running_loop().run_in_executor(None, there.recv, 1) == b""


async def test_a_serial_wire_carries_both_directions(lay_cable: LayCable) -> None:
    cable = await lay_cable("rtu")
    assert cable.pty is not None
    near, far = Pty(), Pty()
    line = SerialEndpoint("", baudrate=1_000_000)
    wire = SerialWire(near.master_fd, far.master_fd, line)
    server = SerialDriveServer(cable.bus, cable.clock, _opened(cable, far), wire=line)
    try:
        async with ModbusMaster(SerialEndpoint(near.path)) as bridge:
            assert await bridge.exchange(1, pack(">BHH", 3, STATUS, 1)) == b"\x03\x02\x00\x03"
    finally:
        server.close()
        wire.close()
        near.close()
        far.close()


def _opened(cable: Cable, pty: Pty) -> int:
    fd = open_serial(pty.path)
    cable.exits.callback(os.close, fd)
    return fd


class Complaining(SimulatedDrive):
    """Says so where a check sum is wrong, as some drives do."""

    def bad_crc_reply(self, function: int) -> bytes | None:
        return bytes((function | 0x80, 8))


@pytest.mark.parametrize(
    ("hearing", "obeyed"),
    [
        (Hearing.STANDARD, False),
        (Hearing.ANY_LENGTH, False),
        (Hearing.MERGING, False),
        (Hearing.NO_CHECK, True),
    ],
)
async def test_drives_on_a_pty_hear_as_they_were_told_to(hearing: Hearing, obeyed: bool) -> None:
    port = Pty()
    axis = SimulatedAxis("x", DEFAULT_REGISTERS, Mechanics(Screw(), Encoder(1000.0)))
    bus = DriveBus([Complaining(1, [axis])])
    line = SerialEndpoint("", baudrate=115_200)
    server = SerialDriveServer(
        bus, SteppedClock(), port.master_fd, wire=line, cable=WireCable(hearing=hearing)
    )
    fd = open_serial(port.path)
    channel = FdChannel(fd)
    came: asyncio.Queue[bytes] = asyncio.Queue()
    channel.listen(came.put_nowait)

    async def answer(frame: bytes, length: int) -> bytes:
        channel.send(frame)
        got = b""
        while len(got) < length:
            got += await asyncio.wait_for(came.get(), 20)
        return got

    acknowledgement = append_crc(pack(">BBHH", 1, 16, COMMAND, 2))
    try:
        good = append_crc(pack(">BBHHBi", 1, 16, COMMAND, 2, 4, 1234))
        assert await answer(good, 8) == acknowledgement
        spoilt = good[:-2] + inverted_crc(residue_after(good[:-2]))
        expected = acknowledgement if obeyed else append_crc(b"\x01\x90\x08")
        assert await answer(spoilt, len(expected)) == expected
    finally:
        channel.close()
        server.close()
        os.close(fd)
        port.close()
    assert len(bus.ledger.writes_to(1, COMMAND)) == 1 + obeyed
    assert server.uart is not None
    assert server.uart.frames_odd == 1 - obeyed


# Frames that manuals print, answered by the simulated drives byte for byte.


# Name of the frame, drive, the PDUs that bring it into the state of the manual, what it is made to do.
# Delta's example reads P2-00 = 0x00B1 and 0x1F40 (manual page 555). The slave error of BLV-R is that of a
# drive that is busy. IAI changes the push force alone (PPOW), which moves to the last PCMD.
PRINTED = [
    ("kinco enable", "kinco-fd", [], []),
    ("kinco read status word", "kinco-fd", [], []),
    ("kinco FC16 32-bit low word first 0x00085555", "kinco-fd", [], []),
    ("kinco FC16 0x001B4E82 = 100 rpm", "kinco-fd", [], []),
    ("leadshine wrong function code", "leadshine-pr", [], []),
    ("leadshine immediate PR0", "leadshine-pr", [], [(ABSOLUTE, 10_000)]),
    ("leadshine FC16 4 regs", "leadshine-pr", [], []),
    ("oriental BLV-R S-ON", "oriental-blv-r", [], []),
    # Type 48 is continuous operation: the position in the frame is no target.
    (
        "oriental BLV-R direct data, 14 regs from 0x005A",
        "oriental-blv-r",
        ["10 007C 0002 04 00000001"],
        [(OTHER, None)],
    ),
    ("oriental AZ stored position -1000", "oriental-az", [], []),
    ("delta FC03", "delta-asda", ["10 0200 0002 04 00B1 1F40"], []),
    ("delta FC16", "delta-asda", [], []),
    ("iai change push", "iai-robo-cylinder", ["05 0403 FF00"], [(ABSOLUTE, 0)]),
    ("iai home edge", "iai-robo-cylinder", ["05 0403 FF00"], [(HOME, None)]),
    ("mks absolute coordinate 163840", "makerbase-servo42d", [], [(ABSOLUTE, 163_840)]),
    ("mks stop", "makerbase-servo42d", [], [(STOP, 0)]),
    ("mks read int48", "makerbase-servo42d", [], []),
    ("ess target 5000", "stepperonline-ess-rs", [], []),
]


@pytest.mark.parametrize(("name", "drive_name", "before", "moves"), PRINTED, ids=[row[0] for row in PRINTED])
def test_printed_frames_are_answered(
    name: str, drive_name: str, before: list[str], moves: list[object]
) -> None:
    frame = GOLDEN_FRAMES[name]
    request = bytes.fromhex(frame["request"])
    assert is_intact(request)
    drive = Drive(drive_name, unit_id=request[0])
    drive.does(*before)
    reply = drive.bus.answer(request[0], request[1:-2], drive.now_s)
    assert reply is not None
    if "reply" in frame:
        assert encode_rtu(request[0], reply) == bytes.fromhex(frame["reply"])
    else:
        assert reply[0] == request[1]
    assert drive.moves == moves


def test_smc_shows_the_position_of_its_manual() -> None:
    frame = GOLDEN_FRAMES["smc position 150.00 mm"]
    drive = Drive("smc-lec")
    drive.motor.set_position(15_000, 0.0)
    assert drive.ask(frame["request"][3:-6]) == frame["reply"][3:-6]


def test_a_busy_oriental_answers_the_printed_slave_error() -> None:
    frame = GOLDEN_FRAMES["oriental slave error"]
    drive = Drive("oriental-blv-r")
    drive.unit.is_busy = True  # type: ignore[attr-defined]
    assert drive.ask(frame["request"][3:-6]) == frame["reply"][3:-6]


def test_delta_refuses_a_parameter_that_it_does_not_have_as_printed() -> None:
    # 0x05C8 would be P5-100; groups end at 99.
    assert Drive("delta-asda").ask("06 05C8 0001") == GOLDEN_FRAMES["delta exception"]["reply"][3:-6]
