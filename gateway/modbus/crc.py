"""The CRC of serial Modbus (Modbus over serial line V1.02, 2.5.1.2 and appendix B).

Polynomial 0x8005 reflected, start 0xFFFF, low byte first on the wire. The CRC over a frame with its own CRC
is 0. It stays 0 when zero bytes follow: so a CRC alone never proves a length.

The CRC is a running residue, which each byte advances by one step. Three residues have a meaning:

- 0: the bytes are a whole frame to a receiver that does not know the length.
- 0xFFFF, the start value of each CRC: a *seam*. The following bytes count as if they stood alone. So bytes
  with this residue, followed by a good frame, form another good frame together.
- 0xB001: the last two bytes were an inverted CRC, whatever the bytes before. The last two steps depend only
  on the difference to the right CRC, which is 0xFFFF then.
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
"""Return the residue after bytes, their CRC. A constant: no name lookup for each frame."""
SEAM: Final = 0xFFFF
"""Residue before the first byte."""
INTACT: Final = 0
"""Residue after a frame with its own CRC."""
INVERTED: Final = 0xB001
"""Residue after a frame whose CRC has all its bits inverted."""


def append_crc(data: bytes) -> bytes:
    """Return ``data`` followed by its CRC.

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
    """Whether ``frame`` ends with its own CRC. The caller must know the length from elsewhere.

    >>> is_intact(bytes.fromhex("01 06 31 00 00 0F C7 32"))
    True
    """
    return crc16(frame) == 0


def residue_after(data: bytes, before: int = SEAM) -> int:
    """Return the residue after ``data``, which follows bytes that left the residue ``before``.

    >>> begun = residue_after(bytes.fromhex("01 06 31 00"))
    >>> f"{begun:04X} {residue_after(bytes.fromhex('00 0F'), begun):04X}"  # C7 32 on the wire
    '49F4 32C7'
    """
    return modbus(data, before)


def ends_a_frame(residue: int) -> bool:
    """Whether bytes that end here can be a frame: alone, or followed by a good frame."""
    return residue in (INTACT, SEAM)


def inverted_crc(residue: int) -> bytes:
    """Return the CRC with which bytes with this residue are certainly no frame.

    After only its first byte the residue has 0x40 in its high byte, which is neither intact nor a seam.

    >>> frame = bytes.fromhex("01 06 31 00 00 0F")
    >>> spoilt = frame + inverted_crc(residue_after(frame))
    >>> spoilt.hex(" "), f"{residue_after(spoilt):04X}"
    ('01 06 31 00 00 0f 38 cd', 'B001')
    """
    return (residue ^ 0xFFFF).to_bytes(2, "little")
