"""The rules of a register map for frames: how a position is meant, and what starts a motion."""

from collections.abc import Iterator
from enum import Enum
from typing import Final

from pydantic import Field, model_validator

from gateway.drives.motion import Action, ModePlan, Operation, TriggerPlan
from gateway.drives.strict import ByName, ListOf, StrictModel, documented
from gateway.drives.words import Address, Word

COIL_VALUES: Final = frozenset({0, 1})


class ModeSource(Enum):
    """Where the meaning of a written position is decided."""

    FIXED = "fixed"
    STICKY = "sticky"
    IN_FRAME = "in-frame"
    TRIGGER = "trigger"


MODE_ACTIONS: Final = (
    Action.ABSOLUTE,
    Action.RELATIVE,
    Action.RELATIVE_TO_COMMANDED,
    Action.RELATIVE_TO_ACTUAL,
    Action.FOLLOW,
    Action.STOP,
    Action.HOME,
    Action.STORED,
    Action.OTHER_MOTION,
)
"""Possible meanings of a mode, for the written positions or for the effect of a trigger."""
TRIGGER_ACTIONS: Final = (
    Action.ABSOLUTE,
    Action.RELATIVE,
    Action.RELATIVE_TO_COMMANDED,
    Action.RELATIVE_TO_ACTUAL,
    Action.START,
    Action.FOLLOW,
    Action.FOLLOW_NEXT,
    Action.STOP,
    Action.HOME,
    Action.SET_POSITION,
    Action.STORED,
    Action.OTHER_MOTION,
    Action.IGNORE,
)


class _Values(StrictModel):
    """Values of one register, listed by their meaning."""

    mask: Word = Field(
        default=0xFFFF,
        description="bits of the register that count",
        json_schema_extra=documented(more="The values below have no others"),
    )
    absolute: ListOf[Word] = Field(default=(), description="values that mean an absolute position")
    relative: ListOf[Word] = Field(default=(), description="values that mean a distance from the last target")
    relative_to_commanded: ListOf[Word] = Field(
        default=(),
        description="values that mean a distance from the drive's own commanded position",
        json_schema_extra=documented(
            text=(
                "a distance from the drive's own profile position at that moment. Also right if the "
                "manual does not say: the gateway then requires standstill, where all three are equal"
            )
        ),
    )
    relative_to_actual: ListOf[Word] = Field(
        default=(), description="values that mean a distance from the actual position"
    )
    follow: ListOf[Word] = Field(
        default=(), description="values after which each position moves the axis as soon as it is written"
    )
    stop: ListOf[Word] = Field(
        default=(),
        description="values that stop the axis",
        json_schema_extra=documented(text=("stops the axis; the position in the frame means nothing")),
    )
    home: ListOf[Word] = Field(default=(), description="values that mean homing")
    stored: ListOf[Word] = Field(default=(), description="values that run positions kept by the drive")
    other_motion: ListOf[Word] = Field(
        default=(),
        description="values that mean jog, velocity or torque",
        json_schema_extra=documented(text="jog, velocity, torque: the position in the frame means nothing"),
    )
    otherwise: ByName[Action] = Field(
        default=Action.UNKNOWN,
        description="what every value means that is not listed",
        json_schema_extra=documented(
            kind='one of the names above, `"ignore"`, `"unknown"`',
            text=("meaning of every unlisted value. `unknown`: passed unchanged and counted"),
        ),
    )

    def listed(self, actions: tuple[Action, ...]) -> Iterator[tuple[int, Action]]:
        """Yield each listed value with its meaning."""
        for action in actions:
            for value in getattr(self, action.value, ()):
                yield value, action

    def wrong_values(self, actions: tuple[Action, ...]) -> str:
        """Return what is wrong with the listed values; empty if nothing is."""
        seen: dict[int, Action] = {}
        for value, action in self.listed(actions):
            if value & ~self.mask:
                return f"{action.value} lists {value:#x}, which has bits outside mask = {self.mask:#x}"
            if value in seen:
                return f"{value:#x} is listed as {seen[value].value} and as {action.value}"
            seen[value] = action
        return ""


