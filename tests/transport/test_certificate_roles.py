"""The role in a certificate: one UTF8String in DER, and nothing else."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.transport.certificates import NoRoleError, read_role, write_role

roles = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=64)


@given(roles)
def test_what_is_written_is_read(role: str) -> None:
    assert read_role(write_role(role)) == role


@pytest.mark.parametrize(
    ("role", "der"),
    [
        ("A", "0c 01 41"),
        ("é" * 64, "0c 81 80" + "c3a9" * 64),  # 128 bytes: the length needs a byte more (X.690, 8.1.3.5)
        ("語" * 64, "0c 81 c0" + "e8aa9e" * 64),
        ("𝄞" * 64, "0c 82 0100" + "f09d849e" * 64),
    ],
)
def test_lengths_are_written_as_der_wants_them(role: str, der: str) -> None:
    assert write_role(role) == bytes.fromhex(der)
    assert read_role(bytes.fromhex(der)) == role


@pytest.mark.parametrize(
    "der",
    [
        "",
        "0c",
        "0c 00",
        "0c 02 41",  # too short
        "0c 01 41 00",  # something behind it
        "0c 81 01 41",  # BER that is no DER
        "0c 80 41 00 00",  # of indefinite length
        "13 01 41",  # PrintableString
        "30 03 0c 01 41",  # in a sequence
        "0c 01 0a",  # a line end
        "0c 01 ff",  # no UTF-8
        "0c 41" + "41" * 65,
    ],
)
def test_everything_else_is_no_role(der: str) -> None:
    with pytest.raises(NoRoleError, match="not one UTF8String"):
        read_role(bytes.fromhex(der))


@given(st.binary(max_size=80))
def test_whatever_stands_there_is_a_role_or_refused(der: bytes) -> None:
    try:
        role = read_role(der)
    except NoRoleError:
        return
    assert write_role(role) == der
