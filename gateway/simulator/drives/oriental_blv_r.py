"""Oriental Motor BLV-R (BLVD-KRD, BLVD-KBRD).

Source: Oriental Motor HP-5142 (BLV-R function manual): direct data operation, Modbus RTU; HP-5143 (inputs,
preset), operation types as quoted from HP-5141.

As the AZ series, and: S-ON must be set, function code 23, the trigger is the lower half of its pair (the
upper half is a lifetime in ms, which is not simulated), 1 to 19 start, the trigger clears itself unless
0x0228 is 0. The inputs are those of the factory, in two words: HOME, START and jog stand in the first.
Not simulated: wrap operation (types 8 to 15), the copies of the inputs, and group addresses with ID share.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from gateway.simulator.drives.endpoint import bits_of
from gateway.simulator.drives.motor import Basis, Motor
from gateway.simulator.drives.oriental_az import (
    ALARM_RESET,
    ALL_DATA,
    INPUT,
    OUTPUT,
    STOP,
    STORED_TYPE,
    TRIGGER,
    OrientalAz,
    trigger_of_low_word,
)

S_ON: Final = 1 << 0
STOPS: Final = 0x0078
"""CLR, QSTOP, STOP, FREE."""
D_SEL: Final = 0xFF00
MORE_INPUTS: Final = 0x007C
TURNS: Final = 0x000F
"""Inching and speed, forward and reverse."""
HOME: Final = 1 << 4
STARTS: Final = 0x00C0
"""START and SSTART, with the number of the data in the upper byte."""
DATA_STRIDE: Final = 64
LAST_START: Final = 19
STOP_TYPES: Final = frozenset({0, 31, 32})
PRESET: Final = 0x018A
PRESET_POSITION: Final = 0x038C
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
    """See the module."""

    functions = frozenset({3, 6, 8, 16, 23})
    absolute = frozenset({1, 7, 20})
    relative = RELATIVE_TYPES
    continuous = frozenset({16, 17, 18, 19, 39, 48, 49, 50, 51})

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.put32(TRIGGER_CLEARS, 1)

    @property
    def is_excited(self) -> bool:
        """See :class:`OrientalAz`."""
        return bool(self.image.word(INPUT) & S_ON) and super().is_excited

    def trigger(self) -> int:
        """See :class:`OrientalAz`."""
        trigger = trigger_of_low_word(self.image.word(TRIGGER + 1))
        return ALL_DATA if ALL_DATA <= trigger <= LAST_START else trigger

    def written(self, before: dict[int, int], now_s: float) -> None:
        """See :class:`MotorDrive`."""
        repeated = before.get(TRIGGER + 1) == self.image.word(TRIGGER + 1) != NEVER
        if repeated and not self.get32(TRIGGER_CLEARS):
            before = {address: word for address, word in before.items() if address != TRIGGER + 1}
        if MORE_INPUTS in before:
            self._more_inputs(self.image.word(MORE_INPUTS), before[MORE_INPUTS], now_s)
        if PRESET + 1 in before and self.image.word(PRESET + 1):
            self.motor.set_position(self.get32(PRESET_POSITION), now_s)
        super().written(before, now_s)

    def inputs(self, word: int, before: int, now_s: float) -> None:
        """See :class:`OrientalAz`."""
        risen = word & ~before
        if risen & ALARM_RESET:
            self.motor.mechanics.alarm = False
        if risen & STOPS or before & ~word & S_ON:
            self.motor.stop(now_s)
        elif risen & D_SEL:
            self._run_stored((risen & D_SEL).bit_length() - 9, now_s)

    def _more_inputs(self, word: int, before: int, now_s: float) -> None:
        risen = word & ~before
        if risen & HOME:
            self.check_ready()
            self.motor.home(now_s)
        elif risen & STARTS:
            self._run_stored(word >> 8, now_s)
        elif risen & TURNS:
            self.motor.other()
        elif before & ~word & TURNS:
            self.motor.stop(now_s)

    def _run_stored(self, number: int, now_s: float) -> None:
        place = STORED_TYPE + DATA_STRIDE * number
        self.run(self.get32(place), self.get32(place + 2), now_s)

    def run(self, operation_type: int, position: int, now_s: float) -> None:
        """See :class:`OrientalAz`."""
        if operation_type in STOP_TYPES:
            self.motor.stop(now_s)
        else:
            super().run(operation_type, position, now_s)

    def consume_trigger(self, before: dict[int, int]) -> None:
        """See :class:`OrientalAz`."""
        if self.get32(TRIGGER_CLEARS):
            super().consume_trigger(before)

    def show_outputs(self) -> None:
        """See :class:`OrientalAz`."""
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
