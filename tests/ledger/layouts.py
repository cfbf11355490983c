"""The drives of the ledger: their registers as drive and witness know them, and as the gateway is told."""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import AxisPlan, CompensationMode, Reference
from gateway.modbus.registers import BitField, FieldAccess, PositionField, RegisterType, WordOrder
from tests.ledger.screws import TRAVEL_MM, Screw

RUN, RUN_RELATIVE, STOP, JOG = 1, 2, 1000, 300
"""Values of the trigger register."""
MODE_ABSOLUTE, MODE_RELATIVE = 1, 2
"""Values of a mode register."""
CONTROL_ENABLE, CONTROL_START = 1, 2
"""Bits of an image's control word: without the first the drive stops; the second starts as it rises."""
IMAGE_RELATIVE = 0x0100
DONE_BIT, MOVING_BIT = 4, 5
MAX_SPEED_MM_S: Final = 150.0


class Style(Enum):
    """How a drive is made to move."""

    DIRECT = "direct"
    """Each target is gone to as it is written."""
    PLAIN = "plain"
    """The same, and nothing but a target moves or stops it: what it is told may be cut through."""
    BLOCK = "block"
    """The same; the word before the target says how it is meant, and counts in its own frame only."""
    STICKY = "sticky"
    """A target waits for a trigger; a mode register says how it is meant."""
    TRIGGERED = "triggered"
    """A target waits for a trigger, whose value says how it is meant."""
    IMAGE = "image"
    """Control word, mode and target in one block that is written all the time, and read beside it."""


class Basis(Enum):
    """From where a distance counts."""

    TARGET = "target"
    COMMANDED = "commanded"
    ACTUAL = "actual"


ACTIONS: Final = {
    Basis.TARGET: Action.RELATIVE,
    Basis.COMMANDED: Action.RELATIVE_TO_COMMANDED,
    Basis.ACTUAL: Action.RELATIVE_TO_ACTUAL,
}


@dataclass(frozen=True)
class Layout:
    """Registers, scale and habits of one drive."""

    name: str
    unit: int
    style: Style
    basis: Basis | None = None
    low_first: bool = False
    counts_per_unit: float = 1000.0
    zero_counts: int = 0
    has_bits: bool = True
    exception_writes_nothing: bool = False
    command: int = 0x0606
    actual: int = 0x0520
    commanded: int | None = 0x0522
    trigger: int = 0x050E
    mode: int = 0x0700
    status: int = 0x005C

    @property
    def is_staged(self) -> bool:
        """Whether a target waits for a trigger."""
        return self.style in (Style.STICKY, Style.TRIGGERED, Style.IMAGE)

    @property
    def machine_sign(self) -> int:
        """Forward in counts: 1, or -1 where the drive counts the other way."""
        return 1 if self.counts_per_unit > 0 else -1

    def machine_mm(self, counts: float) -> float:
        return (counts - self.zero_counts) / self.counts_per_unit

    def counts(self, machine_mm: float) -> int:
        return round(self.zero_counts + self.counts_per_unit * machine_mm)

    def split(self, counts: int) -> tuple[int, int]:
        """Return the words of a position in the order of their addresses."""
        value = counts & 0xFFFFFFFF
        words = value >> 16, value & 0xFFFF
        return words[::-1] if self.low_first else words

    def join(self, words: tuple[int, int]) -> int:
        """Return the position that two words in the order of their addresses hold."""
        high, low = words[::-1] if self.low_first else words
        value = high << 16 | low
        return value - (1 << 32) if value >= 1 << 31 else value


