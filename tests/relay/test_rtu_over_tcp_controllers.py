"""A controller that sends RTU frames over TCP: a device server that connects, or a program."""

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from gateway.transport.endpoints import TcpEndpoint
from tests.support.relay import (
    QUICK,
    TIMING,
    Bench,
    RawEnd,
    Script,
    axis_plan,
    eventually,
    first_controller,
    line_status,
    until_up,
)

if TYPE_CHECKING:
    from gateway.exchange.plan import LineTiming
    from gateway.relay.gateway import Relay

RTU = TcpEndpoint("127.0.0.1", 0, rtu=True)
WRITE_50000 = bytes.fromhex("10 0064 0002 04 0000 C350")
WRITE_50050 = bytes.fromhex("10 0064 0002 04 0000 C382")  # +0.05 mm at 50 mm, 1000 counts/mm
WRITTEN = bytes.fromhex("10 0064 0002")
READ = bytes.fromhex("03 006E 0002")


def drive_script() -> Script:
    """Acknowledge a write, and answer a read with 50 050 counts; unit 9 is silent."""
    decoder = RtuRequestDecoder()

    def answer(data: bytes) -> bytes:
        return b"".join(
            encode_rtu(unit, WRITTEN if pdu[0] == 0x10 else bytes.fromhex("03 04 0000 C382"))
            for unit, pdu in decoder.feed(data, 0)
            if unit != 9
        )

    return answer


async def connected(bench: Bench, *, timing: "LineTiming | None" = None) -> "tuple[RawEnd, RawEnd, Relay]":
    drive, where = await bench.drive("rtu", drive_script())
    link, _ = bench.controller_link("tcp", timeout_ms=2000.0)
    link = replace(link, endpoint=RTU, plan=replace(link.plan, serial=True))
    relay = await bench.relay(where, (link,), axes=(axis_plan(),), timing=timing or TIMING)
    await until_up(relay)
    return await bench.connect(relay.address("line", "cnc")), drive, relay


async def test_its_positions_are_corrected_and_read_back(bench: Bench) -> None:
    controller, drive, _ = await connected(bench)
    controller.write(encode_rtu(1, WRITE_50000))
    await controller.receives(encode_rtu(1, WRITTEN))
    assert encode_rtu(1, WRITE_50050) in drive.data
    controller.write(encode_rtu(1, READ))
    await controller.receives(encode_rtu(1, bytes.fromhex("03 04 0000 C350")))


@pytest.mark.parametrize("cut", [1, 4, 12])
async def test_w2_a_frame_may_come_in_two_segments(bench: Bench, cut: int) -> None:
    controller, drive, _ = await connected(bench)
    frame = encode_rtu(1, WRITE_50000)
    controller.write(frame[:cut])
    controller.write(frame[cut:])
    await controller.receives(encode_rtu(1, WRITTEN))
    assert drive.data.count(encode_rtu(1, WRITE_50050)) == 1


async def test_w7_it_hears_nothing_of_a_silent_drive(bench: Bench) -> None:
    """Silence, as on a wire; the next request is answered."""
    controller, _, relay = await connected(bench, timing=QUICK)
    controller.write(encode_rtu(9, READ))
    await eventually(lambda: line_status(relay)["timeouts"] == 1)
    controller.write(encode_rtu(1, READ))
    await controller.until(lambda end: len(end.data) >= 9)
    assert controller.data[:2] == bytes.fromhex("01 03")


async def test_what_is_no_frame_is_counted(bench: Bench) -> None:
    controller, _, relay = await connected(bench)
    controller.write(bytes.fromhex("01 03 00 6E 00 02 FF FF"))
    await eventually(lambda: first_controller(relay)["malformed"] == 1)
    assert first_controller(relay)["dropped_bytes"] == 8
