"""IAI and SMC: electric cylinders in 0.01 mm, with coils beside the registers."""

import pytest

from tests.simulator.drive_bench import ABSOLUTE, HOME, OTHER, READY, RELATIVE, STOP, Drive, ready

SMC_RUN = "10 9100 0001 02 0100"


def test_iai_moves_on_one_frame() -> None:
    drive = ready("iai-robo-cylinder")
    drive.does("10 9900 0007 0E 0000 2710 0000 000A 0000 2710 001E")
    assert drive.moves == [(ABSOLUTE, 10_000)]
    assert drive.read(0x9005) == [1 << 12 | 1 << 4]
    assert drive.bit(0x9007, 5)
    drive.wait()
    assert drive.high(0x9000) == 10_000
    assert drive.read(0x9005) == [1 << 12 | 1 << 4 | 1 << 3]
    assert drive.input(0x010C, 1)
    assert not drive.input(0x012A, 1)


def test_iai_starts_with_the_low_word() -> None:
    drive = ready("iai-robo-cylinder")
    drive.does("06 9900 0001")
    assert drive.moves == []
    drive.does("06 9901 0002")
    assert drive.moves == [(ABSOLUTE, 0x0001_0002)]


def test_iai_flags_hold_for_one_move() -> None:
    drive = ready("iai-robo-cylinder")
    drive.does("10 9900 0002 04 0000 0064", "06 9908 0008", "10 9900 0002 04 0000 000A")
    # From the last target, not from where the axis is.
    assert drive.moves == [(ABSOLUTE, 100), (RELATIVE, 110)]
    assert drive.read(0x9908) == [0]
    drive.does("10 9900 0002 04 0000 000A")
    assert drive.moves == [(ABSOLUTE, 10)]
    drive.does("10 9900 0009 12 0000 0001 0000 000A 0000 2710 001E 0000 0008")
    assert drive.moves == [(RELATIVE, 11)]


def test_iai_pauses_homes_and_needs_its_servo() -> None:
    drive = Drive("iai-robo-cylinder")
    drive.does("10 9900 0002 04 0000 2710")
    assert drive.moves == []
    drive.does(*READY["iai-robo-cylinder"], "10 9900 0002 04 0000 2710")
    drive.wait(0.05)
    drive.does("05 040A FF00", "10 9900 0002 04 0000 0001")
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]
    drive.does("05 040A 0000")  # It goes the rest of its way.
    assert drive.moves == [(ABSOLUTE, 10_000)]
    drive.does("05 040A FF00", "05 0407 FF00", "05 0407 0000", "05 040A 0000")  # The reset cancels the rest.
    assert drive.moves == [(STOP, 2_500)]
    drive.does("05 040B 0000", "05 040B FF00")
    assert drive.read(0x9005) == [1 << 12]
    drive.wait()
    assert drive.moves == [(HOME, None)]
    assert drive.read(0x9005) == [1 << 12 | 1 << 4 | 1 << 3]
    assert drive.high(0x9000) == 0


def test_iai_runs_stored_positions_by_their_coils() -> None:
    drive = Drive("iai-robo-cylinder")
    drive.does(*READY["iai-robo-cylinder"], "10 1020 0002 04 0000 01F4", "05 041D FF00")
    assert drive.moves == [(ABSOLUTE, 500)]
    drive.wait()
    drive.does("05 0416 FF00", "05 0416 0000")
    assert drive.moves == [(OTHER, None), (STOP, 500)]
    drive.does("06 0D03 0002", "06 0D00 1000", "06 0D00 1008")
    assert drive.moves == [(ABSOLUTE, 500)]
    drive.does("06 0D00 1000", "06 0D01 0020")  # Bit 5 is coil 0x041A: position 5.
    assert drive.moves == [(ABSOLUTE, 0)]


