"""A drive that knows its zero only after it was homed: a reboot makes it forget."""

import random
from dataclasses import replace
from typing import Final

from gateway.drives.motion import Action
from gateway.drives.motion import Operation as Deed
from gateway.exchange.plan import HOMED_BIT, AxisPlan, Reference
from gateway.modbus.registers import BitField
from tests.ledger.drives import Drive, Motor, Operation
from tests.ledger.layouts import Layout
from tests.ledger.screws import TRAVEL_MM
from tests.year.machine import Machine

HOME: Final = 400
"""Value of the trigger register."""
HOMED: Final = 6
"""Its bit in the status word."""
LENGTH_MM: Final = 4.0
"""Of a homing."""


class HomedDrive(Drive):
    """Homed at first."""

    def __init__(self, machine: Machine, layout: Layout, position: int, speed_mm_s: float) -> None:
        super().__init__(layout, position, speed_mm_s)
        self._machine, self._speed_mm_s = machine, speed_mm_s
        self._ahead = self._homings = 0
        """Counts that it shows beyond the true ones."""
        self.is_homed = True
        self.lost_ns = 0
        """When it lost its zero."""

    def reboot(self, rng: random.Random) -> None:
        """Stop, and count from anywhere."""
        self.is_homed, self.lost_ns = False, self._machine.now_ns
        self._homings += 1
        self._count_from(rng.randrange(-200, 200))

    def shift(self, counts: int) -> None:
        """Count from another zero, without a word."""
        self._count_from(self.motor.at(self._machine.now_ns) + counts)

    def home(self) -> Operation:
        """Go a little way towards the middle; there is the zero."""
        now_ns = self._machine.now_ns
        was_at, was_moving, before = self.motor.at(now_ns), self.motor.is_moving(now_ns), self.motor.end
        if self.is_homed:
            self.is_homed, self.lost_ns = False, now_ns
        self._homings += 1
        way = round(LENGTH_MM * self.layout.counts_per_unit)
        end = was_at + (way if self.layout.machine_mm(was_at - self._ahead) < TRAVEL_MM / 2 else -way)
        self._go(end, now_ns)
        self._machine.at(self.motor.arrives_ns, self._found, self._homings)
        return Operation("home", was_at, was_moving, was_at, end, before)

    def _found(self, homing: int) -> None:
        if homing == self._homings:
            self._count_from(self.motor.at(self._machine.now_ns) - self._ahead)
            self._ahead, self.is_homed = 0, True

    def _count_from(self, counts: int) -> None:
        at = self.motor.at(self._machine.now_ns)
        self._ahead += counts - at
        self.motor = Motor(counts, self._speed_mm_s * abs(self.layout.counts_per_unit))

    def _read(self, address: int, now_ns: int) -> int:
        return super()._read(address, now_ns) | (
            self.is_homed << HOMED if address == self.layout.status else 0
        )

    def _act_on_trigger(self, value: int, now_ns: int) -> list[Operation]:
        if value == HOME:
            return [self.home()]
        operations = super()._act_on_trigger(value, now_ns)
        self._homings += bool(operations)  # whatever else it does aborts a homing
        return operations


def with_homing(plan: AxisPlan, reference: Reference) -> AxisPlan:
    """Return the plan of such a drive."""
    deeds = {HOME: Deed(Action.HOME)}
    triggers = tuple(replace(each, deeds={**each.deeds, **deeds}) for each in plan.motion.triggers)
    return replace(
        plan,
        referenced=reference,
        motion=replace(plan.motion, triggers=triggers),
        bits={**plan.bits, HOMED_BIT: BitField(plan.bits["done"].address, HOMED)},
    )
