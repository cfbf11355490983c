"""The silence before a frame: the writer of a wire, and the order of requests over real sockets."""

import asyncio
import os
import random
import socket
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.clock import boot_ns
from gateway.exchange.plan import Role
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.recording.writer import Recorder
from gateway.relay.pacing import PacedReplies, WireWriter
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.transport.channel import Channel
from tests.support.recordings import HEADER, replayed
from tests.support.relay import TIMING, Bench, RawEnd, until_up

MS = 1_000_000
LONG_MS = 60_000


class Wire(Channel):
    """A channel that notes when what was written."""

    def __init__(self, wire_ns_per_byte: int = 0) -> None:
        self.wire_ns_per_byte = wire_ns_per_byte
        self.written: list[tuple[bytes, int]] = []

    @property
    def frames(self) -> list[bytes]:
        return [data for data, _ in self.written]

    def write(self, data: bytes) -> None:
        self.written.append((data, boot_ns()))

    def has_gone(self, *, asks: bool) -> bool:
        return False

    def close(self) -> None:
        pass


def opened(wire: Wire, gap_ns: int, wire_gap_ns: int = 0, *, at_ns: int = 0) -> WireWriter:
    paced = WireWriter(gap_ns, wire_gap_ns)
    paced.opened(wire, at_ns)
    return paced


async def drained(replies: PacedReplies) -> None:
    async with asyncio.timeout(30):
        await replies.drained()


# --- the wire -----------------------------------------------------------------------------------------------


def test_the_traffic_before_the_port_was_opened_is_unknown() -> None:
    paced = opened(Wire(), 5 * MS, at_ns=100 * MS)
    assert not paced.may_begin(105 * MS - 1)
    assert paced.may_begin(105 * MS)


def test_bytes_that_are_heard_begin_the_silence_again() -> None:
    paced = opened(Wire(), 5 * MS)
    paced.heard(103 * MS)
    assert paced.stamps.next_ns == 108 * MS
    paced.heard(101 * MS)  # read later, came earlier
    assert paced.stamps.next_ns == 108 * MS


def test_the_time_that_written_bytes_take_on_the_wire_counts() -> None:
    wire = Wire(wire_ns_per_byte=1 * MS)
    paced = opened(wire, 2 * MS)
    before_ns = boot_ns()
    paced.write(b"four")
    [(_, after_ns)] = wire.written
    assert before_ns + 6 * MS <= paced.stamps.next_ns <= after_ns + 6 * MS  # 4 ms of bytes, 2 ms of silence


def test_a_piece_follows_the_bytes_of_the_pieces_before_it() -> None:
    wire = Wire(wire_ns_per_byte=10 * MS)
    paced = opened(wire, 2 * MS)
    before_ns = boot_ns()
    for _ in range(4):
        paced.write(b"one")
    assert before_ns + 122 * MS <= paced.stamps.next_ns <= wire.written[0][1] + 122 * MS


def test_the_silence_between_characters_is_kept_only_where_there_is_a_wire() -> None:
    assert opened(Wire(), 0, 50 * MS, at_ns=MS).may_begin(MS)
    assert not opened(Wire(wire_ns_per_byte=1), 0, 2 * MS, at_ns=MS).may_begin(3 * MS - 1)
    assert opened(Wire(wire_ns_per_byte=1), 0, 2 * MS, at_ns=MS).may_begin(3 * MS)


def test_without_a_gap_there_is_never_a_wait() -> None:
    paced = opened(Wire(), 0, at_ns=MS)
    paced.write(b"one")
    paced.heard(boot_ns())
    assert paced.stamps.next_ns == 0


def test_nothing_begins_on_a_closed_port() -> None:
    wire = Wire()
    paced = opened(wire, 0)
    paced.closed()
    assert not paced.may_begin(MS)
    paced.write(b"one")
    assert wire.written == []


# --- replies ------------------------------------------------------------------------------------------------


async def test_a_reply_waits_for_the_silence_behind_what_was_heard() -> None:
    wire = Wire()
    paced = opened(wire, 5 * MS)
    replies = PacedReplies(paced)
    heard_ns = boot_ns()
    paced.heard(heard_ns)
    replies.send(b"one", heard_ns + LONG_MS * MS)
    assert wire.written == []
    await drained(replies)
    assert wire.frames == [b"one"]
    assert wire.written[0][1] >= heard_ns + 5 * MS
    replies.close()


