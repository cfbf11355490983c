"""Requests of controllers: in pieces, with lengths that cannot be, of every kind, passed on byte for byte."""

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from gateway.exchange.events import Event
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming
from gateway.exchange.ports import DriveLink
from gateway.modbus.mbap import MbapCounters, encode_mbap
from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from gateway.relay.controller_port import MbapControllerPort, RtuControllerPort
from gateway.relay.pulse import Beats
from gateway.transport.channel import Channel
from gateway.transport.endpoints import TcpEndpoint
from tests.exchange.staged_bench import RUN_PDU, RUN_RELATIVE_PDU, STOP_PDU, staged_plan
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

# === pieces, and lengths that cannot be: no byte of their data becomes a request (W5) ====================

MS = 1_000_000
START_NS = 10_000 * MS
TIMEOUT_MS = 1000.0
# A block of ten registers to 0x2000. Its data is a whole frame, with a header of its own, which writes 90 000
# counts to the position at 100 (0x64).
INNER = encode_mbap(0, 1, bytes.fromhex("10 0064 0002 04 0001 5F90"))
WHOLE = encode_mbap(5, 1, bytes.fromhex("10 2000 000A 14") + INNER + bytes(20 - len(INNER)))
CUT = len(WHOLE) - 20
READ = encode_mbap(6, 1, bytes.fromhex("03 2000 0001"))


class Wires(DriveLink):
    """The way to the drives; keeps what is written."""

    def __init__(self) -> None:
        super().__init__(is_serial=False)
        self.sent: list[bytes] = []

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        self.sent.append(pdu)

    def abandon(self) -> None:
        pass


class End(Channel):
    """The near end of the controller's connection; keeps what is written."""

    def __init__(self) -> None:
        self.peer = "192.168.0.7:4711"
        self.replies = b""
        self.is_closed = False

    def write(self, data: bytes) -> None:
        self.replies += data

    def has_gone(self, *, asks: bool) -> bool:
        return False

    def close(self) -> None:
        self.is_closed = True


class Connection:
    """A controller's connection to a line, with the time in the hands of the test."""

    def __init__(self, *axes: AxisPlan) -> None:
        self.wires, self.end = Wires(), End()
        self.events: list[Event] = []
        self.malformed: list[str] = []
        self.line = LineExchange(axes, LineTiming(), self.wires, self.events.append)
        self.line.link_up(START_NS)
        self.plan = plan = ControllerPlan("cnc", timeout_ms=TIMEOUT_MS)
        self.beats = Beats()
        self.port = MbapControllerPort(
            plan, self.line, MbapCounters(), self.malformed.append, beats=self.beats
        )
        self.port.opened(self.end, START_NS)

    def arrives(self, data: bytes, after_ms: float) -> None:
        self.port.received(data, START_NS + int(after_ms * MS))

    def withdrawn(self) -> list[str]:
        return [event.detail for event in self.events if event.kind.name == "withdrawn"]


@pytest.fixture
async def connection() -> Connection:
    return Connection()


async def test_the_late_tail_of_a_request_is_no_request(connection: Connection) -> None:
    connection.arrives(WHOLE[:CUT], 0)
    connection.arrives(WHOLE[CUT:], TIMEOUT_MS + 150)
    assert connection.wires.sent == []
    assert connection.withdrawn() == [
        "a request of cnc was not sent: it came in pieces for longer than its controller's timeout_ms"
    ]
    assert connection.end.is_closed
    assert connection.end.replies == b""


async def test_bytes_that_drip_in_do_not_make_a_request_younger(connection: Connection) -> None:
    for number, byte in enumerate(WHOLE):
        connection.arrives(bytes((byte,)), number * TIMEOUT_MS / 20)  # 33 bytes take 1.6 s
    assert connection.wires.sent == []
    assert len(connection.withdrawn()) == 1
    assert connection.end.is_closed


async def test_a_request_in_pieces_within_the_patience_is_sent(connection: Connection) -> None:
    connection.arrives(WHOLE[:CUT], 0)
    connection.arrives(WHOLE[CUT:], TIMEOUT_MS)
    assert connection.wires.sent == [WHOLE[7:]]
    assert not connection.end.is_closed


