"""Positions in registers: both word orders, every type, and what a field refuses."""

import copy
import math
import pickle
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.errors import ProtocolError, RegisterDataError, RegisterFieldError
from gateway.modbus.registers import BitField, PositionField, RegisterRangeError, RegisterType, WordOrder

HIGH, LOW = WordOrder.HIGH_FIRST, WordOrder.LOW_FIRST

LIMITS = {
    RegisterType.INT16: (-(2**15), 2**15 - 1),
    RegisterType.UINT16: (0, 2**16 - 1),
    RegisterType.INT32: (-(2**31), 2**31 - 1),
    RegisterType.UINT32: (0, 2**32 - 1),
    RegisterType.INT48: (-(2**47), 2**47 - 1),
    RegisterType.INT64: (-(2**63), 2**63 - 1),
}
WHOLE = sorted(LIMITS, key=lambda kind: kind.value)


@pytest.mark.parametrize(
    ("kind", "order", "raw", "wire"),
    [
        (RegisterType.INT16, HIGH, -2, "FF FE"),
        (RegisterType.INT16, LOW, -2, "FF FE"),
        (RegisterType.UINT16, HIGH, 65534, "FF FE"),
        # Kinco: 0x00085555 and 0x001B4E82, low word first
        (RegisterType.INT32, LOW, 0x00085555, "55 55 00 08"),
        (RegisterType.INT32, LOW, 0x001B4E82, "4E 82 00 1B"),
        # Oriental AZ: stored position -1000
        (RegisterType.INT32, HIGH, -1000, "FF FF FC 18"),
        (RegisterType.INT32, LOW, -1000, "FC 18 FF FF"),
        # Makerbase: absolute coordinate 163840
        (RegisterType.INT32, HIGH, 163840, "00 02 80 00"),
        (RegisterType.UINT32, LOW, 0xFFFF0001, "00 01 FF FF"),
        (RegisterType.INT48, HIGH, 1, "00 00 00 00 00 01"),
        (RegisterType.INT48, HIGH, -2, "FF FF FF FF FF FE"),
        (RegisterType.INT48, LOW, 0x0001_0002_0003, "00 03 00 02 00 01"),
        (RegisterType.INT48, LOW, -2, "FF FE FF FF FF FF"),
        # Kollmorgen AKD: 1000000 as [0, 0, 15, 16960]
        (RegisterType.INT64, HIGH, 1_000_000, "00 00 00 00 00 0F 42 40"),
        (RegisterType.INT64, LOW, 1_000_000, "42 40 00 0F 00 00 00 00"),
        (RegisterType.FLOAT32, HIGH, 1.0, "3F 80 00 00"),
        (RegisterType.FLOAT32, LOW, -2.5, "00 00 C0 20"),
    ],
)
def test_a_value_has_these_bytes(kind: RegisterType, order: WordOrder, raw: float, wire: str) -> None:
    field = PositionField(0x0100, kind, order)
    assert field.pack(raw) == bytes.fromhex(wire)
    assert field.unpack(b"\xaa" + bytes.fromhex(wire) + b"\xbb", 1) == raw


@given(kind=st.sampled_from(WHOLE), order=st.sampled_from(WordOrder), data=st.data())
def test_integers_come_back_as_they_went(kind: RegisterType, order: WordOrder, data: st.DataObject) -> None:
    raw = data.draw(st.integers(*LIMITS[kind]))
    field = PositionField(0, kind, order)
    packed = field.pack(raw)
    assert len(packed) == 2 * field.words
    assert field.unpack(packed) == raw


@given(raw=st.floats(width=32, allow_nan=False, allow_infinity=False), order=st.sampled_from(WordOrder))
def test_single_precision_numbers_come_back_as_they_went(raw: float, order: WordOrder) -> None:
    field = PositionField(0, RegisterType.FLOAT32, order)
    assert field.unpack(field.pack(raw)) == raw


