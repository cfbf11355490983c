"""Constant lost motion, for tables with one direction only, or for an axis without a table.

A table with two columns already contains the lost motion: forward - backward is the backlash at each point.
Applying it once more would double it, so the two exclude each other (Mint, ISG and LinuxCNC agree).
"""

from typing import Final

from gateway.compensation.errors import SettingsError
from gateway.compensation.settings import AxisSettings, Backlash, BacklashKind
from gateway.compensation.table import CorrectionTable, make_table

ANYWHERE: Final = 1e9
"""Largest reach of an axis without travel, in units."""


def no_correction(settings: AxisSettings) -> CorrectionTable:
    """Return a table of zeros over the whole range, for an axis that has only backlash."""
    low, high = settings.travel or ((0.0, settings.modulo) if settings.modulo else (-ANYWHERE, ANYWHERE))
    return make_table([low, high], [0.0, 0.0], [0.0, 0.0], settings.units)


def with_backlash(table: CorrectionTable, backlash: Backlash) -> CorrectionTable:
    """Return a table of two directions: lost motion is added when moving forward, not backward.

    A table that already has its lost motion from here is returned unchanged.

    Raises:
        SettingsError: the table has two directions already, or the width is not positive.

    >>> from gateway.compensation.table import make_table
    >>> from gateway.compensation.units import Units
    >>> one = make_table([0, 1], [0.0, 0.0], [0.0, 0.0], Units.MM)
    >>> list(with_backlash(one, Backlash(0.02, BacklashKind.TWO_SIDED)).forward)
    [0.01, 0.01]
    """
    if table.facts.has_backlash:
        return table
    if not table.is_unidirectional:
        raise SettingsError(
            "backlash belongs to tables of one direction: this table has two, which contain it already"
        )
    if not backlash.width > 0.0:
        raise SettingsError(f"backlash is {backlash.width:g}: it must be greater than 0")
    forward, backward = {
        BacklashKind.TWO_SIDED: (0.5 * backlash.width, -0.5 * backlash.width),
        BacklashKind.HOMED_FORWARD: (0.0, -backlash.width),
        BacklashKind.HOMED_BACKWARD: (backlash.width, 0.0),
    }[backlash.kind]
    return make_table(
        table.positions,
        [c + forward for c in table.forward],
        [c + backward for c in table.backward],
        table.units,
        has_backlash=True,
    )
