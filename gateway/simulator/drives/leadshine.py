"""Leadshine drives with PR paths: steppers (CS2RS, iCL-RS, EM2RS / DM-RS, also of StepperOnline) and servos.

Source: user manuals of the iCL-RS and CS2RS series (registers of Pr8 and Pr9, chapter on communication); for
the servos EL7-RS user manual V2.0.1, and those of L7, T6 and ELD2, as published programs cite them.

Simulated: 16 paths, one-frame moves, homing, zero, quick stop, proxies 0x0F00 to 0x0F09, the save status that
clears when read, the answer to a wrong CRC. Not simulated: jumps from path to path, interruption rules of
paths (a new one always interrupts), speeds, jog, enforcement of the software limits.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, bits_of
from gateway.times import NS_PER_MS, NS_PER_S

PROXIES: Final = 0x0F00
PROXY_TARGETS: Final = 0x0F10
PROXY_COUNT: Final = 10
STATUS: Final = 0x1003
FOLLOWING_ERROR: Final = 0x1010
COMMANDED_MIRROR: Final = 0x1012
ACTUAL_MIRROR: Final = 0x1014
AUXILIARY: Final = 0x1801
RESET_ALARM: Final = 0x1111
SAVE: Final = 0x2211
JOGS: Final = (0x4001, 0x4002)
SAVE_STATUS: Final = 0x1901
SAVED: Final = 0x5555
ALARM: Final = 0x2203
TRIGGER: Final = 0x6002
COMMANDED: Final = 0x602A
ACTUAL: Final = 0x602C
PATHS: Final = 0x6200
PATH_STRIDE: Final = 8
PATH_COUNT: Final = 16
TRIGGER_ALIAS: Final = 0x6207
"""The last register of path 0 is the trigger, so that one frame holds a whole move."""

RUN_PATH: Final = 0x0010
RUNNING_PATH: Final = 0x0100
HOME: Final = 0x0020
SET_ZERO: Final = 0x0021
QUICK_STOP: Final = 0x0040

KIND_MASK: Final = 0x000F
POSITION: Final = 1
VELOCITY: Final = 2
HOMING: Final = 3
IS_RELATIVE: Final = 0x0040
UNSAID: Final = 0x0080
"""The steppers' manuals do not describe this bit of the mode."""
NOTHING: Final = 0
MOTOR_ON: Final = 0x000F
"""Of the closed-loop models: 0 de-energises the motor while the enabling input is off."""

REGISTER_RANGES: Final = ((0x0000, 0x0FFF), (0x1000, 0x2FFF), (0x6000, 0x6FFF))
SERVO_ALARM: Final = 0x0B03
SERVO_STATE: Final = 0x0B05
SERVO_CONTROL: Final = 0x0033
SERVO_MONITORED: Final = (0x0B14, 0x0B16)
"""Commanded and measured position, a second time."""
REFERENCES: Final = 0x00C0
TO_COMMANDED: Final = 0x0040
TO_MOTOR: Final = 0x0080

TURNAROUND_MS: Final = {9600: 24.9, 19200: 13.34, 38400: 7.12, 115200: 3.08}
"""From the first bit of a two-register read to the last one of its reply."""
READ_CHARACTERS: Final = 8 + 9
BITS_PER_CHARACTER: Final = 10
WRONG_CRC: Final = 8


