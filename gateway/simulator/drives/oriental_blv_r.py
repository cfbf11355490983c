"""Oriental Motor BLV-R (BLVD-KRD, BLVD-KBRD).

Source: Oriental Motor HP-5142 (BLV-R function manual): direct data operation, Modbus RTU; HP-5143 (inputs,
preset), operation types as quoted from HP-5141.

Differences from the AZ series: S-ON must be set; function code 23; the trigger is the lower half of its pair
(the upper half is a lifetime in ms, which is not simulated); 1 to 19 start; the trigger clears itself unless
0x0228 is 0. The inputs are the factory settings, in two words: HOME, START and jog are in the first. They can
be written at two more addresses: 0x0074 is equivalent to 0x007C; what is written to 0x0078 switches off
automatically. Not simulated: group addresses with ID share.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, bits_of
from gateway.simulator.drives.oriental_az import (
    ALARM_RESET,
    ALL_DATA,
    FREE,
    INPUT,
    OUTPUT,
    STOP,
    TRIGGER,
    WRAPS,
    OrientalAz,
    trigger_of_low_word,
)

S_ON: Final = 1 << 0
STOPS: Final = 0x0078
"""CLR, QSTOP, STOP, FREE."""
D_SEL: Final = 0xFF00
INPUT_PAIRS: Final = (0x007C, 0x0074, 0x0078)
"""The inputs, their second address, and those that switch off automatically; the second word is that of
S-ON."""
SECOND_INPUT: Final = 0x0075
GOES_OFF: Final = 0x0078
TURNS: Final = 0x000F
"""Inching and speed, forward and reverse."""
HOME: Final = 1 << 4
STARTS: Final = 0x00C0
"""START and SSTART, with the data number in the upper byte."""
LAST_START: Final = 19
STOP_TYPES: Final = frozenset({0, 31, 32})
TRIGGER_CLEARS: Final = 0x0228
NEVER: Final = 0
RELATIVE_TYPES: Final[Mapping[int, Basis]] = {
    2: Basis.COMMANDED,
    3: Basis.ACTUAL,
    4: Basis.TARGET,
    21: Basis.COMMANDED,
    22: Basis.ACTUAL,
    23: Basis.TARGET,
}


class OrientalBlvR(OrientalAz):
    """A simulated BLV-R driver."""

    functions = frozenset({3, 6, 8, 16, 23})
    absolute = frozenset({1, 20})
    relative = RELATIVE_TYPES
    turning = frozenset({7, 16, 17, 18, 19, 39, 48, 49, 50, 51}) | WRAPS

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.put32(TRIGGER_CLEARS, 1)

    @property
    def is_excited(self) -> bool:
        word = self.image.word(INPUT) | self.image.word(SECOND_INPUT)
        return bool(word & S_ON) and not word & FREE

    def trigger(self) -> int:
        trigger = trigger_of_low_word(self.image.word(TRIGGER + 1))
        return ALL_DATA if ALL_DATA <= trigger <= LAST_START else trigger

    def written(self, before: dict[int, int], now_s: float) -> None:
        repeated = before.get(TRIGGER + 1) == self.image.word(TRIGGER + 1) != NEVER
        if repeated and not self.get32(TRIGGER_CLEARS):
            before = {address: word for address, word in before.items() if address != TRIGGER + 1}
        for first in INPUT_PAIRS:
            if first in before:
                self._more_inputs(self.image.word(first), before[first], now_s)
            if first + 1 in before and first + 1 != INPUT:
                self.inputs(self.image.word(first + 1), before[first + 1], now_s)
        self.put32(GOES_OFF, 0)
        super().written(before, now_s)

    def inputs(self, word: int, before: int, now_s: float) -> None:
        risen = word & ~before
        if risen & ALARM_RESET:
            self.motor.mechanics.alarm = False
        if risen & STOPS or (before & ~word & S_ON and not self.is_excited):
            self.motor.stop(now_s)
        elif risen & D_SEL:
            self.run_stored((risen & D_SEL).bit_length() - 9, now_s)

    def _more_inputs(self, word: int, before: int, now_s: float) -> None:
        risen = word & ~before
        if risen & HOME:
            self.check_ready()
            self.motor.home(now_s)
        elif risen & STARTS:
            self.run_stored(word >> 8, now_s)
        elif risen & TURNS:
            self.motor.other()
        elif before & ~word & TURNS:
            self.motor.stop(now_s)

    def run(self, operation_type: int, position: int, now_s: float) -> None:
        if operation_type in STOP_TYPES:
            self.motor.stop(now_s)
        else:
            super().run(operation_type, position, now_s)

    def consume_trigger(self, before: dict[int, int]) -> None:
        if self.get32(TRIGGER_CLEARS):
            super().consume_trigger(before)

    def show_outputs(self) -> None:
        motor = self.motor
        state = bits_of(
            b0=self.is_excited,
            b3=self.is_excited and motor.is_done,
            b4=motor.is_homed,
            b5=bool(self.image.word(INPUT) & STOP),
            b7=motor.has_alarm,
            b8=self.is_busy,
            b9=motor.is_done,
            b13=motor.is_moving,
        )
        self.image.set_word(OUTPUT, state)
