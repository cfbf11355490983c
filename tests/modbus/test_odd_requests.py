"""Odd frames of a controller: of another length than their function code says, from silence to silence.

Check sums are worked out from the polynomial (0xA001 reflected, start 0xFFFF) and written out here.
"""

from itertools import pairwise

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from gateway.modbus.crc import append_crc, is_intact
from gateway.modbus.lengths import REQUESTS, request_length
from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from tests.modbus.frames import frame_of
from tests.modbus.test_rtu_properties import Frame, requests, units

MS = 1_000_000
ODD_UNITS = frozenset({5, 7})
START = bytes.fromhex("05 03 01 01 30 B8")
"""Function 3 with two bytes, where a read has four: it starts a spindle on some inverters."""
SPEED = bytes.fromhex("05 05 02 13 88 44 5A")
"""Function 5 with three bytes: 5000 of something."""
LONG = bytes.fromhex("05 03 01 01 00 00 00 09 07 23 36")
"""Function 3 with seven bytes: the first eight bytes of it have a bad check sum."""
STOP = bytes.fromhex("01 06 60 02 00 40 37 FA")
WRAPPED = append_crc(b"\x05\x03" + STOP)
"""An odd frame in which the stop of another unit stands whole."""
LONGEST = append_crc(bytes((5, 0x41)) + bytes(range(252)))
assert len(LONGEST) == 256


def make(odd_units: frozenset[int] = ODD_UNITS) -> RtuRequestDecoder:
    return RtuRequestDecoder(2 * MS, 30 * MS, odd_units)


def read(*pieces: bytes, pause_ns: int = 0, odd_units: frozenset[int] = ODD_UNITS) -> list[Frame]:
    """Return what comes of bytes with pauses between, and of the silence behind them."""
    decoder, now_ns, frames = make(odd_units), 0, list[Frame]()
    for piece in pieces:
        frames += decoder.feed(piece, now_ns)
        if pause_ns >= 2 * MS:
            frames += decoder.on_silence(now_ns + 2 * MS)
        now_ns += pause_ns
    now_ns -= pause_ns
    for silent_ns in (2 * MS, 30 * MS):
        frames += decoder.on_silence(now_ns + silent_ns)
    assert decoder.deadline_ns is None
    return frames


def test_the_frames_of_this_file_have_good_check_sums() -> None:
    for wire in (START, SPEED, LONG, STOP, WRAPPED, LONGEST):
        assert is_intact(wire)
    assert [request_length(wire) for wire in (START, SPEED, LONG, WRAPPED)] == [8, 8, 8, 8]


@pytest.mark.parametrize("wire", [START, SPEED, LONG, WRAPPED, LONGEST], ids=lambda wire: wire[:4].hex())
def test_an_odd_frame_comes_out_whole_in_one_piece_and_byte_by_byte(wire: bytes) -> None:
    assert read(wire) == [frame_of(wire)]
    assert read(*(wire[at : at + 1] for at in range(len(wire)))) == [frame_of(wire)]


