"""High marks of the last minute grow old by themselves: a look at the status may come once in a day."""

import pytest

from gateway.modbus.mbap import encode_mbap
from gateway.relay import gateway as relay_module
from gateway.state.plan import GatewayPlan, LinePlan
from tests.support.relay import TIMING, Bench, eventually

READ = bytes.fromhex("03 0010 0001")
REPLY = bytes.fromhex("03 02 0007")


async def test_each_line_begins_a_new_slot_unwatched(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relay_module, "TICK_EVERY_S", 0.01)
    names = ("a", "b", "c")
    plans = []
    for name in names:
        _, where = await bench.drive("tcp", lambda data: data[:5] + b"\x05" + data[6:7] + REPLY)
        plans.append(LinePlan(name, where, (bench.controller_link("tcp")[0],), (), TIMING))
    relay = await bench.start(GatewayPlan("bench", tuple(plans)))
    await eventually(lambda: all(line.is_up for line in relay._lines))
    for name in names:
        near = await bench.connect(relay.address(name, "cnc"))
        near.write(encode_mbap(1, 1, READ))
        await near.receives(encode_mbap(1, 1, REPLY))
    for line in relay._lines:
        [measured] = line._exchange.meter.measured.values()
        mark = measured.high
        await eventually(lambda mark=mark: mark.ever_ns > 0 and mark.slot_ns == 0)  # type: ignore[misc]
        assert mark.minute_ns == mark.ever_ns  # it still is of the last minute