class LeadshinePr(MotorDrive):
    """Steppers: CS2RS, iCL-RS, EM2RS / DM-RS."""

    functions = frozenset({3, 6, 16})
    register_ranges = REGISTER_RANGES
    auxiliaries: tuple[int, ...] = (AUXILIARY,)
    """Registers of the control word."""
    harmless = frozenset({NOTHING, 0x2244})
    """Values of the control word without effect on the motor, besides those that are simulated."""
    is_switched_by_bus = True
    """Whether 0x000F switches the motor on and off."""
    max_read = 97
    """Messages have at most 200 bytes: 5 of them are not data in the reply to a read …"""
    max_write = 95
    """… and 9 in a write."""

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._path: int | None = None

    def bad_crc_reply(self, function: int) -> bytes | None:
        """Answer the frame; no other drive does."""
        return bytes((function | 0x80, WRONG_CRC))

    def response_delay_s(self, baudrate: int) -> float:
        """Return the manual's total time without the characters themselves."""
        if baudrate not in TURNAROUND_MS:
            return 0.0
        wire_ns = READ_CHARACTERS * BITS_PER_CHARACTER * NS_PER_S / baudrate
        return max(0.0, TURNAROUND_MS[baudrate] * NS_PER_MS - wire_ns) / NS_PER_S

    def show(self) -> None:
        motor = self.motor
        for address in (COMMANDED, COMMANDED_MIRROR, ACTUAL, ACTUAL_MIRROR):
            self.put32(address, motor.actual_counts)
        self.put32(FOLLOWING_ERROR, 0)
        self.show_status()
        if self._path is not None and not motor.is_moving:
            self._show_trigger(self._path)
            self._path = None
        elif not motor.is_moving and self.image.word(TRIGGER) in {HOME, QUICK_STOP}:
            self._show_trigger(0)

    def show_status(self) -> None:
        """Write the state to this series' registers."""
        motor = self.motor
        self.image.set_word(
            STATUS,
            bits_of(
                b0=motor.has_alarm,
                b1=not motor.has_alarm,
                b2=motor.is_moving,
                b4=motor.is_done,
                b5=motor.is_done,
                b6=motor.is_homed,
            ),
        )
        self.image.set_word(ALARM, int(motor.has_alarm))

    def read_words(self, address: int, count: int) -> bytes:
        for proxy in range(PROXIES, PROXIES + PROXY_COUNT):
            self.image.set_word(proxy, self.image.word(self._target_of(proxy)))
        words = super().read_words(address, count)
        if address <= SAVE_STATUS < address + count:
            self.image.set_word(SAVE_STATUS, 0)
        return words

    def written(self, before: dict[int, int], now_s: float) -> None:
        for proxy in range(PROXIES, PROXIES + PROXY_COUNT):
            if proxy in before and self._target_of(proxy):
                self.write_words(self._target_of(proxy), self.image.words(proxy, 1), now_s)
        for address in self.auxiliaries:
            if address in before:
                self._auxiliary(address, self.image.word(address))
        if self.is_switched_by_bus and MOTOR_ON in before and not self.image.word(MOTOR_ON):
            self.motor.stop(now_s)
        for address in (TRIGGER, TRIGGER_ALIAS):
            if address in before:
                self._trigger(self.image.word(address), now_s)

    def _target_of(self, proxy: int) -> int:
        return self.image.word(PROXY_TARGETS + proxy - PROXIES)

    def _auxiliary(self, address: int, command: int) -> None:
        if command == RESET_ALARM:
            self.motor.mechanics.alarm = False
        elif command == SAVE:
            self.image.set_word(SAVE_STATUS, SAVED)
        elif command in JOGS:
            self.motor.other()
        elif command not in self.harmless:
            self.unheard_of(address, command)

    def _trigger(self, value: int, now_s: float) -> None:
        if RUN_PATH <= value < RUN_PATH + PATH_COUNT:
            self._run(value - RUN_PATH, now_s)
        elif value == HOME:
            self._path = None
            self.motor.home(now_s)
            self._show_trigger(HOME)
        elif value == SET_ZERO:
            self.motor.set_position(0, now_s)
            self._show_trigger(0)
        elif value == QUICK_STOP:
            self._path = None
            self.motor.stop(now_s)
            self._show_trigger(QUICK_STOP)
        elif value != NOTHING:
            self.unheard_of(TRIGGER, value)

    def _run(self, path: int, now_s: float) -> None:
        mode = self.image.word(PATHS + PATH_STRIDE * path)
        target = self.get32(PATHS + PATH_STRIDE * path + 1)
        match mode & KIND_MASK:
            case kind if kind == POSITION:
                self.go(mode, target, now_s)
            case kind if kind == VELOCITY:
                self.motor.other()
            case kind if kind == HOMING:
                self.motor.home(now_s)
            case _:
                self.unheard_of(PATHS + PATH_STRIDE * path, mode)
                return
        self._path = path
        self._show_trigger(RUNNING_PATH | path)

    def go(self, mode: int, target: int, now_s: float) -> None:
        """Start an absolute or relative move, as the mode of its path says."""
        if mode & UNSAID:
            self.unheard_of(PATHS, mode)
        elif mode & IS_RELATIVE:
            self.motor.relative(target, Basis.COMMANDED, now_s)
        else:
            self.motor.absolute(target, now_s)

    def _show_trigger(self, value: int) -> None:
        self.image.set_word(TRIGGER, value)
        self.image.set_word(TRIGGER_ALIAS, value)


class LeadshineEl7(LeadshinePr):
    """Servos: EL7-RS, and the ELD2-RS, L7-RS, iSV2-RS and T6 families.

    The block of paths is that of the steppers. Bits 6 and 7 of a mode are one field, the state has other
    registers, and an answer to a wrong CRC is not known. The drive is commissioned: PR mode chosen (Pr0.01 =
    6) and the servo switched on by an input, because programs do not agree on the register for it (0x0401,
    0x0405, 0x0409).
    """

    auxiliaries = (AUXILIARY, SERVO_CONTROL)
    harmless = frozenset({NOTHING, 0x1122})
    is_switched_by_bus = False

    def go(self, mode: int, target: int, now_s: float) -> None:
        match mode & REFERENCES:
            case 0:
                self.motor.absolute(target, now_s)
            case reference if reference == TO_COMMANDED:
                self.motor.relative(target, Basis.COMMANDED, now_s)
            case reference if reference == TO_MOTOR:
                self.motor.relative(target, Basis.ACTUAL, now_s)
            case _:
                self.unheard_of(PATHS, mode)

    def bad_crc_reply(self, function: int) -> bytes | None:
        """Do not answer."""
        return None

    def response_delay_s(self, baudrate: int) -> float:
        """Return 0: the delay of the servos is not published."""
        return 0.0

    def show_status(self) -> None:
        motor = self.motor
        for address in SERVO_MONITORED:
            self.put32(address, motor.actual_counts)
        self.image.set_word(
            SERVO_STATE,
            bits_of(
                b0=not motor.has_alarm,
                b1=not motor.has_alarm,
                b2=motor.has_alarm,
                b3=motor.is_homed,
                b4=motor.is_done,
            ),
        )
        self.image.set_word(SERVO_ALARM, int(motor.has_alarm))
