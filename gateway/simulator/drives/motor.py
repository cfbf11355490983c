"""The motor of a drive: moves, stops, homing and zero, in the drive's own counts, with a record of each."""

from collections.abc import Callable
from enum import Enum
from typing import Final

from gateway.simulator.ledger import MoveKind
from gateway.simulator.mechanics import Mechanics

HOMING_S: Final = 0.5
"""The shortest homing: off the switch and onto it again."""

Log = Callable[[str, MoveKind, int | None, int | None], None]
"""Takes the axis, the kind, the target and the distance."""


class Basis(Enum):
    """What a relative move is counted from."""

    TARGET = "target"
    COMMANDED = "commanded"
    ACTUAL = "actual"


class Motor:
    """One motor under its drive's control.

    It stands on its reference switch when it is made. Homing takes it back there, and gives the place the
    counts that it had. Speeds and ramps are the machine's, not those in the drive's registers.
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
        """Measured position. The motor follows its profile without lag: it is the commanded one too."""
        return round(self.mechanics.actual_counts)

    @property
    def target_counts(self) -> int:
        """Where the last move ends."""
        return round(self.mechanics.target_counts)

    @property
    def is_homing(self) -> bool:
        """Whether the axis looks for its reference."""
        return self._homing_until_s is not None

    @property
    def is_moving(self) -> bool:
        """Whether a move or a homing is under way."""
        return self.mechanics.is_moving or self.is_homing

    @property
    def is_done(self) -> bool:
        """Whether the axis stands where it was last told to go."""
        return not self.is_moving and not self.has_alarm

    @property
    def is_homed(self) -> bool:
        """Whether the counts mean something."""
        return self.mechanics.homed

    @property
    def has_alarm(self) -> bool:
        """Whether the drive has given up."""
        return self.mechanics.alarm

    def advance(self, now_s: float) -> None:
        """Let time pass."""
        self.mechanics.advance(now_s)
        if self._homing_until_s is None or self.mechanics.is_moving or now_s < self._homing_until_s:
            return
        self._homing_until_s = None
        self.mechanics.redefine(self._home_counts)
        self.mechanics.homed = True

    def absolute(self, target_counts: int, now_s: float) -> bool:
        """Start a move to a place. Returns whether it was started: not with an alarm."""
        return self._move(MoveKind.ABSOLUTE, target_counts, None, now_s)

    def relative(self, distance_counts: int, basis: Basis, now_s: float) -> bool:
        """Start a move over a distance. Returns whether it was started."""
        self.advance(now_s)
        start = self.target_counts if basis is Basis.TARGET else self.actual_counts
        return self._move(MoveKind.RELATIVE, start + distance_counts, distance_counts, now_s)

    def stop(self, now_s: float) -> None:
        """Brake; a homing is given up and the axis stays without a reference."""
        self.advance(now_s)
        self._homing_until_s = None
        self.mechanics.stop(now_s)
        self.log(self.name, MoveKind.STOP, self.target_counts, None)

    def home(self, now_s: float) -> bool:
        """Start a homing. Returns whether it was started."""
        self.advance(now_s)
        if self.has_alarm:
            return False
        self.mechanics.homed = False
        self._homing_until_s = now_s + HOMING_S
        self.mechanics.command(self.mechanics.encoder.counts(self._home_mm), now_s)
        self.log(self.name, MoveKind.HOME, None, None)
        return True

    def set_position(self, counts: int, now_s: float) -> None:
        """Call the place where the axis is ``counts``."""
        self.advance(now_s)
        self.mechanics.redefine(counts)
        self.log(self.name, MoveKind.SET_POSITION, counts, None)

    def other(self) -> None:
        """Note something that would turn the motor and is not simulated."""
        self.log(self.name, MoveKind.OTHER, None, None)

    def _move(self, kind: MoveKind, target_counts: int, distance_counts: int | None, now_s: float) -> bool:
        self.advance(now_s)
        if self.has_alarm:
            return False
        self._homing_until_s = None
        self.mechanics.command(target_counts, now_s)
        self.log(self.name, kind, target_counts, distance_counts)
        return True
