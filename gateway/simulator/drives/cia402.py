"""CiA 402 (IEC 61800-7-201) as several drives implement it: control word, status word, effect of a start.

Bits of the control word: 0 to 3 switch on, 4 new set-point (or start of homing), 5 change immediately, 6
relative, 7 fault reset, 8 halt.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, bits_of
from gateway.simulator.server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusExceptionError

CONTROL: Final = 0x6040
STATUS: Final = 0x6041
MODE: Final = 0x6060
MODE_SHOWN: Final = 0x6061
ACTUAL: Final = 0x6064
TARGET: Final = 0x607A
METHOD: Final = 0x6098
"""Of homing."""
POSITION_MODE: Final = 1
SPEED_MODE: Final = 3
HOME_MODE: Final = 6

ON_BITS: Final = 0x000F
SWITCH_ON: Final = 0x0001
VOLTAGE: Final = 0x0002
NO_QUICK_STOP: Final = 0x0004
NEW_SET_POINT: Final = 0x0010
RELATIVE: Final = 0x0040
FAULT_RESET: Final = 0x0080
HALT: Final = 0x0100


class DeviceState(Enum):
    """States of the device; the value is the lowest seven bits of the status word."""

    SWITCH_ON_DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    FAULT = 0x08


class Order402(Enum):
    """What a control word makes the drive do."""

    NOTHING = "nothing"
    START = "start"
    STOP = "stop"
    FAULT_RESET = "fault reset"


class DeviceControl:
    """The state machine. With ``steps`` only the previous state permits enabling (06, then 07 or 0F)."""

    def __init__(self, *, steps: bool) -> None:
        self.word = 0
        self.state = DeviceState.SWITCH_ON_DISABLED
        self.has_acknowledged = False
        """A new set-point was acknowledged, and its bit is still set."""
        self._steps = steps

    @property
    def is_enabled(self) -> bool:
        """Whether the motor is energised."""
        return self.state is DeviceState.ENABLED

    def write(self, word: int) -> Order402:
        """Take a control word. It starts something only if the bit rises while the drive is enabled."""
        before, self.word = self.word, word
        if word & FAULT_RESET & ~before:
            self.state = DeviceState.SWITCH_ON_DISABLED
            return Order402.FAULT_RESET
        was_enabled = self.is_enabled
        self.state = self._next_state(word)
        if not word & NEW_SET_POINT:
            self.has_acknowledged = False
        if was_enabled and (not self.is_enabled or word & HALT & ~before):
            return Order402.STOP
        if self.is_enabled and word & NEW_SET_POINT & ~before and not word & HALT:
            self.has_acknowledged = True
            return Order402.START
        return Order402.NOTHING

    def _next_state(self, word: int) -> DeviceState:
        if not word & VOLTAGE:
            return DeviceState.SWITCH_ON_DISABLED
        if not word & NO_QUICK_STOP:
            return DeviceState.QUICK_STOP if self.is_enabled else DeviceState.SWITCH_ON_DISABLED
        if not word & SWITCH_ON:
            return DeviceState.READY
        if self._steps and self.state in {DeviceState.SWITCH_ON_DISABLED, DeviceState.QUICK_STOP}:
            return self.state
        return DeviceState.ENABLED if word & ON_BITS == ON_BITS else DeviceState.SWITCHED_ON


class Drive402(MotorDrive, ABC):
    """A drive with such a control word.

    A start does what the mode says: homing, or a move to the target. A subclass says which registers hold its
    numbers, and what its other modes do.
    """

    steps = True
    mode_at = MODE
    target_at = TARGET
    run_modes: frozenset[int] = frozenset({SPEED_MODE})
    """Modes that turn the motor without a start."""
    run_objects: frozenset[int] = frozenset()
    """Objects that start the motor in one of these modes when written."""

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.control = DeviceControl(steps=self.steps)

    @abstractmethod
    def number(self, index: int) -> int:
        """Return the signed number in an object."""

    def go_home(self, now_s: float) -> None:
        """Handle a start in homing mode."""
        self.motor.home(now_s)

    def start_in(self, mode: int, now_s: float) -> None:
        """Handle a start in a mode that is neither homing nor position."""
        self.motor.other()

    def command(self, word: int, now_s: float) -> bool:
        """Execute a control word. Return whether it was a start."""
        match self.control.write(word):
            case Order402.FAULT_RESET:
                self.motor.mechanics.alarm = False
            case Order402.STOP:
                self.motor.stop(now_s)
            case Order402.START:
                self._start(word, now_s)
                return True
        return False

    def _start(self, word: int, now_s: float) -> None:
        mode = self.number(self.mode_at)
        if mode == HOME_MODE:
            self.go_home(now_s)
        elif mode != POSITION_MODE:
            self.start_in(mode, now_s)
        elif word & RELATIVE:
            self.motor.relative(self.number(self.target_at), Basis.COMMANDED, now_s)
        else:
            self.motor.absolute(self.number(self.target_at), now_s)

    def objects_written(self, indexes: Sequence[int], now_s: float) -> None:
        """Handle written objects after all of one frame are stored."""
        if CONTROL in indexes:
            self.command(self.number(CONTROL) & 0xFFFF, now_s)
        runs = self.control.is_enabled and self.number(self.mode_at) in self.run_modes
        if runs and not self.run_objects.isdisjoint(indexes):
            self.motor.other()
        self.show()

    def status(self) -> int:
        """Return the status word of the profile."""
        motor = self.motor
        is_home = self.number(self.mode_at) == HOME_MODE
        return self.control.state.value | bits_of(
            b3=motor.has_alarm,
            b9=True,
            b10=motor.is_done,
            b12=motor.is_homed and motor.is_done if is_home else self.control.has_acknowledged,
        )


class ObjectRegisters(Drive402):
    """A drive whose register addresses are object indexes.

    An object takes as many registers as it is long, all at its one address. A frame over several objects
    holds them one after the other, and may not end inside one.
    """

    object_words: Mapping[int, int]
    """Number of words of each object."""
    read_only: frozenset[int]
    write_only: frozenset[int] = frozenset()

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.objects = {index: bytes(2 * words) for index, words in self.object_words.items()}

    def following(self, index: int) -> int | None:
        """Return the object at which a frame continues; None if it cannot."""
        return index + 1

    def has(self, address: int, count: int) -> bool:
        return bool(self._indexes(address, count))

    def read_words(self, address: int, count: int) -> bytes:
        indexes = self._indexes(address, count)
        if not self.write_only.isdisjoint(indexes):
            raise ModbusExceptionError(ILLEGAL_ADDRESS)
        return b"".join(self.objects[index] for index in indexes)

    def before_write(self, address: int, count: int, now_s: float) -> None:
        if not self.read_only.isdisjoint(self._indexes(address, count)):
            raise ModbusExceptionError(ILLEGAL_ADDRESS)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Store the frame in its objects, then handle all of them."""
        indexes = self._indexes(address, len(data) // 2)
        for index in indexes:
            size = 2 * self.object_words[index]
            self.objects[index], data = data[:size], data[size:]
        self.objects_written(indexes, now_s)

    def _indexes(self, address: int, count: int) -> list[int]:
        """Return the objects that a frame covers.

        Raises:
            RefusedError: there is none, or the frame ends inside one.
        """
        indexes: list[int] = []
        index: int | None = address
        while count > 0:
            if index is None or index not in self.object_words:
                raise ModbusExceptionError(ILLEGAL_ADDRESS)
            indexes.append(index)
            count -= self.object_words[index]
            index = self.following(index)
        if count:
            raise ModbusExceptionError(ILLEGAL_VALUE)
        return indexes
