"""Modbus exceptions from drives: what they mean, and how people and programs write them."""

import re
from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import ExceptionEntry

EXCEPTIONS: Final = (
    ExceptionEntry(
        0x01,
        "illegal function",
        "the drive does not support the function code, or not in its present state",
        "a drive without FC16, FC22 or FC23, or the wrong unit id",
        "look up its function codes in the manual; `write` and `read` of the register map select one",
    ),
    ExceptionEntry(
        0x02,
        "illegal data address",
        "the drive has no such register, or the request runs past the last one",
        "addresses that the manual counts from 1 and the wire from 0, or the map of another drive",
        "compare the address with the manual, also one lower. With the gateway stopped, `pitch-gateway "
        "probe CONFIG` reads them all",
    ),
    ExceptionEntry(
        0x03,
        "illegal data value",
        "the drive refuses the value or the length of the request",
        "a value outside the register's range, or more registers than the drive takes",
        "compare the value with the limits in the manual, and the length with `max_registers`",
    ),
    ExceptionEntry(
        0x04,
        "server device failure",
        "the drive could not execute the request",
        "a drive in alarm, not enabled, or moving",
        "check the drive for alarms, and whether it may be commanded over Modbus",
        ("slave device failure",),
    ),
    ExceptionEntry(
        0x05,
        "acknowledge",
        "the drive has accepted the request and needs more time",
        "programming, such as writing parameters to non-volatile memory",
        "have the controller poll again later",
    ),
    ExceptionEntry(
        0x06,
        "server device busy",
        "the drive is busy with something longer",
        "a drive that starts, homes or saves its parameters",
        "have the controller ask again later",
        ("slave device busy", "slave or server busy", "device busy"),
    ),
    ExceptionEntry(
        0x07,
        "negative acknowledge",
        "the drive cannot do what it was programmed to; not in the standard since 2002",
        "an old controller or drive",
        "see the manual of the drive",
    ),
    ExceptionEntry(
        0x08,
        "memory parity error",
        "the drive found its memory damaged",
        "a faulty drive memory",
        "have the drive repaired",
    ),
    ExceptionEntry(
        0x0A,
        "gateway path unavailable",
        "a gateway has no path to the device; this gateway answers so if the line is down",
        "a device server without its serial port, or with an unknown unit id",
        "check the device server and the unit id",
        ("gateway path unaviable",),
    ),
    ExceptionEntry(
        0x0B,
        "gateway target device failed to respond",
        "the device behind a gateway did not answer; this gateway answers so if a drive does not",
        "power, cable or unit id of the device",
        "check the device; see `drive-silent`",
        ("target device failed to respond", "gateway no response", "gateway target device failed"),
    ),
)
"""In the order of their codes. Modbus application protocol V1.1b3, section 7; 7 of the edition before."""

TITLES: Final[Mapping[int, str]] = {entry.code: entry.title for entry in EXCEPTIONS}
"""By code."""
LIBMODBUS: Final = 112_345_678
"""libmodbus adds the exception code to this number (``MODBUS_ENOBASE``)."""
_BEFORE: Final = r"(?:modbus )?(?:exception|error|exc|ex)?(?: ?code)? ?[:=#]? ?"
_HEX: Final = re.compile(rf"{_BEFORE}(?:0x|\\x|x|\$|&h|16#)([0-9a-f]{{1,4}})|{_BEFORE}([0-9a-f]{{1,4}})h")
_PLAIN: Final = re.compile(rf"{_BEFORE}([0-9a-f]{{1,2}}|1123456[0-9]{{2}})")
_PAIR: Final = re.compile(
    rf"{_BEFORE}(?:0x|\\x|\$)?([89a-f][0-9a-f])h?[ ,:/-]*(?:0x|\\x|\$)?([0-9a-f]{{2}})h?"
)
"""Function code with bit 7 set, and the exception code, as in a frame."""


def code_in(asked: str) -> int | None:
    """Return the exception code in any of the usual spellings; None: the text is not an exception.

    >>> [code_in(asked) for asked in ("0x0B", "0b", "11", "$0B", "0Bh", "16#0B", "exception 11", "83 0B")]
    [11, 11, 11, 11, 11, 11, 11, 11]
    >>> [code_in(asked) for asked in ("ILLEGAL_DATA_ADDRESS", "slave device busy", "112345680", "0x10", "9")]
    [2, 6, 2, None, None]
    """
    text = re.sub(r"\s+", " ", asked.strip().lower())
    code = _number(text)
    if code is None:
        words = re.sub(r"[^a-z]", "", text)
        named = {re.sub(r"[^a-z]", "", n): e.code for e in EXCEPTIONS for n in (e.title, *e.aliases)}
        code = named.get(words)
    return code if code in TITLES else None


def _number(text: str) -> int | None:
    if pair := _PAIR.fullmatch(text):
        return int(pair[2], 16)
    if hexadecimal := _HEX.fullmatch(text):
        value = int(hexadecimal[1] or hexadecimal[2], 16)
        return value & 0xFF if value >> 8 & 0x80 else value  # 0x830B: as in a frame
    plain = _PLAIN.fullmatch(text)
    if plain is None:
        return None
    if not plain[1].isdecimal():
        return int(plain[1], 16)
    value = int(plain[1])
    return value - LIBMODBUS if value > LIBMODBUS else value
