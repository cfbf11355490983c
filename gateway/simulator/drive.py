"""A simulated drive: a PDU in, a PDU out.

Checks are made in the order of the flow charts of the Modbus Application Protocol V1.1b3: function code
(exception 1), quantities (exception 3), addresses (exception 2), then the deed itself (exception 4, which no
simulated drive needs). Vendor codes 0x41, 0x64 and 0x65 are echoed.
"""

from collections.abc import Callable, Sequence
from struct import unpack_from
from typing import Final

from gateway.simulator.axis import SimulatedAxis
from gateway.simulator.image import RegisterImage
from gateway.simulator.ledger import Ledger, WriteRecord

ILLEGAL_FUNCTION: Final = 1
ILLEGAL_ADDRESS: Final = 2
ILLEGAL_VALUE: Final = 3

MAX_READ_BITS: Final = 2000
MAX_WRITE_BITS: Final = 1968
MAX_READ_REGISTERS: Final = 125
MAX_WRITE_REGISTERS: Final = 123
MAX_FC23_WRITE_REGISTERS: Final = 121

COIL_ON: Final = b"\xff\x00"
COIL_OFF: Final = b"\x00\x00"
VENDOR_FUNCTIONS: Final = (0x41, 0x64, 0x65)


class _RefusedError(Exception):
    """Carries an exception code out of a function's checks."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class SimulatedDrive:
    """One unit on a bus, with the axes that it drives.

    ``max_registers`` is the most that it takes in one frame; ``without`` lists function codes that it does
    not know although others do.
    """

    def __init__(
        self,
        unit_id: int,
        axes: Sequence[SimulatedAxis] = (),
        *,
        image: RegisterImage | None = None,
        max_registers: int = MAX_READ_REGISTERS,
        without: Sequence[int] = (),
        ledger: Ledger | None = None,
    ) -> None:
        self.unit_id = unit_id
        self.axes = tuple(axes)
        self.image = image if image is not None else RegisterImage()
        self.ledger = ledger if ledger is not None else Ledger()
        self._max_registers = max_registers
        functions: dict[int, Callable[[bytes, float], bytes]] = {
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
        functions.update(dict.fromkeys(VENDOR_FUNCTIONS, self._echo))
        self._functions = {code: do for code, do in functions.items() if code not in without}
        for axis in self.axes:
            axis.initialise(self.image)

    def answer(self, pdu: bytes, now_s: float) -> bytes:
        """Obey one request and return the reply, normal or exception."""
        function = pdu[0]
        self.ledger.requests[function] += 1
        try:
            if function not in self._functions:
                raise _RefusedError(ILLEGAL_FUNCTION)
            return self._functions[function](pdu, now_s)
        except _RefusedError as refused:
            return bytes((function | 0x80, refused.code))

    def _read_bits(self, pdu: bytes, _now_s: float) -> bytes:
        address, count = _two_words(pdu, 5)
        _check(1 <= count <= MAX_READ_BITS, ILLEGAL_VALUE)
        _check(self.image.has(address, count), ILLEGAL_ADDRESS)
        packed = self.image.coils(address, count)
        return bytes((pdu[0], len(packed))) + packed

    def _read_registers(self, pdu: bytes, now_s: float) -> bytes:
        address, count = _two_words(pdu, 5)
        self._check_registers(address, count, MAX_READ_REGISTERS)
        return bytes((pdu[0], 2 * count)) + self._live_words(address, count, now_s)

    def _write_coil(self, pdu: bytes, _now_s: float) -> bytes:
        address, _ = _two_words(pdu, 5)
        _check(pdu[3:5] in (COIL_ON, COIL_OFF), ILLEGAL_VALUE)
        _check(self.image.has(address, 1), ILLEGAL_ADDRESS)
        self.image.store_coils(address, 1, b"\x01" if pdu[3:5] == COIL_ON else b"\x00")
        return pdu

    def _write_register(self, pdu: bytes, now_s: float) -> bytes:
        address, _ = _two_words(pdu, 5)
        _check(self.image.has(address, 1), ILLEGAL_ADDRESS)
        self._store(6, address, pdu[3:5], now_s)
        return pdu

    def _exception_status(self, pdu: bytes, _now_s: float) -> bytes:
        _check(len(pdu) == 1, ILLEGAL_VALUE)
        return b"\x07\x00"

    def _diagnostics(self, pdu: bytes, _now_s: float) -> bytes:
        """Return query data (subfunction 0); the rest is not known, as on most drives."""
        _check(pdu[1:3] == b"\x00\x00", ILLEGAL_FUNCTION)
        return pdu

    def _write_coils(self, pdu: bytes, _now_s: float) -> bytes:
        address, count = _two_words(pdu, None)
        _check(1 <= count <= MAX_WRITE_BITS and _block_fits(pdu, 5, (count + 7) // 8), ILLEGAL_VALUE)
        _check(self.image.has(address, count), ILLEGAL_ADDRESS)
        self.image.store_coils(address, count, pdu[6:])
        return pdu[:5]

    def _write_registers(self, pdu: bytes, now_s: float) -> bytes:
        address, count = _two_words(pdu, None)
        _check(_block_fits(pdu, 5, 2 * count), ILLEGAL_VALUE)
        self._check_registers(address, count, MAX_WRITE_REGISTERS)
        self._store(16, address, pdu[6:], now_s)
        return pdu[:5]

    def _mask_write(self, pdu: bytes, now_s: float) -> bytes:
        """New content = (old AND and_mask) OR (or_mask AND NOT and_mask) (V1.1b3, 6.16)."""
        _check(len(pdu) == 7, ILLEGAL_VALUE)
        address, and_mask, or_mask = unpack_from(">HHH", pdu, 1)
        _check(self.image.has(address, 1), ILLEGAL_ADDRESS)
        old = int.from_bytes(self._live_words(address, 1, now_s))
        new = (old & and_mask) | (or_mask & ~and_mask & 0xFFFF)
        self._store(22, address, new.to_bytes(2), now_s)
        return pdu

    def _read_write_registers(self, pdu: bytes, now_s: float) -> bytes:
        """Write first, then read (V1.1b3, 6.17)."""
        _check(len(pdu) >= 10, ILLEGAL_VALUE)
        read_address, read_count, write_address, write_count = unpack_from(">HHHH", pdu, 1)
        _check(_block_fits(pdu, 9, 2 * write_count), ILLEGAL_VALUE)
        _check(1 <= read_count <= MAX_READ_REGISTERS, ILLEGAL_VALUE)
        self._check_registers(write_address, write_count, MAX_FC23_WRITE_REGISTERS)
        self._check_registers(read_address, read_count, MAX_READ_REGISTERS)
        self._store(23, write_address, pdu[10:], now_s)
        return bytes((23, 2 * read_count)) + self._live_words(read_address, read_count, now_s)

    def _echo(self, pdu: bytes, _now_s: float) -> bytes:
        return pdu

    def _check_registers(self, address: int, count: int, most: int) -> None:
        _check(1 <= count <= min(most, self._max_registers), ILLEGAL_VALUE)
        _check(self.image.has(address, count), ILLEGAL_ADDRESS)

    def _live_words(self, address: int, count: int, now_s: float) -> bytes:
        for axis in self.axes:
            axis.refresh(self.image, now_s)
        return self.image.words(address, count)

    def _store(self, function: int, address: int, data: bytes, now_s: float) -> None:
        self.image.store_words(address, data)
        self.ledger.writes.append(WriteRecord(self.unit_id, function, address, bytes(data), now_s))
        for axis in self.axes:
            axis.written(self.image, address, len(data) // 2, now_s)


def _check(good: bool, exception_code: int) -> None:
    if not good:
        raise _RefusedError(exception_code)


def _two_words(pdu: bytes, length: int | None) -> tuple[int, int]:
    """The two words after the function code; ``length`` is the whole request's, where it is fixed."""
    _check(len(pdu) == length if length else len(pdu) > 5, ILLEGAL_VALUE)
    first, second = unpack_from(">HH", pdu, 1)
    return first, second


def _block_fits(pdu: bytes, at: int, size: int) -> bool:
    """Whether the byte count at ``at`` and the bytes that follow it are both ``size``."""
    return pdu[at] == size and len(pdu) == at + 1 + size
