"""The running check sum, and frames that are spoilt with it: by hand, by arithmetic, for every stream."""

from hypothesis import example, given
from hypothesis import strategies as st

from gateway.modbus.crc import (
    INTACT,
    INVERTED,
    SEAM,
    append_crc,
    crc16,
    ends_a_frame,
    inverted_crc,
    is_intact,
    residue_after,
)

MAX_ADU = 256
WRITE = bytes.fromhex("01 10 6F 00 00 02 04 55 55 00 08 1A 47")
bodies = st.binary(min_size=2, max_size=MAX_ADU - 2)


def spoilt(body: bytes) -> bytes:
    return body + inverted_crc(residue_after(body))


def by_hand(residue: int, byte: int) -> int:
    """One step as Modbus over serial line V1.02, 6.2.2 has it: eight shifts with 0xA001, 0x8005 reflected."""
    residue ^= byte
    for _ in range(8):
        residue = residue >> 1 ^ 0xA001 if residue & 1 else residue >> 1
    return residue


def test_the_residue_after_each_byte_of_a_read_is_worked_out_by_hand() -> None:
    # 01 03 02 00 00 02 C5 B3. After 01: 0xFFFF ^ 01 = 0xFFFE, shifted with the polynomial: 0x807E; and so on.
    residue, found = SEAM, []
    for byte in bytes.fromhex("01 03 02 00 00 02 C5 B3"):
        residue = residue_after(bytes((byte,)), residue)
        found.append(residue)
    assert found == [0x807E, 0x2140, 0x31A1, 0xB8F0, 0x44B8, 0xB3C5, 0x00B3, 0x0000]


@given(data=st.binary(max_size=300), before=st.integers(0, 0xFFFF))
def test_a_step_is_that_of_the_standard(data: bytes, before: int) -> None:
    residue = before
    for byte in data:
        residue = by_hand(residue, byte)
    assert residue_after(data, before) == residue


@given(data=st.binary(max_size=300), cut=st.integers(0, 300))
def test_the_residue_does_not_depend_on_where_bytes_are_cut(data: bytes, cut: int) -> None:
    assert residue_after(data[cut:], residue_after(data[:cut])) == crc16(data)


@given(body=bodies)
@example(body=b"\x01\x10")
def test_a_check_sum_with_all_bits_inverted_leaves_b001_behind_whatever_stands_before_it(body: bytes) -> None:
    frame = spoilt(body)
    assert residue_after(frame) == INVERTED == 0xB001
    # One byte earlier the high byte is that of the table's last entry, 0x4040, and nothing else: the residue
    # before it has been shifted out of it.
    assert residue_after(frame[:-1]) >> 8 == 0x40
    assert not ends_a_frame(residue_after(frame[:-1]))


@given(body=bodies, behind=st.lists(bodies.map(append_crc), min_size=1, max_size=2))
def test_a_spoilt_frame_taken_together_with_good_ones_is_never_good(body: bytes, behind: list[bytes]) -> None:
    joined = spoilt(body)
    for frame in behind:
        joined += frame
        assert not is_intact(joined)


@given(before=bodies.map(append_crc), body=bodies)
def test_a_good_frame_taken_together_with_a_spoilt_one_is_never_good(before: bytes, body: bytes) -> None:
    assert not is_intact(before + spoilt(body))


def test_no_length_of_what_follows_makes_a_seam_of_a_spoilt_frame() -> None:
    # Behind 0xB001 a good frame of n bytes leaves what n zero bytes make of 0xB001 ^ 0xFFFF.
    # Two frames would be good together with it if that came to 0xFFFF, one if it came to 0.
    left = INVERTED ^ SEAM
    for _ in range(2 * MAX_ADU):
        left = by_hand(left, 0)
        assert left not in (INTACT, SEAM)


@given(body=bodies, cut=st.integers(1, MAX_ADU))
@example(body=WRITE[:-2], cut=7)
def test_the_rest_of_a_torn_frame_is_good_only_behind_a_seam(body: bytes, cut: int) -> None:
    frame = append_crc(body)
    assert is_intact(frame[cut:]) == (residue_after(frame[:cut]) == SEAM)


def test_of_65536_targets_256_are_good_one_byte_before_their_end() -> None:
    # The last data byte equals the low byte of the residue before it, and the first byte of the check sum is
    # then the high one: 1 of 256, whatever else stands in the frame. Here the low word is varied.
    head = WRITE[:7] + b"\x00\x01"
    early = sum(
        is_intact(append_crc(head + low.to_bytes(2, "big"))[:-1]) for low in range(0x10000)
    )  # fmt: skip
    assert early == 256
    inverted = sum(
        ends_a_frame(residue_after(spoilt(head + low.to_bytes(2, "big"))[:-1])) for low in range(256)
    )
    assert inverted == 0


def test_seven_heads_of_65536_could_be_taken_for_frames_if_they_were_cut_short() -> None:
    # Of FC16 with two registers, to unit id 1. A prefix of four bytes or more that is intact or a seam: each
    # of the four lengths has one address for either residue, and 00 behind an intact one keeps it intact.
    found = set()
    for address in range(0x10000):
        residue = residue_after(b"\x01\x10" + address.to_bytes(2, "big"))
        for byte in (b"\x00", b"\x02", b"\x04", b""):
            if ends_a_frame(residue):
                found.add(address)
            residue = residue_after(byte, residue)
    assert len(found) == 7
