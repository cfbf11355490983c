"""Kinco, MR-JE-C, dryve D1: CiA 402 in registers, in objects, and in function code 43."""

import pytest

from tests.simulator.drive_bench import (
    ABSOLUTE,
    HOME,
    OTHER,
    RELATIVE,
    SET_POSITION,
    STOP,
    Drive,
    ready,
    signed,
)

KINCO_TARGET = "10 4000 0002 04 2710 0000"
MRJE_TARGET = "10 607A 0002 04 2710 0000"


def test_kinco_moves_when_the_start_bit_rises() -> None:
    drive = ready("kinco-fd")
    drive.does(KINCO_TARGET, "06 3100 002F")
    assert drive.moves == []
    drive.does("06 3100 003F", "06 3100 003F")
    assert drive.moves == [(ABSOLUTE, 10_000)]
    assert not drive.bit(0x3200, 10)
    assert drive.bit(0x3200, 12)
    drive.wait()
    assert drive.bit(0x3200, 10)
    assert drive.low(0x3700) == 10_000
    drive.does("06 3100 004F")
    assert not drive.bit(0x3200, 12)
    drive.does("06 3100 005F")
    assert drive.moves == [(RELATIVE, 20_000)]


def test_kinco_follows_every_target_that_is_written() -> None:
    drive = ready("kinco-fd")
    drive.does("06 3100 103F")
    assert drive.moves == [(ABSOLUTE, 0)]
    drive.does(KINCO_TARGET, "10 4000 0002 04 0005 0000", "06 4001 0001")
    assert drive.moves == [(ABSOLUTE, 10_000), (ABSOLUTE, 5), (ABSOLUTE, 0x0001_0005)]
    drive.does("06 3100 000F", KINCO_TARGET)
    assert drive.moves == []


@pytest.mark.parametrize("word", ["000B", "0006", "013F"])
def test_kinco_stops_in_the_middle(word: str) -> None:
    drive = ready("kinco-fd")
    drive.does(KINCO_TARGET, "06 3100 003F")
    drive.wait(0.05)
    drive.does(f"06 3100 {word}")
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]


def test_kinco_homes_and_zeroes() -> None:
    drive = ready("kinco-fd")
    drive.finishes(KINCO_TARGET, "06 3100 003F")
    drive.does("10 3700 0002 04 0000 0000")
    assert drive.low(0x3700) == 0
    drive.does("06 3500 0006", "06 4D00 0011", "06 3100 000F", "06 3100 001F")
    assert not drive.bit(0x3200, 15)
    drive.wait()
    assert drive.bit(0x3200, 15)
    assert drive.moves == [(ABSOLUTE, 10_000), (SET_POSITION, 0), (HOME, None)]
    assert drive.motor.mechanics.motor_mm == pytest.approx(0.0)
    drive.does("06 3500 0003", "06 3100 000F", "06 3100 001F")
    assert drive.moves == [(OTHER, None)]


def test_kinco_fault_is_reset_by_its_bit() -> None:
    drive = ready("kinco-fd")
    drive.motor.mechanics.alarm = True
    assert drive.bit(0x3200, 3)
    drive.does("06 3100 0080", "06 3100 000F")
    assert not drive.bit(0x3200, 3)


def test_mr_je_c_addresses_are_objects() -> None:
    drive = ready("mitsubishi-mr-je-c")
    drive.does(MRJE_TARGET)
    assert drive.low(0x607A) == 10_000
    # 0x6040 and 0x6041 are words; 0x6060 and 0x6061 too.
    assert drive.read(0x6060, 2) == [1, 1]
    assert drive.read(0x6040, 2) == [0x000F, 0x0627]
    drive.does("10 6083 0004 08 0001 0000 0002 0000")  # Two objects of two words each.
    assert (drive.low(0x6083), drive.low(0x6084)) == (1, 2)


def test_mr_je_c_moves_when_the_start_bit_rises() -> None:
    drive = ready("mitsubishi-mr-je-c")
    drive.does(MRJE_TARGET, "10 6040 0001 02 001F")
    assert drive.read(0x6041) == [0x1227]  # enabled, remote, acknowledged
    drive.finishes("10 6040 0001 02 000F")
    assert drive.read(0x6041) == [0x0627]
    assert drive.low(0x6064) == 10_000
    drive.does("10 607A 0002 04 FFFB FFFF", "10 6040 0001 02 005F")
    assert drive.moves == [(ABSOLUTE, 10_000), (RELATIVE, 9_995)]


