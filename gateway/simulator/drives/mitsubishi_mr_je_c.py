"""Mitsubishi MR-JE-C with Modbus TCP (and RTU).

Source: MR-JE-_C servo amplifier instruction manual, Modbus TCP / RTU communication (function codes, word
order, rules for 32-bit objects).

After an object, a frame continues with the next index. Simulated: profile position, homing, point table, halt
and quick stop. Not simulated: a set-point that waits for the present one (bit 5 = 0): each takes effect
immediately; velocity, torque, jog and indexer modes (a target speed is recorded).
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
from gateway.simulator.drives.motor_drive import Motor, signed

FIRST_POINT: Final = 0x2801
LAST_POINT: Final = 0x28FF
POINT_WORDS: Final = 15
CHOSEN_POINT: Final = 0x2D60
ACTUAL_POINT: Final = 0x2D69
SPEED: Final = 0x60FF
POINT_MODE: Final = -101
HERE: Final = frozenset({35, 37})
"""Homing methods that make the present position home."""
OBJECT_WORDS: Final = {
    **dict.fromkeys((CONTROL, STATUS, MODE, MODE_SHOWN, METHOD, CHOSEN_POINT, ACTUAL_POINT), 1),
    **dict.fromkeys((ACTUAL, TARGET, 0x607C, 0x6081, 0x6083, 0x6084, 0x60F4, SPEED), 2),
    0x607D: 5,
    **dict.fromkeys(range(FIRST_POINT, LAST_POINT + 1), POINT_WORDS),
}
READ_ONLY: Final = frozenset({STATUS, MODE_SHOWN, ACTUAL, ACTUAL_POINT, 0x60F4})


class MitsubishiMrJeC(ObjectRegisters):
    """A simulated MR-JE-C."""

    functions = frozenset({3, 8, 16})
    run_objects = frozenset({SPEED})
    object_words = OBJECT_WORDS
    read_only = READ_ONLY

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._set_word(MODE, POSITION_MODE)

    def show(self) -> None:
        position = self.motor.actual_counts & 0xFFFF_FFFF
        self.objects[ACTUAL] = (position & 0xFFFF).to_bytes(2) + (position >> 16).to_bytes(2)
        self.objects[MODE_SHOWN] = self.objects[MODE]
        self._set_word(STATUS, self.status())

    def number(self, index: int) -> int:
        if OBJECT_WORDS[index] == 1:
            return signed(int.from_bytes(self.objects[index]), 16)
        return self._long(index, 0)

    def _long(self, index: int, at: int) -> int:
        low, high = (int.from_bytes(self.objects[index][at + i : at + i + 2]) for i in (0, 2))
        return signed(high << 16 | low, 32)

    def _set_word(self, index: int, word: int) -> None:
        self.objects[index] = word.to_bytes(2)

    def go_home(self, now_s: float) -> None:
        if self.number(METHOD) in HERE:
            self.motor.set_position(0, now_s)
        else:
            self.motor.home(now_s)

    def start_in(self, mode: int, now_s: float) -> None:
        """Start a point of the table: a count, the position, and six more numbers."""
        if mode != POINT_MODE:
            self.motor.other()
            return
        number = self.number(CHOSEN_POINT)
        index = FIRST_POINT + number - 1
        if FIRST_POINT <= index <= LAST_POINT:
            self.motor.absolute(self._long(index, 2), now_s)
            self._set_word(ACTUAL_POINT, number)
