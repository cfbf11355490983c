"""Requests in pieces and with lengths that cannot be: no byte of their data becomes a request (W5)."""

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
from tests.exchange.staged_bench import RUN_PDU, RUN_RELATIVE_PDU, STOP_PDU, staged_plan
from tests.support.relay import Bench

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
