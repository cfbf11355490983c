"""JMC integrated motors of the RC series: IHSS-RC, IHT-RC, iHSV-RC.

Source: JMC iHSV-RC manual V1.2 and JMC Modbus manual V2.2, as published programs cite them: objects, their
widths, control and status word, homing methods.

An address is the index of a CiA 402 object. After an object, a frame continues with the next one of a table
(:data:`TABLE`), whatever its index. The sources disagree on which rising edge of bit 4 starts a move: here
each one. The base of a relative move is not public: here the commanded position. Not simulated: speed and
torque (a run at a speed is recorded), the watchdog, acceleration codes.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.cia402 import (
    ACTUAL,
    CONTROL,
    METHOD,
    MODE,
    MODE_SHOWN,
    POSITION_MODE,
    STATUS,
    TARGET,
    ObjectRegisters,
)
from gateway.simulator.drives.motor_drive import Motor, bits_of, signed

ORDER: Final = 0x6000
WATCHDOG: Final = 0x6039
QUICK_STOP: Final = 0x605A
HOME_POSITION: Final = 0x607C
SPEED: Final = 0x6081
RUNS: Final = frozenset({3, 4})
"""Modes that run without a rising edge of bit 4: speed and torque."""
HERE: Final = 0
"""The homing method that moves nothing."""
OBJECT_WORDS: Final = {
    **dict.fromkeys((ORDER, WATCHDOG, CONTROL, STATUS, QUICK_STOP, MODE, MODE_SHOWN, METHOD, 0x609A), 1),
    **dict.fromkeys((ACTUAL, TARGET, HOME_POSITION, SPEED, 0x6099, 0x609B), 2),
    **dict.fromkeys((0x6083, 0x6084, 0x6085), 1),
}
READ_ONLY: Final = frozenset({STATUS, MODE_SHOWN, ACTUAL})
TABLE: Final = (CONTROL, MODE, SPEED, 0x6083, 0x6084, 0x6085, TARGET)


class JmcRc(ObjectRegisters):
    """A simulated RC series motor."""

    functions = frozenset({3, 6, 16})
    steps = False
    run_modes = RUNS
    run_objects = frozenset({CONTROL, SPEED})
    object_words = OBJECT_WORDS
    read_only = READ_ONLY
    write_only = frozenset({MODE})

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._set(MODE, POSITION_MODE)
        self._set(METHOD, 1)

    def following(self, index: int) -> int | None:
        behind = TABLE[TABLE.index(index) + 1 :] if index in TABLE else ()
        return next(iter(behind), None)

    def show(self) -> None:
        motor = self.motor
        self.objects[ACTUAL] = (motor.actual_counts & 0xFFFF_FFFF).to_bytes(4)
        self.objects[MODE_SHOWN] = self.objects[MODE]
        state = bits_of(
            b2=self.control.is_enabled,
            b3=motor.has_alarm,
            b9=motor.is_moving,
            b10=motor.is_done,
            b12=motor.is_homed,
        )
        self._set(STATUS, state)

    def number(self, index: int) -> int:
        data = self.objects[index]
        return signed(int.from_bytes(data), 8 * len(data))

    def _set(self, index: int, value: int) -> None:
        self.objects[index] = value.to_bytes(2 * OBJECT_WORDS[index])

    def go_home(self, now_s: float) -> None:
        if self.number(METHOD) == HERE:
            self.motor.set_position(self.number(HOME_POSITION), now_s)
        else:
            self.motor.home(now_s)

    def start_in(self, mode: int, now_s: float) -> None:
        if mode not in RUNS:
            self.unheard_of(MODE, mode & 0xFFFF)
