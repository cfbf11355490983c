"""The order of requests over real sockets, on a line whose drive needs a silence before each of them."""

import asyncio
import random
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.exchange.plan import Role
from gateway.modbus.mbap import encode_mbap
from gateway.recording.writer import Recorder
from gateway.state.plan import GatewayPlan, LinePlan
from tests.support.recordings import HEADER, replayed
from tests.support.relay import TIMING, Bench, until_up

GAP_MS = 3.0
REQUESTS = 600


def numbered(number: int) -> bytes:
    """A write of this number to a register that means nothing."""
    return encode_mbap(number, 1, bytes.fromhex("06 00C8") + number.to_bytes(2, "big"))


class Drive:
    """Acknowledges each write at once, and notes its value."""

    def __init__(self) -> None:
        self.values: list[int] = []

    def __call__(self, data: bytes) -> bytes:
        self.values.append(int.from_bytes(data[10:12], "big"))
        return data


async def test_w1_requests_on_one_connection_reach_the_drive_in_order(bench: Bench) -> None:
    drive = Drive()
    _, where = await bench.drive("tcp", drive)
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,), timing=replace(TIMING, gap_ms=GAP_MS))
    await until_up(relay)
    cnc = await bench.connect(relay.address("line", "cnc"))
    rng = random.Random(1)
    for number in range(1, REQUESTS + 1):
        cnc.write(numbered(number))
        await asyncio.sleep(rng.uniform(0.001, 0.006))
    await cnc.until(lambda end: len(end.data) >= 12 * REQUESTS)
    out_of_order = [b for a, b in pairwise(drive.values) if b < a]
    assert not out_of_order, f"{len(out_of_order)} of {REQUESTS}: {out_of_order[:5]}"


async def test_w1_nor_does_a_short_standstill_of_the_gateway_change_their_order(bench: Bench) -> None:
    drive = Drive()
    _, where = await bench.drive("tcp", drive)
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,), timing=replace(TIMING, gap_ms=50.0))
    await until_up(relay)
    cnc = await bench.connect(relay.address("line", "cnc"))
    cnc.write(numbered(1))
    await cnc.until(lambda end: len(end.data) >= 12)
    cnc.write(numbered(2))  # waits for the silence
    for _ in range(10):
        await asyncio.sleep(0)  # it is read
    assert drive.values == [1]
    cnc.write(numbered(3))
    time.sleep(0.1)  # noqa: ASYNC251 - the process stands still
    await cnc.until(lambda end: len(end.data) >= 36)
    assert drive.values == [1, 2, 3]


@pytest.mark.parametrize("seed", [1, 2, 3])
async def test_a_monitor_on_a_paced_line_replays_to_the_same_bytes(
    bench: Bench, tmp_path: Path, seed: int
) -> None:
    """The gaps between motion count from the end of the silence, also if nothing waits for it."""

    def answer(data: bytes) -> bytes:
        return data[:4] + b"\x00\x05" + data[6:7] + bytes.fromhex("03 02 0000")

    _, where = await bench.drive("tcp", answer)
    cnc_link, _ = bench.controller_link("tcp")
    hmi_link, _ = bench.controller_link("tcp", "hmi", Role.MONITOR)
    timing = replace(TIMING, gap_ms=GAP_MS, quiet_ms=5.0, monitor_max_wait_ms=100.0)
    plan = GatewayPlan("bench", (LinePlan("line", where, (cnc_link, hmi_link), (), timing),))
    path = tmp_path / "record.jsonl"
    relay = await bench.start(plan, recorder=Recorder(path, HEADER))
    await until_up(relay)
    cnc = await bench.connect(relay.address("line", "cnc"))
    hmi = await bench.connect(relay.address("line", "hmi"))
    rng = random.Random(seed)
    for number in range(1, 300):
        cnc.write(encode_mbap(number, 1, bytes.fromhex("03 00C8 0001")))
        if rng.random() < 0.5:
            await asyncio.sleep(rng.uniform(0.0, 0.006))
            hmi.write(encode_mbap(number, 1, bytes.fromhex("03 00C9 0001")))
        await asyncio.sleep(rng.choice((0.004, 0.008, 0.012)))
    await asyncio.sleep(0.3)
    await relay.stop()
    result = replayed(plan, path)
    assert (result.different, result.first, result.is_truncated) == (0, [], False)
