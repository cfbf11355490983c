"""Tables as the relay maps them: a header, then positions, forward and backward corrections as raw doubles.

In the state folder each has its own file, named by its digest.

The header has every value that would need a walk over the points: so loading such a table takes the loop
equally long for ten points and for a hundred thousand. Numbers are in this machine's own byte order: the file
never leaves the machine that made it.
"""

import contextlib
import hashlib
import struct
from collections.abc import Collection
from pathlib import Path
from typing import Any, Final

from gateway.catalogue import starts
from gateway.compensation.table import CorrectionTable, Range, TableFacts
from gateway.compensation.units import Units
from gateway.files import FileRefusedError
from gateway.state.folder import StateError, read_state, write_if_new

MAGIC: Final = b"PGtable\n"
VERSION: Final = 1
FOLDER_NAME: Final = "tables"
SUFFIX: Final = ".doubles"
OTHERS_KEPT: Final = 4
"""Number of tables that belong to no axis and still stay in the state folder."""
POINT_BYTES: Final = 24
MAX_POINTS: Final = 4_000_000
"""More than any file of 16 MiB can hold."""
_DIGEST_BYTES: Final = 32
_ONE_WAY: Final = 1
_BACKLASH: Final = 2
_ALL_FLAGS: Final = _ONE_WAY | _BACKLASH
# Magic, version, flags, count, units; even step, ranges of forward, backward and difference, steepest slope;
# digest of the points.
_FIELDS: Final = struct.Struct(f"=8sIIQ8s8d{_DIGEST_BYTES}s")
HEADER_BYTES: Final = _FIELDS.size + _DIGEST_BYTES
"""The fields, and a digest over them; a multiple of 8, so that the doubles are aligned."""
assert HEADER_BYTES % 8 == 0


class WrongTableError(Exception):
    """Bytes that are no compiled table of this release; the text says what was found."""


def compiled(table: CorrectionTable) -> bytes:
    """Return a table in its compiled form."""
    facts = table.facts
    points = b"".join(_raw(values) for values in (table.positions, table.forward, table.backward))
    fields = _FIELDS.pack(
        MAGIC,
        VERSION,
        _ONE_WAY * facts.is_unidirectional | _BACKLASH * facts.has_backlash,
        len(table.positions),
        table.units.value.encode(),
        table.even_step,
        *facts.forward,
        *facts.backward,
        *facts.difference,
        facts.max_slope,
        hashlib.sha256(points).digest(),
    )
    return fields + hashlib.sha256(fields).digest() + points


def _raw(values: Any) -> memoryview:
    return memoryview(values).cast("B")  # an array or a view of doubles, both of which have a buffer


def digest_of(data: bytes | memoryview) -> str:
    """Return the name of a compiled table: the digest of its header, which holds that of its points."""
    return bytes(data[_FIELDS.size : HEADER_BYTES]).hex()


def mapped(data: memoryview) -> CorrectionTable:
    """Return a compiled table without reading its points; it uses ``data``, which must not change.

    Raises:
        WrongTableError: the header is not that of a table of this release, is damaged, or states another
            size.
    """
    if len(data) < HEADER_BYTES:
        raise WrongTableError(f"{len(data)} bytes are no compiled table: its header has {HEADER_BYTES}")
    magic, version, flags, count, units, *numbers, _ = _FIELDS.unpack_from(data)
    if magic != MAGIC:
        raise WrongTableError(f"no compiled table: it begins with {magic!r}")
    if version != VERSION:
        raise WrongTableError(f"a compiled table of version {version}; this release has version {VERSION}")
    if hashlib.sha256(data[: _FIELDS.size]).digest() != data[_FIELDS.size : HEADER_BYTES]:
        raise WrongTableError("the header of the compiled table is damaged: its digest is another")
    if not 2 <= count <= MAX_POINTS or flags & ~_ALL_FLAGS:
        raise WrongTableError(f"a compiled table of {count} points with flags {flags:#x}")
    if len(data) != HEADER_BYTES + count * POINT_BYTES:
        size = HEADER_BYTES + count * POINT_BYTES
        raise WrongTableError(f"{len(data)} bytes for {count} points, which take {size}")
    try:
        unit = Units(units.rstrip(b"\0").decode("ascii", "replace"))
    except ValueError:
        raise WrongTableError(f"the units {units!r} are not known") from None
    return _table(data, count, unit, flags, numbers)


