"""The registers of one drive: ``[axis.NAME.registers]``, and the body of a drive profile."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Final

from pydantic import Field, model_validator

from gateway.drives.motion import Addressing, Form, MotionPlan, NextTarget
from gateway.drives.rules import ModeSource, ModeSpec, TriggerSpec
from gateway.drives.strict import ByName, ListOf, Planned, StrictModel, documented
from gateway.drives.words import LAST_ADDRESS, Address, Bit
from gateway.modbus.registers import (
    BitField,
    BitTable,
    FieldAccess,
    PositionField,
    RegisterType,
    WordOrder,
)

MAX_SCALE: Final = 1e9
MAX_GAP_MS: Final = 10_000
MAX_DROP_MS: Final = 60_000
MAX_REGISTERS: Final = 125
"""Most registers that one frame can carry (FC03; Modbus application protocol V1.1b3, 6.3)."""
MAX_PATHS: Final = 256
DEFAULT_MAX_REGISTERS: Final = 123
"""Most registers that FC16 can write (6.12 there)."""


class DoneMeans(Enum):
    """The meaning of a drive's done bit."""

    MOVE_ENDED = "move-ended"
    """The last move has ended."""
    IN_POSITION = "in-position"
    """It is near its momentary setpoint, also on the way."""


class OnException(Enum):
    """What a refusal by the drive proves about the registers of the request."""

    UNKNOWN = "unknown"
    NOTHING_WRITTEN = "nothing-written"


READ_FORMS: Final = (Form.FC03, Form.FC04, Form.MEI)
WRITE_FORMS: Final = (Form.FC16, Form.FC06, Form.MEI)


class PositionSpec(StrictModel):
    """A position in one or more registers."""

    address: Address = Field(description="first register")
    type: ByName[RegisterType] = Field(description="how the number is stored")
    words: ByName[WordOrder] = Field(
        default=WordOrder.HIGH_FIRST,
        description="which word of a longer number comes first",
        json_schema_extra=documented(more="The wrong order turns 10000 into 655360000"),
    )
    scale: Annotated[float, Field(gt=0.0, le=MAX_SCALE)] = Field(
        default=1.0, description="counts in one step of this field"
    )
    access: ByName[FieldAccess] = Field(
        default=FieldAccess.BOTH,
        description="where something else is read at this address than was written: read or write",
        json_schema_extra=documented(
            text=(
                "if a drive shows something else at an address than was written, two positions share it: "
                'one is `"read"`, the other `"write"`'
            )
        ),
    )
    block: Address | None = Field(
        default=None,
        description="the position is only in frames that begin at this address",
        json_schema_extra=documented(
            text=(
                "the position is only in frames that begin at this address. For drives whose addresses "
                "are commands: frames of four registers at 0x00F5 and at 0x00F4 are different commands, "
                "although they overlap"
            )
        ),
    )

    @model_validator(mode="after")
    def _ends_inside(self) -> "PositionSpec":
        last = self.address + self.type.words - 1
        if last > LAST_ADDRESS:
            raise ValueError(
                f"{self.type.value} takes {self.type.words} registers and would end at {last:#06x}: "
                f"the last one is {LAST_ADDRESS:#06x}"
            )
        if self.block is not None and self.block > self.address:
            raise ValueError(
                f"a frame that begins at {self.block:#06x} does not hold {self.address:#06x}: "
                "block is the address of the frame, at or before the position"
            )
        return self

    def field(self, offset: int = 0) -> PositionField:
        """Return it for the exchange, ``offset`` registers further on."""
        block = None if self.block is None else self.block + offset
        return PositionField(self.address + offset, self.type, self.words, self.scale, self.access, block)


class PathsSpec(StrictModel):
    """Further positions of the same kind at even distances."""

    count: Annotated[int, Field(ge=1, le=MAX_PATHS)] = Field(description="how many there are")
    stride: Annotated[int, Field(ge=1, le=LAST_ADDRESS)] = Field(
        description="registers from one to the next, for the mode too"
    )


