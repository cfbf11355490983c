"""What correction is wanted for an axis, wherever the axis is: a curve with its gains, or an offset."""

from dataclasses import dataclass
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
from gateway.compensation.table import CorrectionTable

STEP: Final = Reversal(ReversalKind.STEP)
FULL: Final = Gain()


@dataclass(frozen=True, slots=True)
class CorrectionSpec:
    """One thing that can be in force: nothing, a constant offset, or a curve with its gains."""

    curve: Curve | None = None
    gain: Gain = FULL
    offset: float = 0.0
    reversal: Reversal = STEP
    table_digest: bytes = b""
    """Of the table that the curve was made from; empty without one, or where nobody asked for it."""

    def terms(self, forward_share: float, weight: float) -> tuple[Term, ...]:
        """Terms of the map at a blend between the branches (1 = forward), scaled by ``weight``."""
        if self.curve is None:
            return ()
        forward = weight * forward_share * self.gain.forward
        backward = weight * (1.0 - forward_share) * self.gain.backward
        return (Term(self.curve, forward, backward),)

    def map_at(self, forward_share: float) -> CorrectionMap:
        """Return the map with this alone in force."""
        return CorrectionMap(self.terms(forward_share, 1.0), self.offset)


NOTHING: Final = CorrectionSpec()


def spec_of_table(
    table: CorrectionTable, settings: AxisSettings, gain: Gain | None = None, digest: bytes = b""
) -> CorrectionSpec:
    """Return what a table, in the units of the axis, asks for under its settings.

    ``digest`` is that of the table as it is given; it is only kept.

    Raises:
        TableError: a rotary table that does not close, a fade that is too steep.
        SettingsError: backlash together with a table of two directions, a blend other than ``step`` where
            the drive profiles the move itself.
    """
    if settings.backlash is not None:
        table = with_backlash(table, settings.backlash)
    curve = Curve(table, settings.outside, settings.modulo)
    gain = settings.gain if gain is None else gain
    return CorrectionSpec(curve, gain, 0.0, reversal_in_force(table, settings, gain), digest)


def reversal_in_force(table: CorrectionTable, settings: AxisSettings, gain: Gain) -> Reversal:
    """Return the blend at a reversal, long enough that it never turns the axis round.

    A sin² blend over D adds at most (π/2)·difference/D to the slope of 1. Only backward corrections above
    the forward ones (the wrong way round for lost motion) work against the motion.
    """
    asked = settings.reversal
    if settings.setpoints is Setpoints.TARGETS:
        if asked is not None and asked.kind is not ReversalKind.STEP:
            raise SettingsError(
                f'reversal is {asked.kind.value}: with setpoints = "targets" the drive profiles each move '
                'and only "step" ends where it should'
            )
        return STEP
    differences = [
        gain.forward * f - gain.backward * b for f, b in zip(table.forward, table.backward, strict=True)
    ]
    if asked is None:
        largest = max(map(abs, differences))
        asked = Reversal(
            ReversalKind.DISTANCE,
            max(REVERSAL_PER_DIFFERENCE * largest, REVERSAL_PER_HYSTERESIS * settings.hysteresis),
        )
    if asked.kind is not ReversalKind.DISTANCE:
        return asked
    against = max(0.0, -min(differences))
    return Reversal(ReversalKind.DISTANCE, max(asked.amount, RELOAD_PER_DIFFERENCE * against))


def largest_difference(one: CorrectionSpec, other: CorrectionSpec) -> float:
    """Largest change that going from ``one`` to ``other`` makes on either branch anywhere, in units."""
    knots = [x for spec in (one, other) if spec.curve is not None for x in spec.curve.knots()] or [0.0]
    return max(
        abs(a.correction(x) - b.correction(x))
        for share in (0.0, 1.0)
        for a, b in [(one.map_at(share), other.map_at(share))]
        for x in knots
    )


def changeover_distance(one: CorrectionSpec, other: CorrectionSpec, settings: AxisSettings) -> float:
    """Setpoint travel over which ``one`` gives way to ``other``: as configured, or longer if it must be."""
    return max(settings.reload_distance, RELOAD_PER_DIFFERENCE * largest_difference(one, other))
