"""Numbers to words and back: one codec for each register type and word order, made once at import.

One call reads or writes a whole field; in compiled code that takes a few instructions (``librt``).
"""

import struct
from typing import Final, NoReturn

from librt.strings import (
    BytesWriter,
    read_i16_be,
    read_i32_be,
    read_i64_be,
    write_i16_be,
    write_i32_be,
    write_i64_be,
)

from gateway.catalogue import refusals
from gateway.counts import Raw
from gateway.modbus.errors import RegisterDataError, RegisterRangeError

FLOAT32_MAX: Final = (2.0 - 2.0**-23) * 2.0**127
"""Largest number of IEEE 754 single precision, 3.4028235e38."""
WORD_BITS: Final = 16
WORD_MASK: Final = 0xFFFF


class Codec:
    """One register type in one word order."""

    __slots__ = ("_low_first", "_name", "_struct", "words")

    def __init__(self, name: str, layout: str, *, low_first: bool) -> None:
        self._name = name
        self._low_first = low_first
        self._struct = struct.Struct(layout)
        self.words = self._struct.size // 2
        """Number of registers of the type."""

    def unpack(self, data: bytes, offset: int) -> Raw:
        """Read the value that starts at byte ``offset``, or raise RegisterDataError."""
        raise NotImplementedError

    def pack(self, raw: Raw) -> bytes:
        """Write a value, or raise RegisterRangeError."""
        raise NotImplementedError

    def _too_short(self, data: bytes, offset: int) -> NoReturn:
        raise RegisterDataError(
            f"{self._name} fills {self._struct.size} bytes from byte {offset}, but there are only {len(data)}"
        )


class Integer(Codec):
    """Integers that are one number in wire order: every type of one word, and the high-first ones."""

    __slots__ = ("_is_signed", "_largest", "_range", "_smallest")

    def __init__(self, name: str, layout: str, *, low_first: bool) -> None:
        super().__init__(name, layout, low_first=low_first)
        self._range = 1 << WORD_BITS * self.words
        self._is_signed = not name.startswith("u")
        self._smallest = -self._range // 2 if self._is_signed else 0
        self._largest = self._smallest + self._range - 1

    def unpack(self, data: bytes, offset: int) -> int:
        """See ``Codec``."""
        value: int
        try:
            if self.words == 2:
                value = read_i32_be(data, offset)
            elif self.words == 1:
                value = read_i16_be(data, offset)
            else:
                value = read_i64_be(data, offset)
        except (IndexError, ValueError):
            self._too_short(data, offset)
        return value if self._is_signed or value >= 0 else value + self._range

    def pack(self, raw: Raw) -> bytes:
        """See ``Codec``."""
        if type(raw) is not int or not self._smallest <= raw <= self._largest:
            self._refuse(raw)
        number = raw
        if not self._is_signed and number > self._largest // 2:
            number -= self._range
        written = BytesWriter()
        if self.words == 2:
            write_i32_be(written, number)
        elif self.words == 1:
            write_i16_be(written, number)
        else:
            write_i64_be(written, number)
        return written.getvalue()

    def _refuse(self, raw: Raw) -> NoReturn:
        limits = f"whole numbers from {self._smallest} to {self._largest}"
        raise RegisterRangeError(refusals.DOES_NOT_FIT.sentence(raw=raw, field=self._name, limits=limits))


class _LowFirstPair(Integer):
    """Two words, the least significant first: the usual case, with its own fast code."""

    __slots__ = ()

    def unpack(self, data: bytes, offset: int) -> int:
        """See ``Codec``."""
        try:
            low, high = read_i16_be(data, offset), read_i16_be(data, offset + 2)
        except (IndexError, ValueError):
            self._too_short(data, offset)
        value = int(high) << WORD_BITS | int(low) & WORD_MASK
        return value if self._is_signed or value >= 0 else value + self._range

    def pack(self, raw: Raw) -> bytes:
        """See ``Codec``."""
        high_first = super().pack(raw)
        return high_first[2:] + high_first[:2]


class _Words(Integer):
    """Any number of words in either order, of which the most significant has the sign."""

    __slots__ = ()

    def unpack(self, data: bytes, offset: int) -> int:
        """See ``Codec``."""
        try:
            words = self._struct.unpack_from(data, offset)
        except struct.error:
            self._too_short(data, offset)
        value = 0
        for word in reversed(words) if self._low_first else words:
            value = value << WORD_BITS | word
        return value

    def pack(self, raw: Raw) -> bytes:
        """See ``Codec``."""
        if type(raw) is not int or not self._smallest <= raw <= self._largest:
            self._refuse(raw)
        number = raw
        low_first = [number >> WORD_BITS * index & WORD_MASK for index in range(self.words - 1)]
        low_first.append(number >> WORD_BITS * (self.words - 1))
        return self._struct.pack(*(low_first if self._low_first else reversed(low_first)))


class _Float32(Codec):
    """Single precision. Packing rounds to the nearest, and refuses what would become infinite."""

    __slots__ = ()

    def unpack(self, data: bytes, offset: int) -> float:
        """See ``Codec``."""
        end = offset + 4
        if offset < 0 or len(data) < end:
            self._too_short(data, offset)
        if self._low_first:
            data = data[offset + 2 : end] + data[offset : offset + 2]
            offset = 0
        value: float = self._struct.unpack_from(data, offset)[0]
        return value

    def pack(self, raw: Raw) -> bytes:
        """See ``Codec``."""
        if isinstance(raw, bool) or not -FLOAT32_MAX <= raw <= FLOAT32_MAX:
            limits = f"finite numbers from {-FLOAT32_MAX:.8g} to {FLOAT32_MAX:.8g}"
            raise RegisterRangeError(refusals.DOES_NOT_FIT.sentence(raw=raw, field=self._name, limits=limits))
        high_first = self._struct.pack(raw)
        return high_first[2:] + high_first[:2] if self._low_first else high_first


_CODECS: Final[dict[tuple[str, bool], Codec]] = {
    ("int16", False): Integer("int16", ">h", low_first=False),
    ("int16", True): Integer("int16", ">h", low_first=True),
    ("uint16", False): Integer("uint16", ">H", low_first=False),
    ("uint16", True): Integer("uint16", ">H", low_first=True),
    ("int32", False): Integer("int32", ">i", low_first=False),
    ("int32", True): _LowFirstPair("int32", ">Hh", low_first=True),
    ("uint32", False): Integer("uint32", ">I", low_first=False),
    ("uint32", True): _LowFirstPair("uint32", ">HH", low_first=True),
    ("int48", False): _Words("int48", ">hHH", low_first=False),
    ("int48", True): _Words("int48", ">HHh", low_first=True),
    ("int64", False): Integer("int64", ">q", low_first=False),
    ("int64", True): _Words("int64", ">HHHh", low_first=True),
    ("float32", False): _Float32("float32", ">f", low_first=False),
    ("float32", True): _Float32("float32", ">f", low_first=True),
}


def codec_of(name: str, *, low_first: bool) -> Codec:
    """Return the one codec of a register type in a word order."""
    return _CODECS[name, low_first]
