"""Leadshine and Delta: targets are staged in paths, a trigger register runs them."""

import pytest

from tests.simulator.drive_bench import ABSOLUTE, HOME, OTHER, RELATIVE, SET_POSITION, STOP, Drive

LEADSHINES = ["leadshine-pr", "leadshine-el7"]
ONE_FRAME = "10 6200 0008 10 0001 0000 2710 0258 0032 0032 0000 0010"
"""Absolute to 10 000 at 600 rpm, started by the last register."""
ONE_FRAME_RELATIVE = "10 6200 0008 10 0041 FFFF FF9C 0258 0032 0032 0000 0010"
"""By -100."""


@pytest.mark.parametrize("name", LEADSHINES)
def test_leadshine_moves_on_one_frame(name: str) -> None:
    drive = Drive(name)
    drive.does(ONE_FRAME)
    assert drive.moves == [(ABSOLUTE, 10_000)]
    drive.wait(0.1)  # Half-way: 0.1 s of speeding up to 100 mm/s.
    assert drive.high(0x602A) == drive.high(0x602C) == 5_000
    assert drive.high(0x1012) == drive.high(0x1014) == 5_000
    assert drive.read(0x6002) == [0x0100]
    drive.wait()
    assert drive.high(0x602C) == 10_000
    assert drive.read(0x6002) == drive.read(0x6207) == [0x0000]
    drive.does(ONE_FRAME_RELATIVE)
    assert drive.moves == [(RELATIVE, 9_900)]


@pytest.mark.parametrize("name", LEADSHINES)
def test_leadshine_takes_halves_and_waits_for_the_trigger(name: str) -> None:
    drive = Drive(name)
    drive.finishes(
        "06 6200 0001", "06 6201 FFFF", "06 6202 FC18", "06 6203 0064", "06 6204 0032", "06 6205 0032"
    )
    assert drive.moves == []
    assert drive.high(0x6201) == -1_000
    drive.does("06 6002 0010")
    assert drive.moves == [(ABSOLUTE, -1_000)]


def test_leadshine_runs_any_of_sixteen_paths() -> None:
    drive = Drive("leadshine-pr")
    drive.does("10 6278 0003 06 0001 0000 0BB8", "10 6208 0003 06 0002 0000 0BB8", "06 6002 001F")
    assert drive.moves == [(ABSOLUTE, 3_000)]
    assert drive.read(0x6002) == [0x010F]
    drive.wait()
    assert drive.read(0x6002) == [0x000F]
    drive.does("06 6002 0011")  # Path 1 is one of velocity: its position is no target.
    drive.does("06 6002 0012")  # Path 2 has no mode.
    assert drive.moves == [(OTHER, None)]


def test_leadshine_stops_in_the_middle_and_goes_on() -> None:
    drive = Drive("leadshine-pr")
    drive.does(ONE_FRAME)
    drive.wait(0.1)
    drive.does("06 6002 0040")
    # 100 mm/s at half-way needs 5 mm to stop: just the way that is left.
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 10_000)]
    assert drive.read(0x6002) == [0x0040]
    drive.wait()
    assert drive.read(0x6002) == [0x0000]
    drive.does("10 6200 0008 10 0001 0000 0000 0258 0032 0032 0000 0010")
    drive.wait(0.05)
    drive.does("06 6002 0040")
    # 1000 mm/s² for 0.05 s: 1.25 mm and 50 mm/s, and 1.25 mm to brake.
    assert drive.moves == [(ABSOLUTE, 0), (STOP, 7_500)]


def test_leadshine_state_bits() -> None:
    drive = Drive("leadshine-pr")
    assert drive.read(0x1003) == [0b111_0010]
    drive.does(ONE_FRAME)
    assert drive.read(0x1003) == [0b100_0110]
    drive.wait()
    drive.does("06 6002 0020")
    assert drive.read(0x1003) == [0b000_0110]
    assert drive.read(0x6002) == [0x0020]
    drive.wait()
    assert drive.read(0x1003) == [0b111_0010]
    assert drive.moves == [(ABSOLUTE, 10_000), (HOME, None)]
    drive.motor.mechanics.alarm = True
    assert drive.read(0x1003) == [0b100_0001]
    drive.does(ONE_FRAME)
    assert drive.moves == []
    drive.does("06 1801 1111", ONE_FRAME)
    assert drive.moves == [(ABSOLUTE, 10_000)]


def test_el7_shows_its_state_elsewhere() -> None:
    drive = Drive("leadshine-el7")
    assert drive.read(0x0B05) == [0b1_1011]  # ready, on, homed, in position
    drive.does("06 6002 0020")
    assert drive.read(0x0B05) == [0b0_0011]
    assert drive.read(0x1003) == [0]


@pytest.mark.parametrize("name", LEADSHINES)
def test_leadshine_zero_renames_the_place(name: str) -> None:
    drive = Drive(name)
    drive.finishes(ONE_FRAME)
    drive.does("06 6002 0021")
    assert drive.high(0x602A) == drive.high(0x602C) == 0
    drive.finishes(ONE_FRAME_RELATIVE)
    assert drive.moves == [(ABSOLUTE, 10_000), (SET_POSITION, 0), (RELATIVE, -100)]
    assert drive.motor.mechanics.motor_mm == pytest.approx(9.9)


