"""Numbers that govern one axis, with their defaults. Lengths are in the units of the axis."""

from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

from gateway.compensation.units import Units

DEFAULT_HYSTERESIS_MM: Final = 0.001
DEFAULT_HYSTERESIS_STEPS: Final = 2
"""Hysteresis is the larger of 2 counts, or steps, and 1 µm (the semantics of Fagor's REVEHYST, P99)."""
DEFAULT_IN_POSITION_MM: Final = 0.02
DEFAULT_MAX_CORRECTION_MM: Final = 0.5
DEFAULT_MAX_CORRECTION_SHARE: Final = 3e-4
"""Of the length of an axis: 0.3 mm/m, the error at the end of a long screw in a sound machine."""
DEFAULT_MAX_SLOPE: Final = 0.01
DEFAULT_FRESH_MS: Final = 20.0
DEFAULT_RELOAD_DISTANCE_MM: Final = 1.0
DEFAULT_KELVIN_PER_MIN: Final = 2.0
"""A screw warms more slowly."""
DEFAULT_LARGEST_DT: Final = 40.0
REVERSAL_PER_DIFFERENCE: Final = 5.0
REVERSAL_PER_HYSTERESIS: Final = 20.0
RELOAD_PER_DIFFERENCE: Final = 4.0
"""A sin² blend over D adds a slope of at most (π/2)·difference/D; 4 keeps it below 0.4."""


class Setpoints(Enum):
    """How the controller commands the axis."""

    TARGETS = "targets"
    STREAM = "stream"


class ReversalKind(Enum):
    """The unit in which the blend of a reversal advances."""

    STEP = "step"
    DISTANCE = "distance"
    TIME_MS = "time_ms"
    CYCLES = "cycles"


class OutsideKind(Enum):
    """What applies outside the table."""

    HOLD = "hold"
    FADE = "fade"
    ZERO = "zero"
    REFUSE = "refuse"


@dataclass(frozen=True, slots=True)
class Reversal:
    """Blend between the branches; ``amount`` is a length, milliseconds or cycles, by its kind."""

    kind: ReversalKind
    amount: float = 0.0


@dataclass(frozen=True, slots=True)
class Outside:
    """Policy outside the table; ``fade_length`` belongs to ``fade``."""

    kind: OutsideKind = OutsideKind.HOLD
    fade_length: float = 0.0


@dataclass(frozen=True, slots=True)
class Gain:
    """Share of the table that is applied, 0 to 1, for each direction."""

    forward: float = 1.0
    backward: float = 1.0

    @property
    def is_even(self) -> bool:
        """Whether both directions get the same share."""
        return self.forward == self.backward

    @property
    def is_zero(self) -> bool:
        """Whether nothing of the table is applied."""
        return not (self.forward or self.backward)


class BacklashKind(Enum):
    """Where the lost motion of a unidirectional table is applied.

    ``two-sided``: half of it each way (LinuxCNC). ``homed-forward`` / ``homed-backward``: none in the
    direction in which homing took it up, all of it in the other (Mint).
    """

    TWO_SIDED = "two-sided"
    HOMED_FORWARD = "homed-forward"
    HOMED_BACKWARD = "homed-backward"


@dataclass(frozen=True, slots=True)
class Backlash:
    """Constant lost motion, only for unidirectional tables; ``width`` > 0 in units."""

    width: float
    kind: BacklashKind


@dataclass(frozen=True, slots=True)
class ThermalSettings:
    """How the length of a screw follows its temperature. Lengths are in the units of the axis."""

    alpha: float
    """Expansion per kelvin; steel has about 11.5e-6."""
    reference: float = 20.0
    """Temperature at which the table is valid, °C."""
    fixed_at: float = 0.0
    """Machine position that does not move with the temperature."""
    timeout_s: float = 60.0
    """Time after its last value until the sensor counts as silent."""
    hold_s: float = 600.0
    """Time after that for which the last value is held."""
    rate_per_min: float = DEFAULT_KELVIN_PER_MIN
    """Largest rate of the effective difference, in K per minute."""
    largest_dt: float = DEFAULT_LARGEST_DT
    """A value that differs more from the reference is no temperature of a screw, K."""