class RepeatedSpec(PositionSpec):
    """A position, and perhaps further ones of the same kind."""

    paths: PathsSpec | None = Field(
        default=None,
        description="further positions at even distances",
        json_schema_extra=documented(
            text=(
                "only in `command` (as its only entry), `position_like` and `remap`: `count` (1 to 256) "
                "positions of this kind, each `stride` registers after the previous one; in `command` "
                "the address of `mode` advances by the same `stride`"
            ),
            kind="`{ count, stride }`",
        ),
    )

    @model_validator(mode="after")
    def _paths_fit(self) -> "RepeatedSpec":
        last = self.address + self.offsets[-1] + self.type.words - 1
        if last > LAST_ADDRESS:
            raise ValueError(
                f"the last path would end at {last:#06x}: the last register is {LAST_ADDRESS:#06x}"
            )
        return self

    @property
    def overlap(self) -> str:
        """Say which path would begin inside the one before it; empty if none does."""
        if self.paths is None or self.paths.count == 1 or self.paths.stride >= self.type.words:
            return ""
        return f"stride = {self.paths.stride}, but {self.type.value} takes {self.type.words} registers"

    def fields(self) -> list[PositionField]:
        """Return one field for each path."""
        return [self.field(offset) for offset in self.offsets]

    @property
    def offsets(self) -> list[int]:
        """Return the offset of each path in registers."""
        return [0] if self.paths is None else [self.paths.stride * n for n in range(self.paths.count)]


class CommandSpec(RepeatedSpec):
    """A position that the controller writes."""

    mode: ModeSpec | None = Field(
        default=None,
        description="how this position is meant, where it is not as the map says",
        json_schema_extra=documented(more="Only in `command`", default="as `mode` of the map"),
    )


class ActualSpec(PositionSpec):
    """A measured position."""

    set_position: bool = Field(
        default=False,
        description=("writing it tells the drive that it is elsewhere"),
        json_schema_extra=documented(more="Only in `actual`"),
    )


class BitSpec(StrictModel):
    """One bit of one register, or a coil or discrete input."""

    address: Address = Field(description="the register, coil or input")
    bit: Bit = Field(
        default=0,
        description="the bit of the register, 0 being the lowest",
        json_schema_extra=documented(kind="0 (lowest) to 15", default="required with a register"),
    )
    table: ByName[BitTable] = Field(
        default=BitTable.REGISTER,
        description="register, coil or input",
        json_schema_extra=documented(
            text=("a coil (function code 1) or a discrete input (function code 2) has no `bit`")
        ),
    )
    inverted: bool = Field(default=False, description="0 means yes")

    @model_validator(mode="after")
    def _has_bits(self) -> "BitSpec":
        if self.table is not BitTable.REGISTER and "bit" in self.model_fields_set:
            raise ValueError("a coil or input has no bits: leave bit out")
        if self.table is BitTable.REGISTER and "bit" not in self.model_fields_set:
            raise ValueError("a register has 16 bits: say which")
        return self

    def field(self) -> BitField:
        """Return it for the exchange."""
        return BitField(self.address, self.bit, self.table, self.inverted)


class ObjectSpec(StrictModel):
    """The number of registers of an object that is no position."""

    address: Address = Field(description="index of the object")
    words: Annotated[int, Field(ge=1, le=4)] = Field(description="its registers")


class BitsSpec(StrictModel):
    """The status bits of the drive; each is true while its bit is 1."""

    homed: BitSpec | None = Field(default=None, description="the drive knows where it is")
    homing_done: BitSpec | None = Field(
        default=None,
        description="the commanded homing has succeeded; at other times the bit means something else",
    )
    done: BitSpec | None = Field(default=None, description="the last move has ended")
    moving: BitSpec | None = Field(default=None, description="the axis moves")
    alarm: BitSpec | None = Field(default=None, description="the drive has given up")

    def named(self) -> Iterator[tuple[str, BitSpec]]:
        """Yield the mapped bits, with their names."""
        for name in BitsSpec.model_fields:
            bit: BitSpec | None = getattr(self, name)
            if bit is not None:
                yield name, bit