@given(kind=st.sampled_from(RegisterType), data=st.data())
def test_low_first_is_the_words_of_high_first_turned_round(kind: RegisterType, data: st.DataObject) -> None:
    raw = 1.5 if kind.is_float else data.draw(st.integers(*LIMITS[kind]))
    high = PositionField(0, kind, HIGH).pack(raw)
    words = [high[at : at + 2] for at in range(0, len(high), 2)]
    assert PositionField(0, kind, LOW).pack(raw) == b"".join(reversed(words))


@pytest.mark.parametrize("order", WordOrder)
@pytest.mark.parametrize("kind", WHOLE)
def test_a_value_beyond_the_range_is_refused_with_the_range(kind: RegisterType, order: WordOrder) -> None:
    smallest, largest = LIMITS[kind]
    field = PositionField(0, kind, order)
    for raw in (smallest - 1, largest + 1):
        with pytest.raises(RegisterRangeError) as caught:
            field.pack(raw)
        for part in (str(raw), kind.value, str(smallest), str(largest)):
            assert part in str(caught.value)


@pytest.mark.parametrize("kind", RegisterType)
@pytest.mark.parametrize("raw", [True, False, math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_refused(kind: RegisterType, raw: float) -> None:
    with pytest.raises(RegisterRangeError, match=kind.value):
        PositionField(0, kind).pack(raw)


def test_a_fraction_is_refused_by_an_integer() -> None:
    with pytest.raises(RegisterRangeError, match=r"3\.5 does not fit int32"):
        PositionField(0, RegisterType.INT32).pack(3.5)


@pytest.mark.parametrize("raw", [3.5e38, -3.5e38, 10**40])
def test_a_float_that_would_become_infinite_is_refused(raw: float) -> None:
    with pytest.raises(RegisterRangeError, match="float32"):
        PositionField(0, RegisterType.FLOAT32).pack(raw)


def test_the_largest_float_fits() -> None:
    largest = struct.unpack(">f", bytes.fromhex("7F 7F FF FF"))[0]
    assert PositionField(0, RegisterType.FLOAT32).pack(largest) == bytes.fromhex("7F 7F FF FF")


@pytest.mark.parametrize("order", WordOrder)
@pytest.mark.parametrize("kind", RegisterType)
def test_too_few_bytes_are_named(kind: RegisterType, order: WordOrder) -> None:
    field = PositionField(0, kind, order)
    with pytest.raises(RegisterDataError, match=kind.value):
        field.unpack(bytes(2 * field.words), 1)


@pytest.mark.parametrize("address", [-1, 0xFFFF, 0x10000])
def test_a_field_must_lie_within_the_address_space(address: int) -> None:
    with pytest.raises(RegisterFieldError, match=str(address)):
        PositionField(address, RegisterType.INT32)


def test_a_field_may_end_with_the_address_space() -> None:
    assert PositionField(0xFFFE, RegisterType.INT32).end == 0x10000


@pytest.mark.parametrize("scale", [0.0, math.nan, math.inf])
def test_a_scale_must_be_a_factor(scale: float) -> None:
    with pytest.raises(RegisterFieldError, match="scale"):
        PositionField(0, RegisterType.INT32, scale=scale)


@pytest.mark.parametrize(("address", "bit"), [(-1, 0), (0x10000, 0), (0, -1), (0, 16)])
def test_a_bit_must_exist(address: int, bit: int) -> None:
    with pytest.raises(ProtocolError):
        BitField(address, bit)


def test_bit_0_is_the_least_significant() -> None:
    assert [bit for bit in range(16) if BitField(0x1003, bit).is_set(0x8031)] == [0, 4, 5, 15]


def test_fields_are_equal_by_value_and_survive_copying() -> None:
    field = PositionField(0x3700, RegisterType.INT32, LOW, scale=0.1)
    assert field == PositionField(0x3700, RegisterType.INT32, LOW, scale=0.1)
    assert len({field, copy.deepcopy(field), pickle.loads(pickle.dumps(field))}) == 1
    assert pickle.loads(pickle.dumps(field)).pack(-1) == b"\xff" * 4
