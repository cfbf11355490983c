"""Applied Motion and MOONS' drives, with the 16-bit map (TSM, STM, SSM, STAC, ST-Q, M2DC) and the 32-bit one.

Source: Applied Motion Products, Host Command Reference, appendix on Modbus (register map, opcodes of 40125),
which numbers registers from 40001; MDX+ series Modbus register map. The 32-bit map (MDX+, MDXT, MBDV) is like
the other, but nearly every register is a pair.

The opcode decides the meaning of the number in DI. Not simulated: jog, feeds to a sensor, stored programs
(all are recorded), word order by parameter, a second axis at +1000, writes that start motion in control modes
10 and 21.
"""

from typing import Final

from gateway.simulator.drives.motor_drive import Basis, MotorDrive, bits_of

ALARM: Final = 0
STATUS: Final = 1
ENCODER: Final = 4
COMMANDED: Final = 6
"""Immediate absolute position (IP)."""
DISTANCE: Final = 30
OPCODE: Final = 124
PARAMETERS: Final = 125
WIDE_STATUS: Final = 2
"""In the 32-bit map, as the next four; the alarm is at 0 in both maps."""
WIDE_COMMANDED: Final = 6
WIDE_ENCODER: Final = 10
WIDE_JOG_SPEED: Final = 342
WIDE_DISTANCE: Final = 350

FEED_RELATIVE: Final = 0x66
FEED_ABSOLUTE: Final = 0x67
SENSOR_MOVES: Final = frozenset({0x68, 0x69, 0x6A, 0x6B, 0x6C, 0x6D})
SEEK_HOME: Final = 0x6E
FIND_HOME: Final = 0xDB
QUEUE_EXECUTE: Final = 0x78
JOG: Final = 0x96
JOGS_BY_INPUTS: Final = frozenset({0xA2, 0xA3})
FOLLOW_ENCODER: Final = 0xCC
HARMLESS: Final = frozenset({0x06, 0x42, 0x46, 0x47, 0x54, 0x6F, 0x70, 0x8B, 0xC0, 0xD1, 0xD2, 0xD3, 0xD6})
"""They set filters and outputs, read inputs, wait."""
SET_ENCODER: Final = 0x98
DISABLE: Final = 0x9E
ENABLE: Final = 0x9F
SET_POSITION: Final = 0xA5
RESET_ALARM: Final = 0xBA
STOPS: Final = frozenset({0xD8, 0xE1, 0xE2})
"""Stop jogging; stop and kill the buffer, hard and with the deceleration DE."""


class AppliedMotion16(MotorDrive):
    """The 16-bit map: TSM, STM, SSM, STAC, ST-Q, M2DC."""

    functions = frozenset({3, 6, 16})
    distance = DISTANCE
    positions: tuple[int, ...] = (ENCODER, COMMANDED)
    register_ranges = ((0, 199),)

    is_enabled = True

    def show(self) -> None:
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
        """Write the status to this map's registers."""
        self.image.set_word(ALARM, int(self.motor.has_alarm))
        self.image.set_word(STATUS, status)

    def written(self, before: dict[int, int], now_s: float) -> None:
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
        elif opcode in {SEEK_HOME, FIND_HOME}:
            motor.home(now_s)
        elif opcode in {JOG, QUEUE_EXECUTE, FOLLOW_ENCODER} | JOGS_BY_INPUTS | SENSOR_MOVES:
            motor.other()
        elif opcode not in HARMLESS:
            self.unheard_of(OPCODE, opcode)


class AppliedMotion32(AppliedMotion16):
    """The 32-bit map: MDX+, MDXT, MBDV."""

    distance = WIDE_DISTANCE
    positions = (WIDE_COMMANDED, WIDE_ENCODER)
    register_ranges = ((0, 511),)

    def written(self, before: dict[int, int], now_s: float) -> None:
        """The speed takes effect during a jog; 0 stops it."""
        if WIDE_JOG_SPEED + 1 in before and self.get32(WIDE_JOG_SPEED) == 0:
            self.motor.stop(now_s)
        super().written(before, now_s)

    def show_status(self, status: int) -> None:
        self.put32(ALARM, int(self.motor.has_alarm))
        self.put32(WIDE_STATUS, status)
