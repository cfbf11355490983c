"""A screw with errors: the deviation of the nut from its ideal position.

All positions and errors are in machine millimetres, except where a name says µm. On a rotary axis a degree
counts as a millimetre. The deviation has the sign of a measurement: true position minus ideal position. So a
positive progressive error is a screw whose pitch is too long.
"""

import math
import random
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Final

from gateway.simulator.errors import SimulatorError

UM_PER_MM: Final = 1000.0
STEEPEST_SLOPE: Final = 0.5
"""No real screw's error changes faster than this; the play operator needs less than 1."""


@dataclass(frozen=True, slots=True)
class PeriodicError:
    """An error that repeats, usually once per turn of the screw (period = lead).

    >>> PeriodicError(amplitude_um=3.0, period_mm=5.0).deviation_um(1.25)
    3.0
    """

    amplitude_um: float
    period_mm: float
    phase_turns: float = 0.0

    def deviation_um(self, motor_mm: float) -> float:
        """Deviation at a motor position."""
        return self.amplitude_um * sin(2 * pi * (motor_mm / self.period_mm + self.phase_turns))


@dataclass(frozen=True, slots=True)
class Wear:
    """A worn interval, where the machine has done most of its work: a raised cosine, smooth at both ends.

    >>> Wear(centre_mm=100.0, width_mm=40.0, depth_um=-20.0).deviation_um(110.0)
    -10.0
    """

    centre_mm: float
    width_mm: float
    depth_um: float

    def deviation_um(self, motor_mm: float) -> float:
        """Deviation at a motor position; 0 outside the interval."""
        distance = motor_mm - self.centre_mm
        if abs(distance) >= self.width_mm / 2:
            return 0.0
        return self.depth_um * round((1 + cos(2 * pi * distance / self.width_mm)) / 2, 15)


@dataclass(frozen=True, slots=True)
class Screw:
    """Sum of the errors of one screw over ``[start_mm, start_mm + length_mm]``, continued beyond its ends.

    >>> Screw(start_mm=0.0, length_mm=1000.0, progressive_um_per_m=50.0).deviation_mm(500.0)
    0.025
    """

    start_mm: float = 0.0
    length_mm: float = 1000.0
    progressive_um_per_m: float = 0.0
    bow_um: float = 0.0
    """Height of a slow parabola that is 0 at both ends of the screw."""
    periodic: tuple[PeriodicError, ...] = ()
    wear: tuple[Wear, ...] = ()

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        if self.length_mm <= 0 or any(p.period_mm <= 0 for p in self.periodic):
            raise SimulatorError("a screw needs a length and periods greater than 0 mm")
        if self._steepest() > STEEPEST_SLOPE:
            raise SimulatorError(
                f"the error of this screw may change by {self._steepest():.3g} mm per mm; "
                f"at most {STEEPEST_SLOPE} is allowed"
            )

    def deviation_mm(self, motor_mm: float) -> float:
        """True minus ideal nut position, without backlash, at the motor position ``motor_mm``."""
        share = (motor_mm - self.start_mm) / self.length_mm
        total_um = self.progressive_um_per_m * motor_mm / 1000.0 + self.bow_um * 4 * share * (1 - share)
        total_um += sum(wave.deviation_um(motor_mm) for wave in self.periodic)
        total_um += sum(dip.deviation_um(motor_mm) for dip in self.wear)
        return total_um / UM_PER_MM

    def driven_mm(self, motor_mm: float) -> float:
        """Position of the thread's flank: the nut's position while the forward flank carries it."""
        return motor_mm + self.deviation_mm(motor_mm)

    def _steepest(self) -> float:
        """Upper bound of |change of deviation / distance| on the screw."""
        bound = abs(self.progressive_um_per_m) / 1000.0 + 4 * abs(self.bow_um) / self.length_mm
        bound += sum(2 * pi * abs(p.amplitude_um) / p.period_mm for p in self.periodic)
        bound += sum(pi * abs(w.depth_um) / w.width_mm for w in self.wear)
        return bound / UM_PER_MM


def waviness(
    rng: random.Random, amplitude_um: float, shortest_mm: float, longest_mm: float, waves: int = 4
) -> tuple[PeriodicError, ...]:
    """Random long waves whose amplitudes add up to at most ``amplitude_um``."""
    return tuple(
        PeriodicError(amplitude_um / waves, rng.uniform(shortest_mm, longest_mm), rng.random())
        for _ in range(waves)
    )


def worn_screw(
    rng: random.Random,
    start_mm: float,
    length_mm: float,
    lead_mm: float,
    *,
    most_um_per_m: float = math.inf,
) -> Screw:
    """Return an old machine's screw: 80 to 120 µm of pitch error over its length, 20 to 30 µm of wear.

    The errors do not scale with the length, except that ``most_um_per_m`` limits the pitch error. The
    periodic error stays small, as on real ground screws. A correction table with points farther apart than
    half a lead cannot remove it.
    """
    long_or_short = rng.choice((-1.0, 1.0))
    return Screw(
        start_mm=start_mm,
        length_mm=length_mm,
        progressive_um_per_m=long_or_short
        * min(rng.uniform(80.0, 120.0) * 1000.0 / length_mm, most_um_per_m),
        bow_um=rng.uniform(-15.0, 15.0),
        periodic=(
            PeriodicError(rng.uniform(0.5, 0.8), lead_mm, rng.random()),
            *waviness(rng, 4.0, length_mm / 3, length_mm),
        ),
        wear=(
            Wear(
                centre_mm=start_mm + rng.uniform(0.35, 0.65) * length_mm,
                width_mm=0.5 * length_mm,
                depth_um=-rng.uniform(20.0, 30.0),
            ),
        ),
    )
