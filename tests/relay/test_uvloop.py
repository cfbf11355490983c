"""The same relay on uvloop, where it is installed: sockets, terminals, timers."""

import asyncio
from typing import TYPE_CHECKING

import pytest

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu

if TYPE_CHECKING:
    from tests.relay.conftest import Tools

uvloop = pytest.importorskip("uvloop")
REQUEST, REPLY = bytes.fromhex("41 0102030405"), bytes.fromhex("41 0D1113")


@pytest.mark.parametrize("controller", ["tcp", "rtu"])
@pytest.mark.parametrize("drives", ["tcp", "rtu", "rtu_over_tcp"])
def test_an_exchange_that_silence_ends_goes_through(tools: "Tools", controller: str, drives: str) -> None:
    def script(data: bytes) -> bytes:
        if drives == "tcp":
            return data[:4] + bytes([0, len(REPLY) + 1]) + data[6:7] + REPLY
        return encode_rtu(data[0], REPLY)

    async def exchange() -> None:
        bench = tools.bench()
        async with bench.stack:
            near, _, _ = await bench.raw_pair(controller, drives, script)
            near.write(encode_mbap(1, 1, REQUEST) if controller == "tcp" else encode_rtu(1, REQUEST))
            await near.receives(encode_mbap(1, 1, REPLY) if controller == "tcp" else encode_rtu(1, REPLY))

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(exchange())
