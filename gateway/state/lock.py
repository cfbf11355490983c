"""Locks in the state folder: one process of a kind for each folder, and one writer at a time."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from gateway.state.folder import make_folder
from gateway.state.tables import FOLDER_NAME


def take_lock(path: Path) -> int:
    """Take a lock, which the system releases however the process ends; return its descriptor.

    The file stays after the release: removing it could remove the lock of the next process.

    Raises:
        BlockingIOError: another process has it.
        OSError: the file cannot be made.
    """
    import fcntl  # what only reads drive profiles runs without it, on Windows too

    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


@contextlib.contextmanager
def alone_in(state: Path) -> Iterator[None]:
    """Wait until no other process writes here: two writers would remove each other's tables."""
    import fcntl

    make_folder(state)
    make_folder(state / FOLDER_NAME)
    descriptor = os.open(state / FOLDER_NAME, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
