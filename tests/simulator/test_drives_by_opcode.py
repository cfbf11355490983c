"""Makerbase, Applied Motion, StepperOnline ESS-RS, TL-R: steppers, each with its own way of starting."""

import pytest

from tests.simulator.drive_bench import ABSOLUTE, HOME, OTHER, RELATIVE, SET_POSITION, STOP, Drive


def mks_position(drive: Drive) -> int:
    high, middle, low = drive.read(0x0031, 3, function=4)
    value = high << 32 | middle << 16 | low
    return value - (1 << 48) if value >> 47 else value


def test_mks_moves_as_the_frame_says() -> None:
    drive = Drive("makerbase-servo42d")
    drive.does("10 00F5 0004 08 0002 012C 0000 2710")
    drive.wait(0.1)
    assert mks_position(drive) == 5_000
    drive.wait()
    assert mks_position(drive) == 10_000
    drive.finishes("10 00F4 0004 08 0002 012C FFFF FFFB")
    assert mks_position(drive) == 9_995
    # 3200 pulses make a turn of 16 384 counts.
    drive.finishes("10 00FE 0004 08 0002 012C FFFF F380")
    assert mks_position(drive) == -16_384
    assert drive.moves == [(ABSOLUTE, 10_000), (RELATIVE, 9_995), (ABSOLUTE, -16_384)]


@pytest.mark.parametrize(
    "stop",
    [
        "10 00F4 0004 08 0002 0000 0000 0000",
        "10 00F5 0004 08 0002 0000 0000 0000",
        "10 00F6 0002 04 0002 0000",
        "10 00FD 0004 08 0002 0000 0000 0000",
        "10 00FE 0004 08 0002 0000 0000 0000",
        "06 00F3 0000",
        "06 00F7 0001",
    ],
)
def test_mks_stops_where_the_position_of_the_frame_is_no_target(stop: str) -> None:
    drive = Drive("makerbase-servo42d")
    drive.does("10 00F5 0004 08 0002 012C 0000 2710")
    drive.wait(0.05)
    drive.does(stop)
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]


def test_mks_tells_its_state_and_its_place_in_three_ways() -> None:
    drive = Drive("makerbase-servo42d")
    drive.does("10 00FE 0004 08 0002 012C 0000 12C0")  # one turn and a half
    assert drive.read(0x00F1, function=4) == [4]
    drive.wait()
    assert drive.read(0x00F1, function=4) == [1]
    assert mks_position(drive) == 24_576
    assert drive.read(0x0030, 3, function=4) == [0, 1, 8_192]
    assert drive.read(0x0033, 2, function=4) == [0, 4_800]
    drive.does("06 0091 0001")
    assert drive.read(0x00F1, function=4) == [5]


def test_mks_homes_and_zeroes() -> None:
    drive = Drive("makerbase-servo42d")
    drive.does("10 00F5 0004 08 0002 012C 0000 2710")
    assert drive.ask("06 0092 0001") == "06 00 92 FF FF"  # It moves.
    drive.wait()
    drive.does("06 0092 0001")
    assert mks_position(drive) == 0
    drive.finishes("06 0091 0001")
    assert drive.motor.mechanics.motor_mm == pytest.approx(0.0)
    assert drive.moves == [(ABSOLUTE, 10_000), (SET_POSITION, 0), (HOME, None)]


def test_mks_obeys_a_broadcast_in_silence() -> None:
    drive = Drive("makerbase-servo42d")
    assert drive.bus.answer(0, bytes.fromhex("10 00F5 0004 08 0002 012C 0000 2710"), 0.0) is None
    assert drive.moves == [(ABSOLUTE, 10_000)]


@pytest.mark.parametrize(
    ("name", "target", "actual"),
    [("applied-motion-16", "001E", 4), ("applied-motion-32", "015E", 6), ("applied-motion-32", "015E", 10)],
)
def test_applied_motion_decides_by_the_opcode(name: str, target: str, actual: int) -> None:
    drive = Drive(name)
    drive.finishes(f"10 {target} 0002 04 0000 2710")
    assert drive.moves == []
    drive.finishes("06 007C 0067")
    assert drive.high(actual) == 10_000
    drive.does("06 007C 0066")
    drive.wait(0.05)
    drive.does("06 007C 00E2")
    assert drive.moves == [(ABSOLUTE, 10_000), (RELATIVE, 20_000), (STOP, 12_500)]
    drive.wait()
    drive.does("10 007D 0002 04 0000 000A", "06 007C 00A5")
    assert drive.high(actual) == 10
    drive.does("10 007D 0002 04 0000 0000", "06 007C 0098")
    assert drive.high(actual) == 0
    assert drive.moves == [(SET_POSITION, 10), (SET_POSITION, 0)]


