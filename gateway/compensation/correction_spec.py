"""The requested correction of an axis, for every position: its curve and gains, and a line."""

from dataclasses import dataclass, replace
from typing import Final

from gateway.compensation.backlash import with_backlash
from gateway.compensation.correction_map import CorrectionMap, Term
from gateway.compensation.curve import Curve
from gateway.compensation.errors import SettingsError
from gateway.compensation.settings import (
    RELOAD_PER_DIFFERENCE,
    REVERSAL_PER_DIFFERENCE,
    REVERSAL_PER_HYSTERESIS,
    AxisSettings,
    Gain,
    Reversal,
    ReversalKind,
    Setpoints,
)
from gateway.compensation.table import CorrectionTable, Range

STEP: Final = Reversal(ReversalKind.STEP)
FULL: Final = Gain()


@dataclass(frozen=True, slots=True)
class CorrectionSpec:
    """A correction that can be in force: none, a constant offset, or a curve with gains and a line."""

    curve: Curve | None = None
    gain: Gain = FULL
    offset: float = 0.0
    """Of the line at machine position 0, in units."""
    reversal: Reversal = STEP
    table_digest: bytes = b""
    """Digest of the curve's table; empty without a table, or if no digest was given."""
    tilt: float = 0.0
    """Slope of the line, units per unit of machine position; together with the curve's it stays below 1."""

    def terms(self, forward_share: float, weight: float) -> tuple[Term, ...]:
        """Return the terms of the map at a blend between the branches (1 = forward), scaled by ``weight``."""
        if self.curve is None:
            return ()
        forward = weight * forward_share * self.gain.forward
        backward = weight * (1.0 - forward_share) * self.gain.backward
        return (Term(self.curve, forward, backward),)

    @property
    def has_branches(self) -> bool:
        """Whether it depends on the direction of travel."""
        return self.curve is not None and not (self.curve.table.is_unidirectional and self.gain.is_even)

    def gain_of(self, *, is_forward: bool) -> float:
        """Return the share of its table that one branch gets."""
        return self.gain.forward if is_forward else self.gain.backward

    def range(self, *, is_forward: bool) -> Range:
        """Return the smallest and the largest correction of one branch over all positions."""
        if self.curve is None:
            return Range(self.offset, self.offset)
        low, high = self.curve.range(is_forward=is_forward)
        gain = self.gain_of(is_forward=is_forward)
        return Range(self.offset + gain * low, self.offset + gain * high)

    def map_at(self, forward_share: float) -> CorrectionMap:
        """Return the map with only this correction in force."""
        return CorrectionMap(self.terms(forward_share, 1.0), self.offset, self.tilt)

    def correction(self, position: float, *, is_forward: bool) -> float:
        """Return what one branch adds at a machine position, in units: that of :meth:`map_at` 1 or 0."""
        line = self.offset + self.tilt * position
        if self.curve is None:
            return line
        if is_forward:
            return line + self.gain.forward * self.curve.forward(position)
        return line + self.gain.backward * self.curve.backward(position)

    def is_kin_of(self, other: "CorrectionSpec") -> bool:
        """Whether two corrections differ in the line only: the same curve and gains."""
        return self.curve is not None and self.curve is other.curve and self.gain == other.gain

    def line_at(self, position: float) -> float:
        """Return what the line adds at a machine position, in units."""
        return self.offset + self.tilt * position


NOTHING: Final = CorrectionSpec()


def with_line(spec: CorrectionSpec, offset: float, tilt: float) -> CorrectionSpec:
    """Return a correction with another line.

    Raises:
        SettingsError: the slopes of curve and line could reach 1: the sum could not be inverted.
    """
    steepest = 0.0 if spec.curve is None else spec.curve.max_slope
    if not steepest + abs(tilt) < 1.0:
        raise SettingsError(
            f"a line with a slope of {tilt:.4g} on a table with one of {steepest:.4g}: together they must "
            "stay below 1"
        )
    return replace(spec, offset=offset, tilt=tilt)


def towards_line(
    spec: CorrectionSpec, requested: CorrectionSpec, position: float, most: float
) -> CorrectionSpec:
    """Return ``requested``, or a line on the way to it that changes by ``most`` at ``position``.

    ``spec`` and ``requested`` differ in the line only. Where the lines cross the change is complete
    immediately: nothing moves there.
    """
    change = abs(requested.line_at(position) - spec.line_at(position))
    if change <= most:
        return requested
    share = most / change
    offset = spec.offset + share * (requested.offset - spec.offset)
    return replace(spec, offset=offset, tilt=spec.tilt + share * (requested.tilt - spec.tilt))


