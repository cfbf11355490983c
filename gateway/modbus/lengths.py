"""How long an RTU frame will be, told from its first bytes (Modbus application protocol V1.1b3, section 6).

Silence does not end frames reliably where an operating system and USB adapters stand between the wire and the
program, so a frame ends where its own bytes say. One entry for each function code; those that are not listed
(43/13 for CANopen, the user-defined 65 to 72 and 100 to 110, all others) can only end by silence.

A length is the number of bytes with unit id and check sum, or one of the three constants below. It is a
prediction: the check sum is what decides.
"""

from collections.abc import Callable, Mapping
from typing import Final

from gateway.modbus.pdu import EXCEPTION_BIT, MEI_READ_DEVICE_IDENTIFICATION, FunctionCode

NEEDS_MORE: Final = 0
"""The length cannot be told yet."""
UNTIL_SILENCE: Final = -1
"""The length can never be told: the frame ends where the line falls silent."""
NO_FRAME: Final = -2
"""No frame begins so: function code 0, or longer than a frame may be."""

MIN_ADU: Final = 4
"""Unit id, function code, check sum."""
MAX_ADU: Final = 256
EXCEPTION_ADU: Final = 5
ADU_OVERHEAD: Final = 3
"""What an RTU frame has besides its PDU: unit id and check sum."""

Rule = Callable[[bytes, int], int]
"""Bytes and the offset at which the frame begins -> its length."""


def _fixed(length: int) -> Rule:
    def rule(data: bytes, start: int) -> int:  # noqa: ARG001 - the same whatever the bytes are
        return length

    return rule


def _counted(base: int, at: int) -> Rule:
    """``base`` bytes and as many more as the byte at offset ``at`` says."""

    def rule(data: bytes, start: int) -> int:
        if len(data) <= start + at:
            return NEEDS_MORE
        length = base + data[start + at]
        return length if length <= MAX_ADU else NO_FRAME

    return rule


def _fifo_reply(data: bytes, start: int) -> int:
    """FC 24 is the only one that counts in two bytes."""
    if len(data) < start + 4:
        return NEEDS_MORE
    length = 6 + int.from_bytes(data[start + 2 : start + 4], "big")
    return length if length <= MAX_ADU else NO_FRAME


def _encapsulated_request(data: bytes, start: int) -> int:
    if len(data) < start + 3:
        return NEEDS_MORE
    return 7 if data[start + 2] == MEI_READ_DEVICE_IDENTIFICATION else UNTIL_SILENCE


def _encapsulated_reply(data: bytes, start: int) -> int:
    """Walk the objects of a device identification: 8 bytes of head, then id, length and text of each."""
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
    FunctionCode.READ_COILS: _fixed(8),
    FunctionCode.READ_DISCRETE_INPUTS: _fixed(8),
    FunctionCode.READ_HOLDING_REGISTERS: _fixed(8),
    FunctionCode.READ_INPUT_REGISTERS: _fixed(8),
    FunctionCode.WRITE_SINGLE_COIL: _fixed(8),
    FunctionCode.WRITE_SINGLE_REGISTER: _fixed(8),
    FunctionCode.READ_EXCEPTION_STATUS: _fixed(4),
    # One data word is what devices take; "return query data" may carry more, and then ends by silence.
    FunctionCode.DIAGNOSTICS: _fixed(8),
    FunctionCode.GET_COMM_EVENT_COUNTER: _fixed(4),
    FunctionCode.GET_COMM_EVENT_LOG: _fixed(4),
    FunctionCode.WRITE_MULTIPLE_COILS: _counted(9, at=6),
    FunctionCode.WRITE_MULTIPLE_REGISTERS: _counted(9, at=6),
    FunctionCode.REPORT_SERVER_ID: _fixed(4),
    FunctionCode.READ_FILE_RECORD: _counted(5, at=2),
    FunctionCode.WRITE_FILE_RECORD: _counted(5, at=2),
    FunctionCode.MASK_WRITE_REGISTER: _fixed(10),
    FunctionCode.READ_WRITE_MULTIPLE_REGISTERS: _counted(13, at=10),
    FunctionCode.READ_FIFO_QUEUE: _fixed(6),
    FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT: _encapsulated_request,
}

REPLIES: Final[Mapping[int, Rule]] = {
    FunctionCode.READ_COILS: _counted(5, at=2),
    FunctionCode.READ_DISCRETE_INPUTS: _counted(5, at=2),
    FunctionCode.READ_HOLDING_REGISTERS: _counted(5, at=2),
    FunctionCode.READ_INPUT_REGISTERS: _counted(5, at=2),
    FunctionCode.WRITE_SINGLE_COIL: _fixed(8),
    FunctionCode.WRITE_SINGLE_REGISTER: _fixed(8),
    FunctionCode.READ_EXCEPTION_STATUS: _fixed(5),
    FunctionCode.DIAGNOSTICS: _fixed(8),
    FunctionCode.GET_COMM_EVENT_COUNTER: _fixed(8),
    FunctionCode.GET_COMM_EVENT_LOG: _counted(5, at=2),
    FunctionCode.WRITE_MULTIPLE_COILS: _fixed(8),
    FunctionCode.WRITE_MULTIPLE_REGISTERS: _fixed(8),
    FunctionCode.REPORT_SERVER_ID: _counted(5, at=2),
    FunctionCode.READ_FILE_RECORD: _counted(5, at=2),
    FunctionCode.WRITE_FILE_RECORD: _counted(5, at=2),
    FunctionCode.MASK_WRITE_REGISTER: _fixed(10),
    FunctionCode.READ_WRITE_MULTIPLE_REGISTERS: _counted(5, at=2),
    FunctionCode.READ_FIFO_QUEUE: _fifo_reply,
    FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT: _encapsulated_reply,
}


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
    rule = REQUESTS.get(function)
    if rule is not None:
        return rule(data, start)
    return UNTIL_SILENCE if function else NO_FRAME


def reply_length(request_pdu: bytes, data: bytes, start: int = 0) -> int:
    """Return the length of the reply that begins at byte ``start`` of ``data``, or a constant.

    The request is the context: diagnostics (8) are answered in the request's own length, and a vendor's
    function code above 127 is no exception where it was asked for. A reply to something else is measured by
    its own function code.

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
    if function == FunctionCode.DIAGNOSTICS == request_pdu[0]:
        return len(request_pdu) + ADU_OVERHEAD
    rule = REPLIES.get(function)
    if rule is not None:
        return rule(data, start)
    return UNTIL_SILENCE if function else NO_FRAME


def asked_bytes(request_pdu: bytes) -> int | None:
    """Return the byte count that the reply to a read has to carry; None for other requests.

    >>> asked_bytes(bytes.fromhex("03 02 00 00 02"))
    4
    """
    if len(request_pdu) < 5:
        return None
    quantity = request_pdu[3] << 8 | request_pdu[4]
    if request_pdu[0] in _REGISTER_READS:
        return 2 * quantity
    return (quantity + 7) // 8 if request_pdu[0] in _BIT_READS else None


_BIT_READS: Final = frozenset({FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS})
_REGISTER_READS: Final = frozenset(
    {
        FunctionCode.READ_HOLDING_REGISTERS,
        FunctionCode.READ_INPUT_REGISTERS,
        FunctionCode.READ_WRITE_MULTIPLE_REGISTERS,
    }
)
