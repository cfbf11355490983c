"""Fields in registers: positions in 16-bit words, and single bits of status words.

Bytes inside a word are big-endian for every drive known to us; only the order of the words differs.
``high-first`` has the most significant word at the lowest address, ``low-first`` the least significant one.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import Enum
from typing import Final

from gateway.counts import Raw
from gateway.modbus.errors import RegisterFieldError, RegisterRangeError
from gateway.modbus.words import Codec, codec_of

__all__ = [
    "BitField",
    "BitTable",
    "FieldAccess",
    "PositionField",
    "RegisterRangeError",
    "RegisterType",
    "WordOrder",
]

ADDRESSES: Final = 0x10000
BITS_OF_A_WORD: Final = 16


class WordOrder(Enum):
    """Which word of a field is at its lowest address."""

    HIGH_FIRST = "high-first"
    LOW_FIRST = "low-first"


FLOAT_STEP: Final = 2.0**-23
"""Largest distance of two neighbouring float32 numbers, as a share of their value."""


class RegisterType(Enum):
    """Type of a field. Signed integers are two's complement, ``float32`` is IEEE 754 single precision."""

    INT16 = "int16"
    UINT16 = "uint16"
    INT32 = "int32"
    UINT32 = "uint32"
    INT48 = "int48"
    INT64 = "int64"
    FLOAT32 = "float32"

    @property
    def words(self) -> int:
        """Number of registers of the type.

        >>> RegisterType.INT48.words
        3
        """
        return codec_of(self.value, low_first=False).words

    @property
    def is_float(self) -> bool:
        """Whether raw values are floating point numbers."""
        return self is RegisterType.FLOAT32


class FieldAccess(Enum):
    """Which requests reach a field: with some drives a read returns another field than a write sets."""

    BOTH = "both"
    READ = "read"
    WRITE = "write"


class BitTable(Enum):
    """Where a status bit is."""

    REGISTER = "register"
    COIL = "coil"
    INPUT = "input"
    """A discrete input."""


class _WithCodec:
    """Holds the codec of a field, besides its description."""

    __slots__ = ("codec", "words")
    codec: Codec
    """Packs and unpacks its raw values."""
    words: int
    """Number of registers of the field."""


@dataclass(frozen=True, slots=True)
class PositionField(_WithCodec):
    """One position in a drive's registers: counts = raw × ``scale``.

    The address is the one on the wire, counted from 0. With ``block`` the field exists only in frames that
    begin at that address: there an address is a command, not memory.

    >>> target = PositionField(0x6F00, RegisterType.INT32, WordOrder.LOW_FIRST)
    >>> target.pack(0x00085555).hex(" ")
    '55 55 00 08'
    >>> hex(target.unpack(bytes.fromhex("55 55 00 08")))
    '0x85555'
    """

    address: int
    type: RegisterType
    order: WordOrder = WordOrder.HIGH_FIRST
    scale: float = 1.0
    access: FieldAccess = FieldAccess.BOTH
    block: int | None = None

    def __post_init__(self) -> None:
        codec = codec_of(self.type.value, low_first=self.order is WordOrder.LOW_FIRST)
        object.__setattr__(self, "codec", codec)
        object.__setattr__(self, "words", codec.words)
        if not 0 <= self.address <= ADDRESSES - codec.words:
            last = ADDRESSES - codec.words
            raise RegisterFieldError(f"address {self.address} of an {self.type.value} is not in 0 … {last}")
        if not math.isfinite(self.scale) or self.scale == 0.0:
            raise RegisterFieldError(
                f"scale {self.scale} is not allowed: give the counts per raw step, finite and not 0"
            )

    def __reduce__(self) -> "tuple[Callable[..., PositionField], tuple[object, ...]]":
        return PositionField, tuple(getattr(self, each.name) for each in fields(self))

    def step_counts(self, largest_counts: float) -> float:
        """Return the smallest step that the field can show, in counts, up to ``largest_counts``.

        >>> PositionField(0, RegisterType.FLOAT32).step_counts(2.0**23)
        1.0
        """
        return FLOAT_STEP * largest_counts if self.type.is_float else abs(self.scale)

    @property
    def is_readable(self) -> bool:
        """Whether a read of exactly its registers returns it.

        >>> PositionField(0x31, RegisterType.INT48, access=FieldAccess.READ, block=0x31).is_readable
        True
        >>> PositionField(0xF7, RegisterType.INT32, block=0xF5).is_readable
        False
        """
        return self.access is not FieldAccess.WRITE and self.block in (None, self.address)

    @property
    def end(self) -> int:
        """The first address after the field."""
        return self.address + self.words

    @property
    def is_high_first_pair(self) -> bool:
        """Whether it is an integer of four bytes, the highest one first."""
        is_whole = not self.type.is_float and self.words == 2
        return is_whole and self.order is WordOrder.HIGH_FIRST

    def unpack(self, data: bytes, offset: int = 0) -> Raw:
        """Return the raw value that starts at byte ``offset`` of ``data``.

        Raises RegisterDataError if ``data`` ends inside the field. A float32 may be NaN or infinite.
        """
        return self.codec.unpack(data, offset)

    def pack(self, raw: Raw) -> bytes:
        """Return the bytes of a raw value in the order of the wire.

        Raises RegisterRangeError if the field cannot hold it: out of range, not finite, a fraction for an
        integer, a bool.
        """
        return self.codec.pack(raw)


@dataclass(frozen=True, slots=True)
class BitField:
    """One bit of one register, bit 0 being the least significant; or one coil or discrete input.

    ``is_inverted``: the drive uses 0 for yes.

    >>> BitField(0x1003, 6).is_set(0x0040)
    True
    >>> BitField(0x0048, 0, BitTable.INPUT, is_inverted=True).is_set(1)
    False
    """

    address: int
    bit: int = 0
    table: BitTable = BitTable.REGISTER
    is_inverted: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.address < ADDRESSES:
            raise RegisterFieldError(f"address {self.address} of a bit is not in 0 … {ADDRESSES - 1}")
        if not 0 <= self.bit < BITS_OF_A_WORD:
            raise RegisterFieldError(f"bit {self.bit} of register {self.address} is not in 0 … 15")

    def is_set(self, word: int) -> bool:
        """Whether the register's value means yes; for a coil or input, its own value."""
        return bool(word >> self.bit & 1) is not self.is_inverted
