"""Mitsubishi MR-JE-C with Modbus TCP (and RTU).

Source: MR-JE-_C servo amplifier instruction manual, Modbus TCP / RTU communication (function codes, word
order, rules for 32-bit objects).

An address is the index of an object; an object takes as many registers as it is long, all at its one
address, and a frame over several objects holds them one behind the other. Simulated: profile position,
homing, point table, halt and quick stop. Not simulated: a set-point that waits for the one under way (bit 5
= 0): every one is taken at once; velocity, torque, jog and indexer modes (a target speed is noted).
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.device_control import RELATIVE, DeviceControl, Order402
from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, Order, bits_of, signed
from gateway.simulator.server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError

CONTROL: Final = 0x6040
STATUS: Final = 0x6041
MODE: Final = 0x6060
MODE_SHOWN: Final = 0x6061
ACTUAL: Final = 0x6064
TARGET: Final = 0x607A
FIRST_POINT: Final = 0x2801
LAST_POINT: Final = 0x28FF
POINT_WORDS: Final = 15
CHOSEN_POINT: Final = 0x2D60
ACTUAL_POINT: Final = 0x2D69
METHOD: Final = 0x6098
SPEED: Final = 0x60FF
POSITION_MODE: Final = 1
SPEED_MODE: Final = 3
HOME_MODE: Final = 6
POINT_MODE: Final = -101
HERE: Final = frozenset({35, 37})
"""Homing methods that call the place where the axis stands home."""
OBJECT_WORDS: Final = {
    **dict.fromkeys((CONTROL, STATUS, MODE, MODE_SHOWN, METHOD, CHOSEN_POINT, ACTUAL_POINT), 1),
    **dict.fromkeys((ACTUAL, TARGET, 0x607C, 0x6081, 0x6083, 0x6084, 0x60F4, SPEED), 2),
    0x607D: 5,
    **dict.fromkeys(range(FIRST_POINT, LAST_POINT + 1), POINT_WORDS),
}
WRITABLE: Final = OBJECT_WORDS.keys() - {STATUS, MODE_SHOWN, ACTUAL, ACTUAL_POINT, 0x60F4}


class MitsubishiMrJeC(MotorDrive):
    """See the module."""

    functions = frozenset({3, 8, 16})
    order = Order.LOW_FIRST

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._control = DeviceControl(steps=True)
        self._objects = {index: bytes(2 * words) for index, words in OBJECT_WORDS.items()}
        self._set_word(MODE, POSITION_MODE)

    def has(self, address: int, count: int) -> bool:
        """See :class:`RegisterServer`."""
        return bool(self._objects_of(address, count))

    def _objects_of(self, address: int, count: int) -> list[int]:
        """Return the objects that a frame is made of; it may not end inside one."""
        indexes: list[int] = []
        while count > 0:
            if address not in OBJECT_WORDS:
                raise RefusedError(ILLEGAL_ADDRESS)
            indexes.append(address)
            count -= OBJECT_WORDS[address]
            address += 1
        if count:
            raise RefusedError(ILLEGAL_VALUE)
        return indexes

    def read_words(self, address: int, count: int) -> bytes:
        """See :class:`RegisterServer`."""
        return b"".join(self._objects[index] for index in self._objects_of(address, count))

    def before_write(self, address: int, count: int, now_s: float) -> None:
        """See :class:`RegisterServer`."""
        if not WRITABLE.issuperset(self._objects_of(address, count)):
            raise RefusedError(ILLEGAL_ADDRESS)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """See :class:`RegisterServer`."""
        indexes = self._objects_of(address, len(data) // 2)
        at = 0
        for index in indexes:
            size = 2 * OBJECT_WORDS[index]
            self._objects[index] = data[at : at + size]
            at += size
        if CONTROL in indexes:
            self._command(self._word(CONTROL), now_s)
        if SPEED in indexes and signed(self._word(MODE), 16) == SPEED_MODE and self._control.is_enabled:
            self.motor.other()
        self.show()

    def show(self) -> None:
        """See :class:`MotorDrive`."""
        motor, control = self.motor, self._control
        position = motor.actual_counts & 0xFFFF_FFFF
        self._objects[ACTUAL] = (position & 0xFFFF).to_bytes(2) + (position >> 16).to_bytes(2)
        self._objects[MODE_SHOWN] = self._objects[MODE]
        is_home = signed(self._word(MODE), 16) == HOME_MODE
        state = bits_of(
            b3=motor.has_alarm,
            b9=True,
            b10=motor.is_done,
            b12=motor.is_homed and motor.is_done if is_home else control.has_acknowledged,
        )
        self._set_word(STATUS, control.state.value | state)

    def _word(self, index: int) -> int:
        return int.from_bytes(self._objects[index][:2])

    def _set_word(self, index: int, word: int) -> None:
        self._objects[index] = word.to_bytes(2)

    def _number(self, index: int, at: int) -> int:
        low, high = (int.from_bytes(self._objects[index][at + i : at + i + 2]) for i in (0, 2))
        return signed(high << 16 | low, 32)

    def _command(self, word: int, now_s: float) -> None:
        match self._control.write(word):
            case Order402.FAULT_RESET:
                self.motor.mechanics.alarm = False
            case Order402.STOP:
                self.motor.stop(now_s)
            case Order402.START:
                self._start(word, now_s)

    def _start(self, word: int, now_s: float) -> None:
        mode = signed(self._word(MODE), 16)
        if mode == HOME_MODE and self._word(METHOD) in HERE:
            self.motor.set_position(0, now_s)
        elif mode == HOME_MODE:
            self.motor.home(now_s)
        elif mode == POINT_MODE:
            self._run_point(self._word(CHOSEN_POINT), now_s)
        elif mode != POSITION_MODE:
            self.motor.other()
        elif word & RELATIVE:
            self.motor.relative(self._number(TARGET, 0), Basis.COMMANDED, now_s)
        else:
            self.motor.absolute(self._number(TARGET, 0), now_s)

    def _run_point(self, number: int, now_s: float) -> None:
        """Run a line of the point table: a count, then the position, then six more numbers."""
        index = FIRST_POINT + number - 1
        if FIRST_POINT <= index <= LAST_POINT:
            self.motor.absolute(self._number(index, 2), now_s)
            self._set_word(ACTUAL_POINT, number)
