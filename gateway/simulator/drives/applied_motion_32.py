"""Applied Motion and MOONS' drives with the 32-bit map: MDX+, MDXT, MBDV.

Source: Applied Motion Products, MDX+ series Modbus register map (registers from 40001). As the 16-bit map,
but nearly every register is a pair.
"""

from typing import Final

from gateway.simulator.drives.applied_motion_16 import AppliedMotion16

ALARM: Final = 0
STATUS: Final = 2
IMMEDIATE_POSITION: Final = 6
ENCODER: Final = 10
JOG_SPEED: Final = 342
DISTANCE: Final = 350
KNOWN: Final = ((0, 511),)


class AppliedMotion32(AppliedMotion16):
    """See the module."""

    distance = DISTANCE
    positions = (IMMEDIATE_POSITION, ENCODER)
    known = KNOWN

    def written(self, before: dict[int, int], now_s: float) -> None:
        """See :class:`AppliedMotion16`; the speed acts while it jogs, and 0 lets it stand."""
        if JOG_SPEED + 1 in before and self.get32(JOG_SPEED) == 0:
            self.motor.stop(now_s)
        super().written(before, now_s)

    def show_status(self, status: int) -> None:
        """See :class:`AppliedMotion16`."""
        self.put32(ALARM, int(self.motor.has_alarm))
        self.put32(STATUS, status)
