"""JMC integrated motors of the RC series: IHSS-RC, IHT-RC, iHSV-RC.

Source: JMC iHSV-RC manual V1.2 and JMC Modbus manual V2.2, as published programs cite them: objects, their
widths, control and status word, homing methods.

An address is the index of a CiA 402 object. A frame that goes on after an object goes on with the next of a
table (:data:`TABLE`), whatever its index. Which rise of bit 4 moves is told in two ways: here each one. What
a distance counts from is not public: here the commanded place. Not simulated: speed and torque (a run at a
speed is noted), the watchdog, acceleration codes.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.device_control import RELATIVE, DeviceControl, Order402
from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, bits_of, signed
from gateway.simulator.server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError

ORDER: Final = 0x6000
WATCHDOG: Final = 0x6039
CONTROL: Final = 0x6040
STATUS: Final = 0x6041
QUICK_STOP: Final = 0x605A
MODE: Final = 0x6060
MODE_SHOWN: Final = 0x6061
ACTUAL: Final = 0x6064
TARGET: Final = 0x607A
HOME_PLACE: Final = 0x607C
SPEED: Final = 0x6081
METHOD: Final = 0x6098
POSITION_MODE: Final = 1
HOME_MODE: Final = 6
RUNS: Final = frozenset({3, 4})
"""Modes that run without a rise of bit 4: speed and torque."""
HERE: Final = 0
"""The homing method that moves nothing."""
OBJECT_WORDS: Final = {
    **dict.fromkeys((ORDER, WATCHDOG, CONTROL, STATUS, QUICK_STOP, MODE, MODE_SHOWN, METHOD, 0x609A), 1),
    **dict.fromkeys((ACTUAL, TARGET, HOME_PLACE, SPEED, 0x6099, 0x609B), 2),
    **dict.fromkeys((0x6083, 0x6084, 0x6085), 1),
}
READ_ONLY: Final = frozenset({STATUS, MODE_SHOWN, ACTUAL})
TABLE: Final = (CONTROL, MODE, SPEED, 0x6083, 0x6084, 0x6085, TARGET)


class JmcRc(MotorDrive):
    """See the module."""

    functions = frozenset({3, 6, 16})

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._control = DeviceControl(steps=False)
        self._objects = {index: bytes(2 * words) for index, words in OBJECT_WORDS.items()}
        self._set(MODE, POSITION_MODE)
        self._set(METHOD, 1)

    def has(self, address: int, count: int) -> bool:
        """See :class:`RegisterServer`."""
        return bool(_objects_of(address, count))

    def read_words(self, address: int, count: int) -> bytes:
        """See :class:`RegisterServer`; the mode can only be written."""
        indexes = _objects_of(address, count)
        if MODE in indexes:
            raise RefusedError(ILLEGAL_ADDRESS)
        return b"".join(self._objects[index] for index in indexes)

    def before_write(self, address: int, count: int, now_s: float) -> None:
        """See :class:`RegisterServer`."""
        if not READ_ONLY.isdisjoint(_objects_of(address, count)):
            raise RefusedError(ILLEGAL_ADDRESS)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Put the frame into its objects; the control word acts when all of them are there."""
        indexes = _objects_of(address, len(data) // 2)
        for index in indexes:
            size = 2 * OBJECT_WORDS[index]
            self._objects[index], data = data[:size], data[size:]
        if CONTROL in indexes:
            self._command(self._number(CONTROL), now_s)
        if self._control.is_enabled and self._number(MODE) in RUNS and {CONTROL, SPEED} & set(indexes):
            self.motor.other()
        self.show()

    def show(self) -> None:
        """See :class:`MotorDrive`."""
        motor, control = self.motor, self._control
        self._objects[ACTUAL] = (motor.actual_counts & 0xFFFF_FFFF).to_bytes(4)
        self._objects[MODE_SHOWN] = self._objects[MODE]
        state = bits_of(
            b2=control.is_enabled,
            b3=motor.has_alarm,
            b9=motor.is_moving,
            b10=motor.is_done,
            b12=motor.is_homed,
        )
        self._set(STATUS, state)

    def _number(self, index: int) -> int:
        data = self._objects[index]
        return signed(int.from_bytes(data), 8 * len(data))

    def _set(self, index: int, value: int) -> None:
        self._objects[index] = value.to_bytes(2 * OBJECT_WORDS[index])

    def _command(self, word: int, now_s: float) -> None:
        match self._control.write(word & 0xFFFF):
            case Order402.FAULT_RESET:
                self.motor.mechanics.alarm = False
            case Order402.STOP:
                self.motor.stop(now_s)
            case Order402.START:
                self._start(word, now_s)

    def _start(self, word: int, now_s: float) -> None:
        mode = self._number(MODE)
        if mode == HOME_MODE and self._number(METHOD) == HERE:
            self.motor.set_position(self._number(HOME_PLACE), now_s)
        elif mode == HOME_MODE:
            self.motor.home(now_s)
        elif mode == POSITION_MODE and word & RELATIVE:
            self.motor.relative(self._number(TARGET), Basis.COMMANDED, now_s)
        elif mode == POSITION_MODE:
            self.motor.absolute(self._number(TARGET), now_s)
        elif mode not in RUNS:
            self.unheard_of(MODE, mode & 0xFFFF)


def _objects_of(address: int, count: int) -> list[int]:
    """Return the objects that a frame goes through: those of the table behind its first; it ends with one.

    Raises:
        RefusedError: there is none, or the frame ends inside one.
    """
    if address not in OBJECT_WORDS:
        raise RefusedError(ILLEGAL_ADDRESS)
    indexes = [address]
    count -= OBJECT_WORDS[address]
    rest = iter(TABLE[TABLE.index(address) + 1 :] if address in TABLE else ())
    while count > 0:
        following = next(rest, None)
        if following is None:
            raise RefusedError(ILLEGAL_ADDRESS)
        indexes.append(following)
        count -= OBJECT_WORDS[following]
    if count:
        raise RefusedError(ILLEGAL_VALUE)
    return indexes
