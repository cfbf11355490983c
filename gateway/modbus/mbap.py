"""Modbus/TCP: the MBAP header and the frames of a byte stream (Messaging on TCP/IP Guide V1.0b, 3.1.3)."""

from dataclasses import dataclass
from struct import Struct
from typing import Final

from librt.strings import BytesWriter, read_i16_be, read_i32_be, write_i32_be

from gateway.modbus.errors import FrameError
from gateway.modbus.pdu import MAX_PDU, ExceptionCode, exception_pdu

HEADER: Final = Struct(">HHHB")
"""Transaction id, protocol id (0), length of the rest, unit id."""
HEADER_SIZE: Final = 7
PROTOCOL_AT: Final = 2
COUNTED_FROM: Final = 6
"""The length field counts from here: unit id and PDU."""
SHORTEST_LENGTH: Final = 2
LONGEST_LENGTH: Final = 1 + MAX_PDU
LARGEST_SENT: Final = 260
"""Longer lengths than the standard allows, which published clients and servers send: an FC16 of 124 registers
has 255, a reply of 126 registers too. Up to here a frame is too long, beyond it there is no frame."""
FUNCTION_AT: Final = 7

_unpack_header = HEADER.unpack_from

Adu = tuple[int, int, bytes]
"""Transaction id, unit id, PDU."""


def encode_mbap(transaction_id: int, unit_id: int, pdu: bytes) -> bytes:
    """Return a frame. Raises FrameError if an id or the length of the PDU is out of range.

    >>> encode_mbap(1, 255, bytes.fromhex("03 32 00 00 02")).hex(" ")
    '00 01 00 00 00 06 ff 03 32 00 00 02'
    """
    size = len(pdu)
    if not 0 < size <= MAX_PDU:
        raise FrameError(f"a PDU of {size} bytes cannot be framed: it has 1 to {MAX_PDU}")
    if not (0 <= transaction_id <= 0xFFFF and 0 <= unit_id <= 0xFF):
        raise FrameError(
            f"transaction id {transaction_id} must be in 0 … 65535, unit id {unit_id} in 0 … 255"
        )
    frame = BytesWriter()
    frame.append(transaction_id >> 8)
    frame.append(transaction_id & 0xFF)
    write_i32_be(frame, size + 1)  # the protocol id, which is 0, before it
    frame.append(unit_id)
    frame.write(pdu)
    return frame.getvalue()


@dataclass(slots=True)
class MbapCounters:
    """What a decoder received besides good frames."""

    skipped_frames: int = 0
    """Whole frames of another protocol id."""
    bad_headers: int = 0
    """Headers with an impossible length; everything from there on was dropped."""
    dropped_bytes: int = 0
    """All bytes that belong to no frame returned."""


class MbapDecoder:
    """Bytes of one connection in, frames out; for requests and replies alike. Never raises.

    TCP loses nothing. So a header with an impossible length means that the other side does not use
    Modbus/TCP, or has lost its count. The next frame cannot be found: what follows may be the data of a
    frame, and would be executed. So the decoding ends for good: ``broken_by`` is the head of that frame, and
    all further bytes are dropped and counted. The caller must close the connection.

    ``longest_length``: largest value of the length field; frames up to it are returned whole.
    """

    __slots__ = ("_buffer", "_longest", "broken_by", "counters", "transaction_id", "unit_id")

    def __init__(self, counters: MbapCounters | None = None, *, longest_length: int = LONGEST_LENGTH) -> None:
        self._buffer = b""
        self._longest = longest_length
        self.broken_by = b""
        """Header and, if there is one, function code of the impossible frame; empty: none."""
        self.counters = MbapCounters() if counters is None else counters
        self.transaction_id = self.unit_id = 0
        """Of the frame that :meth:`one` returned last."""

    def one(self, data: bytes) -> bytes:
        """Return the PDU of ``data`` if that is exactly one frame, as it nearly always is.

        Otherwise return b"" and take nothing: :meth:`feed` takes it.
        """
        size = len(data)
        if size <= HEADER_SIZE or len(self._buffer) or len(self.broken_by):
            return b""
        length = size - COUNTED_FROM
        if read_i32_be(data, PROTOCOL_AT) != length or length > self._longest:  # protocol id 0, and length
            return b""
        self.transaction_id, self.unit_id = int(read_i16_be(data, 0)) & 0xFFFF, data[6]
        return data[HEADER_SIZE:]

    def feed(self, data: bytes) -> list[Adu]:
        """Return the frames that ``data`` completes, in their order."""
        return self._split(self._buffer + data)

    @property
    def is_between_frames(self) -> bool:
        """Whether all received frames are complete."""
        return not len(self._buffer)

    def _split(self, data: bytes) -> list[Adu]:
        frames: list[Adu] = []
        start = 0
        size = len(data)
        while size - start >= COUNTED_FROM and not self.broken_by:
            length = data[start + 4] << 8 | data[start + 5]
            if not SHORTEST_LENGTH <= length <= self._longest:
                if SHORTEST_LENGTH <= length <= LARGEST_SENT and size - start <= FUNCTION_AT:
                    break  # its function code is still to come: then it can be answered
                self.broken_by = data[start : start + FUNCTION_AT + 1]
                self.counters.bad_headers += 1
                break
            end = start + COUNTED_FROM + length
            if end > size:
                break
            transaction_id, protocol_id, _, unit_id = _unpack_header(data, start)
            if protocol_id == 0:
                frames.append((transaction_id, unit_id, data[start + HEADER_SIZE : end]))
            else:
                self.counters.skipped_frames += 1
                self.counters.dropped_bytes += end - start
            start = end
        if self.broken_by:
            self.counters.dropped_bytes += size - start
            start = size
        self._buffer = data[start:]
        return frames


def answers_with(asked_id: int, answered_id: int) -> str:
    """Say what a drive does whose replies have another transaction id than their requests.

    >>> answers_with(7, 0)
    'answers, with transaction id 0 (asked with 7)'
    """
    return f"answers, with transaction id {answered_id} (asked with {asked_id})"


def too_long(head: bytes) -> Adu | None:
    r"""Return the exception for a frame of impossible length (``broken_by``); None: there is none.

    Exception 3, as from servers that read such a frame: only for lengths that clients send.

    >>> too_long(bytes.fromhex("00 02 00 00 00 FF 01 10"))
    (2, 1, b'\x90\x03')
    """
    if len(head) <= FUNCTION_AT:
        return None
    transaction_id, protocol_id, length, unit_id = _unpack_header(head)
    if protocol_id or not SHORTEST_LENGTH <= length <= LARGEST_SENT:
        return None
    return transaction_id, unit_id, exception_pdu(head[FUNCTION_AT], ExceptionCode.ILLEGAL_DATA_VALUE)