class RegisterMap(StrictModel):
    """The position registers of a drive, and how the drive must be addressed."""

    command: Annotated[ListOf[CommandSpec], Field(min_length=1)] = Field(
        description="positions that the controller writes; read back they give the nominal value too"
    )
    actual: ListOf[ActualSpec] = Field(
        default=(),
        description="measured positions",
        json_schema_extra=documented(
            text=(
                "measured positions. If writing one tells the drive that it is elsewhere, set "
                "`set_position = true` in it"
            )
        ),
    )
    commanded: ListOf[PositionSpec] = Field(
        default=(), description="positions that the drive's own profile commands at the moment"
    )
    limits: ListOf[PositionSpec] = Field(
        default=(),
        description="positions that the drive compares its own with: software limits, areas",
        json_schema_extra=documented(
            text=(
                "positions that the drive compares its own with: software limits, areas. Corrected half "
                "way between the two directions. A limit of 0 passes unchanged: for many drives it means "
                "none. A write of part of a limit is refused"
            )
        ),
    )
    aliases: ListOf[PositionSpec] = Field(
        default=(),
        description="further addresses at which the same positions are read",
        json_schema_extra=documented(
            text=(
                "further addresses at which positions are read, corrected like `actual`. A write while "
                "the axis is corrected gets exception 2"
            )
        ),
    )
    position_like: ListOf[RepeatedSpec] = Field(
        default=(),
        description="positions that are not mapped; writing them is refused",
        json_schema_extra=documented(
            text=(
                "unmapped positions (mirrors, stored targets, home offsets). A write while the axis is "
                "corrected gets exception 2 (see `unmapped`); reads pass unchanged"
            )
        ),
    )
    remap: ListOf[RepeatedSpec] = Field(
        default=(),
        description="registers that move other registers about; writing one ends the compensation",
        json_schema_extra=documented(
            text=(
                "registers that move other registers or swap their words. A write ends the compensation "
                "of its unit until a restart of the gateway"
            )
        ),
    )
    mode: ModeSpec | None = Field(
        default=None,
        description="whether a written position is absolute or a distance",
        json_schema_extra=documented(more="See below", default="absolute"),
    )
    trigger: ListOf[TriggerSpec] = Field(
        default=(),
        description="registers whose values make the drive act",
        json_schema_extra=documented(more="Coils too, see below"),
    )
    bits: BitsSpec = Field(
        default=BitsSpec(),
        description="state bits",
        json_schema_extra=documented(more=("`homed`, `homing_done`, `done`, `moving`, `alarm`, see below")),
    )
    done_means: ByName[DoneMeans] = Field(
        default=DoneMeans.MOVE_ENDED,
        description="what bits.done says: move-ended or in-position",
        json_schema_extra=documented(
            text=(
                "`move-ended`: `bits.done` falls when a move begins and returns when it has ended. "
                "`in-position`: the axis is near its present setpoint, perhaps still on the way; arrival "
                "then needs an actual position"
            )
        ),
    )
    done_drop_ms: Planned[Annotated[float, Field(ge=0.0, le=MAX_DROP_MS)]] = Field(
        default=1000.0,
        description="milliseconds that bits.done may still be that of the move before",
        json_schema_extra=documented(
            text=(
                "how long after an acknowledged target `bits.done` may still be that of the previous "
                "move. Within this time it counts as arrival, or as standstill before a distance, only "
                "after it was seen to fall"
            )
        ),
    )
    next_target: Planned[ByName[NextTarget]] = Field(
        default=NextTarget.AT_ONCE,
        description="what a target does that comes while the axis moves: at-once, queued or unknown",
        json_schema_extra=documented(
            text=(
                "a target that comes during a move. `at-once`: the axis goes there from where it is. "
                "`queued`: it first goes to the previous one, like CiA 402 drives with sets of "
                "set-points; its direction then follows the order of the targets. `unknown`: the "
                "controller decides with each start; where the two directions differ the move is flagged"
            )
        ),
    )
    staged: bool = Field(
        default=False,
        description="a written position waits for a trigger",
        json_schema_extra=documented(
            text=(
                "a written position waits for a trigger, and is corrected for that moment, see below. "
                "Needs a `trigger`"
            )
        ),
    )
    starts_on: ListOf[Address] = Field(
        default=(),
        description="words of a position that start the motion",
        json_schema_extra=documented(
            text=(
                "words that start the motion when written: a word of a position, or a speed beside it. "
                "The other words wait for it"
            )
        ),
    )
    addressing: Planned[ByName[Addressing]] = Field(
        default=Addressing.REGISTERS,
        description="whether an address is a register, or an object with its own width",
        json_schema_extra=documented(
            text=(
                '`"objects"`: an address is the index of an object with its own width. Two registers at '
                "0x6064 do not touch 0x6065, and a frame holds consecutive whole objects"
            )
        ),
    )
    objects: ListOf[ObjectSpec] = Field(
        default=(),
        description="widths of objects that are no positions, where frames hold several objects",
        json_schema_extra=documented(
            text=(
                'with `addressing = "objects"`: registers (1 to 4) of an object that is not a position, '
                "as in `{ address = 0x6081, words = 2 }`; default 1. Needed only if a frame holds "
                "several objects"
            ),
            kind="list of `{ address, words }`",
        ),
    )
    read: ByName[Form] = Field(
        default=Form.FC03,
        description="how the gateway itself reads a position: fc03, fc04 or mei",
        json_schema_extra=documented(kind='`"fc03"`, `"fc04"`, `"mei"`'),
    )
    write: ByName[Form] = Field(
        default=Form.FC16,
        description="how the gateway itself writes a position: fc16, fc06 or mei",
        json_schema_extra=documented(
            text=(
                "how the gateway writes a position; `fc06` writes a longer one word by word and needs "
                "`staged = true`, or the first word would already move the axis"
            ),
            kind='`"fc16"`, `"fc06"`, `"mei"`',
        ),
    )
    refused_read: Planned[Annotated[int, Field(ge=0, le=255)]] = Field(
        default=0,
        description="function byte with which the drive refuses every read; 0: the usual one",
        json_schema_extra=documented(
            text=(
                "function byte with which the drive refuses every read, as Kinco with `0x81`; `0`: the "
                "standard's (bit 7 set in the request's). On RTU any other byte is no answer"
            )
        ),
    )
    exception: ByName[OnException] = Field(
        default=OnException.UNKNOWN, description="what a refusal by the drive proves"
    )
    safe_read: Planned[bool] = Field(
        default=True, description="the gateway may add reads of mapped positions and bits"
    )
    checks_crc: Planned[bool] = Field(
        default=True,
        description="the drive obeys no frame with a wrong check sum and does not answer it either",
    )
    max_registers: Planned[Annotated[int, Field(ge=1, le=MAX_REGISTERS)]] = Field(
        default=DEFAULT_MAX_REGISTERS, description="most registers that the drive takes in one frame"
    )
    gap_ms: Annotated[float, Field(ge=0.0, le=MAX_GAP_MS)] = Field(
        default=0.0, description="silence in milliseconds that the drive needs before a request"
    )
    response_ms: Planned[Annotated[float, Field(ge=0.0, le=MAX_GAP_MS)] | None] = Field(
        default=None,
        description="milliseconds that the drive takes before it answers; only the budget reckons with it",
        json_schema_extra=documented(
            text=("time that this drive needs to answer. Only `pitch-gateway budget` and `check` use it"),
            default="not known",
        ),
    )

    @model_validator(mode="after")
    def _fits_together(self) -> "RegisterMap":
        rule = self._broken_rule()
        if rule:
            raise ValueError(rule)
        return self

    def _broken_rule(self) -> str:
        if self.read not in READ_FORMS:
            return 'read: allowed: "fc03", "fc04" or "mei"'
        if self.write not in WRITE_FORMS:
            return 'write: allowed: "fc16", "fc06" or "mei"'
        has_paths = any(position.paths is not None for position in self.command)
        if has_paths and len(self.command) > 1:
            return "command: paths need to be the only entry"
        if not has_paths and any(trigger.paths for trigger in self.trigger):
            return "trigger: paths = true, but no command has paths"
        if self.staged and not self.trigger:
            return "staged = true, but no trigger is named: nothing would ever run the target"
        if self.mode is not None and self.mode.source is ModeSource.TRIGGER and not self.trigger:
            return 'mode: source = "trigger", but no trigger is named'
        if self.objects and self.addressing is not Addressing.OBJECTS:
            return 'objects: only with addressing = "objects"'
        if self.addressing is not Addressing.OBJECTS:
            repeated = (*self.command, *self.position_like, *self.remap)
            overlap = next(filter(None, (position.overlap for position in repeated)), "")
            if overlap:
                return f"paths: {overlap}"
        paths = sum(len(position.offsets) for position in self.command)
        wrong = next(filter(None, (trigger.wrong_paths(paths) for trigger in self.trigger)), "")
        return f"trigger: {wrong}" if wrong else ""

    def motion(
        self, *, passes_stored_moves: bool = False, passes_unknown_relative: bool = False
    ) -> MotionPlan:
        """Return the meaning of the frames, for the exchange."""
        modes = tuple(
            mode.plan(offset) if (mode := position.mode or self.mode) is not None else None
            for position in self.command
            for offset in position.offsets
        )
        return MotionPlan(
            is_staged=self.staged,
            modes=modes if any(modes) else (),
            triggers=tuple(trigger.plan(len(modes)) for trigger in self.trigger),
            starts_on=frozenset(self.starts_on),
            passes_stored_moves=passes_stored_moves,
            passes_unknown_relative=passes_unknown_relative,
        )


