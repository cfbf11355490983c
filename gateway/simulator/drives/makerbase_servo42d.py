"""Makerbase MKS SERVO42D and 57D, firmware 1.0.9 with Modbus RTU.

Source: Makerbase, MKS SERVO42&57D_Modbus RTU User Manual V1.0.9, pages 9 to 64, and the RS485 manual V1.0.5,
part 8.

An address is an opcode: a block of four registers at 0x00F4, 0x00F5 or 0x00FE is one command, and 0x00F5 is
not the second register of 0x00F4. In each of them, and in 0x00FD and 0x00F6, speed 0 is a stop. The drive has
no exceptions: it refuses FC06 with an echo of FFFF, FC16 with a count of 0, everything else without a reply.
Counts are 1/16384 of a turn, pulses 1/3200. Not simulated: relative moves in pulses (0x00FD), whose sign the
sources do not give, and speed mode, which both turn nothing; settings.
"""

from struct import pack, unpack
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, MotorDrive
from gateway.simulator.server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusExceptionError

CARRY: Final = 0x0030
"""Turns, followed by the position in the turn."""
ACTUAL: Final = 0x0031
PULSES: Final = 0x0033
STATE: Final = 0x00F1
READINGS: Final = {CARRY: 3, ACTUAL: 3, PULSES: 2, STATE: 1}
"""Number of registers of each reading; their addresses are not contiguous."""
STOPPED: Final = 1
AT_SPEED: Final = 4
HOMING: Final = 5
CLEAR_STALL: Final = 0x003D
ENABLE: Final = 0x00F3
SPEED: Final = 0x00F6
SPEED_WORDS: Final = 2
HOME: Final = 0x0091
SET_ZERO: Final = 0x0092
RELATIVE_COORDINATE: Final = 0x00F4
ABSOLUTE_COORDINATE: Final = 0x00F5
EMERGENCY_STOP: Final = 0x00F7
RELATIVE_PULSES: Final = 0x00FD
ABSOLUTE_PULSES: Final = 0x00FE
MOVES: Final = frozenset({RELATIVE_COORDINATE, ABSOLUTE_COORDINATE, RELATIVE_PULSES, ABSOLUTE_PULSES})
MOVE_WORDS: Final = 4
COMMANDS: Final = frozenset({CLEAR_STALL, HOME, SET_ZERO, ENABLE, EMERGENCY_STOP})
LENGTHS: Final = {SPEED: SPEED_WORDS} | dict.fromkeys(MOVES, MOVE_WORDS) | dict.fromkeys(COMMANDS, 1)
"""Registers of each command."""
GO: Final = 1
COUNTS_PER_REVOLUTION: Final = 16_384
PULSES_PER_REVOLUTION: Final = 3_200
FAILED: Final = b"\xff\xff"


class MakerbaseServo42d(MotorDrive):
    """A simulated MKS SERVO42D or 57D."""

    functions = frozenset({4, 6, 16})

    def refusal(self, request: bytes, code: int) -> bytes | None:
        """Return the reply in place of an exception."""
        if request[0] == 6 and len(request) == 5:
            return request[:3] + FAILED
        if request[0] == 16 and len(request) > 5:
            return request[:3] + bytes(2)
        return None

    def has(self, address: int, count: int) -> bool:
        return READINGS.get(address) == count or address in LENGTHS

    def before_write(self, address: int, count: int, now_s: float) -> None:
        """Require an opcode with all of its data and nothing else."""
        if address not in LENGTHS:
            raise ModbusExceptionError(ILLEGAL_ADDRESS)
        if count != LENGTHS[address]:
            raise ModbusExceptionError(ILLEGAL_VALUE)

    def read_words(self, address: int, count: int) -> bytes:
        """Return one reading. Opcodes cannot be read, and a read covers one reading only."""
        if address not in READINGS:
            raise ModbusExceptionError(ILLEGAL_ADDRESS)
        counts = self.motor.actual_counts
        match address:
            case reading if reading == ACTUAL:
                return (counts % (1 << 48)).to_bytes(6)
            case reading if reading == CARRY:
                revolutions, remainder = divmod(counts, COUNTS_PER_REVOLUTION)
                return pack(">iH", revolutions, remainder)
            case reading if reading == PULSES:
                return pack(">i", round(counts * PULSES_PER_REVOLUTION / COUNTS_PER_REVOLUTION))
            case _:
                return self._state().to_bytes(2)

    def _state(self) -> int:
        if self.motor.is_homing:
            return HOMING
        return AT_SPEED if self.motor.is_moving else STOPPED

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Execute an opcode; nothing is stored."""
        if address in MOVES:
            _, speed, position = unpack(">HHi", data)
            self._move(address, speed, position, now_s)
        elif address == SPEED:
            _, speed = unpack(">HH", data)
            if speed:
                self.motor.other()
            else:
                self.motor.stop(now_s)
        elif address == ENABLE:
            if data == bytes(2):
                self.motor.stop(now_s)
        elif data != GO.to_bytes(2):
            raise ModbusExceptionError(ILLEGAL_VALUE)
        elif address == HOME:
            self.motor.home(now_s)
        elif address == EMERGENCY_STOP:
            self.motor.stop(now_s)
        elif address == CLEAR_STALL:
            self.motor.mechanics.alarm = False
        elif self.motor.is_moving:
            raise ModbusExceptionError(ILLEGAL_VALUE)
        else:
            self.motor.set_position(0, now_s)

    def _move(self, opcode: int, speed: int, position: int, now_s: float) -> None:
        if not speed:
            self.motor.stop(now_s)
        elif opcode == ABSOLUTE_COORDINATE:
            self.motor.absolute(position, now_s)
        elif opcode == RELATIVE_COORDINATE:
            self.motor.relative(position, Basis.COMMANDED, now_s)
        elif opcode == ABSOLUTE_PULSES:
            self.motor.absolute(round(position * COUNTS_PER_REVOLUTION / PULSES_PER_REVOLUTION), now_s)
        else:
            self.motor.other()