async def test_each_request_has_an_age_of_its_own(connection: Connection) -> None:
    connection.arrives(READ[:5], 0)
    connection.arrives(READ[5:] + WHOLE[:CUT], TIMEOUT_MS - 1)
    connection.line.reply(1, bytes.fromhex("03 02 0000"), START_NS + 1000 * MS)
    connection.arrives(WHOLE[CUT:], 2 * TIMEOUT_MS - 2)
    assert connection.wires.sent == [READ[7:], WHOLE[7:]]


async def test_what_stands_behind_a_late_tail_is_not_sent_either(connection: Connection) -> None:
    connection.arrives(WHOLE[:CUT], 0)
    connection.arrives(WHOLE[CUT:] + READ + READ[:4], TIMEOUT_MS + 150)
    connection.arrives(READ[4:], TIMEOUT_MS + 151)
    assert connection.wires.sent == []
    assert len(connection.withdrawn()) == 1
    assert connection.line.counters.withdrawn == 2


@pytest.mark.parametrize("is_split", [False, True])
async def test_the_data_of_a_too_long_request_is_no_request(
    connection: Connection, *, is_split: bool
) -> None:
    # FC16 of 124 registers from 1000 on; its first eight data bytes read as: write 1234 to register 1500.
    head = bytes.fromhex("0002 0000 00FF 01 10 03E8 007C F8")
    data = bytes.fromhex("0007 0000 0006 01 06 05DC 04D2") + bytes(236)
    if is_split:
        connection.arrives(head, 0)
        connection.arrives(data, 1)
    else:
        connection.arrives(head + data, 0)
    connection.arrives(READ, 2)
    assert connection.wires.sent == []
    assert connection.end.replies == encode_mbap(2, 1, bytes((0x90, 3)))
    assert connection.end.is_closed
    assert connection.malformed == ["192.168.0.7:4711"]


@pytest.mark.parametrize("length", ["0000", "0001", "0105", "FFFF"])
async def test_a_length_that_cannot_be_ends_the_connection(connection: Connection, length: str) -> None:
    connection.arrives(bytes.fromhex(f"0002 0000 {length} 01 10 03E8"), 0)
    connection.arrives(READ, 1)
    assert connection.wires.sent == []
    assert connection.end.replies == b""
    assert connection.end.is_closed


async def test_over_real_sockets_a_too_long_request_ends_the_connection(bench: Bench) -> None:
    near, far, _ = await bench.raw_pair("tcp", "tcp")
    near.write(bytes.fromhex("0002 0000 00FF 01 10 03E8 007C F8"))
    await near.receives(encode_mbap(2, 1, bytes((0x90, 3))))
    await near.until(lambda end: end.closes == 1)
    assert far.data == b""


async def test_m3_a_stop_in_two_halves_goes_out_however_late_its_tail_is() -> None:
    connection = Connection(staged_plan())
    del connection.wires.sent[:]
    stop = encode_mbap(7, 1, STOP_PDU)
    connection.arrives(stop[:9], 0)
    connection.arrives(stop[9:], TIMEOUT_MS + 150)
    assert connection.wires.sent == [STOP_PDU]
    assert connection.withdrawn() == []
    assert connection.end.is_closed


async def test_m3_a_target_in_two_halves_that_is_too_late_blocks_its_trigger() -> None:
    connection = Connection(staged_plan())
    target = encode_mbap(7, 1, bytes.fromhex("10 0606 0002 04 5F90 0001"))
    connection.arrives(target[:9], 0)
    connection.arrives(target[9:], TIMEOUT_MS + 150)
    again = MbapControllerPort(
        connection.plan, connection.line, MbapCounters(), connection.malformed.append, beats=Beats()
    )
    end = End()
    again.opened(end, START_NS)
    again.received(encode_mbap(8, 1, RUN_PDU), START_NS + 1200 * MS)
    assert connection.wires.sent == []
    assert end.replies == encode_mbap(8, 1, bytes((0x86, 4)))  # lost: exception 4 (M3)


def serial_port(connection: Connection) -> RtuControllerPort:
    """A controller on a wire of the same line."""
    plan = ControllerPlan("cnc", timeout_ms=TIMEOUT_MS, serial=True)
    port = RtuControllerPort(plan, connection.line, RtuRequestDecoder(), 0, beats=connection.beats)
    port.opened(connection.end, START_NS)
    return port


