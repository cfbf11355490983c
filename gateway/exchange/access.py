"""Which registers a request writes and reads, for every function code that can carry a position.

One entry per function code. A function code without an entry never holds a position and passes unchanged.

Layouts: Modbus application protocol V1.1b3, sections 6.3, 6.4, 6.6, 6.12, 6.16, 6.17 and 6.21. The data of
the CANopen general reference (6.21) is little-endian, as in CiA 309-2; its bytes are swapped here.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

from gateway.modbus.pdu import MEI_CANOPEN_GENERAL_REFERENCE, FunctionCode

MEI_HEAD: Final = 12
"""Bytes of a general reference before its data."""
HEAD_BYTES: Final = bytes({1: 5, 2: 5, 3: 5, 4: 5, 6: 3, 16: 6}.get(function, 0) for function in range(256))
"""By function code: length of the head of a PDU, which names the registers that it touches; 0: it has no such
head."""


class Access(NamedTuple):
    """Registers touched by one request.

    The words of a write begin in the PDU at ``data_offset``. ``is_consistent`` is False if the counts of the
    request contradict each other, so that the effect on the drive is unknown. With ``is_mei`` the address is
    an object's index, and the bytes of each word are swapped.
    """

    read_address: int = 0
    read_quantity: int = 0
    write_address: int = 0
    write_quantity: int = 0
    data_offset: int = 0
    is_mask: bool = False
    is_consistent: bool = True
    is_mei: bool = False

    def writes_over(self, other: "Access") -> bool:
        """Whether both write a register in common."""
        ends_before = self.write_address + self.write_quantity <= other.write_address
        begins_behind = other.write_address + other.write_quantity <= self.write_address
        return not (ends_before or begins_behind)

    def words(self, pdu: bytes) -> bytes:
        """Return the words that the request writes, as registers hold them."""
        data = pdu[self.data_offset :]
        return swapped(data) if self.is_mei else data

    def with_words(self, pdu: bytes, words: bytes) -> bytes:
        """Return the request with its words replaced by as many other words."""
        return pdu[: self.data_offset] + (swapped(words) if self.is_mei else words)


def swapped(data: bytes) -> bytes:
    """Swap the bytes of each word; a single byte at the end becomes the low byte of its word.

    >>> swapped(bytes.fromhex("01 02 03 04")).hex(" "), swapped(bytes((6,))).hex(" ")
    ('02 01 04 03', '00 06')
    """
    if len(data) % 2:
        data += b"\x00"
    result = bytearray(data)
    result[0::2], result[1::2] = data[1::2], data[0::2]
    return bytes(result)


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


def _general_reference(pdu: bytes) -> Access | None:
    """MEI type 13: read or write one object; sub-indexes other than 0 hold nothing that is mapped."""
    if len(pdu) < MEI_HEAD or pdu[1] != MEI_CANOPEN_GENERAL_REFERENCE or pdu[7] != 0:
        return None
    index, quantity = _u16(pdu, 5), (pdu[11] + 1) // 2
    if pdu[2] == 0:
        return Access(read_address=index, read_quantity=quantity, is_mei=True)
    present = (len(pdu) - MEI_HEAD + 1) // 2
    is_consistent = pdu[11] == len(pdu) - MEI_HEAD > 0
    return Access(0, 0, index, max(quantity, present), MEI_HEAD, False, is_consistent, is_mei=True)


def coils_written(pdu: bytes) -> dict[int, int]:
    """Return the coils that a request writes, with their values (sections 6.5 and 6.11).

    >>> coils_written(bytes.fromhex("05 040B FF00"))
    {1035: 1}
    >>> coils_written(bytes.fromhex("0F 0019 0003 01 05"))
    {25: 1, 26: 0, 27: 1}
    """
    if pdu[0] == FunctionCode.WRITE_SINGLE_COIL and len(pdu) >= 5:  # a drive may ignore extra bytes
        return {_u16(pdu, 1): int(_u16(pdu, 3) > 0)}  # a drive may take any value but 0 for ON
    if pdu[0] == FunctionCode.WRITE_MULTIPLE_COILS and len(pdu) > 6:
        address, quantity = _u16(pdu, 1), min(_u16(pdu, 3), 8 * (len(pdu) - 6))
        return {address + i: pdu[6 + i // 8] >> i % 8 & 1 for i in range(quantity)}
    return {}


ACCESS: Final[dict[int, Callable[[bytes], Access | None]]] = {
    0x03: _read,
    0x04: _read,
    0x06: _write_single,
    0x10: _write_multiple,
    0x16: _mask_write,
    0x17: _read_write,
    0x2B: _general_reference,
}
"""Function code to the registers that its request touches; None: the request is too short to tell."""


def access_of(pdu: bytes) -> Access | None:
    """Return the registers that a request touches; None: none, or the request is too short to tell."""
    parse = ACCESS.get(pdu[0])
    return None if parse is None else parse(pdu)


_FORMS: Final = {1: 5, 2: 5, 3: 5, 4: 5, 5: 5, 6: 5, 15: 6, 16: 6, 22: 7, 23: 10}
"""By function code: minimum length of a request; of those with 6 or 10 bytes, the last says how many
follow."""


def is_truncated(pdu: bytes) -> bool:
    """Whether a request lacks bytes that its own function code needs: no drive can execute it.

    >>> is_truncated(bytes.fromhex("10 01 00")), is_truncated(bytes.fromhex("10 0100 0001 02 1234"))
    (True, False)
    """
    form = _FORMS.get(pdu[0], 0)
    size = len(pdu)
    return size < form or (form in (6, 10) and size < form + pdu[form - 1])


MONITOR_FUNCTIONS: Final = frozenset({0x01, 0x02, 0x03, 0x04, 0x07, 0x0B, 0x0C, 0x11, 0x14, 0x18})
"""Function codes that change nothing in a drive: all that a monitor may send, with 0x2B/0x0E."""

READ_DEVICE_IDENTIFICATION: Final = bytes((0x2B, 0x0E))
READ_OBJECT: Final = bytes((0x2B, MEI_CANOPEN_GENERAL_REFERENCE, 0))


def only_reads(pdu: bytes) -> bool:
    """Whether a request changes nothing in any drive that follows the specification."""
    is_object_read = pdu[:3] == READ_OBJECT and len(pdu) >= MEI_HEAD
    return pdu[0] in MONITOR_FUNCTIONS or pdu[:2] == READ_DEVICE_IDENTIFICATION or is_object_read
