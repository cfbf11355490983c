"""Which registers a request writes and reads, for every function code that can carry a position.

One entry per function code. A function code that is not here never holds a position and passes as it is.

Layouts: Modbus application protocol V1.1b3, sections 6.3, 6.4, 6.6, 6.12, 6.16 and 6.17.
"""

from collections.abc import Callable
from typing import Final, NamedTuple


class Access(NamedTuple):
    """Registers touched by one request.

    Words of the write stand in the PDU from ``data_offset``; ``is_consistent`` is False when the counts of
    the request contradict each other, so that nobody can tell what the drive would write.
    """

    read_address: int = 0
    read_quantity: int = 0
    write_address: int = 0
    write_quantity: int = 0
    data_offset: int = 0
    is_mask: bool = False
    is_consistent: bool = True


def _u16(pdu: bytes, offset: int) -> int:
    return pdu[offset] << 8 | pdu[offset + 1]


def _read(pdu: bytes) -> Access | None:
    if len(pdu) != 5:
        return None
    return Access(read_address=_u16(pdu, 1), read_quantity=_u16(pdu, 3))


def _write_single(pdu: bytes) -> Access | None:
    if len(pdu) != 5:
        return None if len(pdu) < 3 else Access(0, 0, _u16(pdu, 1), 1, 3, False, False)
    return Access(write_address=_u16(pdu, 1), write_quantity=1, data_offset=3)


def _write_multiple(pdu: bytes) -> Access | None:
    if len(pdu) < 6:
        return None
    quantity = _u16(pdu, 3)
    present = (len(pdu) - 6 + 1) // 2
    is_consistent = pdu[5] == 2 * quantity == len(pdu) - 6 and quantity > 0
    return Access(0, 0, _u16(pdu, 1), max(quantity, present), 6, False, is_consistent)


def _mask_write(pdu: bytes) -> Access | None:
    if len(pdu) < 3:
        return None
    return Access(0, 0, _u16(pdu, 1), 1, 3, True, len(pdu) == 7)


def _read_write(pdu: bytes) -> Access | None:
    if len(pdu) < 10:
        return None
    quantity = _u16(pdu, 7)
    present = (len(pdu) - 10 + 1) // 2
    is_consistent = pdu[9] == 2 * quantity == len(pdu) - 10 and quantity > 0
    return Access(_u16(pdu, 1), _u16(pdu, 3), _u16(pdu, 5), max(quantity, present), 10, False, is_consistent)


ACCESS: Final[dict[int, Callable[[bytes], Access | None]]] = {
    0x03: _read,
    0x04: _read,
    0x06: _write_single,
    0x10: _write_multiple,
    0x16: _mask_write,
    0x17: _read_write,
}
"""Function code to the registers that its request touches; None where the request is too short to tell."""

MONITOR_FUNCTIONS: Final = frozenset({0x01, 0x02, 0x03, 0x04, 0x07, 0x0B, 0x0C, 0x11, 0x14, 0x18})
"""Function codes that change nothing in a drive: all that a monitor may send, with 0x2B/0x0E."""

READ_DEVICE_IDENTIFICATION: Final = bytes((0x2B, 0x0E))


def only_reads(pdu: bytes) -> bool:
    """Whether a request changes nothing in any drive that keeps to the specification."""
    return pdu[0] in MONITOR_FUNCTIONS or pdu[:2] == READ_DEVICE_IDENTIFICATION
