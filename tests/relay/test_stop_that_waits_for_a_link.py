"""The gateway ends although a stop waits for a line that is down."""

import asyncio
import time

from gateway.modbus.mbap import encode_mbap
from gateway.transport.endpoints import TcpEndpoint
from tests.exchange.staged_bench import STOP_PDU, staged_plan
from tests.support.relay import TIMING, Bench


async def test_stop_of_the_gateway_with_a_stop_that_waits_for_a_lost_link(bench: Bench) -> None:
    """The stop of a controller with ``timeout_ms = 5000``."""
    link, _ = bench.controller_link("tcp", timeout_ms=5000.0)
    relay = await bench.relay(TcpEndpoint("127.0.0.1", 9), (link,), (staged_plan(),), timing=TIMING)
    cnc = await bench.connect(relay.address("line", "cnc"))
    cnc.write(encode_mbap(1, 1, STOP_PDU))
    await asyncio.sleep(0.1)
    began_s = time.monotonic()
    await relay.stop()
    assert time.monotonic() - began_s < 4.0
