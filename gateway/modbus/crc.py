"""The check sum of serial Modbus (Modbus over serial line V1.02, 2.5.1.2 and appendix B).

Polynomial 0x8005 reflected, start 0xFFFF, low byte first on the wire. The check sum over a frame
together with its own check sum is 0. It stays 0 when zero bytes follow, so that a check sum alone never
proves a length.

The check sum is a running residue, which each byte takes one step further. Three residues say something:

- 0: what stands there is a whole frame to whoever knows no length.
- 0xFFFF, where each check sum starts: a *seam*. What follows counts as if it stood alone, so that bytes with
  this residue in front of a good frame make another good one of both.
- 0xB001: a check sum came of which both bytes were inverted, whatever stands before it: the last two steps
  act on the difference to the right check sum alone, which is 0xFFFF then.
"""

from collections.abc import Callable
from typing import Final

from fastcrc.crc16 import modbus
from librt.strings import BytesWriter

__all__ = [
    "INTACT",
    "INVERTED",
    "SEAM",
    "append_crc",
    "crc16",
    "ends_a_frame",
    "inverted_crc",
    "is_intact",
    "residue_after",
]

crc16: Final[Callable[[bytes], int]] = modbus
"""Return the residue after bytes, their check sum. A constant, and no name to be looked up for each frame."""
SEAM: Final = 0xFFFF
"""Residue before the first byte."""
INTACT: Final = 0
"""Residue behind a frame with its own check sum."""
INVERTED: Final = 0xB001
"""Residue behind a frame whose check sum has all its bits inverted."""


def append_crc(data: bytes) -> bytes:
    """Return ``data`` with its check sum behind it.

    >>> append_crc(bytes.fromhex("01 06 31 00 00 0F")).hex(" ")
    '01 06 31 00 00 0f c7 32'
    """
    residue = crc16(data)
    framed = BytesWriter()
    framed.write(data)
    framed.append(residue & 0xFF)
    framed.append(residue >> 8)
    return framed.getvalue()


def is_intact(frame: bytes) -> bool:
    """Whether ``frame`` ends with its own check sum. The caller knows the length from elsewhere.

    >>> is_intact(bytes.fromhex("01 06 31 00 00 0F C7 32"))
    True
    """
    return crc16(frame) == 0


def residue_after(data: bytes, before: int = SEAM) -> int:
    """Return the residue after ``data``, which comes after bytes that left the residue ``before``.

    >>> begun = residue_after(bytes.fromhex("01 06 31 00"))
    >>> f"{begun:04X} {residue_after(bytes.fromhex('00 0F'), begun):04X}"  # C7 32 on the wire
    '49F4 32C7'
    """
    return modbus(data, before)


def ends_a_frame(residue: int) -> bool:
    """Whether bytes that end here can be a frame: by themselves, or with a good frame behind them."""
    return residue in (INTACT, SEAM)


def inverted_crc(residue: int) -> bytes:
    """Return the check sum that makes sure that bytes with this residue are no frame.

    With its first byte alone the residue has 0x40 in its high byte, which is neither intact nor a seam.

    >>> frame = bytes.fromhex("01 06 31 00 00 0F")
    >>> spoilt = frame + inverted_crc(residue_after(frame))
    >>> spoilt.hex(" "), f"{residue_after(spoilt):04X}"
    ('01 06 31 00 00 0f 38 cd', 'B001')
    """
    return (residue ^ 0xFFFF).to_bytes(2, "little")
