"""Names and numbers of the Modbus application protocol (V1.1b3), as far as a gateway needs them."""

from enum import IntEnum
from typing import Final

MEI_CANOPEN_GENERAL_REFERENCE: Final = 0x0D
MEI_READ_DEVICE_IDENTIFICATION: Final = 0x0E

MAX_PDU: Final = 253
BROADCAST_UNIT_ID: Final = 0

MAX_READ_BITS: Final = 2000
MAX_READ_REGISTERS: Final = 125
MAX_WRITE_BITS: Final = 1968
MAX_WRITE_REGISTERS: Final = 123
MAX_READ_WRITE_READ_REGISTERS: Final = 125
MAX_READ_WRITE_WRITE_REGISTERS: Final = 121

EXCEPTION_BIT: Final = 0x80
COIL_ON: Final = 0xFF00
COIL_OFF: Final = 0x0000


class FunctionCode(IntEnum):
    """The public function codes (section 5.1). Others exist, and pass unchanged."""

    READ_COILS = 0x01
    READ_DISCRETE_INPUTS = 0x02
    READ_HOLDING_REGISTERS = 0x03
    READ_INPUT_REGISTERS = 0x04
    WRITE_SINGLE_COIL = 0x05
    WRITE_SINGLE_REGISTER = 0x06
    READ_EXCEPTION_STATUS = 0x07
    DIAGNOSTICS = 0x08
    GET_COMM_EVENT_COUNTER = 0x0B
    GET_COMM_EVENT_LOG = 0x0C
    WRITE_MULTIPLE_COILS = 0x0F
    WRITE_MULTIPLE_REGISTERS = 0x10
    REPORT_SERVER_ID = 0x11
    READ_FILE_RECORD = 0x14
    WRITE_FILE_RECORD = 0x15
    MASK_WRITE_REGISTER = 0x16
    READ_WRITE_MULTIPLE_REGISTERS = 0x17
    READ_FIFO_QUEUE = 0x18
    ENCAPSULATED_INTERFACE_TRANSPORT = 0x2B


class ExceptionCode(IntEnum):
    """Why a request was refused (section 7). Drives also send codes of their own: those pass unchanged."""

    ILLEGAL_FUNCTION = 0x01
    ILLEGAL_DATA_ADDRESS = 0x02
    ILLEGAL_DATA_VALUE = 0x03
    SERVER_DEVICE_FAILURE = 0x04
    ACKNOWLEDGE = 0x05
    SERVER_DEVICE_BUSY = 0x06
    MEMORY_PARITY_ERROR = 0x08
    GATEWAY_PATH_UNAVAILABLE = 0x0A
    GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND = 0x0B


ABSENT: Final = frozenset(
    {ExceptionCode.GATEWAY_PATH_UNAVAILABLE, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND}
)
"""Codes with which a converter answers for a device that it does not reach or that did not answer it."""


def exception_pdu(function: int, code: int) -> bytes:
    """Return the exception reply to a request of function code ``function``, with exception ``code``.

    >>> exception_pdu(FunctionCode.WRITE_SINGLE_REGISTER, ExceptionCode.ILLEGAL_DATA_ADDRESS).hex(" ")
    '86 02'
    """
    return bytes((function | EXCEPTION_BIT, code))


def is_absence(pdu: bytes) -> bool:
    r"""Whether a converter has answered in the place of its device (section 7, codes 0A and 0B).

    >>> is_absence(b"\x83\x0b"), is_absence(b"\x83\x02"), is_absence(b"\x03\x02\x00\x0b")
    (True, False, False)
    """
    return pdu[0] >= EXCEPTION_BIT and len(pdu) == 2 and pdu[1] in ABSENT


def is_exception(pdu: bytes) -> bool:
    r"""Whether a reply refuses its request: bit 7 of the function byte is set.

    Some drives answer a refused read with 0x81 for any function code (Kinco FD and CD), so the other seven
    bits mean nothing.

    >>> is_exception(b"\x83\x02"), is_exception(b"\x81\x02"), is_exception(b"\x03\x02\x00\x01")
    (True, True, False)
    """
    return len(pdu) > 0 and pdu[0] >= EXCEPTION_BIT
