"""A lock in the state folder: one process of its kind for each folder, and the next one knows."""

import fcntl
import os
from pathlib import Path


def take_lock(path: Path) -> int:
    """Take a lock, which the system lets go of whatever way the process ends; returns its descriptor.

    The file stays when the lock is let go of: whoever removed it could take away that of the next one.

    Raises:
        BlockingIOError: somebody has it.
        OSError: the file cannot be made.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
