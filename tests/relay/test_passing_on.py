"""All that holds no position goes through byte for byte, between every kind of controller and drive."""

import pytest

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from tests.support.relay import Bench, eventually, first_controller, line_status

COMBINATIONS = pytest.mark.parametrize(
    ("controller", "drives"),
    [("tcp", "tcp"), ("tcp", "rtu"), ("rtu", "tcp"), ("rtu", "rtu"), ("tcp", "rtu_over_tcp")],
)


def framed(kind: str, pdu: bytes, transaction_id: int = 7) -> bytes:
    return encode_mbap(transaction_id, 1, pdu) if kind == "tcp" else encode_rtu(1, pdu)


def pdu_of(kind: str, frame: bytes) -> bytes:
    return frame[7:] if kind == "tcp" else frame[1:-2]


def reply_to(kind: str, request: bytes, reply: bytes) -> bytes:
    """Frame a reply as an independent drive does: its transaction id is the request's."""
    if kind == "tcp":
        return request[:4] + (len(reply) + 1).to_bytes(2, "big") + request[6:7] + reply
    return encode_rtu(request[0], reply)


@COMBINATIONS
@pytest.mark.parametrize("function", [0x41, 0x64, 0x65])
async def test_w1_unknown_functions_pass(bench: Bench, controller: str, drives: str, function: int) -> None:
    request, reply = bytes([function, 1, 2, 3, 4, 5]), bytes([function, 0, 0xFF, 0x0D, 0x11, 0x13, 9])
    near, far, _ = await bench.raw_pair(controller, drives, lambda data: reply_to(drives, data, reply))
    near.write(framed(controller, request))
    await near.receives(framed(controller, reply))
    assert pdu_of(drives, far.data) == request


@COMBINATIONS
async def test_w1_a_vendor_exception_keeps_its_code(bench: Bench, controller: str, drives: str) -> None:
    near, _, _ = await bench.raw_pair(
        controller, drives, lambda data: reply_to(drives, data, bytes([0x83, 0xE7]))
    )
    near.write(framed(controller, bytes.fromhex("03 9C40 0002")))
    await near.receives(framed(controller, bytes([0x83, 0xE7])))


@COMBINATIONS
async def test_one_request_after_the_other_is_answered(bench: Bench, controller: str, drives: str) -> None:
    count = 0

    def script(data: bytes) -> bytes:
        nonlocal count
        count += 1
        return reply_to(drives, data, bytes([3, 2, 0, count]))

    near, _, _ = await bench.raw_pair(controller, drives, script)
    for number in range(1, 6):
        near.write(framed(controller, bytes.fromhex("03 0010 0001"), number))
        await near.receives(framed(controller, bytes([3, 2, 0, number]), number))


@pytest.mark.parametrize("drives", ["tcp", "rtu", "rtu_over_tcp"])
async def test_w1_pipelined_requests_are_answered_in_their_order(bench: Bench, drives: str) -> None:
    def script(data: bytes) -> bytes:
        address = pdu_of(drives, data)[2]
        return reply_to(drives, data, bytes([3, 2, 0, address]))

    near, _, _ = await bench.raw_pair("tcp", drives, script)
    requests = [encode_mbap(number, 1, bytes([3, 0, number, 0, 1])) for number in (1, 2, 3)]
    near.write(b"".join(requests))
    await near.receives(b"".join(encode_mbap(number, 1, bytes([3, 2, 0, number])) for number in (1, 2, 3)))


@COMBINATIONS
async def test_frames_in_single_bytes_are_put_together(bench: Bench, controller: str, drives: str) -> None:
    near, far, _ = await bench.raw_pair(controller, drives)
    request = framed(controller, bytes.fromhex("03 0010 0001"))
    for byte in request:
        near.write(bytes([byte]))
    await far.until(lambda end: pdu_of(drives, end.data) == bytes.fromhex("03 0010 0001"))
    for byte in reply_to(drives, far.data, bytes([3, 2, 0, 1])):
        far.write(bytes([byte]))
    await near.receives(framed(controller, bytes([3, 2, 0, 1])))


