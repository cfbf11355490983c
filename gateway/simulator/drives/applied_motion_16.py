"""Applied Motion and MOONS' drives with the 16-bit map: TSM, STM, SSM, STAC, ST-Q, M2DC.

Source: Applied Motion Products, Host Command Reference, appendix on Modbus (register map, opcodes of 40125),
which numbers registers from 40001.

The opcode decides what the number in DI means. Not simulated: jog, stored programs (both are noted), word
order by parameter, a second axis at +1000, writes that start motion in control mode 21.
"""

from typing import Final

from gateway.simulator.drives.endpoint import MotorDrive, bits_of, within
from gateway.simulator.drives.motor import Basis

ALARM: Final = 0
STATUS: Final = 1
ENCODER: Final = 4
COMMANDED: Final = 6
"""Immediate absolute position (IP)."""
DISTANCE: Final = 30
OPCODE: Final = 124
PARAMETERS: Final = 125
KNOWN: Final = ((0, 199),)

FEED_RELATIVE: Final = 0x66
FEED_ABSOLUTE: Final = 0x67
SEEK_HOME: Final = 0x6E
QUEUE_EXECUTE: Final = 0x78
JOG: Final = 0x96
SET_ENCODER: Final = 0x98
DISABLE: Final = 0x9E
ENABLE: Final = 0x9F
SET_POSITION: Final = 0xA5
RESET_ALARM: Final = 0xBA
STOPS: Final = frozenset({0xD8, 0xE1, 0xE2})
"""Stop jogging; stop and kill the buffer, hard and with the deceleration DE."""


class AppliedMotion16(MotorDrive):
    """See the module."""

    functions = frozenset({3, 6, 16})
    distance = DISTANCE
    positions: tuple[int, ...] = (ENCODER, COMMANDED)
    known = KNOWN

    is_enabled = True

    def has(self, address: int, count: int) -> bool:
        """See :class:`RegisterServer`."""
        return within(address, count, self.known)

    def show(self) -> None:
        """See :class:`MotorDrive`."""
        for address in self.positions:
            self.put32(address, self.motor.actual_counts)
        self.show_status(self.status())

    def status(self) -> int:
        """Return the status code (command SC of the Host Command Reference)."""
        motor = self.motor
        return bits_of(
            b0=self.is_enabled,
            b2=motor.has_alarm,
            b3=motor.is_done,
            b4=motor.is_moving,
            b9=motor.has_alarm,
            b10=motor.is_homing,
        )

    def show_status(self, status: int) -> None:
        """Put the status where this map has it."""
        self.image.set_word(ALARM, int(self.motor.has_alarm))
        self.image.set_word(STATUS, status)

    def written(self, before: dict[int, int], now_s: float) -> None:
        """See :class:`MotorDrive`."""
        if OPCODE in before:
            self._execute(self.image.word(OPCODE), now_s)

    def _execute(self, opcode: int, now_s: float) -> None:
        motor = self.motor
        if opcode in STOPS:
            motor.stop(now_s)
        elif opcode in {ENABLE, DISABLE}:
            self.is_enabled = opcode == ENABLE
        elif opcode == RESET_ALARM:
            motor.mechanics.alarm = False
        elif opcode in {SET_POSITION, SET_ENCODER}:
            motor.set_position(self.get32(PARAMETERS), now_s)
        elif self.is_enabled:
            self._move(opcode, now_s)

    def _move(self, opcode: int, now_s: float) -> None:
        motor = self.motor
        if opcode == FEED_ABSOLUTE:
            motor.absolute(self.get32(self.distance), now_s)
        elif opcode == FEED_RELATIVE:
            motor.relative(self.get32(self.distance), Basis.COMMANDED, now_s)
        elif opcode == SEEK_HOME:
            motor.home(now_s)
        elif opcode in {JOG, QUEUE_EXECUTE}:
            motor.other()
        else:
            self.unheard_of(OPCODE, opcode)
