"""Oriental Motor AZ and BLV-R: direct data operation, inputs and outputs, slave errors."""

import pytest

from tests.simulator.drive_bench import ABSOLUTE, HOME, OTHER, READY, RELATIVE, STOP, Drive, ready

NAMES = ["oriental-az", "oriental-blv-r"]


def block(kind: int, position: str, trigger: str = "0000 0001") -> str:
    """Direct data from 0x0058: data number, type, position, speed, both ramps, current, trigger."""
    speeds = "0000 03E8 0000 03E8 0000 03E8 0000 03E8"
    return f"10 0058 0010 20 0000 0000 0000 {kind:04X} {position} {speeds} {trigger}"


@pytest.mark.parametrize("name", NAMES)
def test_one_frame_moves(name: str) -> None:
    drive = ready(name)
    drive.does(block(1, "0000 2710"))
    assert drive.moves == [(ABSOLUTE, 10_000)]
    assert drive.bit(0x007F, 13)
    drive.wait(0.1)
    assert drive.high(0x00C6) == drive.high(0x00CC) == drive.high(0x0120) == drive.high(0x0122) == 5_000
    drive.wait()
    assert not drive.bit(0x007F, 13)
    assert drive.high(0x00CC) == 10_000
    drive.finishes(block(2, "FFFF FFFF"))
    drive.does(block(3, "0000 0005"))
    assert drive.moves == [(RELATIVE, 9_999), (RELATIVE, 10_004)]


@pytest.mark.parametrize("name", NAMES)
def test_a_trigger_clears_itself_and_can_be_given_again(name: str) -> None:
    drive = ready(name)
    drive.does(block(1, "0000 0007"))
    assert drive.read(0x0066, 2) == [0, 0]
    drive.does("10 005C 0002 04 0000 0009")
    assert drive.moves == [(ABSOLUTE, 7)]
    drive.does("10 0066 0002 04 0000 0001")
    assert drive.moves == [(ABSOLUTE, 9)]


@pytest.mark.parametrize(("name", "trigger"), [("oriental-az", "FFFF FFFB"), ("oriental-blv-r", "0000 FFFB")])
def test_with_trigger_minus_five_each_written_position_moves(name: str, trigger: str) -> None:
    drive = ready(name)
    drive.does("10 005A 0002 04 0000 0001", f"10 0066 0002 04 {trigger}", "10 005E 0002 04 0000 0064")
    assert drive.moves == []
    drive.does("10 005C 0002 04 0000 0064", "10 005C 0002 04 0000 00C8")
    assert drive.moves == [(ABSOLUTE, 100), (ABSOLUTE, 200)]
    # Halves go out of range in between, as the manual warns.
    drive.does("06 005C 0001", "06 005D 0000")
    assert drive.moves == [(ABSOLUTE, 0x0001_00C8), (ABSOLUTE, 0x0001_0000)]


def test_continuous_operation_has_no_target() -> None:
    drive = Drive("oriental-az")
    for kind in (7, 8, 16, 17, 18):  # 8 is a wrap operation
        drive.does(block(kind, "0000 0000"))
    assert drive.moves == [(OTHER, None)] * 5
    drive = ready("oriental-blv-r")
    for kind in (7, 8, 16, 48):
        drive.does(block(kind, "0000 0000"))
    assert drive.moves == [(OTHER, None)] * 4


@pytest.mark.parametrize("name", NAMES)
def test_a_push_goes_to_a_place_or_over_a_distance(name: str) -> None:
    drive = ready(name)
    for kind in (20, 21, 22):
        drive.finishes(block(kind, "0000 0064"))
    assert drive.moves == [(ABSOLUTE, 100), (RELATIVE, 200), (RELATIVE, 300)]


@pytest.mark.parametrize(("name", "start"), [("oriental-az", "0000 0008"), ("oriental-blv-r", "0040 0001")])
def test_stored_data_run_on_a_rising_start(name: str, start: str) -> None:
    drive = ready(name)
    drive.does("10 1800 0004 08 0000 0001 FFFF FC18", f"10 007C 0002 04 {start}")
    assert drive.moves == [(ABSOLUTE, -1_000)]
    drive.does(f"10 007C 0002 04 {start}", "10 007C 0002 04 0000 0001")
    assert drive.moves == []


def test_blv_r_has_inputs_of_its_own() -> None:
    drive = ready("oriental-blv-r")
    drive.finishes("06 007C 0010", "06 007C 0000")
    drive.does("06 007C 0004", "06 007C 0000")
    drive.finishes("10 18C0 0004 08 0000 0001 0000 01F4", "06 007C 0300", "06 007C 0340")
    for stop in ("0009", "0011", "0021", "0041"):  # CLR, QSTOP, STOP, FREE
        drive.does(f"06 007D {stop}", "06 007D 0001")
    assert drive.moves == [(HOME, None), (OTHER, None), (STOP, 0), (ABSOLUTE, 500), *[(STOP, 500)] * 4]