@pytest.mark.parametrize(("name", "status"), [("applied-motion-16", 1), ("applied-motion-32", 3)])
def test_applied_motion_status(name: str, status: int) -> None:
    drive = Drive(name)
    assert drive.read(status) == [1 << 0 | 1 << 3]
    drive.does("06 007D 0001", "06 007E 004C", "06 007C 006E")
    assert drive.read(status) == [1 << 0 | 1 << 4 | 1 << 10]
    drive.wait()
    assert drive.read(status) == [1 << 0 | 1 << 3]
    drive.does("06 007C 009E", "06 007C 0067")
    assert drive.read(status) == [1 << 3]
    drive.does("06 007C 009F", "06 007C 0096")
    assert drive.moves == [(HOME, None), (OTHER, None)]


def test_ess_checks_its_block_before_it_runs_it() -> None:
    drive = Drive("stepperonline-ess-rs")
    drive.does("10 0021 0005 0A 0064 0064 012C 0000 1388")
    assert drive.read(0x0021, 5) == [0x64, 0x64, 0x12C, 0, 0x1388]
    drive.does("06 0027 0005")
    assert drive.moves == [(ABSOLUTE, 5_000)]
    assert drive.read(0x0007) == [0b0110]  # homed, running
    drive.wait(0.05)
    drive.finishes("06 0027 0100")
    drive.finishes("06 0027 0001")
    assert drive.moves == [(STOP, 2_500), (RELATIVE, 7_500)]
    assert drive.high(0x000A) == 7_500
    assert drive.read(0x0027) == [0]


def test_ess_has_a_bit_for_each_command() -> None:
    drive = Drive("stepperonline-ess-rs")
    drive.does("10 0024 0002 04 0000 1388", "06 0027 0005", "06 0027 0005")
    drive.finishes("10 0024 0002 04 0000 0BB8", "06 0027 000D")  # Only bit 3 interrupts.
    drive.finishes("06 002D 0012", "06 002D 0021", "06 0027 0010")
    drive.does("06 002D 0031")
    assert drive.moves == [(ABSOLUTE, 5_000), (ABSOLUTE, 3_000), (HOME, None), (SET_POSITION, 0)]
    assert drive.read(0x0007) == [0b0011]


def test_a_command_that_nobody_knows_is_told(caplog: pytest.LogCaptureFixture) -> None:
    drive = Drive("stepperonline-ess-rs")
    drive.does("06 002D 0099")
    said = "unit 1: this simulated drive does not know 0x0099 in 0x002d"
    assert list(drive.unit.ledger.unheard_of) == [said]
    assert caplog.messages == [said]


def test_ess_turns_its_words_round_on_demand() -> None:
    drive = Drive("stepperonline-ess-rs")
    drive.finishes("06 0019 0001", "10 0024 0002 04 1388 0000", "06 0027 0005")
    assert drive.moves == [(ABSOLUTE, 5_000)]
    assert drive.low(0x000A) == 5_000


def test_tl_r_starts_as_often_as_it_is_told() -> None:
    drive = Drive("tl-r")
    drive.does("06 0034 0064", "06 0035 0064", "06 0036 012C", "06 0037 0000", "06 0038 2710", "06 004E 0003")
    assert drive.moves == [(ABSOLUTE, 10_000)]
    assert drive.read(4) == [0b0110]
    drive.wait()
    assert drive.read(4) == [0b0011]
    assert drive.high(8) == 10_000
    drive.finishes("06 004E 0001")  # The start bit needs no edge.
    drive.does("06 004E 0000", "06 004E 0001")
    assert drive.moves == [(RELATIVE, 20_000), (RELATIVE, 30_000)]


def test_tl_r_takes_four_registers_and_says_nothing() -> None:
    drive = Drive("tl-r")
    drive.does("10 0034 0005 0A 0064 0064 012C 0000 2710")
    assert drive.read(52, 5) == [0x64, 0x64, 0x12C, 0, 0]


def test_tl_r_stops_homes_and_zeroes() -> None:
    drive = Drive("tl-r")
    drive.does("06 0038 2710", "06 004E 0003")
    drive.wait(0.05)
    assert drive.ask("06 004E 0000") == "06 00 4E 00 00"
    assert drive.ask("06 004E 0003") == "86 04"  # Not while it moves …
    drive.does("06 004E 0000", "06 0038 2711", "06 004E 0007")  # … but with the interrupt bit.
    drive.does("06 004E 0020")
    assert drive.moves == [(ABSOLUTE, 10_000), (ABSOLUTE, 10_001), (STOP, 2_500)]
    drive.wait()
    drive.does("06 004F 0400")
    assert drive.high(8) == 0
    drive.does("06 004E 0010")
    assert not drive.bit(4, 1)
    drive.wait()
    assert drive.bit(4, 1)
    assert drive.moves == [(SET_POSITION, 0), (HOME, None)]
