"""One drive is well and one is dead, polled in turn over real sockets and pseudo terminals."""

import asyncio
import contextlib
import itertools
import time

import pytest

from gateway.exchange.plan import LineTiming
from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.rtu import encode_rtu
from tests.support.relay import Bench, RawEnd, line_status, until_up

READ, REPLY, NO_RESPONSE = (bytes.fromhex(text) for text in ("03 0010 0001", "03 02 0007", "83 0B"))
WELL, DEAD = 1, 2
TIMEOUT_MS = 1000.0
TAKES_S = 0.003
READS_BETWEEN = 5
"""So many of unit 1 before each of unit 2: 15 ms. A poll of unit 2 within 500 ms is too late."""
SOON_MS = 1250.0
"""From the first poll of unit 2 to the next: 250 ms behind its time-out, 250 ms more for a busy machine."""


def drive(end: RawEnd, data: bytes) -> None:
    """Answer for unit 1, after a while."""
    if data[0] == WELL:
        asyncio.get_running_loop().call_later(TAKES_S, end.write, encode_rtu(WELL, REPLY))


async def poll(near: RawEnd, unit_id: int, number: int) -> tuple[bytes, float]:
    """Ask a unit id and wait as long as a controller does; return the PDU of the answer and the ms it took.

    ``number``: its transaction id over TCP; 0 on a serial port.
    """
    near.data = b""
    begun = time.monotonic()
    near.write(encode_mbap(number, unit_id, READ) if number else encode_rtu(unit_id, READ))
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(TIMEOUT_MS / 1000):
            await near.until(lambda end: bool(answered(end, unit_id, number)))
    return answered(near, unit_id, number), 1000 * (time.monotonic() - begun)


def answered(near: RawEnd, unit_id: int, number: int) -> bytes:
    """Return the PDU that has come for a request, and not for one that was given up; empty: none has."""
    if number:
        return b"".join(pdu for each, _, pdu in MbapDecoder().feed(near.data) if each == number)
    return next((pdu for pdu in (REPLY, NO_RESPONSE) if encode_rtu(unit_id, pdu) == near.data), b"")


@pytest.mark.parametrize("controller", ["tcp", "rtu"])
async def test_w6_before_it_is_dead_the_other_one_loses_nothing(bench: Bench, controller: str) -> None:
    serial = controller == "rtu"
    drives, where = await bench.drive("rtu")
    drives.script = lambda data: drive(drives, data)
    link, device = bench.controller_link(controller, timeout_ms=TIMEOUT_MS)
    timing = LineTiming(response_timeout_ms=TIMEOUT_MS, drain_ms=TIMEOUT_MS)
    relay = await bench.relay(where, (link,), timing=timing)
    await until_up(relay)
    near = await (bench.plug(device) if serial else bench.connect(relay.address("line", "cnc")))
    of_dead: list[bytes] = []
    begun_ms: list[float] = []
    of_well: list[tuple[bytes, float]] = []
    numbers = itertools.repeat(0) if serial else itertools.count(1)
    while line_status(relay)["timeouts"] != 3:
        of_well += [await poll(near, WELL, next(numbers)) for _ in range(READS_BETWEEN)]
        begun_ms.append(1000 * time.monotonic())
        of_dead.append((await poll(near, DEAD, next(numbers)))[0])
    status = line_status(relay)
    assert {pdu for pdu, _ in of_well} == {REPLY}
    assert max(took_ms for _, took_ms in of_well) < TIMEOUT_MS
    # Behind each of two time-outs two are answered at once, if the machine lets unit 1 be read so often
    # before half of the silence is over; the poll behind these goes.
    too_late = int(str(status["too_late"]))
    assert too_late <= 4
    assert status["withdrawn"] == 0
    # A time-out itself may be told before a controller on TCP has given up.
    assert of_dead.count(NO_RESPONSE) >= too_late
    if begun_ms[1] - begun_ms[0] < SOON_MS:
        assert of_dead[1] == NO_RESPONSE
        assert too_late >= 1
