"""Leadshine servos with PR paths: EL7-RS, and the iSV2-RS and T6 families with the same block of paths.

Source: EL7-RS user manual V2.0.1 as published programs cite it. The block of paths is that of the steppers;
the state stands elsewhere, and a wrong check sum is not known to be answered.

The drive is commissioned: PR mode chosen (Pr0.01 = 6) and the servo switched on by an input, because programs
do not agree on the register that would do it (0x0401, 0x0405, 0x0409). The state word 0x0B05 is simulated as
bits, as one of two readings of the manual has it.
"""

from typing import Final

from gateway.simulator.drives.endpoint import bits_of
from gateway.simulator.drives.leadshine_pr import LeadshinePr

ALARM: Final = 0x0B03
STATE: Final = 0x0B05


class LeadshineEl7(LeadshinePr):
    """See the module."""

    def bad_crc_reply(self, function: int) -> bytes | None:
        """Stay silent."""
        return None

    def response_delay_s(self, baudrate: int) -> float:
        """Return 0: the delay of the servos is not published."""
        return 0.0

    def show_status(self) -> None:
        """See :class:`LeadshinePr`."""
        motor = self.motor
        self.image.set_word(
            STATE,
            bits_of(
                b0=not motor.has_alarm,
                b1=motor.is_moving,
                b2=motor.has_alarm,
                b3=motor.is_homed,
                b4=motor.is_done,
            ),
        )
        self.image.set_word(ALARM, int(motor.has_alarm))
