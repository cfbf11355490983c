"""One simulated axis: motor, screw, backlash, nut and encoder. Nothing here reads a clock.

Positions are machine millimetres (a degree of a rotary axis counts as a millimetre). Time only goes forward:
call :meth:`Mechanics.advance` with times that never decrease.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from gateway.compensation.settings import AxisSettings
from gateway.compensation.units import Units
from gateway.simulator.errors import SimulatorError
from gateway.simulator.motion import Dynamics, MotionProfile, plan_motion, standstill
from gateway.simulator.screw import Screw

DEFAULT_DYNAMICS: Final = Dynamics()


class Flank(Enum):
    """Flank of the thread that carries the nut: ``FORWARD`` after motion towards greater positions."""

    FORWARD = "forward"
    BACKWARD = "backward"


class Play:
    """A nut with lost motion: it follows the screw only after the play has been taken up.

    The nut is at the flank's own position while the forward flank carries it, and ``width_mm`` above it while
    the backward flank does. In between it does not move.

    >>> play = Play(0.030, at_mm=10.0, flank=Flank.FORWARD)
    >>> play.follow(10.5), play.follow(10.48), play.follow(10.0)
    (10.5, 10.5, 10.03)
    """

    def __init__(self, width_mm: float, at_mm: float = 0.0, flank: Flank = Flank.FORWARD) -> None:
        if width_mm < 0:
            raise SimulatorError(f"backlash of {width_mm} mm: it cannot be less than 0")
        self.width_mm = width_mm
        self.nut_mm = at_mm if flank is Flank.FORWARD else at_mm + width_mm

    def follow(self, driven_mm: float) -> float:
        """Move the flank to ``driven_mm`` without a reversal on the way; return the nut's position."""
        self.nut_mm = min(max(self.nut_mm, driven_mm), driven_mm + self.width_mm)
        return self.nut_mm


@dataclass(frozen=True, slots=True)
class Encoder:
    """Converts motor positions to counts: ``counts = zero_counts + counts_per_mm * motor_mm``.

    ``counts_per_mm`` is negative if the drive counts in the other direction.
    """

    counts_per_mm: float
    zero_counts: float = 0.0

    def counts(self, motor_mm: float) -> float:
        """Return the counts at a motor position, not rounded."""
        return self.zero_counts + self.counts_per_mm * motor_mm

    def motor_mm(self, counts: float) -> float:
        """Return the motor position of a number of counts."""
        return (counts - self.zero_counts) / self.counts_per_mm


class Mechanics:
    """A motor that turns a worn screw, and the nut that follows it."""

    def __init__(
        self,
        screw: Screw,
        encoder: Encoder,
        *,
        backlash_mm: float = 0.0,
        flank: Flank = Flank.FORWARD,
        dynamics: Dynamics = DEFAULT_DYNAMICS,
        start_mm: float = 0.0,
    ) -> None:
        self.screw = screw
        self.encoder = encoder
        self.dynamics = dynamics
        self.homed = True
        self.alarm = False
        self._now_s = 0.0
        self._motion: MotionProfile = standstill(start_mm)
        self._target_counts = encoder.counts(start_mm)
        self._play = Play(backlash_mm, screw.driven_mm(start_mm), flank)

    @property
    def backlash_mm(self) -> float:
        """Lost motion between screw and nut."""
        return self._play.width_mm

    @property
    def motor_mm(self) -> float:
        """Ideal position of the nut from the motor's turns."""
        return self._motion.position_mm(self._now_s)

    @property
    def nut_mm(self) -> float:
        """True position of the nut."""
        return self._play.nut_mm

    @property
    def actual_counts(self) -> float:
        """Encoder position, not rounded; exactly the target after the move."""
        return self.encoder.counts(self.motor_mm) if self.is_moving else self._target_counts

    @property
    def target_counts(self) -> float:
        """Target of the last command."""
        return self._target_counts

    @property
    def is_moving(self) -> bool:
        """Whether a move is running."""
        return self._now_s < self._motion.end_s

    @property
    def is_done(self) -> bool:
        """Whether the axis is at standstill at its last target."""
        return not self.is_moving and not self.alarm

    def advance(self, now_s: float) -> None:
        """Advance to ``now_s``; the nut follows through every turning point on the way."""
        if now_s <= self._now_s:
            return
        for turning_mm in self._motion.turning_points_mm(self._now_s, now_s):
            self._play.follow(self.screw.driven_mm(turning_mm))
        self._now_s = now_s
        self._play.follow(self.screw.driven_mm(self.motor_mm))

    def command(self, target_counts: float, now_s: float) -> None:
        """Start an absolute move. Repeating the target of the running move changes nothing."""
        self.advance(now_s)
        if self.alarm or (target_counts == self._target_counts and self.is_moving):
            return
        self._start(self.encoder.motor_mm(target_counts), now_s)
        self._target_counts = target_counts

    def stop(self, now_s: float) -> None:
        """Brake to a standstill; the final position becomes the target."""
        self.advance(now_s)
        speed = self._motion.speed_mm_s(now_s)
        at_mm = self.motor_mm + speed * abs(speed) / (2 * self.dynamics.acceleration_mm_s2)
        if self.is_moving:
            self._start(at_mm, now_s)
            self._target_counts = self.encoder.counts(at_mm)

    def redefine(self, counts: float) -> None:
        """Set the present position to ``counts``; nothing moves."""
        shift = counts - self.actual_counts
        encoder = self.encoder
        self.encoder = Encoder(encoder.counts_per_mm, encoder.zero_counts + shift)
        self._target_counts += shift

    def _start(self, target_mm: float, now_s: float) -> None:
        speed_mm_s = self._motion.speed_mm_s(now_s)
        self._motion = plan_motion(self.motor_mm, speed_mm_s, target_mm, now_s, self.dynamics)


def encoder_of(settings: AxisSettings) -> Encoder:
    """Return the encoder of an axis of a configuration.

    ``counts = zero_counts + counts_per_unit * (nominal + machine_offset)``, and the machine position is
    ``nominal + machine_offset``. So the encoder does not depend on the offset.
    """
    return Encoder(settings.counts_per_unit / unit_mm(settings.units), settings.zero_counts)


def unit_mm(units: Units) -> float:
    """Millimetres of one machine unit; a degree counts as a millimetre."""
    return 1.0 if units is Units.DEGREE else units.convert_factor(Units.MM)
