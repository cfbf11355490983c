"""What drives of known makes share: a motor, a record of its moves, and 32-bit register pairs.

A motor moves, stops, homes and takes a zero, in the drive's own counts.
"""

from collections.abc import Callable, Sequence
from enum import Enum
from logging import getLogger
from typing import Final

from gateway.simulator.errors import SimulatorError
from gateway.simulator.ledger import MoveKind, MoveRecord
from gateway.simulator.mechanics import Mechanics
from gateway.simulator.server import RegisterServer

WORD: Final = 0x10000
LOG: Final = getLogger(__name__)
"""Without a handler it goes to stderr."""
HOMING_S: Final = 0.5
"""The shortest homing: off the switch and back onto it."""

Log = Callable[[str, MoveKind, int | None, int | None], None]
"""Takes the axis, the kind, the target and the distance."""


class Order(Enum):
    """Which word of a number comes first."""

    HIGH_FIRST = "high-first"
    LOW_FIRST = "low-first"


def signed(value: int, bits: int) -> int:
    """Return the lowest ``bits`` of a number as two's complement.

    >>> signed(0xFFFB, 16)
    -5
    """
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def bits_of(**flags: bool) -> int:
    """Return a word with the bits that are true: ``bits_of(b0=True, b6=False)``.

    >>> bits_of(b0=True, b6=False, b5=True)
    33
    """
    return sum(1 << int(name[1:]) for name, is_set in flags.items() if is_set)


class Basis(Enum):
    """The base of a relative move."""

    TARGET = "target"
    COMMANDED = "commanded"
    ACTUAL = "actual"


class Motor:
    """One motor under its drive's control.

    It starts on its reference switch. Homing returns it there, and restores the counts of that position.
    Speeds and ramps are the machine's, not those in the drive's registers.
    """

    def __init__(self, name: str, mechanics: Mechanics) -> None:
        self.name = name
        self.mechanics = mechanics
        self.log: Log = lambda _axis, _kind, _target, _distance: None
        self._home_mm = mechanics.motor_mm
        self._home_counts = mechanics.target_counts
        self._homing_until_s: float | None = None

    @property
    def actual_counts(self) -> int:
        """Measured position. The motor follows its profile without lag, so it is also the commanded one."""
        return round(self.mechanics.actual_counts)

    @property
    def target_counts(self) -> int:
        """Target of the last move."""
        return round(self.mechanics.target_counts)

    @property
    def is_homing(self) -> bool:
        """Whether a homing is running."""
        return self._homing_until_s is not None

    @property
    def is_moving(self) -> bool:
        """Whether a move or a homing is running."""
        return self.mechanics.is_moving or self.is_homing

    @property
    def is_done(self) -> bool:
        """Whether the axis is at standstill at its last target."""
        return not self.is_moving and not self.has_alarm

    @property
    def is_homed(self) -> bool:
        """Whether the counts are referenced."""
        return self.mechanics.homed

    @property
    def has_alarm(self) -> bool:
        """Whether the drive has an alarm."""
        return self.mechanics.alarm

    def advance(self, now_s: float) -> None:
        """Advance to ``now_s``."""
        self.mechanics.advance(now_s)
        if self._homing_until_s is None or self.mechanics.is_moving or now_s < self._homing_until_s:
            return
        self._homing_until_s = None
        self.mechanics.redefine(self._home_counts)
        self.mechanics.homed = True

    def absolute(self, target_counts: int, now_s: float) -> bool:
        """Start an absolute move. Return whether it started; with an alarm it does not."""
        return self._move(MoveKind.ABSOLUTE, target_counts, None, now_s)

    def relative(self, distance_counts: int, basis: Basis, now_s: float) -> bool:
        """Start a relative move. Return whether it started."""
        self.advance(now_s)
        start = self.target_counts if basis is Basis.TARGET else self.actual_counts
        return self._move(MoveKind.RELATIVE, start + distance_counts, distance_counts, now_s)

    def stop(self, now_s: float) -> None:
        """Brake; a homing is aborted and leaves the axis unreferenced."""
        self.advance(now_s)
        self._homing_until_s = None
        self.mechanics.stop(now_s)
        self.log(self.name, MoveKind.STOP, self.target_counts, None)

    def home(self, now_s: float) -> bool:
        """Start a homing. Return whether it started."""
        self.advance(now_s)
        if self.has_alarm:
            return False
        self.mechanics.homed = False
        self._homing_until_s = now_s + HOMING_S
        self.mechanics.command(self.mechanics.encoder.counts(self._home_mm), now_s)
        self.log(self.name, MoveKind.HOME, None, None)
        return True

    def set_position(self, counts: int, now_s: float) -> None:
        """Set the present position to ``counts``."""
        self.advance(now_s)
        self.mechanics.redefine(counts)
        self.log(self.name, MoveKind.SET_POSITION, counts, None)

    def other(self) -> None:
        """Record a command that would turn the motor and is not simulated."""
        self.log(self.name, MoveKind.OTHER, None, None)

    def _move(self, kind: MoveKind, target_counts: int, distance_counts: int | None, now_s: float) -> bool:
        self.advance(now_s)
        if self.has_alarm:
            return False
        self._homing_until_s = None
        self.mechanics.command(target_counts, now_s)
        self.log(self.name, kind, target_counts, distance_counts)
        return True


