"""The drive's own motion profile: trapezoidal speed, from any state of motion to standstill."""

from dataclasses import dataclass
from math import copysign, sqrt

from gateway.simulator.errors import SimulatorError


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Limits of the drive's motion profile."""

    speed_mm_s: float = 100.0
    acceleration_mm_s2: float = 2000.0

    def __post_init__(self) -> None:
        """Refuse limits with which the motor never moves."""
        if self.speed_mm_s <= 0 or self.acceleration_mm_s2 <= 0:
            raise SimulatorError(
                f"speed {self.speed_mm_s} mm/s, acceleration {self.acceleration_mm_s2} mm/s²: "
                "both must be above 0"
            )


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of time with constant acceleration, in which the speed keeps its sign."""

    start_s: float
    start_mm: float
    speed_mm_s: float
    acceleration_mm_s2: float

    def position_mm(self, now_s: float) -> float:
        """Position at a time within the stretch."""
        elapsed_s = now_s - self.start_s
        return self.start_mm + elapsed_s * (self.speed_mm_s + self.acceleration_mm_s2 * elapsed_s / 2)


@dataclass(frozen=True, slots=True)
class MotionProfile:
    """One move. Before its first stretch and after its end the axis is at standstill."""

    stretches: tuple[Stretch, ...]
    end_s: float
    target_mm: float

    def position_mm(self, now_s: float) -> float:
        """Motor position at ``now_s``; exactly the target from ``end_s`` on."""
        if now_s >= self.end_s:
            return self.target_mm
        return self._at(now_s).position_mm(now_s)

    def speed_mm_s(self, now_s: float) -> float:
        """Signed motor speed at ``now_s``."""
        if now_s >= self.end_s:
            return 0.0
        stretch = self._at(now_s)
        return stretch.speed_mm_s + stretch.acceleration_mm_s2 * (now_s - stretch.start_s)

    def turning_points_mm(self, after_s: float, until_s: float) -> list[float]:
        """Positions of the reversals between two times, in order: the play has to follow through them."""
        return [
            stretch.start_mm
            for stretch in self.stretches[1:]
            if not stretch.speed_mm_s and after_s < stretch.start_s <= until_s
        ]

    def _at(self, now_s: float) -> Stretch:
        for stretch in reversed(self.stretches):
            if now_s >= stretch.start_s:
                return stretch
        return self.stretches[0]


def standstill(at_mm: float, now_s: float = 0.0) -> MotionProfile:
    """An axis at rest."""
    return MotionProfile((), now_s, at_mm)


def plan_motion(
    from_mm: float, speed_mm_s: float, target_mm: float, now_s: float, dynamics: Dynamics
) -> MotionProfile:
    """Plan the quickest move within the limits of the drive.

    An axis that moves away from the target, or too fast to stop before it, first brakes to standstill.

    Half a second to 50 mm/s, 1.5 s at that speed, half a second to brake:

    >>> plan_motion(0.0, 0.0, 100.0, 0.0, Dynamics(50.0, 100.0)).end_s
    2.5
    """
    braking_mm = speed_mm_s * abs(speed_mm_s) / (2 * dynamics.acceleration_mm_s2)
    distance_mm = target_mm - from_mm
    if not distance_mm and not speed_mm_s:
        return standstill(target_mm, now_s)
    if abs(braking_mm) > abs(distance_mm) or speed_mm_s * distance_mm < 0:
        brake = Stretch(now_s, from_mm, speed_mm_s, -copysign(dynamics.acceleration_mm_s2, speed_mm_s))
        stop_s = now_s + abs(speed_mm_s) / dynamics.acceleration_mm_s2
        rest = plan_motion(from_mm + braking_mm, 0.0, target_mm, stop_s, dynamics)
        return MotionProfile((brake, *rest.stretches), rest.end_s, target_mm)
    return _trapezoid(from_mm, speed_mm_s, target_mm, now_s, dynamics)


def _trapezoid(
    from_mm: float, speed_mm_s: float, target_mm: float, now_s: float, dynamics: Dynamics
) -> MotionProfile:
    """Accelerate, cruise, brake; the axis is at standstill or already moves towards the target."""
    acceleration = dynamics.acceleration_mm_s2
    distance_mm = abs(target_mm - from_mm)
    sign = copysign(1.0, target_mm - from_mm)
    speed = abs(speed_mm_s)
    peak = max(speed, min(dynamics.speed_mm_s, sqrt(acceleration * distance_mm + speed * speed / 2)))
    up_mm = (peak * peak - speed * speed) / (2 * acceleration)
    down_mm = peak * peak / (2 * acceleration)
    cruise_s = max(0.0, distance_mm - up_mm - down_mm) / peak
    cruise_from_s = now_s + (peak - speed) / acceleration
    brake_from_s = cruise_from_s + cruise_s
    return MotionProfile(
        (
            Stretch(now_s, from_mm, sign * speed, sign * acceleration),
            Stretch(cruise_from_s, from_mm + sign * up_mm, sign * peak, 0.0),
            Stretch(brake_from_s, target_mm - sign * down_mm, sign * peak, -sign * acceleration),
        ),
        brake_from_s + peak / acceleration,
        target_mm,
    )
