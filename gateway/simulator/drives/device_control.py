"""Control word and status word of CiA 402 (IEC 61800-7-201), as several drives have them.

Bits of the control word: 0 to 3 switch on, 4 new set-point (or start of homing), 5 change at once, 6
relative, 7 fault reset, 8 halt.
"""

from enum import Enum
from typing import Final

ON_BITS: Final = 0x000F
SWITCH_ON: Final = 0x0001
VOLTAGE: Final = 0x0002
NO_QUICK_STOP: Final = 0x0004
NEW_SET_POINT: Final = 0x0010
RELATIVE: Final = 0x0040
FAULT_RESET: Final = 0x0080
HALT: Final = 0x0100


class DeviceState(Enum):
    """States of the device; the value is what the lowest seven bits of the status word show."""

    SWITCH_ON_DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    FAULT = 0x08


class Order402(Enum):
    """What a control word makes the drive do."""

    NOTHING = "nothing"
    START = "start"
    STOP = "stop"
    FAULT_RESET = "fault reset"


class DeviceControl:
    """The state machine. With ``steps`` it is only enabled from the state before (06, then 07 or 0F)."""

    def __init__(self, *, steps: bool) -> None:
        self.word = 0
        self.state = DeviceState.SWITCH_ON_DISABLED
        self.has_acknowledged = False
        """A new set-point was taken, and its bit is still set."""
        self._steps = steps

    @property
    def is_enabled(self) -> bool:
        """Whether the motor is under current."""
        return self.state is DeviceState.ENABLED

    def write(self, word: int) -> Order402:
        """Take a control word. A start is only one where the bit rises while the drive is enabled."""
        before, self.word = self.word, word
        if word & FAULT_RESET & ~before:
            self.state = DeviceState.SWITCH_ON_DISABLED
            return Order402.FAULT_RESET
        was_enabled = self.is_enabled
        self.state = self._next_state(word)
        if not word & NEW_SET_POINT:
            self.has_acknowledged = False
        if was_enabled and (not self.is_enabled or word & HALT & ~before):
            return Order402.STOP
        if self.is_enabled and word & NEW_SET_POINT & ~before and not word & HALT:
            self.has_acknowledged = True
            return Order402.START
        return Order402.NOTHING

    def _next_state(self, word: int) -> DeviceState:
        if not word & VOLTAGE:
            return DeviceState.SWITCH_ON_DISABLED
        if not word & NO_QUICK_STOP:
            return DeviceState.QUICK_STOP if self.is_enabled else DeviceState.SWITCH_ON_DISABLED
        if not word & SWITCH_ON:
            return DeviceState.READY
        if self._steps and self.state in {DeviceState.SWITCH_ON_DISABLED, DeviceState.QUICK_STOP}:
            return self.state
        return DeviceState.ENABLED if word & ON_BITS == ON_BITS else DeviceState.SWITCHED_ON
