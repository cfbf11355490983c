"""Any controller with any drive: a pymodbus client moves and reads an axis of a pymodbus server.

Meanwhile a second client reads other registers. The table adds 0.05 mm at 50 mm: 50 000 counts go out as
50 050.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

import pytest
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from gateway.exchange.plan import CompensationMode, LineTiming, Role
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.support.relay import Bench, axis_plan, until_up

if TYPE_CHECKING:
    from gateway.relay.gateway import Relay

COMMAND, ACTUAL, OTHER = 100, 110, 200
OTHERS = list(range(1000, 1010))
PATIENCE_S = 30.0
PATIENCE_MS = 1000.0 * PATIENCE_S


class Drive:
    """A pymodbus server whose actual position follows the commanded one at once."""

    def __init__(self) -> None:
        self.written: list[list[int]] = []
        registers = [
            SimData(COMMAND, count=20, values=0, datatype=DataType.REGISTERS),
            SimData(OTHER, values=OTHERS, datatype=DataType.REGISTERS),
        ]
        self.device = SimDevice(1, registers, action=self._follow)

    async def _follow(  # noqa: PLR0917 - pymodbus's signature
        self,
        function_code: int,
        start_address: int,
        address: int,
        count: int,
        current_registers: list[int],
        set_values: "list[int] | list[bool] | None",
    ) -> None:
        if set_values is not None and address == COMMAND:
            words = [int(word) for word in set_values]
            self.written.append(words)
            at = ACTUAL - start_address
            current_registers[at : at + len(words)] = words


@contextlib.asynccontextmanager
async def serving(bench: Bench, kind: str, drive: Drive) -> AsyncIterator[TcpEndpoint | SerialEndpoint]:
    where: TcpEndpoint | SerialEndpoint
    server: ModbusTcpServer | ModbusSerialServer
    if kind == "rtu":
        cable = bench.cable()
        server = ModbusSerialServer(drive.device, port=cable.far, baudrate=115200)
        await server.serve_forever(background=True)
        where = SerialEndpoint(cable.near, 115200, "E")
    else:
        server = ModbusTcpServer(drive.device, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        assert server.transport is not None
        port = server.transport.sockets[0].getsockname()[1]  # type: ignore[attr-defined]
        where = TcpEndpoint("127.0.0.1", port)
    yield where
    await server.shutdown()  # type: ignore[no-untyped-call]


@contextlib.asynccontextmanager
async def client(
    relay: "Relay", name: str, device: str
) -> AsyncIterator[AsyncModbusTcpClient | AsyncModbusSerialClient]:
    made: AsyncModbusTcpClient | AsyncModbusSerialClient
    if device:
        made = AsyncModbusSerialClient(device, baudrate=115200, timeout=PATIENCE_S, retries=0)
    else:
        where = relay.address("line", name)
        made = AsyncModbusTcpClient(where.host, port=where.port, timeout=PATIENCE_S, retries=0)
    assert await made.connect()
    yield made
    made.close()


def words(counts: int) -> list[int]:
    return [counts >> 16 & 0xFFFF, counts & 0xFFFF]


@pytest.mark.parametrize("controller", ["tcp", "rtu"])
@pytest.mark.parametrize("drives", ["tcp", "rtu"])
async def test_an_axis_moves_while_another_client_reads(bench: Bench, controller: str, drives: str) -> None:
    drive = Drive()
    async with serving(bench, drives, drive) as where:
        cnc, device = bench.controller_link(controller, timeout_ms=PATIENCE_MS)
        hmi, _ = bench.controller_link("tcp", "hmi", Role.MONITOR, timeout_ms=PATIENCE_MS)
        relay = await bench.relay(
            where, (cnc, hmi), (axis_plan(),), LineTiming(response_timeout_ms=PATIENCE_MS)
        )
        await until_up(relay)
        async with client(relay, "cnc", device) as mover, client(relay, "hmi", "") as reader:

            async def read_others() -> None:
                for _ in range(10):
                    reply = await reader.read_holding_registers(OTHER, count=10, device_id=1)
                    assert reply.registers == OTHERS

            reading = asyncio.create_task(read_others())
            for nominal in (50_000, 100_000, 20_000, 0):
                await mover.write_registers(COMMAND, words(nominal), device_id=1)
                for address in (COMMAND, ACTUAL):
                    reply = await mover.read_holding_registers(address, count=2, device_id=1)
                    assert reply.registers == words(nominal)
            await reading
    # 1 um of correction for each mm: 50 at 50 mm, 100 at 100 mm, 20 at 20 mm, none at 0
    assert drive.written == [words(50_050), words(100_100), words(20_020), words(0)]


async def test_a_monitor_may_not_write(bench: Bench) -> None:
    drive = Drive()
    async with serving(bench, "tcp", drive) as where:
        hmi, _ = bench.controller_link("tcp", "hmi", Role.MONITOR)
        relay = await bench.relay(where, (hmi,), (axis_plan(),))
        await until_up(relay)
        async with client(relay, "hmi", "") as reader:
            reply = await reader.write_registers(COMMAND, words(50_000), device_id=1)
            assert reply.exception_code == 1
    assert drive.written == []


async def test_shadow_writes_the_original_and_shows_the_correction(bench: Bench) -> None:
    drive = Drive()
    async with serving(bench, "tcp", drive) as where:
        cnc, _ = bench.controller_link("tcp")
        relay = await bench.relay(where, (cnc,), (axis_plan(CompensationMode.SHADOW),))
        await until_up(relay)
        async with client(relay, "cnc", "") as mover:
            await mover.write_registers(COMMAND, words(50_000), device_id=1)
            reply = await mover.read_holding_registers(ACTUAL, count=2, device_id=1)
            assert reply.registers == words(50_000)
        axis = relay.status().axes["x"]
        assert axis.compensation == "shadow"
        assert axis.correction == pytest.approx(0.05)
    assert drive.written == [words(50_000)]
