"""Where a relative move starts (M5).

The last accepted target, where nothing else has moved the axis since and the drive counts from it. Else what
the drive says, of an axis that stands: its own commanded position, or the actual one. Never a moving axis.
"""

from gateway.counts import Counts
from gateway.drives.motion import Action
from gateway.exchange.added_frames import AddedFrame, Purpose, read_bit, read_field
from gateway.exchange.axis import AxisExchange
from gateway.exchange.known import Known, Standing
from gateway.exchange.plan import DONE_BIT, MOVING_BIT
from gateway.exchange.rendering import Base


def next_base_read(axis: AxisExchange, action: Action, known: Known) -> AddedFrame | None:
    """Return what must be read next to know where a relative move starts; None when no reading helps."""
    if not axis.may_read or _is_place_untold(axis, known) or base_of(axis, action, known) is not None:
        return None
    name, bits = axis.plan.name, axis.plan.bits
    if name not in known.standing:
        for bit_name in (DONE_BIT, MOVING_BIT):
            if bit_name in bits:
                return read_bit(axis, Purpose.STANDING, bits[bit_name])
    actual, commanded = axis.asked_actual, axis.asked_commanded
    if axis.is_distance_unproven and actual is not None:
        return None if name in known.actual else read_field(axis, Purpose.ACTUAL, actual)
    if _counts_from_commanded(axis, action):
        if commanded is not None and name not in known.commanded:
            return read_field(axis, Purpose.COMMANDED, commanded)
    elif actual is not None and name not in known.actual:
        return read_field(axis, Purpose.ACTUAL, actual)
    return None


def base_of(axis: AxisExchange, action: Action, known: Known) -> Base | None:
    """Return where a relative move starts, as far as is known by now; None where it is not."""
    if axis.is_distance_unproven or _is_place_untold(axis, known):
        return None
    accepted = axis.compensation.accepted
    is_certain = axis.arrival.is_proven and action is not Action.RELATIVE_TO_ACTUAL
    if accepted is not None and (action is Action.RELATIVE or is_certain):
        return Base(accepted.nominal_counts, accepted.corrected_counts, is_standing=axis.arrival.is_proven)
    name = axis.plan.name
    standing = known.standing.get(name, Standing.UNTOLD)
    if _counts_from_commanded(axis, action):
        counts = known.commanded.get(name)
        return None if counts is None else _base_at(axis, counts, standing, tolerance=0.0)
    actual = known.actual.get(name)
    if actual is None:
        return None
    settings = axis.plan.settings
    tolerance = settings.hysteresis * abs(settings.counts_per_unit)
    if action is Action.RELATIVE_TO_ACTUAL:
        return _base_at(axis, actual.counts, standing, tolerance=0.0)
    return _base_at(axis, actual.counts, standing, tolerance=tolerance)


def _is_place_untold(axis: AxisExchange, known: Known) -> bool:
    """Whether the drive was asked where it is, and did not say: it may have been jogged (M6)."""
    return axis.plan.name in known.actual and known.actual[axis.plan.name] is None


def _counts_from_commanded(axis: AxisExchange, action: Action) -> bool:
    return axis.asked_commanded is not None and action is not Action.RELATIVE_TO_ACTUAL


def _base_at(axis: AxisExchange, counts: Counts, standing: Standing, *, tolerance: float) -> Base | None:
    """Return the base at a position that the drive reported.

    A bit that may be that of the time before the last move counts only beside a position at the end of it.
    """
    accepted = axis.compensation.accepted
    if accepted is not None and abs(counts - accepted.corrected_counts) <= tolerance:
        return Base(accepted.nominal_counts, accepted.corrected_counts, is_standing=True)
    is_certain = standing is Standing.STANDS or (standing is Standing.SAYS_SO and axis.is_at_target(counts))
    if not is_certain:
        return None
    return Base(round(axis.nominal_of(counts)), counts, is_standing=True)
