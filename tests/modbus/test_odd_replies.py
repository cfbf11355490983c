"""Odd replies of a device: of another length than their function code says."""

import pytest

from gateway.modbus.crc import append_crc
from gateway.modbus.rtu import RtuReplyDecoder

MS = 1_000_000
START = bytes.fromhex("05 03 01 01 30 B8")
SPEED = bytes.fromhex("05 05 02 13 88 44 5A")
AXIS = append_crc(bytes.fromhex("05 03 04 00 B1 1F 40"))
"""What a read of two registers is answered, of the device itself."""


def make(request: bytes, unit_id: int = 5, odd_units: frozenset[int] = frozenset({5})) -> RtuReplyDecoder:
    decoder = RtuReplyDecoder(2 * MS, 30 * MS, odd_units=odd_units)
    decoder.expect(unit_id, request)
    return decoder


def replies(decoder: RtuReplyDecoder, *pieces: bytes, pause_ns: int = 0) -> list[tuple[int, bytes]]:
    taken, now_ns = [], 0
    for piece in pieces:
        taken += decoder.feed(piece, now_ns)
        taken += decoder.on_silence(now_ns + min(pause_ns, 2 * MS))
        now_ns += pause_ns
    return taken + decoder.on_silence(now_ns + 2 * MS) + decoder.on_silence(now_ns + 30 * MS)


@pytest.mark.parametrize(
    "wire",
    [
        START,  # as long as a reply of function 3 is
        SPEED,  # shorter than the reply of function 5
        append_crc(bytes.fromhex("05 05 02 13 88 00 07 09")),  # longer
        append_crc(bytes.fromhex("05 85")),  # an exception without a code
        append_crc(bytes.fromhex("05 85 01 02")),  # one with two bytes
    ],
    ids=lambda wire: wire.hex(),
)
def test_an_odd_reply_comes_out_whole_however_it_comes(wire: bytes) -> None:
    request = bytes((wire[1] & 0x7F,)) + bytes.fromhex("02 13 88")
    whole = [(5, wire[1:-2])]
    assert replies(make(request), wire) == whole
    assert replies(make(request), *(wire[at : at + 1] for at in range(len(wire)))) == whole
    for cut in range(1, len(wire)):
        assert replies(make(request), wire[:cut], wire[cut:], pause_ns=16 * MS) == whole


def test_one_that_is_short_waits_for_what_an_adapter_may_hold_back_unless_it_repeats_the_request() -> None:
    for request, ends_ms in (("05 02 13 88", 2), ("05 02 13 89", 30)):
        decoder = make(bytes.fromhex(request))
        assert decoder.feed(SPEED, 0) == []
        assert decoder.on_silence(ends_ms * MS - 1) == []
        assert decoder.on_silence(2 * MS) == [(5, SPEED[1:-2])] * (ends_ms == 2)
        assert decoder.on_silence(30 * MS) == [(5, SPEED[1:-2])] * (ends_ms == 30)


@pytest.mark.parametrize(
    "body",
    [
        "06 05 02 13 88 00 07 09",  # of another unit
        "05 06 02 13 88 00 07 09",  # of another function
        "05 86 01 02",  # an exception to another function
        "05 81 01 02",  # what some drives refuse reads with has the length of an exception
    ],
)
def test_only_the_unit_that_was_asked_answers_and_with_the_function_byte_that_fits(body: str) -> None:
    for request in ("05 02 13 88", "03 02 13 88"):
        decoder = make(bytes.fromhex(request))
        assert replies(decoder, append_crc(bytes.fromhex(body))) == []
        assert decoder.is_expecting


def test_when_nothing_is_expected_any_more_it_answers_nothing() -> None:
    decoder = make(bytes.fromhex("05 02 13 88"))
    decoder.cancel()
    assert replies(decoder, SPEED) == []
    assert (decoder.counters.stray_frames, decoder.late_unit_id) == (1, 5)


@pytest.mark.parametrize("count", [0x63, 2])
@pytest.mark.parametrize("cut", range(2, 14))
def test_nothing_is_looked_for_inside_it(cut: int, count: int) -> None:
    """Whether the length that it says has not come, or has a bad check sum."""
    inside = append_crc(b"\x05\x03\x02\x00\x01")  # what a read of one register would be answered
    wire = append_crc(bytes((5, 3, count)) + inside + b"\x07")
    assert replies(make(b"\x03\x01\x01"), wire) == [(5, wire[1:-2])]
    assert replies(make(b"\x03\x01\x01"), wire[:cut], wire[cut:], pause_ns=16 * MS) == [(5, wire[1:-2])]


def test_noise_in_front_of_an_ordinary_reply_costs_it_nothing() -> None:
    for noise in (b"\x00", b"\xff\x03", b"\x05\x00", START):
        decoder = make(bytes.fromhex("03 02 00 00 02"))
        assert replies(decoder, noise + AXIS) == [(5, AXIS[1:-2])]


def test_of_a_drive_with_an_axis_the_reply_inside_is_what_counts() -> None:
    decoder = make(bytes.fromhex("03 02 00 00 02"), odd_units=frozenset({6}))
    assert replies(decoder, b"\x05\x03\x07\x05\x03" + AXIS) == [(5, AXIS[1:-2])]


def test_w6_an_odd_frame_of_another_device_is_late_and_no_damage() -> None:
    decoder = make(bytes.fromhex("03 02 00 00 02"), unit_id=1)
    assert decoder.feed(SPEED, 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert (decoder.counters.foreign, decoder.late_unit_id, decoder.counters.damaged) == (1, 5, 0)
    reply = append_crc(bytes.fromhex("01 03 04 00 B1 1F 40"))
    assert decoder.feed(reply, 5 * MS) == [(1, reply[1:-2])]


def test_behind_an_odd_frame_of_another_device_the_reply_counts_all_the_same() -> None:
    decoder = make(bytes.fromhex("03 02 00 00 02"), unit_id=1)
    reply = append_crc(bytes.fromhex("01 03 04 00 B1 1F 40"))
    assert decoder.feed(SPEED + reply, 0) == [(1, reply[1:-2])]
