"""What the simulated wire hears, and what no drive has heard of."""

import pytest

from gateway.modbus.crc import append_crc, inverted_crc, is_intact, residue_after
from gateway.simulator.ears import Hearing, TimedByte, Uart
from tests.simulator.drive_bench import Drive

BAUD, BITS = 1000, 10
CHAR_NS = 10_000_000  # 10 ms a byte: t1.5 is 15 ms, t3.5 35 ms
MS = 1_000_000
WRITE = append_crc(bytes.fromhex("01 10 6F 00 00 02 04 55 55 00 08"))
READ = append_crc(bytes.fromhex("01 03 02 00 00 03"))
ALL = tuple(Hearing)


def heard(uart: Uart, *pieces: tuple[int, bytes]) -> list[bytes]:
    """Let pieces come, each after a pause of the wire in ns; return the frames, the last one by silence."""
    frames = []
    at_ns = 0
    for pause_ns, piece in pieces:
        at_ns += pause_ns
        for byte in piece:
            at_ns += CHAR_NS
            frames.append(uart.receive(TimedByte(at_ns, byte)))
    frames.append(uart.take(at_ns + 1000 * MS))
    return [frame for frame in frames if frame]


@pytest.mark.parametrize("hearing", ALL)
def test_every_kind_takes_a_good_frame(hearing: Hearing) -> None:
    assert heard(Uart(hearing, BAUD, BITS), (0, WRITE)) == [WRITE]


@pytest.mark.parametrize("hearing", ALL)
def test_a_silence_of_three_and_a_half_characters_lies_between_two_frames(hearing: Hearing) -> None:
    assert heard(Uart(hearing, BAUD, BITS), (0, WRITE), (35 * MS, READ)) == [WRITE, READ]


def test_a_pause_of_one_and_a_half_characters_breaks_a_frame_in_a_drive_of_the_standard() -> None:
    uart = Uart(Hearing.STANDARD, BAUD, BITS)
    assert heard(uart, (0, WRITE[:7]), (15 * MS, WRITE[7:])) == [WRITE]
    uart = Uart(Hearing.STANDARD, BAUD, BITS)
    assert heard(uart, (0, WRITE[:7]), (15 * MS + 1, WRITE[7:])) == []
    assert (uart.frames_broken, uart.frames_odd) == (1, 0)


@pytest.mark.parametrize("hearing", [Hearing.ANY_LENGTH, Hearing.MERGING, Hearing.NO_CHECK])
def test_the_others_wait_for_the_end_of_it(hearing: Hearing) -> None:
    assert heard(Uart(hearing, BAUD, BITS), (0, WRITE[:7]), (34 * MS, WRITE[7:])) == [WRITE]


def test_above_19200_baud_both_times_are_fixed() -> None:
    # A character of 11 bits takes 95 µs; t1.5 is 750 µs and t3.5 1.75 ms all the same.
    char_ns = 95_486
    for pause_ns, frames in ((750_000, [WRITE]), (750_001, [])):
        uart = Uart(Hearing.STANDARD, 115_200)
        for index, byte in enumerate(WRITE):
            uart.receive(TimedByte(index * char_ns + (pause_ns if index >= 5 else 0), byte))
        last_ns = 12 * char_ns + pause_ns
        assert uart.deadline_ns == last_ns + 1_750_000 + char_ns
        assert [each for each in [uart.take(uart.deadline_ns)] if each] == frames


# A write whose bytes 0 to 10 end with a good check sum of their own: cut short by two it is intact.
SHORT = append_crc(bytes.fromhex("01 10 6F 00 00 02 04 55 55"))
"""11 bytes, intact, and two too few of what its head counts."""


def test_who_looks_at_no_length_obeys_a_frame_that_was_cut_short_with_what_its_buffer_held() -> None:
    uart = Uart(Hearing.ANY_LENGTH, BAUD, BITS)
    assert is_intact(SHORT)
    # Bytes 11 and 12 are those of the frame before: its check sum.
    assert heard(uart, (0, WRITE), (40 * MS, SHORT)) == [WRITE, SHORT + WRITE[11:]]
    uart = Uart(Hearing.STANDARD, BAUD, BITS)
    assert heard(uart, (0, WRITE), (40 * MS, SHORT)) == [WRITE]
    assert (uart.frames_odd, uart.damaged) == (1, SHORT)