@pytest.mark.parametrize("drives", ["tcp", "rtu", "rtu_over_tcp"])
async def test_garbage_from_a_serial_controller_costs_no_good_frame(bench: Bench, drives: str) -> None:
    near, far, relay = await bench.raw_pair(
        "rtu", drives, lambda data: reply_to(drives, data, bytes([3, 2, 0, 1]))
    )
    near.write(bytes.fromhex("01 03 0010 0001 FFFF"))  # its check sum is wrong

    def dropped() -> bool:
        status = line_status(relay)["controllers"]
        assert isinstance(status, list)
        return bool(status[0]["crc_errors"])

    await eventually(dropped)
    near.write(framed("rtu", bytes.fromhex("03 0010 0001")))
    await near.receives(framed("rtu", bytes([3, 2, 0, 1])))
    assert pdu_of(drives, far.data) == bytes.fromhex("03 0010 0001")


@pytest.mark.parametrize("controller", ["tcp", "rtu"])
@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_noise_before_a_reply_is_dropped(bench: Bench, controller: str, drives: str) -> None:
    near, _, _ = await bench.raw_pair(
        controller, drives, lambda data: b"\x00\xff" + reply_to(drives, data, bytes([3, 2, 0, 1])) + b"\x00"
    )
    for _ in range(2):
        near.write(framed(controller, bytes.fromhex("03 0010 0001")))
        await near.receives(framed(controller, bytes([3, 2, 0, 1])))


@pytest.mark.parametrize(
    "garbage",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        bytes.fromhex("0001 0000 0000"),
        bytes.fromhex("0001 0000 0001 01"),
        bytes.fromhex("0001 0000 FFFF 01 03 0000 0001"),
    ],
    ids=["http", "length 0", "length 1", "length 65535"],
)
async def test_garbage_ends_its_connection_and_no_other(bench: Bench, garbage: bytes) -> None:
    near, far, relay = await bench.raw_pair(
        "tcp", "tcp", lambda data: reply_to("tcp", data, bytes([3, 2, 0, 1]))
    )
    other = await bench.connect(relay.address("line", "cnc"))
    near.write(garbage)
    await near.until(lambda end: end.closes == 1)
    assert first_controller(relay)["dropped_bytes"] == len(garbage)
    other.write(framed("tcp", bytes.fromhex("03 0010 0001")))
    await other.receives(framed("tcp", bytes([3, 2, 0, 1])))
    assert pdu_of("tcp", far.data) == bytes.fromhex("03 0010 0001")


async def test_a_frame_of_another_protocol_costs_no_good_frame(bench: Bench) -> None:
    near, far, relay = await bench.raw_pair(
        "tcp", "tcp", lambda data: reply_to("tcp", data, bytes([3, 2, 0, 1]))
    )
    near.write(bytes.fromhex("0001 0007 0006 01 03 0000 0001"))
    near.write(framed("tcp", bytes.fromhex("03 0010 0001")))
    await near.receives(framed("tcp", bytes([3, 2, 0, 1])))
    assert pdu_of("tcp", far.data) == bytes.fromhex("03 0010 0001")
    assert first_controller(relay)["dropped_bytes"] == 12


async def test_a_host_that_sends_garbage_on_every_connection_is_told_of_once(bench: Bench) -> None:
    near, _, relay = await bench.raw_pair("tcp", "tcp", lambda data: reply_to("tcp", data, b"\x83\x02"))
    [where] = next(iter(relay.addresses.values()))
    ends = [near, *[await bench.connect(where) for _ in range(9)]]
    for end in ends:
        end.write(b"GET / HTTP/1.1\r\n\r\n")
    await eventually(lambda: first_controller(relay)["dropped_bytes"] == 18 * len(ends))
    told = [dict(note.fields)["detail"] for note in bench.notes if note.event == "connection-malformed"]
    assert told == ["127.0.0.1: it sent a header of impossible length; its connection was closed"]


@pytest.mark.parametrize("controller", ["tcp", "rtu"])
async def test_a_broadcast_goes_out_once_and_the_next_request_follows(bench: Bench, controller: str) -> None:
    def script(data: bytes) -> bytes | None:
        return reply_to("rtu", data, bytes([3, 2, 0, 1])) if data[0] else None

    near, far, _ = await bench.raw_pair(controller, "rtu", script)
    stop_all = bytes.fromhex("06 6002 0040")
    near.write(encode_mbap(1, 0, stop_all) if controller == "tcp" else encode_rtu(0, stop_all))
    await far.until(lambda end: end.data == encode_rtu(0, stop_all))
    near.write(framed(controller, bytes.fromhex("03 0010 0001")))
    await near.receives(framed(controller, bytes([3, 2, 0, 1])))
    assert far.data == encode_rtu(0, stop_all) + encode_rtu(1, bytes.fromhex("03 0010 0001"))
