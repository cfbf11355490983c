"""Stores into the records of the axes: a process may be killed between two of them, and within one.

A record is mapped memory (``gateway.relay.axis_record``), so no call of the system stores into it. What packs
its parts, in ``gateway.exchange.axis.record_layout``, does it here. Slices stay as they are: they are stored
once after a start, and for a slope.
"""

import errno
import os
import struct
from typing import Any, Final

from gateway.exchange.axis import record_layout
from tests.year.system import MACHINE


class _Stored:
    """A ``struct.Struct`` whose stores are those of the machine."""

    def __init__(self, layout: struct.Struct) -> None:
        self._layout = layout

    def __getattr__(self, name: str) -> Any:
        return getattr(self._layout, name)

    def pack_into(self, buffer: memoryview, at: int, *values: Any) -> None:
        """See ``struct.Struct``."""
        MACHINE.store(buffer, at, self._layout.pack(*values))


_really_allocate, _really_sync = os.posix_fallocate, os.fsync


def _allocate(descriptor: int, offset: int, size: int, /) -> None:
    """See ``os``: what is on the disk already needs no room."""
    if MACHINE.is_disk_full and os.fstat(descriptor).st_size < offset + size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    _really_allocate(descriptor, offset, size)


def _sync(fd: Any) -> None:
    """See ``os``."""
    if MACHINE.is_disk_full:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    _really_sync(fd)


_LAYOUTS: Final = ("_BODY", "_MOVE", "_STEP", "_CRC")


def install() -> None:
    """Take the place of the layouts of a record, and of what a full disk refuses."""
    os.posix_fallocate, os.fsync = _allocate, _sync
    for name in _LAYOUTS:
        setattr(record_layout, name, _Stored(getattr(record_layout, name)))
    for name in ("_STEP", "_CRC"):
        setattr(record_layout, f"_pack{name.lower()}", getattr(record_layout, name).pack_into)
