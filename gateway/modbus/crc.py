"""The check sum of serial Modbus (Modbus over serial line V1.02, 2.5.1.2 and appendix B).

Polynomial 0x8005 reflected, start 0xFFFF, low byte first on the wire. The check sum over a frame
together with its own check sum is 0. It stays 0 when zero bytes follow, so that a check sum alone never
proves a length.
"""

from fastcrc.crc16 import modbus as crc16

__all__ = ["append_crc", "crc16", "is_intact"]


def append_crc(data: bytes) -> bytes:
    """Return ``data`` with its check sum behind it.

    >>> append_crc(bytes.fromhex("01 06 31 00 00 0F")).hex(" ")
    '01 06 31 00 00 0f c7 32'
    """
    return data + crc16(data).to_bytes(2, "little")


def is_intact(frame: bytes) -> bool:
    """Whether ``frame`` ends with its own check sum. The caller knows the length from elsewhere.

    >>> is_intact(bytes.fromhex("01 06 31 00 00 0F C7 32"))
    True
    """
    return crc16(frame) == 0
