"""An RS-485 adapter whose receiver stays on: every request comes back before its reply."""

from dataclasses import replace
from typing import TYPE_CHECKING

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from gateway.transport.endpoints import SerialEndpoint

if TYPE_CHECKING:
    from tests.relay.conftest import Bench, Tools

WRITE = bytes.fromhex("06 00C8 1234")
BROADCAST = bytes.fromhex("06 6002 0040")


class Echoing:
    """Sends back what it hears, and acknowledges a write of one register: the very same bytes again."""

    def __init__(self) -> None:
        self._decoder = RtuRequestDecoder()

    def __call__(self, data: bytes) -> bytes:
        answers = b"".join(encode_rtu(unit, pdu) for unit, pdu in self._decoder.feed(data, 0) if unit)
        return data + answers


async def test_the_own_request_is_taken_out_and_is_no_acknowledgement(bench: "Bench", tools: "Tools") -> None:
    drive, where = await bench.drive("rtu", Echoing())
    assert isinstance(where, SerialEndpoint)
    link, _ = bench.controller_link("tcp", timeout_ms=4000.0)
    # Time for an echo to come back on a machine that is busy, also after a broadcast, which has no reply.
    timing = replace(tools.timing, response_timeout_ms=2000.0, turnaround_ms=500.0)
    relay = await bench.relay(replace(where, echo=True), (link,), timing=timing)
    await tools.until_up(relay)
    controller = await bench.connect(relay.address("line", "cnc"))
    for number in range(3):
        controller.write(encode_mbap(number, 1, WRITE))
        await controller.receives(encode_mbap(number, 1, WRITE))
    controller.write(encode_mbap(3, 0, BROADCAST))
    await drive.until(lambda end: end.data.endswith(encode_rtu(0, BROADCAST)))
    controller.write(encode_mbap(4, 1, WRITE))
    await controller.receives(encode_mbap(4, 1, WRITE))
    status = tools.line_status(relay)
    assert (status["echoes"], status["late"], status["stray_bytes"]) == (5, 0, 0)