def test_mr_je_c_must_be_switched_on_in_steps() -> None:
    drive = Drive("mitsubishi-mr-je-c", unit_id=255)
    drive.does("10 6040 0001 02 000F", MRJE_TARGET, "10 6040 0001 02 001F")
    assert drive.moves == []
    assert drive.read(0x6041) == [0x0640]


def test_mr_je_c_stops_in_the_middle() -> None:
    drive = ready("mitsubishi-mr-je-c")
    drive.does(MRJE_TARGET, "10 6040 0001 02 001F")
    drive.wait(0.05)
    drive.does("10 6040 0001 02 010F")
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]


def test_mr_je_c_homes_in_mode_6() -> None:
    drive = ready("mitsubishi-mr-je-c")
    drive.does("10 6060 0001 02 0006", "10 6040 0001 02 001F")
    assert drive.read(0x6041) == [0x0227]
    drive.wait()
    assert drive.read(0x6041) == [0x1627]
    assert drive.moves == [(HOME, None)]


def test_mr_je_c_runs_its_point_table() -> None:
    drive = ready("mitsubishi-mr-je-c")
    point = "0007 07D0 0000" + " 0000" * 12
    drive.does(f"10 2802 000F 1E {point}", "10 6060 0001 02 FF9B", "10 2D60 0001 02 0002")
    drive.does("10 6040 0001 02 001F")
    assert drive.moves == [(ABSOLUTE, 2_000)]
    assert drive.read(0x2D69) == [2]


def dryve() -> Drive:
    drive = Drive("igus-dryve-d1", unit_id=0)
    for word in ("06 00", "07 00", "0F 00"):
        put(drive, "6040", word)
    return drive


def put(drive: Drive, index: str, data: str, sub: str = "00") -> None:
    """Write an object: its bytes, the lowest first."""
    head = f"2B0D 01 0000 {index} {sub} 000000"
    size = len(bytes.fromhex(data))
    reply = drive.ask(f"{head} {size:02X} {data}")
    assert bytes.fromhex(reply) == bytes.fromhex(f"{head} 00")


def get(drive: Drive, index: str, size: int) -> bytes:
    """Read an object."""
    request = bytes.fromhex(f"2B0D 00 0000 {index} 00 000000 {size:02X}")
    reply = bytes.fromhex(drive.ask(request.hex()))
    assert reply[:12] == request
    return reply[12:]


def test_dryve_moves_when_the_start_bit_rises() -> None:
    drive = dryve()
    put(drive, "6081", "10 27 00 00")
    put(drive, "607A", "10 27 00 00")
    put(drive, "6040", "1F 00")
    assert get(drive, "6041", 2) == b"\x27\x12"
    put(drive, "6040", "0F 00")
    drive.wait()
    assert get(drive, "6041", 2) == b"\x27\x06"
    assert get(drive, "6064", 4) == bytes.fromhex("10 27 00 00")
    put(drive, "607A", "FB FF FF FF")
    put(drive, "6040", "5F 00")
    drive.wait()
    assert signed(0, int.from_bytes(get(drive, "6064", 4), "little")) == 9_995
    put(drive, "6040", "0F 00")
    put(drive, "6040", "1F 00")
    drive.wait(0.05)
    put(drive, "6040", "0F 01")
    moves = drive.moves
    # 50 mm/s after 0.05 s and 1.25 mm, and 1.25 mm to brake.
    assert moves == [(ABSOLUTE, 10_000), (RELATIVE, 9_995), (ABSOLUTE, -5), (STOP, 7_495)]


def test_dryve_homes_to_the_state_of_the_example() -> None:
    drive = dryve()
    put(drive, "6060", "06")
    put(drive, "6092", "01 00 00 00", "01")
    put(drive, "6099", "70 17 00 00", "01")
    put(drive, "609A", "40 9C 00 00")
    put(drive, "6040", "1F 00")
    assert get(drive, "6041", 2) == b"\x27\x02"
    drive.wait()
    assert get(drive, "6041", 2) == b"\x27\x16"
    assert drive.moves == [(HOME, None)]


@pytest.mark.parametrize(
    ("request_pdu", "reply"),
    [
        ("03 6064 0002", "83 01"),
        ("2B0E 01 00", "AB 03"),
        ("2B0D 00 0000 6065 00 000000 04", "AB 02"),
        ("2B0D 00 0000 6064 00 000000 02", "AB 03"),
        ("2B0D 01 0000 6064 00 000000 04 00000000", "AB 02"),
        ("2B0D 01 0000 607A 00 000000 04 0000", "AB 03"),
    ],
)
def test_dryve_refusals(request_pdu: str, reply: str) -> None:
    assert dryve().ask(request_pdu) == reply