def test_blv_r_takes_its_inputs_at_three_places() -> None:
    drive = Drive("oriental-blv-r")
    drive.finishes("06 0075 0001", block(1, "0000 2710"), "06 0079 0020")  # S-ON and STOP
    drive.finishes("06 0074 0010", "06 0074 0000")  # HOME
    drive.finishes("06 0078 0010")
    drive.does("06 0078 0010")
    assert drive.read(0x0078, 2) == [0, 0]
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 0), *[(HOME, None)] * 3]


def test_az_inputs() -> None:
    drive = Drive("oriental-az")
    drive.finishes("10 1880 0004 08 0000 0001 0000 01F4", "06 007D 000A", "06 007D 0000")  # START of No. 2
    drive.does("06 007D 0400", "06 007D 0000")  # D-SEL2
    drive.does("06 007D 1000", "06 007D 0000")  # FW-JOG-P
    drive.does("06 007D 4000", "06 007D 0000")  # FW-POS
    assert drive.moves == [(ABSOLUTE, 500), (ABSOLUTE, 500), (OTHER, None), (OTHER, None), (STOP, 500)]


@pytest.mark.parametrize("name", NAMES)
def test_stop_in_the_middle(name: str) -> None:
    drive = ready(name)
    drive.does(block(1, "0000 2710"))
    drive.wait(0.05)
    drive.does("10 007C 0002 04 0000 0021")
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]
    drive.wait()
    assert drive.ask(block(1, "0000 0001")) == "90 04"  # STOP is still on.
    drive.does("10 007C 0002 04 0000 0001", block(1, "0000 0001"))
    assert drive.moves == [(ABSOLUTE, 1)]


def test_az_homes_on_zhome() -> None:
    drive = Drive("oriental-az")
    drive.finishes(block(1, "0000 2710"))
    drive.does("10 007C 0002 04 0000 0010", "10 007C 0002 04 0000 0000")
    assert drive.read(0x0178) == [0]
    drive.wait()
    assert drive.read(0x0178) == [1]
    assert drive.high(0x00CC) == 0
    assert drive.moves == [(ABSOLUTE, 10_000), (HOME, None)]


def test_az_outputs() -> None:
    drive = Drive("oriental-az")
    assert drive.read(0x007F) == [1 << 5 | 1 << 14]
    drive.motor.mechanics.alarm = True
    assert drive.read(0x007F) == [1 << 7]
    assert drive.read(0x0080, 2) == [0, 1]
    drive.does("10 007C 0002 04 0000 0080")
    assert drive.read(0x007F) == [1 << 5 | 1 << 14]


def test_blv_r_outputs_and_its_need_for_s_on() -> None:
    drive = Drive("oriental-blv-r")
    assert drive.read(0x007F) == [1 << 4 | 1 << 9]
    assert drive.ask(block(1, "0000 0001")) == "90 04"
    drive.does(*READY["oriental-blv-r"])
    assert drive.read(0x007F) == [1 << 0 | 1 << 3 | 1 << 4 | 1 << 9]


def test_a_slave_error_does_not_mean_that_nothing_was_written() -> None:
    drive = Drive("oriental-blv-r")
    assert drive.ask(block(1, "0000 0305")) == "90 04"
    assert drive.high(0x005C) == 0x0305
    assert drive.moves == []


def test_slave_errors_can_be_hidden() -> None:
    drive = Drive("oriental-az")
    drive.unit.suppresses_slave_errors = True  # type: ignore[attr-defined]
    drive.does(block(99, "0000 0305"))
    assert drive.moves == []


def test_blv_r_that_does_not_clear_its_trigger_takes_the_same_one_only_once() -> None:
    drive = ready("oriental-blv-r")
    drive.does("10 0228 0002 04 0000 0000", block(1, "0000 0007"), block(1, "0000 0008"))
    assert drive.moves == [(ABSOLUTE, 7)]
    assert drive.read(0x0066, 2) == [0, 1]
    drive.does("10 0066 0002 04 0000 0000", block(1, "0000 0009"))
    assert drive.moves == [(ABSOLUTE, 9)]


def test_blv_r_counts_from_the_last_target_with_type_4() -> None:
    drive = ready("oriental-blv-r")
    drive.does(block(1, "0000 2710"))
    drive.wait(0.05)
    drive.does(block(4, "0000 000A"))
    assert drive.moves == [(ABSOLUTE, 10_000), (RELATIVE, 10_010)]


def test_oriental_broadcast() -> None:
    drive = Drive("oriental-az")
    assert drive.bus.answer(0, bytes.fromhex(block(1, "0000 0005")), 0.0) is None
    assert drive.moves == [(ABSOLUTE, 5)]
    assert drive.unit.response_delay_s(115200) == 0.003