def steepest_change(spec: CorrectionSpec, requested: CorrectionSpec, max_slope: float) -> float:
    """Return how fast a line may change to another one, per unit of travel.

    ``spec`` and ``requested`` differ in the line only.

    The limit is that of a table change. Curve and line together must also never reverse the axis.
    """
    steepest = 0.0 if spec.curve is None else spec.curve.max_slope
    room = 1.0 - steepest - max(abs(spec.tilt), abs(requested.tilt))
    return min(max_slope, 0.5 * room)


def spec_of_table(
    table: CorrectionTable, settings: AxisSettings, gain: Gain | None = None, digest: bytes = b""
) -> CorrectionSpec:
    """Return the correction of a table, in the units of the axis, under its settings.

    ``digest`` is that of the given table; it is only stored.

    Raises:
        TableError: a rotary table that does not close, a fade that is too steep.
        SettingsError: backlash together with a table of two directions, or a blend other than ``step`` if the
            drive profiles the move itself.
    """
    if settings.backlash is not None:
        table = with_backlash(table, settings.backlash)
    curve = Curve(table, settings.outside, settings.modulo)
    gain = settings.gain if gain is None else gain
    return CorrectionSpec(curve, gain, 0.0, reversal_in_force(table, settings, gain), digest)


def reversal_in_force(table: CorrectionTable, settings: AxisSettings, gain: Gain) -> Reversal:
    """Return the blend at a reversal, long enough that it never reverses the axis.

    A sin² blend over D adds at most (π/2)·difference/D to the slope of 1. Only backward corrections above the
    forward ones (the wrong way round for lost motion) work against the motion.
    """
    asked = settings.reversal
    if settings.setpoints is Setpoints.TARGETS:
        if asked is not None and asked.kind is not ReversalKind.STEP:
            raise SettingsError(
                f'reversal is {asked.kind.value}: with setpoints = "targets" the drive profiles each move '
                'and only "step" ends where it should'
            )
        return STEP
    difference = _branch_difference(table, gain)
    if asked is None:
        amount = max(
            REVERSAL_PER_DIFFERENCE * difference.largest, REVERSAL_PER_HYSTERESIS * settings.hysteresis
        )
        asked = Reversal(ReversalKind.DISTANCE, amount)
    if asked.kind is not ReversalKind.DISTANCE:
        return asked
    against = max(0.0, -difference.low)
    return Reversal(ReversalKind.DISTANCE, max(asked.amount, RELOAD_PER_DIFFERENCE * against))


def _branch_difference(table: CorrectionTable, gain: Gain) -> Range:
    """Return the bounds of forward less backward correction; exact if both gains are equal."""
    facts = table.facts
    low, high = facts.difference
    if gain.is_even:
        return Range(gain.forward * low, gain.forward * high)
    # gf·f − gb·b = gf·(f − b) + (gf − gb)·b, and each branch has its own bounds.
    more = gain.forward - gain.backward
    rest = sorted((more * facts.backward.low, more * facts.backward.high))
    return Range(
        max(
            gain.forward * low + rest[0],
            gain.forward * facts.forward.low - gain.backward * facts.backward.high,
        ),
        min(
            gain.forward * high + rest[1],
            gain.forward * facts.forward.high - gain.backward * facts.backward.low,
        ),
    )


def largest_difference(one: CorrectionSpec, other: CorrectionSpec) -> float:
    """Return a bound of the change from ``one`` to ``other`` on either branch at any position, in units.

    Exact if one of them is no curve, or both are one table with other gains. For two tables it is the bound
    from their extremes, without a walk over their points: the blend is rather too long than too short.
    """
    return max(_branch_change(one, other, is_forward=is_forward) for is_forward in (True, False))


def _line_change(one: CorrectionSpec, other: CorrectionSpec, travel: tuple[float, float] | None) -> float:
    """Return a bound of the change by the slopes of two lines within the travel, without their offsets."""
    if one.tilt == other.tilt or travel is None:
        return 0.0
    return abs(one.tilt - other.tilt) * max(map(abs, travel))


def _branch_change(one: CorrectionSpec, other: CorrectionSpec, *, is_forward: bool) -> float:
    if one.curve is not None and other.curve is not None and one.curve.table is other.curve.table:
        change = one.gain_of(is_forward=is_forward) - other.gain_of(is_forward=is_forward)
        return abs(change) * one.curve.range(is_forward=is_forward).largest + abs(one.offset - other.offset)
    low, high = one.range(is_forward=is_forward)
    other_low, other_high = other.range(is_forward=is_forward)
    return max(high - other_low, other_high - low)


def changeover_distance(one: CorrectionSpec, other: CorrectionSpec, settings: AxisSettings) -> float:
    """Return the setpoint travel of the change-over: as configured, or longer if necessary."""
    difference = largest_difference(one, other) + _line_change(one, other, settings.travel)
    return max(settings.reload_distance, RELOAD_PER_DIFFERENCE * difference)
