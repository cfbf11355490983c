"""Requests from a serial controller: damage, pauses, unknown function codes, noise."""

import pytest

from gateway.modbus.crc import append_crc
from gateway.modbus.errors import FrameError
from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu, silence_ns
from tests.modbus.frames import frame_of

MS = 1_000_000
READ = bytes.fromhex("01 03 02 00 00 02 C5 B3")
WRITE = bytes.fromhex("01 10 6F 00 00 02 04 55 55 00 08 1A 47")
VENDOR = append_crc(bytes.fromhex("09 65 10 20 30 40"))
BROADCAST = append_crc(bytes.fromhex("00 06 60 02 00 10"))


def make() -> RtuRequestDecoder:
    return RtuRequestDecoder(silence_ns=2 * MS, give_up_ns=30 * MS)


def test_a_truncated_request_does_not_cost_the_next_one_that_comes_later() -> None:
    decoder = make()
    assert decoder.feed(WRITE[:6], 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert decoder.feed(READ, 5 * MS) == [frame_of(READ)]
    assert (decoder.counters.crc_errors, decoder.counters.dropped_bytes) == (1, 6)


def test_after_a_silence_a_request_counts_from_there_even_byte_by_byte() -> None:
    decoder = make()
    decoder.feed(bytes.fromhex("01 10 6F 00 00 7B F6"), 0)  # announces 255 bytes
    decoder.on_silence(2 * MS)
    for at, byte in enumerate(READ[:-1]):
        assert decoder.feed(bytes((byte,)), 5 * MS + at) == []
    assert decoder.feed(READ[-1:], 6 * MS) == [frame_of(READ)]
    assert decoder.deadline_ns is None


def test_a_corrupt_request_glued_to_a_good_one_costs_one() -> None:
    decoder = make()
    corrupt = WRITE[:9] + b"\x01" + WRITE[10:]
    assert decoder.feed(corrupt + READ + WRITE, 0) == [frame_of(READ), frame_of(WRITE)]
    assert (decoder.counters.crc_errors, decoder.counters.dropped_bytes) == (1, len(corrupt))


def test_a_corrupt_byte_count_is_survived_at_the_next_silence() -> None:
    decoder = make()
    corrupt = WRITE[:6] + b"\x84" + WRITE[7:]
    assert decoder.feed(corrupt + READ, 0) == []
    assert decoder.on_silence(2 * MS) == [frame_of(READ)]
    assert decoder.counters.crc_errors == 1


def test_usb_pauses_inside_a_request_do_not_break_it() -> None:
    decoder = make()
    assert decoder.feed(WRITE[:5], 0) == []
    assert decoder.deadline_ns == 2 * MS
    assert decoder.on_silence(2 * MS) == []
    assert decoder.deadline_ns == 30 * MS
    assert decoder.feed(WRITE[5:], 16 * MS) == [frame_of(WRITE)]
    assert decoder.counters.dropped_bytes == 0


def test_bytes_are_given_up_in_the_end() -> None:
    decoder = make()
    decoder.feed(WRITE[:5], 0)
    decoder.on_silence(2 * MS)
    assert decoder.on_silence(30 * MS) == []
    assert decoder.deadline_ns is None
    assert (decoder.counters.crc_errors, decoder.counters.dropped_bytes) == (1, 5)
    assert decoder.feed(WRITE[5:], 31 * MS) == []


def test_a_timer_that_fires_early_changes_nothing() -> None:
    decoder = make()
    decoder.feed(VENDOR, 0)
    assert decoder.on_silence(2 * MS - 1) == []
    assert decoder.deadline_ns == 2 * MS
    assert decoder.on_silence(2 * MS) == [frame_of(VENDOR)]


def test_every_byte_puts_the_end_of_an_unknown_function_off() -> None:
    # mbusd 0.5.3 set its timer once, and cut long frames of unknown length
    decoder = make()
    long = append_crc(bytes((1, 0x41)) + bytes(range(200)))
    for at in range(len(long)):
        now_ns = at * MS
        assert decoder.feed(long[at : at + 1], now_ns) == []
        assert decoder.deadline_ns == now_ns + 2 * MS
        assert decoder.on_silence(now_ns + MS) == []
    assert decoder.on_silence(len(long) * MS + 2 * MS) == [frame_of(long)]


def test_an_unknown_function_survives_usb_pauses() -> None:
    decoder = make()
    decoder.feed(VENDOR[:5], 0)
    assert decoder.on_silence(2 * MS) == []
    decoder.feed(VENDOR[5:], 16 * MS)
    assert decoder.on_silence(18 * MS) == [frame_of(VENDOR)]


def test_an_unknown_function_behind_stale_bytes_is_found() -> None:
    decoder = make()
    decoder.feed(READ[:-1] + b"\x00", 0)
    decoder.on_silence(2 * MS)
    decoder.feed(VENDOR, 10 * MS)
    assert decoder.on_silence(12 * MS) == [frame_of(VENDOR)]
    assert decoder.counters.crc_errors == 1


def test_w3_an_unknown_function_with_a_bad_check_sum_is_dropped() -> None:
    decoder = make()
    decoder.feed(VENDOR[:-1] + b"\x00", 0)
    assert decoder.on_silence(2 * MS) == []
    assert decoder.on_silence(30 * MS) == []
    assert decoder.counters.crc_errors == 1


@pytest.mark.parametrize(
    "body",
    [
        "01 08 00 00 A5 37 11 22 33",  # query data of odd length
        "01 06 62 00 00 01 00 02",  # longer than a write of one register is
        "01 17 00 03 00 06",  # shorter than announced or usual
        "01 E5 01 02 03",  # no master asks so, but a vendor may
    ],
)
def test_a_request_of_odd_length_passes_as_it_is(body: str) -> None:
    decoder = make()
    wire = append_crc(bytes.fromhex(body))
    frames = decoder.feed(wire, 0) + decoder.on_silence(2 * MS) + decoder.on_silence(30 * MS)
    assert frames == [frame_of(wire)]
    assert decoder.counters.dropped_bytes == 0


@pytest.mark.parametrize(
    "body",
    [
        "01 10 00 00 00 02 06 00 01 00 02 00 03",
        "01 0F 00 13 00 0A 03 CD 01 00",
        "01 17 00 00 00 01 00 00 00 02 02 00 01",
    ],
)
def test_a_byte_count_that_contradicts_the_quantity_is_passed_on(body: str) -> None:
    wire = append_crc(bytes.fromhex(body))
    assert make().feed(wire, 0) == [frame_of(wire)]


def test_the_longest_frame_passes() -> None:
    known = append_crc(bytes.fromhex("01 10 00 00 00 7B F7") + bytes(247))
    unknown = append_crc(bytes((1, 0x41)) + bytes(252))
    decoder = make()
    assert decoder.feed(known, 0) == [frame_of(known)]
    assert len(unknown) == 256
    decoder.feed(unknown, 10 * MS)
    assert decoder.on_silence(12 * MS) == [frame_of(unknown)]


def test_a_frame_that_is_too_long_is_dropped_and_counted() -> None:
    decoder = make()
    decoder.feed(append_crc(bytes((1, 0x41)) + bytes(253)), 0)
    assert decoder.on_silence(2 * MS) == []
    assert decoder.on_silence(30 * MS) == []
    assert decoder.counters.oversized == 1
    assert decoder.counters.dropped_bytes == 257
    assert decoder.feed(READ, 40 * MS) == [frame_of(READ)]


def test_an_endless_stream_of_noise_is_bounded() -> None:
    decoder = make()
    decoder.feed(b"\x55" * 100_000, 0)
    assert decoder.counters.dropped_bytes >= 100_000 - 256
    assert decoder.feed(READ, 10 * MS) == [frame_of(READ)]


def test_a_switching_driver_does_not_delay_the_next_request() -> None:
    # unit 9: "00 09" looks like an unknown function, which would wait for silence
    request = append_crc(bytes.fromhex("09 06 31 00 00 0F"))
    decoder = make()
    assert decoder.feed(request + b"\x00", 0) == [frame_of(request)]
    assert decoder.on_silence(2 * MS) == []
    assert decoder.deadline_ns is None
    for byte in request[:-1]:
        assert decoder.feed(bytes((byte,)), 4 * MS) == []
    assert decoder.feed(request[-1:], 4 * MS) == [frame_of(request)]
    assert (decoder.counters.glitch_bytes, decoder.counters.crc_errors) == (1, 0)


def test_a_broadcast_that_pauses_after_its_first_byte_is_not_taken_for_a_glitch() -> None:
    decoder = make()
    assert decoder.feed(BROADCAST[:1], 100 * MS) == []
    assert decoder.on_silence(102 * MS) == []
    assert decoder.feed(BROADCAST[1:], 116 * MS) == [frame_of(BROADCAST)]


def test_a_broadcast_glued_to_a_request_is_found() -> None:
    decoder = make()
    assert decoder.feed(READ, 0) == [frame_of(READ)]
    assert [frame for byte in BROADCAST for frame in decoder.feed(bytes((byte,)), 1)] == [frame_of(BROADCAST)]


def test_resetting_forgets_what_waits() -> None:
    decoder = make()
    decoder.feed(WRITE[:6], 0)
    decoder.reset()
    assert decoder.deadline_ns is None
    assert decoder.feed(WRITE[6:], 1) == []


def test_no_bytes_change_nothing() -> None:
    decoder = make()
    assert decoder.feed(b"", 0) == []
    assert decoder.deadline_ns is None


@pytest.mark.parametrize(
    ("baudrate", "bits", "expected_ns"),
    [
        # 3.5 x 11 bits / 9600 Bd = 4.0104 ms; 3.5 x 10 / 19200 = 1.8229 ms
        (9600, 11, 4_010_417),
        (19200, 10, 1_822_917),
        (38400, 11, 1_750_000),
        (230400, 10, 1_750_000),
    ],
)
def test_silence_is_3_5_characters_up_to_19200_baud(baudrate: int, bits: int, expected_ns: int) -> None:
    assert silence_ns(baudrate, bits) == expected_ns


def test_giving_up_cannot_come_before_the_silence() -> None:
    with pytest.raises(FrameError, match="give_up_ns"):
        RtuRequestDecoder(silence_ns=2 * MS, give_up_ns=MS)


@pytest.mark.parametrize(("unit_id", "pdu"), [(256, b"\x03"), (-1, b"\x03"), (1, b""), (1, bytes(254))])
def test_what_cannot_be_framed_is_refused(unit_id: int, pdu: bytes) -> None:
    with pytest.raises(FrameError):
        encode_rtu(unit_id, pdu)
