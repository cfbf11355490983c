"""StepperOnline ESS23-RS10 and RS20 integrated steppers.

Source: StepperOnline, Modbus Series Bus Product Function Manual V1.0, pages 68 to 79, and a published bench
test of firmware 0x0029 (github.com/janhavelka/ESS23-RS).

Not simulated: homing (not in the sources), segments started by inputs, speeds, limits.
"""

from typing import Final

from gateway.simulator.drives.endpoint import MotorDrive, Order, within
from gateway.simulator.drives.motor import Basis

ALARM: Final = 0x0006
MOTION: Final = 0x0007
POSITION: Final = 0x000A
WORD_ORDER: Final = 0x0019
TARGET: Final = 0x0024
TRIGGER: Final = 0x0027
RELATIVE: Final = 0x0001
ABSOLUTE: Final = 0x0005
STOPS: Final = frozenset({0x0100, 0x0200})
KNOWN: Final = ((0x0000, 0x00BF),)


class StepperonlineEssRs(MotorDrive):
    """See the module."""

    functions = frozenset({3, 6, 16})
    max_read = 16

    def has(self, address: int, count: int) -> bool:
        """See :class:`RegisterServer`."""
        return within(address, count, KNOWN)

    def show(self) -> None:
        """See :class:`MotorDrive`. The trigger can only be written."""
        self.order = Order.LOW_FIRST if self.image.word(WORD_ORDER) else Order.HIGH_FIRST
        self.put32(POSITION, self.motor.actual_counts)
        self.image.set_word(ALARM, int(self.motor.has_alarm))
        self.image.set_word(MOTION, int(self.motor.is_moving))
        self.image.set_word(TRIGGER, 0)

    def written(self, before: dict[int, int], now_s: float) -> None:
        """See :class:`MotorDrive`."""
        if TRIGGER not in before:
            return
        value = self.image.word(TRIGGER)
        if value == ABSOLUTE:
            self.motor.absolute(self.get32(TARGET), now_s)
        elif value == RELATIVE:
            self.motor.relative(self.get32(TARGET), Basis.COMMANDED, now_s)
        elif value in STOPS:
            self.motor.stop(now_s)
