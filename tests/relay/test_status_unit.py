"""The gateway's own unit id on real ports, read by pymodbus and by raw bytes."""

import pytest
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient

from gateway.exchange.plan import Role
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.transport.endpoints import TcpEndpoint
from tests.support.relay import Bench, axis_plan, until_up

OWN = 250
PATIENCE_S = 30.0
TARGET = bytes.fromhex("10 0064 0002 04 0000 C350")
"""50 000 counts: 50 mm, where the table adds 0.05 mm."""


def echo(data: bytes) -> bytes:
    """Acknowledge FC16 over Modbus/TCP."""
    return data[:4] + bytes((0, 6)) + data[6:12]


@pytest.mark.parametrize("controller", ["tcp", "rtu"])
async def test_a_client_reads_the_gateway_on_any_port_unheard_by_drives(
    bench: Bench, controller: str
) -> None:
    drive, where = await bench.drive("tcp", echo)
    link, device = bench.controller_link(controller)
    relay = await bench.relay(where, (link,), (axis_plan(),), status_unit=OWN)
    await until_up(relay)
    client: AsyncModbusTcpClient | AsyncModbusSerialClient
    if device:
        client = AsyncModbusSerialClient(device, baudrate=115200, timeout=PATIENCE_S, retries=0)
    else:
        at = relay.address("line", "cnc")
        client = AsyncModbusTcpClient(at.host, port=at.port, timeout=PATIENCE_S, retries=0)
    assert await client.connect()
    bench.stack.callback(client.close)
    heard = bytes(drive.data)
    head = await client.read_holding_registers(0, count=10, device_id=OWN)
    # Layout 1; then alarm, lines, lines up, axes, silent drives, and three without a name.
    assert [*head.registers[:1], *head.registers[2:]] == [1, 0, 1, 1, 1, 0, 0, 0, 0]
    again = await client.read_input_registers(1, count=1, device_id=OWN)
    assert 0 <= (again.registers[0] - head.registers[1]) % 65536 < PATIENCE_S * 10
    assert (await client.write_register(0, 1, device_id=OWN)).exception_code == 1
    assert (await client.read_holding_registers(10, count=1, device_id=OWN)).exception_code == 2
    assert (await client.read_coils(0, count=1, device_id=OWN)).exception_code == 1
    assert drive.data == heard
    assert not (await client.write_registers(100, [0x0000, 0xC350], device_id=1)).isError()
    axis = await client.read_input_registers(1000, count=10, device_id=OWN)
    # 0.05 mm are 50 000 nm; referenced, switched on, with a target; unit id 1 on line 1.
    assert axis.registers == [1, 0, 0, 50_000, 0b1011, 0, 1, 1, 0, 0]


async def test_on_rtu_the_gateway_answers_like_a_slave(bench: Bench) -> None:
    controller, _, _ = await bench.raw_pair("rtu", "rtu", axes=(axis_plan(),), status_unit=OWN)
    # Worked out with the CRC of the Modbus over Serial Line specification, appendix B, low byte first.
    for asked, answered in (
        ("03 0002 0002", "03 04 0000 0001"),
        ("03 0009 0002", "83 02"),
        ("10 0000 0001 02 0001", "90 01"),
        ("41", "C1 01"),  # a function code that nobody knows
    ):
        controller.write(encode_rtu(OWN, bytes.fromhex(asked)))
        await controller.receives(encode_rtu(OWN, bytes.fromhex(answered)))


async def test_raw_bytes_over_tcp_also_glued_and_while_the_drives_are_away(bench: Bench) -> None:
    link, _ = bench.controller_link("tcp", role=Role.MONITOR)
    relay = await bench.relay(TcpEndpoint("127.0.0.1", 1), (link,), (axis_plan(),), status_unit=OWN)
    controller = await bench.connect(relay.address("line", "cnc"))
    asked = [encode_mbap(number, OWN, bytes.fromhex("03 0002 0003")) for number in (1, 2)]
    controller.write(b"".join(asked))
    # A line is down, and so the alarm; one line, none of them up.
    answered = [encode_mbap(number, OWN, bytes.fromhex("03 06 0003 0001 0000")) for number in (1, 2)]
    await controller.receives(b"".join(answered))
