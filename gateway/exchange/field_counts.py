"""Conversion between register contents and counts."""

from math import floor

from gateway.counts import Counts, Raw
from gateway.modbus.registers import PositionField


def nearest(value: float) -> int:
    """Return the nearest whole number, of two the even one: ``round`` at a tenth of its cost when compiled.

    >>> [nearest(value) for value in (0.4, 0.5, 1.5, -0.5, -1.5, -2.6)]
    [0, 0, 2, 0, -2, -3]
    """
    below = floor(value)
    rest = value - below  # exact, except for values next to -0.5, which give 0 either way
    return below + (1 if rest > 0.5 or (rest == 0.5 and below & 1) else 0)


def counts_of(field_: PositionField, raw: Raw) -> Counts:
    """Counts of a register's content; integers stay integers, so that 64 bits lose nothing."""
    return raw if field_.scale == 1.0 else raw * field_.scale


def steps_of(field_: PositionField, counts: Counts) -> Raw:
    """Whole steps of a register for a number of counts; a float register takes them unrounded."""
    return counts / field_.scale if field_.type.is_float else nearest(counts / field_.scale)


def raw_of(field_: PositionField, counts: Counts) -> Raw:
    """Content of a register for counts: the inverse of :func:`counts_of`."""
    raw = counts if field_.scale == 1.0 else counts / field_.scale
    return raw if field_.type.is_float else round(raw)