def test_who_merges_takes_what_is_nearer_than_10_ms_for_one() -> None:
    # At 115 200 baud the standard has two frames after 1.75 ms.
    for hearing, frames in ((Hearing.ANY_LENGTH, [WRITE, READ]), (Hearing.MERGING, [])):
        uart = Uart(hearing, 115_200)
        got = [
            uart.receive(TimedByte(index * 95_486 + (9 * MS if index >= 13 else 0), byte))
            for index, byte in enumerate(WRITE + READ)
        ]
        got.append(uart.take(1000 * MS))
        assert [each for each in got if each] == frames
    # A piece that leaves the residue 0xFFFF is a seam: with the next frame it is one, and obeyed.
    seam = bytes.fromhex("01 10 56 F9")
    assert residue_after(seam) == 0xFFFF
    joined = seam + WRITE
    assert is_intact(joined)
    uart = Uart(Hearing.MERGING, BAUD, BITS)
    # Address 0x56F9, 0x0110 registers, 0x6F bytes: the head that it reads says 120 bytes, the rest is old.
    assert heard(uart, (0, seam), (9 * MS, WRITE)) == [joined + bytes(9 + 0x6F - len(joined))]


def test_who_checks_no_check_sum_obeys_what_is_spoilt() -> None:
    spoilt = WRITE[:-2] + inverted_crc(residue_after(WRITE[:-2]))
    assert heard(Uart(Hearing.NO_CHECK, BAUD, BITS), (0, spoilt)) == [spoilt]
    for hearing in (Hearing.STANDARD, Hearing.ANY_LENGTH, Hearing.MERGING):
        assert heard(Uart(hearing, BAUD, BITS), (0, spoilt)) == []


@pytest.mark.parametrize("hearing", ALL)
def test_less_than_four_bytes_and_more_than_256_are_no_frame(hearing: Hearing) -> None:
    uart = Uart(hearing, BAUD, BITS)
    assert heard(uart, (0, WRITE[:3])) == []
    assert heard(uart, (0, bytes(257))) == []
    assert (uart.frames_odd, uart.frames_broken) == (1, 1)


@pytest.mark.parametrize("hearing", [Hearing.STANDARD, Hearing.ANY_LENGTH, Hearing.MERGING])
def test_a_frame_of_a_vendor_ends_by_silence(hearing: Hearing) -> None:
    vendor = append_crc(bytes.fromhex("01 65 00 01 02"))
    assert heard(Uart(hearing, BAUD, BITS), (0, vendor)) == [vendor]


# What neither profile nor simulated drive knows moves nothing, and is told loudly.


def cmmt(control: int, kind: int, target: int) -> str:
    """Return an image of telegram 111: STW1, POS_STW1, the target low word first."""
    words = (control, kind, 0, 0, 0, target, 0)
    return "10 0000 0007 0E " + " ".join(f"{word:04X}" for word in words)


@pytest.mark.parametrize(
    ("name", "frames", "told"),
    [
        ("smc-lec", ("05 0019 FF00", "05 0030 FF00", "10 9100 0001 02 1000"), "0x1000 in 0x9100"),
        ("tl-r", ("06 004E 0080",), "0x0080 in 0x004e"),
        ("oriental-az", ("06 0067 0002",), "0x0002 in 0x0067"),
        ("oriental-blv-r", ("06 007D 0001", "06 0067 0014"), "0x0014 in 0x0067"),  # 1 to 19 start
        ("festo-cmmt-111", (cmmt(0x043F, 0x8000, 1), cmmt(0x043F, 0x9000, 2)), "0x9000 in 0x0001"),
        ("festo-cmmt-111", (cmmt(0x043F, 0x0100, 1), cmmt(0x043F, 0x1100, 2)), "0x1100 in 0x0001"),
        (
            "festo-cmmo-fhpp",
            ("10 0000 0004 08 4301 0000 0000 0000", "10 0000 0004 08 4303 0800 0000 0064"),
            "0x0800 in 0x0001",
        ),
    ],
)
def test_unknown_frames_are_told(
    name: str, frames: tuple[str, ...], told: str, caplog: pytest.LogCaptureFixture
) -> None:
    drive = Drive(name)
    drive.does(*frames)
    assert drive.moves == []
    [said] = drive.unit.ledger.unheard_of
    assert told in said
    assert caplog.messages == [said]
