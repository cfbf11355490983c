"""SMC LECP6 and LECA6 with Modbus RTU.

Source: SMC, LEC series serial communication manual, as cpppo_positioner 3.2.0 (PyPI) and another program use
it.

Positions are in 0.01 mm. Nothing moves without the coils SVON and "serial drive mode", nor before the axis
has been homed. SETUP (homing) must be cleared as soon as SETON is on: a start while it is still set is an
alarm. RESET and HOLD stop the axis. After HOLD ends, the axis does not continue: no source says that it does.
A jog is recorded. DRIVE runs the step of the controller's own data that IN0 to IN5 name. Not simulated:
pushing.
"""

from typing import Final

from gateway.simulator.drives.motor_drive import Basis, MotorDrive, within

STEP_NUMBER: Final = range(0x10, 0x16)
"""IN0 to IN5."""
HOLD: Final = 0x18
SVON: Final = 0x19
DRIVE: Final = 0x1A
RESET: Final = 0x1B
SETUP: Final = 0x1C
JOGS: Final = frozenset({0x1D, 0x1E})
SERIAL_MODE: Final = 0x30
BUSY: Final = 0x48
SVRE: Final = 0x49
SETON: Final = 0x4A
IN_POSITION: Final = 0x4B
ALARM: Final = 0x4F
STEP_DATA: Final = 0x0400
STEP_STRIDE: Final = 16
STEP_POSITION: Final = 2
"""Mode, speed, position, and so on."""
POSITION: Final = 0x9000
PRESENT_TARGET: Final = 0x9004
START: Final = 0x9100
RUN: Final = 0x0100
MOVEMENT_MODE: Final = 0x9102
ABSOLUTE: Final = 1
RELATIVE: Final = 2
TARGET: Final = 0x9104

REGISTER_RANGES: Final = ((0x0400, 0x07FF), (0x9000, 0x9010), (0x9100, 0x9111))
BIT_RANGES: Final = ((0x00, 0x7F),)


class SmcLec(MotorDrive):
    """A simulated LEC controller."""

    functions = frozenset({1, 2, 3, 5, 8, 15, 16})
    register_ranges = REGISTER_RANGES

    def has_bits(self, function: int, address: int, count: int) -> bool:
        """The coils end where the inputs begin."""
        return within(address, count, BIT_RANGES)

    def show(self) -> None:
        motor = self.motor
        self.put32(POSITION, motor.actual_counts)
        self.put32(PRESENT_TARGET, motor.target_counts)
        self.image.set_coil(BUSY, motor.is_moving)
        self.image.set_coil(SVRE, self.image.coil(SVON) and not motor.has_alarm)
        self.image.set_coil(SETON, motor.is_homed)
        self.image.set_coil(IN_POSITION, motor.is_done)
        self.image.set_coil(ALARM, motor.has_alarm)

    def coil_written(self, address: int, *, before: bool, on: bool, now_s: float) -> None:
        if before == on:
            return
        if address == RESET and on:
            self.motor.mechanics.alarm = False
            self.motor.stop(now_s)
        elif (address == SVON and not on) or (address == HOLD and on):
            self.motor.stop(now_s)
        elif address in JOGS:
            if on:
                self.motor.other()
            else:
                self.motor.stop(now_s)
        elif address == SETUP and on and self.image.coil(SVON):
            self.motor.home(now_s)
        elif address == DRIVE and on:
            number = sum(self.image.coil(coil) << bit for bit, coil in enumerate(STEP_NUMBER))
            step = STEP_DATA + STEP_STRIDE * number
            self._run(step, step + STEP_POSITION, now_s)
        self.show()

    def written(self, before: dict[int, int], now_s: float) -> None:
        if START not in before or not self.image.word(START):
            return
        if self.image.word(START) != RUN:
            self.unheard_of(START, self.image.word(START))
            return
        self.image.set_word(START, 0)
        self._run(MOVEMENT_MODE, TARGET, now_s)

    def _run(self, mode_address: int, target_address: int, now_s: float) -> None:
        if not self.image.coil(SVON) or not self.image.coil(SERIAL_MODE):
            return
        if not self.motor.is_homed or self.image.coil(SETUP):
            self.motor.mechanics.alarm = True
            return
        mode, number = self.image.word(mode_address), self.get32(target_address)
        if mode == ABSOLUTE:
            self.motor.absolute(number, now_s)
        elif mode == RELATIVE:
            self.motor.relative(number, Basis.COMMANDED, now_s)
        else:
            self.unheard_of(mode_address, mode)