@dataclass(frozen=True, slots=True)
class AxisSettings:
    """All settings for the maths of one axis, besides its table.

    ``counts = zero_counts + counts_per_unit * (nominal + machine_offset)``; the table and ``travel`` are in
    machine positions, that is ``nominal + machine_offset``.
    """

    units: Units
    counts_per_unit: float
    zero_counts: float = 0.0
    machine_offset: float = 0.0
    travel: tuple[float, float] | None = None
    travel_margin: float = DEFAULT_MAX_CORRECTION_MM
    setpoints: Setpoints = Setpoints.TARGETS
    hysteresis: float = DEFAULT_HYSTERESIS_MM
    reversal: Reversal | None = None
    """None: ``step`` in targets, the default distance in stream."""
    reload_distance: float = DEFAULT_RELOAD_DISTANCE_MM
    outside: Outside = Outside()
    modulo: float = 0.0
    """Length of one turn of a rotary axis, 0 for a linear one."""
    gain: Gain = Gain()
    backlash: Backlash | None = None
    max_correction: float = DEFAULT_MAX_CORRECTION_MM
    max_slope: float = DEFAULT_MAX_SLOPE
    max_speed: float = 0.0
    """Units per second; 0 if unknown."""
    fresh_ms: float = DEFAULT_FRESH_MS
    home_approach: int = 0
    """+1 forward, -1 backward, 0 unknown: the branch in force after homing."""
    step_counts: float = 1.0
    """Smallest step that every register of the axis can show, in counts, at most 1.

    Less than 1 if a count is coarse, as with a ``float32`` in millimetres."""

    in_position: float = DEFAULT_IN_POSITION_MM
    """An axis within this distance of its target has arrived; never less than the hysteresis."""
    repeat_within_counts: float = 0.0
    """A target within this distance of the last one keeps its branch."""

    @property
    def hysteresis_counts(self) -> float:
        """Jitter that an axis at standstill may have, each way."""
        return self.hysteresis * abs(self.counts_per_unit)

    @property
    def in_position_counts(self) -> float:
        """The in-position window, each way."""
        return max(self.in_position, self.hysteresis) * abs(self.counts_per_unit)

    @property
    def max_correction_counts(self) -> float:
        """The largest correction."""
        return self.max_correction * abs(self.counts_per_unit)

    @property
    def step(self) -> float:
        """The length of ``step_counts``."""
        return self.step_counts / abs(self.counts_per_unit)

    @property
    def largest_counts(self) -> float:
        """Size of the largest command within the travel or the turn; 0 if neither is known."""
        low, high = self.travel or (0.0, self.modulo)
        return max(abs(self.zero_counts + self.counts_per_unit * end) for end in (low, high))

    @property
    def corrected_bounds(self) -> tuple[float, float]:
        """Lowest and highest corrected machine position that the travel and its margin allow."""
        if self.travel is None:
            return -inf, inf
        low, high = self.travel
        slack = self.travel_margin + 0.5 * self.step  # rounding
        return low - slack, high + slack


def default_max_correction(units: Units, length: float) -> float:
    """Return the default for the largest correction of an axis of this length: 0.5 mm, or 0.3 mm/m.

    >>> default_max_correction(Units.MM, 500.0), round(default_max_correction(Units.MM, 3000.0), 9)
    (0.5, 0.9)
    """
    return max(units.from_mm(DEFAULT_MAX_CORRECTION_MM), DEFAULT_MAX_CORRECTION_SHARE * length)


def default_hysteresis(units: Units, step: float) -> float:
    """Return the larger of 2 steps of the registers and 1 µm, all in ``units``."""
    return max(DEFAULT_HYSTERESIS_STEPS * step, units.from_mm(DEFAULT_HYSTERESIS_MM))
