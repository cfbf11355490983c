"""A Modbus unit: its memory, and a PDU in, a PDU out. Every simulated drive is based on it.

Checks follow the order of the flow charts of the Modbus Application Protocol V1.1b3: function code (exception
1), quantities (exception 3), addresses (exception 2), then the execution itself (exception 4). A drive
overrides the hooks at the end of :class:`RegisterServer`.
"""

from array import array
from collections.abc import Callable, Sequence
from struct import unpack_from
from sys import byteorder
from typing import Final, Protocol

from gateway.modbus.registers import BitField
from gateway.simulator.ledger import Ledger, WriteRecord
from gateway.simulator.mechanics import Mechanics

ADDRESS_SPACE: Final = 0x10000

ILLEGAL_FUNCTION: Final = 1
ILLEGAL_ADDRESS: Final = 2
ILLEGAL_VALUE: Final = 3
EXECUTION_FAILED: Final = 4

MAX_READ_BITS: Final = 2000
MAX_WRITE_BITS: Final = 1968
MAX_READ_REGISTERS: Final = 125
MAX_WRITE_REGISTERS: Final = 123
MAX_FC23_WRITE_REGISTERS: Final = 121

COIL_ON: Final = b"\xff\x00"
COIL_OFF: Final = b"\x00\x00"


