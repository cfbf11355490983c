"""IAI ROBO Cylinder controllers (PCON, ACON, SCON, ERC2) with Modbus RTU.

Source: IAI, ROBO Cylinder series, serial communication manual for Modbus, pages 60 to 183 and 286.

Positions are in 0.01 mm. Writing the low word of PCMD, VCMD, ACMD or PPOW starts a move; CTLF applies to one
move. Also simulated: servo on, homing, pause (when it ends, the axis completes the move, unless the alarm was
reset meanwhile), deceleration stop, stored positions by number, by coil and by CSTR. A jog is recorded. Both
words of commands set their coils. Not simulated: push mode's force, INP band, teaching, level operation of
the start coils.
"""

from typing import Final

from gateway.simulator.drives.motor_drive import Basis, MotorDrive, bits_of, within

POSITION_TABLE: Final = 0x1000
TABLE_STRIDE: Final = 16
POSITION: Final = 0x9000
ALARM: Final = 0x9002
DSS1: Final = 0x9005
DSSE: Final = 0x9007
COMPLETED: Final = 0x9014
DEVICE_CONTROL: Final = 0x0D00
DEVICE_CONTROL_2: Final = 0x0D01
SELECTED_NUMBER: Final = 0x0D03
MOVE_TO_NUMBER: Final = 0x9800
PCMD: Final = 0x9900
STARTING: Final = frozenset({0x9901, 0x9904, 0x9905, 0x9906, 0x9907})
"""The low word of PCMD, VCMD, ACMD, PPOW."""
CTLF: Final = 0x9908
PUSH: Final = 1 << 1
INCREMENTAL: Final = 1 << 3

COMMAND_COILS: Final = 0x0400
COMMAND_COILS_2: Final = 0x0410
SERVO_ON: Final = 0x0403
ALARM_RESET: Final = 0x0407
PAUSE: Final = 0x040A
HOME: Final = 0x040B
START: Final = 0x040C
TEACH: Final = 0x0415
JOGS: Final = frozenset({0x0416, 0x0417})
LAST_START: Final = 0x041F
"""Starts position 0; the seven before it, in descending order, positions 1 to 7."""
STARTS: Final = range(LAST_START - 7, LAST_START + 1)
DECELERATION_STOP: Final = 0x042C
STATUS_COILS: Final = 0x0100
EXPANSION_COILS: Final = 0x0120

REGISTER_RANGES: Final = (
    (0x0D00, 0x0D03),
    (0x1000, 0x3FFF),
    (0x9000, 0x9015),
    (0x9800, 0x9800),
    (0x9900, 0x9908),
)
COIL_RANGES: Final = ((0x0100, 0x013F), (0x0400, 0x043F))


class IaiRoboCylinder(MotorDrive):
    """A simulated ROBO Cylinder controller."""

    functions = frozenset({1, 3, 5, 6, 16})
    register_ranges = REGISTER_RANGES
    _rest: int | None = None
    """Target of a paused move."""

    def has_bits(self, function: int, address: int, count: int) -> bool:
        """The coils at 0x0100 can only be read."""
        return within(address, count, COIL_RANGES if function == 1 else COIL_RANGES[1:])

    def show(self) -> None:
        """Coil n of a group is bit 15 - n of its register."""
        motor = self.motor
        self.put32(POSITION, motor.actual_counts)
        self.image.set_word(ALARM, int(motor.has_alarm))
        state = bits_of(
            b12=self.image.coil(SERVO_ON),
            b10=motor.has_alarm,
            b5=self.image.coil(PAUSE),
            b4=motor.is_homed,
            b3=motor.is_done,
        )
        self._show_state(DSS1, STATUS_COILS, state)
        self._show_state(DSSE, EXPANSION_COILS, bits_of(b5=motor.is_moving))

    def _show_state(self, register: int, coils: int, state: int) -> None:
        self.image.set_word(register, state)
        for bit in range(16):
            self.image.set_coil(coils + 15 - bit, bool(state >> bit & 1))

    def coil_written(self, address: int, *, before: bool, on: bool, now_s: float) -> None:
        if before == on:
            return
        motor = self.motor
        if address == SERVO_ON and not on:
            self._rest = None
            motor.stop(now_s)
        elif address == ALARM_RESET and on:
            motor.mechanics.alarm = False
            self._rest = None
        elif address == PAUSE:
            self._pause(on=on, now_s=now_s)
        elif address == DECELERATION_STOP and on:
            self._rest = None
            motor.stop(now_s)
            self.image.set_coil(DECELERATION_STOP, False)
        elif address == HOME and on and self._may_move:
            motor.home(now_s)
        elif address in JOGS:
            if on:
                motor.other()
            else:
                motor.stop(now_s)
        elif address in STARTS and on and self._may_move:
            self._go_to_number(LAST_START - address, now_s)
        elif address == START and on and self._may_move:
            self._go_to_number(self.image.word(SELECTED_NUMBER), now_s)
        elif address == TEACH and on:
            self.unheard_of(address, 1)
        self.show()

    def _pause(self, *, on: bool, now_s: float) -> None:
        motor = self.motor
        if on:
            self._rest = motor.target_counts if motor.is_moving and not motor.is_homing else None
            motor.stop(now_s)
        elif self._rest is not None:
            rest, self._rest = self._rest, None
            motor.absolute(rest, now_s)

    def _go_to_number(self, number: int, now_s: float) -> None:
        self.motor.absolute(self.get32(POSITION_TABLE + TABLE_STRIDE * number), now_s)
        self.image.set_word(COMPLETED, number)

    @property
    def _may_move(self) -> bool:
        return self.image.coil(SERVO_ON) and not self.image.coil(PAUSE)

    def written(self, before: dict[int, int], now_s: float) -> None:
        for register, coils in ((DEVICE_CONTROL, COMMAND_COILS), (DEVICE_CONTROL_2, COMMAND_COILS_2)):
            if register in before:
                self._device_control(coils, self.image.word(register), now_s)
        if MOVE_TO_NUMBER in before and self._may_move:
            self._go_to_number(self.image.word(MOVE_TO_NUMBER), now_s)
        if STARTING & before.keys() and self._may_move:
            self._start(now_s)

    def _device_control(self, coils: int, word: int, now_s: float) -> None:
        """Set sixteen coils like a register: the first coil is the highest bit."""
        for bit in range(16):
            address, on = coils + 15 - bit, bool(word >> bit & 1)
            before = self.image.coil(address)
            self.image.set_coil(address, on)
            self.coil_written(address, before=before, on=on, now_s=now_s)

    def _start(self, now_s: float) -> None:
        target, flags = self.get32(PCMD), self.image.word(CTLF)
        if flags & INCREMENTAL:
            self.motor.relative(target, Basis.ACTUAL if flags & PUSH else Basis.TARGET, now_s)
        else:
            self.motor.absolute(target, now_s)
        self.image.set_word(CTLF, 0)
