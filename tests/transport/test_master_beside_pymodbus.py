"""What the master of the tools has to keep, tried on pymodbus's client and on our own (decision 32).

Each test lets both ask the same drive, over real sockets and pseudo terminals. Where one of those that show a
fault of pymodbus fails with a newer release, the decision wants to be looked at again.
"""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from itertools import pairwise
from typing import Final

import pytest
from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.client.base import ModbusBaseClient
from pymodbus.exceptions import ConnectionException, ModbusIOException

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.errors import RefusedError
from gateway.transport.master import GarbledError, ModbusMaster, SilentError
from tests.transport.scripted_drive import ANSWER, ASK, KINDS, Drive, Rig, framed

LATE: Final = bytes.fromhex("03 02 FFFF")
WRITE: Final = bytes.fromhex("06 0010 0001")
PATIENCE_MS: Final = 5000.0
Script = Callable[[bytes], bytes | None]


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    rig = Rig()
    async with rig.stack:
        yield rig


@asynccontextmanager
async def pymodbus_at(
    endpoint: TcpEndpoint | SerialEndpoint, timeout_ms: float
) -> AsyncIterator[ModbusBaseClient]:
    """Connect a client of pymodbus that repeats nothing and does not reconnect."""
    client: ModbusBaseClient
    if isinstance(endpoint, SerialEndpoint):
        client = AsyncModbusSerialClient(
            endpoint.device, timeout=timeout_ms / 1000.0, retries=0, reconnect_delay=0
        )
    else:
        client = AsyncModbusTcpClient(
            endpoint.host,
            port=endpoint.port,
            framer=FramerType.RTU if endpoint.rtu else FramerType.SOCKET,
            timeout=timeout_ms / 1000.0,
            retries=0,
            reconnect_delay=0,
        )
    assert await client.connect()
    try:
        yield client
    finally:
        client.close()


async def registers(client: ModbusBaseClient, count: int = 1, unit_id: int = 1) -> list[int]:
    """Read holding registers from 0x10 on."""
    return list((await client.read_holding_registers(0x10, count=count, device_id=unit_id)).registers)


def gaps_ns(drive: Drive) -> list[int]:
    """Return the times between the requests that a drive has heard."""
    return [later - earlier for earlier, later in pairwise(drive.heard_ns)]


def silent_once(then: Script) -> Script:
    """Answer nothing to the first request."""
    heard: list[bytes] = []

    def script(data: bytes) -> bytes | None:
        heard.append(data)
        return None if len(heard) == 1 else then(data)

    return script


# --- nothing is repeated -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
async def test_neither_repeats_anything(rig: Rig, kind: str) -> None:
    theirs, ours = Drive(lambda data: None), Drive(lambda data: None)
    async with pymodbus_at(await rig.drive(kind, theirs), 60.0) as client:
        with pytest.raises(ModbusIOException):
            await registers(client)
    async with ModbusMaster(await rig.drive(kind, ours), 60.0) as master:
        with pytest.raises(SilentError):
            await master.exchange(1, ASK)
    assert (len(theirs.heard_ns), len(ours.heard_ns)) == (1, 1)


@pytest.mark.parametrize("kind", ["tcp", "rtu_over_tcp"])
async def test_pymodbus_hangs_up_on_a_line_of_which_one_drive_is_dead(rig: Rig, kind: str) -> None:
    """The fifth silence in a row ends its connection, and with it what the healthy drive would say."""

    def script(data: bytes) -> bytes | None:
        unit_id = data[6] if kind == "tcp" else data[0]
        return framed(kind, data, ANSWER) if unit_id == 2 else None

    async with pymodbus_at(await rig.drive(kind, Drive(script)), 20.0) as client:
        for _ in range(5):
            with pytest.raises(ModbusIOException):
                await registers(client)
        with pytest.raises(ConnectionException):
            await registers(client, unit_id=2)
    async with ModbusMaster(await rig.drive(kind, Drive(script)), 20.0) as master:
        for _ in range(5):
            with pytest.raises(SilentError):
                await master.exchange(1, ASK)
        assert await master.exchange(2, ASK) == ANSWER


# --- the silence that a drive wants before a request -----------------------------------------------------


async def test_pymodbus_has_no_silence_before_a_request(rig: Rig) -> None:
    """It has no key for it: its requests follow each other at once; ours wait 20 ms."""
    theirs = Drive(lambda data: framed("tcp", data, ANSWER))
    async with pymodbus_at(await rig.drive("tcp", theirs), PATIENCE_MS) as client:
        for _ in range(20):
            await registers(client)
    ours = Drive(lambda data: framed("tcp", data, ANSWER))
    async with ModbusMaster(await rig.drive("tcp", ours), PATIENCE_MS, gap_ms=20.0) as master:
        for _ in range(3):
            await master.exchange(1, ASK)
    assert min(gaps_ns(theirs)) < 20_000_000
    assert min(gaps_ns(ours)) >= 20_000_000


# --- a late reply is never taken for another ---------------------------------------------------------------


async def test_neither_takes_a_late_reply_on_modbus_tcp(rig: Rig) -> None:
    """Both go by the transaction id: the late reply to request 1 comes before that to request 2."""

    def answered(data: bytes) -> bytes:
        return encode_mbap(1, 1, LATE) + framed("tcp", data, ANSWER)

    async with pymodbus_at(await rig.drive("tcp", Drive(silent_once(answered))), 200.0) as client:
        with pytest.raises(ModbusIOException):
            await registers(client)
        assert await registers(client) == [7]
    async with ModbusMaster(await rig.drive("tcp", Drive(silent_once(answered))), 200.0) as master:
        with pytest.raises(SilentError):
            await master.exchange(1, ASK)
        assert await master.exchange(1, ASK) == ANSWER


