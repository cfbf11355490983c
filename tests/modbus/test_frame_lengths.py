"""The length of every frame that tells its length (Modbus application protocol V1.1b3, section 6)."""

import pytest

from gateway.modbus.lengths import (
    NEEDS_MORE,
    NO_FRAME,
    REPLIES,
    REQUESTS,
    UNTIL_SILENCE,
    reply_length,
    request_length,
)
from gateway.modbus.pdu import ExceptionCode, exception_pdu, is_exception

# The data of the specification's examples, request and reply, without unit id, function code and check sum.
# Those of 7, 17 and 43 are shortened or filled in where the specification prints "device specific".
IDENTIFICATION = (
    "0E 01 01 00 00 03 00 16 "
    "43 6F 6D 70 61 6E 79 20 69 64 65 6E 74 69 66 69 63 61 74 69 6F 6E "
    "01 0C 50 72 6F 64 75 63 74 20 63 6F 64 65 02 05 56 32 2E 31 31"
)
EXAMPLES = {
    0x01: ("00 13 00 13", "03 CD 6B 05"),
    0x02: ("00 C4 00 16", "03 AC DB 35"),
    0x03: ("00 6B 00 03", "06 02 2B 00 00 00 64"),
    0x04: ("00 08 00 01", "02 00 0A"),
    0x05: ("00 AC FF 00", "00 AC FF 00"),
    0x06: ("00 01 00 03", "00 01 00 03"),
    0x07: ("", "6D"),
    0x08: ("00 00 A5 37", "00 00 A5 37"),
    0x0B: ("", "FF FF 01 08"),
    0x0C: ("", "08 00 00 01 08 01 21 20 00"),
    0x0F: ("00 13 00 0A 02 CD 01", "00 13 00 0A"),
    0x10: ("00 01 00 02 04 00 0A 01 02", "00 01 00 02"),
    0x11: ("", "03 41 42 FF"),
    0x14: ("0E 06 00 04 00 01 00 02 06 00 03 00 09 00 02", "0C 05 06 0D FE 00 20 05 06 33 CD 00 40"),
    0x15: ("0D 06 00 04 00 07 00 03 06 AF 04 BE 10 0D", "0D 06 00 04 00 07 00 03 06 AF 04 BE 10 0D"),
    0x16: ("00 04 00 F2 00 25", "00 04 00 F2 00 25"),
    0x17: ("00 03 00 06 00 0E 00 03 06 00 FF 00 FF 00 FF", "0C 00 FE 0A CD 00 01 00 03 00 0D 00 FF"),
    0x18: ("04 DE", "00 06 00 02 01 B8 12 84"),
    0x2B: ("0E 01 00", IDENTIFICATION),
}


def without_crc(function: int, body: str) -> bytes:
    return bytes((0x11, function)) + bytes.fromhex(body)


def test_every_public_function_code_has_a_rule() -> None:
    assert set(EXAMPLES) == set(REQUESTS) == set(REPLIES)


@pytest.mark.parametrize("function", EXAMPLES)
def test_the_specifications_request_is_measured(function: int) -> None:
    wire = without_crc(function, EXAMPLES[function][0])
    assert request_length(wire + b"\xca\xfe") == len(wire) + 2
    assert request_length(b"\x00\xff\x00" + wire + b"\xca\xfe", 3) == len(wire) + 2


@pytest.mark.parametrize("function", EXAMPLES)
def test_the_specifications_reply_is_measured(function: int) -> None:
    request = without_crc(function, EXAMPLES[function][0])[1:]
    wire = without_crc(function, EXAMPLES[function][1])
    assert reply_length(request, wire + b"\xca\xfe") == len(wire) + 2
    assert reply_length(request, b"\x00\xff\x00" + wire + b"\xca\xfe", 3) == len(wire) + 2


@pytest.mark.parametrize("function", EXAMPLES)
def test_the_length_is_never_told_wrong_from_fewer_bytes(function: int) -> None:
    request, reply = (without_crc(function, body) for body in EXAMPLES[function])
    for size in range(len(request)):
        assert request_length(request[:size]) in (NEEDS_MORE, len(request) + 2)
    for size in range(len(reply)):
        assert reply_length(request[1:], reply[:size]) in (NEEDS_MORE, len(reply) + 2)


UNKNOWN = [9, 0x0A, *range(0x41, 0x49), *range(0x64, 0x6F), 0x7F]


@pytest.mark.parametrize("function", UNKNOWN)
def test_an_unknown_function_ends_by_silence(function: int) -> None:
    wire = bytes((1, function, 1, 2, 3, 4, 5, 6))
    assert request_length(wire) == UNTIL_SILENCE
    assert reply_length(wire[1:-2], wire) == UNTIL_SILENCE


def test_canopen_general_reference_ends_by_silence() -> None:
    wire = bytes.fromhex("01 2B 0D 00 00 00")
    assert request_length(wire) == UNTIL_SILENCE
    assert reply_length(wire[1:], wire) == UNTIL_SILENCE


@pytest.mark.parametrize("function", [0x81, 0x83, 0x90, 0xAB, 0xE5, 0xFF])
def test_any_function_byte_with_bit_7_is_an_exception_of_five_bytes(function: int) -> None:
    assert reply_length(b"\x03\x00\x00\x00\x01", bytes((1, function))) == 5
    assert request_length(bytes((1, function))) == UNTIL_SILENCE


def test_a_vendors_function_above_127_is_no_exception_where_it_was_asked_for() -> None:
    assert reply_length(b"\xc1\x00", bytes.fromhex("01 C1 02")) == UNTIL_SILENCE


def test_function_0_begins_no_frame() -> None:
    assert request_length(bytes(8)) == NO_FRAME
    assert reply_length(b"\x03\x00\x00\x00\x01", bytes(8)) == NO_FRAME


def test_a_byte_count_beyond_a_frame_begins_no_frame() -> None:
    assert request_length(bytes.fromhex("01 10 00 00 00 7B F7")) == 256
    assert request_length(bytes.fromhex("01 10 00 00 00 7C F8")) == NO_FRAME
    assert reply_length(b"\x18\x00\x00", bytes.fromhex("01 18 01 00")) == NO_FRAME
    # FC43/14 with 3 objects of 200 characters each
    identification = bytes.fromhex("01 2B 0E 01 01 00 00 03 00 C8") + bytes(200) + b"\x01\xc8"
    assert reply_length(b"\x2b\x0e\x01\x00", identification) == NO_FRAME


def test_diagnostics_are_answered_in_the_requests_own_length() -> None:
    request = bytes.fromhex("08 00 00 A5 37 11 22")
    assert reply_length(request, b"\x01\x08") == 10
    assert request_length(b"\x01\x08") == 8


def test_exceptions_are_built_and_told() -> None:
    assert exception_pdu(0x10, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND) == b"\x90\x0b"
    assert is_exception(b"\x90\x0b")
    assert is_exception(b"\x81\x02")  # Kinco, after a read of holding registers
    assert not is_exception(b"\x10\x00\x01\x00\x02")
    assert not is_exception(b"")
