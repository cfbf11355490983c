"""Bytes, bits and silences, worked out by hand."""

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.budget.sequence import What, round_of
from gateway.budget.wire import PduSizes, Wire, read_frame, wire_of, write_frames
from gateway.drives.library import names
from gateway.drives.motion import Form
from gateway.exchange.added_frames import AddedFrame, Purpose, read_field
from gateway.exchange.axis.axis import Axis
from gateway.modbus.lengths import UNTIL_SILENCE, request_length
from gateway.modbus.rtu import encode_rtu
from gateway.simulator.wire import PacedWire
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.budget.budget_bench import known_axis, serial

SIZES = st.integers(min_value=1, max_value=253)


@pytest.mark.parametrize(
    ("parity", "stop_bits", "bits"), [("E", 1, 11), ("O", 1, 11), ("N", 2, 11), ("N", 1, 10), ("E", 2, 12)]
)
def test_bits_of_a_character(parity: str, stop_bits: int, bits: int) -> None:
    assert wire_of(SerialEndpoint("/d", 9600, parity, 8, stop_bits)).bits_per_byte == bits


# FC16 of two registers: 13 bytes out, 8 back. FC03 of two: 8 and 9. 11 bits for a byte.
@pytest.mark.parametrize(
    ("baudrate", "pdu_bytes", "span_ns"),
    [
        (9600, 10, 14_895_833),  # 13 × 11 / 9600 = 14.8958 ms
        (9600, 5, 9_166_667),  # 8 × 11 / 9600
        (9600, 6, 10_312_500),  # 9 × 11 / 9600
        (19200, 10, 7_447_917),
        (38400, 10, 3_723_958),
        (115200, 10, 1_241_319),
        (115200, 5, 763_889),
    ],
)
def test_a_frame_on_a_wire(baudrate: int, pdu_bytes: int, span_ns: int) -> None:
    assert wire_of(serial(baudrate)).frame_ns(pdu_bytes) == span_ns


def test_a_character_without_parity_is_a_bit_shorter() -> None:
    assert wire_of(serial(9600, "N")).frame_ns(10) == 13_541_667  # 13 × 10 / 9600


@pytest.mark.parametrize(
    ("baudrate", "parity", "silence_ns"),
    [
        (9600, "E", 4_010_417),  # 3.5 × 11 / 9600
        (9600, "N", 3_645_833),
        (19200, "E", 2_005_208),
        (38400, "E", 1_750_000),  # fixed above 19200
        (115200, "E", 1_750_000),
    ],
)
def test_the_silence_between_frames(baudrate: int, parity: str, silence_ns: int) -> None:
    assert wire_of(serial(baudrate, parity)).silence_ns == silence_ns


def test_tcp_has_no_wire_and_no_silence() -> None:
    wire = wire_of(TcpEndpoint("127.0.0.1", 502))
    assert (wire.frame_ns(10), wire.silence_ns, wire.tail_ns, wire.is_serial) == (0, 0, 0, False)
    assert wire.frame_bytes(10) == 17  # a header of 7 bytes, no check sum


def test_the_wire_behind_a_device_server_is_not_known() -> None:
    wire = wire_of(TcpEndpoint("127.0.0.1", 4001, rtu=True))
    assert (wire.is_hidden, wire.is_serial, wire.frame_ns(10)) == (True, False, 0)
    assert (wire.silence_ns, wire.tail_ns) == (0, 5_000_000)


@pytest.mark.parametrize(
    ("frame", "request_pdu", "reply_pdu"),
    [
        # Delta's manual: FC16 of two registers; SMC's: FC03 of two.
        (write_frames(Form.FC16, 2)[0], "10 01 12 00 02 04 0B B8 00 00", "10 01 12 00 02"),
        (read_frame(Form.FC03, 2), "03 90 00 00 02", "03 04 00 00 3A 98"),
        (read_frame(Form.FC04, 3), "04 00 31 00 03", "04 06 00 00 00 00 00 00"),
        (write_frames(Form.FC06, 1)[0], "06 31 00 00 3F", "06 31 00 00 3F"),
    ],
)
def test_frames_are_as_long_as_golden_ones(frame: PduSizes, request_pdu: str, reply_pdu: str) -> None:
    sizes = (len(bytes.fromhex(request_pdu)), len(bytes.fromhex(reply_pdu)))
    assert frame[:2] == sizes
    assert Wire().frame_bytes(sizes[0]) == len(encode_rtu(1, bytes.fromhex(request_pdu)))


def test_a_write_word_by_word_is_as_many_frames() -> None:
    assert write_frames(Form.FC06, 2) == (PduSizes(5, 5), PduSizes(5, 5))


