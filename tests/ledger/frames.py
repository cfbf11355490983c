"""Modbus frames as the witness reads them: an own parser and an own check sum, from the specification.

Modbus application protocol V1.1b3, section 6; Modbus over serial line V1.02, section 6.2 (CRC).
"""

from typing import Final, NamedTuple

READS: Final = (3, 4)
WRITES: Final = (6, 16, 22, 23)


class Parsed(NamedTuple):
    """What a request touches: (address, count) of the read, (address, words) of the write."""

    function: int
    read: tuple[int, int] | None = None
    write: tuple[int, tuple[int, ...]] | None = None
    mask: tuple[int, int] | None = None
    """AND and OR mask of FC22; the write then names the register with a word that is not known yet."""

    @property
    def is_read(self) -> bool:
        return self.read is not None and self.write is None


def words_of(data: bytes) -> tuple[int, ...]:
    """Return big-endian words."""
    return tuple(data[i] << 8 | data[i + 1] for i in range(0, len(data) - 1, 2))


def bytes_of(words: tuple[int, ...] | list[int]) -> bytes:
    return b"".join(word.to_bytes(2, "big") for word in words)


def parse(pdu: bytes) -> Parsed:
    """Return what a well-formed request touches; nothing for function codes without registers."""
    function = pdu[0]
    address = int.from_bytes(pdu[1:3], "big")
    if function in READS:
        return Parsed(function, read=(address, int.from_bytes(pdu[3:5], "big")))
    if function == 6:
        return Parsed(function, write=(address, words_of(pdu[3:5])))
    if function == 16:
        return Parsed(function, write=(address, words_of(pdu[6:])))
    if function == 22:
        masks = words_of(pdu[3:7])
        return Parsed(function, write=(address, (0,)), mask=(masks[0], masks[1]))
    if function == 23:
        written = int.from_bytes(pdu[5:7], "big"), words_of(pdu[10:])
        return Parsed(function, read=(address, int.from_bytes(pdu[3:5], "big")), write=written)
    return Parsed(function)


def read_pdu(address: int, count: int, function: int = 3) -> bytes:
    """FC03 or FC04."""
    return bytes((function,)) + bytes_of([address, count])


def write_pdu(address: int, words: tuple[int, ...] | list[int]) -> bytes:
    """FC16."""
    return b"\x10" + bytes_of([address, len(words)]) + bytes((2 * len(words),)) + bytes_of(words)


def single_pdu(address: int, word: int) -> bytes:
    """FC06."""
    return b"\x06" + bytes_of([address, word])


def exchange_pdu(address: int, count: int, written: int, words: tuple[int, ...] | list[int]) -> bytes:
    """FC23."""
    head = bytes_of([address, count, written, len(words)])
    return b"\x17" + head + bytes((2 * len(words),)) + bytes_of(words)


def native_success(pdu: bytes, reply: bytes) -> bool:
    """Whether a reply says that the whole of a write was done."""
    function = pdu[0]
    if function in (6, 22):
        return reply == pdu
    if function == 16:
        return reply == pdu[:5]
    if function == 23:
        count = int.from_bytes(pdu[3:5], "big")
        return len(reply) == 2 + 2 * count and reply[0] == 23 and reply[1] == 2 * count
    return reply[0] == function


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
        table.append(crc)
    return tuple(table)


_TABLE: Final = _crc_table()


def crc(data: bytes) -> bytes:
    """Return the two bytes of a check sum, low one first."""
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _TABLE[(value ^ byte) & 0xFF]
    return bytes((value & 0xFF, value >> 8))


def rtu(unit_id: int, pdu: bytes) -> bytes:
    """Return a whole RTU frame."""
    body = bytes((unit_id,)) + pdu
    return body + crc(body)


def open_rtu(frame: bytes) -> tuple[int, bytes] | None:
    """Return unit id and PDU of a whole RTU frame; None where its check sum is wrong."""
    if len(frame) < 4 or crc(frame[:-2]) != frame[-2:]:
        return None
    return frame[0], frame[1:-2]


def mbap(transaction_id: int, unit_id: int, pdu: bytes) -> bytes:
    """Return a whole Modbus/TCP frame."""
    return bytes_of([transaction_id, 0, len(pdu) + 1]) + bytes((unit_id,)) + pdu


def open_mbap(frame: bytes) -> tuple[int, int, bytes]:
    """Return transaction id, unit id and PDU of a whole Modbus/TCP frame."""
    assert frame[2:6] == (len(frame) - 6).to_bytes(4, "big"), frame.hex(" ")  # protocol id 0, length
    return int.from_bytes(frame[:2], "big"), frame[6], frame[7:]
