"""What a register map says about the meaning of frames: how a position is meant, and what starts a motion."""

from enum import Enum

from pydantic import Field, model_validator

from gateway.drives.strict import ByName, ListOf, StrictModel
from gateway.drives.words import Address, Word


class ModeSource(Enum):
    """Where it is decided what a written position means."""

    FIXED = "fixed"
    STICKY = "sticky"
    IN_FRAME = "in-frame"
    TRIGGER = "trigger"


class ModeSpec(StrictModel):
    """How to tell an absolute position from a relative one."""

    source: ByName[ModeSource] = Field(description="where the mode is decided")
    address: Address | None = Field(default=None, description="the register that holds the mode")
    mask: Word = Field(default=0xFFFF, description="bits of that register that count")
    absolute: ListOf[Word] = Field(default=(), description="values that mean an absolute position")
    relative: ListOf[Word] = Field(default=(), description="values that mean a distance")

    @model_validator(mode="after")
    def _is_whole(self) -> "ModeSpec":
        if self.source is ModeSource.FIXED and self.model_fields_set != {"source"}:
            raise ValueError(
                'with source = "fixed" every position is absolute and no other key has a meaning'
            )
        if self.source in {ModeSource.STICKY, ModeSource.IN_FRAME} and self.address is None:
            raise ValueError(f'source = "{self.source.value}" needs the address of the register')
        return self


class TriggerSpec(StrictModel):
    """A register whose values make the drive act."""

    address: Address = Field(description="the register")
    absolute: ListOf[Word] = Field(default=(), description="values that start an absolute move")
    relative: ListOf[Word] = Field(default=(), description="values that start a relative move")
    start: ListOf[Word] = Field(default=(), description="values that start a move of either kind")
    stop: ListOf[Word] = Field(default=(), description="values that stop the axis")
    home: ListOf[Word] = Field(default=(), description="values that start homing")
    set_position: ListOf[Word] = Field(default=(), description="values that redefine where the axis is")
