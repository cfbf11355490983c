"""What the drives of known makes share: motors, a record of what they did, numbers of two registers."""

from collections.abc import Sequence
from enum import Enum
from logging import getLogger
from typing import Final

from gateway.simulator.drives.motor import Motor
from gateway.simulator.errors import SimulatorError
from gateway.simulator.ledger import MoveKind, MoveRecord
from gateway.simulator.server import RegisterServer

WORD: Final = 0x10000
LOG: Final = getLogger(__name__)
"""Without a handler it goes to stderr."""


class Order(Enum):
    """Which word of a number comes first."""

    HIGH_FIRST = "high-first"
    LOW_FIRST = "low-first"


def signed(value: int, bits: int) -> int:
    """Two's complement of the lowest ``bits`` of a number.

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


class MotorDrive(RegisterServer):
    """A drive with its own registers and (nearly always) one motor.

    ``order`` is that of its 32-bit numbers.
    """

    order = Order.HIGH_FIRST
    most_motors = 1

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        """Raise SimulatorError where there are more motors than the drive has outputs for."""
        super().__init__(unit_id)
        if not 1 <= len(motors) <= self.most_motors:
            raise SimulatorError(
                f"unit {unit_id}: this drive moves {self.most_motors} axis, but {len(motors)} axes of the "
                "configuration have its unit id; give each axis a unit id of its own"
            )
        self.axes: tuple[Motor, ...] = tuple(motors)
        self.motor = self.axes[0]
        self._now_s = 0.0
        for motor in self.axes:
            motor.log = self._log

    def _log(self, axis: str, kind: MoveKind, target: int | None, distance: int | None) -> None:
        self.ledger.moves.append(MoveRecord(self.unit_id, axis, kind, target, self._now_s, distance))

    def unheard_of(self, address: int, value: int) -> None:
        """Say that a command came that this drive, as it is simulated, does not know: it does nothing."""
        said = f"unit {self.unit_id}: {value:#06x} in {address:#06x} means nothing to this simulated drive"
        self.ledger.unheard_of.append(said)
        LOG.warning(said)

    def get32(self, address: int) -> int:
        """Return a signed number of two registers."""
        first, second = self.image.word(address), self.image.word(address + 1)
        if self.order is Order.LOW_FIRST:
            first, second = second, first
        return signed(first << 16 | second, 32)

    def put32(self, address: int, value: int) -> None:
        """Show a signed number in two registers; a larger one wraps round as counters do."""
        high, low = value >> 16, value
        if self.order is Order.LOW_FIRST:
            high, low = low, high
        self.image.set_word(address, high)
        self.image.set_word(address + 1, low)

    def refresh(self, now_s: float) -> None:
        """See :class:`RegisterServer`."""
        self._now_s = now_s
        for motor in self.axes:
            motor.advance(now_s)
        self.show()

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """Take the registers, then act on all that were in the frame; what they changed shows at once."""
        before = {address + i: self.image.word(address + i) for i in range(len(data) // 2)}
        self.image.store_words(address, data)
        self.written(before, now_s)
        self.show()

    def show(self) -> None:
        """Put positions and states into the registers; every motor is up to date."""

    def written(self, before: dict[int, int], now_s: float) -> None:
        """Act on a frame: ``before`` has its registers with what they held; the image has what they hold."""


def within(address: int, count: int, ranges: Sequence[tuple[int, int]]) -> bool:
    """Whether registers all lie in one of some ranges, each given by its first and last."""
    return any(first <= address and address + count - 1 <= last for first, last in ranges)
