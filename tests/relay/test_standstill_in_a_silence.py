"""The process stands still while a request waits for the silence before its frame: over real sockets."""

import asyncio
import socket
import time
from dataclasses import replace

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from tests.support.relay import TIMING, Bench, RawEnd, until_up

GAP_MS = 50.0
READ = bytes.fromhex("03 00C8 0001")
WRITE = bytes.fromhex("06 00C8 0001")
ANSWER = bytes.fromhex("03 02 0007")


async def read_by_the_relay() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


async def paced(bench: Bench, timeout_ms: float = 200.0) -> tuple[RawEnd, RawEnd]:
    """A controller over Modbus/TCP that got an answer just now, and an RTU drive that needs a silence."""
    drive, where = await bench.drive("rtu_over_tcp", None)
    link, _ = bench.controller_link("tcp", timeout_ms=timeout_ms)
    relay = await bench.relay(where, (link,), timing=replace(TIMING, gap_ms=GAP_MS, drain_ms=60.0))
    await until_up(relay)
    cnc = await bench.connect(relay.address("line", "cnc"))
    cnc.write(encode_mbap(1, 1, READ))
    await drive.receives(encode_rtu(1, READ))
    drive.write(encode_rtu(1, ANSWER))
    await cnc.receives(encode_mbap(1, 1, ANSWER))
    return cnc, drive


async def test_w5_a_write_that_its_controller_gave_up_is_not_sent(bench: Bench) -> None:
    cnc, drive = await paced(bench)
    cnc.write(encode_mbap(2, 1, WRITE))
    await read_by_the_relay()
    assert drive.data == b""
    time.sleep(0.3)  # noqa: ASYNC251
    await asyncio.sleep(0.3)
    assert drive.data == b""


async def test_w5_nor_one_whose_connection_was_closed_meanwhile(bench: Bench) -> None:
    drive, where = await bench.drive("rtu_over_tcp", None)
    link, _ = bench.controller_link("tcp", timeout_ms=2000.0)
    relay = await bench.relay(where, (link,), timing=replace(TIMING, gap_ms=GAP_MS))
    await until_up(relay)
    await drive.until(lambda end: end.opens == 1)
    address = relay.address("line", "cnc")
    with socket.create_connection((address.host, address.port)) as cnc:
        await read_by_the_relay()
        await asyncio.sleep(0.1)
        drive.write(b"\x00")
        await read_by_the_relay()
        cnc.sendall(encode_mbap(2, 1, WRITE))
        await read_by_the_relay()
    time.sleep(0.2)  # noqa: ASYNC251
    await asyncio.sleep(0.3)
    assert drive.data == b""


async def test_w6_a_frame_that_came_meanwhile_answers_nothing(bench: Bench) -> None:
    cnc, drive = await paced(bench, 2000.0)
    cnc.write(encode_mbap(2, 1, READ))
    await read_by_the_relay()
    drive.write(encode_rtu(1, bytes.fromhex("03 02 0BAD")))
    time.sleep(0.2)  # noqa: ASYNC251
    await drive.receives(encode_rtu(1, READ))
    assert cnc.data == b""
    drive.write(encode_rtu(1, ANSWER))
    await cnc.receives(encode_mbap(2, 1, ANSWER))


async def test_a_link_that_is_lost_meanwhile(bench: Bench) -> None:
    """The write is sent on the next connection, once."""
    cnc, drive = await paced(bench, 2000.0)
    cnc.write(encode_mbap(2, 1, WRITE))
    await read_by_the_relay()
    assert drive.channel is not None
    drive.channel.close()
    await drive.until(lambda end: end.opens == 2)
    await drive.receives(encode_rtu(1, WRITE))
    drive.write(encode_rtu(1, WRITE))
    await cnc.receives(encode_mbap(2, 1, WRITE))
    await asyncio.sleep(0.2)
    assert drive.data == b""
