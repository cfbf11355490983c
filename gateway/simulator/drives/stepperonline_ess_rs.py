"""StepperOnline ESS-RS integrated steppers.

Source: StepperOnline, Modbus Series Bus Product Function Manual V1.0, pages 13 to 30 and 68 to 79, and a
published bench test of firmware 0x0029 (github.com/janhavelka/ESS23-RS).

Each bit of the trigger is a command each time it is written. Without bit 3, a start while the axis moves is
ignored. Not simulated: segments started by inputs, speeds, limits.
"""

from typing import Final

from gateway.simulator.drives.motor_drive import Basis, MotorDrive, Order, bits_of
from gateway.simulator.server import ModbusExceptionError

ALARM: Final = 0x0006
MOTION: Final = 0x0007
POSITION: Final = 0x000A
WORD_ORDER: Final = 0x0019
TARGET: Final = 0x0024
TRIGGER: Final = 0x0027
START: Final = 1 << 0
START_SPEED: Final = 1 << 1
ABSOLUTE: Final = 1 << 2
AT_ONCE: Final = 1 << 3
HOME: Final = 1 << 4
STOPS: Final = 1 << 8 | 1 << 9
BITS: Final = START | START_SPEED | ABSOLUTE | AT_ONCE | HOME | STOPS
AUXILIARY: Final = 0x002D
RELEASE: Final = 0x0011
CLEAR_ALARM: Final = 0x0021
SET_ZERO: Final = 0x0031
NO_MOTION: Final = frozenset({0x0000, 0x0012, 0x0042})
"""Nothing; enable; save."""
ILLEGAL_VALUE: Final = 7
REGISTER_RANGES: Final = ((0x0000, 0x00BF),)


class StepperonlineEssRs(MotorDrive):
    """A simulated ESS-RS stepper."""

    functions = frozenset({3, 6, 16})
    register_ranges = REGISTER_RANGES
    max_read = 16

    def show(self) -> None:
        """Command registers are write-only."""
        motor = self.motor
        self.order = Order.LOW_FIRST if self.image.word(WORD_ORDER) else Order.HIGH_FIRST
        self.put32(POSITION, motor.actual_counts)
        self.image.set_word(ALARM, int(motor.has_alarm))
        state = bits_of(b0=motor.is_done, b1=motor.is_homed, b2=motor.is_moving, b3=motor.has_alarm)
        self.image.set_word(MOTION, state)
        self.image.set_word(TRIGGER, 0)
        self.image.set_word(AUXILIARY, 0)

    def written(self, before: dict[int, int], now_s: float) -> None:
        if AUXILIARY in before:
            self._auxiliary(self.image.word(AUXILIARY), now_s)
        if TRIGGER in before:
            self._trigger(self.image.word(TRIGGER), now_s)

    def _auxiliary(self, command: int, now_s: float) -> None:
        if command == SET_ZERO:
            self.motor.set_position(0, now_s)
        elif command == RELEASE:
            self.motor.stop(now_s)
        elif command == CLEAR_ALARM:
            self.motor.mechanics.alarm = False
        elif command not in NO_MOTION:
            self.unheard_of(AUXILIARY, command)

    def _trigger(self, word: int, now_s: float) -> None:
        if word & ~BITS:
            raise ModbusExceptionError(ILLEGAL_VALUE)
        if word & STOPS:
            self.motor.stop(now_s)
        elif word & HOME:
            self.motor.home(now_s)
        elif word & START:
            if self.motor.is_moving and not word & AT_ONCE:
                return
            if word & ABSOLUTE:
                self.motor.absolute(self.get32(TARGET), now_s)
            else:
                self.motor.relative(self.get32(TARGET), Basis.COMMANDED, now_s)
        elif word & START_SPEED:
            self.motor.other()
