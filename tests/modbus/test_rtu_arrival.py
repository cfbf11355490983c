"""What is known of a frame while it arrives: byte by byte, whole, glued, damaged."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.crc import append_crc, residue_after
from gateway.modbus.rtu import RtuRequestDecoder
from gateway.modbus.rtu_arrival import Progress, ReplyArrival, RequestArrival

WRITE = bytes.fromhex("01 10 6F 00 00 02 04 55 55 00 08 1A 47")
READ = bytes.fromhex("01 03 02 00 00 02 C5 B3")
READ_REPLY = bytes.fromhex("01 03 04 00 B1 1F 40 A3 D4")
WRITE_REPLY = append_crc(WRITE[:6])

frames = st.one_of(
    st.binary(min_size=4, max_size=4).map(lambda b: append_crc(b"\x01\x03" + b)),
    st.binary(max_size=246).map(lambda b: append_crc(b"\x01\x10\x10\x00\x00\x02" + bytes((len(b),)) + b)),
    st.binary(min_size=2, max_size=260),
)


def followed(data: bytes, arrival: RequestArrival | None = None) -> str:
    """What is known after each byte, by the first letter of the word."""
    arrival = RequestArrival() if arrival is None else arrival
    progress = ""
    for at in range(len(data)):
        assert arrival.feed(data[at : at + 1]) == 1
        progress += arrival.progress.value[0]
    return progress


def reply_to(request: bytes) -> ReplyArrival:
    return ReplyArrival(request[0], request[1:-2])


def test_a_request_is_followed_byte_by_byte() -> None:
    # A write says with its seventh byte how long it is, a read with its second, and where with its sixth.
    assert followed(WRITE) == "bbbbbbhhhhhhg"
    assert followed(READ) == "bbbbbhhg"


def test_a_reply_is_followed_byte_by_byte() -> None:
    assert followed(READ_REPLY, reply_to(READ)) == "bbhhhhhhg"
    assert followed(WRITE_REPLY, reply_to(WRITE)) == "bhhhhhhg"


def test_the_length_is_there_as_soon_as_it_can_be() -> None:
    arrival = RequestArrival()
    lengths = []
    for byte in WRITE:
        arrival.feed(bytes((byte,)))
        lengths.append(arrival.length)
    assert lengths == [0, 0, 0, 0, 0, 0, 13, 13, 13, 13, 13, 13, 13]
    arrival = RequestArrival()
    arrival.feed(READ[:2])
    assert (arrival.length, arrival.progress) == (8, Progress.BEGUN)


def test_one_wrong_bit_makes_a_frame_bad_and_never_good() -> None:
    for at in range(7, len(WRITE)):
        for bit in range(8):
            damaged = WRITE[:at] + bytes((WRITE[at] ^ 1 << bit,)) + WRITE[at + 1 :]
            arrival = RequestArrival()
            assert arrival.feed(damaged) == 13
            assert arrival.progress is Progress.BAD


def test_what_follows_a_frame_is_not_its_own() -> None:
    arrival = RequestArrival()
    assert arrival.feed(WRITE[:11]) == 11
    assert arrival.feed(WRITE[11:] + READ) == 2
    assert (arrival.data, arrival.progress) == (WRITE, Progress.GOOD)
    assert arrival.feed(READ) == 0


@pytest.mark.parametrize(
    "begun",
    [
        "01 06",  # single registers and coils are left alone, and what cannot be measured
        "01 05",
        "01 2B",
        "01 65",
        "01 00",
        "01 17",  # of a read and write in one the head has more than registers to write
        "01 10 6F 00 00 7B F9",  # 258 bytes
    ],
)
def test_requests_that_are_not_followed(begun: str) -> None:
    data = bytes.fromhex(begun)
    assert followed(data)[-1] == "o"
    arrival = RequestArrival()
    assert arrival.feed(data + bytes(20)) == len(data)
    assert (arrival.progress, arrival.length) == (Progress.ODD, 0)


@pytest.mark.parametrize(
    ("reply", "bytes_until_it_is_odd"),
    [
        ("02 03 04 00 B1 1F 40 E7 D4", 1),  # another unit
        ("01 83 02 C0 F1", 2),  # an exception
        ("01 81 02 C1 91", 2),  # the refusal of any read
        ("01 04 04 00 B1 1F 40 A2 63", 2),  # another function
        ("01 03 06 00 B1 1F 40 00 00 00 00", 3),  # more than was asked for
        ("01 03 02 00 B1", 3),  # less
    ],
)
def test_w4_replies_that_are_not_what_was_asked_for_are_odd(reply: str, bytes_until_it_is_odd: int) -> None:
    arrival = reply_to(READ)
    assert arrival.feed(bytes.fromhex(reply)) == bytes_until_it_is_odd
    assert arrival.progress is Progress.ODD


def test_the_reply_to_a_vendor_s_function_is_odd() -> None:
    arrival = ReplyArrival(9, bytes.fromhex("65 10 20"))
    arrival.feed(bytes.fromhex("09 65 10"))
    assert arrival.progress is Progress.ODD


@given(stream=frames, data=st.data())
def test_what_is_known_follows_from_the_bytes_alone(stream: bytes, data: st.DataObject) -> None:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    pieces = [stream[a:b] for a, b in pairwise([0, *cuts, len(stream)])]
    whole, cut = RequestArrival(), RequestArrival()
    taken = whole.feed(stream)
    assert sum(cut.feed(piece) for piece in pieces) == taken
    assert (cut.data, cut.progress, cut.length, cut.residue) == (
        whole.data,
        whole.progress,
        whole.length,
        whole.residue,
    )
    assert whole.data == stream[:taken]
    assert whole.residue == residue_after(whole.data)


@given(stream=frames)
def test_w3_a_frame_is_good_only_where_the_decoder_gives_it(stream: bytes) -> None:
    arrival = RequestArrival()
    taken = arrival.feed(stream)
    given_frames = RtuRequestDecoder().feed(stream[:taken], 0)
    if arrival.progress is Progress.GOOD:
        assert given_frames == [(stream[0], stream[1 : taken - 2])]
    elif arrival.progress in (Progress.BEGUN, Progress.HEAD):
        assert given_frames == []
