"""Progress of a blend. It is a state and no queue: interrupting it loses nothing."""

from math import pi, sin

from gateway.compensation.settings import Reversal, ReversalKind


def shape(progress: float) -> float:
    """Weight of the new state at ``progress`` 0 to 1: sin², as in the ISG kernel; exact at both ends.

    >>> shape(0.0), shape(1.0), round(shape(0.5), 12)
    (0.0, 1.0, 0.5)
    """
    if progress <= 0.0:
        return 0.0
    if progress >= 1.0:
        return 1.0
    half = sin(0.5 * pi * progress)
    return half * half


def towards(progress: float, goal: float, share: float) -> float:
    """Move ``progress`` by at most ``share`` towards ``goal``.

    >>> towards(0.5, 0.0, 0.2), towards(0.1, 0.0, 0.2)
    (0.3, 0.0)
    """
    if progress < goal:
        return min(goal, progress + share)
    return max(goal, progress - share)


def share_of(reversal: Reversal, distance: float, elapsed_ms: float) -> float:
    """Return the part of a whole reversal that one different setpoint advances, 0 to 1.

    Args:
        reversal: the unit and length of the blend.
        distance: |setpoint - last setpoint|, units.
        elapsed_ms: time since the last setpoint of this reversal; 0 for its first.
    """
    if reversal.kind is ReversalKind.STEP or reversal.amount <= 0.0:
        return 1.0
    if reversal.kind is ReversalKind.DISTANCE:
        return min(1.0, distance / reversal.amount)
    if reversal.kind is ReversalKind.TIME_MS:
        # A pause longer than the whole blend is a dwell, not a part of the motion.
        return elapsed_ms / reversal.amount if elapsed_ms <= reversal.amount else 0.0
    return 1.0 / reversal.amount
