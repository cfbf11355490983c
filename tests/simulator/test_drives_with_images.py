"""Festo CMMT and CMMO, Kollmorgen AKD2G: images that are written whole, actions on edges."""

import pytest

from tests.simulator.drive_bench import ABSOLUTE, HOME, OTHER, RELATIVE, STOP, Drive

READY = 0x043F
TASK = 0x047F
REFERENCE = 0x0C3F


def cmmt_image(stw1: int, mode: int = 0x8100, target: str = "2710 0000") -> str:
    """The output image of 28 registers, the target's low word first."""
    return f"10 0000 001C 38 {stw1:04X} {mode:04X} 0000 0000 4000 {target}" + " 0000" * 21


def cmmo_image(control: str, direction: str, target: str) -> str:
    """CCON and CPOS, CDIR and speed, setpoint with the high word first."""
    return f"10 0000 0004 08 {control} {direction} {target}"


def test_cmmt_runs_a_task_on_an_edge_and_not_on_repeats() -> None:
    drive = Drive("festo-cmmt-111")
    drive.does(cmmt_image(READY), cmmt_image(TASK), cmmt_image(TASK))
    assert drive.moves == [(ABSOLUTE, 10_000)]
    assert drive.bit(100, 12)
    assert not drive.bit(100, 10)
    drive.wait()
    assert drive.bit(100, 10)
    assert drive.low(105) == 10_000
    drive.does(cmmt_image(READY, 0x8000, "FFFB FFFF"))
    assert not drive.bit(100, 12)
    drive.does(cmmt_image(TASK, 0x8000, "FFFB FFFF"))
    assert drive.moves == [(RELATIVE, 9_995)]


def test_cmmt_follows_a_target_that_changes() -> None:
    drive = Drive("festo-cmmt-111")
    drive.does(cmmt_image(READY, 0x9100, "0000 0000"), cmmt_image(READY, 0x9100), cmmt_image(READY, 0x9100))
    drive.does(cmmt_image(READY, 0x9100, "0005 0000"))
    assert drive.moves == [(ABSOLUTE, 10_000), (ABSOLUTE, 5)]


@pytest.mark.parametrize("stw1", [READY & ~0x10, READY & ~0x20, READY & ~0x01])
def test_cmmt_stops_in_the_middle(stw1: int) -> None:
    drive = Drive("festo-cmmt-111")
    drive.does(cmmt_image(READY), cmmt_image(TASK))
    drive.wait(0.05)
    drive.does(cmmt_image(stw1))
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]
    drive.wait()
    assert drive.bit(100, 13)


def test_cmmt_goes_on_after_a_pause() -> None:
    drive = Drive("festo-cmmt-111")
    drive.does(cmmt_image(READY), cmmt_image(TASK))
    drive.wait(0.05)
    drive.finishes(cmmt_image(READY & ~0x20))
    drive.finishes(cmmt_image(READY))
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500), (ABSOLUTE, 10_000)]
    assert drive.low(105) == 10_000
    drive.does(cmmt_image(READY & ~0x20), cmmt_image(READY))  # it stood: there is no rest of the way
    assert drive.moves == [(STOP, 10_000)]


@pytest.mark.parametrize("lost", [0x10, 0x01])
def test_cmmt_does_not_go_on_after_a_task_was_rejected_or_the_power_was_off(lost: int) -> None:
    drive = Drive("festo-cmmt-111")
    drive.does(cmmt_image(READY), cmmt_image(TASK))
    drive.wait(0.05)
    drive.does(cmmt_image(READY & ~0x20), cmmt_image(READY & ~0x20 & ~lost), cmmt_image(READY))
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]


def test_cmmt_jogs_one_way_or_the_other() -> None:
    drive = Drive("festo-cmmt-111")
    for stw1 in (0x053F, 0x053F, 0x063F, 0x073F, READY, 0x073F, READY):
        drive.does(cmmt_image(stw1))
    assert drive.moves == [(OTHER, None), (OTHER, None), (STOP, 0)]


def test_cmmt_references() -> None:
    drive = Drive("festo-cmmt-111")
    drive.does(cmmt_image(READY), cmmt_image(REFERENCE))
    assert not drive.bit(100, 11)
    drive.wait()
    assert drive.bit(100, 11)
    assert drive.moves == [(HOME, None)]


def test_cmmt_tells_records_and_speeds_from_positions() -> None:
    drive = Drive("festo-cmmt-111")
    for mode in (0x0003, 0xC300, 0xC500):  # record 3, speed forward and backward
        drive.does(cmmt_image(READY, mode), cmmt_image(TASK, mode))
    drive.does(cmmt_image(READY, 0x0003), cmmt_image(READY | 1 << 13, 0x0003))  # the next record
    assert drive.moves == [(OTHER, None)] * 4


