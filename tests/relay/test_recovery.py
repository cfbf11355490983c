"""Drives, adapters and cables that go away and come back; drives that are silent, late or dead."""

import asyncio
import contextlib
import itertools
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from gateway.clock import boot_ns
from gateway.exchange.plan import LineTiming
from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.serial import SerialPort
from gateway.transport.tcp import TcpListener
from tests.support.relay import Bench, RawEnd, eventually, line_status, until_up

if TYPE_CHECKING:
    from gateway.relay.gateway import Relay

READ = bytes.fromhex("03 0010 0001")
REPLY = bytes.fromhex("03 02 0007")
PATH_UNAVAILABLE, NO_RESPONSE = bytes([0x83, 0x0A]), bytes([0x83, 0x0B])


def answer_tcp(data: bytes) -> bytes:
    return data[:4] + bytes([0, len(REPLY) + 1]) + data[6:7] + REPLY


def answer_rtu(data: bytes) -> bytes:
    return encode_rtu(data[0], REPLY)


async def ask(near: RawEnd, transaction_id: int, expected: bytes) -> None:
    near.write(encode_mbap(transaction_id, 1, READ))
    await near.receives(encode_mbap(transaction_id, 1, expected))


async def listen(endpoint: TcpEndpoint, end: RawEnd) -> TcpListener:
    listener = TcpListener(endpoint, (), lambda: end, lambda host, why: None)
    await listener.open()
    return listener


async def test_a_drive_that_restarts_is_connected_again(bench: Bench) -> None:
    drive = RawEnd(answer_tcp)
    listener = await listen(TcpEndpoint("127.0.0.1", 0), drive)
    where = listener.addresses[0]
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,))
    await until_up(relay)
    near = await bench.connect(relay.address("line", "cnc"))
    await ask(near, 1, REPLY)
    await listener.close()
    await eventually(lambda: line_status(relay)["state"] == "down")
    await ask(near, 2, PATH_UNAVAILABLE)
    listener = await listen(where, drive)
    await until_up(relay)
    await ask(near, 3, REPLY)
    await relay.stop()
    await listener.close()
    events = [note.event for note in bench.notes]
    assert events.count("line-up") == 2
    assert events.count("line-down") == 1


async def test_a_drive_that_is_off_at_the_start_is_waited_for(bench: Bench) -> None:
    drive = RawEnd(answer_tcp)
    listener = await listen(TcpEndpoint("127.0.0.1", 0), drive)
    where = listener.addresses[0]
    await listener.close()
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,))
    near = await bench.connect(relay.address("line", "cnc"))
    await ask(near, 1, PATH_UNAVAILABLE)
    listener = await listen(where, drive)
    await until_up(relay)
    await ask(near, 2, REPLY)
    await relay.stop()
    await listener.close()


async def test_a_drive_adapter_that_is_replugged_is_opened_again(bench: Bench, tmp_path: Path) -> None:
    device = tmp_path / "by-id"
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(SerialEndpoint(str(device), 115200, "E"), (link,))
    near = await bench.connect(relay.address("line", "cnc"))
    for turn in range(2):
        await ask(near, 10 * turn, PATH_UNAVAILABLE)
        cable = bench.cable()
        device.symlink_to(cable.near)
        port = SerialPort(SerialEndpoint(cable.far), RawEnd(answer_rtu), lambda why: None)
        await port.open()
        await until_up(relay)
        await ask(near, 10 * turn + 1, REPLY)
        await port.close()
        if turn == 0:
            cable.close()
            device.unlink()
            await eventually(lambda: line_status(relay)["state"] == "down")