async def test_w5_of_several_requests_in_one_read_of_a_wire_only_the_last_is_waited_for() -> None:
    connection = Connection()
    port = serial_port(connection)
    other = bytes.fromhex("06 2000 0001")
    port.received(encode_rtu(1, RUN_RELATIVE_PDU) + encode_rtu(1, RUN_RELATIVE_PDU), START_NS)
    assert connection.wires.sent == [RUN_RELATIVE_PDU]  # it was there twice
    connection.line.reply(1, RUN_RELATIVE_PDU, START_NS)
    assert connection.end.replies == encode_rtu(1, RUN_RELATIVE_PDU)
    connection.wires.is_serial = True
    port.received(encode_rtu(1, other) + encode_rtu(0, other) + encode_rtu(2, READ[7:]), START_NS)
    assert connection.wires.sent == [RUN_RELATIVE_PDU, other]  # the broadcast: nobody waits for it anyway
    assert connection.line.deadline_ns is not None  # the turnaround
    connection.line.tick(connection.line.deadline_ns)
    assert connection.wires.sent == [RUN_RELATIVE_PDU, other, READ[7:]]
    # The second one of the same second is counted, and told with the next.
    assert connection.withdrawn() == ["a request of cnc was not sent: its controller sent another request"]
    assert connection.line.counters.withdrawn == 2
    port.closed("", START_NS)


async def test_w5_a_stop_among_several_requests_in_one_read_goes_out() -> None:
    connection = Connection(staged_plan())
    del connection.wires.sent[:]
    port = serial_port(connection)
    read = bytes.fromhex("03 2000 0001")
    port.received(encode_rtu(1, STOP_PDU) + encode_rtu(1, read), START_NS)
    assert connection.wires.sent == [STOP_PDU]
    connection.line.reply(1, STOP_PDU, START_NS)
    assert connection.wires.sent == [STOP_PDU, read]
    port.closed("", START_NS)


@pytest.mark.parametrize(("late_ms", "sent"), [(40, 1), (TIMEOUT_MS + 100, 0)])
async def test_w5_what_a_silence_ends_after_a_standstill_is_not_sent(late_ms: float, sent: int) -> None:
    connection = Connection()
    port = serial_port(connection)
    vendor = bytes.fromhex("65 10 20 30 40")
    connection.beats.beat(START_NS)  # the next one is due 20 ms later
    port.received(encode_rtu(9, vendor), START_NS)
    assert connection.wires.sent == []
    port._silent(START_NS + int(late_ms * MS))
    assert connection.wires.sent == [vendor] * sent
    assert len(connection.withdrawn()) == 1 - sent
    port.closed("", START_NS)


# === what holds no position goes through byte for byte ===================================================

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


# === RTU frames over TCP: of a device server that connects, or a program =================================

if TYPE_CHECKING:
    from gateway.exchange.plan import LineTiming
    from gateway.relay.gateway import Relay

RTU = TcpEndpoint("127.0.0.1", 0, rtu=True)
WRITE_50000 = bytes.fromhex("10 0064 0002 04 0000 C350")
WRITE_50050 = bytes.fromhex("10 0064 0002 04 0000 C382")  # +0.05 mm at 50 mm, 1000 counts/mm
WRITTEN = bytes.fromhex("10 0064 0002")
READ_ACTUAL = bytes.fromhex("03 006E 0002")


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
    controller.write(encode_rtu(1, READ_ACTUAL))
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
    controller.write(encode_rtu(9, READ_ACTUAL))
    await eventually(lambda: line_status(relay)["timeouts"] == 1)
    controller.write(encode_rtu(1, READ_ACTUAL))
    await controller.until(lambda end: len(end.data) >= 9)
    assert controller.data[:2] == bytes.fromhex("01 03")


async def test_what_is_no_frame_is_counted(bench: Bench) -> None:
    controller, _, relay = await connected(bench)
    controller.write(bytes.fromhex("01 03 00 6E 00 02 FF FF"))
    await eventually(lambda: first_controller(relay)["malformed"] == 1)
    assert first_controller(relay)["dropped_bytes"] == 8