@pytest.mark.parametrize("wire", [START, SPEED, LONG, WRAPPED], ids=lambda wire: wire[:4].hex())
def test_it_waits_for_the_rest_that_an_adapter_may_hold_back(wire: bytes) -> None:
    decoder = make()
    assert decoder.feed(wire, 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert decoder.on_silence(30 * MS) == [frame_of(wire)]
    assert decoder.counters.dropped_bytes == 0


def test_where_the_last_byte_is_0_a_pause_before_it_cuts_nothing_off() -> None:
    wires = [
        append_crc(bytes((5, function, 2, n >> 8, n & 0xFF))) for function in (3, 5) for n in range(2000)
    ]
    ends = [wire for wire in wires if wire[-1] == 0]
    assert len(ends) >= 10
    for wire in ends:
        assert is_intact(wire[:-1])
        assert read(wire[:-1], wire[-1:], pause_ns=16 * MS) == [frame_of(wire)]


def test_a_function_code_that_says_nothing_of_its_length_ends_with_the_silence_as_of_any_unit() -> None:
    vendor = append_crc(bytes.fromhex("05 65 10 20"))
    for odd_units in (ODD_UNITS, frozenset[int]()):
        decoder = make(odd_units)
        assert decoder.feed(vendor, 0) == []
        assert decoder.on_silence(2 * MS) == [frame_of(vendor)]


@pytest.mark.parametrize("cut", range(1, len(LONG)))
def test_a_pause_of_an_adapter_inside_an_odd_frame_does_not_break_it(cut: int) -> None:
    assert read(LONG[:cut], LONG[cut:], pause_ns=16 * MS) == [frame_of(LONG)]


@pytest.mark.parametrize("cut", range(1, len(WRAPPED)))
def test_nothing_is_looked_for_inside_an_odd_frame_wherever_it_pauses(cut: int) -> None:
    assert read(WRAPPED[:cut], WRAPPED[cut:], pause_ns=16 * MS) == [frame_of(WRAPPED)]


def test_of_a_unit_that_is_not_named_the_stop_inside_is_what_is_found() -> None:
    assert read(WRAPPED, odd_units=frozenset({6})) == [frame_of(STOP)]


@pytest.mark.parametrize("odd", [START, SPEED, LONG, LONGEST], ids=lambda wire: wire[:4].hex())
@pytest.mark.parametrize("pause_ns", [0, 5 * MS])
def test_a_stop_behind_an_odd_frame_is_delivered(odd: bytes, pause_ns: int) -> None:
    assert read(odd, STOP, pause_ns=pause_ns) == [frame_of(odd), frame_of(STOP)]
    assert read(odd + STOP) == [frame_of(odd), frame_of(STOP)]
    glued = odd + STOP
    assert read(*(glued[at : at + 1] for at in range(len(glued)))) == [frame_of(odd), frame_of(STOP)]


@pytest.mark.parametrize("cut", range(1, len(LONG + STOP)))
def test_a_stop_glued_behind_an_odd_frame_survives_a_pause_anywhere(cut: int) -> None:
    glued = LONG + STOP
    assert read(glued[:cut], glued[cut:], pause_ns=16 * MS) == [frame_of(LONG), frame_of(STOP)]


def test_a_stop_behind_an_odd_frame_waits_for_the_silence_and_no_longer() -> None:
    decoder = make()
    assert decoder.feed(START + STOP, 0) == []
    assert decoder.on_silence(2 * MS) == [frame_of(START), frame_of(STOP)]


def test_a_stop_after_a_silence_is_taken_with_its_last_byte() -> None:
    decoder = make()
    assert decoder.feed(START, 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert decoder.feed(STOP[:-1], 5 * MS) == []
    assert decoder.feed(STOP[-1:], 6 * MS) == [frame_of(START), frame_of(STOP)]
    assert decoder.counters.dropped_bytes == 0


@pytest.mark.parametrize("behind", [b"", STOP, LONG, STOP + LONG], ids=len)
def test_a_stop_after_half_an_odd_frame_waits_for_the_silence(behind: bytes) -> None:
    decoder = make()
    assert decoder.feed(LONG[:9], 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert decoder.feed(STOP + behind, 5 * MS) == []
    assert decoder.on_silence(7 * MS) == [frame_of(STOP)] * (1 + behind.count(STOP))
    assert decoder.on_silence(35 * MS) == [frame_of(LONG)] * behind.count(LONG)
    assert decoder.counters.dropped_bytes == 9


def test_a_stop_in_front_is_taken_at_once() -> None:
    decoder = make()
    assert decoder.feed(STOP + LONG, 0) == [frame_of(STOP)]
    assert decoder.on_silence(2 * MS) == []
    assert decoder.on_silence(30 * MS) == [frame_of(LONG)]


def test_where_nobody_looked_at_the_silence_what_stood_before_it_is_still_told_apart() -> None:
    decoder = make()
    assert decoder.feed(LONG + STOP, 0) == []
    other = append_crc(bytes.fromhex("01 03 02 00 00 02"))
    assert decoder.feed(other, 50 * MS) == [frame_of(LONG), frame_of(STOP), frame_of(other)]


def test_a_stop_behind_a_damaged_odd_frame_is_delivered_when_it_is_given_up() -> None:
    damaged = LONG[:4] + b"\x01" + LONG[5:]
    decoder = make()
    assert decoder.feed(damaged + STOP, 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert decoder.on_silence(30 * MS) == [frame_of(STOP)]
    assert (decoder.counters.crc_errors, decoder.counters.dropped_bytes) == (1, len(damaged))


@pytest.mark.parametrize("between", [STOP, STOP + STOP])
def test_a_stop_behind_a_damaged_odd_frame_is_not_lost_when_its_controller_goes_on(between: bytes) -> None:
    damaged = LONG[:4] + b"\x01" + LONG[5:]
    following = append_crc(bytes.fromhex("01 03 02 00 00 02"))
    stops = [frame_of(STOP)] * (len(between) // len(STOP))
    for last in (following, LONG, append_crc(bytes.fromhex("09 65 10 20"))):
        decoder = make()
        assert decoder.feed(damaged + between, 0) == []
        assert decoder.on_silence(2 * MS) == []
        assert decoder.feed(last, 10 * MS) == []
        frames = decoder.on_silence(12 * MS)
        assert frames[: len(stops)] == stops
        assert frames + decoder.on_silence(40 * MS) == [*stops, frame_of(last)]


@pytest.mark.parametrize("odd", [START, SPEED, LONG], ids=lambda wire: wire[:4].hex())
@pytest.mark.parametrize("damage", ["ff", "01 03 10", "01 03 10 03 00 01 70 00"])
def test_a_stop_between_an_odd_frame_and_damage_is_delivered(odd: bytes, damage: str) -> None:
    glued = odd + STOP + bytes.fromhex(damage)
    assert read(glued) == [frame_of(odd), frame_of(STOP)]
    assert read(odd + STOP, bytes.fromhex(damage), pause_ns=MS) == [frame_of(odd), frame_of(STOP)]
    decoder = make()
    assert decoder.feed(glued, 0) == []
    assert decoder.on_silence(2 * MS) == []  # what is damage so far may only not be whole yet
    assert decoder.on_silence(30 * MS) == [frame_of(odd), frame_of(STOP)]
    following = append_crc(bytes.fromhex("01 03 02 00 00 02"))
    for last in (following, LONG):
        assert read(glued, last, pause_ns=5 * MS) == [frame_of(odd), frame_of(STOP), frame_of(last)]


def test_w3_a_damaged_odd_frame_is_dropped() -> None:
    assert read(LONG[:4] + b"\x01" + LONG[5:]) == []


@pytest.mark.parametrize("flipped", [0, 1, 10, 11])
def test_w3_of_a_damaged_odd_frame_nothing_inside_is_run(flipped: int) -> None:
    damaged = bytearray(WRAPPED)
    damaged[flipped] ^= 5 if flipped else 2  # 05 becomes 07, which takes odd frames too
    assert read(bytes(damaged)) == []
    for cut in (1, 4, 11):
        assert read(bytes(damaged[:cut]), bytes(damaged[cut:]), pause_ns=16 * MS) == []
    assert read(bytes(damaged) + STOP) == [frame_of(STOP)]


def test_noise_behind_an_odd_frame_makes_it_none() -> None:
    assert read(LONG + b"\xff") == []
    assert read(LONG + STOP[:-1]) == []


def test_noise_directly_before_an_odd_frame_makes_it_none_and_a_silence_between_them_does_not() -> None:
    assert read(b"\xff", LONG) == []
    assert read(b"\xff\x03", LONG, pause_ns=5 * MS) == [frame_of(LONG)]
    assert read(b"\xff\x03\x00\x00\x00\x00\x00\x00\x00", WRAPPED, pause_ns=5 * MS) == [frame_of(WRAPPED)]


def test_zeros_behind_a_check_sum_may_belong_to_the_frame_and_go_with_it() -> None:
    # The check sum stays good: 1 of 256 frames of three bytes is another one and a zero.
    assert read(LONG + b"\x00") == [(5, LONG[1:-1])]


def test_a_zero_behind_a_frame_as_a_driver_makes_it_is_no_odd_frame() -> None:
    assert read(STOP + b"\x00\x00") == [frame_of(STOP)]


def test_a_good_beginning_is_no_frame_where_the_whole_is_good() -> None:
    # Four bytes that are good, and five more that make the whole good again.
    whole = append_crc(append_crc(b"\x05\x41") + b"\x01\x02\x03")
    assert is_intact(whole[:4])
    assert read(whole) == [frame_of(whole)]
    assert read(whole[:4], whole[4:], pause_ns=MS) == [frame_of(whole)]


def test_where_the_expected_length_gives_a_good_check_sum_it_holds() -> None:
    ordinary = append_crc(bytes.fromhex("05 06 00 01 00 02"))
    assert make().feed(ordinary, 0) == [frame_of(ordinary)]
    assert read(append_crc(ordinary + b"\x01")) == [frame_of(ordinary)]


def test_two_odd_frames_are_told_apart_with_and_without_a_silence() -> None:
    for first, second in ((START, SPEED), (SPEED, LONG), (LONG, START), (START, START)):
        assert read(first + second) == [frame_of(first), frame_of(second)]
        assert read(first, second, pause_ns=5 * MS) == [frame_of(first), frame_of(second)]


def test_behind_two_short_ones_the_first_waits_for_the_second() -> None:
    decoder = make()
    assert decoder.feed(START + SPEED, 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert decoder.on_silence(30 * MS) == [frame_of(START), frame_of(SPEED)]


def test_an_axis_and_a_broadcast_have_no_odd_frames() -> None:
    for unit_id in (0, 1, 6):
        long = append_crc(bytes((unit_id, 3)) + STOP)
        assert read(long) == [frame_of(STOP)]


def test_function_code_0_begins_no_odd_frame() -> None:
    assert read(append_crc(bytes.fromhex("05 00 01 02 03"))) == []


def test_a_burst_without_an_end_is_searched_as_any_other() -> None:
    decoder = make()
    assert decoder.feed(bytes((5, 0x41)) + bytes(range(1, 255)) * 2, 0) == []
    assert decoder.feed(bytes.fromhex("41 41 41"), 0) == []
    assert decoder.counters.oversized == 1
    assert decoder.feed(STOP, 0) == [frame_of(STOP)]


def pieces_of(stream: bytes, data: st.DataObject) -> list[bytes]:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    return [piece for a, b in pairwise([0, *cuts, len(stream)]) if (piece := stream[a:b])]


bodies = st.binary(min_size=0, max_size=40)
odd_frames = st.builds(
    lambda unit_id, function, body: append_crc(bytes((unit_id, function)) + body),
    st.sampled_from(sorted(ODD_UNITS)),
    st.integers(1, 255),
    bodies,
)


odd_frames_of_known_codes = st.builds(
    lambda unit_id, function, body: append_crc(bytes((unit_id, function)) + body),
    st.sampled_from(sorted(ODD_UNITS)),
    st.sampled_from(sorted(set(map(int, REQUESTS)) - {43})),
    bodies,
)


def is_odd(wire: bytes) -> bool:
    length = request_length(wire)
    return not (0 < length <= len(wire) and is_intact(wire[:length]))


some = st.one_of(units, st.sampled_from(sorted(ODD_UNITS)))


@given(frames=st.lists(requests, max_size=5), data=st.data())
def test_good_requests_come_out_as_without_odd_frames(frames: list[Frame], data: st.DataObject) -> None:
    moved = [(data.draw(some), pdu) for _, pdu in frames]
    stream = b"".join(encode_rtu(*frame) for frame in moved)
    plain, odd = make(frozenset()), make()
    now_ns = 0
    for piece in pieces_of(stream, data):
        assert plain.feed(piece, now_ns) == odd.feed(piece, now_ns)
        now_ns += data.draw(st.sampled_from([0, MS, 3 * MS, 16 * MS]))
        assert plain.on_silence(now_ns) == odd.on_silence(now_ns)
    assert plain.on_silence(now_ns + 40 * MS) == odd.on_silence(now_ns + 40 * MS)
    assert plain.counters == odd.counters


@given(
    wire=odd_frames,
    front=st.lists(requests, max_size=2),
    behind=st.lists(requests, max_size=2),
    pauses=st.sampled_from([0, MS]),
    data=st.data(),
)
def test_what_stands_before_and_behind_an_odd_frame_is_always_delivered(
    wire: bytes, front: list[Frame], behind: list[Frame], pauses: int, data: st.DataObject
) -> None:
    behind_wire = b"".join(encode_rtu(*frame) for frame in behind)
    assume(is_odd(wire + behind_wire))
    stream = b"".join(encode_rtu(*frame) for frame in front) + wire + behind_wire
    decoder, now_ns, frames = make(), 0, list[Frame]()
    for piece in pieces_of(stream, data):
        frames += decoder.feed(piece, now_ns)
        now_ns += pauses
    frames += decoder.on_silence(now_ns + 2 * MS) + decoder.on_silence(now_ns + 30 * MS)
    assert frames == [*front, frame_of(wire), *behind]


@given(wire=odd_frames_of_known_codes, data=st.data())
def test_an_odd_frame_survives_pauses_of_an_adapter(wire: bytes, data: st.DataObject) -> None:
    assume(is_odd(wire))
    assert read(*pieces_of(wire, data), pause_ns=16 * MS) == [frame_of(wire)]


@given(
    begun=odd_frames.map(lambda wire: wire[:-1]),
    wire=odd_frames,
    pause=st.sampled_from([0, 3 * MS, 16 * MS]),
    data=st.data(),
)
def test_a_stop_behind_whatever_begins_like_an_odd_frame_is_delivered(
    begun: bytes, wire: bytes, pause: int, data: st.DataObject
) -> None:
    waiting = data.draw(st.sampled_from([begun, wire, wire + begun, begun + wire]))
    assume(is_odd(waiting + STOP))
    decoder = make()
    frames = decoder.feed(waiting, 0)
    frames += decoder.on_silence(2 * MS) if pause else []
    frames += decoder.feed(STOP, pause)
    frames += decoder.on_silence(pause + 2 * MS) + decoder.on_silence(pause + 30 * MS)
    assert frames[-1] == frame_of(STOP)


@given(pieces=st.lists(st.tuples(st.binary(max_size=300), st.integers(0, 40 * MS)), max_size=8))
@example(pieces=[(b"\x05" * 300, 0), (b"\x05" * 300, 0)])
@example(pieces=[(START + bytes(300), 0), (b"\x05", MS)])
@example(pieces=[(b"\x05", 0), (b"\x00" * 5, 40 * MS)])
def test_arbitrary_bytes_raise_nothing_and_are_all_accounted_for(pieces: list[tuple[bytes, int]]) -> None:
    decoder, now_ns, frames = make(), 0, list[Frame]()
    for piece, pause_ns in pieces:
        begun = bytes((5, 3)) + piece if len(piece) % 2 else piece
        frames += decoder.feed(begun, now_ns)
        now_ns += pause_ns
        frames += decoder.on_silence(now_ns)
    frames += decoder.on_silence(now_ns + 40 * MS)
    assert decoder.deadline_ns is None
    taken = sum(3 + len(pdu) for _, pdu in frames)
    counters = decoder.counters
    total = sum(len(piece) + 2 * (len(piece) % 2) for piece, _ in pieces)
    assert taken + counters.dropped_bytes + counters.glitch_bytes == total
