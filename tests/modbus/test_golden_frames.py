"""Frames from the manuals of real drives go through both decoders, however they arrive."""

import pytest

from gateway.modbus.crc import is_intact
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu
from tests.modbus.frames import frame_of

GARBAGE = bytes.fromhex("FF 7E 03")


def test_a_request_comes_out_whole(golden_request: bytes) -> None:
    decoder = RtuRequestDecoder()
    assert decoder.feed(golden_request, 0) == [frame_of(golden_request)]
    assert decoder.deadline_ns is None


def test_a_request_comes_out_with_its_last_byte(golden_request: bytes) -> None:
    decoder = RtuRequestDecoder()
    for byte in golden_request[:-1]:
        assert decoder.feed(bytes((byte,)), 0) == []
    assert decoder.feed(golden_request[-1:], 0) == [frame_of(golden_request)]


def test_two_glued_requests_come_out_together(golden_request: bytes) -> None:
    decoder = RtuRequestDecoder()
    assert decoder.feed(golden_request * 2, 0) == [frame_of(golden_request)] * 2


@pytest.mark.parametrize("count", [1, 2, 3])
def test_zeros_behind_a_request_are_dropped_and_counted(golden_request: bytes, count: int) -> None:
    decoder = RtuRequestDecoder(silence_ns=1000)
    assert decoder.feed(golden_request + bytes(count), 0) == [frame_of(golden_request)]
    assert decoder.deadline_ns == 1000
    assert decoder.on_silence(1000) == []
    assert decoder.counters.glitch_bytes == count
    assert decoder.counters.crc_errors == 0
    assert decoder.deadline_ns is None


def test_garbage_behind_a_request_does_not_hide_the_next(golden_request: bytes) -> None:
    decoder = RtuRequestDecoder(silence_ns=1000, give_up_ns=30_000)
    frames = decoder.feed(golden_request + GARBAGE + golden_request, 0)
    frames += decoder.on_silence(1000)
    assert frames == [frame_of(golden_request)] * 2
    assert decoder.counters.dropped_bytes == len(GARBAGE)


def test_a_request_behind_garbage_is_found(golden_request: bytes) -> None:
    decoder = RtuRequestDecoder(silence_ns=1000)
    frames = decoder.feed(GARBAGE + golden_request, 0) + decoder.on_silence(1000)
    assert frames == [frame_of(golden_request)]


def test_a_request_behind_its_own_truncated_copy_is_found(golden_request: bytes) -> None:
    for cut in range(1, len(golden_request)):
        decoder = RtuRequestDecoder(silence_ns=1000)
        frames = decoder.feed(golden_request[:cut] + golden_request, 0) + decoder.on_silence(1000)
        assert frames == [frame_of(golden_request)], cut
        assert decoder.counters.dropped_bytes + decoder.counters.glitch_bytes == cut


def test_all_requests_glued_come_out_in_order(golden_requests: list[bytes]) -> None:
    frames = RtuRequestDecoder().feed(b"".join(golden_requests), 0)
    assert frames == [frame_of(wire) for wire in golden_requests]


def test_a_misprinted_frame_does_not_come_out(misprint: tuple[bytes, bytes]) -> None:
    printed, intact = misprint
    decoder = RtuRequestDecoder(silence_ns=1000, give_up_ns=5000)
    assert decoder.feed(printed, 0) == []
    assert decoder.on_silence(1000) == []
    assert decoder.on_silence(5000) == []
    assert (decoder.counters.crc_errors, decoder.counters.dropped_bytes) == (1, 8)
    assert decoder.feed(intact, 6000) == [frame_of(intact)]


def expecting(exchange: tuple[bytes, bytes]) -> tuple[RtuReplyDecoder, bytes]:
    """Return a decoder that waits for the reply of an exchange, and that."""
    request, reply = exchange
    decoder = RtuReplyDecoder(silence_ns=1000)
    decoder.expect(reply[0], request)
    return decoder, reply


def test_a_reply_comes_out_whole(golden_exchange: tuple[bytes, bytes]) -> None:
    decoder, reply = expecting(golden_exchange)
    assert decoder.feed(reply, 0) == [frame_of(reply)]
    assert not decoder.is_expecting


def test_a_reply_comes_out_with_its_last_byte(golden_exchange: tuple[bytes, bytes]) -> None:
    decoder, reply = expecting(golden_exchange)
    for byte in reply[:-1]:
        assert decoder.feed(bytes((byte,)), 0) == []
    assert decoder.feed(reply[-1:], 0) == [frame_of(reply)]


@pytest.mark.parametrize("noise", [b"\x00", b"\xff", b"\x00\xff\x00", GARBAGE, b"\x01", b"\x07\x10"])
def test_a_reply_behind_noise_is_found(golden_exchange: tuple[bytes, bytes], noise: bytes) -> None:
    decoder, reply = expecting(golden_exchange)
    assert decoder.feed(noise + reply, 0) + decoder.on_silence(1000) == [frame_of(reply)]
    assert decoder.counters.dropped_bytes + decoder.counters.glitch_bytes == len(noise)


def test_only_the_first_of_two_glued_replies_comes_out(golden_exchange: tuple[bytes, bytes]) -> None:
    decoder, reply = expecting(golden_exchange)
    assert decoder.feed(reply + reply, 0) == [frame_of(reply)]
    assert decoder.stray_bytes == len(reply)


def test_zeros_behind_a_reply_are_counted_as_glitches(golden_exchange: tuple[bytes, bytes]) -> None:
    decoder, reply = expecting(golden_exchange)
    assert decoder.feed(reply + b"\x00", 0) == [frame_of(reply)]
    assert decoder.feed(b"\x00\x00", 1) == []
    assert (decoder.counters.glitch_bytes, decoder.stray_bytes) == (3, 0)


def test_a_misprinted_reply_does_not_come_out(misprint: tuple[bytes, bytes]) -> None:
    printed, intact = misprint
    decoder = RtuReplyDecoder(silence_ns=1000, give_up_ns=5000)
    decoder.expect(1, intact[1:-2])
    assert decoder.feed(printed, 0) + decoder.on_silence(1000) + decoder.on_silence(5000) == []
    assert decoder.counters.crc_errors == 1


def test_encoding_gives_the_printed_bytes(golden_request: bytes) -> None:
    assert encode_rtu(*frame_of(golden_request)) == golden_request


def test_zeros_behind_a_frame_keep_its_check_sum_good(golden_request: bytes) -> None:
    # The reason why a check sum alone never ends a frame.
    for count in range(4):
        assert is_intact(golden_request + bytes(count))
