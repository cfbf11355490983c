"""Oriental Motor BLV-R (BLVD-KRD, BLVD-KBRD).

Source: Oriental Motor HP-5142 (BLV-R function manual): direct data operation, Modbus RTU.

As the AZ series, and: S-ON must be set, function code 23, the trigger is the lower half of its pair (the
upper half is a lifetime in ms, which is not simulated), the trigger clears itself unless 0x0228 is 0.
Not simulated: wrap operation (types 8 to 15) and group addresses with ID share.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from gateway.simulator.drives.endpoint import bits_of
from gateway.simulator.drives.motor import Basis, Motor
from gateway.simulator.drives.oriental_az import INPUT, OUTPUT, STOP, TRIGGER, OrientalAz, trigger_of_low_word

S_ON: Final = 1 << 0
TRIGGER_CLEARS: Final = 0x0228
NEVER: Final = 0
RELATIVE_TYPES: Final[Mapping[int, Basis]] = {
    2: Basis.COMMANDED,
    3: Basis.ACTUAL,
    4: Basis.TARGET,
    21: Basis.COMMANDED,
    22: Basis.ACTUAL,
    23: Basis.TARGET,
}


class OrientalBlvR(OrientalAz):
    """See the module."""

    functions = frozenset({3, 6, 8, 16, 23})
    absolute = frozenset({1, 7, 20})
    relative = RELATIVE_TYPES
    continuous = frozenset({16, 48})

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.put32(TRIGGER_CLEARS, 1)

    @property
    def is_excited(self) -> bool:
        """See :class:`OrientalAz`."""
        return bool(self.image.word(INPUT) & S_ON) and super().is_excited

    def trigger(self) -> int:
        """See :class:`OrientalAz`."""
        return trigger_of_low_word(self.image.word(TRIGGER + 1))

    def written(self, before: dict[int, int], now_s: float) -> None:
        """See :class:`MotorDrive`."""
        repeated = before.get(TRIGGER + 1) == self.image.word(TRIGGER + 1) != NEVER
        if repeated and not self.get32(TRIGGER_CLEARS):
            before = {address: word for address, word in before.items() if address != TRIGGER + 1}
        super().written(before, now_s)

    def consume_trigger(self, before: dict[int, int]) -> None:
        """See :class:`OrientalAz`."""
        if self.get32(TRIGGER_CLEARS):
            super().consume_trigger(before)

    def show_outputs(self) -> None:
        """See :class:`OrientalAz`."""
        motor = self.motor
        state = bits_of(
            b0=self.is_excited,
            b3=self.is_excited and motor.is_done,
            b4=motor.is_homed,
            b5=bool(self.image.word(INPUT) & STOP),
            b7=motor.has_alarm,
            b8=self.is_busy,
            b9=motor.is_done,
            b13=motor.is_moving,
        )
        self.image.set_word(OUTPUT, state)