def _table(data: memoryview, count: int, unit: Units, flags: int, numbers: list[float]) -> CorrectionTable:
    even_step, *bounds, max_slope = numbers
    doubles = data[HEADER_BYTES:].cast("d")
    forward = doubles[count : 2 * count]
    is_one_way = bool(flags & _ONE_WAY)
    facts = TableFacts(
        is_one_way,
        Range(*bounds[0:2]),
        Range(*bounds[2:4]),
        Range(*bounds[4:6]),
        max_slope,
        bool(flags & _BACKLASH),
    )
    backward = forward if is_one_way else doubles[2 * count :]
    return CorrectionTable(doubles[:count], forward, backward, unit, even_step, facts, digest_of(data))


def checked(data: bytes) -> CorrectionTable:
    """Do what :func:`mapped` does, and compare the points with their digest too.

    Raises:
        WrongTableError: see there; or the points are not those that were written.
    """
    table = mapped(memoryview(data))
    check_points(memoryview(data))
    return table


def check_points(data: memoryview) -> None:
    """Compare the points of a table with a valid header with their digest; other threads run meanwhile.

    Raises:
        WrongTableError: they are not those that were written.
    """
    if hashlib.sha256(data[HEADER_BYTES:]).digest() != data[_FIELDS.size - _DIGEST_BYTES : _FIELDS.size]:
        raise WrongTableError("the points of the compiled table are damaged: their digest is another")


def table_path(state: Path, digest: str) -> Path:
    """Return the path of a compiled table."""
    return state / FOLDER_NAME / f"{digest}{SUFFIX}"


def write_table(state: Path, data: bytes) -> None:
    """Write a compiled table unless it exists; OSError if it cannot be written."""
    write_if_new(table_path(state, digest_of(data)), data)


def read_table(state: Path, digest: str, remedy: str) -> CorrectionTable:
    """Read a table into memory: truncating a mapped file would end the reading process.

    Raises:
        StateError: its file is missing, damaged or holds another one; with ``remedy``.
    """
    path = table_path(state, digest)
    try:
        table = checked(read_state(path))
    except FileRefusedError as error:
        raise StateError(f"{path}: {error.found}; {remedy}") from None
    except WrongTableError as error:
        raise StateError(f"{path}: {error}; {remedy}") from None
    if table.digest != digest:
        raise StateError(f"{starts.ANOTHER_TABLE.begin(table=path)}; {remedy}")
    return table


def find_table(state: Path, fingerprint: bytes) -> CorrectionTable | None:
    """Return a compiled table by its ``compensation.fingerprint``; None if there is none.

    A table that is no longer in force may still be needed, by an axis that was killed while it changed to the
    next one.
    """
    for path in (state / FOLDER_NAME).glob(f"*{SUFFIX}"):
        digest = path.name.removesuffix(SUFFIX)
        with contextlib.suppress(ValueError, StateError):
            if bytes.fromhex(digest)[: len(fingerprint)] == fingerprint:
                return read_table(state, digest, "")
    return None


def remove_others(state: Path, digests: Collection[str]) -> None:
    """Remove tables that belong to no axis any more, except the newest few (see :func:`find_table`)."""
    others: list[tuple[float, Path]] = []
    for path in (state / FOLDER_NAME).glob(f"*{SUFFIX}"):
        if path.name.removesuffix(SUFFIX) not in digests:
            with contextlib.suppress(OSError):
                others.append((path.stat().st_mtime, path))
    for _, path in sorted(others)[:-OTHERS_KEPT]:
        with contextlib.suppress(OSError):
            path.unlink()
