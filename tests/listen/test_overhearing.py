"""Frames out of a line that somebody else speaks on, and how the line is set."""

import pytest

from gateway.commissioning.listen.overhearing import Overheard, Overhearing
from gateway.commissioning.listen.serial_line import PortSettings, Trial, settings_to_try
from gateway.modbus.rtu import encode_rtu
from tests.listen.uart import Character, marked, received

READ = bytes.fromhex("03 00CC 0002")
READ_REPLY = bytes.fromhex("03 04 0000 2710")
WRITE = bytes.fromhex("10 005C 0002 04 0000 2710")
WRITE_REPLY = bytes.fromhex("10 005C 0002")
SINGLE = bytes.fromhex("06 007D 0008")
CONVERSATION = [
    (1, READ, False),
    (1, READ_REPLY, True),
    (1, WRITE, False),
    (1, WRITE_REPLY, True),
    (2, SINGLE, False),
    (2, SINGLE, True),  # its echo
    (3, READ, False),  # nobody answers
    (1, bytes.fromhex("03 1000 0001"), False),
    (1, bytes.fromhex("83 02"), True),
]
ON_THE_WIRE = b"".join(encode_rtu(unit_id, pdu) for unit_id, pdu, _ in CONVERSATION)


def kinds(frames: list[Overheard]) -> list[tuple[int, bytes, bool]]:
    return [(frame.unit_id, frame.pdu, frame.is_reply) for frame in frames]


def test_requests_are_told_from_replies() -> None:
    line = Overhearing()
    frames = line.feed(ON_THE_WIRE)
    assert kinds(frames) == CONVERSATION
    assert [frame.request for frame in frames if frame.is_reply] == [
        READ,
        WRITE,
        SINGLE,
        bytes.fromhex("03 1000 0001"),
    ]
    assert (line.frames, line.good_bytes, line.bad_bytes) == (9, len(ON_THE_WIRE), 0)


def test_bytes_may_come_one_by_one() -> None:
    line = Overhearing()
    frames = [frame for value in ON_THE_WIRE for frame in line.feed(bytes((value,)))]
    assert kinds(frames) == CONVERSATION


def test_who_comes_in_the_middle_of_a_frame_hears_the_next() -> None:
    line = Overhearing()
    heard = line.feed(ON_THE_WIRE[3:8]) + line.silent()
    assert heard == []
    assert kinds(line.feed(ON_THE_WIRE[8:])) == CONVERSATION[1:]
    assert line.bad_bytes == 5


def test_what_is_damaged_costs_itself_only() -> None:
    line = Overhearing()
    damaged = bytearray(encode_rtu(1, READ))
    damaged[4] ^= 0x10
    heard = line.feed(bytes(damaged)) + line.silent()
    assert heard == []
    assert kinds(line.feed(encode_rtu(2, SINGLE))) == [(2, SINGLE, False)]
    assert line.bad_bytes == 8


def test_a_broadcast_has_no_reply() -> None:
    line = Overhearing()
    frames = line.feed(encode_rtu(0, SINGLE) + encode_rtu(1, SINGLE) + encode_rtu(1, SINGLE))
    assert kinds(frames) == [(0, SINGLE, False), (1, SINGLE, False), (1, SINGLE, True)]


def test_a_function_of_a_vendor_ends_with_silence() -> None:
    line = Overhearing()
    frame = encode_rtu(5, bytes.fromhex("65 01 02"))
    assert line.feed(frame) == []
    assert kinds(line.silent()) == [(5, bytes.fromhex("65 01 02"), False)]


# --- baud rates and parities -------------------------------------------------------------------------------


def test_a_uart_at_twice_the_rate_hears_each_bit_twice() -> None:
    # 0x55 at 9600 Bd: start 0, then 1 0 1 0 1 0 1 0, stop 1. At 19200 Bd the line reads 00 11 00 11 00 11 00
    # 11 00 11: start 0, data 0 1 1 0 0 1 1 0 from the lowest bit on = 0x66, and 0 in place of the stop bit.
    assert received(b"\x55", (9600, "N"), (19200, "N"))[0] == Character(0x66, is_wrong=True)


def test_a_uart_without_parity_takes_the_parity_bit_for_the_stop_bit() -> None:
    # 0x01 has one bit set: its even parity bit is 1, as a stop bit is. That of 0x03 is 0: an error of frame.
    assert received(b"\x01", (9600, "E"), (9600, "N")) == [Character(0x01, is_wrong=False)]
    assert received(b"\x03", (9600, "E"), (9600, "N")) == [Character(0x03, is_wrong=True)]
    assert received(b"\x01\x03", (9600, "E"), (9600, "O")) == [Character(1, True), Character(3, True)]


@pytest.mark.parametrize("baudrate", [1200, 9600, 19200, 38400, 115200, 921600])
@pytest.mark.parametrize("parity", ["N", "E", "O"])
def test_only_the_right_setting_is_taken(baudrate: int, parity: str) -> None:
    """Each of all settings that are tried hears the same minute of a line, as its UART would misread it."""
    right = []
    for setting in settings_to_try(None, None):
        trial = Trial(setting)
        for _ in range(3):
            for unit_id, pdu, _ in CONVERSATION:
                if trial.is_right or trial.is_hopeless:
                    break
                frame = encode_rtu(unit_id, pdu)
                trial.feed(marked(received(frame, (baudrate, parity), (setting.baudrate, setting.parity))))
                trial.line.silent()
        if trial.is_right:
            right.append(setting)
    assert right == [PortSettings(baudrate, parity)]


def test_what_is_given_is_not_guessed() -> None:
    assert settings_to_try(9600, "O") == [PortSettings(9600, "O")]
    assert settings_to_try(9600, None) == [
        PortSettings(9600, "E"),
        PortSettings(9600, "N"),
        PortSettings(9600, "O"),
    ]
    assert settings_to_try(9600, "E", has_parity=False) == [PortSettings(9600, "N")]
    assert len(set(settings_to_try(None, None))) == 33
