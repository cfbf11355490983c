"""One RTU frame while it arrives: its bytes so far, and what they show.

The decoders (``rtu_requests``, ``rtu_replies``) return whole frames, and search for the next good one after
damage. This file follows an incomplete frame instead, from its first byte to its last. It begins after a
silence of its line. Bytes that belong to no frame, or to another one, make it ``ODD``.
"""

from enum import Enum
from typing import Final

from gateway.modbus.crc import INTACT, SEAM, residue_after
from gateway.modbus.lengths import NEEDS_MORE, UNTIL_SILENCE, asked_bytes, reply_length, request_length
from gateway.modbus.pdu import FunctionCode


class Progress(Enum):
    """What the bytes so far show."""

    __hash__ = object.__hash__

    BEGUN = "begun"
    """The length of the frame is unknown."""
    HEAD = "head"
    """All but its data: its length, and the registers of a request."""
    GOOD = "good"
    """It is complete, and its CRC is right."""
    BAD = "bad"
    """It has its full length, and its CRC is wrong."""
    ODD = "odd"
    """It cannot be followed: its bytes do not show its length, or it is not the expected reply."""


BLOCK_HEAD: Final = 7
"""Bytes of a frame that writes a block, before its data: unit id, function, address, count, byte count."""
REGISTERS_HEAD: Final = 6
"""Bytes that name registers: unit id, function, address, count."""
REQUEST_HEADS: Final = {
    FunctionCode.READ_COILS: REGISTERS_HEAD,
    FunctionCode.READ_DISCRETE_INPUTS: REGISTERS_HEAD,
    FunctionCode.READ_HOLDING_REGISTERS: REGISTERS_HEAD,
    FunctionCode.READ_INPUT_REGISTERS: REGISTERS_HEAD,
    FunctionCode.WRITE_MULTIPLE_COILS: BLOCK_HEAD,
    FunctionCode.WRITE_MULTIPLE_REGISTERS: BLOCK_HEAD,
}
"""By function code: bytes of the head of a request. Others are not followed."""


class RequestArrival:
    """A request while it arrives. Its progress depends on its bytes only, however they are split.

    >>> arrival = RequestArrival()
    >>> for piece in ("01 03 02 00 00", "02", "C5 B3 01"):
    ...     print(arrival.feed(bytes.fromhex(piece)), arrival.progress.value, arrival.length)
    5 begun 8
    1 head 8
    2 good 8
    """

    __slots__ = ("data", "length", "progress", "residue")

    def __init__(self) -> None:
        self.data = b""
        """The bytes so far."""
        self.progress = Progress.BEGUN
        self.length = 0
        """Its full length, with unit id and CRC; 0: not known yet, or never."""
        self.residue = SEAM
        """CRC residue after the bytes so far."""

    @property
    def is_over(self) -> bool:
        """Whether its progress is final."""
        return self.progress in (Progress.GOOD, Progress.BAD, Progress.ODD)

    def feed(self, data: bytes) -> int:
        """Take the bytes that belong to it; return their number. The next byte begins another frame."""
        taken = 0
        while taken < len(data) and not self.is_over:
            # Up to the next byte that shows more: one at a time until the length is known.
            needed = (self.length or len(self.data) + 1) - len(self.data)
            piece = data[taken : taken + needed]
            self.data += piece
            self.residue = residue_after(piece, self.residue)
            taken += len(piece)
            self._update()
        return taken

    def _update(self) -> None:
        length = self._stated_length()
        if length < NEEDS_MORE:
            self.progress, self.length = Progress.ODD, 0
        elif length and len(self.data) >= length:
            self.length = length
            self.progress = Progress.GOOD if self.residue == INTACT else Progress.BAD
        elif length:
            self.length = length
            if len(self.data) >= self._head_bytes():
                self.progress = Progress.HEAD

    def _stated_length(self) -> int:
        if len(self.data) >= 2 and self.data[1] not in REQUEST_HEADS:
            return UNTIL_SILENCE
        return request_length(self.data)

    def _head_bytes(self) -> int:
        return REQUEST_HEADS[FunctionCode(self.data[1])]


class ReplyArrival(RequestArrival):
    """The reply to a request while it arrives. Only the expected reply is followed (W4).

    An exception, the reply of another unit id or function, and another number of bytes than requested are
    ODD: they are passed on whole.

    >>> arrival = ReplyArrival(1, bytes.fromhex("03 02 00 00 02"))
    >>> for piece in ("01 03", "04", "00 B1 1F 40 A3 D4"):
    ...     print(arrival.feed(bytes.fromhex(piece)), arrival.progress.value, arrival.length)
    2 begun 0
    1 head 9
    6 good 9
    """

    __slots__ = ("_asked", "_request", "_unit_id")

    def __init__(self, unit_id: int, request_pdu: bytes) -> None:
        super().__init__()
        self._unit_id = unit_id
        self._request = request_pdu
        self._asked = asked_bytes(request_pdu)

    def _stated_length(self) -> int:
        data = self.data
        if data[0] != self._unit_id:
            return UNTIL_SILENCE
        if len(data) >= 2 and (data[1] != self._request[0] or data[1] not in REQUEST_HEADS):
            return UNTIL_SILENCE
        if len(data) >= 3 and self._asked is not None and data[2] != self._asked:
            return UNTIL_SILENCE
        return reply_length(self._request, data)

    def _head_bytes(self) -> int:
        return 2 if self._asked is None else 3