POSITION_KEYS: Final = ("command", "actual", "commanded", "limits", "aliases", "position_like", "remap")
"""Keys of a register map whose positions may not share a register."""


@dataclass(frozen=True, slots=True)
class ClaimedSpan:
    """Registers that one key of a register map claims. ``key`` is its path inside the map."""

    key: tuple[str | int, ...]
    first: int
    words: int
    access: FieldAccess = FieldAccess.BOTH
    block: int | None = None

    @property
    def last(self) -> int:
        """Last register claimed."""
        return self.first + self.words - 1

    def __str__(self) -> str:
        return f"{self.first:#06x}" if self.words == 1 else f"{self.first:#06x}..{self.last:#06x}"


def position_spans(registers: RegisterMap) -> list[ClaimedSpan]:
    """Return the registers of every mapped position; an object takes one address, whatever its width."""
    is_object = registers.addressing is Addressing.OBJECTS
    return [
        ClaimedSpan((key, index), field.address, 1 if is_object else field.words, field.access, field.block)
        for key in POSITION_KEYS
        for index, position in enumerate(getattr(registers, key))
        for field in (position.fields() if isinstance(position, RepeatedSpec) else (position.field(),))
    ]


def bit_spans(registers: RegisterMap) -> list[ClaimedSpan]:
    """Return the registers that hold mapped bits."""
    return [
        ClaimedSpan(("bits", name), bit.address, 1, FieldAccess.READ)
        for name, bit in registers.bits.named()
        if bit.table is BitTable.REGISTER
    ]


