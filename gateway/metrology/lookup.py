"""Corrections of a table between its points, and outside it as the default policy has them: held."""

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable


def correction_at(table: CorrectionTable, position: float, direction: Direction) -> float:
    """Return the amount that a table adds at a machine position, in its units.

    >>> from gateway.compensation.table import make_table
    >>> from gateway.compensation.units import Units
    >>> table = make_table([0, 10], [0.0, 0.02], [0.0, 0.0], Units.MM)
    >>> correction_at(table, 5, Direction.FORWARD), correction_at(table, 99, Direction.FORWARD)
    (0.01, 0.02)
    """
    curve = table.backward if direction is Direction.BACKWARD else table.forward
    inside = min(max(position, table.first), table.last)
    index = table.segment(inside)
    left, right = table.positions[index], table.positions[index + 1]
    share = (inside - left) / (right - left)
    # Exact at both points: rounding must not move what was measured.
    return curve[index + 1] if share == 1.0 else curve[index] + share * (curve[index + 1] - curve[index])
