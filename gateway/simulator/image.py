"""The memory of a simulated drive: 16-bit registers and single bits."""

from array import array
from sys import byteorder
from typing import Final

from gateway.modbus.registers import BitField

ADDRESS_SPACE: Final = 0x10000


class RegisterImage:
    """Registers (holding and input registers are one and the same) and coils (also read as discrete inputs).

    ``size`` registers and as many coils exist, from address 0.
    """

    def __init__(self, size: int = ADDRESS_SPACE) -> None:
        self._words = array("H", bytes(2 * size))
        self._coils = bytearray(size)

    def has(self, address: int, count: int) -> bool:
        """Whether all of a range exists."""
        return address + count <= len(self._words)

    def words(self, address: int, count: int) -> bytes:
        """Registers as they travel: two bytes each, high byte first."""
        chunk = self._words[address : address + count]
        _swap(chunk)
        return chunk.tobytes()

    def store_words(self, address: int, data: bytes) -> None:
        """Write registers from the bytes of a frame."""
        chunk = array("H", data)
        _swap(chunk)
        self._words[address : address + len(chunk)] = chunk

    def word(self, address: int) -> int:
        """One register."""
        return self._words[address]

    def set_word(self, address: int, word: int) -> None:
        """Change one register; more than 16 bits are cut off."""
        self._words[address] = word & 0xFFFF

    def set_bit(self, bit_field: BitField, on: bool) -> None:
        """Set or clear one bit and leave the rest of its register alone."""
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
        """Coils as they travel: eight to a byte, the lowest address in the lowest bit."""
        packed = bytearray((count + 7) // 8)
        for index in range(count):
            packed[index >> 3] |= self._coils[address + index] << (index & 7)
        return bytes(packed)


def _swap(chunk: "array[int]") -> None:
    if byteorder == "little":
        chunk.byteswap()
