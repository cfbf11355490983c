"""The meaning of frames on one axis: how a written position is meant, and which values make the drive act.

Plain data from a drive profile. Nothing here has state.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple


class NextTarget(Enum):
    """What a drive does with a new target while it moves to another one."""

    AT_ONCE = "at-once"
    """It moves to the new target."""
    QUEUED = "queued"
    """It completes the earlier target first."""
    UNKNOWN = "unknown"
    """The controller decides with each start (CiA 402: bit 5 of the control word), or a start may be
    ignored."""


class Action(Enum):
    """The meaning of a value of a mode or trigger register; the value is the key in profiles."""

    ABSOLUTE = "absolute"
    RELATIVE = "relative"
    """A distance from the last target."""
    RELATIVE_TO_COMMANDED = "relative_to_commanded"
    """A distance from the momentary position of the drive's own profile."""
    RELATIVE_TO_ACTUAL = "relative_to_actual"
    START = "start"
    """Runs the target as the mode says; without a mode it is an absolute position."""
    FOLLOW = "follow"
    """Runs the target, and then each further one as soon as it is written."""
    FOLLOW_NEXT = "follow_next"
    """Runs nothing now, but then each target as soon as it is written."""
    STOP = "stop"
    HOME = "home"
    SET_POSITION = "set_position"
    """Sets another position of the drive."""
    STORED = "stored"
    """Runs a position that is stored in the drive: its correction is unknown."""
    OTHER_MOTION = "other_motion"
    """Moves without a target: jog, velocity, torque."""
    IGNORE = "ignore"
    UNKNOWN = "unknown"
    """The profile does not know this value: it is passed on, counted, and never corrected by guess."""

    @property
    def is_relative(self) -> bool:
        """Whether a position is a distance."""
        return self in _RELATIVE

    @property
    def runs_target(self) -> bool:
        """Whether it starts a move to a written position."""
        return self in _RUNS_TARGET


_RELATIVE: Final = frozenset({Action.RELATIVE, Action.RELATIVE_TO_COMMANDED, Action.RELATIVE_TO_ACTUAL})
_FOLLOWING: Final = frozenset({Action.FOLLOW, Action.FOLLOW_NEXT})
_RUNS_TARGET: Final = _RELATIVE | {Action.ABSOLUTE, Action.START, Action.FOLLOW}


class Addressing(Enum):
    """The meaning of consecutive addresses in one frame."""

    REGISTERS = "registers"
    OBJECTS = "objects"
    """Each address is an object with its own width; a frame holds whole objects one after the other."""


class Form(Enum):
    """Function code with which the gateway itself reads or writes a position."""

    FC03 = "fc03"
    FC04 = "fc04"
    FC06 = "fc06"
    FC16 = "fc16"
    MEI = "mei"
    """Function code 43 with MEI type 13, CANopen general reference."""


@dataclass(frozen=True, slots=True)
class ModePlan:
    """A register that says how a written position is meant. Its value at the trigger counts."""

    address: int
    mask: int = 0xFFFF
    actions: Mapping[int, Action] = field(default_factory=dict)
    """By masked value."""
    otherwise: Action = Action.UNKNOWN
    is_in_frame: bool = False
    """It counts only if it is in the same frame as the position."""
    resets_to: int | None = None
    """Content after each started move; None: it stays."""

    def action(self, word: int) -> Action:
        """Return the meaning of the register's content."""
        return self.actions.get(word & self.mask, self.otherwise)


class Operation(NamedTuple):
    """An action, and the command field that it runs; None: the field written last."""

    action: Action
    number: int | None = None
    is_letting_go: bool = False
    """A stop that ends only what the same coil began: any other motion that a frame starts, runs."""


@dataclass(frozen=True, slots=True)
class TriggerPlan:
    """A register, or a coil, whose values make the drive act."""

    address: int
    is_coil: bool = False
    mask: int = 0xFFFF
    rising: int = 0
    """The drive acts if one of these bits rises from 0 to 1; 0: every write acts."""
    deeds: Mapping[int, Operation] = field(default_factory=dict)
    """By masked value; a coil that is set has the value 1."""
    otherwise: Action = Action.UNKNOWN
    block: int | None = None
    """It acts only in frames that begin at this address."""

    def operation(self, word: int, before: int | None) -> Operation:
        """Return what writing ``word`` does, if the register held ``before`` (None: unknown).

        A stop needs no rising bit, and a bit that may have risen counts as risen.
        """
        operation = self.deeds.get(word & self.mask) or Operation(self.otherwise)
        if not self.rising or operation.action is Action.STOP:
            return operation
        risen = word & self.rising & ~(before or 0)
        return operation if risen else NOTHING_DONE

    def stops_surely(self, word: int, certain: int) -> bool:
        """Whether a word, of which only the bits ``certain`` are known, stops the drive in any case."""
        open_bits = self.mask & ~certain
        met = [
            operation.action
            for value, operation in self.deeds.items()
            if not (value ^ word) & self.mask & certain
        ]
        is_all = len(met) == 1 << open_bits.bit_count()
        return all(action is Action.STOP for action in met) and (is_all or self.otherwise is Action.STOP)

    def is_following(self, word: int) -> bool:
        """Whether the drive follows each written position while the register holds ``word``."""
        operation = self.deeds.get(word & self.mask)
        return operation is not None and operation.action in _FOLLOWING

    def holds_unknown(self, word: int) -> bool:
        """Whether the meaning of the register's content is unknown."""
        return self.otherwise is Action.UNKNOWN and word & self.mask not in self.deeds

    @property
    def can_follow(self) -> bool:
        """Whether one of its values makes the drive follow each written position."""
        return any(operation.action in _FOLLOWING for operation in self.deeds.values())


NOTHING_DONE: Final = Operation(Action.IGNORE)


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """How the drive of one axis starts a motion."""

    is_staged: bool = False
    """A written position waits for a trigger."""
    modes: tuple[ModePlan | None, ...] = ()
    """By command field; missing or None: every position is absolute unless the trigger says otherwise."""
    triggers: tuple[TriggerPlan, ...] = ()
    starts_on: frozenset[int] = frozenset()
    """Registers that start the motion when they are written, whatever their value."""
    passes_stored_moves: bool = False
    passes_unknown_relative: bool = False
    """A relative move from an unknown position is sent unchanged."""

    def mode(self, number: int) -> ModePlan | None:
        """Return the mode of one command field."""
        return self.modes[number] if number < len(self.modes) else None

    @property
    def waits_for_trigger(self) -> bool:
        """Whether the drive may hold a position that it does not run (M3)."""
        return self.is_staged or bool(self.starts_on) or bool(self.triggers)


DIRECT: Final = MotionPlan()
"""A drive that moves to each absolute position as soon as it is written."""