def test_a_general_reference_ends_by_silence() -> None:
    # 2B 0D 01 00 00 60 7A 00 00 00 00 04 and four bytes of data
    assert write_frames(Form.MEI, 2) == (PduSizes(16, 12, ends_by_silence=True),)
    assert read_frame(Form.MEI, 2) == PduSizes(12, 16, ends_by_silence=True)


TARGET, TRIGGER, POSITION, STATUS = What.TARGET, What.TRIGGER, What.POSITION, What.STATUS


@pytest.mark.parametrize(
    ("profile", "steps"),
    [
        # RTU bytes of each exchange as the manuals have them.
        ("oriental-az", [(TARGET, 13, 8), (TRIGGER, 8, 8), (POSITION, 8, 9), (STATUS, 8, 7)]),
        ("delta-asda", [(TARGET, 13, 8), (TRIGGER, 8, 8), (POSITION, 8, 9), (STATUS, 8, 7)]),
        ("leadshine-el7", [(TARGET, 13, 8), (TRIGGER, 8, 8), (POSITION, 8, 9), (STATUS, 8, 7)]),
        # One frame of four registers at 0x00F5 that moves at once; FC04 of three registers.
        ("makerbase-servo42d", [(TARGET, 17, 8), (POSITION, 8, 11)]),
        # Written word by word.
        ("tl-r", [(TARGET, 8, 8), (TARGET, 8, 8), (TRIGGER, 8, 8), (POSITION, 8, 9), (STATUS, 8, 7)]),
        # The state is a discrete input.
        ("smc-lec", [(TARGET, 13, 8), (TRIGGER, 8, 8), (POSITION, 8, 9), (STATUS, 8, 6)]),
        # Registers 1 to 3: the byte that tells a distance is in the frame of the target.
        ("festo-cmmo-fhpp", [(TARGET, 15, 8), (TRIGGER, 8, 8), (POSITION, 8, 9), (STATUS, 8, 7)]),
        # The low word of the target starts the move.
        ("iai-robo-cylinder", [(TARGET, 13, 8), (POSITION, 8, 9), (STATUS, 8, 7)]),
    ],
)
def test_what_a_round_of_a_known_drive_holds(profile: str, steps: list[tuple[What, int, int]]) -> None:
    wire = Wire()
    found = [
        (step.what, wire.frame_bytes(step.frame.request_bytes), wire.frame_bytes(step.frame.reply_bytes))
        for step in round_of([known_axis(profile)])
    ]
    assert found == steps


@pytest.mark.parametrize("profile", names())
def test_frames_of_the_gateways_own_are_as_long_as_those_that_it_sends(profile: str) -> None:
    plan = known_axis(profile)
    exchange = Axis(plan)
    read = read_field(exchange, Purpose.ACTUAL, plan.actual[0])
    assert read_frame(plan.reads_with, plan.actual[0].words).request_bytes == len(read.pdu)
    words = 1 if plan.writes_with is Form.FC06 else plan.command[0].words
    write = AddedFrame(exchange, Purpose.REWRITE, 0x100, words, words=bytes(2 * words))
    frames = write_frames(plan.writes_with, plan.command[0].words)
    assert {frame.request_bytes for frame in frames} == {len(write.pdu)}
    assert len(frames) * words == plan.command[0].words


@pytest.mark.parametrize("profile", names())
def test_a_frame_of_a_round_ends_by_silence_where_the_decoder_cannot_tell_its_length(profile: str) -> None:
    plan = known_axis(profile)
    pdu = read_field(Axis(plan), Purpose.ACTUAL, plan.actual[0]).pdu
    ends_by_silence = request_length(encode_rtu(1, pdu)) == UNTIL_SILENCE
    assert read_frame(plan.reads_with, plan.actual[0].words).ends_by_silence is ends_by_silence


def test_the_relay_can_reckon_without_the_libraries_that_it_must_not_have() -> None:
    script = (
        "import sys, gateway.budget.as_data, gateway.budget.verdict;"
        "print([m for m in ('pydantic', 'rich', 'typer', 'asyncio', 'logging') if m in sys.modules])"
    )
    process = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert process.stdout == "[]\n"


@given(baudrate=st.sampled_from([1200, 9600, 19200, 57600, 115200]), parity=st.sampled_from("NE"), size=SIZES)
def test_a_frame_takes_as_long_as_on_the_simulated_wire(baudrate: int, parity: str, size: int) -> None:
    endpoint = serial(baudrate, parity)
    wire = PacedWire(baudrate, endpoint.bits_per_character)
    wire.send(bytes(size + 3), now_ns=0)
    while wire.deadline_ns is not None:
        last_ns = wire.deadline_ns
        wire.receive(last_ns)
    assert wire_of(endpoint).frame_ns(size) == pytest.approx(last_ns, abs=1)
