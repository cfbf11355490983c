"""Kollmorgen AKD2G with its default Modbus map, both axes.

Source: Kollmorgen 907-200010 rev. A (AKD2G Modbus communications manual): default map, MODBUS.ERRORMODE,
action commands; its online manual, AXIS#.MT.CNTL and AXIS#.MOTIONSTAT.

Every parameter takes two registers, the high word first, in thousandths of the axis's units; axis 2 is 50
registers further on. MT.MOVE is an action: it starts motion task 0 when it changes from 0. Errors are not
reported (``error_mode`` 1): a block is executed to its end, without what cannot be written. The sources do
not say what the codes 33, 34 and 35 mean: here a part of a parameter, a read-only parameter, and no
parameter. Not simulated: MODBUS.MAP, MOTIONCONTROL (whose bits are not public), other motion tasks and their
starts, throttling.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, bits_of
from gateway.simulator.server import ModbusExceptionError

POSITION: Final = 0
VELOCITY: Final = 2
ACTIVE: Final = 4
MOTION_STATUS: Final = 6
DISABLE_SOURCES: Final = 8
FAULTED: Final = 10
MOTION_CONTROL: Final = 20
MOVE: Final = 22
TASK_ACCELERATION: Final = 24
TASK_DECELERATION: Final = 26
TASK_VELOCITY: Final = 28
TASK_POSITION: Final = 30
TASK_CONTROL: Final = 32
INPUTS: Final = 100
AXIS_STRIDE: Final = 50
LAST_REGISTER: Final = 299

READABLE: Final = frozenset({POSITION, VELOCITY, ACTIVE, MOTION_STATUS, DISABLE_SOURCES, FAULTED})
WRITABLE: Final = frozenset(
    {MOTION_CONTROL, MOVE, TASK_ACCELERATION, TASK_DECELERATION, TASK_VELOCITY, TASK_POSITION, TASK_CONTROL}
)
KIND: Final = 0x001F
"""Of MT.CNTL: the kind of move, and whether the next task runs after it."""
ABSOLUTE: Final = 0
BASES: Final = {0x01: Basis.COMMANDED, 0x03: Basis.TARGET, 0x07: Basis.ACTUAL}
PARTIAL: Final = 33
READ_ONLY: Final = 34
NOT_MAPPED: Final = 35


class KollmorgenAkd2g(MotorDrive):
    """A simulated AKD2G."""

    functions = frozenset({3, 6, 16})
    register_ranges = ((0, LAST_REGISTER),)
    most_motors = 2

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.error_mode = 1

    def show(self) -> None:
        for index, motor in enumerate(self.axes):
            base = AXIS_STRIDE * index
            self.put32(base + POSITION, motor.actual_counts)
            self.put32(base + ACTIVE, int(not motor.has_alarm))
            state = bits_of(
                b0=motor.is_moving,
                b1=motor.is_homed,
                b2=motor.is_homed,
                b11=motor.is_done,
                b13=motor.has_alarm,
            )
            self.put32(base + MOTION_STATUS, state)
            self.put32(base + FAULTED, int(motor.has_alarm))

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Write the parameters that are whole and writable; ignore the rest."""
        error = 0
        end = address + len(data) // 2
        for parameter in range(address & ~1, end, 2):
            wrong = self._wrong(parameter, address, end)
            error = error or wrong
            if not wrong:
                at = 2 * (parameter - address)
                self._write(parameter, data[at : at + 4], now_s)
        self.show()
        if error and not self.error_mode:
            raise ModbusExceptionError(error)

    def _wrong(self, parameter: int, address: int, end: int) -> int:
        """Return the code for a parameter that cannot be written, or 0."""
        index, offset = divmod(parameter, AXIS_STRIDE)
        if parameter < address or parameter + 2 > end:
            return PARTIAL
        if parameter == INPUTS or (index < len(self.axes) and offset in READABLE):
            return READ_ONLY
        return 0 if index < len(self.axes) and offset in WRITABLE else NOT_MAPPED

    def _write(self, parameter: int, data: bytes, now_s: float) -> None:
        before = self.get32(parameter)
        self.image.store_words(parameter, data)
        index, offset = divmod(parameter, AXIS_STRIDE)
        if offset == MOVE and not before and self.get32(parameter):
            self._run(self.axes[index], AXIS_STRIDE * index, now_s)
        elif offset == MOTION_CONTROL and self.get32(parameter):
            self.unheard_of(parameter + 1, self.get32(parameter) & 0xFFFF)

    def _run(self, motor: Motor, base: int, now_s: float) -> None:
        kind, position = self.get32(base + TASK_CONTROL) & KIND, self.get32(base + TASK_POSITION)
        if kind == ABSOLUTE:
            motor.absolute(position, now_s)
        elif kind in BASES:
            motor.relative(position, BASES[kind], now_s)
        else:
            motor.other()
