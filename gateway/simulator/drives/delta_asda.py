"""Delta ASDA-A2 and B3, SureServo2: PR mode.

Source: ASDA-A2 user manual (parameters, chapter on communication: function codes, 10 ms of silence), ASDA-B
manual (exception codes 27h to 29h).

Each parameter Pg.n takes the two registers g × 0x100 + 2n, the low word first. The drive is commissioned:
servo on, all paths absolute single moves (type 2). The option bits of a definition are those of a published
SureServo2 program. Not simulated: paths that run another one or count from a captured position, the pause
that a drive needs between target and trigger, EEPROM wear, paths above 49.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, Order, bits_of
from gateway.simulator.server import ModbusExceptionError

ALARM: Final = 0x0002
MONITOR: Final = 0x0012
MONITOR_CHOICE: Final = 0x0022
FEEDBACK_PUU: Final = 0
STATUS: Final = 0x005C
ABSOLUTE_POSITION: Final = 0x0066
TRIGGER: Final = 0x050E
ACTUAL: Final = 0x0520
DEFINITIONS: Final = 0x0600
TARGETS: Final = 0x0602
PATH_STRIDE: Final = 4
LAST_PATH: Final = 49
HOME: Final = 0
STOP: Final = 1000
RUNNING: Final = 10_000
DONE: Final = 20_000
TYPE: Final = 0x000F
SPEED: Final = 1
POINTS: Final = frozenset({2, 3})
"""A move to a position, and one that then continues with the next path; the next path is not simulated."""
COMMAND: Final = 0x00C0
ABSOLUTE: Final = 0x0000
FROM_ACTUAL: Final = 0x0040
FROM_TARGET: Final = 0x0080
HOMING_MODE: Final = 0x0508
DEFINE_ORIGIN: Final = 8
LOCK: Final = 0x0210
UNLOCKED: Final = 271
BUILD_ORIGIN: Final = 0x028E
"""Sets the origin of the absolute encoder at the present position; executed after 271 was written to
P2-08."""

LAST_GROUP: Final = 7
LAST_REGISTER: Final = 2 * 99 + 1
MONITORS: Final = frozenset(
    register
    for first in (ALARM, MONITOR, STATUS, ABSOLUTE_POSITION, ACTUAL)
    for register in (first, first + 1)
)
NO_GROUP: Final = 0x01
NO_PARAMETER: Final = 0x02
TOO_MANY_WORDS: Final = 0x04
NO_WORDS: Final = 0x05
READ_ONLY: Final = 0x06
ILLEGAL_VALUE: Final = 0x27

SILENCE_S: Final = 0.010


class DeltaAsda(MotorDrive):
    """A simulated ASDA drive."""

    functions = frozenset({3, 6, 16})
    max_read = 10
    max_write = 12
    order = Order.LOW_FIRST

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._path: int | None = None
        for path in range(1, LAST_PATH + 1):
            self.image.set_word(DEFINITIONS + PATH_STRIDE * path, 2)

    def response_delay_s(self, baudrate: int) -> float:
        """Return the silence before every frame; 0 on TCP, which only device servers use."""
        return SILENCE_S

    def refusal(self, request: bytes, code: int) -> bytes | None:
        """Return the drive's own codes for words and addresses."""
        if code == 3 and len(request) >= 5:
            count = int.from_bytes(request[3:5])
            code = NO_WORDS if not count else TOO_MANY_WORDS if count > self.max_read else code
        elif code == 2 and len(request) >= 3 and request[1] > LAST_GROUP:
            code = NO_GROUP
        return super().refusal(request, code)

    def has(self, address: int, count: int) -> bool:
        return address >> 8 <= LAST_GROUP and (address & 0xFF) + count - 1 <= LAST_REGISTER

    def before_write(self, address: int, count: int, now_s: float) -> None:
        if MONITORS & set(range(address, address + count)):
            raise ModbusExceptionError(READ_ONLY)

    def show(self) -> None:
        motor = self.motor
        self.put32(ACTUAL, motor.actual_counts)
        self.put32(ABSOLUTE_POSITION, motor.actual_counts)
        if self.image.word(MONITOR_CHOICE) == FEEDBACK_PUU:
            self.put32(MONITOR, motor.actual_counts)
        self.image.set_word(ALARM, int(motor.has_alarm))
        self.image.set_word(
            STATUS,
            bits_of(
                b0=not motor.has_alarm,
                b1=not motor.has_alarm,
                b2=not motor.is_moving,
                b4=motor.is_done,
                b6=motor.has_alarm,
                b8=motor.is_homed,
            ),
        )
        if self._path is not None:
            self.image.set_word(TRIGGER, (RUNNING if motor.is_moving else DONE) + self._path)

    def written(self, before: dict[int, int], now_s: float) -> None:
        builds = BUILD_ORIGIN in before and self.image.word(BUILD_ORIGIN) == 1
        if builds and self.image.word(LOCK) == UNLOCKED:
            self.motor.set_position(0, now_s)
        if TRIGGER not in before:
            return
        value = self.image.word(TRIGGER)
        if value == HOME:
            self._path = 0
            if self.image.word(HOMING_MODE) & TYPE == DEFINE_ORIGIN:
                self.motor.set_position(0, now_s)
            else:
                self.motor.home(now_s)
        elif value == STOP:
            self._path = None
            self.motor.stop(now_s)
        elif value <= LAST_PATH:
            self._run(value, now_s)
        else:
            raise ModbusExceptionError(ILLEGAL_VALUE)

    def _run(self, path: int, now_s: float) -> None:
        address = DEFINITIONS + PATH_STRIDE * path
        definition, number = self.image.word(address), self.get32(TARGETS + PATH_STRIDE * path)
        kind, command = definition & TYPE, definition & COMMAND
        if kind == SPEED:
            self.motor.other()
        elif kind not in POINTS or command not in {ABSOLUTE, FROM_ACTUAL, FROM_TARGET}:
            self.unheard_of(address, definition)
        else:
            self._path = path
            if command == ABSOLUTE:
                self.motor.absolute(number, now_s)
            else:
                basis = Basis.ACTUAL if command == FROM_ACTUAL else Basis.TARGET
                self.motor.relative(number, basis, now_s)
