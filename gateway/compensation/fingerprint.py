"""Short digests that show whether two tables, or two sets of numbers, are equal."""

from array import array
from collections.abc import Sequence
from hashlib import blake2b
from typing import Final

from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import CorrectionTable

DIGEST_BYTES: Final = 16


def table_digest(table: CorrectionTable) -> bytes:
    """Return the digest of a table's content: its units and its three columns, whatever its file was.

    A compiled table has its own digest: no loop with deadlines walks over its points.
    """
    if table.digest:
        return bytes.fromhex(table.digest)[:DIGEST_BYTES]
    digest = blake2b(table.units.value.encode(), digest_size=DIGEST_BYTES)
    for column in (table.positions, table.forward, table.backward):
        digest.update(array("d", column).tobytes())
    return digest.digest()


def scale_digest(settings: AxisSettings, more: Sequence[object] = ()) -> bytes:
    """Return the digest of every setting that decides what a count means and how a table is read.

    It has no gains, because they change as tables do, and no lengths that only control a blend. ``more``:
    what else must be equal, as plain numbers and strings.
    """
    parts = (
        settings.units.value,
        settings.setpoints.value,
        float(settings.counts_per_unit),
        float(settings.zero_counts),
        float(settings.machine_offset),
        settings.outside.kind.value,
        float(settings.outside.fade_length),
        float(settings.modulo),
        None if settings.backlash is None else (settings.backlash.kind.value, float(settings.backlash.width)),
        *more,
    )
    return blake2b(repr(parts).encode(), digest_size=DIGEST_BYTES).digest()
