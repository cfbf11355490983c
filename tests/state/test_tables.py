"""A compiled table: everything in it survives, and nothing damaged is ever taken."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.state.tables import HEADER_BYTES, WrongTableError, checked, compiled, digest_of, mapped


def table_of_3() -> CorrectionTable:
    return make_table([0.0, 1.0, 3.0], [0.0, 0.01, 0.02], [0.0, -0.01, 0.03], Units.MM)


def test_a_compiled_table_is_24_bytes_a_point_behind_its_header() -> None:
    table = table_of_3()
    data = compiled(table)
    assert len(data) == HEADER_BYTES + 3 * 24
    points = struct.unpack("=9d", data[HEADER_BYTES:])
    assert points == (0.0, 1.0, 3.0, 0.0, 0.01, 0.02, 0.0, -0.01, 0.03)
    found = mapped(memoryview(data))
    assert found == table
    assert found.facts == table.facts
    assert found.digest == digest_of(data)
    assert isinstance(found.positions, memoryview)
    assert compiled(found) == data


def test_a_table_of_one_direction_has_one_branch_in_memory() -> None:
    found = checked(compiled(make_table([0.0, 1.0], [0.0, 0.01], [0.0, 0.01], Units.INCH)))
    assert found.forward is found.backward
    assert found.units is Units.INCH
    assert found.even_step == 1.0


@given(st.integers(0, HEADER_BYTES + 72), st.integers(1, 255))
def test_a_table_with_a_wrong_byte_is_refused(place: int, change: int) -> None:
    data = bytearray(compiled(table_of_3()))
    if place == len(data):
        data += b"x"
    else:
        data[place] ^= change
    with pytest.raises(WrongTableError):
        checked(bytes(data))


@given(st.binary(max_size=400))
def test_any_bytes_are_a_table_or_refused(data: bytes) -> None:
    with pytest.raises(WrongTableError):
        mapped(memoryview(data))


def test_what_is_wrong_with_a_table_is_said() -> None:
    data = compiled(table_of_3())
    for bad, said in (
        (data[:10], "10 bytes are no compiled table"),
        (b"x" * 200, "it begins with b'xxxxxxxx'"),
        (data[:-8], f"{len(data) - 8} bytes for 3 points, which take {len(data)}"),
        (data[:8] + struct.pack("=I", 2) + data[12:], "of version 2; this release has version 1"),
    ):
        with pytest.raises(WrongTableError, match=said):
            mapped(memoryview(bad))