async def test_a_controllers_adapter_that_is_replugged_is_opened_again(bench: Bench, tmp_path: Path) -> None:
    device = tmp_path / "by-id"
    _, where = await bench.drive("tcp", answer_tcp)
    link, _ = bench.controller_link("rtu")
    plan = link.plan
    relay = await bench.relay(where, (type(link)(plan, SerialEndpoint(str(device), 115200)),))
    await until_up(relay)

    def controller_state(relay: "Relay") -> object:
        controllers = line_status(relay)["controllers"]
        assert isinstance(controllers, list)
        return controllers[0]["state"]

    for turn in range(2):
        cable = bench.cable()
        device.symlink_to(cable.near)
        near = RawEnd()
        port = SerialPort(SerialEndpoint(cable.far), near, lambda why: None)
        await port.open()
        await eventually(lambda: controller_state(relay) == "up")
        near.write(encode_rtu(1, READ))
        await near.receives(encode_rtu(1, REPLY))
        await port.close()
        if turn == 0:
            cable.close()
            device.unlink()
            await eventually(lambda: controller_state(relay) == "down")


@pytest.mark.parametrize("drives", ["tcp", "rtu", "rtu_over_tcp"])
async def test_a_silent_drive_is_0x0b_and_the_next_request_is_answered(bench: Bench, drives: str) -> None:
    seen = 0

    def script(data: bytes) -> bytes | None:
        nonlocal seen
        seen += 1
        if seen == 1:
            return None
        return answer_tcp(data) if drives == "tcp" else answer_rtu(data)

    near, _, _ = await bench.raw_pair("tcp", drives, script)
    await ask(near, 1, NO_RESPONSE)
    await ask(near, 2, REPLY)
    assert seen == 2


async def test_a_late_reply_never_answers_the_next_request_on_tcp(bench: Bench) -> None:
    near, far, relay = await bench.raw_pair("tcp", "tcp")
    await ask(near, 1, NO_RESPONSE)
    first = far.data
    near.write(encode_mbap(2, 1, READ))
    await far.until(lambda end: len(end.data) > len(first))
    second = far.data[len(first) :]
    assert first[:2] != second[:2]
    far.write(first[:4] + bytes([0, 5]) + first[6:7] + bytes.fromhex("03 02 DEAD"))
    far.write(answer_tcp(second))
    await near.receives(encode_mbap(2, 1, REPLY))
    assert line_status(relay)["late_replies"] == 1


async def test_a_late_reply_never_answers_the_next_request_on_a_serial_line(bench: Bench) -> None:
    near, far, _ = await bench.raw_pair("tcp", "rtu")
    await ask(near, 1, NO_RESPONSE)
    far.write(encode_rtu(1, bytes.fromhex("03 02 DEAD")))  # first: on a busy machine the silence may be over
    near.write(encode_mbap(2, 1, READ))  # waits: the line must fall silent
    sent_once = encode_rtu(1, READ)
    await far.until(lambda end: end.data == 2 * sent_once)
    far.write(answer_rtu(sent_once))
    await near.receives(encode_mbap(2, 1, REPLY))


async def test_a_serial_controller_hears_nothing_of_a_silent_drive(bench: Bench) -> None:
    silent = True

    def script(data: bytes) -> bytes | None:
        return None if silent else answer_tcp(data)

    near, _, relay = await bench.raw_pair("rtu", "tcp", script)
    near.write(encode_rtu(1, READ))
    await eventually(lambda: line_status(relay)["timeouts"] == 1)
    silent = False
    near.write(encode_rtu(1, READ))
    await near.receives(encode_rtu(1, REPLY))


async def test_a_request_waits_for_the_gap_that_the_drives_need(bench: Bench) -> None:
    asked_ns: list[int] = []
    answered_ns: list[int] = []

    def drive(data: bytes) -> bytes:
        asked_ns.append(boot_ns())
        answer = answer_rtu(data)
        answered_ns.append(boot_ns())
        return answer

    near, _, _ = await bench.raw_pair("tcp", "rtu", drive, timing=LineTiming(gap_ms=20.0))
    for number in range(3):
        await ask(near, number, REPLY)
    # As the drive sees it: however late anybody is woken, that makes the gap longer, never shorter.
    assert len(asked_ns) == 3
    assert all(asked_ns[i + 1] - answered_ns[i] >= 20_000_000 for i in range(2))


# === one drive is well and one is dead, polled in turn ===================================================
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