@pytest.mark.parametrize("kind", ["rtu", "rtu_over_tcp"])
async def test_pymodbus_takes_a_late_reply_on_rtu(rig: Rig, kind: str) -> None:
    """It sends the next request at once, and what was owed answers it; ours is silent first, and hears it."""
    owing = Drive(silent_once(lambda data: framed(kind, data, LATE)))
    async with pymodbus_at(await rig.drive(kind, owing), 60.0) as client:
        with pytest.raises(ModbusIOException):
            await registers(client)
        assert await registers(client) == [0xFFFF]  # said on the second request, about the first
    drive = Drive(silent_once(lambda data: framed(kind, data, ANSWER)))
    async with ModbusMaster(await rig.drive(kind, drive), 60.0, drain_ms=80.0) as master:
        with pytest.raises(SilentError):
            await master.exchange(1, ASK)
        assert drive.channel is not None
        drive.channel.write(framed(kind, bytes((1,)), LATE))
        assert await master.exchange(1, ASK) == ANSWER


@pytest.mark.parametrize("kind", ["rtu", "rtu_over_tcp"])
async def test_pymodbus_takes_the_late_reply_to_a_read_for_that_to_a_write(rig: Rig, kind: str) -> None:
    """No silence around it can help: later than any silence, a read's reply acknowledges a write."""

    def late_then_true(data: bytes) -> bytes:
        return framed(kind, data, LATE) + framed(kind, data, data[1:-2])

    async with pymodbus_at(await rig.drive(kind, Drive(late_then_true)), PATIENCE_MS) as client:
        reply = await client.write_register(0x10, 1, device_id=1)
        assert not reply.isError()
        assert (reply.function_code, reply.registers) == (3, [0xFFFF])
    async with ModbusMaster(await rig.drive(kind, Drive(late_then_true)), PATIENCE_MS) as master:
        assert await master.exchange(1, WRITE) == WRITE


@pytest.mark.parametrize("kind", ["rtu", "rtu_over_tcp"])
async def test_pymodbus_takes_a_late_reply_of_another_size(rig: Rig, kind: str) -> None:
    two = bytes.fromhex("03 04 0001 0002")

    def late_then_true(data: bytes) -> bytes:
        return framed(kind, data, LATE) + framed(kind, data, two)

    async with pymodbus_at(await rig.drive(kind, Drive(late_then_true)), PATIENCE_MS) as client:
        assert await registers(client, count=2) == [0xFFFF]
    async with ModbusMaster(await rig.drive(kind, Drive(late_then_true)), PATIENCE_MS) as master:
        assert await master.exchange(1, bytes.fromhex("03 0010 0002")) == two


# --- drives and adapters as they are -----------------------------------------------------------------------


async def test_pymodbus_hears_no_drive_that_answers_with_another_unit_id(rig: Rig) -> None:
    """Many Modbus/TCP drives answer as unit 1 whatever they are asked as (``answers_as``)."""

    def as_unit_1(data: bytes) -> bytes:
        return encode_mbap(int.from_bytes(data[:2], "big"), 1, ANSWER)

    async with pymodbus_at(await rig.drive("tcp", Drive(as_unit_1)), 60.0) as client:
        with pytest.raises(ModbusIOException):
            await registers(client, unit_id=5)
    async with ModbusMaster(await rig.drive("tcp", Drive(as_unit_1)), PATIENCE_MS) as master:
        assert await master.exchange(5, ASK) == ANSWER


@pytest.mark.parametrize("kind", ["rtu", "rtu_over_tcp"])
async def test_pymodbus_loses_the_reply_behind_a_zero_of_a_driver(rig: Rig, kind: str) -> None:
    def behind_zero(data: bytes) -> bytes:
        return b"\x00" + encode_rtu(1, ANSWER)

    async with pymodbus_at(await rig.drive(kind, Drive(behind_zero)), 60.0) as client:
        with pytest.raises(ModbusIOException):
            await registers(client)
    async with ModbusMaster(await rig.drive(kind, Drive(behind_zero)), PATIENCE_MS) as master:
        assert await master.exchange(1, ASK) == ANSWER


async def test_pymodbus_tells_silence_and_damage_alike(rig: Rig) -> None:
    """What `probe` is asked for: is nobody there, or is the baud rate wrong?"""
    endpoint = await rig.drive("rtu", Drive(lambda data: b"\x01\x02\x03\x04\x05"))
    async with pymodbus_at(endpoint, 60.0) as client:
        with pytest.raises(ModbusIOException, match="No response received"):
            await registers(client)
    async with ModbusMaster(endpoint, 60.0) as master:
        with pytest.raises(GarbledError, match="the last bytes were 01 02 03 04 05"):
            await master.exchange(1, ASK)


async def test_pymodbus_does_not_say_why_a_port_cannot_be_opened(rig: Rig) -> None:
    endpoint = await rig.drive("rtu", Drive(lambda data: None))
    assert isinstance(endpoint, SerialEndpoint)
    async with ModbusMaster(endpoint):
        client = AsyncModbusSerialClient(endpoint.device, retries=0, reconnect_delay=0)
        assert not await client.connect()
        with pytest.raises(RefusedError, match="in use by another program"):
            async with ModbusMaster(endpoint):
                pass
