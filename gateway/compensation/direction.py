"""Direction of travel with hysteresis (the semantics of Fagor's REVEHYST, P99).

The branch changes only after the setpoint has moved back by the hysteresis from the furthest point reached.
So dither and single increments at a quadrant leave no ridge.
"""

from enum import Enum
from typing import NamedTuple


class Direction(Enum):
    """Direction of travel on the nominal scale, in machine units and never in counts."""

    FORWARD = 1
    BACKWARD = -1
    UNKNOWN = 0

    @property
    def goal(self) -> float:
        """Blend progress at which the branch of this direction is fully in force."""
        return (self.value + 1) / 2


class Travel(NamedTuple):
    """State of the detector: direction, and the furthest nominal position reached in it."""

    direction: Direction
    extreme: float


def follow(travel: Travel, nominal: float, hysteresis: float) -> Travel:
    """Return the travel after a setpoint at ``nominal``; a setpoint equal to the last changes nothing.

    >>> follow(Travel(Direction.FORWARD, 10.0), 9.9995, 0.001).direction
    <Direction.FORWARD: 1>
    >>> follow(Travel(Direction.FORWARD, 10.0), 9.9985, 0.001).direction
    <Direction.BACKWARD: -1>
    """
    direction, extreme = travel
    distance = nominal - extreme
    if direction is Direction.FORWARD:
        if distance >= 0.0:
            return Travel(direction, nominal)
        return travel if -distance < hysteresis else Travel(Direction.BACKWARD, nominal)
    if direction is Direction.BACKWARD:
        if distance <= 0.0:
            return Travel(direction, nominal)
        return travel if distance < hysteresis else Travel(Direction.FORWARD, nominal)
    if not distance or abs(distance) < hysteresis:
        return travel
    return Travel(Direction.FORWARD if distance > 0 else Direction.BACKWARD, nominal)
