"""The length of an RTU frame, from its first bytes (Modbus application protocol V1.1b3, section 6).

Silence does not end frames reliably when an operating system and USB adapters are between the wire and the
program. So a frame ends where its own bytes say. There is one rule for each function code. Codes without a
rule (43/13 for CANopen, the user-defined 65 to 72 and 100 to 110, all others) can only end by silence.

A length is the number of bytes with unit id and CRC, or one of the three constants below. It is a prediction:
the CRC decides.
"""

from collections.abc import Mapping
from typing import Final

from gateway.modbus.pdu import EXCEPTION_BIT, MEI_READ_DEVICE_IDENTIFICATION, FunctionCode

NEEDS_MORE: Final = 0
"""The length is not known yet."""
UNTIL_SILENCE: Final = -1
"""The length never becomes known: the frame ends with a silence."""
NO_FRAME: Final = -2
"""No frame begins like this: function code 0, or longer than a frame may be."""

MIN_ADU: Final = 4
"""Unit id, function code, CRC."""
MAX_ADU: Final = 256
EXCEPTION_ADU: Final = 5
ADU_OVERHEAD: Final = 3
"""The bytes of an RTU frame besides its PDU: unit id and CRC."""


class Rule:
    """``base`` bytes plus the value of the byte at offset ``counted_at``; 0: no such byte."""

    __slots__ = ("_base", "_counted_at")

    def __init__(self, base: int = 0, *, counted_at: int = 0) -> None:
        self._base = base
        self._counted_at = counted_at

    def length(self, data: bytes, start: int) -> int:
        """Return the length of the frame that begins at byte ``start`` of ``data``, or a constant."""
        at = self._counted_at
        if not at:
            return self._base
        if len(data) <= start + at:
            return NEEDS_MORE
        length = self._base + data[start + at]
        return length if length <= MAX_ADU else NO_FRAME


class FifoReply(Rule):
    """FC 24 is the only one with a count of two bytes."""

    def length(self, data: bytes, start: int) -> int:
        """See ``Rule``."""
        if len(data) < start + 4:
            return NEEDS_MORE
        length = 6 + int.from_bytes(data[start + 2 : start + 4], "big")
        return length if length <= MAX_ADU else NO_FRAME


class EncapsulatedRequest(Rule):
    """FC 43: only device identification has a length."""

    def length(self, data: bytes, start: int) -> int:
        """See ``Rule``."""
        if len(data) < start + 3:
            return NEEDS_MORE
        return 7 if data[start + 2] == MEI_READ_DEVICE_IDENTIFICATION else UNTIL_SILENCE


class EncapsulatedReply(Rule):
    """The objects of a device identification: 8 bytes of head, then id, length and text of each."""

    def length(self, data: bytes, start: int) -> int:
        """See ``Rule``."""
        if len(data) < start + 3:
            return NEEDS_MORE
        if data[start + 2] != MEI_READ_DEVICE_IDENTIFICATION:
            return UNTIL_SILENCE
        if len(data) < start + 8:
            return NEEDS_MORE
        end = start + 8
        for _ in range(data[start + 7]):
            if end + 4 - start > MAX_ADU:
                return NO_FRAME
            if len(data) < end + 2:
                return NEEDS_MORE
            end += 2 + data[end + 1]
        length = end + 2 - start
        return length if length <= MAX_ADU else NO_FRAME


REQUESTS: Final[Mapping[int, Rule]] = {
    FunctionCode.READ_COILS: Rule(8),
    FunctionCode.READ_DISCRETE_INPUTS: Rule(8),
    FunctionCode.READ_HOLDING_REGISTERS: Rule(8),
    FunctionCode.READ_INPUT_REGISTERS: Rule(8),
    FunctionCode.WRITE_SINGLE_COIL: Rule(8),
    FunctionCode.WRITE_SINGLE_REGISTER: Rule(8),
    FunctionCode.READ_EXCEPTION_STATUS: Rule(4),
    # Devices take one data word; "return query data" may have more, and then ends by silence.
    FunctionCode.DIAGNOSTICS: Rule(8),
    FunctionCode.GET_COMM_EVENT_COUNTER: Rule(4),
    FunctionCode.GET_COMM_EVENT_LOG: Rule(4),
    FunctionCode.WRITE_MULTIPLE_COILS: Rule(9, counted_at=6),
    FunctionCode.WRITE_MULTIPLE_REGISTERS: Rule(9, counted_at=6),
    FunctionCode.REPORT_SERVER_ID: Rule(4),
    FunctionCode.READ_FILE_RECORD: Rule(5, counted_at=2),
    FunctionCode.WRITE_FILE_RECORD: Rule(5, counted_at=2),
    FunctionCode.MASK_WRITE_REGISTER: Rule(10),
    FunctionCode.READ_WRITE_MULTIPLE_REGISTERS: Rule(13, counted_at=10),
    FunctionCode.READ_FIFO_QUEUE: Rule(6),
    FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT: EncapsulatedRequest(),
}