class RegisterImage:
    """Registers (holding and input registers are the same) and coils (also read as discrete inputs).

    ``size`` registers and as many coils exist, from address 0.
    """

    def __init__(self, size: int = ADDRESS_SPACE) -> None:
        self._words = array("H", bytes(2 * size))
        self._coils = bytearray(size)

    def has(self, address: int, count: int) -> bool:
        """Whether a whole range exists."""
        return address + count <= len(self._words)

    def words(self, address: int, count: int) -> bytes:
        """Return registers as in a frame: two bytes each, high byte first."""
        chunk = self._words[address : address + count]
        _swap(chunk)
        return chunk.tobytes()

    def store_words(self, address: int, data: bytes) -> None:
        """Store registers from the bytes of a frame."""
        chunk = array("H", data)
        _swap(chunk)
        self._words[address : address + len(chunk)] = chunk

    def word(self, address: int) -> int:
        """One register."""
        return self._words[address]

    def set_word(self, address: int, word: int) -> None:
        """Change one register; only the low 16 bits count."""
        self._words[address] = word & 0xFFFF

    def set_bit(self, bit_field: BitField, on: bool) -> None:
        """Set or clear one bit; the rest of its register stays."""
        mask = 1 << bit_field.bit
        word = self._words[bit_field.address]
        self._words[bit_field.address] = word | mask if on else word & ~mask

    def coil(self, address: int) -> bool:
        """One coil or discrete input."""
        return bool(self._coils[address])

    def set_coil(self, address: int, on: bool) -> None:
        """Change one coil or discrete input."""
        self._coils[address] = on

    def coils(self, address: int, count: int) -> bytes:
        """Return coils as in a frame: eight to a byte, the lowest address in the lowest bit."""
        packed = bytearray((count + 7) // 8)
        for index in range(count):
            packed[index >> 3] |= self._coils[address + index] << (index & 7)
        return bytes(packed)


def _swap(chunk: "array[int]") -> None:
    if byteorder == "little":
        chunk.byteswap()


class ModbusExceptionError(Exception):
    """Carries an exception code from a function's checks, or from its execution."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class ServedMotion(Protocol):
    """An axis, for code that only serves or reads it."""

    @property
    def name(self) -> str:
        """Its name in the configuration."""
        ...

    @property
    def mechanics(self) -> Mechanics:
        """Motor, screw and nut."""
        ...


class RegisterServer:
    """One unit: function codes, quantities, registers and coils. It knows only ``functions``."""

    functions: frozenset[int]
    max_read = MAX_READ_REGISTERS
    """Most registers in one read."""
    max_write = MAX_WRITE_REGISTERS
    """Most registers in one write."""
    axes: Sequence[ServedMotion]

    def __init__(self, unit_id: int, image: RegisterImage | None = None) -> None:
        self.unit_id = unit_id
        self.image = image if image is not None else RegisterImage()
        self.ledger = Ledger()
        self._handlers: dict[int, Callable[[bytes, float], bytes]] = {
            1: self._read_bits,
            2: self._read_bits,
            3: self._read_registers,
            4: self._read_registers,
            5: self._write_coil,
            6: self._write_register,
            7: self._exception_status,
            8: self._diagnostics,
            15: self._write_coils,
            16: self._write_registers,
            22: self._mask_write,
            23: self._read_write_registers,
        }

    def answer(self, pdu: bytes, now_s: float) -> bytes | None:
        """Execute one request and return the reply, normal or exception; None: the drive does not answer."""
        function = pdu[0]
        self.ledger.requests[function] += 1
        try:
            if function not in self.functions:
                raise ModbusExceptionError(ILLEGAL_FUNCTION)
            return self._handlers[function](pdu, now_s)
        except ModbusExceptionError as refused:
            return self.refusal(pdu, refused.code)

    def _read_bits(self, pdu: bytes, now_s: float) -> bytes:
        address, count = _two_words(pdu, 5)
        check(1 <= count <= MAX_READ_BITS, ILLEGAL_VALUE)
        check(self.has_bits(pdu[0], address, count), ILLEGAL_ADDRESS)
        self.refresh(now_s)
        packed = self.image.coils(address, count)
        return bytes((pdu[0], len(packed))) + packed

    def _read_registers(self, pdu: bytes, now_s: float) -> bytes:
        address, count = _two_words(pdu, 5)
        self._check_registers(address, count, self.max_read)
        return bytes((pdu[0], 2 * count)) + self._live_words(address, count, now_s)

    def _write_coil(self, pdu: bytes, now_s: float) -> bytes:
        address, _ = _two_words(pdu, 5)
        check(pdu[3:5] in (COIL_ON, COIL_OFF), ILLEGAL_VALUE)
        check(self.has_bits(5, address, 1), ILLEGAL_ADDRESS)
        self._store_coils(address, 1, b"\x01" if pdu[3:5] == COIL_ON else b"\x00", now_s)
        return pdu

    def _write_register(self, pdu: bytes, now_s: float) -> bytes:
        address, _ = _two_words(pdu, 5)
        self._check_registers(address, 1, 1)
        self._store(6, address, pdu[3:5], now_s)
        return pdu

    def _exception_status(self, pdu: bytes, _now_s: float) -> bytes:
        check(len(pdu) == 1, ILLEGAL_VALUE)
        return b"\x07\x00"

    def _diagnostics(self, pdu: bytes, _now_s: float) -> bytes:
        """Return query data (subfunction 0). Other subfunctions are refused, as on most drives."""
        check(pdu[1:3] == b"\x00\x00", ILLEGAL_FUNCTION)
        return pdu

    def _write_coils(self, pdu: bytes, now_s: float) -> bytes:
        address, count = _two_words(pdu, None)
        check(1 <= count <= MAX_WRITE_BITS and _block_fits(pdu, 5, (count + 7) // 8), ILLEGAL_VALUE)
        check(self.has_bits(15, address, count), ILLEGAL_ADDRESS)
        self._store_coils(address, count, pdu[6:], now_s)
        return pdu[:5]

    def _write_registers(self, pdu: bytes, now_s: float) -> bytes:
        address, count = _two_words(pdu, None)
        check(_block_fits(pdu, 5, 2 * count), ILLEGAL_VALUE)
        self._check_registers(address, count, self.max_write)
        self._store(16, address, pdu[6:], now_s)
        return pdu[:5]

    def _mask_write(self, pdu: bytes, now_s: float) -> bytes:
        """New content = (old AND and_mask) OR (or_mask AND NOT and_mask) (V1.1b3, 6.16)."""
        check(len(pdu) == 7, ILLEGAL_VALUE)
        address, and_mask, or_mask = unpack_from(">HHH", pdu, 1)
        check(self.has(address, 1), ILLEGAL_ADDRESS)
        old = int.from_bytes(self._live_words(address, 1, now_s))
        new = (old & and_mask) | (or_mask & ~and_mask & 0xFFFF)
        self._store(22, address, new.to_bytes(2), now_s)
        return pdu

    def _read_write_registers(self, pdu: bytes, now_s: float) -> bytes:
        """Write first, then read (V1.1b3, 6.17)."""
        check(len(pdu) >= 10, ILLEGAL_VALUE)
        read_address, read_count, write_address, write_count = unpack_from(">HHHH", pdu, 1)
        check(_block_fits(pdu, 9, 2 * write_count), ILLEGAL_VALUE)
        check(1 <= read_count <= MAX_READ_REGISTERS, ILLEGAL_VALUE)
        self._check_registers(write_address, write_count, min(self.max_write, MAX_FC23_WRITE_REGISTERS))
        self._check_registers(read_address, read_count, self.max_read)
        self._store(23, write_address, pdu[10:], now_s)
        return bytes((23, 2 * read_count)) + self._live_words(read_address, read_count, now_s)

    def _check_registers(self, address: int, count: int, most: int) -> None:
        check(1 <= count <= most, ILLEGAL_VALUE)
        check(self.has(address, count), ILLEGAL_ADDRESS)

    def _live_words(self, address: int, count: int, now_s: float) -> bytes:
        self.refresh(now_s)
        return self.read_words(address, count)

    def _store(self, function: int, address: int, data: bytes, now_s: float) -> None:
        self.refresh(now_s)
        self.before_write(address, len(data) // 2, now_s)
        self.ledger.writes.append(WriteRecord(self.unit_id, function, address, bytes(data), now_s))
        self.write_words(address, data, now_s)

    def _store_coils(self, address: int, count: int, packed: bytes, now_s: float) -> None:
        self.refresh(now_s)
        for index in range(count):
            before = self.image.coil(address + index)
            on = bool(packed[index >> 3] >> (index & 7) & 1)
            self.image.set_coil(address + index, on)
            self.coil_written(address + index, before=before, on=on, now_s=now_s)

    # Hooks for drives.

    def refusal(self, request: bytes, code: int) -> bytes | None:
        """Return the exception reply; None: the drive refuses without a reply."""
        return bytes((request[0] | 0x80, code))

    def has(self, address: int, count: int) -> bool:
        """Whether a whole range of registers exists."""
        return self.image.has(address, count)

    def has_bits(self, function: int, address: int, count: int) -> bool:
        """Whether a whole range of coils or inputs exists for a function code."""
        return self.image.has(address, count)

    def refresh(self, now_s: float) -> None:
        """Update everything that can be read."""

    def before_write(self, address: int, count: int, now_s: float) -> None:
        """Raise RefusedError if registers may not be written now."""

    def read_words(self, address: int, count: int) -> bytes:
        """Return existing, updated registers as in a frame."""
        return self.image.words(address, count)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Store existing registers, and execute what they command."""
        self.image.store_words(address, data)

    def coil_written(self, address: int, *, before: bool, on: bool, now_s: float) -> None:
        """Handle a written coil."""

    def response_delay_s(self, baudrate: int) -> float:
        """Return the drive's response delay; ``baudrate`` is 0 on TCP."""
        return 0.0

    def bad_crc_reply(self, function: int) -> bytes | None:
        """Return the drive's answer to an RTU frame with a wrong CRC; None: no answer."""
        return None


def check(good: bool, exception_code: int) -> None:
    """Refuse with ``exception_code`` unless ``good``."""
    if not good:
        raise ModbusExceptionError(exception_code)


def _two_words(pdu: bytes, length: int | None) -> tuple[int, int]:
    """Return the two words after the function code; ``length`` is the whole request's, if it is fixed."""
    check(len(pdu) == length if length else len(pdu) > 5, ILLEGAL_VALUE)
    first, second = unpack_from(">HH", pdu, 1)
    return first, second


def _block_fits(pdu: bytes, at: int, size: int) -> bool:
    """Whether the byte count at ``at`` and the bytes that follow it are both ``size``."""
    return pdu[at] == size and len(pdu) == at + 1 + size