def test_cmmo_reads_something_else_than_was_written() -> None:
    drive = Drive("festo-cmmo-fhpp")
    drive.does(cmmo_image("4301", "0064", "0000 2710"), cmmo_image("4303", "0064", "0000 2710"))
    # SCON: enabled, operation enabled, direct mode; SPOS: no halt, start acknowledged, moving, referenced.
    assert drive.read(0, 4) == [0x4300 | 0x93, 0, 0, 0]
    drive.does(cmmo_image("4303", "0064", "0000 2710"))
    assert drive.moves == [(ABSOLUTE, 10_000)]
    drive.wait()
    assert drive.read(0, 4) == [0x4300 | 0x87, 0, 0, 10_000]
    drive.does(cmmo_image("4301", "0164", "FFFF FFFB"), cmmo_image("4303", "0164", "FFFF FFFB"))
    assert drive.moves == [(RELATIVE, 9_995)]


def test_cmmo_writes_and_reads_with_one_frame() -> None:
    drive = Drive("festo-cmmo-fhpp")
    drive.does(cmmo_image("4301", "0064", "0000 2710"))
    reply = drive.ask("17 0000 0004 0000 0004 08 4303 0064 0000 2710")
    assert reply == "17 08 43 93 00 00 00 00 00 00"
    assert drive.moves == [(ABSOLUTE, 10_000)]


@pytest.mark.parametrize("control", ["4300", "4101", "4201"])
def test_cmmo_stops_in_the_middle(control: str) -> None:
    drive = Drive("festo-cmmo-fhpp")
    drive.does(cmmo_image("4301", "0064", "0000 2710"), cmmo_image("4303", "0064", "0000 2710"))
    drive.wait(0.05)
    drive.does(cmmo_image(control, "0064", "0000 2710"))
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]


def test_cmmo_homes() -> None:
    drive = Drive("festo-cmmo-fhpp")
    drive.does(cmmo_image("4301", "0064", "0000 0000"), cmmo_image("4305", "0064", "0000 0000"))
    assert not drive.bit(0, 7)
    drive.wait()
    assert drive.bit(0, 7)
    assert drive.moves == [(HOME, None)]


def test_cmmo_runs_a_record_where_the_mode_selects_one_and_jogs() -> None:
    drive = Drive("festo-cmmo-fhpp")
    drive.does(cmmo_image("0301", "0300", "0000 2710"), cmmo_image("0303", "0300", "0000 2710"))
    assert drive.moves == [(OTHER, None)]
    drive.does(cmmo_image("4301", "0064", "0000 2710"), cmmo_image("4309", "0064", "0000 2710"))
    assert drive.moves == [(OTHER, None)]


AKD_TARGET = "10 001E 0002 04 0000 2710"
AKD_MOVE = ("10 0016 0002 04 0000 0000", "10 0016 0002 04 0000 0001")


def test_akd2g_moves_when_the_action_leaves_zero() -> None:
    drive = Drive("kollmorgen-akd2g")
    drive.does(AKD_TARGET, "10 0020 0002 04 0000 0000", *AKD_MOVE, AKD_MOVE[1])
    assert drive.moves == [(ABSOLUTE, 10_000)]
    assert drive.high(22) == 1
    assert drive.high(6) == 0b0000_0110 | 1
    drive.wait()
    assert drive.high(0) == 10_000
    assert drive.high(6) == 0b0000_0110 | 1 << 11


def test_akd2g_has_two_axes() -> None:
    drive = Drive("kollmorgen-akd2g", axes=2)
    drive.does("10 0050 0002 04 0000 2710", "10 0048 0002 04 0000 0001")
    assert drive.moves == [(ABSOLUTE, 10_000)]
    drive.wait()
    assert (drive.high(0), drive.high(50)) == (0, 10_000)
    assert [axis.name for axis in drive.unit.axes] == ["x", "y"]


@pytest.mark.parametrize(
    ("request_pdu", "code"),
    [
        ("06 001E 0001", "21"),  # half of MT.P0
        ("10 001F 0002 04 0001 0001", "21"),
        ("10 0000 0002 04 0000 0001", "22"),  # PL.FB
        ("10 0050 0002 04 0000 0001", "23"),  # there is no axis 2
    ],
)
def test_akd2g_does_not_report_what_it_leaves_out(request_pdu: str, code: str) -> None:
    drive = Drive("kollmorgen-akd2g")
    drive.does(AKD_TARGET, request_pdu)
    assert drive.high(30) == 10_000
    drive.unit.error_mode = 0  # type: ignore[attr-defined]
    assert drive.ask(request_pdu) == f"{int(request_pdu[:2], 16) | 0x80:02X} {code}"
