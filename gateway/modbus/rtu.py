"""RTU framing (Modbus over serial line V1.02): the frames are built here, and the two decoders are named."""

from typing import Final

from gateway.modbus.crc import append_crc
from gateway.modbus.errors import FrameError
from gateway.modbus.pdu import MAX_PDU
from gateway.modbus.rtu_line import Frame, RtuCounters, silence_ns
from gateway.modbus.rtu_replies import RtuReplyDecoder
from gateway.modbus.rtu_requests import RtuRequestDecoder

__all__ = ["Frame", "RtuCounters", "RtuReplyDecoder", "RtuRequestDecoder", "encode_rtu", "silence_ns"]

_UNIT_IDS: Final = tuple(bytes((unit_id,)) for unit_id in range(0x100))


def encode_rtu(unit_id: int, pdu: bytes) -> bytes:
    """Return a frame with its CRC. Raises FrameError if unit id or length of the PDU is out of range.

    >>> encode_rtu(1, bytes.fromhex("06 31 00 00 0F")).hex(" ")
    '01 06 31 00 00 0f c7 32'
    """
    if not 0 < len(pdu) <= MAX_PDU:
        raise FrameError(f"a PDU of {len(pdu)} bytes cannot be framed: it has 1 to {MAX_PDU}")
    if not 0 <= unit_id <= 0xFF:
        raise FrameError(f"unit id {unit_id} must be in 0 … 255")
    return append_crc(_UNIT_IDS[unit_id] + pdu)
