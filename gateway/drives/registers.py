"""The registers of one drive: ``[axis.NAME.registers]``, and the body of a drive profile."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import combinations
from typing import Annotated, Final

from pydantic import Field, model_validator

from gateway.drives.rules import ModeSpec, TriggerSpec
from gateway.drives.strict import ByName, ListOf, StrictModel
from gateway.drives.words import LAST_ADDRESS, Address, Bit
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder

MAX_SCALE: Final = 1e9
MAX_GAP_MS: Final = 10_000
MAX_REGISTERS: Final = 125
"""Most registers that one frame can carry (FC03; Modbus application protocol V1.1b3, 6.3)."""
DEFAULT_MAX_REGISTERS: Final = 123
"""Most registers that FC16 can write (6.12 there)."""


class WriteFunction(Enum):
    """The function code with which the gateway writes a position."""

    FC16 = "fc16"
    FC06 = "fc06"

    @property
    def code(self) -> int:
        """The code itself."""
        return 16 if self is WriteFunction.FC16 else 6


class OnException(Enum):
    """What a refusal by the drive proves about the registers it was to write."""

    UNKNOWN = "unknown"
    NOTHING_WRITTEN = "nothing-written"


class PositionSpec(StrictModel):
    """A position in one or more registers."""

    address: Address = Field(description="first register")
    type: ByName[RegisterType] = Field(description="how the number is stored")
    words: ByName[WordOrder] = Field(
        default=WordOrder.HIGH_FIRST, description="which word of a longer number comes first"
    )
    scale: Annotated[float, Field(gt=0.0, le=MAX_SCALE)] = Field(
        default=1.0, description="counts in one step of this field"
    )

    @model_validator(mode="after")
    def _ends_inside(self) -> "PositionSpec":
        last = self.address + self.type.words - 1
        if last > LAST_ADDRESS:
            raise ValueError(
                f"{self.type.value} takes {self.type.words} registers and would end at {last:#06x}: "
                f"the last one is {LAST_ADDRESS:#06x}"
            )
        return self

    def field(self) -> PositionField:
        """Return it as the exchange uses it."""
        return PositionField(self.address, self.type, self.words, self.scale)


class BitSpec(StrictModel):
    """One bit of one register."""

    address: Address = Field(description="the register")
    bit: Bit = Field(description="the bit, 0 being the lowest")

    def field(self) -> BitField:
        """Return it as the exchange uses it."""
        return BitField(self.address, self.bit)


class BitsSpec(StrictModel):
    """What the drive tells about its state; each is true while its bit is 1."""

    homed: BitSpec | None = Field(default=None, description="the drive knows where it is")
    done: BitSpec | None = Field(default=None, description="the last move has ended")
    moving: BitSpec | None = Field(default=None, description="the axis moves")
    alarm: BitSpec | None = Field(default=None, description="the drive has given up")

    def named(self) -> Iterator[tuple[str, BitSpec]]:
        """Yield the bits that are mapped, with their names."""
        for name in BitsSpec.model_fields:
            bit: BitSpec | None = getattr(self, name)
            if bit is not None:
                yield name, bit


class RegisterMap(StrictModel):
    """Which registers of a drive hold positions, and how the drive wants to be spoken to."""

    command: Annotated[ListOf[PositionSpec], Field(min_length=1)] = Field(
        description="positions that the controller writes; read back they give the nominal value too"
    )
    actual: ListOf[PositionSpec] = Field(default=(), description="measured positions")
    commanded: ListOf[PositionSpec] = Field(
        default=(), description="positions that the drive's own profile commands at the moment"
    )
    limits: ListOf[PositionSpec] = Field(default=(), description="software limits")
    aliases: ListOf[PositionSpec] = Field(default=(), description="further addresses of the same positions")
    position_like: ListOf[PositionSpec] = Field(
        default=(), description="positions that are not mapped; writing them is refused"
    )
    remap: ListOf[PositionSpec] = Field(
        default=(), description="registers that move other registers about; writing one ends the compensation"
    )
    mode: ModeSpec | None = Field(
        default=None, description="how an absolute position is told from a distance"
    )
    trigger: ListOf[TriggerSpec] = Field(default=(), description="registers whose values make the drive act")
    bits: BitsSpec = Field(default=BitsSpec(), description="state bits")
    staged: bool = Field(default=False, description="a written position waits for a trigger")
    starts_on: ListOf[Address] = Field(default=(), description="words of a position that start the motion")
    write: ByName[WriteFunction] = Field(
        default=WriteFunction.FC16, description="function code with which the gateway writes a position"
    )
    exception: ByName[OnException] = Field(
        default=OnException.UNKNOWN, description="what a refusal by the drive proves"
    )
    safe_read: bool = Field(
        default=True, description="the gateway may read mapped positions and bits by itself"
    )
    max_registers: Annotated[int, Field(ge=1, le=MAX_REGISTERS)] = Field(
        default=DEFAULT_MAX_REGISTERS, description="most registers that the drive takes in one frame"
    )
    gap_ms: Annotated[float, Field(ge=0.0, le=MAX_GAP_MS)] = Field(
        default=0.0, description="silence in milliseconds that the drive needs before a request"
    )


POSITION_KEYS: Final = ("command", "actual", "commanded", "limits", "aliases", "position_like", "remap")
"""Keys of a register map whose positions may not share a register."""


@dataclass(frozen=True, slots=True)
class Span:
    """Registers that one key of a register map claims. ``key`` is its path inside the map."""

    key: tuple[str | int, ...]
    first: int
    words: int

    @property
    def last(self) -> int:
        """Last register claimed."""
        return self.first + self.words - 1

    def __str__(self) -> str:
        return f"{self.first:#06x}" if self.words == 1 else f"{self.first:#06x}..{self.last:#06x}"


def position_spans(registers: RegisterMap) -> list[Span]:
    """Return the registers of every mapped position."""
    return [
        Span((key, index), position.address, position.type.words)
        for key in POSITION_KEYS
        for index, position in enumerate(getattr(registers, key))
    ]


def bit_spans(registers: RegisterMap) -> list[Span]:
    """Return the registers that hold mapped bits."""
    return [Span(("bits", name), bit.address, 1) for name, bit in registers.bits.named()]


def share_register(one: Span, other: Span) -> bool:
    """Whether two spans have a register in common.

    >>> share_register(Span(("command", 0), 10, 2), Span(("actual", 0), 11, 2))
    True
    """
    return one.first <= other.last and other.first <= one.last


def clashes(registers: RegisterMap) -> list[tuple[Span, Span]]:
    """Return every pair of one map that shares a register; several bits may share theirs."""
    positions: Sequence[Span] = position_spans(registers)
    bits = bit_spans(registers)
    pairs = [*combinations(positions, 2), *((p, b) for p in positions for b in bits)]
    return [(one, other) for one, other in pairs if share_register(one, other)]
