"""Short digests that tell whether two tables, or two sets of numbers, are the same."""

from array import array
from collections.abc import Sequence
from hashlib import blake2b
from typing import Final

from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import CorrectionTable

DIGEST_BYTES: Final = 16


def table_digest(table: CorrectionTable) -> bytes:
    """Digest of what a table holds: its units and its three columns, wherever they were read from.

    A compiled table brings its own: nobody walks over the points of one in a loop that has to answer.
    """
    if table.digest:
        return bytes.fromhex(table.digest)[:DIGEST_BYTES]
    digest = blake2b(table.units.value.encode(), digest_size=DIGEST_BYTES)
    for column in (table.positions, table.forward, table.backward):
        digest.update(array("d", column).tobytes())
    return digest.digest()


def scale_digest(settings: AxisSettings, more: Sequence[object] = ()) -> bytes:
    """Digest of every setting that decides what a count means and how a table is read.

    Gains are not among them, for they change as tables do; nor lengths that only say how a blend goes on.
    ``more``: what else must be the same, as plain numbers and strings.
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
