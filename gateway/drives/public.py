"""Frames that public programs and manuals send to a drive, and what its motor does by the manual.

A profile may have a file of the same name in ``traffic``. That file is written from programs and manuals and
never from the profile. The tests play it through the gateway, and so find what the profile lacks.
"""

import tomllib
from enum import Enum
from functools import cache
from importlib.resources import files
from typing import Final

from pydantic import Field

from gateway.drives.library import SUFFIX
from gateway.drives.strict import ByName, ListOf, StrictModel
from gateway.drives.words import Address
from gateway.modbus.registers import RegisterType, WordOrder

FOLDER: Final = "traffic"


class SequenceKind(Enum):
    """What a sequence of frames makes the motor do."""

    ABSOLUTE = "absolute"
    RELATIVE = "relative"
    HOMING = "homing"
    SET_POSITION = "set-position"
    STOP = "stop"
    JOG = "jog"
    STORED = "stored"
    ENABLE = "enable"
    FAULT_RESET = "fault-reset"


class SequenceTarget(StrictModel):
    """Where a sequence writes the target position of the motor, or the distance."""

    address: Address = Field(description="first register, as in the frames")
    type: ByName[RegisterType] = Field(default=RegisterType.INT32, description="how the number is stored")
    words: ByName[WordOrder] = Field(default=WordOrder.HIGH_FIRST, description="which word comes first")
    counts: int = Field(description="the number that the frames hold")
    scale: float = Field(default=1.0, description="counts in one step of it, as of a position in a profile")


class Sequence(StrictModel):
    """Frames that a controller sends one after the other, and their effect."""

    kind: ByName[SequenceKind] = Field(description="what the motor does")
    what: str = Field(description="the same in words")
    source: str = Field(description="where it was read: a key of [sources] in the profile")
    frames: ListOf[str] = Field(description="PDUs in hexadecimal, without unit id and check sum")
    target: SequenceTarget | None = Field(default=None, description="for absolute and relative moves")
    refused: str = Field(default="", description="why the gateway refuses it on a corrected axis")


class Traffic(StrictModel):
    """A file of sequences."""

    sequence: ListOf[Sequence] = Field(default=(), description="the sequences")


@cache
def public_traffic(name: str) -> tuple[Sequence, ...]:
    """Return the known traffic to the drive of a shipped profile; empty if none is public."""
    file = files("gateway.drives") / FOLDER / f"{name}{SUFFIX}"
    if not file.is_file():
        return ()
    return Traffic.model_validate(tomllib.loads(file.read_text(encoding="utf-8"))).sequence
