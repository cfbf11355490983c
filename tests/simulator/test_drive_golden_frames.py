"""Frames that manuals print, answered by the simulated drives byte for byte."""

import pytest

from gateway.modbus.crc import is_intact
from gateway.modbus.rtu import encode_rtu
from tests.simulator.drive_bench import ABSOLUTE, GOLDEN_FRAMES, HOME, OTHER, STOP, Drive

# Name of the frame, drive, the PDUs that bring it into the state of the manual, what it is made to do.
# Delta's example reads P2-00 = 0x00B1 and 0x1F40 (manual page 555). The slave error of BLV-R is that of a
# drive that is busy. IAI changes the push force alone (PPOW), which moves to the last PCMD.
PRINTED = [
    ("kinco enable", "kinco-fd", [], []),
    ("kinco read status word", "kinco-fd", [], []),
    ("kinco FC16 32-bit low word first 0x00085555", "kinco-fd", [], []),
    ("kinco FC16 0x001B4E82 = 100 rpm", "kinco-fd", [], []),
    ("leadshine wrong function code", "leadshine-pr", [], []),
    ("leadshine immediate PR0", "leadshine-pr", [], [(ABSOLUTE, 10_000)]),
    ("leadshine FC16 4 regs", "leadshine-pr", [], []),
    ("oriental BLV-R S-ON", "oriental-blv-r", [], []),
    # Type 48 is continuous operation: the position in the frame is no target.
    (
        "oriental BLV-R direct data, 14 regs from 0x005A",
        "oriental-blv-r",
        ["10 007C 0002 04 00000001"],
        [(OTHER, None)],
    ),
    ("oriental AZ stored position -1000", "oriental-az", [], []),
    ("delta FC03", "delta-asda", ["10 0200 0002 04 00B1 1F40"], []),
    ("delta FC16", "delta-asda", [], []),
    ("iai change push", "iai-robo-cylinder", ["05 0403 FF00"], [(ABSOLUTE, 0)]),
    ("iai home edge", "iai-robo-cylinder", ["05 0403 FF00"], [(HOME, None)]),
    ("mks absolute coordinate 163840", "makerbase-servo42d", [], [(ABSOLUTE, 163_840)]),
    ("mks stop", "makerbase-servo42d", [], [(STOP, 0)]),
    ("mks read int48", "makerbase-servo42d", [], []),
    ("ess target 5000", "stepperonline-ess-rs", [], []),
]


@pytest.mark.parametrize(("name", "drive_name", "before", "moves"), PRINTED, ids=[row[0] for row in PRINTED])
def test_printed_frames_are_answered(
    name: str, drive_name: str, before: list[str], moves: list[object]
) -> None:
    frame = GOLDEN_FRAMES[name]
    request = bytes.fromhex(frame["request"])
    assert is_intact(request)
    drive = Drive(drive_name, unit_id=request[0])
    drive.does(*before)
    reply = drive.bus.answer(request[0], request[1:-2], drive.now_s)
    assert reply is not None
    if "reply" in frame:
        assert encode_rtu(request[0], reply) == bytes.fromhex(frame["reply"])
    else:
        assert reply[0] == request[1]
    assert drive.moves == moves


def test_smc_shows_the_position_of_its_manual() -> None:
    frame = GOLDEN_FRAMES["smc position 150.00 mm"]
    drive = Drive("smc-lec")
    drive.motor.set_position(15_000, 0.0)
    assert drive.ask(frame["request"][3:-6]) == frame["reply"][3:-6]


def test_a_busy_oriental_answers_the_printed_slave_error() -> None:
    frame = GOLDEN_FRAMES["oriental slave error"]
    drive = Drive("oriental-blv-r")
    drive.unit.is_busy = True  # type: ignore[attr-defined]
    assert drive.ask(frame["request"][3:-6]) == frame["reply"][3:-6]


def test_delta_refuses_a_parameter_that_it_does_not_have_as_printed() -> None:
    # 0x05C8 would be P5-100; groups end at 99.
    assert Drive("delta-asda").ask("06 05C8 0001") == GOLDEN_FRAMES["delta exception"]["reply"][3:-6]