def test_iai_forgets_the_rest_of_its_way_when_it_is_stopped() -> None:
    drive = ready("iai-robo-cylinder")
    drive.does("10 9900 0002 04 0000 2710")
    drive.wait(0.05)
    drive.does("05 040A FF00", "05 042C FF00", "05 040A 0000")
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500), (STOP, 2_500)]
    assert not drive.input(0x042C, 1)  # It takes its coil back.


def test_iai_runs_stored_positions_by_number() -> None:
    drive = ready("iai-robo-cylinder")
    drive.does("10 1020 0002 04 0000 07D0", "06 9800 0002")
    assert drive.moves == [(ABSOLUTE, 2_000)]
    assert drive.read(0x9014) == [2]


def test_iai_is_read_in_one_go() -> None:
    drive = ready("iai-robo-cylinder")
    drive.motor.set_position(-5, 0.0)
    assert drive.read(0x9000, 10) == [0xFFFF, 0xFFFB, 0, 0, 0, 1 << 12 | 1 << 4 | 1 << 3, 0, 0, 0, 0]


def test_smc_follows_targets() -> None:
    drive = ready("smc-lec")
    drive.does("10 9102 0001 02 0001", "10 9103 0001 02 0064", "10 9104 0002 04 0000 2710", SMC_RUN)
    assert drive.moves == [(ABSOLUTE, 10_000)]
    assert drive.read(0x9100) == [0]
    assert drive.input(0x48)
    assert not drive.input(0x4B)
    drive.wait(0.1)
    assert drive.high(0x9000) == 5_000
    assert drive.high(0x9004) == 10_000
    drive.finishes("10 9104 0002 04 0000 0005", SMC_RUN)
    drive.does("10 9102 0003 06 0002 0064 FFFF", "10 9105 0001 02 FFFB", SMC_RUN)
    assert drive.moves == [(ABSOLUTE, 5), (RELATIVE, 0)]


def test_smc_homes_while_setup_is_on() -> None:
    drive = ready("smc-lec")
    drive.does("05 001C FF00")
    assert not drive.input(0x4A)
    drive.wait()
    assert drive.input(0x4A)
    drive.does("05 001C 0000", "10 9102 0004 08 0001 0064 0000 0005", SMC_RUN)
    assert drive.moves == [(HOME, None), (ABSOLUTE, 5)]


def test_smc_that_still_has_setup_gives_an_alarm() -> None:
    drive = ready("smc-lec")
    drive.finishes("05 001C FF00")
    drive.does(SMC_RUN)
    assert drive.moves == [(HOME, None)]
    assert drive.input(0x4F)
    drive.does("05 001C 0000", "0F 001B 0001 01 01", "05 001B 0000")
    assert not drive.input(0x4F)


def test_smc_runs_its_own_step_data_and_jogs() -> None:
    drive = ready("smc-lec")
    drive.does("10 0430 0004 08 0001 0064 0000 01F4", "05 0010 FF00", "05 0011 FF00", "05 001A FF00")
    assert drive.moves == [(ABSOLUTE, 500)]
    drive.wait()
    drive.does("05 001A 0000", "05 001D FF00", "05 001D 0000")
    assert drive.moves == [(OTHER, None), (STOP, 500)]


def test_smc_moves_only_in_serial_mode_with_its_servo_on() -> None:
    for missing in READY["smc-lec"]:
        drive = ready("smc-lec")
        drive.does(missing.replace("FF00", "0000"), "10 9102 0004 08 0001 0064 0000 0005", SMC_RUN)
        assert (ABSOLUTE, 5) not in drive.moves


@pytest.mark.parametrize("coil", ["001B", "0018"])
def test_smc_stops_on_reset_and_on_hold(coil: str) -> None:
    drive = ready("smc-lec")
    drive.does("10 9102 0004 08 0001 0064 0000 2710", SMC_RUN)
    drive.wait(0.05)
    drive.does(f"05 {coil} FF00", f"05 {coil} 0000")
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]
