"""Leadshine servos with PR paths: EL7-RS, and the ELD2-RS, L7-RS, iSV2-RS and T6 families.

Source: EL7-RS user manual V2.0.1, and those of L7, T6 and ELD2, as published programs cite them. The block of
paths is that of the steppers; bits 6 and 7 of a mode are one field, the state stands elsewhere, and a wrong
check sum is not known to be answered.

The drive is commissioned: PR mode chosen (Pr0.01 = 6) and the servo switched on by an input, because programs
do not agree on the register that would do it (0x0401, 0x0405, 0x0409).
"""

from typing import Final

from gateway.simulator.drives.leadshine_pr import AUXILIARY, NOTHING, PATHS, LeadshinePr
from gateway.simulator.drives.motor_drive import Basis, bits_of

ALARM: Final = 0x0B03
STATE: Final = 0x0B05
CONTROL: Final = 0x0033
MONITORED: Final = (0x0B14, 0x0B16)
"""Commanded and measured position once more."""
REFERENCES: Final = 0x00C0
TO_COMMANDED: Final = 0x0040
TO_MOTOR: Final = 0x0080


class LeadshineEl7(LeadshinePr):
    """See the module."""

    auxiliaries = (AUXILIARY, CONTROL)
    harmless = frozenset({NOTHING, 0x1122})
    is_switched_by_bus = False

    def go(self, mode: int, target: int, now_s: float) -> None:
        """See :class:`LeadshinePr`."""
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
        """Stay silent."""
        return None

    def response_delay_s(self, baudrate: int) -> float:
        """Return 0: the delay of the servos is not published."""
        return 0.0

    def show_status(self) -> None:
        """See :class:`LeadshinePr`."""
        motor = self.motor
        for address in MONITORED:
            self.put32(address, motor.actual_counts)
        self.image.set_word(
            STATE,
            bits_of(
                b0=not motor.has_alarm,
                b1=not motor.has_alarm,
                b2=motor.has_alarm,
                b3=motor.is_homed,
                b4=motor.is_done,
            ),
        )
        self.image.set_word(ALARM, int(motor.has_alarm))
