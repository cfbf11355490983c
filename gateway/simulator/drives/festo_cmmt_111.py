"""Festo CMMT-AS and CMMT-ST: PROFIdrive telegram 111 in Modbus TCP registers.

Source: Festo's own library festo-edcon 1.0.3 (PyPI) for the layout of telegram 111; the PROFIdrive profile of
PROFIBUS & PROFINET International, positioning mode, for the bits of STW1 and ZSW1.

A controller writes the whole output image every few milliseconds and reads the input image: only edges and
changes take effect. Simulated: traversing tasks (absolute, relative, continuous with POS_STW1 bit 12),
rejected and interrupted tasks (an intermediate stop is a pause: the axis completes the move when the bit
returns), reference run, reference point, device identification. Jog, records and speed runs, which MDI and
set-up of POS_STW1 distinguish from positions, are recorded. Not simulated: the watchdog of register 400, the
parameter mailbox.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, Order, bits_of
from gateway.simulator.server import ILLEGAL_VALUE, check

STW1: Final = 0
POS_STW1: Final = 1
POS_STW2: Final = 2
TARGET: Final = 5
IMAGE_WORDS: Final = 28
ZSW1: Final = 100
ACTUAL: Final = 105
FAULT_CODE: Final = 109
REGISTER_RANGES: Final = ((0, IMAGE_WORDS - 1), (ZSW1, ZSW1 + IMAGE_WORDS - 1), (400, 401), (500, 599))

ON_BITS: Final = 0x000F
NOT_REJECTED: Final = 1 << 4
NOT_INTERRUPTED: Final = 1 << 5
TASK: Final = 1 << 6
ACKNOWLEDGE_FAULT: Final = 1 << 7
JOG: Final = 1 << 8 | 1 << 9
REFERENCE: Final = 1 << 11
NEXT_RECORD: Final = 1 << 13
RUNNING: Final = ON_BITS | NOT_REJECTED | NOT_INTERRUPTED
ABSOLUTE: Final = 1 << 8
CONTINUOUS: Final = 1 << 12
SET_UP: Final = 1 << 14
MDI: Final = 1 << 15
REFERENCE_POINT: Final = 1 << 1

READ_IDENTIFICATION: Final = b"\x2b\x0e"
IDENTIFICATION: Final = (b"Festo", b"CMMT", b"1")


class FestoCmmt111(MotorDrive):
    """A simulated CMMT."""

    functions = frozenset({3, 6, 16, 43})
    register_ranges = REGISTER_RANGES
    order = Order.LOW_FIRST

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._handlers[43] = self._identify
        self._has_acknowledged = False
        self._interrupted_target: int | None = None
        """Target of the move that an intermediate stop has interrupted."""

    def _identify(self, pdu: bytes, _now_s: float) -> bytes:
        """Read device identification, basic objects (Modbus application protocol V1.1b3, 6.21)."""
        check(pdu[:2] == READ_IDENTIFICATION and len(pdu) == 4, ILLEGAL_VALUE)
        objects = b"".join(bytes((i, len(text))) + text for i, text in enumerate(IDENTIFICATION))
        return READ_IDENTIFICATION + bytes((pdu[2], 1, 0, 0, len(IDENTIFICATION))) + objects

    def show(self) -> None:
        motor = self.motor
        enabled = self.image.word(STW1) & ON_BITS == ON_BITS and not motor.has_alarm
        state = bits_of(
            b0=not motor.has_alarm,
            b1=enabled,
            b2=enabled,
            b3=motor.has_alarm,
            b9=True,
            b10=motor.is_done,
            b11=motor.is_homed,
            b12=self._has_acknowledged,
            b13=not motor.is_moving,
        )
        self.image.set_word(ZSW1, state)
        self.put32(ACTUAL, motor.actual_counts)
        self.image.set_word(FAULT_CODE, int(motor.has_alarm))

    def written(self, before: dict[int, int], now_s: float) -> None:
        if POS_STW2 in before and self.image.word(POS_STW2) & REFERENCE_POINT & ~before[POS_STW2]:
            self.motor.set_position(0, now_s)
        word = self.image.word(STW1)
        was = before.get(STW1, word)
        risen = word & ~was
        if not word & TASK:
            self._has_acknowledged = False
        if risen & ACKNOWLEDGE_FAULT:
            self.motor.mechanics.alarm = False
        lost = was & RUNNING & ~word
        if lost & ~NOT_INTERRUPTED:
            self._interrupted_target = None
        if was & RUNNING == RUNNING and lost:
            self._stop(lost, now_s)
        elif word & RUNNING == RUNNING:
            self._jog(was & JOG, word & JOG, now_s)
            self._run(before, risen, now_s)
            self._interrupted_target = None

    def _stop(self, lost: int, now_s: float) -> None:
        if lost == NOT_INTERRUPTED and self.motor.is_moving and not self.motor.is_homing:
            self._interrupted_target = self.motor.target_counts
        self.motor.stop(now_s)

    def _jog(self, was: int, bits: int, now_s: float) -> None:
        """Jog forward or reverse; both bits together do nothing."""
        was_jogging, is_jogging = was not in (0, JOG), bits not in (0, JOG)
        if is_jogging and bits != was:
            self.motor.other()
        elif was_jogging and not is_jogging:
            self.motor.stop(now_s)

    def _run(self, before: dict[int, int], risen: int, now_s: float) -> None:
        mode = self.image.word(POS_STW1)
        target = self.get32(TARGET)
        changed = any(before.get(a, self.image.word(a)) != self.image.word(a) for a in (TARGET, TARGET + 1))
        if risen & REFERENCE:
            self.motor.home(now_s)
        elif risen & NEXT_RECORD:
            self.motor.other()
        elif risen & TASK:
            self._has_acknowledged = True
            if not mode & MDI or mode & SET_UP:
                self.motor.other()
            elif mode & ABSOLUTE:
                self.motor.absolute(target, now_s)
            else:
                self.motor.relative(target, Basis.COMMANDED, now_s)
        elif mode & CONTINUOUS and changed:
            if mode & (MDI | SET_UP | ABSOLUTE) == MDI | ABSOLUTE:
                self.motor.absolute(target, now_s)
            else:
                self.unheard_of(POS_STW1, mode)
        elif self._interrupted_target is not None:
            self.motor.absolute(self._interrupted_target, now_s)
