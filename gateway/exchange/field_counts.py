"""Between the content of a register and counts."""

from gateway.counts import Counts, Raw
from gateway.modbus.registers import PositionField


def counts_of(field_: PositionField, raw: Raw) -> Counts:
    """Counts of a register's content; integers stay integers, so that 64 bits lose nothing."""
    return raw if field_.scale == 1.0 else raw * field_.scale


def steps_of(field_: PositionField, counts: Counts) -> Raw:
    """Whole steps of a register for a number of counts; a float register takes them as they are."""
    return counts / field_.scale if field_.type.is_float else round(counts / field_.scale)


def raw_of(field_: PositionField, counts: Counts) -> Raw:
    """Content of a register for counts: the inverse of :func:`counts_of`."""
    raw = counts if field_.scale == 1.0 else counts / field_.scale
    return raw if field_.type.is_float else round(raw)
