"""Festo CMMO-ST with FHPP over Modbus TCP.

Source: Festo, CMMO-ST description GDCP-CMMO-ST-LK-C-HP-EN (2017-05b, page 23: FC23 on address 0) and the FHPP
description for CCON, CPOS, CDIR, SCON, SPOS.

Reading address 0 returns the state, not what was written there. A controller writes the image cyclically:
only rising start bits take effect. Clearing "no halt" stops the axis. Only for sister drives is it known
whether the axis then continues; here it does not. Not simulated: the contents of records (a start in record
selection and jogging are recorded), teaching, FPC parameters, velocity and force mode.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, bits_of
from gateway.simulator.server import RegisterImage

CONTROL: Final = 0
DIRECTION: Final = 1
SETPOINT: Final = 2
WORDS: Final = 8

ENABLE: Final = 1 << 8
NO_STOP: Final = 1 << 9
RESET_FAULT: Final = 1 << 11
NO_HALT: Final = 1 << 0
START: Final = 1 << 1
HOME: Final = 1 << 2
JOG: Final = 3 << 3
MODE: Final = 3 << 14
DIRECT: Final = 1 << 14
RUNNING: Final = ENABLE | NO_STOP | NO_HALT
RELATIVE: Final = 1 << 8
OTHER_KINDS: Final = 0x1E00
"""Force and speed, and the continuous set-point of sister drives."""


class FestoCmmoFhpp(MotorDrive):
    """A simulated CMMO-ST."""

    functions = frozenset({3, 7, 16, 23})
    register_ranges = ((0, WORDS - 1),)

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._state = RegisterImage(WORDS)

    def read_words(self, address: int, count: int) -> bytes:
        """Return the state, which has the same addresses."""
        return self._state.words(address, count)

    def show(self) -> None:
        """SCON and SPOS share a register, SDIR and the velocity another one."""
        motor = self.motor
        word = self.image.word(CONTROL)
        enabled = bool(word & ENABLE) and not motor.has_alarm
        scon = (
            bits_of(b0=enabled, b1=enabled and bool(word & NO_STOP), b3=motor.has_alarm) | (word & MODE) >> 8
        )
        spos = bits_of(
            b0=bool(word & NO_HALT),
            b1=bool(word & START) and word & RUNNING == RUNNING,
            b2=motor.is_done,
            b4=motor.is_moving,
            b7=motor.is_homed,
        )
        self._state.set_word(CONTROL, scon << 8 | spos)
        self._state.set_word(DIRECTION, self.image.word(DIRECTION) & RELATIVE)
        self._state.set_word(SETPOINT, motor.actual_counts >> 16)
        self._state.set_word(SETPOINT + 1, motor.actual_counts)

    def written(self, before: dict[int, int], now_s: float) -> None:
        if CONTROL not in before:
            return
        word, was = self.image.word(CONTROL), before[CONTROL]
        risen = word & ~was
        if risen & RESET_FAULT:
            self.motor.mechanics.alarm = False
        if was & RUNNING == RUNNING != word & RUNNING:
            self.motor.stop(now_s)
        elif word & RUNNING == RUNNING and risen & HOME:
            self.motor.home(now_s)
        elif word & RUNNING == RUNNING and risen & JOG:
            self.motor.other()
        elif word & RUNNING == RUNNING and risen & START:
            self._start(word & MODE == DIRECT, now_s)

    def _start(self, is_direct: bool, now_s: float) -> None:
        if not is_direct:
            self.motor.other()  # the record that register 1 names
        elif self.image.word(DIRECTION) & OTHER_KINDS:
            self.unheard_of(DIRECTION, self.image.word(DIRECTION))
        elif self.image.word(DIRECTION) & RELATIVE:
            self.motor.relative(self.get32(SETPOINT), Basis.TARGET, now_s)
        else:
            self.motor.absolute(self.get32(SETPOINT), now_s)