def rule_spans(registers: RegisterMap) -> list[ClaimedSpan]:
    """Return the registers that decide what a position means, and those that make the drive act."""
    motion = registers.motion()
    modes = [ClaimedSpan(("mode",), mode.address, 1, FieldAccess.WRITE) for mode in motion.modes if mode]
    triggers = [
        ClaimedSpan(("trigger", index), trigger.address, 1, FieldAccess.WRITE, trigger.block)
        for index, trigger in enumerate(motion.triggers)
        if not trigger.is_coil
    ]
    return list(dict.fromkeys((*modes, *triggers)))


def share_register(one: ClaimedSpan, other: ClaimedSpan) -> bool:
    """Whether two spans share a register that the same request can reach.

    >>> share_register(ClaimedSpan(("command", 0), 10, 2), ClaimedSpan(("actual", 0), 11, 2))
    True
    >>> written = ClaimedSpan(("command", 0), 10, 2, FieldAccess.WRITE)
    >>> share_register(written, ClaimedSpan(("actual", 0), 10, 2, FieldAccess.READ))
    False
    """
    if one.first > other.last or other.first > one.last or one.block != other.block:
        return False
    return {one.access, other.access} != {FieldAccess.READ, FieldAccess.WRITE}


def clashes(registers: RegisterMap) -> list[tuple[ClaimedSpan, ClaimedSpan]]:
    """Return the pairs of one map that share a register; bits may share theirs, and rules too.

    For one key with many positions only the first pair is reported.
    """
    positions = position_spans(registers)
    spans = [*positions, *bit_spans(registers), *rule_spans(registers)]
    found: list[tuple[bool, int, int]] = []
    reaching: list[int] = []
    for index in sorted(range(len(spans)), key=lambda index: spans[index].first):
        reaching = [each for each in reaching if spans[each].last >= spans[index].first]
        for each in reaching:
            one, other = sorted((each, index))
            if one < len(positions) and share_register(spans[one], spans[other]):
                found.append((other >= len(positions), one, other))
        reaching.append(index)
    return first_of_keys((spans[one], spans[other]) for _, one, other in sorted(found))


def first_of_keys(pairs: Iterable[tuple[ClaimedSpan, ClaimedSpan]]) -> list[tuple[ClaimedSpan, ClaimedSpan]]:
    """Return the first pair for each pair of keys."""
    found: dict[tuple[object, object], tuple[ClaimedSpan, ClaimedSpan]] = {}
    for one, other in pairs:
        found.setdefault((one.key, other.key), (one, other))
    return list(found.values())