async def test_bytes_heard_while_it_waits_put_it_off() -> None:
    wire = Wire()
    start_ns = boot_ns()
    paced = opened(wire, 5 * MS, at_ns=start_ns)
    replies = PacedReplies(paced)
    replies.send(b"one", start_ns + LONG_MS * MS)
    paced.heard(start_ns + 3 * MS)
    await drained(replies)
    assert wire.written[0][1] >= start_ns + 8 * MS
    replies.close()


async def test_w6_a_reply_is_not_sent_once_its_controller_has_given_up() -> None:
    wire = Wire()
    start_ns = boot_ns()
    replies = PacedReplies(opened(wire, 5 * MS, at_ns=start_ns))
    replies.send(b"too late", start_ns + 4 * MS)
    await drained(replies)
    assert wire.frames == []
    replies.send(b"next", boot_ns() + LONG_MS * MS)
    assert wire.frames == [b"next"]
    replies.close()


async def test_w6_a_reply_is_dropped_when_the_next_one_comes_or_it_is_discarded() -> None:
    wire = Wire()
    start_ns = boot_ns()
    by_ns = start_ns + LONG_MS * MS
    replies = PacedReplies(opened(wire, 5 * MS, at_ns=start_ns))
    replies.send(b"one", by_ns)
    replies.send(b"two", by_ns)
    await drained(replies)
    assert wire.frames == [b"two"]
    paced = opened(wire, 5 * MS, at_ns=boot_ns())
    replies.close()
    replies = PacedReplies(paced)
    replies.send(b"three", by_ns)
    replies.discard()
    await drained(replies)
    assert wire.frames == [b"two"]
    replies.close()


async def test_w6_what_the_controller_has_sent_is_read_before_a_reply_is_written_late() -> None:
    """The process stands still while a reply waits; the controller's next request is read first."""
    wire = Wire()
    start_ns = boot_ns()
    replies = PacedReplies(opened(wire, MS, at_ns=start_ns))
    replies.send(b"one", start_ns + LONG_MS * MS)
    loop = asyncio.get_running_loop()
    reading, writing = os.pipe()

    def request_came() -> None:
        os.read(reading, 1)
        replies.discard()

    loop.add_reader(reading, request_came)
    os.write(writing, b"x")
    while boot_ns() < start_ns + 3 * MS:  # it stands still: silence and request are both over
        pass
    await drained(replies)
    loop.remove_reader(reading)
    os.close(reading)
    os.close(writing)
    assert wire.frames == []
    replies.close()


async def test_each_reply_is_named_as_it_is_written() -> None:
    named: list[bytes] = []
    start_ns = boot_ns()
    replies = PacedReplies(opened(Wire(), 2 * MS, at_ns=start_ns), named.append)
    replies.send(b"one", start_ns + LONG_MS * MS)
    assert named == []
    await drained(replies)
    assert named == [b"one"]
    replies.close()


# === the order of requests over real sockets =============================================================

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
    cnc, _, _ = await bench.raw_pair("tcp", "tcp", drive, timing=replace(TIMING, gap_ms=GAP_MS))
    rng = random.Random(1)
    for number in range(1, REQUESTS + 1):
        cnc.write(numbered(number))
        await asyncio.sleep(rng.uniform(0.001, 0.006))
    await cnc.until(lambda end: len(end.data) >= 12 * REQUESTS)
    out_of_order = [b for a, b in pairwise(drive.values) if b < a]
    assert not out_of_order, f"{len(out_of_order)} of {REQUESTS}: {out_of_order[:5]}"


async def test_w1_nor_does_a_short_standstill_of_the_gateway_change_their_order(bench: Bench) -> None:
    drive = Drive()
    cnc, _, _ = await bench.raw_pair("tcp", "tcp", drive, timing=replace(TIMING, gap_ms=50.0))
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


# === the process stands still while a request waits for its silence ======================================

LONG_GAP_MS = 50.0
READ = bytes.fromhex("03 00C8 0001")
WRITE = bytes.fromhex("06 00C8 0001")
ANSWER = bytes.fromhex("03 02 0007")


async def read_by_the_relay() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


async def paced(bench: Bench, timeout_ms: float = 200.0) -> tuple[RawEnd, RawEnd]:
    """A controller over Modbus/TCP that got an answer just now, and an RTU drive that needs a silence."""
    cnc, drive, _ = await bench.raw_pair(
        "tcp",
        "rtu_over_tcp",
        timeout_ms=timeout_ms,
        timing=replace(TIMING, gap_ms=LONG_GAP_MS, drain_ms=60.0),
    )
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
    relay = await bench.relay(where, (link,), timing=replace(TIMING, gap_ms=LONG_GAP_MS))
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