def axis_plan(layout: Layout, screw: Screw) -> AxisPlan:
    """What the gateway is told about a drive."""
    is_image = layout.style is Style.IMAGE
    order = WordOrder.LOW_FIRST if layout.low_first else WordOrder.HIGH_FIRST

    def field(address: int, access: FieldAccess = FieldAccess.BOTH) -> PositionField:
        return PositionField(address, RegisterType.INT32, order, access=access)

    bits = {"done": BitField(layout.status, DONE_BIT), "moving": BitField(layout.status, MOVING_BIT)}
    return AxisPlan(
        name=layout.name,
        unit_id=layout.unit,
        settings=AxisSettings(
            Units.MM,
            layout.counts_per_unit,
            zero_counts=layout.zero_counts,
            travel=(0.0, TRAVEL_MM),
            max_speed=2 * MAX_SPEED_MM_S,
            hysteresis=2 / abs(layout.counts_per_unit),
        ),
        table=make_table(screw.positions, screw.forward, screw.backward, Units.MM),
        compensation=CompensationMode.ON,
        referenced=Reference.ABSOLUTE,
        command=(field(layout.command, FieldAccess.WRITE if is_image else FieldAccess.BOTH),),
        actual=(field(layout.actual, FieldAccess.READ if is_image else FieldAccess.BOTH),),
        commanded=() if layout.commanded is None else (field(layout.commanded),),
        motion=_motion(layout),
        bits=bits if layout.has_bits else {},
        exception_writes_nothing=layout.exception_writes_nothing,
    )


def _motion(layout: Layout) -> MotionPlan:
    relative = ACTIONS[layout.basis] if layout.basis else Action.UNKNOWN
    others = {STOP: Operation(Action.STOP), JOG: Operation(Action.OTHER_MOTION)}
    match layout.style:
        case Style.PLAIN:
            return MotionPlan()
        case Style.DIRECT:
            return MotionPlan(triggers=(TriggerPlan(layout.trigger, deeds=others, otherwise=Action.IGNORE),))
        case Style.BLOCK:
            actions = {0: Action.ABSOLUTE, 1: relative}
            mode = ModePlan(layout.mode, mask=1, actions=actions, is_in_frame=True)
            trigger = TriggerPlan(layout.trigger, deeds=others, otherwise=Action.IGNORE)
            return MotionPlan(modes=(mode,), triggers=(trigger,))
        case Style.STICKY:
            mode = ModePlan(layout.mode, actions={MODE_ABSOLUTE: Action.ABSOLUTE, MODE_RELATIVE: relative})
            deeds = {RUN: Operation(Action.START), **others}
            return MotionPlan(
                is_staged=True, modes=(mode,), triggers=(TriggerPlan(layout.trigger, deeds=deeds),)
            )
        case Style.TRIGGERED:
            deeds = {RUN: Operation(Action.ABSOLUTE), **others}
            if layout.basis is not None:
                deeds[RUN_RELATIVE] = Operation(relative)
            return MotionPlan(is_staged=True, triggers=(TriggerPlan(layout.trigger, deeds=deeds),))
        case Style.IMAGE:
            actions = {0: Action.ABSOLUTE, IMAGE_RELATIVE: relative}
            start = {CONTROL_START: Operation(Action.START)}
            enabled = {CONTROL_ENABLE: Operation(Action.IGNORE)}
            return MotionPlan(
                is_staged=True,
                modes=(ModePlan(layout.mode, mask=IMAGE_RELATIVE, actions=actions),),
                triggers=(
                    TriggerPlan(
                        layout.trigger,
                        mask=CONTROL_START,
                        rising=CONTROL_START,
                        deeds=start,
                        otherwise=Action.IGNORE,
                    ),
                    TriggerPlan(layout.trigger, mask=CONTROL_ENABLE, deeds=enabled, otherwise=Action.STOP),
                ),
            )


def image(name: str, unit: int, basis: Basis) -> Layout:
    """A drive with a cyclic image: control, mode, target written at 0; status, spare, actual read at 0."""
    return Layout(
        name, unit, Style.IMAGE, basis, has_bits=False,
        command=2, actual=2, commanded=None, trigger=0, mode=1, status=0,
    )  # fmt: skip


def block(name: str, unit: int, basis: Basis) -> Layout:
    """A drive whose mode stands right before its target, counting the other way."""
    return Layout(
        name, unit, Style.BLOCK, basis, counts_per_unit=-800.0, zero_counts=5_000,
        has_bits=False, mode=0x0605,
    )  # fmt: skip
