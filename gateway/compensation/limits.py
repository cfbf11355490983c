"""What a table and its blends can add to the motion, and the limits of that."""

from dataclasses import dataclass
from math import pi

from gateway.compensation.correction_spec import CorrectionSpec
from gateway.compensation.settings import AxisSettings, ReversalKind
from gateway.compensation.table import CorrectionTable


@dataclass(frozen=True, slots=True)
class MotionReport:
    """Worst additions to the motion of one axis, in its units and seconds.

    ``largest_step``: a jump of the command at a reversal without a blend. Speed and acceleration are at the
    configured ``max_speed``; both are 0 if that is unknown and no blend runs by time.
    """

    largest_step: float
    added_speed: float
    added_acceleration: float


def motion_report(spec: CorrectionSpec, settings: AxisSettings) -> MotionReport:
    """Bound the step, speed and acceleration that a correction can add.

    A sin² blend of a difference d over a time T adds at most (π/2)·d/T of speed and (π²/2)·d/T² of
    acceleration; one over a distance D at speed v has T = D/v.
    """
    if spec.curve is None:
        return MotionReport(0.0, 0.0, 0.0)
    table = spec.curve.table
    difference = max(
        abs(spec.gain.forward * f - spec.gain.backward * b)
        for f, b in zip(table.forward, table.backward, strict=True)
    )
    speed = table.max_slope() * max(spec.gain.forward, spec.gain.backward) * settings.max_speed
    blend_s = 0.0
    if spec.reversal.kind is ReversalKind.TIME_MS:
        blend_s = spec.reversal.amount / 1000.0
    elif spec.reversal.kind is ReversalKind.DISTANCE and settings.max_speed:
        blend_s = spec.reversal.amount / settings.max_speed
    if not blend_s:
        return MotionReport(difference, speed, 0.0)
    return MotionReport(
        0.0, speed + 0.5 * pi * difference / blend_s, 0.5 * pi * pi * difference / blend_s / blend_s
    )


def steepest_segment(table: CorrectionTable) -> tuple[str, float, float, float]:
    """Return branch, both ends and slope of the steepest segment of a table."""
    return max(
        (
            (name, table.positions[i], table.positions[i + 1], (curve[i + 1] - curve[i]) / width)
            for name, curve in (("forward", table.forward), ("backward", table.backward))
            for i in range(len(table.positions) - 1)
            for width in [table.positions[i + 1] - table.positions[i]]
        ),
        key=lambda segment: abs(segment[3]),
    )