class MotorDrive(RegisterServer):
    """A drive with its own registers and (nearly always) one motor.

    ``order`` is that of its 32-bit numbers.
    """

    order = Order.HIGH_FIRST
    most_motors = 1
    register_ranges: Sequence[tuple[int, int]] = ((0, 0xFFFF),)
    """The first and the last register of each range of the drive."""

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        """Raise SimulatorError if there are more motors than the drive has outputs for."""
        super().__init__(unit_id)
        if not 1 <= len(motors) <= self.most_motors:
            raise SimulatorError(
                f"unit {unit_id}: give each axis its own unit id: this drive moves {self.most_motors} "
                f"axis, but {len(motors)} axes of the configuration have its unit id"
            )
        self.axes: tuple[Motor, ...] = tuple(motors)
        self.motor = self.axes[0]
        self._now_s = 0.0
        for motor in self.axes:
            motor.log = self._log

    def _log(self, axis: str, kind: MoveKind, target: int | None, distance: int | None) -> None:
        self.ledger.moves.append(MoveRecord(self.unit_id, axis, kind, target, self._now_s, distance))

    def unheard_of(self, address: int, value: int) -> None:
        """Record and log a command that this simulated drive does not know; it has no effect."""
        text = f"unit {self.unit_id}: this simulated drive does not know {value:#06x} in {address:#06x}"
        self.ledger.unheard_of.append(text)
        LOG.warning(text)

    def get32(self, address: int) -> int:
        """Return a signed number from two registers."""
        first, second = self.image.word(address), self.image.word(address + 1)
        if self.order is Order.LOW_FIRST:
            first, second = second, first
        return signed(first << 16 | second, 32)

    def put32(self, address: int, value: int) -> None:
        """Write a signed number to two registers; a larger one wraps round like a counter."""
        high, low = value >> 16, value
        if self.order is Order.LOW_FIRST:
            high, low = low, high
        self.image.set_word(address, high)
        self.image.set_word(address + 1, low)

    def has(self, address: int, count: int) -> bool:
        return within(address, count, self.register_ranges)

    def refresh(self, now_s: float) -> None:
        self._now_s = now_s
        for motor in self.axes:
            motor.advance(now_s)
        self.show()

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Store the registers, then handle the whole frame; the results are visible immediately."""
        before = {address + i: self.image.word(address + i) for i in range(len(data) // 2)}
        self.image.store_words(address, data)
        self.written(before, now_s)
        self.show()

    def show(self) -> None:
        """Write positions and states to the registers; every motor is up to date."""

    def written(self, before: dict[int, int], now_s: float) -> None:
        """Handle a frame: ``before`` has its registers' old values, the image has the new ones."""


def within(address: int, count: int, ranges: Sequence[tuple[int, int]]) -> bool:
    """Whether all registers are in one of the ranges, each given by its first and last register."""
    return any(first <= address and address + count - 1 <= last for first, last in ranges)