REPLIES: Final[Mapping[int, Rule]] = {
    FunctionCode.READ_COILS: Rule(5, counted_at=2),
    FunctionCode.READ_DISCRETE_INPUTS: Rule(5, counted_at=2),
    FunctionCode.READ_HOLDING_REGISTERS: Rule(5, counted_at=2),
    FunctionCode.READ_INPUT_REGISTERS: Rule(5, counted_at=2),
    FunctionCode.WRITE_SINGLE_COIL: Rule(8),
    FunctionCode.WRITE_SINGLE_REGISTER: Rule(8),
    FunctionCode.READ_EXCEPTION_STATUS: Rule(5),
    FunctionCode.DIAGNOSTICS: Rule(8),
    FunctionCode.GET_COMM_EVENT_COUNTER: Rule(8),
    FunctionCode.GET_COMM_EVENT_LOG: Rule(5, counted_at=2),
    FunctionCode.WRITE_MULTIPLE_COILS: Rule(8),
    FunctionCode.WRITE_MULTIPLE_REGISTERS: Rule(8),
    FunctionCode.REPORT_SERVER_ID: Rule(5, counted_at=2),
    FunctionCode.READ_FILE_RECORD: Rule(5, counted_at=2),
    FunctionCode.WRITE_FILE_RECORD: Rule(5, counted_at=2),
    FunctionCode.MASK_WRITE_REGISTER: Rule(10),
    FunctionCode.READ_WRITE_MULTIPLE_REGISTERS: Rule(5, counted_at=2),
    FunctionCode.READ_FIFO_QUEUE: FifoReply(),
    FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT: EncapsulatedReply(),
}

_DIAGNOSTICS: Final = int(FunctionCode.DIAGNOSTICS)
_FUNCTION_CODES: Final = 0x100
_REQUEST_RULES: Final = tuple([REQUESTS.get(function) for function in range(_FUNCTION_CODES)])
_REPLY_RULES: Final = tuple([REPLIES.get(function) for function in range(_FUNCTION_CODES)])


def request_length(data: bytes, start: int = 0) -> int:
    """Return the length of the request that begins at byte ``start`` of ``data``, or a constant.

    >>> request_length(bytes.fromhex("01 06 31 00"))
    8
    >>> request_length(bytes.fromhex("01 10 6F 00 00 02 04"))
    13
    >>> request_length(bytes.fromhex("01 10 6F")) == NEEDS_MORE
    True
    >>> request_length(bytes.fromhex("01 41 00")) == UNTIL_SILENCE
    True
    """
    if len(data) < start + 2:
        return NEEDS_MORE
    function = data[start + 1]
    rule = _REQUEST_RULES[function]
    if rule is not None:
        return rule.length(data, start)
    return UNTIL_SILENCE if function else NO_FRAME


def is_odd_request(pdu: bytes) -> bool:
    """Whether a request has another length than its function code says: its effect is unknown.

    A function code without a rule has no expected length.

    >>> is_odd_request(bytes.fromhex("03 01 01")), is_odd_request(bytes.fromhex("03 01 01 00 02"))
    (True, False)
    """
    length = request_length(b"\0" + pdu + b"\0\0")
    return length not in (UNTIL_SILENCE, len(pdu) + ADU_OVERHEAD)


def reply_length(request_pdu: bytes, data: bytes, start: int = 0) -> int:
    """Return the length of the reply that begins at byte ``start`` of ``data``, or a constant.

    The request is the context. The reply to diagnostics (8) has the request's length, and a vendor's function
    code above 127 is no exception if the request had it. A reply to another request is measured by its own
    function code.

    >>> reply_length(bytes.fromhex("03 32 00 00 02"), bytes.fromhex("01 03 04"))
    9
    >>> reply_length(bytes.fromhex("03 32 00 00 02"), bytes.fromhex("01 81 02"))
    5
    """
    if len(data) < start + 2:
        return NEEDS_MORE
    function = data[start + 1]
    if function >= EXCEPTION_BIT:
        return UNTIL_SILENCE if function == request_pdu[0] else EXCEPTION_ADU
    if function == _DIAGNOSTICS and function == request_pdu[0]:
        return len(request_pdu) + ADU_OVERHEAD
    rule = _REPLY_RULES[function]
    if rule is not None:
        return rule.length(data, start)
    return UNTIL_SILENCE if function else NO_FRAME


def asked_bytes(request_pdu: bytes) -> int | None:
    """Return the byte count that the reply to a read must have; None for other requests.

    >>> asked_bytes(bytes.fromhex("03 02 00 00 02"))
    4
    """
    if len(request_pdu) < 5:
        return None
    bits = _BITS_EACH[request_pdu[0]]
    return ((request_pdu[3] << 8 | request_pdu[4]) * bits + 7) // 8 if bits else None


def _bits_each() -> bytes:
    bits = bytearray(_FUNCTION_CODES)
    bits[FunctionCode.READ_COILS] = bits[FunctionCode.READ_DISCRETE_INPUTS] = 1
    bits[FunctionCode.READ_HOLDING_REGISTERS] = bits[FunctionCode.READ_INPUT_REGISTERS] = 16
    bits[FunctionCode.READ_WRITE_MULTIPLE_REGISTERS] = 16
    return bytes(bits)


_BITS_EACH: Final = _bits_each()
"""By function code: bits of each item that a read request counts; 0: it is no read."""