def test_leadshine_homing_finds_the_switch_again_after_a_zero() -> None:
    drive = Drive("leadshine-pr")
    drive.finishes(ONE_FRAME)
    drive.finishes("06 6002 0021", "06 6002 0020")
    assert drive.high(0x602C) == 0
    assert drive.motor.mechanics.motor_mm == pytest.approx(0.0)


def test_leadshine_proxies_lead_to_other_registers() -> None:
    drive = Drive("leadshine-pr")
    drive.finishes(ONE_FRAME, "06 0F10 602C", "06 0F11 602D", "06 0F12 6002")
    assert drive.high(0x0F00) == 10_000
    drive.does("06 0F02 0021")
    assert drive.moves[-1] == (SET_POSITION, 0)


def test_leadshine_save_state_is_gone_once_it_is_read() -> None:
    drive = Drive("leadshine-pr")
    drive.does("06 1801 2211")
    assert drive.read(0x1901) == [0x5555]
    assert drive.read(0x1901) == [0]


@pytest.mark.parametrize(("baudrate", "total_ms"), [(9600, 24.9), (38400, 7.12), (115200, 3.08)])
def test_leadshine_thinks_for_what_the_manual_says_without_the_wire(baudrate: int, total_ms: float) -> None:
    drive = Drive("leadshine-pr")
    wire_ms = 17 * 10 * 1000 / baudrate  # 8 characters of request, 9 of reply, 10 bits each.
    assert drive.unit.response_delay_s(baudrate) * 1000 + wire_ms == pytest.approx(total_ms)
    assert drive.bus.response_delay_s(2, baudrate) == 0


@pytest.mark.parametrize("trigger", ["06 050E 0001", "10 050E 0002 04 0001 0000"])
def test_delta_runs_path_1(trigger: str) -> None:
    drive = Drive("delta-asda")
    drive.finishes("06 023C 0005", "10 0606 0002 04 86A0 0001")  # 100 000 = 0x0001_86A0, the low word first.
    assert drive.moves == []
    drive.does(trigger)
    assert drive.moves == [(ABSOLUTE, 100_000)]
    assert drive.read(0x050E) == [10_001]
    assert not drive.bit(0x005C, 4)
    drive.wait()
    assert drive.read(0x050E) == [20_001]
    assert drive.bit(0x005C, 4)
    assert drive.low(0x0520) == drive.low(0x0012) == 100_000


@pytest.mark.parametrize(
    ("definition", "move"),
    [
        ("0012", (ABSOLUTE, 100)),  # INS
        ("1132", (ABSOLUTE, 100)),  # INS, OVLP and ramps
        ("0052", (RELATIVE, 5_000 + 100)),  # from where it is
        ("0092", (RELATIVE, 10_000 + 100)),  # from the last target
    ],
)
def test_delta_counts_from_what_bits_6_and_7_say(definition: str, move: object) -> None:
    drive = Drive("delta-asda")
    drive.does("10 0606 0002 04 2710 0000", "06 050E 0001")
    drive.wait(0.1)  # Half of it.
    assert drive.moves == [(ABSOLUTE, 10_000)]
    drive.does(f"10 0608 0002 04 {definition} 0000", "10 060A 0002 04 0064 0000", "06 050E 0002")
    assert drive.moves == [move]


def test_delta_says_that_a_definition_is_not_known(caplog: pytest.LogCaptureFixture) -> None:
    drive = Drive("delta-asda")
    drive.does("10 0604 0002 04 00C2 0000", "06 050E 0001")
    assert drive.moves == []
    assert "0x00c2 in 0x0604" in caplog.text


def test_delta_takes_the_place_where_it_stands_for_its_origin() -> None:
    drive = Drive("delta-asda")
    drive.finishes("10 0606 0002 04 2710 0000", "06 050E 0001")
    drive.does("06 0508 0008", "06 050E 0000")
    assert drive.moves == [(ABSOLUTE, 10_000), (SET_POSITION, 0)]
    assert drive.low(0x0520) == 0


def test_delta_builds_the_origin_of_its_encoder_once_it_is_unlocked() -> None:
    drive = Drive("delta-asda")
    drive.finishes("10 0606 0002 04 2710 0000", "06 050E 0001")
    drive.does("06 028E 0001")
    assert drive.moves == [(ABSOLUTE, 10_000)]
    drive.does("06 0210 010F", "06 028E 0001")  # 271
    assert drive.moves == [(SET_POSITION, 0)]
    assert drive.low(0x0520) == 0


def test_delta_stops_and_homes() -> None:
    drive = Drive("delta-asda")
    drive.does("10 0606 0002 04 2710 0000", "06 050E 0001")
    drive.wait(0.05)
    drive.does("06 050E 03E8")
    # 1.25 mm until then and 1.25 mm to brake.
    assert drive.moves == [(ABSOLUTE, 10_000), (STOP, 2_500)]
    drive.wait()
    drive.does("06 050E 0000")
    assert not drive.bit(0x005C, 8)
    drive.wait()
    assert drive.bit(0x005C, 8)
    assert drive.low(0x0520) == 0
    assert drive.moves == [(HOME, None)]
    assert drive.read(0x050E) == [20_000]


def test_delta_keeps_silent_before_each_frame() -> None:
    assert Drive("delta-asda").unit.response_delay_s(115200) == 0.010
