"""Makerbase MKS SERVO42D and 57D, firmware 1.0.9 with Modbus RTU.

Source: Makerbase, MKS SERVO42&57D_Modbus RTU User Manual V1.0.9, pages 9 to 64.

An address is an opcode: a block of four registers at 0x00F4, 0x00F5 or 0x00FE is one command, and 0x00F5 is
not the second register of 0x00F4. The drive knows no exceptions: it refuses FC06 with an echo of FFFF, FC16
with a count of 0, everything else in silence. Counts are 1/16384 of a turn, pulses 1/3200. Not simulated:
relative moves in pulses (0x00FD), whose sign the sources leave open; speed mode; the status registers.
"""

from struct import unpack
from typing import Final

from gateway.simulator.drives.endpoint import MotorDrive
from gateway.simulator.drives.motor import Basis
from gateway.simulator.server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError

ACTUAL: Final = 0x0031
ACTUAL_WORDS: Final = 3
HOME: Final = 0x0091
SET_ZERO: Final = 0x0092
RELATIVE_COORDINATE: Final = 0x00F4
ABSOLUTE_COORDINATE: Final = 0x00F5
EMERGENCY_STOP: Final = 0x00F7
RELATIVE_PULSES: Final = 0x00FD
ABSOLUTE_PULSES: Final = 0x00FE
MOVES: Final = frozenset({RELATIVE_COORDINATE, ABSOLUTE_COORDINATE, RELATIVE_PULSES, ABSOLUTE_PULSES})
MOVE_WORDS: Final = 4
COMMANDS: Final = frozenset({HOME, SET_ZERO, EMERGENCY_STOP})
GO: Final = 1
COUNTS_PER_TURN: Final = 16_384
PULSES_PER_TURN: Final = 3_200
FAILED: Final = b"\xff\xff"


class MakerbaseServo42d(MotorDrive):
    """See the module."""

    functions = frozenset({4, 6, 16})

    def refusal(self, request: bytes, code: int) -> bytes | None:
        """Return what stands for an exception."""
        if request[0] == 6 and len(request) == 5:
            return request[:3] + FAILED
        if request[0] == 16 and len(request) > 5:
            return request[:3] + bytes(2)
        return None

    def has(self, address: int, count: int) -> bool:
        """See :class:`RegisterServer`."""
        return (address, count) == (ACTUAL, ACTUAL_WORDS) or address in MOVES | COMMANDS

    def show(self) -> None:
        """See :class:`MotorDrive`: 48 bits, the highest word first."""
        for index in range(ACTUAL_WORDS):
            shift = 16 * (ACTUAL_WORDS - 1 - index)
            self.image.set_word(ACTUAL + index, self.motor.actual_counts >> shift)

    def before_write(self, address: int, count: int, now_s: float) -> None:
        """See :class:`RegisterServer`: an opcode comes with all of its data and nothing else."""
        if count != (MOVE_WORDS if address in MOVES else 1):
            raise RefusedError(ILLEGAL_VALUE)
        if address == ACTUAL:
            raise RefusedError(ILLEGAL_ADDRESS)

    def read_words(self, address: int, count: int) -> bytes:
        """See :class:`RegisterServer`: opcodes cannot be read."""
        if address != ACTUAL:
            raise RefusedError(ILLEGAL_ADDRESS)
        return super().read_words(address, count)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Obey an opcode: nothing is stored."""
        if address in MOVES:
            _, speed, position = unpack(">HHi", data)
            self._move(address, speed, position, now_s)
        elif data != GO.to_bytes(2):
            raise RefusedError(ILLEGAL_VALUE)
        elif address == HOME:
            self.motor.home(now_s)
        elif address == EMERGENCY_STOP:
            self.motor.stop(now_s)
        elif self.motor.is_moving:
            raise RefusedError(ILLEGAL_VALUE)
        else:
            self.motor.set_position(0, now_s)
        self.show()

    def _move(self, opcode: int, speed: int, position: int, now_s: float) -> None:
        if not speed:
            self.motor.stop(now_s)
        elif opcode == ABSOLUTE_COORDINATE:
            self.motor.absolute(position, now_s)
        elif opcode == RELATIVE_COORDINATE:
            self.motor.relative(position, Basis.COMMANDED, now_s)
        elif opcode == ABSOLUTE_PULSES:
            self.motor.absolute(round(position * COUNTS_PER_TURN / PULSES_PER_TURN), now_s)
        else:
            self.motor.other()
