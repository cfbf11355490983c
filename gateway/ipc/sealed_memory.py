"""Bytes that one process gives to another and cannot change any more: a memfd with all its seals.

Without the seals a sender could change a correction in the middle of a motion, or end the reading process
(SIGBUS) by truncating the memory.
"""

import fcntl
import mmap
import os
from typing import Final

SEALS: Final = fcntl.F_SEAL_SEAL | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE
_POPULATE: Final = getattr(mmap, "MAP_POPULATE", 0)


class NotSealedError(Exception):
    """A descriptor that is no sealed memory; the text says what it is."""


def seal(data: bytes, name: str) -> int:
    """Return a descriptor of sealed memory that holds ``data``; the caller closes it.

    Raises:
        OSError: there is not enough memory, or there are too many descriptors.
    """
    descriptor = os.memfd_create(name, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        view = memoryview(data)
        while view:
            view = view[os.write(descriptor, view) :]
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, SEALS)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def map_sealed(descriptor: int, largest: int) -> memoryview:
    """Return the bytes of a descriptor that :func:`seal` made; it may be closed afterwards.

    Raises:
        NotSealedError: it is something else, can still be changed, or has more than ``largest`` bytes.
    """
    try:
        seals = fcntl.fcntl(descriptor, fcntl.F_GET_SEALS)
    except OSError:
        raise NotSealedError("the descriptor is not a memfd") from None
    if seals & SEALS != SEALS:
        raise NotSealedError("the memory is not sealed: its sender could change it or cut it short")
    size = os.fstat(descriptor).st_size
    if not 0 < size <= largest:
        raise NotSealedError(f"the memory has {size} bytes; allowed: 1 to {largest}")
    try:
        # Private: older kernels do not map sealed memory as shared, and no process writes to it anyway.
        return memoryview(
            mmap.mmap(descriptor, size, flags=mmap.MAP_PRIVATE | _POPULATE, prot=mmap.PROT_READ)
        )
    except OSError as error:
        raise NotSealedError(f"the memory cannot be mapped: {error.strerror or error}") from None
