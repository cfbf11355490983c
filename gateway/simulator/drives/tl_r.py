"""TL-R series closed-loop steppers (TLC, TLO 42/57/60/86-R).

Source: TL-R_RS485EN manual, list of registers, and published notes of a driver that was tried on the
hardware.

The firmware stores only the first four registers of a longer FC16 and reports no error. Bit 4 of the state is
documented as "enabled" but was measured to be 0 then. A start while the axis moves is refused with 04 unless
the interrupt bit is set. A bit of the control register takes effect each time it is written (3.1.3); the
auxiliary register takes one command at a time. Not simulated: jog, speeds, stored paths.
"""

from typing import Final

from gateway.simulator.drives.motor_drive import Basis, MotorDrive, bits_of
from gateway.simulator.server import EXECUTION_FAILED, ModbusExceptionError

STATUS: Final = 4
POSITION: Final = 8
TARGET: Final = 55
CONTROL: Final = 78
AUXILIARY: Final = 79
CLEAR_ALARM: Final = 0x0300
SET_ZERO: Final = 0x0400
RELEASE: Final = 0x0600
NO_MOTION: Final = frozenset({0x0000, 0x0200, 0x0500})
"""Nothing; save; motor on."""
START: Final = 1 << 0
ABSOLUTE: Final = 1 << 1
INTERRUPT: Final = 1 << 2
JOG: Final = 1 << 3
HOME: Final = 1 << 4
STOPS: Final = 1 << 5 | 1 << 6
BITS: Final = START | ABSOLUTE | INTERRUPT | JOG | HOME | STOPS
TAKEN_REGISTERS: Final = 4
REGISTER_RANGES: Final = ((0, 199),)


class TlR(MotorDrive):
    """A simulated TL-R stepper."""

    functions = frozenset({3, 6, 16})
    register_ranges = REGISTER_RANGES

    def show(self) -> None:
        motor = self.motor
        self.put32(POSITION, motor.actual_counts)
        state = bits_of(b0=motor.is_done, b1=motor.is_homed, b2=motor.is_moving, b3=motor.has_alarm, b4=False)
        self.image.set_word(STATUS, state)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Ignore registers beyond the limit."""
        super().write_words(address, data[: 2 * TAKEN_REGISTERS], now_s)

    def written(self, before: dict[int, int], now_s: float) -> None:
        if AUXILIARY in before:
            self._auxiliary(self.image.word(AUXILIARY), now_s)
        if CONTROL in before:
            self._control(self.image.word(CONTROL), now_s)

    def _auxiliary(self, command: int, now_s: float) -> None:
        if command == SET_ZERO:
            self.motor.set_position(0, now_s)
        elif command == RELEASE:
            self.motor.stop(now_s)
        elif command == CLEAR_ALARM:
            self.motor.mechanics.alarm = False
        elif command not in NO_MOTION:
            self.unheard_of(AUXILIARY, command)

    def _control(self, word: int, now_s: float) -> None:
        if word & ~BITS:
            self.unheard_of(CONTROL, word)
        if word & STOPS:
            self.motor.stop(now_s)
        elif word & HOME:
            self.motor.home(now_s)
        elif word & START:
            if self.motor.is_moving and not word & INTERRUPT:
                raise ModbusExceptionError(EXECUTION_FAILED)
            if word & ABSOLUTE:
                self.motor.absolute(self.get32(TARGET), now_s)
            else:
                self.motor.relative(self.get32(TARGET), Basis.COMMANDED, now_s)
        elif word & JOG:
            self.motor.other()