class ModeSpec(_Values):
    """How to distinguish an absolute position from a relative one, or from none at all."""

    source: ByName[ModeSource] = Field(
        description="where the mode is decided",
        json_schema_extra=documented(
            text=(
                "`fixed`: every position is absolute. `sticky`: a register says so, as it is at the "
                "trigger. `in-frame`: a register that counts only in the position's frame. `trigger`: "
                "the trigger says so"
            )
        ),
    )
    address: Address | None = Field(
        default=None,
        description="the register that holds the mode",
        json_schema_extra=documented(
            text=("the register of the mode: required with `sticky` and `in-frame`, otherwise not allowed")
        ),
    )
    resets_to: Word | None = Field(
        default=None, description="content to which the drive resets the register after each move"
    )

    @model_validator(mode="after")
    def _is_whole(self) -> "ModeSpec":
        if self.source in {ModeSource.FIXED, ModeSource.TRIGGER}:
            if self.model_fields_set != {"source"}:
                raise ValueError(f'with source = "{self.source.value}" no other key is allowed')
            return self
        if self.address is None:
            raise ValueError(f'source = "{self.source.value}" needs the address of the register')
        wrong = self.wrong_values(MODE_ACTIONS)
        if wrong:
            raise ValueError(wrong)
        if not any(True for _ in self.listed(MODE_ACTIONS)) and self.otherwise is Action.UNKNOWN:
            raise ValueError("no value of the register has a meaning: list at least one under absolute")
        return self

    def plan(self, offset: int = 0) -> ModePlan | None:
        """Return it for the exchange, ``offset`` registers further on."""
        if self.address is None:
            return None
        return ModePlan(
            address=self.address + offset,
            mask=self.mask,
            actions=dict(self.listed(MODE_ACTIONS)),
            otherwise=self.otherwise,
            is_in_frame=self.source is ModeSource.IN_FRAME,
            resets_to=self.resets_to,
        )


class TriggerSpec(_Values):
    """A register or a coil whose values make the drive act."""

    address: Address | None = Field(
        default=None,
        description="the register",
        json_schema_extra=documented(more="Exactly one of `address` and `coil`"),
    )
    coil: Address | None = Field(
        default=None,
        description="the coil, in place of a register; it is 0 or 1",
        json_schema_extra=documented(text="the coil; its values are 0 and 1"),
    )
    rising: Word = Field(
        default=0,
        description="bits of which one must rise for the drive to act; 0: every write acts",
        json_schema_extra=documented(
            text=(
                "bits of which one must rise from 0 to 1 for the drive to act; 0: every write acts. A "
                "stop always acts"
            )
        ),
    )
    block: Address | None = Field(
        default=None, description="it acts only in frames that begin at this address"
    )
    start: ListOf[Word] = Field(default=(), description="values that start a move of the kind the mode says")
    set_position: ListOf[Word] = Field(default=(), description="values that redefine where the axis is")
    follow_next: ListOf[Word] = Field(
        default=(),
        description="as follow, for values that run nothing themselves, only what is written later",
        json_schema_extra=documented(
            text=(
                "like `follow`, for values that run nothing themselves: only later writes. While the "
                "register holds an unlisted value, positions pass unchanged and are counted as unknown"
            )
        ),
    )
    ignore: ListOf[Word] = Field(default=(), description="values that do nothing")
    paths: bool = Field(
        default=False,
        description="values under absolute, relative and start: value + P runs the position of path P",
        json_schema_extra=documented(
            text=(
                "with `paths` in `command`: value + P runs the position of path P, for the values under "
                "`absolute`, the three `relative` and `start`"
            )
        ),
    )

    @model_validator(mode="after")
    def _is_whole(self) -> "TriggerSpec":
        if (self.address is None) is (self.coil is None):
            raise ValueError("needs exactly one of address and coil")
        wrong = self.wrong_values(TRIGGER_ACTIONS)
        if wrong:
            raise ValueError(wrong)
        values = {value for value, _ in self.listed(TRIGGER_ACTIONS)}
        if self.coil is not None and values - COIL_VALUES:
            raise ValueError("a coil is 0 or 1: list no other value")
        if not values and self.otherwise is Action.UNKNOWN:
            raise ValueError("no value has a meaning: list at least one")
        if self.rising & ~self.mask:
            raise ValueError(f"rising = {self.rising:#x} has bits outside mask = {self.mask:#x}")
        return self

    def wrong_paths(self, paths: int) -> str:
        """Return the value that, with a path number added, means something else; empty if there is none."""
        listed = dict(self.listed(TRIGGER_ACTIONS))
        for value, action in listed.items():
            for sum_ in range(value + 1, value + paths) if self.paths and action.runs_target else ():
                if sum_ & ~self.mask:
                    return f"path {sum_ - value} of {value:#x} is {sum_:#x}, outside mask = {self.mask:#x}"
                if sum_ in listed:
                    return f"path {sum_ - value} of {value:#x} is {sum_:#x}, listed as {listed[sum_].value}"
        return ""

    def _lets_go(self, value: int) -> bool:
        """Whether a value resets a coil that moves the axis as long as it is set."""
        return self.coil is not None and value == 0 and 1 in (*self.other_motion, *self.stored)

    def plan(self, paths: int = 1) -> TriggerPlan:
        """Return it for the exchange, for a drive with this many paths."""
        deeds: dict[int, Operation] = {}
        for value, action in self.listed(TRIGGER_ACTIONS):
            if self.paths and action.runs_target:
                for number in range(paths):
                    deeds[value + number] = Operation(action, number)
            else:
                deeds[value] = Operation(action, is_letting_go=action is Action.STOP and self._lets_go(value))
        address = self.coil if self.address is None else self.address
        assert address is not None
        return TriggerPlan(
            address=address,
            is_coil=self.coil is not None,
            mask=self.mask,
            rising=self.rising,
            deeds=deeds,
            otherwise=self.otherwise,
            block=self.block,
        )
