"""Modbus/TCP frames out of a byte stream."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.errors import FrameError
from gateway.modbus.mbap import LARGEST_SENT, MbapDecoder, encode_mbap, too_long

READ = bytes.fromhex("03 32 00 00 02")
ADU = bytes.fromhex("00 07 00 00 00 06 01 03 32 00 00 02")
FOREIGN = bytes.fromhex("00 07 00 01 00 06 01 03 32 00 00 02")

ids = st.integers(0, 0xFFFF)
units = st.integers(0, 0xFF)
pdus = st.binary(min_size=1, max_size=253)


def test_a_frame_is_built_as_the_guide_says() -> None:
    assert encode_mbap(7, 1, READ) == ADU


def test_a_frame_comes_out_whole() -> None:
    assert MbapDecoder().feed(ADU) == [(7, 1, READ)]


def test_a_frame_comes_out_with_its_last_byte() -> None:
    decoder = MbapDecoder()
    for byte in ADU[:-1]:
        assert decoder.feed(bytes((byte,))) == []
    assert decoder.feed(ADU[-1:]) == [(7, 1, READ)]
    assert decoder.counters.dropped_bytes == 0


def test_pipelined_requests_all_come_out() -> None:
    decoder = MbapDecoder()
    stream = b"".join(encode_mbap(n, 1, READ) for n in range(5))
    assert decoder.feed(stream[:-3]) == [(n, 1, READ) for n in range(4)]
    assert decoder.feed(stream[-3:]) == [(4, 1, READ)]


def test_another_protocol_is_skipped_frame_by_frame() -> None:
    decoder = MbapDecoder()
    assert decoder.feed(FOREIGN) == []
    assert decoder.feed(FOREIGN + ADU) == [(7, 1, READ)]
    assert decoder.counters.skipped_frames == 2
    assert decoder.counters.dropped_bytes == 2 * len(FOREIGN)
    assert decoder.counters.bad_headers == 0


@pytest.mark.parametrize("length", [0, 1, 255, 256, 0xFFFF])
def test_after_an_impossible_length_nothing_is_a_frame_any_more(length: int) -> None:
    decoder = MbapDecoder()
    header = bytes((0, 7, 0, 0)) + length.to_bytes(2, "big")
    assert decoder.feed(ADU + header + bytes(300) + ADU) == [(7, 1, READ)]
    assert decoder.broken_by == header + bytes(2)
    assert decoder.counters.bad_headers == 1
    assert decoder.counters.dropped_bytes == 306 + len(ADU)
    assert decoder.feed(ADU) == []
    assert decoder.feed(ADU[:3]) == []
    assert decoder.is_between_frames
    assert decoder.counters.bad_headers == 1
    assert decoder.counters.dropped_bytes == 306 + 2 * len(ADU) + 3


def test_an_impossible_length_that_fits_the_data_is_refused_too() -> None:
    decoder = MbapDecoder()
    assert decoder.feed(bytes.fromhex("00 07 00 00 00 FF") + bytes(255)) == []
    assert decoder.counters.bad_headers == 1


# FC16 of 124 registers, as clients send it that are asked to: 1 + 6 + 248 = 255 bytes behind the length.
TOO_LONG = bytes.fromhex("00 02 00 00 00 FF 01 10 03 E8 00 7C F8")


def test_a_frame_that_is_too_long_is_judged_when_its_function_code_is_there() -> None:
    decoder = MbapDecoder()
    for byte in TOO_LONG[:7]:
        assert decoder.feed(bytes((byte,))) == []
        assert decoder.broken_by == b""
    assert decoder.feed(TOO_LONG[7:8]) == []
    assert decoder.broken_by == TOO_LONG[:8]
    assert decoder.counters.dropped_bytes == 8


@pytest.mark.parametrize(
    ("head", "answer"),
    [
        ("00 02 00 00 00 FF 01 10", (2, 1, b"\x90\x03")),
        ("AB CD 00 00 01 04 11 17", (0xABCD, 0x11, b"\x97\x03")),  # 260, the longest that is answered
        ("AB CD 00 00 01 05 11 17", None),
        ("AB CD 00 00 00 01 11 17", None),  # no room for a function code
        ("AB CD 00 00 00 00 11 17", None),
        ("AB CD 00 01 00 FF 11 17", None),  # of another protocol
        ("AB CD 00 00 FF FF", None),
    ],
)
def test_only_what_a_client_sends_is_answered(head: str, answer: tuple[int, int, bytes] | None) -> None:
    assert too_long(bytes.fromhex(head)) == answer


def test_replies_may_be_longer_than_the_standard_allows() -> None:
    decoder = MbapDecoder(longest_length=LARGEST_SENT)
    reply = bytes.fromhex("00 07 00 00 00 FF 01 03 FC") + bytes(252)
    assert decoder.feed(reply + ADU) == [(7, 1, reply[7:]), (7, 1, READ)]
    assert decoder.feed(reply) == [(7, 1, reply[7:])]
    assert decoder.counters.bad_headers == 0


@pytest.mark.parametrize("size", [1, 253])
def test_the_shortest_and_the_longest_pdu_pass(size: int) -> None:
    assert MbapDecoder().feed(encode_mbap(0xFFFF, 255, bytes(size))) == [(0xFFFF, 255, bytes(size))]


@pytest.mark.parametrize(
    ("transaction_id", "unit_id", "pdu"),
    [(-1, 1, READ), (0x10000, 1, READ), (1, -1, READ), (1, 256, READ), (1, 1, b""), (1, 1, bytes(254))],
)
def test_what_cannot_be_framed_is_refused(transaction_id: int, unit_id: int, pdu: bytes) -> None:
    with pytest.raises(FrameError):
        encode_mbap(transaction_id, unit_id, pdu)


@given(frames=st.lists(st.tuples(ids, units, pdus), max_size=8), data=st.data())
def test_any_split_gives_the_same_frames(frames: list[tuple[int, int, bytes]], data: st.DataObject) -> None:
    stream = b"".join(encode_mbap(*frame) for frame in frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    decoder = MbapDecoder()
    pieces = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    assert [frame for piece in pieces for frame in decoder.feed(piece)] == frames


@given(pieces=st.lists(st.binary(max_size=400), max_size=10))
def test_arbitrary_bytes_raise_nothing_and_are_all_accounted_for(pieces: list[bytes]) -> None:
    decoder = MbapDecoder()
    taken = sum(7 + len(pdu) for piece in pieces for _, _, pdu in decoder.feed(piece))
    fed = sum(len(piece) for piece in pieces)
    assert 0 <= fed - taken - decoder.counters.dropped_bytes < 260
