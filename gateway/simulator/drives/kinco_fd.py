"""Kinco FD and CD servos.

Source: Kinco FD3 & CD3 manual, pages 122 to 123 (example frames, error replies), FD5P manual, pages 136 to
140 (control word, homing, object list).

Objects have fixed addresses with gaps between them; 32-bit numbers have the low word first. Simulated:
position mode with absolute and relative starts and with following (0x103F), homing, quick stop, zero by
writing the actual position, error replies with 0x81, 0x86 and 0x90. Not simulated: velocity and torque mode,
stored positions, limits.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.cia402 import POSITION_MODE, Drive402
from gateway.simulator.drives.motor_drive import Motor, Order, bits_of

CONTROL: Final = 0x3100
STATUS: Final = 0x3200
MODE: Final = 0x3500
ACTUAL: Final = 0x3700
TARGET: Final = 0x4000
FOLLOW: Final = 0x1000
OTHER_MODES: Final = frozenset({3, 4, 7, 0xFFFC, 0xFFFD})
"""Speed, torque, interpolated; pulses, immediate speed."""
OBJECTS: Final = (
    *(0x0C10, 0x0C20, 0x0C30, 0x0C40, 0x0CF0, 0x0D00, 0x0D10, 0x0D20, 0x0D30),
    *(CONTROL, STATUS, MODE, ACTUAL, TARGET),
    *(0x4100, 0x4410, 0x4420, 0x4A00, 0x4B00, 0x4C00, 0x4D00, 0x5010, 0x5020, 0x6F00),
)
REGISTER_RANGES: Final = tuple((address, address + 1) for address in OBJECTS)
ERROR_FUNCTIONS: Final = {3: 0x81, 6: 0x86, 16: 0x90}


class KincoFd(Drive402):
    """A simulated Kinco servo."""

    functions = frozenset({3, 6, 16})
    register_ranges = REGISTER_RANGES
    order = Order.LOW_FIRST
    steps = False
    mode_at = MODE
    target_at = TARGET

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.image.set_word(MODE, POSITION_MODE)

    def refusal(self, request: bytes, code: int) -> bytes | None:
        """Return an error reply, whose function byte for FC03 is 0x81."""
        return bytes((ERROR_FUNCTIONS.get(request[0], request[0] | 0x80), code))

    def show(self) -> None:
        motor = self.motor
        self.put32(ACTUAL, motor.actual_counts)
        enabled = self.control.is_enabled
        state = bits_of(
            b0=enabled,
            b1=enabled,
            b2=enabled,
            b3=motor.has_alarm,
            b10=motor.is_done,
            b12=self.control.has_acknowledged,
            b14=enabled,
            b15=motor.is_homed,
        )
        self.image.set_word(STATUS, state)

    def written(self, before: dict[int, int], now_s: float) -> None:
        if ACTUAL in before or ACTUAL + 1 in before:
            self.motor.set_position(self.get32(ACTUAL), now_s)
        started = CONTROL in before and self.command(self.image.word(CONTROL), now_s)
        follows = self.control.is_enabled and self.control.word & FOLLOW
        if follows and not started and {TARGET, TARGET + 1} & before.keys():
            self.motor.absolute(self.get32(TARGET), now_s)

    def number(self, index: int) -> int:
        return self.get32(index) if index == TARGET else self.image.word(index)

    def start_in(self, mode: int, now_s: float) -> None:
        if mode in OTHER_MODES:
            self.motor.other()
        else:
            self.unheard_of(MODE, mode)
